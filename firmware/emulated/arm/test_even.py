"""How ticks are judged, on rows whose shape is known."""

import math
import unittest

from even import LARGEST_JITTER, TICK_US, width

COUNT_US, TICKS = 1e6 / 32_768, 500
BOUND = LARGEST_JITTER * TICK_US


class Judged(unittest.TestCase):
    """Rows of 500 ticks."""

    def row(self, *late):
        """Each late by so much, in turn."""
        return [index * TICK_US + late[index % len(late)] for index in range(TICKS)]

    def test_what_comes_late_is_seen_once_and_at_its_size(self):
        self.assertEqual(width(self.row(0), TICK_US), 0)
        self.assertEqual(width(self.row(*[0] * 99, 60), TICK_US), 60)
        self.assertGreater(60, BOUND)

    def test_whole_counts_of_a_coarse_clock_are_seen(self):
        counted = [math.ceil(index * TICK_US / COUNT_US) * COUNT_US for index in range(TICKS)]
        self.assertAlmostEqual(width(counted, TICK_US), COUNT_US, delta=0.5)

    def test_a_clock_that_runs_away_is_seen(self):
        self.assertGreater(width([index * (TICK_US + 0.3) for index in range(TICKS)], TICK_US), BOUND)


if __name__ == "__main__":
    unittest.main()
