//! One readable table of what the simulator does, line by line: graph, funnel, loss and latency in, figures
//! out. Everything is deterministic, so nothing is allowed to change unnoticed.
#![allow(clippy::unwrap_used, reason = "helpers of tests, which clippy does not know as such")]

use sim_host::number_format::significant;
use sim_host::record::Summary;
use sim_host::run::{Fidelity, Outcome};
use sim_host::scenario::{Expect, Scenario};
use std::fmt::Write;
use std::path::Path;
use system_tests::{run, scenario};

/// A funnel's name and its end.
type End = (&'static str, f64);

const WIDE: End = ("wide", 2.0);
const NARROW: End = ("narrow", 0.02);

/// Graph, funnel, loss, latency and jitter in microseconds.
const CONFIGURATIONS: &[(&str, End, f64, u32, u32)] = &[
    ("ring", WIDE, 0.0, 0, 0),
    ("ring", WIDE, 0.1, 0, 0),
    ("ring", WIDE, 0.0, 1500, 0),
    ("ring", WIDE, 0.1, 300, 900),
    ("ring", WIDE, 0.5, 0, 3000),
    ("path", WIDE, 0.0, 0, 0),
    ("star", WIDE, 0.0, 0, 0),
    ("complete", WIDE, 0.0, 0, 0),
    ("ring", NARROW, 0.0, 0, 0),
    ("ring", NARROW, 0.1, 0, 0),
    // Known limit: a delay of a whole tick more than the law is made for drives nodes into their state limit
    // here.
    ("ring", NARROW, 0.0, 1500, 0),
    ("path", NARROW, 0.0, 0, 0),
    ("star", NARROW, 0.0, 0, 0),
    ("star", NARROW, 0.1, 300, 900),
    ("complete", NARROW, 0.0, 0, 0),
];

#[test]
fn the_table_of_figures_is_the_recorded_one() {
    let mut table = String::from(
        "graph    funnel  loss latency jitter | max ratio breaches    spread    error frames  lost extrapol. trace\n\
         \x20                     us      us     |\n",
    );
    for &(graph, funnel, loss, latency, jitter) in CONFIGURATIONS {
        let (scenario, outcome) = simulated(graph, funnel.1, loss, latency, jitter);
        let summary = outcome.judge(&scenario, Fidelity::Loopback);
        let shown = format!("{graph:<8} {:<7} {loss:>4} {latency:>7} {jitter:>6}", funnel.0);
        writeln!(table, "{shown} | {}", figures(&summary, &outcome)).unwrap();
    }
    assert_recorded("netsim.txt", &table);
}

/// Three seconds of the five agents, with the distance to the reference.
fn simulated(graph: &str, end: f64, loss: f64, latency: u32, jitter: u32) -> (Scenario, Outcome) {
    let settings = [
        "time.duration=3s".to_owned(),
        format!("graph.kind={graph}"),
        format!("coupling.funnel.end={end}"),
        // Fast enough for the narrow end to be reached.
        "coupling.funnel.rate=4.0".to_owned(),
        format!("bus.loss={loss}"),
        format!("bus.latency={latency}us"),
        format!("bus.jitter={jitter}us"),
    ];
    let settings: Vec<_> = settings.iter().map(String::as_str).collect();
    let expect = Expect { reference_error: Some(1.0), ..Expect::default() };
    let scenario = Scenario { expect, ..scenario("five-agents.toml", &settings) };
    let outcome = run(&scenario, Fidelity::Loopback);
    (scenario, outcome)
}

fn figures(summary: &Summary, outcome: &Outcome) -> String {
    let (funnel, sync, bus) = (summary.funnel.unwrap(), summary.sync.unwrap(), summary.bus.as_ref().unwrap());
    let extrapolated: u32 = outcome.counters.iter().map(|counters| counters.extrapolated).sum();
    format!(
        "{:>9} {:>8} {:>9} {:>8.1e} {:>6} {:>5} {:>9} {}",
        significant(funnel.max_ratio, 4),
        funnel.breaches,
        significant(sync.final_spread, 4),
        // Two digits: the reference is f64 arithmetic of a solver, which need not be the same to the last
        // bit.
        summary.reference.unwrap().max_error,
        bus.sent,
        bus.lost,
        extrapolated,
        summary.trace_hash.as_ref().unwrap()
    )
}

/// Compares with `tests/snapshots/NAME`, or records there.
fn assert_recorded(name: &str, found: &str) {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/snapshots").join(name);
    if std::env::var_os("UPDATE_SNAPSHOTS").is_some() {
        std::fs::write(&path, found).unwrap();
        return;
    }
    let recorded = std::fs::read_to_string(&path).unwrap_or_default();
    assert!(
        recorded == found,
        "the figures are not those of {}.\n{}If the change is meant: UPDATE_SNAPSHOTS=1 cargo test --package system-tests \
         --test netsim, and say in the commit why.",
        path.display(),
        difference(&recorded, found)
    );
}

/// The lines that differ, old above new.
fn difference(recorded: &str, found: &str) -> String {
    let (recorded, found): (Vec<_>, Vec<_>) = (recorded.lines().collect(), found.lines().collect());
    let mut text = String::new();
    for line in 0..recorded.len().max(found.len()) {
        let (old, new) = (recorded.get(line), found.get(line));
        if old != new {
            writeln!(text, "- {}\n+ {}", old.unwrap_or(&""), new.unwrap_or(&"")).unwrap();
        }
    }
    text
}
