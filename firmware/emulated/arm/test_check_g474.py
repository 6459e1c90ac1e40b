"""The image that checks its own Nucleo-G474RE: all is well with all of its hardware there, and each check says what is missing where it is taken away."""

import unittest

from expect_check import Checks, OnCan, OneClock
from g474 import G474, PAGE as PAGE_OF_FLASH, G474Check


class Check(Checks, OnCan, OneClock, unittest.TestCase):
    """What it says."""

    NODE, CHECK, PAGE, JUMPER = G474, G474Check, PAGE_OF_FLASH, "from PC4 to PC5"
    NO_CLOCK, TIMER_HZ_WITHOUT = "no crystal", 16_000_000


if __name__ == "__main__":
    unittest.main()
