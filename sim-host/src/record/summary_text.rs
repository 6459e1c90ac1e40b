//! The summary of a run for people: a line per part that the run has, and one per expectation.

use super::summary::{
    BenchNodeSummary, BenchSummary, BenchSyncSummary, BusSummary, ClockSummary, EmergentSummary,
    EventSummary, Expectation, FunnelSummary, OwnClockNodeSummary, OwnClockSummary, PerComponent, Summary,
    SyncSummary, WiresSummary,
};
use crate::number_format::significant;
use std::fmt;

/// Name and text of a line.
type Line = (&'static str, String);

impl fmt::Display for Summary {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&title(self))?;
        let lines = [behaviour(self), carriage(self), record(self), verdict(self)];
        lines.iter().flatten().try_for_each(|(name, text)| write!(f, "\n  {name:<10} {text}"))
    }
}

/// Sentences about what has failed: expectations, then checks.
#[must_use]
pub fn failures(summary: &Summary) -> Vec<String> {
    let expectations = summary.expect.iter().filter(|expectation| !expectation.pass);
    let expectations = expectations.map(|Expectation { name, limit, value, .. }| {
        let value = value.map_or("not measured".to_owned(), |value| match value.is_nan() {
            true => "not a number".to_owned(),
            false => value.to_string(),
        });
        format!("failed: {name} = {value} must stay below {limit}")
    });
    let checks = summary.checks.iter().filter(|check| !check.pass);
    expectations.chain(checks.map(|check| format!("failed: {}: {}", check.name, check.text))).collect()
}

fn title(summary: &Summary) -> String {
    format!(
        "{}: {} nodes, {} ticks of {} s on {}, {} s of wall time",
        summary.scenario,
        summary.nodes,
        summary.ticks,
        significant(summary.tick_s, 4),
        summary.on,
        significant(summary.wall_s, 3)
    )
}

/// Lines on how the states behaved.
fn behaviour(summary: &Summary) -> Vec<Line> {
    let mut lines = Vec::new();
    lines.extend(summary.funnel.as_ref().map(|funnel| ("funnel", funnels(funnel))));
    lines.extend(events(&summary.events));
    lines.extend(summary.sync.map(|sync| ("sync", agreement(&sync))));
    lines.push(("input", format!("largest |u| {}", known(summary.max_input, 4))));
    lines.extend(summary.emergent.iter().flat_map(predictions));
    let error = |error: f64| format!("largest error {}", known(error, 4));
    lines.extend(summary.reference.map(|reference| ("reference", error(reference.max_error))));
    lines
}

/// Its digits, or that it is not known.
fn known(value: f64, digits: usize) -> String {
    if value.is_nan() { "not known".to_owned() } else { significant(value, digits) }
}

/// Lines on what carried the states, and how that differs from loopback.
fn carriage(summary: &Summary) -> Vec<Line> {
    let mut lines = Vec::new();
    lines.extend(summary.bus.as_ref().map(|bus| ("bus", frames(bus))));
    for table in summary.bus.iter().flat_map(|bus| &bus.can.0) {
        lines.extend(
            table.told().into_iter().enumerate().map(|(n, line)| (if n == 0 { "can" } else { "" }, line)),
        );
    }
    lines.extend(summary.clocks.as_ref().map(|clocks| ("clocks", kept_time(clocks))));
    let Some(bench) = &summary.bench else { return lines };
    lines.push(("bench", beside_loopback(bench)));
    lines.extend(bench.own_clock.as_ref().map(|clocks| ("clocks", own_clocks(clocks))));
    lines.extend(bench.wires.as_ref().map(|wires| ("wires", between_nodes(wires))));
    lines
}

/// Lines on what the nodes counted, and the hash of their states.
fn record(summary: &Summary) -> Vec<Line> {
    let counted = summary.counters.as_ref().map(|counters| ("counted", counters.told()));
    let trace = summary.trace_hash.as_ref().map(|hash| ("trace", hash.clone()));
    counted.into_iter().chain(trace).collect()
}

