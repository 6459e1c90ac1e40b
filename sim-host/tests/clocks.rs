//! Clocks that drift, with and without SYNC, on CAN in this program.
#![allow(clippy::unwrap_used, clippy::expect_used)] // tests

use serde_json::Value;
use std::process::Command;

/// The summary of a run of the scenario of drifting clocks, with these keys, and whether it passed.
fn run(sets: &[&str]) -> Value {
    let scenario = concat!(env!("CARGO_MANIFEST_DIR"), "/tests/clocks/five-agents.toml");
    let mut command = Command::new(env!("CARGO_BIN_EXE_sim-host"));
    command.args(["run", scenario, "-q", "--json", "-"]);
    for set in sets {
        command.args(["--set", set]);
    }
    let output = command.output().expect("sim-host starts");
    serde_json::from_slice(&output.stdout).expect("a summary")
}

/// What is said of a scenario that is refused.
fn refused(sets: &[&str]) -> String {
    let scenario = concat!(env!("CARGO_MANIFEST_DIR"), "/tests/clocks/five-agents.toml");
    let mut command = Command::new(env!("CARGO_BIN_EXE_sim-host"));
    command.args(["run", scenario, "-q"]);
    for set in sets {
        command.args(["--set", set]);
    }
    let output = command.output().expect("sim-host starts");
    assert_eq!(output.status.code(), Some(2));
    String::from_utf8(output.stderr).expect("text")
}

/// All clocks are right.
const RIGHT: [&str; 6] = [
    "node.1.clock.drift_ppm=0",
    "node.2.clock.drift_ppm=0",
    "node.3.clock.drift_ppm=0",
    "node.4.clock.drift_ppm=0",
    "node.5.clock.drift_ppm=0",
    "clock.wander=0",
];

fn number(summary: &Value, path: &str) -> f64 {
    summary.pointer(path).and_then(Value::as_f64).unwrap_or(f64::NAN)
}

#[test]
fn with_sync_clocks_of_50_ppm_are_as_good_as_right_ones() {
    let (right, drifting) = (run(&RIGHT), run(&[]));
    let error = |summary: &Value| number(summary, "/reference/max_error");
    assert!(error(&drifting) <= 2.0 * error(&right), "{} {}", error(&drifting), error(&right));
    assert!(number(&drifting, "/funnel/max_ratio") < 1.0);
    assert!(number(&drifting, "/clocks/skew_p99_s") < 5e-6, "{}", drifting["clocks"]);
    assert!(number(&drifting, "/clocks/syncs") >= 200.0);
    assert_eq!(drifting["passed"], true);
    assert_eq!(run(&[])["trace_hash"], drifting["trace_hash"]);
}

#[test]
fn without_sync_they_drift_apart_by_as_much_as_they_differ() {
    let summary = run(&["sync.off=true"]);
    let skew = number(&summary, "/clocks/skew_max_s");
    assert!((1.9e-3..2.1e-3).contains(&skew), "{skew}");
    assert_eq!(summary["clocks"]["syncs"], 0);
    assert_eq!(summary["passed"], false);
}

#[test]
fn clocks_that_are_right_change_no_bit() {
    let mut off = RIGHT.to_vec();
    off.push("sync.off=true");
    let (with_sync, without) = (run(&RIGHT), run(&off));
    assert_eq!(with_sync["trace_hash"], without["trace_hash"]);
    let plain = concat!(env!("CARGO_MANIFEST_DIR"), "/../scenarios/five-agents.toml");
    let output = Command::new(env!("CARGO_BIN_EXE_sim-host"))
        .args(["run", plain, "-q", "--json", "-", "--set", "bus.model=can"])
        .output()
        .expect("sim-host starts");
    let plain: Value = serde_json::from_slice(&output.stdout).expect("a summary");
    assert_eq!(without["trace_hash"], plain["trace_hash"]);
    assert!(plain.get("clocks").is_none());
}

#[test]
fn a_clock_that_has_jumped_too_far_stops_its_node_when_the_holdover_is_over() {
    let summary = run(&[
        "node.3.clock.jumps=[{ at = \"5s\", by = \"50ms\" }]",
        "safety.holdover=1s",
        "time.duration=8s",
    ]);
    assert_eq!(summary["stopped"], serde_json::json!([3]));
}

#[test]
fn keys_that_make_no_sense_are_refused_by_name() {
    assert!(refused(&["bus.model=ideal"]).contains("needs bus.model"));
    assert!(refused(&["sync.masters=[9]"]).contains("sync.masters"));
    assert!(refused(&["sync.period=1us"]).contains("sync.period"));
    assert!(refused(&["clock.offset=1ms"]).contains("shorter than a tick"));
    assert!(refused(&["clock.drift=5"]).contains("drift_ppm"));
}
