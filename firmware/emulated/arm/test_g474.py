"""The Nucleo-G474RE's image."""

import unittest

import settings
from core import NMI
from expect import OnCan, OnLines, Words
from g474 import FLASH, G474, STORAGE, G474Fd, G474Peers
from words import CONFIGURED


class Classic(OnCan, unittest.TestCase):
    """CAN with classic frames."""

    BOARD, WATCHDOG_S, CUT_EVERY = G474, 2.0, settings.cut_every(7)

    def spoiled(self, unit, delay):
        """A node that finds in its storage a word whose write was cut, with NMIs that come `delay` instructions late."""
        whole = self.stored()
        start, size = STORAGE
        written = next(at for at in range(start, start + size, 8) if whole.core.uc.mem_read(at, 8) != b"\xff" * 8)
        board = self.BOARD(storage=whole.storage(), broken=[written])
        board.flash.ecc_unit, board.core.nmi_delay = unit, delay
        board.ms(self.BOARD.boot_ms)
        return board

    def test_a_word_of_the_storage_that_a_cut_has_spoiled_is_no_defect_however_late_its_nmi_comes(self):
        for unit in (1, 8):
            for delay in (0, 1, 10, 100):
                with self.subTest(unit=unit, delay=delay):
                    board = self.spoiled(unit, delay)
                    self.assertGreater(board.core.nmis, 0)
                    self.assertEqual(board.core.resets, 0)
                    self.assertIsNotNone(board.identity(Words.of()))

    def test_a_word_elsewhere_that_cannot_be_corrected_resets_it(self):
        for address in (FLASH + 0x1000, STORAGE[0] - 8, FLASH + 0x3E000):
            with self.subTest(address=hex(address)):
                board = self.BOARD.booted()
                board.flash.detect(address)
                board.core.enter(NMI)
                board.ms(self.BOARD.boot_ms + 10)
                self.assertEqual(board.core.resets, 1)
                self.assertEqual(board.identity(Words.of())["reset"], "HardFault")


class Fd(OnCan, unittest.TestCase):
    """CAN with frames of CAN FD."""

    BOARD, WATCHDOG_S, CUT_EVERY = G474Fd, 2.0, settings.cut_every(25)


class Peers(OnLines, unittest.TestCase):
    """Lines to neighbours."""

    BOARD = G474Peers

    def test_errors_on_any_of_its_lines_are_counted(self):
        board, errors = self.BOARD.booted(), 0
        self.assertEqual(board.ask(Words.of()["nodes"][0]["configure"], CONFIGURED)["configured"], {"ok": None})
        for uart in (board.uart, *(uart for uart, _ in board.peers)):
            with self.subTest(irq=uart.irq):
                errors = self.errors_are_counted(board, uart, errors)
        self.assertEqual(board.core.resets, 0)


if __name__ == "__main__":
    unittest.main()