/// Lines on what was expected, and which checks have failed.
fn verdict(summary: &Summary) -> Vec<Line> {
    let expectation = |Expectation { name, limit, value, pass }: &Expectation| {
        let value = value.map_or("not measured".to_owned(), |value| match value.is_nan() {
            true => "not a number".to_owned(),
            false => significant(value, 4),
        });
        (if *pass { "pass" } else { "FAIL" }, format!("{name} {value} < {limit}"))
    };
    let mut lines: Vec<Line> = summary.expect.iter().map(expectation).collect();
    let failed = summary.checks.iter().filter(|check| !check.pass);
    lines.extend(failed.map(|check| ("FAIL", format!("{}: {}", check.name, check.text))));
    lines.extend(summary.left_out.iter().map(|what| ("left out", (*what).to_owned())));
    if !summary.own_fields.is_empty() {
        let ids: Vec<_> = summary.own_fields.iter().map(u16::to_string).collect();
        let note =
            format!("not the firmware's result: the fields of nodes {} are computed outside", ids.join(", "));
        lines.push(("note", note));
    }
    if summary.expect.is_empty() {
        let note = "the scenario expects nothing: only the checks that every run has to pass were made";
        lines.push(("note", note.to_owned()));
    }
    lines
}

/// Events that the text has a line for.
const EVENTS: usize = 12;

/// What each event did: the first ones, and how many more there are.
fn events(events: &[EventSummary]) -> Vec<Line> {
    let line = |(at, of): (usize, &EventSummary)| {
        let back = match (of.recovered_s, of.recovery) {
            (Some(s), _) => format!("inside {} s after its end", significant(s, 3)),
            (None, "outside") => "not inside again before the next one, or the end".to_owned(),
            (None, _) => "no tick between its end and the next one, or the end".to_owned(),
        };
        let ratio = known(of.max_ratio, 4);
        let what = shortened(&of.event);
        let text = format!("{} s {what}: ratio {ratio}, breaches {}, {back}", of.from_s, of.breaches);
        (if at == 0 { "events" } else { "" }, text)
    };
    let mut lines: Vec<Line> = events.iter().take(EVENTS).enumerate().map(line).collect();
    if let Some(more) = events.len().checked_sub(EVENTS).filter(|more| *more > 0) {
        lines.push(("", format!("and {more} more, in summary.json")));
    }
    lines
}

/// At most so many characters of an event, whose nodes may be many.
const EVENT: usize = 60;

fn shortened(event: &str) -> String {
    match event.char_indices().nth(EVENT) {
        None => event.to_owned(),
        Some((end, _)) => format!("{} ...", event.get(..end).unwrap_or_default()),
    }
}

/// Says how the funnels held, and what nodes believe of them where that is something else.
fn funnels(funnel: &FunnelSummary) -> String {
    let mut text = format!("largest |nu|/psi {}, breaches {}", known(funnel.max_ratio, 4), funnel.breaches);
    if let Some(believed) = funnel.believed {
        let [true_ratio, ratio] = [funnel.max_ratio, believed.max_ratio].map(|ratio| known(ratio, 4));
        if true_ratio != ratio || funnel.breaches != believed.breaches {
            text += &format!("; nodes believe {ratio}, {}", believed.breaches);
        }
    }
    if let Some(during) = funnel.during_events {
        let ratio = known(during.max_ratio, 4);
        text += &format!("; during events {ratio}, {}", during.breaches);
    }
    if funnel.unknown > 0 {
        text += &format!("; not known at {} node-ticks", funnel.unknown);
    }
    if funnel.uncoupled > 0 {
        text += &format!("; no neighbour at {} node-ticks", funnel.uncoupled);
    }
    text
}

fn kept_time(clocks: &ClockSummary) -> String {
    let [p99, most] = [clocks.skew_p99_s, clocks.skew_max_s].map(|s| known(s * 1e6, 3));
    let kept = match clocks.sync {
        true => format!("{} SYNC, time masters {}", clocks.syncs, clocks.masters),
        false => "no SYNC".to_owned(),
    };
    format!("apart by {p99} us in 99 of 100 ticks, by {most} us at most; {kept}")
}

