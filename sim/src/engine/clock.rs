//! The clock of a node: an exact map from true time to what it shows, by whole numbers alone.

use crate::random::{self, Purpose};
use crate::scenario::ClockSpec;
use rand_pcg::Pcg64;

/// Parts of a nanosecond in which a clock is kept, so that every rate is exact.
const PARTS: i128 = 1_000_000_000;
/// Time after which a rate wanders, ns.
const WANDERS_EVERY: u64 = 1_000_000_000;

/// A clock. Between two changes of its rate it shows `shows + (t - at) (1 + ppb / 10^9)`.
#[derive(Clone, Debug)]
pub struct Clock {
    /// True time of the last change, ns.
    at: u64,
    /// What it showed then, in parts.
    shows: i128,
    /// How much too fast it is, parts in a billion.
    ppb: i64,
    /// Standard deviation of the change of that in a second.
    wander_ppb: u64,
    stream: Pcg64,
    /// Jumps to come: true time and how far, ns; the latest first.
    jumps: Vec<(u64, i64)>,
    /// Drifts to come: true time and parts in a billion; the latest first.
    drifts: Vec<(u64, i64)>,
    /// When the rate changes next, ns.
    wanders_at: u64,
}

impl Clock {
    /// The clock of the node with this index, which shows 0 at true time 0.
    pub fn new(spec: &ClockSpec, seed: u64, index: usize) -> Self {
        let latest_first = |changes: &[(u64, i64)]| {
            let mut changes = changes.to_vec();
            changes.sort_by_key(|change| std::cmp::Reverse(change.0));
            changes
        };
        let (jumps, drifts) = (latest_first(&spec.jumps), latest_first(&spec.drifts));
        Self {
            at: 0,
            shows: 0,
            ppb: spec.drift_ppb,
            wander_ppb: spec.wander_ppb,
            stream: random::stream(seed, Purpose::ClockWander, index as u64),
            jumps,
            drifts,
            wanders_at: if spec.wander_ppb == 0 { u64::MAX } else { WANDERS_EVERY },
        }
    }

    fn rate(&self) -> i128 {
        PARTS + i128::from(self.ppb)
    }

    fn parts(&self, t: u64) -> i128 {
        self.shows + (i128::from(t) - i128::from(self.at)) * self.rate()
    }

    /// When it changes next, ns.
    fn changes_at(&self) -> u64 {
        let next = |changes: &[(u64, i64)]| changes.last().map_or(u64::MAX, |change| change.0);
        next(&self.jumps).min(next(&self.drifts)).min(self.wanders_at)
    }

    /// Makes the changes up to `t`.
    pub fn advance_to(&mut self, t: u64) {
        while self.changes_at() <= t {
            let at = self.changes_at();
            (self.shows, self.at) = (self.parts(at), at);
            if self.jumps.last().is_some_and(|jump| jump.0 == at)
                && let Some((_, by)) = self.jumps.pop()
            {
                self.shows += i128::from(by) * PARTS;
            } else if self.drifts.last().is_some_and(|drift| drift.0 == at)
                && let Some((_, ppb)) = self.drifts.pop()
            {
                self.ppb = ppb;
            } else {
                let change = random::gaussian(&mut self.stream) * self.wander_ppb as f64;
                self.ppb += change.round() as i64;
                self.wanders_at = at.saturating_add(WANDERS_EVERY);
            }
        }
    }

    /// What it shows at true time `t`, ns. Times do not go back, but by less than from one change to the
    /// next.
    pub fn shows(&mut self, t: u64) -> u64 {
        self.advance_to(t);
        u64::try_from(self.parts(t).div_euclid(PARTS).max(0)).unwrap_or(u64::MAX)
    }

    /// The first true time at which it shows `own` or more (ns); where it changes before that, the time of
    /// the change.
    pub fn when(&self, own: u64) -> u64 {
        let left = i128::from(own) * PARTS - self.shows;
        let passed = if left <= 0 { 0 } else { (left + self.rate() - 1) / self.rate() };
        u64::try_from(i128::from(self.at) + passed).unwrap_or(u64::MAX).min(self.changes_at())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn clock(spec: ClockSpec) -> Clock {
        Clock::new(&spec, 1, 0)
    }

    #[test]
    fn a_clock_shows_exactly_what_its_rate_makes_of_true_time() {
        let mut fast = clock(ClockSpec { drift_ppb: 50_000, ..ClockSpec::default() });
        assert_eq!([0, 1, 19_999, 20_000, 40_000].map(|t| fast.shows(t)), [0, 1, 19_999, 20_001, 40_002]);
        assert_eq!(fast.shows(3_600_000_000_000), 3_600_180_000_000);
        assert_eq!(fast.when(20_001), 20_000);
        for own in [1, 7, 20_000, 20_001, 999_999_999_999] {
            let t = fast.when(own);
            assert!(fast.parts(t) >= i128::from(own) * PARTS && fast.parts(t - 1) < i128::from(own) * PARTS);
        }
    }

    #[test]
    fn a_clock_jumps_where_it_is_told_to() {
        let jumps = vec![(1_000, 500), (2_000, -300)];
        let mut clock = clock(ClockSpec { jumps, ..ClockSpec::default() });
        assert_eq!(
            [999, 1_000, 1_999, 2_000, 3_000].map(|t| clock.shows(t)),
            [999, 1_500, 2_499, 2_200, 3_200]
        );
    }

    #[test]
    fn a_clock_drifts_as_it_is_told_to_from_then_on() {
        let drifts = vec![(20_000, -50_000), (60_000, 0)];
        let mut clock = clock(ClockSpec { drift_ppb: 50_000, drifts, ..ClockSpec::default() });
        assert_eq!(
            [20_000, 40_000, 60_000, 90_000].map(|t| clock.shows(t)),
            [20_001, 40_000, 59_999, 89_999]
        );
    }

    #[test]
    fn a_rate_wanders_by_the_seed_and_no_further_than_it_should() {
        let spec = ClockSpec { wander_ppb: 100, ..ClockSpec::default() };
        let ends = |seed| {
            let mut clock = Clock::new(&spec, seed, 3);
            clock.shows(100_000_000_000).abs_diff(100_000_000_000)
        };
        assert_eq!(ends(1), ends(1));
        assert_ne!(ends(1), ends(2));
        // Standard deviation 100 ppb sqrt(100^3 / 3) s = 58 us.
        assert!((1..20).all(|seed| ends(seed) < 300_000));
    }
}
