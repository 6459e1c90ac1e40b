"""The Nucleo-F446RE's image."""

import unittest

import settings
from expect import OnCan
from f446 import F446, Flash, TURN_NS
from words import STORED, Words, log_of


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
        board = self.BOARD.booted()
        self.stored_again(board)
        self.assertGreater(board.core.ns, 3 * TURN_NS, "no turn of its timer was missed: the test shows nothing")
        self.assertLess(abs(self.started_late_by(board)), 1e6)


if __name__ == "__main__":
    unittest.main()