fn agreement(sync: &SyncSummary) -> String {
    let [last, most, bound] = [sync.final_spread, sync.max_spread, sync.bound].map(|value| known(value, 4));
    let bound = if sync.bound.is_nan() { "no bound".to_owned() } else { format!("bound {bound}") };
    format!("final spread {last}, {bound}; largest spread {most}")
}

/// Lines on how far from the predictions the states ended, where these are known.
fn predictions(emergent: &EmergentSummary) -> impl Iterator<Item = Line> {
    // Where one of them is there at the end, the other one never was.
    let is_over = emergent.xi_final.is_none() && emergent.blended_final.is_none();
    let distance = |name, error: Option<f64>, symbol: &str, end: &Option<PerComponent>| {
        let error = known(error.unwrap_or(f64::NAN), 4);
        let Some(end) = end else {
            let why = emergent.unresolved.as_ref().filter(|_| is_over)?;
            return Some((name, format!("no prediction at the end: {why}")));
        };
        let unresolved = emergent.unresolved.as_ref().map(|why| format!(", which is not resolved: {why}"));
        let unresolved = unresolved.unwrap_or_default();
        Some((name, format!("final distance {error} to {symbol}{}{unresolved}", each(&end.0))))
    };
    let lines = [
        distance("emergent", emergent.final_error, "xi = ", &emergent.xi_final),
        distance("blended", emergent.blended_error, "", &emergent.blended_final),
    ];
    lines.into_iter().flatten()
}

fn frames(bus: &BusSummary) -> String {
    let rest = [
        ("without room", bus.no_room),
        ("replaced by newer ones", bus.replaced),
        ("disturbed", bus.corrupted),
        ("twice", bus.duplicated),
        ("out of order", bus.reordered),
        ("refused", bus.refused.values().sum()),
    ];
    let rest: String = rest
        .iter()
        .filter(|(_, count)| *count > 0)
        .map(|(what, count)| format!(", {count} {what}"))
        .collect();
    format!("{} frames sent, {} deliveries lost{rest}", bus.sent, bus.lost)
}

/// Says how a bench's nodes differ from loopback.
fn beside_loopback(bench: &BenchSummary) -> String {
    let differs = |node: &BenchNodeSummary| {
        let first = node.first_difference?;
        Some(format!(
            "node {} from tick {first}, by at most {}",
            node.node,
            significant(node.largest_deviation, 4)
        ))
    };
    let differences: Vec<_> = bench.nodes.iter().filter_map(differs).collect();
    let unreadable: u64 = bench.nodes.iter().map(|node| node.unreadable).sum();
    let unreadable =
        if unreadable == 0 { String::new() } else { format!("; {unreadable} unreadable frames from nodes") };
    let unreadable = match bench.unrecorded {
        0 => unreadable,
        count => format!("; {count} node-ticks not recorded{unreadable}"),
    };
    match differences.as_slice() {
        [] if bench.bit_for_bit => format!("bit for bit as loopback{unreadable}"),
        [] => format!("not bit for bit as loopback{unreadable}"),
        some => format!("differs from loopback: {}{unreadable}", some.join("; ")),
    }
}

/// Says what nodes did with clocks of their own.
fn own_clocks(clocks: &OwnClockSummary) -> String {
    let sum =
        |count: fn(&OwnClockNodeSummary) -> u32| clocks.nodes.iter().map(|node| u64::from(count(node))).sum();
    let syncs = clocks.sync.as_ref().map_or_else(String::new, carried);
    let end = clocks.end_skew_s.map_or_else(|| "not known".to_owned(), |s| significant(s, 3) + " s");
    format!(
        "{syncs}largest skew {} s, at the end {end}, {}, {} node-ticks not recorded",
        significant(clocks.largest_skew_s, 3),
        too_late(sum(|node| node.extrapolated), sum(|node| node.late)),
        clocks.missed
    )
}

