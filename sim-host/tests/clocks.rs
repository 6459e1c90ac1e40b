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

/// What `check` says of clocks.
fn foretold(sets: &[&str]) -> Value {
    let scenario = concat!(env!("CARGO_MANIFEST_DIR"), "/tests/clocks/five-agents.toml");
    let mut command = Command::new(env!("CARGO_BIN_EXE_sim-host"));
    command.args(["check", scenario, "--json"]);
    for set in sets {
        command.args(["--set", set]);
    }
    let report: Value =
        serde_json::from_slice(&command.output().expect("sim-host starts").stdout).expect("JSON");
    let findings = report["findings"].as_array().expect("findings").clone();
    findings.into_iter().find(|finding| finding["name"] == "clocks").expect("a finding")
}

/// How far clocks come apart, when the first state comes late, and when the first one is not taken: all as `check` says it.
#[test]
fn without_sync_what_breaks_and_when_is_as_check_says() {
    let off = ["sync.off=true", "time.duration=30s", "expect.reference_error=1e9", "expect.funnel_ratio=1e9"];
    let said = foretold(&off);
    assert_eq!(said["status"], "fail");
    let values = &said["values"];
    let at = |key: &str| number(values, key);
    let skew = number(&run(&off), "/clocks/skew_max_s");
    assert!((at("/skew_s") / skew - 1.0).abs() < 0.02, "{values} {skew}");
    let until = |t: f64| {
        let duration = format!("time.duration={}ms", (t * 1e3).round());
        run(&["sync.off=true", &duration, "expect.reference_error=1e9", "expect.funnel_ratio=1e9"])
    };
    // One state in each tick from then on.
    let late = |t: f64| number(&until(t), "/counters/extrapolated");
    let from = at("/late_from_s");
    assert!(
        late(0.95 * from) < 10.0 && late(1.1 * from) > 400.0,
        "{} {}",
        late(0.95 * from),
        late(1.1 * from)
    );
    // A neighbour that is silent is extrapolated for up to 120 ticks.
    let lost = |t: f64| number(&until(t), "/counters/lost");
    let from = at("/deaf_from_s");
    assert!(
        lost(0.98 * from) < 1.0 && lost(1.05 * from) >= 1.0,
        "{} {}",
        lost(0.98 * from),
        lost(1.05 * from)
    );
    assert_eq!(foretold(&["time.duration=30s"])["status"], "ok");
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

/// The events of a run that begin with a word, by the file that tells them, as the scenario's times in seconds.
fn told(sets: &[&str], words: &str) -> Vec<f64> {
    let folder = tempfile::tempdir().expect("a folder");
    let scenario = concat!(env!("CARGO_MANIFEST_DIR"), "/tests/clocks/five-agents.toml");
    let mut command = Command::new(env!("CARGO_BIN_EXE_sim-host"));
    command.args(["run", scenario, "-q", "--out"]).arg(folder.path());
    for set in sets {
        command.args(["--set", set]);
    }
    let output = command.output().expect("sim-host starts");
    let text = std::fs::read_to_string(folder.path().join("events.txt"));
    let text = text.unwrap_or_else(|_| String::from_utf8(output.stderr).expect("text"));
    let time = |line: &str| line.split(' ').next().and_then(|time| time.parse().ok());
    text.lines().filter(|line| line.contains(words)).filter_map(time).collect()
}

const LOST: &str = "event=[{ at = \"5s\", kind = \"sync-loss\", for = \"2s\" }]";

#[test]
fn where_sync_is_lost_clocks_hold_over_and_are_together_again_after_it() {
    let short = ["time.duration=12s", "expect.reference_error=1e9", "clock.wander=0"];
    let with = run(&[&short[..], &[LOST, "expect.recovered_within=1s"]].concat());
    assert_eq!(with["passed"], true, "{with}");
    // What is learnt of the others' rates is kept: 100 ppm apart for 2 s they would be 200 us apart.
    let skew = number(&with, "/clocks/skew_max_s");
    assert!(skew < 20e-6, "{skew}");
    let syncs = |summary: &Value| number(summary, "/clocks/syncs");
    let lost = syncs(&run(&short)) - syncs(&with);
    assert!((19.0..=21.0).contains(&lost), "{lost}");
}

#[test]
fn where_sync_is_lost_for_longer_than_the_holdover_who_follows_stops() {
    let summary = run(&[LOST, "safety.holdover=1s", "time.duration=8s", "sync.masters=[1]"]);
    assert_eq!(summary["stopped"], serde_json::json!([2, 3, 4, 5]));
    let stops = told(&[LOST, "safety.holdover=1s", "time.duration=8s", "sync.masters=[1]"], "stopped");
    assert!(stops.iter().all(|at| (5.85..6.15).contains(at)), "{stops:?}");
}

#[test]
fn where_one_master_is_silent_the_next_one_takes_over_and_yields_again() {
    let silent = "event=[{ at = \"5s\", kind = \"sync-loss\", node = 1, for = \"2s\" }]";
    let short = ["time.duration=12s", "expect.reference_error=1e9", "expect.recovered_within=1s", silent];
    let summary = run(&short);
    assert_eq!(summary["passed"], true, "{summary}");
    assert!(number(&summary, "/clocks/skew_p99_s") < 5e-6, "{}", summary["clocks"]);
    let leads = told(&short, "node 2 is time master");
    assert!(leads.len() == 1 && (5.0..5.3).contains(&leads[0]), "{leads:?}");
}

#[test]
fn a_clock_that_jumps_or_drifts_by_an_event_is_brought_back() {
    for change in ["by = \"300us\"", "drift_ppm = -50"] {
        let event = format!("event=[{{ at = \"5s\", kind = \"clock\", node = 3, {change} }}]");
        let summary =
            run(&[&event, "time.duration=12s", "expect.reference_error=1e9", "expect.recovered_within=1s"]);
        assert_eq!(summary["passed"], true, "{change} {summary}");
        let skew = number(&summary, "/clocks/skew_max_s");
        assert!((3e-6..310e-6).contains(&skew), "{change} {skew}");
        let off = run(&[&event, "sync.off=true", "time.duration=12s"]);
        assert!(number(&off, "/clocks/skew_max_s") > skew, "{change} {off}");
    }
}

#[test]
fn events_of_clocks_that_make_no_sense_are_refused_by_name() {
    let event = |keys: &str| format!("event=[{{ at = \"5s\", {keys} }}]");
    assert!(refused(&[&event("kind = \"clock\", node = 3")]).contains("must be how far the clock jumps"));
    assert!(refused(&[&event("kind = \"clock\", node = 9, by = \"1us\"")]).contains("node"));
    assert!(refused(&[&event("kind = \"clock\", node = 3, by = \"2s\"")]).contains("a second at most"));
    assert!(refused(&[&event("kind = \"sync-loss\"")]).contains("how long SYNC do not go out"));
    assert!(
        refused(&[&event("kind = \"sync-loss\", for = \"1h\"")])
            .contains("must be over by the end of the run")
    );
    assert!(
        refused(&[&event("kind = \"sync-loss\", for = \"1s\", node = 3")])
            .contains("node 3 is none of sync.masters")
    );
    assert!(refused(&[&event("kind = \"sync-loss\", for = \"0s\"")]).contains("must be longer than 0s"));
    assert!(
        refused(&[&event("kind = \"sync-loss\", for = \"1s\""), "sync.off=true"]).contains("needs [sync]")
    );
    assert!(refused(&[&event("kind = \"bounce\", node = 3"), "sync.off=true"]).contains(
        "of kind bounce needs [sync] beside [clock]: a node that comes learns the tick from a time master"
    ));
}

#[test]
fn keys_that_make_no_sense_are_refused_by_name() {
    assert!(refused(&["bus.model=ideal"]).contains("needs bus.model"));
    assert!(refused(&["sync.masters=[9]"]).contains("sync.masters"));
    assert!(refused(&["sync.period=1us"]).contains("sync.period"));
    assert!(refused(&["clock.offset=1ms"]).contains("shorter than a tick"));
    assert!(refused(&["clock.drift=5"]).contains("drift_ppm"));
}
