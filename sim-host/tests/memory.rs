//! Memory and files of long runs: neither grows with what a node says at every tick, and memory not with
//! time.
#![allow(clippy::unwrap_used, clippy::panic, reason = "helpers of tests, which clippy does not know as such")]

use std::fs;
use std::path::Path;
use std::process::{Child, Command, Stdio};
use std::time::Duration;
use tempfile::TempDir;

/// Two nodes that follow different sines, inside their funnels.
const CALM: &str = r#"
version = 1
time = { tick = "1ms", duration = "1s" }
graph = { kind = "path", nodes = 2 }
[coupling]
kind = "node-wise"
gain = { kind = "reciprocal", scale = 1.0 }
funnel = { kind = "exponential", start = 10.0, end = 2.0, rate = 1.0 }
[[node]]
id = 1
dynamics = { kind = "affine", slope = -1.0, sines = [{ amplitude = 2.0, frequency = 3.0 }] }
[[node]]
id = 2
dynamics = { kind = "affine", slope = -1.0, sines = [{ amplitude = 2.0, frequency = 0.7 }] }
"#;

/// The noise of the states is as wide as the funnel: nodes leave it and come back every few ticks.
const NOISY: &str = r#"
version = 1
time = { tick = "1ms", duration = "20s" }
graph = { kind = "path", nodes = 2 }
coupling = { kind = "node-wise", gain = { kind = "reciprocal", scale = 1.0 }, funnel = { kind = "constant", width = 1.0 } }
agent = { dynamics = { kind = "affine", slope = -1.0 }, noise = 1.0 }
"#;

fn start(folder: &TempDir, text: &str, duration: &str) -> Child {
    fs::write(folder.path().join("a.toml"), text).unwrap();
    let set = format!("time.duration={duration}");
    Command::new(env!("CARGO_BIN_EXE_sim-host"))
        .args(["run", "a.toml", "--quiet", "--every", "1ms", "--out", "out", "--set", &set])
        .current_dir(folder.path())
        .stdin(Stdio::null())
        .spawn()
        .unwrap()
}

/// The most memory that a process has had, kB; `None` once it is gone.
fn most_memory(process: u32) -> Option<u64> {
    let status = fs::read_to_string(Path::new("/proc").join(process.to_string()).join("status")).ok()?;
    let line = status.lines().find_map(|line| line.strip_prefix("VmHWM:"))?;
    line.trim_end_matches("kB").trim().parse().ok()
}

/// The most memory of a run with a row at every tick, kB, and how many rows it has written.
fn memory_of(text: &str, duration: &str) -> (u64, usize) {
    let folder = tempfile::tempdir().unwrap();
    let (mut child, mut most) = (start(&folder, text, duration), 0);
    let status = loop {
        if let Some(status) = child.try_wait().unwrap() {
            break status;
        }
        most = most.max(most_memory(child.id()).unwrap_or(0));
        std::thread::sleep(Duration::from_millis(2));
    };
    assert!(status.success(), "{status}");
    let rows = fs::read(folder.path().join("out/trajectory.csv")).unwrap();
    (most, rows.iter().filter(|&&byte| byte == b'\n').count() - 1)
}

/// What a row may cost, bytes: less than one f64 of it that is kept. Peaks of equal runs differ by several
/// hundred kB, so that the runs have to differ by many rows.
const BYTES_A_ROW: u64 = 7;

/// The longer run has no more memory than the shorter one but for less than an f64 per row.
fn alike(text: &str, short: &str, long: &str, times: usize) {
    let [(before, few), (after, many)] = [short, long].map(|duration| memory_of(text, duration));
    println!("{short}: {few} rows, {before} kB; {long}: {many} rows, {after} kB");
    assert_eq!(many - 1, times * (few - 1));
    let more = u64::try_from(many - few).unwrap() * BYTES_A_ROW / 1024;
    assert!(after <= before + more, "{before} kB for {short}, {after} kB for {long}, {more} kB allowed");
}

#[test]
fn memory_does_not_grow_with_time() {
    alike(CALM, "20s", "200s", 10);
}

#[test]
#[ignore = "a minute: ./ci.sh extended"]
fn memory_of_a_thousand_seconds_is_nearly_that_of_ten() {
    // The envelopes of the pictures are full after four seconds.
    alike(CALM, "10s", "1000s", 100);
}

/// The same network on a CAN bus with errors, and a link that delays, turns and copies frames.
fn on_can() -> String {
    format!(
        "{CALM}\n[bus]\nmodel = \"can\"\nbit_errors = 1e-4\n[[link]]\nbetween = [1, 2]\nloss = 0.01\njitter = \"300us\"\nreorder = 0.01\nduplicate = 0.01\n"
    )
}

#[test]
fn memory_of_a_can_bus_does_not_grow_with_time() {
    alike(&on_can(), "20s", "200s", 10);
}

#[test]
#[ignore = "a minute: ./ci.sh extended"]
fn memory_of_a_can_bus_after_a_thousand_seconds_is_nearly_that_after_ten() {
    alike(&on_can(), "10s", "1000s", 100);
}

#[test]
fn events_of_every_tick_are_named_up_to_a_hundred_and_counted_beyond() {
    let folder = tempfile::tempdir().unwrap();
    assert!(start(&folder, NOISY, "20s").wait().unwrap().success());
    let read = |name: &str| fs::read_to_string(folder.path().join("out").join(name)).unwrap();
    let events = read("events.txt");
    assert!(events.starts_with(
        "# of each node the first 100 events of a kind, and of more their number and the last one\n"
    ));
    assert!(events.len() < 60_000, "{} bytes", events.len());
    let of = |words: &str| events.lines().filter(|line| line.contains(words)).count();
    assert_eq!(of("node 1 left its funnel"), 101);
    // Every breach that a node counts is a tick; those that it names are the beginnings. None is lost: each
    // end has a beginning.
    let counted = |words: &str| -> u64 {
        let line = events.lines().rfind(|line| line.contains(words)).unwrap();
        let (_, rest) = line.split_once("(the last of ").unwrap();
        rest.split(' ').next().unwrap().parse().unwrap()
    };
    let (left, back) = (counted("node 1 left its funnel"), counted("node 1 is inside its funnel again"));
    assert!(left > 2_000 && left.abs_diff(back) <= 1, "{left} and {back}");
    let summary: serde_json::Value = serde_json::from_str(&read("summary.json")).unwrap();
    assert!(summary["counters"]["breaches"].as_u64().unwrap() > 2 * left, "the counters have them all");
    // What is named is in the order of time, and so is the rest.
    let times = events.lines().skip(1).map(|line| line.split(' ').next().unwrap().parse::<f64>().unwrap());
    assert!(times.is_sorted());
}
