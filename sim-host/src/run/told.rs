//! What is told of a run: what happened, what nodes reported, and when they were away.

use super::event_log::{MoreEvents, NAMED};
use super::outcome::Outcome;
use crate::engine::NodeEvent;
use crate::record::Gravity;
use crate::scenario::{Scenario, TimeSpec};
use funnelnet_node::Event;

/// Something that happened.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) struct Told {
    /// When, ns of the trajectory, which begins with tick 0: one tick after the start, when the announced states
    /// have arrived.
    pub at: u64,
    /// How grave it is.
    pub gravity: Gravity,
    /// To whom: `node 3`, or `event`.
    pub who: String,
    /// What: the rest of the sentence.
    pub what: String,
}

/// What happened, what nodes reported and when they were away, in the order of time.
pub(super) fn of(scenario: &Scenario, outcome: &Outcome) -> Vec<Told> {
    let time = &scenario.time;
    // Before what nodes say at the same time: the cause comes first.
    let mut told: Vec<_> = outcome
        .happened
        .iter()
        .map(|event| Told {
            at: event.at_ns,
            gravity: Gravity::Info,
            who: "event".to_owned(),
            what: event.to_string(),
        })
        .collect();
    told.extend(outcome.events.iter().map(|event| of_node(event, time)));
    told.extend(outcome.more_events.iter().map(|more| counted(more, time)));
    for absence in outcome.bench.iter().flat_map(|bench| &bench.absences) {
        let mut tell = |tick: u32, gravity: Gravity, what: String| {
            told.push(Told {
                at: time.at_ns(tick.into()),
                gravity,
                who: format!("node {}", absence.node),
                what,
            });
        };
        let away = format!("is away from tick {} on: {}", absence.from_tick, absence.why);
        tell(absence.from_tick, Gravity::Warning, away);
        if let Some(to) = absence.to_tick {
            tell(to, Gravity::Info, format!("is back at tick {to}"));
        }
    }
    // Stable: what happened at the same time stays in the order in which it was told.
    told.sort_by_key(|told| told.at);
    told
}

/// How a list of events is shortened, for its reader; empty where it is whole.
pub(super) fn heading(outcome: &Outcome) -> String {
    match outcome.more_events.is_empty() {
        true => String::new(),
        false => format!(
            "# of each node the first {NAMED} events of a kind, and of more their number and the last one\n"
        ),
    }
}

/// A line each: time, who, what.
pub(super) fn lines<'a>(told: impl IntoIterator<Item = &'a Told>) -> String {
    told.into_iter().map(|Told { at, who, what, .. }| format!("{} s, {who} {what}\n", seconds(*at))).collect()
}

/// What a node reported.
pub(super) fn of_node(event: &NodeEvent, time: &TimeSpec) -> Told {
    let gravity = match event.event {
        Event::Fault(_) => Gravity::Error,
        Event::Warned(_) => Gravity::Warning,
        _ => Gravity::Info,
    };
    let at = time.from_clock(event.at.saturating_sub(time.tick_ns));
    Told { at, gravity, who: format!("node {}", event.node + 1), what: event.event.to_string() }
}

/// The last of the events that were only counted.
pub(super) fn counted(more: &MoreEvents, time: &TimeSpec) -> Told {
    let Told { what, .. } = of_node(&more.last, time);
    let what = format!("{what} (the last of {} more of this kind)", more.count);
    Told { what, ..of_node(&more.last, time) }
}

/// Nanoseconds as seconds, to the last digit, with six decimals or more.
fn seconds(ns: u64) -> String {
    let exact = format!("{}.{:09}", ns / 1_000_000_000, ns % 1_000_000_000);
    let zeros = exact.len() - exact.trim_end_matches('0').len();
    exact[..exact.len() - zeros.min(3)].to_owned()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::judge::AbsenceSummary;
    use crate::record::BenchSummary;
    use std::path::Path;

    #[test]
    fn events_have_the_time_of_the_trajectory_and_read_as_sentences() {
        let event = |at, event| NodeEvent { at, node: 2, event };
        let list = [event(0, Event::Started), event(41_000_000, Event::BreachEnded { tick: 40 })];
        let expected =
            "0.000000 s, node 3 started\n0.040000 s, node 3 is inside its funnel again at tick 40\n";
        let time = TimeSpec::plain(1_000_000, 100);
        let told = list.map(|event| of_node(&event, &time));
        assert_eq!(lines(&told), expected);
    }

    #[test]
    fn absences_stand_among_the_events_in_the_order_of_time() {
        let text = "version = 1\ntime = { tick = '1ms', duration = '1s' }\ngraph = { kind = 'path', nodes = 3 }\nagent = { dynamics = { kind = 'affine' } }\n\
                    coupling = { kind = 'none', funnel = { kind = 'constant', width = 1.0 } }";
        let scenario = Scenario::parse(text, Path::new("a.toml"), &[]).unwrap();
        let absence =
            |from_tick, to_tick| AbsenceSummary { node: 3, from_tick, to_tick, why: "it is silent".into() };
        let bench = BenchSummary {
            absences: vec![absence(10, Some(40)), absence(60, None)],
            ..BenchSummary::default()
        };
        let event = |at, event| NodeEvent { at, node: 0, event };
        let outcome = Outcome {
            events: vec![event(0, Event::Started), event(31_000_000, Event::SyncGap { missed: 2 })],
            bench: Some(bench),
            ..Outcome::default()
        };
        let expected = "0.000000 s, node 1 started\n0.010000 s, node 3 is away from tick 10 on: it is silent\n\
                        0.030000 s, node 1 skips 2 ticks that SYNC has skipped\n0.040000 s, node 3 is back at tick 40\n\
                        0.060000 s, node 3 is away from tick 60 on: it is silent\n";
        assert_eq!(lines(&of(&scenario, &outcome)), expected);
    }

    #[test]
    fn times_of_events_are_exact() {
        for (ns, text) in [
            (0, "0.000000"),
            (1, "0.000000001"),
            (1_500, "0.0000015"),
            (300_000_000, "0.300000"),
            (86_400_000_000_001_000, "86400000.000001"),
            (u64::MAX, "18446744073.709551615"),
        ] {
            assert_eq!(seconds(ns), text);
        }
    }
}
