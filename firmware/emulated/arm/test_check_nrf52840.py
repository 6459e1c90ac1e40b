"""The image that checks its own nRF52840-DK: all is well with all of its hardware there, and each check says what is missing where it is taken away."""

import unittest

from expect_check import Checks
from nrf52840 import Nrf52840, Nrf52840Check
from nrf_peripherals import PAGE as PAGE_OF_FLASH

CRYSTALS = {(False, True): "no crystal of 32 MHz", (True, False): "no crystal of 32,768 Hz", (False, False): "RC oscillators, no crystal"}


class Check(Checks, unittest.TestCase):
    """What it says."""

    NODE, CHECK, PAGE, JUMPER, CAN = Nrf52840, Nrf52840Check, PAGE_OF_FLASH, "from P1.02 to P1.01", "SKIPPED"
    JITTER_NS = 200e3

    def test_each_missing_crystal_is_found(self):
        for (has_fast, has_slow), said in CRYSTALS.items():
            with self.subTest(said):
                board = self.CHECK()
                board.rcc.has_fast_crystal, board.rcc.has_slow_crystal = has_fast, has_slow
                self.assertEqual(self.verdicts(board.finished(), clock="FAIL")["clock"][1], said)


if __name__ == "__main__":
    unittest.main()
