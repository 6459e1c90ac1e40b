"""How even the ticks of a node's own clock are while its bus is busy: what a node on CAN and one on a line share. Mixed into a
`unittest.TestCase` that says how its board is started, loaded and asked."""

import settings
from words import CONFIGURED, REPORT, Words

TICK_US, LARGEST_JITTER = 1000, 0.05
# Instructions at a time where jitter is measured: 1.6 us at 160 MHz, 3.9 us at 64 MHz.
FINE_SLICE = 250


class Even:
    """A node that ticks by its own clock. Its test has `start`, which says CTRL start; `with_traffic`, which runs it and gives the times of
    its states, us; and `lost`, what its bus or line has lost."""

    def timed(self, configure, *overrides):
        """A node that ticks by its own clock, and has been started."""
        board = self.BOARD.booted()
        self.assertEqual(board.ask(Words.of(*overrides)["nodes"][0][configure], CONFIGURED)["configured"], {"ok": None})
        board.core.slice_length = FINE_SLICE
        self.start(board)
        return board

    def counters(self, board):
        return board.ask(Words.of()["report"], REPORT)["report"]["counters"]

    def row(self, configure, tick_us):
        """The times of a node's states, and what it has counted; none is late by a period, and nothing is lost."""
        ticks = settings.jitter_ticks()
        board = self.timed(configure, tick_of(tick_us))
        times = self.with_traffic(board, ticks, tick_us)
        self.assertGreaterEqual(len(times), ticks - 2)
        counters = self.counters(board)
        print(f"{board.image}, {configure}: {len(times)} ticks of {tick_us} us by its own clock with traffic, jitter {width(times, tick_us):.1f} us"
              f", {counters['overruns']} late by a period, {counters['link']['unsaid']} unsaid")
        self.assertEqual((counters["overruns"], counters["link"]["frames"], self.lost(board)), (0, 0, 0))
        return times, counters

    def jitter(self, configure):
        times, counters = self.row(configure, TICK_US)
        self.assertLess(width(times, TICK_US), LARGEST_JITTER * TICK_US)
        return counters

    def test_ticks_of_its_own_clock_are_even_with_traffic(self):
        self.jitter("configure_by_timer")

    def test_a_core_that_stands_still_once_is_seen_in_the_row_of_its_ticks(self):
        board = self.timed("configure_by_timer")
        stall = lambda index: board.core.stall(1.5e6) if index == 10 else None
        times = self.with_traffic(board, 20, at=stall)
        self.assertGreater(width(times, TICK_US), LARGEST_JITTER * TICK_US)


def tick_of(tick_us):
    """The scenario's setting."""
    return f"time.tick={tick_us}us"


def width(times, tick_us):
    """How far times are from an even row: earliest to latest, us."""
    late = [at - index * tick_us for index, at in enumerate(times)]
    return max(late) - min(late)
