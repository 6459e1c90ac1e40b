//! `run.mcap`, read by the library of MCAP's makers for Python, which `./ci.sh setup` installs.
#![allow(clippy::unwrap_used, clippy::panic, reason = "helpers of tests, which clippy does not know as such")]

use serde_json::Value;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Output, Stdio};
use std::time::{Duration, Instant};
use tempfile::TempDir;

const UNJUDGED: [&str; 4] = ["--set", "expect={ funnel_ratio = 1e9 }", "--every", "1ms"];
const SOON: Duration = Duration::from_secs(60);

fn repository() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("..")
}

/// A run that records, with a row for each tick.
fn recording(scenario: &str, folder: &Path, more: &[&str]) -> Command {
    let mut command = Command::new(env!("CARGO_BIN_EXE_sim-host"));
    command.current_dir(repository()).args(["run", scenario, "--quiet", "--mcap", "--out"]).arg(folder);
    command.args(UNJUDGED).args(more).stdin(Stdio::null());
    command
}

fn said(command: &mut Command) -> (Option<i32>, String, String) {
    let Output { status, stdout, stderr } = command.output().unwrap();
    let text = |bytes: Vec<u8>| String::from_utf8_lossy(&bytes).into_owned();
    (status.code(), text(stdout), text(stderr))
}

/// What the reader says of a recording beside a trajectory; none where there is no reader, said aloud.
fn read(recording: &Path, trajectory: &Path, options: &[&str]) -> Option<(Option<i32>, Value, String)> {
    let python = repository().join("target/readers/bin/python");
    if !python.exists() || said(Command::new(&python).args(["-c", "import mcap"])).0 != Some(0) {
        eprintln!("SKIPPED: no mcap in target/readers; ./ci.sh setup installs it where PyPI can be reached");
        return None;
    }
    let script = repository().join("tests/readers/recording.py");
    let (code, out, err) =
        said(Command::new(&python).arg(script).args([recording, trajectory]).args(options));
    Some((code, serde_json::from_str(&out).unwrap_or(Value::Null), err))
}

fn rows(told: &Value) -> u64 {
    told["counts"]["/node/1"].as_u64().unwrap()
}

/// Waits until the recording of a run that goes on has some whole chunks.
fn under_way(folder: &Path, run: &mut Child) -> PathBuf {
    let begin = Instant::now();
    loop {
        let entries = fs::read_dir(folder).into_iter().flatten().flatten().map(|entry| entry.path());
        let named = |path: &PathBuf| path.to_string_lossy().contains(".run.mcap.");
        let long = |path: &PathBuf| fs::metadata(path).is_ok_and(|file| file.len() > 1_000_000);
        if let Some(path) = entries.into_iter().find(|path| named(path) && long(path)) {
            return path;
        }
        assert!(run.try_wait().unwrap().is_none() && begin.elapsed() < SOON, "{:?}", run.try_wait());
        std::thread::sleep(Duration::from_millis(2));
    }
}

#[test]
fn every_row_and_event_of_a_run_is_in_its_recording() {
    let bounce = "--set=event=[{ at = '50ms', kind = 'bounce', node = 2, for = '50ms' }]";
    let nothing = "--set=agent.unit=°C";
    for (scenario, more) in [
        ("scenarios/five-agents.toml", nothing),
        ("scenarios/five-agents.toml", bounce),
        ("scenarios/vector-oscillators.toml", nothing),
    ] {
        let place = TempDir::new().unwrap();
        let at = |name: &str| place.path().join(name);
        let (code, _, err) =
            said(&mut recording(scenario, place.path(), &["--set", "time.duration=300ms", more]));
        assert_eq!((code, err.contains("rror")), (Some(0), false), "{err}");
        let Some((code, told, err)) = read(&at("run.mcap"), &at("trajectory.csv"), &[]) else { return };
        assert_eq!(code, Some(0), "{scenario} {more}: {err}");
        let counts = told["counts"].as_object().unwrap();
        assert!(counts.len() > 2 && counts.values().all(|count| *count == told["rows"]), "{told}");
        assert_eq!(rows(&told), 301);
        let events = told["events"].as_array().unwrap();
        let lines = fs::read_to_string(at("events.txt")).unwrap();
        let as_line =
            |event: &Value| format!("{} {}", event[2].as_str().unwrap(), event[3].as_str().unwrap());
        let told_lines: Vec<_> = events.iter().map(as_line).collect();
        let lines: Vec<_> = lines.lines().filter_map(|line| Some(line.split_once(" s, ")?.1)).collect();
        assert_eq!(told_lines, lines);
        let scenario = fs::read_to_string(at("scenario.toml")).unwrap();
        assert_eq!(told["attachments"], serde_json::json!([["scenario.toml", scenario]]));
    }
}