/// SYNC of time masters. The first of these is no change.
fn carried(sync: &BenchSyncSummary) -> String {
    let kept = if sync.kept > 0 { format!(" ({} kept back)", sync.kept) } else { String::new() };
    let changes = match sync.masters.saturating_sub(1) {
        0 => "one time master".to_owned(),
        1 => "the time master changed once".to_owned(),
        changes => format!("the time master changed {changes} times"),
    };
    format!("{} SYNC{kept}, {changes}, ", sync.frames)
}

fn between_nodes(&WiresSummary { count, extrapolated, late, .. }: &WiresSummary) -> String {
    format!("{count} from node to node, {}", too_late(extrapolated, late))
}

/// Says what neighbours had not said when its tick ran, and what came after it.
fn too_late(extrapolated: u64, late: u64) -> String {
    format!("{extrapolated} values extrapolated, {late} states came after their tick")
}

/// Number, or the numbers of a vector in brackets.
fn each(values: &[f64]) -> String {
    let figures: Vec<_> = values.iter().map(|&value| significant(value, 6)).collect();
    if let [one] = figures.as_slice() { one.clone() } else { format!("[{}]", figures.join(", ")) }
}

#[cfg(test)]
mod tests {
    use super::super::summary::BelievedSummary;
    use super::*;
    use crate::judge::Check;

    /// A run of which nothing is known but its size.
    fn bare() -> Summary {
        let (scenario, on) = ("Two nodes".to_owned(), "loopback".to_owned());
        Summary { scenario, nodes: 2, ticks: 300, tick_s: 0.01, on, wall_s: 0.123_456, ..Summary::default() }
    }

    /// The lines of a summary that begin with `name`.
    fn lines_of(summary: &Summary, name: &str) -> Vec<String> {
        let text = summary.to_string();
        let lines = text.lines().skip(1).filter_map(|line| line.trim_start().strip_prefix(name));
        lines.map(|rest| rest.trim_start().to_owned()).collect()
    }

    fn bench(nodes: Vec<BenchNodeSummary>) -> BenchSummary {
        let bit_for_bit = nodes.iter().all(|node| node.first_difference.is_none());
        BenchSummary { nodes, bit_for_bit, ..BenchSummary::default() }
    }

    fn on_bench(bench: BenchSummary) -> String {
        lines_of(&Summary { bench: Some(bench), ..bare() }, "bench").concat()
    }

    #[test]
    fn a_run_without_parts_has_a_title_its_input_and_a_note() {
        assert_eq!(
            bare().to_string(),
            "Two nodes: 2 nodes, 300 ticks of 0.01 s on loopback, 0.123 s of wall time\n  \
             input      largest |u| 0\n  \
             note       the scenario expects nothing: only the checks that every run has to pass were made"
        );
    }

    #[test]
    fn every_part_has_its_line_in_order() {
        let summary = Summary {
            funnel: Some(FunnelSummary { max_ratio: 0.5, ..FunnelSummary::default() }),
            sync: Some(SyncSummary { final_spread: 0.1, max_spread: 2.0, bound: 0.2, lambda2: 2.0 }),
            max_input: 1.5,
            emergent: Some(EmergentSummary {
                final_error: Some(0.25),
                xi_final: Some(PerComponent(vec![1.0])),
                blended_error: Some(0.5),
                blended_final: Some(PerComponent(vec![1.0, -2.0])),
                ..EmergentSummary::default()
            }),
            bus: Some(BusSummary { sent: 602, lost: 3, ..BusSummary::default() }),
            trace_hash: Some("0011".to_owned()),
            expect: vec![Expectation::below("funnel_ratio", 1.0, Some(0.5))],
            ..bare()
        };
        assert_eq!(
            summary.to_string(),
            "Two nodes: 2 nodes, 300 ticks of 0.01 s on loopback, 0.123 s of wall time\n  \
             funnel     largest |nu|/psi 0.5, breaches 0\n  \
             sync       final spread 0.1, bound 0.2; largest spread 2\n  \
             input      largest |u| 1.5\n  \
             emergent   final distance 0.25 to xi = 1\n  \
             blended    final distance 0.5 to [1, -2]\n  \
             bus        602 frames sent, 3 deliveries lost\n  \
             trace      0011\n  \
             pass       funnel_ratio 0.5 < 1"
        );
    }

