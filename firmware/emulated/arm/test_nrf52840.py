"""The nRF52840-DK's image."""

import unittest

import settings
from expect import OnLine, OnLines
from nrf52840 import Nrf52840, Nrf52840Peers


class Line(OnLine, unittest.TestCase):
    """Both planes on UARTE 0."""

    BOARD, WATCHDOG_S, CUT_EVERY = Nrf52840, 2.0, settings.cut_every(25)


class Peers(OnLines, unittest.TestCase):
    """A line to a neighbour."""

    BOARD = Nrf52840Peers


if __name__ == "__main__":
    unittest.main()