#[test]
fn a_number_that_differs_is_found() {
    let place = TempDir::new().unwrap();
    let at = |name: &str| place.path().join(name);
    let scenario = "scenarios/five-agents.toml";
    assert_eq!(said(&mut recording(scenario, place.path(), &["--set", "time.duration=20ms"])).0, Some(0));
    let text = fs::read_to_string(at("trajectory.csv")).unwrap();
    let (head, last) = text.trim_end().rsplit_once('\n').unwrap();
    fs::write(
        at("changed.csv"),
        format!("{head}\n{}\n", last.replacen(",0.", ",1.", 1).replacen(",-", ",", 1)),
    )
    .unwrap();
    let Some((code, _, err)) = read(&at("run.mcap"), &at("changed.csv"), &[]) else { return };
    assert!(code == Some(1) && err.contains("and trajectory.csv has"), "{code:?} {err}");
}

#[test]
fn equal_runs_have_equal_recordings() {
    let bytes = [(); 2].map(|()| {
        let place = TempDir::new().unwrap();
        let run = &mut recording("scenarios/five-agents.toml", place.path(), &["--set", "time.duration=2s"]);
        assert_eq!(said(run).0, Some(0));
        fs::read(place.path().join("run.mcap")).unwrap()
    });
    assert!(bytes[0].len() > 1_000_000 && bytes[0] == bytes[1]);
}

/// The reader takes the file by its index, which is written last.
#[test]
fn a_run_that_is_interrupted_leaves_a_whole_recording() {
    let place = TempDir::new().unwrap();
    let at = |name: &str| place.path().join(name);
    let mut run = recording("scenarios/five-agents.toml", place.path(), &["--set", "time.duration=10min"]);
    let mut run = run.stderr(Stdio::null()).spawn().unwrap();
    under_way(place.path(), &mut run);
    assert!(Command::new("kill").args(["-INT", &run.id().to_string()]).status().unwrap().success());
    assert_eq!(run.wait().unwrap().code(), Some(130));
    let Some((code, told, err)) = read(&at("run.mcap"), &at("trajectory.csv"), &[]) else { return };
    assert_eq!((code, told["rows"].as_u64()), (Some(0), told["counts"]["/node/5"].as_u64()), "{err}");
    assert!(rows(&told) > 100);
}

#[test]
fn of_a_run_that_is_killed_all_whole_chunks_can_be_read() {
    let place = TempDir::new().unwrap();
    let (broken, whole) = (place.path().join("broken"), place.path().join("whole"));
    let scenario = "scenarios/five-agents.toml";
    assert_eq!(said(&mut recording(scenario, &whole, &[])).0, Some(0));
    let mut run = recording(scenario, &broken, &["--set", "time.duration=10min"]).spawn().unwrap();
    let left = under_way(&broken, &mut run);
    run.kill().unwrap();
    run.wait().unwrap();
    // Its rows are those of the run that went on, for as long as that did.
    let Some((code, told, err)) = read(&left, &whole.join("trajectory.csv"), &["--torn"]) else { return };
    assert_eq!(code, Some(0), "{err}");
    assert!(rows(&told) > 500, "{told}");
}

#[test]
fn recordings_that_nobody_can_make_are_refused() {
    let place = TempDir::new().unwrap();
    let mut run = recording("scenarios/five-agents.toml", place.path(), &["--set", "bus.model=none"]);
    let (code, _, err) = said(&mut run);
    assert!(
        code == Some(2) && err.contains("--mcap: there are no columns per node in this run"),
        "{code:?} {err}"
    );
    let mut run = Command::new(env!("CARGO_BIN_EXE_sim-host"));
    let (code, _, err) =
        said(run.current_dir(repository()).args(["run", "scenarios/five-agents.toml", "--mcap"]));
    assert!(code == Some(2) && err.contains("--out <DIR>"), "{err}");
}
