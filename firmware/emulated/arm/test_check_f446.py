"""The image that checks its own Nucleo-F446RE: all is well with all of its hardware there, and each check says what is missing where it is taken away."""

import unittest

from expect_check import Checks, OnCan, OneClock
from f446 import F446, SECTOR, F446Check


class Check(Checks, OnCan, OneClock, unittest.TestCase):
    """What it says."""

    NODE, CHECK, PAGE, JUMPER, NO_CLOCK = F446, F446Check, SECTOR, "from PA9 to PA10", "no clock of the ST-LINK"


if __name__ == "__main__":
    unittest.main()
