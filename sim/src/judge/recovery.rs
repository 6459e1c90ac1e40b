//! What events do to a run: the ticks that they disturb, and how long the network takes to be inside its
//! funnels again.
//!
//! From the begin of an event to `expect.recovered_within` after its end, node-ticks count by themselves. An
//! event that begins while the network is still outside takes nothing over: the one before goes on being
//! measured.
//!
//! An event that ends within another one, or as another one begins, has not ended for the network: its time
//! runs from the end of the last event that covers it. A node that joins in a partition has nobody to come to
//! before the links are mended.

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
    /// Events that have ended, and from which the network has not recovered yet, or may leave its funnels
    /// again.
    open: Vec<Open>,
    /// Whether a node was outside at the last tick.
    outside: bool,
    /// Longest time from the end of an event to the last tick outside, ns; none once no term was known after
    /// an event.
    longest: Option<u64>,
}

/// An event that has ended.
struct Open {
    end_ns: u64,
    /// Time of the last tick outside since, ns.
    outside_at: Option<u64>,
    /// A term was known since.
    is_seen: bool,
}

impl Recovery {
    /// Of the events of a scenario; `None` where nothing is expected of the recovery, or there is nothing to
    /// recover from.
    pub(super) fn of(scenario: &Scenario) -> Option<Self> {
        let within = scenario.expect.recovered_within_ns?;
        let disturbances = scenario.course().disturbances(&scenario.events);
        let spans: Option<Vec<Range<u64>>> =
            disturbances.iter().map(|disturbance| Some(disturbance.from_ns..disturbance.end_ns?)).collect();
        let spans = spans.filter(|spans| !spans.is_empty())?;
        let begins = spans.iter().map(|span| scenario.time.first_tick(span.start));
        let events: Vec<(u64, u64)> = begins.zip(covered(&spans)).collect();
        let range =
            |&(from, end_ns): &(u64, u64)| from..scenario.time.first_tick(end_ns.saturating_add(within));
        Some(Self::new(scenario.time, &events, joined(events.iter().map(range))))
    }

    /// Of events by first tick and end (ns).
    fn new(time: TimeSpec, events: &[(u64, u64)], disturbed: Vec<Range<u64>>) -> Self {
        let (mut begins, mut ends): (Vec<u64>, Vec<u64>) = events.iter().copied().unzip();
        begins.sort_unstable_by(|a, b| b.cmp(a));
        ends.sort_unstable_by(|a, b| b.cmp(a));
        Self { time, begins, ends, disturbed, open: Vec::new(), outside: false, longest: Some(0) }
    }

    /// Whether events disturb tick `k`.
    pub(super) fn is_disturbed(&self, k: u64) -> bool {
        let at = self.disturbed.partition_point(|range| range.end <= k);
        self.disturbed.get(at).is_some_and(|range| range.contains(&k))
    }

    /// Takes tick `k`, at which a node was outside or none was; `None` where no term was known.
    pub(super) fn tick(&mut self, k: u64, outside: Option<bool>) {
        let now = self.time.at_ns(k);
        let mut begins = false;
        while self.begins.pop_if(|from| *from <= k).is_some() {
            begins = true;
        }
        if begins && !self.outside {
            self.close();
        }
        while let Some(end_ns) = self.ends.pop_if(|end_ns| *end_ns <= now) {
            self.open.push(Open { end_ns, outside_at: None, is_seen: false });
        }
        let Some(outside) = outside else { return };
        for open in &mut self.open {
            open.is_seen = true;
            if outside {
                open.outside_at = Some(now);
            }
        }
        self.outside = outside;
    }

    fn close(&mut self) {
        for open in self.open.drain(..) {
            let took = open.outside_at.map_or(0, |at| at.saturating_sub(open.end_ns));
            // Where nobody is left to be outside, nothing has recovered.
            self.longest = self.longest.filter(|_| open.is_seen).map(|longest| longest.max(took));
        }
    }

    /// The longest time from the end of an event to the last tick outside, s; `None` where the run ended
    /// before an event did, or with a node outside, or where no term was known after an event.
    pub(super) fn finish(mut self) -> Option<f64> {
        let recovered = self.ends.is_empty() && (!self.outside || self.open.is_empty());
        self.close();
        self.longest.filter(|_| recovered).map(|longest| longest as f64 / 1e9)
    }
}

/// When each of `spans` has ended for the network: the end of the last one that covers it. They are in the
/// order of their begins.
pub(super) fn covered(spans: &[Range<u64>]) -> Vec<u64> {
    let joined = joined(spans.iter().cloned());
    let end = |span: &Range<u64>| {
        let at = joined.partition_point(|whole| whole.end < span.end);
        joined.get(at).map_or(span.end, |whole| whole.end)
    };
    spans.iter().map(end).collect()
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
        (0..ticks).for_each(|k| recovery.tick(k, Some(outside(k))));
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
    fn where_nobody_is_left_to_be_outside_nothing_has_recovered() {
        let took = |known: fn(u64) -> bool| {
            let mut recovery = recovery(&[(10, 20)]);
            (0..100).for_each(|k| recovery.tick(k, known(k).then_some(k == 30)));
            recovery.finish()
        };
        assert_eq!([took(|k| k < 20), took(|k| k < 40), took(|_| true)], [None, Some(0.01), Some(0.01)]);
    }

    #[test]
    fn an_event_that_comes_while_the_network_is_outside_hides_nothing() {
        // Outside from the first event to tick 60, across the second one.
        assert_eq!(took(&[(10, 10), (40, 40)], 100, |k| (10..=60).contains(&k)), Some(0.05));
        // Inside again before the second one.
        assert_eq!(took(&[(10, 10), (40, 40)], 100, |k| (10..30).contains(&k) || k == 55), Some(0.019));
    }

    #[test]
    fn an_event_ends_with_the_last_one_that_covers_it() {
        // A join in a partition, one at its end, and one after it; two partitions that overlap.
        assert_eq!(covered(&[10..50, 20..20, 50..50, 60..60]), [50, 50, 50, 60]);
        assert_eq!(covered(&[10..50, 20..20, 30..80, 90..95]), [80, 80, 80, 95]);
        assert_eq!(covered(&[5..5, 10..50]), [5, 50]);
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
