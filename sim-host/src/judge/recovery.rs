//! What events do to a run: the ticks that they disturb, and how long the network takes to be inside its funnels again.
//!
//! From the begin of an event to `expect.recovered_within` after its end, node-ticks count by themselves. An event that begins while the
//! network is still outside takes nothing over: the one before goes on being measured.

use crate::scenario::{Scenario, TimeSpec};
use std::ops::Range;

/// What was found at the ticks that events disturb.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct DuringEvents {
    /// Node-ticks that were judged; per component.
    pub judged: u64,
    /// Those with `|nu| >= psi`, or with a term that is not a number.
    pub breaches: u64,
    /// The largest `|nu| / psi`; NaN where one was not a number.
    pub max_ratio: f64,
}

/// Follows how a network recovers from the events of its scenario.
pub(super) struct Recovery {
    time: TimeSpec,
    /// First ticks of the events that have not begun, the next one last.
    begins: Vec<u64>,
    /// Ends of the events that have not ended, ns, the next one last.
    ends: Vec<u64>,
    /// Ticks that are disturbed, ascending, apart from each other.
    disturbed: Vec<Range<u64>>,
    /// Events that have ended, and from which the network has not recovered yet, or may leave its funnels again.
    open: Vec<Open>,
    /// Whether a node was outside at the last tick.
    outside: bool,
    /// Longest time from the end of an event to the last tick outside, ns.
    longest: u64,
}

/// An event that has ended.
struct Open {
    end_ns: u64,
    /// Time of the last tick outside since, ns.
    outside_at: Option<u64>,
}

impl Recovery {
    /// Of the events of a scenario; `None` where nothing is expected of the recovery, or there is nothing to recover from.
    pub(super) fn of(scenario: &Scenario) -> Option<Self> {
        let within = scenario.expect.recovered_within_ns?;
        let disturbances = scenario.course().disturbances(&scenario.events);
        let events: Option<Vec<(u64, u64)>> = disturbances
            .iter()
            .map(|disturbance| Some((scenario.time.first_tick(disturbance.from_ns), disturbance.end_ns?)))
            .collect();
        let events = events.filter(|events| !events.is_empty())?;
        let range =
            |&(from, end_ns): &(u64, u64)| from..scenario.time.first_tick(end_ns.saturating_add(within));
        Some(Self::new(scenario.time, &events, joined(events.iter().map(range))))
    }

    /// Of events by first tick and end (ns).
    fn new(time: TimeSpec, events: &[(u64, u64)], disturbed: Vec<Range<u64>>) -> Self {
        let (mut begins, mut ends): (Vec<u64>, Vec<u64>) = events.iter().copied().unzip();
        begins.sort_unstable_by(|a, b| b.cmp(a));
        ends.sort_unstable_by(|a, b| b.cmp(a));
        Self { time, begins, ends, disturbed, open: Vec::new(), outside: false, longest: 0 }
    }

    /// Whether events disturb tick `k`.
    pub(super) fn is_disturbed(&self, k: u64) -> bool {
        let at = self.disturbed.partition_point(|range| range.end <= k);
        self.disturbed.get(at).is_some_and(|range| range.contains(&k))
    }

    /// Takes tick `k`, at which a node was outside or none was.
    pub(super) fn tick(&mut self, k: u64, outside: bool) {
        let now = self.time.at_ns(k);
        let mut begins = false;
        while self.begins.pop_if(|from| *from <= k).is_some() {
            begins = true;
        }
        if begins && !self.outside {
            self.close();
        }
        while let Some(end_ns) = self.ends.pop_if(|end_ns| *end_ns <= now) {
            self.open.push(Open { end_ns, outside_at: None });
        }
        if outside {
            self.open.iter_mut().for_each(|open| open.outside_at = Some(now));
        }
        self.outside = outside;
    }

    fn close(&mut self) {
        for open in self.open.drain(..) {
            let took = open.outside_at.map_or(0, |at| at.saturating_sub(open.end_ns));
            self.longest = self.longest.max(took);
        }
    }

    /// The longest time from the end of an event to the last tick outside, s; `None` where the run ended before an event did, or
    /// with a node outside.
    pub(super) fn finish(mut self) -> Option<f64> {
        let recovered = self.ends.is_empty() && (!self.outside || self.open.is_empty());
        self.close();
        recovered.then_some(self.longest as f64 / 1e9)
    }
}

/// Ranges, in the order of their starts, as ranges that are apart from each other.
fn joined(ranges: impl Iterator<Item = Range<u64>>) -> Vec<Range<u64>> {
    let mut joined: Vec<Range<u64>> = Vec::new();
    for range in ranges {
        match joined.last_mut() {
            Some(last) if range.start <= last.end => last.end = last.end.max(range.end),
            _ => joined.push(range),
        }
    }
    joined
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Ticks of 1 ms; events by first tick and end in ms.
    fn recovery(events: &[(u64, u64)]) -> Recovery {
        let events: Vec<_> = events.iter().map(|&(from, end)| (from, end * 1_000_000)).collect();
        Recovery::new(TimeSpec::plain(1_000_000, u64::MAX), &events, Vec::new())
    }

    fn took(events: &[(u64, u64)], ticks: u64, outside: impl Fn(u64) -> bool) -> Option<f64> {
        let mut recovery = recovery(events);
        (0..ticks).for_each(|k| recovery.tick(k, outside(k)));
        recovery.finish()
    }

    #[test]
    fn the_time_runs_from_the_end_of_an_event_to_the_last_tick_outside() {
        assert_eq!(took(&[(10, 20)], 100, |k| (12..35).contains(&k)), Some(0.014));
        assert_eq!(took(&[(10, 20)], 100, |k| k < 20), Some(0.0));
        assert_eq!(took(&[(10, 20)], 100, |k| k == 25 || k == 90), Some(0.07));
    }

    #[test]
    fn a_run_that_ends_outside_or_too_early_has_no_such_time() {
        assert_eq!(took(&[(10, 20)], 100, |k| k == 99), None);
        assert_eq!(took(&[(10, 20)], 15, |_| false), None);
    }

    #[test]
    fn an_event_that_comes_while_the_network_is_outside_hides_nothing() {
        // Outside from the first event to tick 60, across the second one.
        assert_eq!(took(&[(10, 10), (40, 40)], 100, |k| (10..=60).contains(&k)), Some(0.05));
        // Inside again before the second one.
        assert_eq!(took(&[(10, 10), (40, 40)], 100, |k| (10..30).contains(&k) || k == 55), Some(0.019));
    }

    #[test]
    fn disturbed_ticks_are_joined() {
        let mut recovery = recovery(&[]);
        recovery.disturbed = joined([3..5, 5..7, 6..8, 20..21].into_iter());
        assert_eq!(recovery.disturbed, [3..8, 20..21]);
        let disturbed: Vec<u64> = (0..30).filter(|&k| recovery.is_disturbed(k)).collect();
        assert_eq!(disturbed, [3, 4, 5, 6, 7, 20]);
    }
}
