//! What `check` says of how often healthy nodes stop, against many runs.
#![allow(clippy::unwrap_used, clippy::panic, reason = "helpers of tests, which clippy does not know as such")]

use funnelnet_sim::check::{Report, check};
use funnelnet_sim::{Scenario, Simulation};
use std::path::Path;

/// Six in a row, inside a funnel of 0.453 from 1 s on: world 7835 of the campaigns.
const PATH: &str = r#"version = 1
time = { tick = "1ms", duration = "2s" }
graph = { kind = "path", nodes = 6 }
coupling.kind = "node-wise"
coupling.gain = { kind = "logarithmic", scale = 1.0 }
coupling.funnel = { kind = "exponential", start = 1.812, end = 0.453, rate = 3.86 }
agent.dynamics = { kind = "affine", slope = -1.188 }
[[node]]
id = 3
state = 0.053
dynamics = { offset = -0.758 }
"#;
const RUNS: u64 = 40;

fn read(rest: &str, seed: u64) -> Scenario {
    let text = format!("seed = {seed}\n{rest}\n{PATH}");
    Scenario::parse(&text, Path::new("path.toml"), &[]).unwrap_or_else(|errors| panic!("{errors}"))
}

fn share(report: &Report, finding: &str, key: &str) -> f64 {
    report.findings.iter().find(|one| one.name == finding).unwrap().values[key].as_f64().unwrap()
}

/// The share of the runs in which a node stops for that reason is between what `check` says, within four standard deviations.
#[track_caller]
fn stops_as_often_as_said(rest: &str, finding: &str, why: &str) {
    let report = check(&read(rest, 1));
    let (low, high) = (share(&report, finding, "share_at_least"), share(&report, finding, "share"));
    let stops = |seed: &u64| {
        let verdict = Simulation::new(&read(rest, *seed)).unwrap().run();
        verdict.stops.first().is_some_and(|stop| stop.why.contains(why))
    };
    let seen = (1..=RUNS).filter(stops).count() as f64 / RUNS as f64;
    let reach = |share: f64| 4.0 * (share * (1.0 - share) / RUNS as f64).sqrt();
    assert!((low - reach(low)..=high + reach(high)).contains(&seen), "{rest}: {seen}, said {low} to {high}");
    // A case that is as good as certain, or impossible, would say nothing of the figure.
    assert!(low > 0.02 && low < 0.98, "{rest}: {low} to {high}");
}

#[test]
fn bursts_silence_neighbours_as_often_as_said() {
    let lost = |rest| stops_as_often_as_said(rest, "lost-neighbours", "lost too many neighbours");
    lost("safety.lost_neighbours = 2\nbus.loss = { to_bad = 0.01, to_good = 0.2 }");
    lost("safety.lost_neighbours = 2\nbus.loss = { to_bad = 0.01, to_good = 0.3 }\nbus.latency = '3ms'");
    lost("safety.lost_neighbours = 2\nbus = { model = 'can', loss = { to_bad = 0.01, to_good = 0.25 } }");
}

#[test]
fn independent_losses_silence_neighbours_as_often_as_said() {
    let lost = |rest| stops_as_often_as_said(rest, "lost-neighbours", "lost too many neighbours");
    lost("safety.lost_neighbours = 1\nbus.loss = 0.4");
    lost("safety.lost_neighbours = 1\nlink = [{ from = 2, to = 3, loss = 0.5 }]");
}

#[test]
fn lost_sync_stops_nodes_as_often_as_said() {
    let lost = |rest: &str| {
        let clocks = "clock.drift_ppm = 50\nsync = { period = '50ms', masters = [1] }";
        stops_as_often_as_said(&format!("{clocks}\n{rest}"), "lost-sync", "heard no SYNC for too long");
    };
    lost("safety.holdover = '160ms'\nbus = { model = 'can', loss = 0.05 }");
    lost("safety.holdover = '210ms'\nbus = { model = 'can', loss = { to_bad = 0.01, to_good = 0.2 } }");
}

/// What counts at an error is not all followed, so that the bounds lie apart; in the middle of them there is nothing to be said.
#[test]
fn controllers_go_off_the_bus_within_what_is_said() {
    let said = |errors: f64| {
        let rest = format!("bus = {{ model = 'can', bit_errors = {errors} }}");
        let report = check(&read(&rest, 1));
        let off = |seed: u64| {
            let verdict = Simulation::new(&read(&rest, seed)).unwrap().run();
            verdict.stops.iter().any(|stop| stop.why.contains("went off the bus"))
        };
        let off = (1..=10).filter(|&seed| off(seed)).count();
        (share(&report, "bus-off", "share_at_least"), share(&report, "bus-off", "share"), off)
    };
    let (_, most, off) = said(0.0005);
    assert!(most < 1e-3 && off == 0, "{most} {off}");
    let (least, _, off) = said(0.002);
    assert!(least > 0.999 && off == 10, "{least} {off}");
}
