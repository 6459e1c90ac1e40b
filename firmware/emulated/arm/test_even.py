"""How ticks are judged, on rows whose shape is known."""

import unittest

from even import LARGEST_JITTER, TICK_US, parts, width

HZ, COUNT_US, TICKS = 32_768, 1e6 / 32_768, 500
BOUND = LARGEST_JITTER * TICK_US


class Judged(unittest.TestCase):
    """Rows of 500 ticks."""

    def counted(self, *late):
        """Each at the next whole count after it is due, then late by so much, in turn."""
        return [-(-index * TICK_US // COUNT_US) * COUNT_US + late[index % len(late)] for index in range(TICKS)]

    def test_whole_counts_are_the_clocks(self):
        of_clock, of_rest = parts(self.counted(0), TICK_US, HZ)
        self.assertAlmostEqual(of_clock, COUNT_US, delta=0.5)
        self.assertLess(of_rest, 1e-6)

    def test_what_comes_late_is_not_the_clocks(self):
        self.assertAlmostEqual(parts(self.counted(0, 0, 0, 0, 20), TICK_US, HZ)[1], 20, delta=1)
        self.assertGreater(parts(self.counted(*[0] * 99, 60), TICK_US, HZ)[1], BOUND)

    def test_a_clock_that_runs_away_is_seen(self):
        runs_away = [index * (TICK_US + 0.3) for index in range(TICKS)]
        self.assertGreater(parts(runs_away, TICK_US, HZ)[1], BOUND)
        self.assertGreater(width(runs_away, TICK_US), BOUND)


if __name__ == "__main__":
    unittest.main()
