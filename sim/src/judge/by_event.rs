//! What each event did to a run: how far nodes left their funnels, and when all were inside again.
//!
//! To an event count the ticks from its begin on, up to the first event that begins after its end. Those of events that overlap count to each of them.

use super::Ratios;
use super::recovery::{DuringEvents, covered};
use crate::scenario::{Scenario, TimeSpec};

/// What was found of one event.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct EventFigures {
    /// Its end, ns of the scenario; none where links stay cut.
    pub end_ns: Option<u64>,
    /// Its ticks.
    pub during: DuringEvents,
    /// How it ended.
    pub recovery: Recovered,
}

/// How the network came back from an event.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub enum Recovered {
    /// All were inside this long after its end, s: until the last of its ticks with a node outside.
    After(f64),
    /// A node was outside at the last of its ticks, or links stayed cut.
    Outside,
    /// It has no tick after its end at which a term was known.
    #[default]
    NotSeen,
}

impl Recovered {
    /// The time, where there is one, s.
    #[must_use]
    pub fn after_s(self) -> Option<f64> {
        match self {
            Self::After(s) => Some(s),
            Self::Outside | Self::NotSeen => None,
        }
    }
}

/// Follows the events of a scenario.
pub(super) struct ByEvent {
    time: TimeSpec,
    spans: Vec<Span>,
    /// The first span that has not begun. They are in the order of their begins.
    next: usize,
    /// Those that go on.
    open: Vec<usize>,
}

struct Span {
    /// First tick, and the first one that is no more its own.
    from: u64,
    to: u64,
    end_ns: Option<u64>,
    during: DuringEvents,
    /// The last tick outside, and the last one with a known term, since its end.
    outside: Option<u64>,
    seen: Option<u64>,
}

impl ByEvent {
    /// Of the events of a scenario; none where there are none.
    pub(super) fn of(scenario: &Scenario) -> Option<Self> {
        let disturbances = scenario.course().disturbances(&scenario.events);
        // As for `expect.recovered_within`, one that ends within another one has not ended for the network.
        let known: Vec<_> = disturbances.iter().map(|of| of.from_ns..of.end_ns.unwrap_or(u64::MAX)).collect();
        let spans =
            known.iter().zip(covered(&known)).map(|(of, end)| (of.start, (end != u64::MAX).then_some(end)));
        let spans: Vec<_> = spans.collect();
        (!spans.is_empty()).then(|| Self::new(scenario.time, &spans))
    }

    /// Of events by begin and end (ns), in the order of their begins.
    fn new(time: TimeSpec, events: &[(u64, Option<u64>)]) -> Self {
        let span = |&(from_ns, end_ns): &(u64, Option<u64>)| {
            let next = end_ns.map(|end| events.partition_point(|&(from, _)| from <= end));
            let next = next.and_then(|next| events.get(next));
            let to = next.map_or(u64::MAX, |&(from, _)| time.first_tick(from));
            let from = time.first_tick(from_ns);
            Span { from, to, end_ns, during: DuringEvents::default(), outside: None, seen: None }
        };
        Self { time, spans: events.iter().map(span).collect(), next: 0, open: Vec::new() }
    }

    /// Takes the ratios of tick `k`.
    pub(super) fn tick(&mut self, k: u64, ratios: Ratios) {
        while self.spans.get(self.next).is_some_and(|span| span.from <= k) {
            self.open.push(self.next);
            self.next += 1;
        }
        if self.open.is_empty() {
            return;
        }
        let now = self.time.at_ns(k);
        let spans = &mut self.spans;
        self.open.retain(|&at| spans.get(at).is_some_and(|span| k < span.to));
        for &at in &self.open {
            if let Some(span) = spans.get_mut(at) {
                span.take(k, now, ratios);
            }
        }
    }

    /// By event, in their order.
    pub(super) fn finish(self) -> Vec<EventFigures> {
        let time = self.time;
        let of = |span: Span| EventFigures {
            end_ns: span.end_ns,
            during: span.during,
            recovery: span.recovered(time),
        };
        self.spans.into_iter().map(of).collect()
    }
}

impl Span {
    fn take(&mut self, k: u64, now: u64, ratios: Ratios) {
        self.during.take(ratios);
        if ratios.judged == 0 || self.end_ns.is_none_or(|end| now < end) {
            return;
        }
        self.seen = Some(k);
        if ratios.breaches > 0 {
            self.outside = Some(k);
        }
    }

    fn recovered(&self, time: TimeSpec) -> Recovered {
        let Some(end_ns) = self.end_ns else { return Recovered::Outside };
        match (self.seen, self.outside) {
            (None, _) => Recovered::NotSeen,
            (Some(_), None) => Recovered::After(0.0),
            (Some(seen), Some(outside)) if outside == seen => Recovered::Outside,
            (Some(_), Some(outside)) => {
                Recovered::After(time.at_ns(outside).saturating_sub(end_ns) as f64 / 1e9)
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Ticks of 1 ms; events by begin and end in ms; the time until all were inside again, and breaches.
    fn told(
        events: &[(u64, Option<u64>)],
        ticks: u64,
        outside: impl Fn(u64) -> bool,
    ) -> Vec<(Option<f64>, u64)> {
        let events: Vec<_> =
            events.iter().map(|&(from, end)| (from * 1_000_000, end.map(|end| end * 1_000_000))).collect();
        let mut by_event = ByEvent::new(TimeSpec::plain(1_000_000, u64::MAX), &events);
        for k in 0..ticks {
            let breaches = u64::from(outside(k));
            by_event.tick(k, Ratios { largest: breaches as f64, judged: 3, breaches, first: None });
        }
        let figures = by_event.finish();
        figures.iter().map(|figures| (figures.recovery.after_s(), figures.during.breaches)).collect()
    }

    #[test]
    fn each_event_has_its_own_time() {
        let outside = |k: u64| (12..35).contains(&k) || (60..62).contains(&k);
        let events = [(10, Some(20)), (50, Some(50)), (60, Some(70))];
        assert_eq!(told(&events, 100, outside), [(Some(0.014), 23), (Some(0.0), 0), (Some(0.0), 2)]);
    }

    #[test]
    fn what_is_not_inside_before_the_next_event_has_not_recovered() {
        let events = [(10, Some(20)), (50, Some(50)), (80, None)];
        let told = told(&events, 100, |k| (12..60).contains(&k) || k > 90);
        assert_eq!(told, [(None, 38), (Some(0.009), 10), (None, 9)]);
    }

    #[test]
    fn events_that_overlap_share_their_ticks_and_a_repair_belongs_to_its_partition() {
        let events = [(10, Some(40)), (20, Some(20)), (40, Some(40))];
        assert_eq!(
            told(&events, 100, |k| (30..45).contains(&k)),
            [(Some(0.004), 15), (None, 10), (Some(0.004), 5)]
        );
    }
}