    #[test]
    fn what_nodes_believe_is_said_where_it_is_not_what_is_true() {
        let told = |max_ratio, breaches, unknown| {
            let believed = Some(BelievedSummary { max_ratio: 0.5, breaches: 0 });
            let funnel = FunnelSummary { max_ratio, breaches, unknown, believed, ..FunnelSummary::default() };
            funnels(&funnel)
        };
        assert_eq!(told(0.5, 0, 0), "largest |nu|/psi 0.5, breaches 0");
        assert_eq!(told(0.500_001, 0, 0), "largest |nu|/psi 0.5, breaches 0", "as many digits as are shown");
        assert_eq!(told(1.25, 7, 0), "largest |nu|/psi 1.25, breaches 7; nodes believe 0.5, 0");
        assert_eq!(told(0.5, 0, 9), "largest |nu|/psi 0.5, breaches 0; not known at 9 node-ticks");
    }

    #[test]
    fn what_fails_is_a_line_here_and_a_sentence_on_standard_error() {
        let check = |name: &'static str, pass| Check { name, pass, text: "node 3 says nothing".into() };
        let summary = Summary {
            expect: vec![
                Expectation::below("funnel_ratio", 1.0, Some(0.9)),
                Expectation::below("final_spread", 0.1, Some(0.123_456)),
                Expectation::below("emergent_error", 0.1, None),
            ],
            checks: vec![check("silent", false), check("unheard", true)],
            ..bare()
        };
        assert_eq!(lines_of(&summary, "pass"), ["funnel_ratio 0.9 < 1"]);
        assert_eq!(
            lines_of(&summary, "FAIL"),
            ["final_spread 0.1235 < 0.1", "emergent_error not measured < 0.1", "silent: node 3 says nothing"]
        );
        assert_eq!(
            failures(&summary),
            [
                "failed: final_spread = 0.123456 must stay below 0.1",
                "failed: emergent_error = not measured must stay below 0.1",
                "failed: silent: node 3 says nothing"
            ]
        );
        assert!(failures(&bare()).is_empty());
    }

    #[test]
    fn a_bench_is_told_beside_loopback() {
        let node = |node, first_difference, unreadable| BenchNodeSummary {
            node,
            first_difference,
            largest_deviation: 0.25,
            unreadable,
            ..BenchNodeSummary::default()
        };
        assert_eq!(on_bench(bench(vec![node(1, None, 0)])), "bit for bit as loopback");
        let gaps = BenchSummary { unrecorded: 4, bit_for_bit: false, ..bench(vec![node(1, None, 2)]) };
        assert_eq!(
            on_bench(gaps),
            "not bit for bit as loopback; 4 node-ticks not recorded; 2 unreadable frames from nodes"
        );
        assert_eq!(
            on_bench(bench(vec![node(1, Some(7), 0), node(2, None, 0), node(3, Some(8), 0)])),
            "differs from loopback: node 1 from tick 7, by at most 0.25; node 3 from tick 8, by at most 0.25"
        );
    }

    #[test]
    fn refused_frames_and_late_values_are_told() {
        let refused = [("stale".to_owned(), 2), ("duplicate".to_owned(), 1)].into_iter().collect();
        let bus = BusSummary { sent: 10, lost: 0, refused, ..BusSummary::default() };
        assert_eq!(frames(&bus), "10 frames sent, 0 deliveries lost, 3 refused");
        let wires = WiresSummary { count: 2, extrapolated: 5, late: 6, ..WiresSummary::default() };
        let summary = Summary { bench: Some(BenchSummary { wires: Some(wires), ..bench(vec![]) }), ..bare() };
        assert_eq!(
            lines_of(&summary, "wires"),
            ["2 from node to node, 5 values extrapolated, 6 states came after their tick"]
        );
    }
}
