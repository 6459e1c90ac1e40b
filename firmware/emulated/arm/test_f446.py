"""The Nucleo-F446RE's image."""

import unittest

import settings
from expect import OnCan
from f446 import F446


class Classic(OnCan, unittest.TestCase):
    """CAN with classic frames."""

    BOARD, WATCHDOG_S, CUT_EVERY = F446, 2.0, settings.cut_every(25)


if __name__ == "__main__":
    unittest.main()
