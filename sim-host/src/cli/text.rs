//! The summary of a run for people.

use crate::figure::figure;
use crate::record::{
    BenchNodeSummary, BenchSummary, Expectation, FunnelSummary, OwnClockSummary, PerComponent, Summary,
    WiresSummary,
};

/// The summary for people: a line per part that the run has, and one per expectation.
pub(super) fn text(summary: &Summary) -> String {
    let mut lines = vec![format!(
        "{}: {} nodes, {} ticks of {} s on {}, {} s of wall time",
        summary.scenario,
        summary.nodes,
        summary.ticks,
        figure(summary.tick_s, 4),
        summary.on,
        figure(summary.wall_s, 3)
    )];
    let mut line = |name: &str, text: String| lines.push(format!("  {name:<10} {text}"));
    if let Some(funnel) = &summary.funnel {
        line("funnel", funnels(funnel));
    }
    if let Some(sync) = summary.sync {
        let [last, most, bound] =
            [sync.final_spread, sync.max_spread, sync.bound].map(|value| figure(value, 4));
        line("sync", format!("final spread {last}, bound {bound}; largest spread {most}"));
    }
    line("input", format!("largest |u| {}", figure(summary.max_input, 4)));
    if let Some(emergent) = &summary.emergent {
        let mut distance = |name: &str, error: Option<f64>, symbol: &str, end: &Option<PerComponent>| {
            if let (Some(error), Some(end)) = (error, end) {
                line(name, format!("final distance {} to {symbol}{}", figure(error, 4), each(&end.0)));
            }
        };
        distance("emergent", emergent.final_error, "xi = ", &emergent.xi_final);
        distance("blended", emergent.blended_error, "", &emergent.blended_final);
    }
    if let Some(reference) = summary.reference {
        line("reference", format!("largest error {}", figure(reference.max_error, 4)));
    }
    if let Some(bus) = &summary.bus {
        let refused: u64 = bus.refused.values().sum();
        let refused = if refused == 0 { String::new() } else { format!(", {refused} refused") };
        line("bus", format!("{} frames sent, {} deliveries lost{refused}", bus.sent, bus.lost));
    }
    if let Some(bench) = &summary.bench {
        line("bench", beside_loopback(bench));
        if let Some(clocks) = &bench.own_clock {
            line("clocks", own_clocks(clocks));
        }
        if let Some(WiresSummary { count, extrapolated, .. }) = bench.wires {
            line(
                "wires",
                format!("{count} from node to node, {extrapolated} values came too late for their tick"),
            );
        }
    }
    if let Some(counters) = &summary.counters {
        line("counted", counters.told());
    }
    if let Some(hash) = &summary.trace_hash {
        line("trace", hash.clone());
    }
    for Expectation { name, limit, value, pass } in &summary.expect {
        let value = value.map_or("not measured".to_owned(), |value| figure(value, 4));
        line(if *pass { "pass" } else { "FAIL" }, format!("{name} {value} < {limit}"));
    }
    for check in summary.checks.iter().filter(|check| !check.pass) {
        line("FAIL", format!("{}: {}", check.name, check.text));
    }
    if summary.expect.is_empty() {
        line(
            "note",
            "the scenario expects nothing: only the checks that every run has to pass were made".to_owned(),
        );
    }
    lines.join("\n")
}

/// How the funnels held, and what nodes believe of them where that is something else.
fn funnels(funnel: &FunnelSummary) -> String {
    let mut text = format!("largest |nu|/psi {}, breaches {}", figure(funnel.max_ratio, 4), funnel.breaches);
    if let Some(believed) = funnel.believed {
        let [true_ratio, ratio] = [funnel.max_ratio, believed.max_ratio].map(|ratio| figure(ratio, 4));
        if true_ratio != ratio || funnel.breaches != believed.breaches {
            text += &format!("; nodes believe {ratio}, {}", believed.breaches);
        }
    }
    if funnel.unknown > 0 {
        text += &format!("; not known at {} node-ticks", funnel.unknown);
    }
    text
}

/// How a bench's nodes differ from loopback.
fn beside_loopback(bench: &BenchSummary) -> String {
    let differs = |node: &BenchNodeSummary| {
        let first = node.first_difference?;
        Some(format!(
            "node {} from tick {first}, by at most {}",
            node.node,
            figure(node.largest_deviation, 4)
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

/// What nodes did with clocks of their own.
fn own_clocks(clocks: &OwnClockSummary) -> String {
    let late: u64 = clocks.nodes.iter().map(|node| u64::from(node.extrapolated)).sum();
    format!(
        "largest skew {} s, {late} values came too late for their tick, {} node-ticks not recorded",
        figure(clocks.largest_skew_s, 3),
        clocks.missed
    )
}

/// A number, or the numbers of a vector in brackets.
fn each(values: &[f64]) -> String {
    let figures: Vec<_> = values.iter().map(|&value| figure(value, 6)).collect();
    if let [one] = figures.as_slice() { one.clone() } else { format!("[{}]", figures.join(", ")) }
}
