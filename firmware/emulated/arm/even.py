"""How even the ticks of a node's own clock are while its bus is busy: what a node on CAN and one on a line share. Mixed into a
`unittest.TestCase` that says how its board is started, loaded and asked."""

import math

import settings
from words import CONFIGURED, REPORT, Words

TICK_US, LARGEST_JITTER = 1000, 0.05
# Instructions at a time where jitter is measured: 1.6 us at 160 MHz, 3.9 us at 64 MHz.
FINE_SLICE = 250
# Beginnings of a row of counts that are told apart.
PHASES = 1000


class Even:
    """A node that ticks by its own clock. Its test has `start`, which says CTRL start; `with_traffic`, which runs it and gives the times of
    its states, us; and `lost`, what its bus or line has lost."""

    def timed(self, configure):
        """A node that ticks by its own clock, and has been started."""
        board = self.BOARD.booted()
        self.assertEqual(board.ask(Words.of()["nodes"][0][configure], CONFIGURED)["configured"], {"ok": None})
        board.core.slice_length = FINE_SLICE
        self.start(board)
        return board

    def counters(self, board):
        return board.ask(Words.of()["report"], REPORT)["report"]["counters"]

    def jitter(self, configure):
        board, ticks = self.timed(configure), settings.jitter_ticks()
        times = self.with_traffic(board, ticks)
        self.assertGreaterEqual(len(times), ticks - 2)
        counters = self.counters(board)
        print(f"{board.image}, {configure}: {len(times)} ticks by its own clock with traffic, jitter {width(times):.1f} us{shares(times, board)}, "
              f"{counters['overruns']} late by a period, {counters['link']['unsaid']} unsaid")
        self.assertLess(width(times), LARGEST_JITTER * TICK_US)
        self.assertEqual((counters["overruns"], counters["link"]["frames"], self.lost(board)), (0, 0, 0))
        return counters

    def test_ticks_of_its_own_clock_are_even_with_traffic(self):
        self.jitter("configure_by_timer")

    def test_a_core_that_stands_still_once_is_seen_in_the_row_of_its_ticks(self):
        board = self.timed("configure_by_timer")
        stall = lambda tick: board.core.stall(1.5e6) if tick == 10 else None
        self.assertGreater(width(self.with_traffic(board, 20, stall)), LARGEST_JITTER * TICK_US)


def width(times, row=lambda index: index * TICK_US):
    """How far times are from a row, by default one of exactly the period: earliest to latest, us."""
    late = [at - row(index) for index, at in enumerate(times)]
    return max(late) - min(late)


def shares(times, board):
    """Of a clock with coarse counts, in words: how far the nearest row of whole counts is from an even one, and the times from that row."""
    if board.clock_hz is None:
        return ""
    count_us = 1e6 / board.clock_hz
    rows = [lambda index, phase=phase: math.floor(phase / PHASES + index * TICK_US / count_us) * count_us for phase in range(PHASES)]
    row = min(rows, key=lambda row: width(times, row))
    of_clock = width([row(index) for index in range(len(times))])
    return f" (its clock's counts {of_clock:.1f} us, the rest {width(times, row):.1f} us)"
