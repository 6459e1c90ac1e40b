"""The Nucleo-F446RE's image."""

import unittest
from unittest import mock

import settings
from expect import STATES, OnCan
from f446 import ERASE_NS, F446, HALF_NS, Flash
from even import tick_of, width
from words import CONFIGURED, STORED, Words, log_of

# Longer than what embassy's timer counts.
LONG_TICK_US = 100_000


class Classic(OnCan, unittest.TestCase):
    """CAN with classic frames."""

    BOARD, WATCHDOG_S, CUT_EVERY, IS_STORAGE_LAST = F446, 2.0, settings.cut_every(25), False

    def test_its_flash_is_read_through_its_caches_and_ahead(self):
        board = self.BOARD.booted()
        wanted = Flash.PREFETCH | Flash.INSTRUCTIONS | Flash.DATA
        self.assertEqual(board.flash.get(Flash.ACR) & wanted, wanted)
        self.stored_again(board)
        self.assertEqual(board.flash.get(Flash.ACR) & wanted, wanted)
        self.assertEqual(board.flash.faults, [])

    def stored_again(self, board):
        """Stores twice: the second time half of its storage is erased by itself."""
        self.configured(board)
        for _ in range(2):
            self.assertIn("ok", board.ask(Words.of()["store"], STORED)["stored"])

    def started_late_by(self, board):
        """Starts a node; how much later than that its own clock says that it has started, ns."""
        board.core.log()
        begin = board.core.ns
        self.start(board)
        board.ms(1)
        [line] = [line for line in log_of(board).splitlines() if line.endswith("started")]
        return float(line.split()[0]) * 1e9 - begin

    def test_its_time_is_right_after_it_has_erased(self):
        # An odd and an even number of halves of its timer, whatever the phase.
        for longer_ns in [HALF_NS * part for part in (0, 0.2, 0.4, 0.6, 0.8)]:
            with self.subTest(erase_ns=ERASE_NS + longer_ns), mock.patch("f446.ERASE_NS", ERASE_NS + longer_ns):
                board = self.BOARD.booted()
                self.stored_again(board)
                self.assertGreater(board.watchdog.longest, 3 * HALF_NS, "no half was missed: the test shows nothing")
                # Its ticks are alarms that are set far ahead: a half that is missing makes them late by a turn.
                by_timer = Words.of(tick_of(LONG_TICK_US), "time.duration=4s")["nodes"][0]["configure_by_timer"]
                self.assertEqual(board.ask(by_timer, CONFIGURED)["configured"], {"ok": None})
                board.can.sent_at.clear(), board.can.sent.clear()
                self.assertLess(abs(self.started_late_by(board)), 1e6)
                board.ms(3_000)
                states = [at for at, sent in zip(board.can.sent_at, board.can.sent) if STATES[0] <= sent.id >> 7 <= STATES[1]]
                times = [at / 1e3 for at in states]
                self.assertGreater(len(times), 25)
                self.assertLess(width(times, LONG_TICK_US), 1_000)


if __name__ == "__main__":
    unittest.main()
