//! What a run does with its files: with real links, devices, signals and processes.
#![allow(clippy::unwrap_used, clippy::panic, reason = "helpers of tests, which clippy does not know as such")]

use serde_json::Value;
use std::fs;
use std::io::Write;
use std::os::unix::fs::{PermissionsExt, symlink};
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Output, Stdio};
use std::time::{Duration, Instant};
use tempfile::TempDir;

const SHORT: &str = "time.duration=200ms";
const LONG: &str = "time.duration=10h";

fn repository() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("..")
}

/// A folder with a scenario, in which the program runs.
struct Place(TempDir);

impl Place {
    fn new() -> Self {
        let place = Self(tempfile::tempdir().unwrap());
        fs::copy(repository().join("scenarios/five-agents.toml"), place.at("five.toml")).unwrap();
        place
    }

    fn at(&self, name: &str) -> PathBuf {
        self.0.path().join(name)
    }

    fn read(&self, name: &str) -> String {
        fs::read_to_string(self.at(name)).unwrap_or_else(|error| panic!("{name}: {error}"))
    }

    fn write(&self, name: &str, text: &str) {
        fs::write(self.at(name), text).unwrap();
    }

    fn command(&self, arguments: &[&str]) -> Command {
        // Whoever runs the tests by nohup has them ignore SIGHUP, and so their children.
        let mut command = Command::new("env");
        command.args(["--default-signal=HUP,INT,TERM", env!("CARGO_BIN_EXE_sim-host")]);
        command.current_dir(self.0.path()).args(arguments).stdin(Stdio::null());
        command
    }

    fn run(&self, arguments: &[&str]) -> Ended {
        Ended::of(self.command(arguments).output().unwrap())
    }

    /// A short run of the scenario with more options.
    fn five(&self, more: &[&str]) -> Ended {
        self.run(&[&["run", "five.toml", "--set", SHORT], more].concat())
    }

    fn summary(&self, name: &str) -> Value {
        serde_json::from_str(&self.read(name)).unwrap()
    }

    fn names(&self, folder: &str) -> Vec<String> {
        let entries = fs::read_dir(self.at(folder)).unwrap();
        let mut names: Vec<_> =
            entries.map(|entry| entry.unwrap().file_name().into_string().unwrap()).collect();
        names.sort();
        names
    }

    /// A run of hours that has its files open.
    fn long(&self, more: &[&str]) -> Child {
        let every: &[&str] = if more.contains(&"--every") { &[] } else { &["--every", "1min"] };
        let arguments = [&["run", "five.toml", "--set", LONG, "--out", "out"], every, more].concat();
        let child = self.command(&arguments).stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().unwrap();
        let is_open = || fs::read_dir(self.at("out")).is_ok_and(|entries| entries.count() > 6);
        let begin = Instant::now();
        while !is_open() {
            assert!(begin.elapsed() < Duration::from_secs(30), "no output was opened");
            std::thread::sleep(Duration::from_millis(5));
        }
        // The first tick is run before a signal is looked at; some more are.
        std::thread::sleep(Duration::from_millis(200));
        child
    }
}

struct Ended {
    code: Option<i32>,
    out: String,
    err: String,
}

impl Ended {
    fn of(output: Output) -> Self {
        let text = |bytes| String::from_utf8(bytes).unwrap();
        Self { code: output.status.code(), out: text(output.stdout), err: text(output.stderr) }
    }

    /// Refused with code 2, and a message that has all the words.
    fn refused(&self, words: &[&str]) {
        assert_eq!((self.code, self.out.as_str()), (Some(2), ""), "{}", self.err);
        for word in words {
            assert!(self.err.contains(word), "{word} is not in {}", self.err);
        }
    }

    fn fine(&self) {
        assert_eq!((self.code, self.err.as_str()), (Some(0), ""));
    }
}

fn signal(name: &str, child: &Child) {
    let sent = Command::new("kill").args([&format!("-{name}"), &child.id().to_string()]).status();
    assert!(sent.unwrap().success());
}

/// Not green: one error or failure.
fn red(junit: &str) {
    assert!(!junit.contains("errors=\"0\"") || !junit.contains("failures=\"0\""), "{junit}");
}

const FILES: [&str; 8] = [
    "agreement.svg",
    "events.txt",
    "funnels.svg",
    "inputs.svg",
    "scenario.toml",
    "states.svg",
    "summary.json",
    "trajectory.csv",
];

#[test]
fn an_output_that_is_the_scenario_is_refused_under_every_name() {
    let place = Place::new();
    let before = place.read("five.toml");
    fs::create_dir(place.at("deep")).unwrap();
    symlink("../five.toml", place.at("deep/link")).unwrap();
    fs::hard_link(place.at("five.toml"), place.at("hard")).unwrap();
    fs::create_dir(place.at("out")).unwrap();
    symlink("../five.toml", place.at("out/can.log")).unwrap();
    for option in ["--json", "--junit"] {
        for name in ["five.toml", "./deep/../five.toml", "deep/link", "hard"] {
            let named = format!("{option} {name} is the scenario five.toml");
            place.five(&[option, name]).refused(&[&named]);
            assert_eq!(place.read("five.toml"), before, "{option} {name}");
        }
    }
    // A file that this run would not even write, but remove.
    place.five(&["--out", "out"]).refused(&["--out out (can.log) is the scenario five.toml"]);
    assert_eq!(place.read("five.toml"), before);
    let mut child = place.command(&["run", "-", "--json", "five.toml"]);
    child.stdin(fs::File::open(place.at("five.toml")).unwrap());
    Ended::of(child.output().unwrap()).refused(&["is the scenario at standard input"]);
    assert_eq!(place.read("five.toml"), before);
}

#[test]
fn an_output_that_is_the_bench_file_or_another_output_is_refused() {
    let place = Place::new();
    place.write("bench.toml", "nonsense");
    place
        .run(&["bench", "five.toml", "--bench", "bench.toml", "--junit", "bench.toml"])
        .refused(&["--junit bench.toml is the bench file bench.toml"]);
    assert_eq!(place.read("bench.toml"), "nonsense");
    place.write("a", "kept");
    symlink("a", place.at("b")).unwrap();
    fs::hard_link(place.at("a"), place.at("c")).unwrap();
    for other in ["a", "b", "c", "./a"] {
        place.five(&["--json", "a", "--junit", other]).refused(&["--json a and --junit ", "are one file"]);
        assert_eq!(place.read("a"), "kept");
    }
    place.five(&["--out", "o", "--json", "o/summary.json"]).refused(&["--out o (summary.json) are one file"]);
    place.five(&["--json", "-", "--junit", "-"]).refused(&["--json - and --junit - are one file"]);
}

#[test]
fn a_refusal_for_a_clash_is_in_the_junit_file() {
    let place = Place::new();
    place.write("j.xml", "yesterday's");
    place.five(&["--json", "five.toml", "--junit", "j.xml"]).refused(&["is the scenario"]);
    let junit = place.read("j.xml");
    red(&junit);
    assert!(junit.contains("is the scenario five.toml") && junit.contains("type=\"refused\""), "{junit}");
}

#[test]
fn links_are_written_through_and_rights_are_kept() {
    let place = Place::new();
    fs::create_dir(place.at("real")).unwrap();
    let mode = |name: &str| fs::metadata(place.at(name)).unwrap().permissions().mode() & 0o7777;
    fs::create_dir(place.at("out")).unwrap();
    for name in ["real/a.json", "j.xml", "out/trajectory.csv", "out/states.svg"] {
        place.write(name, "old");
        fs::set_permissions(place.at(name), fs::Permissions::from_mode(0o640)).unwrap();
    }
    symlink("real/a.json", place.at("a.json")).unwrap();
    symlink("../real/summary", place.at("out/summary.json")).unwrap();
    place.five(&["--out", "out", "--json", "a.json", "--junit", "j.xml"]).fine();
    for name in ["real/a.json", "j.xml", "out/trajectory.csv", "out/states.svg"] {
        assert_eq!(mode(name), 0o640, "{name}");
        assert_ne!(place.read(name), "old", "{name}");
    }
    for link in ["a.json", "out/summary.json"] {
        assert!(fs::symlink_metadata(place.at(link)).unwrap().is_symlink(), "{link}");
    }
    assert_eq!(place.summary("real/a.json"), place.summary("real/summary"));
    assert_eq!(place.names("real"), ["a.json", "summary"]);
}

#[test]
fn a_pipe_is_written_as_it_is() {
    let place = Place::new();
    assert!(Command::new("mkfifo").arg(place.at("pipe")).status().unwrap().success());
    let reader = std::thread::spawn({
        let pipe = place.at("pipe");
        move || fs::read_to_string(pipe).unwrap()
    });
    place.five(&["--junit", "pipe"]).fine();
    let text = reader.join().unwrap();
    assert_eq!(text.matches("<testsuites").count(), 1, "{text}");
    assert!(text.contains("errors=\"0\""), "{text}");
}

#[test]
fn outputs_of_an_earlier_run_go_and_those_of_others_stay() {
    let place = Place::new();
    fs::create_dir(place.at("out")).unwrap();
    for name in ["bench.csv", "can.log", "node-3.log", "thesis.tex", "node-3.log.gz"] {
        place.write(&format!("out/{name}"), "old");
    }
    place.five(&["--out", "out"]).fine();
    let mut expected: Vec<_> = FILES.into_iter().chain(["node-3.log.gz", "thesis.tex"]).collect();
    expected.sort_unstable();
    assert_eq!(place.names("out"), expected);
}

/// The folder of a run has all that repeats it: the original may be changed or gone.
#[test]
fn a_run_with_inputs_is_repeated_from_its_folder() {
    let place = Place::new();
    place.write("load.csv", "time_s,# of loads,p_kw\n0,3,0.1\n0.05,4,1.7\n10,1,-2\n");
    let inputs = r#"agent.inputs={ load = { file = "load.csv", time = "time_s", column = "p_kw" } }"#;
    let field = r#"agent.dynamics={ kind = "expression", f = "-x + 0.3*load" }"#;
    place.five(&["--set", field, "--set", inputs, "--out", "out"]).fine();
    let first = place.summary("out/summary.json");
    fs::remove_file(place.at("load.csv")).unwrap();
    let own = place.read("out/scenario-input-1.csv");
    place.run(&["run", "out/scenario.toml", "--out", "again"]).fine();
    assert_eq!(place.summary("again/summary.json")["trace_hash"], first["trace_hash"]);
    place.run(&["run", "again/scenario.toml", "--out", "third"]).fine();
    assert_eq!(place.summary("third/summary.json")["trace_hash"], first["trace_hash"]);
    assert_eq!(place.read("third/scenario-input-1.csv"), own);
    // A run without inputs leaves none.
    place.five(&["--out", "out"]).fine();
    assert!(!place.at("out/scenario-input-1.csv").exists());
}

#[test]
fn a_refused_run_leaves_no_folder_that_it_has_made_and_keeps_one_that_was_there() {
    let place = Place::new();
    place.write("bad.toml", "version = 1\n[tim");
    fs::create_dir(place.at("mine")).unwrap();
    let before = place.names(".");
    for arguments in [&["run", "bad.toml"][..], &["run", "five.toml", "--every", "1500us"]] {
        for out in ["deep/out", "out", "mine"] {
            place.run(&[arguments, &["--out", out]].concat()).refused(&[]);
            assert_eq!(place.names("."), before, "{arguments:?} {out}");
        }
    }
    assert!(place.names("mine").is_empty());
}

#[test]
fn a_refused_run_leaves_no_green_file() {
    let place = Place::new();
    place.write("bad.toml", "version = 1\n[tim");
    let outputs = ["--out", "out", "--json", "a.json", "--junit", "j.xml"];
    let refusals: [(&[&str], &str); 5] = [
        (&["run", "bad.toml"], "not valid TOML"),
        (&["run", "none.toml"], "cannot be read"),
        (&["run", "five.toml", "--set", "graph.nodes=128", "--set", "expect={}"], ""),
        (&["run", "five.toml", "--every", "3s", "--set", SHORT], "must be whole ticks"),
        (&["bench", "five.toml", "--bench", "none.toml"], "none.toml: cannot be read"),
    ];
    for (arguments, message) in refusals {
        place.five(&outputs).fine();
        assert!(place.read("j.xml").contains("errors=\"0\""));
        place.run(&[arguments, &outputs].concat()).refused(&[message]);
        let junit = place.read("j.xml");
        red(&junit);
        assert!(junit.contains(message) && junit.contains("name=\"run\""), "{junit}");
        assert!(!place.at("out/summary.json").exists() && !place.at("a.json").exists(), "{arguments:?}");
    }
}

#[test]
fn an_output_that_cannot_be_written_is_in_the_junit_file() {
    let place = Place::new();
    place.write("file", "kept");
    for outputs in [["--out", "file/out"], ["--json", "file/a.json"], ["--json", "/dev/full"]] {
        place.write("j.xml", "yesterday's");
        let ended = place.five(&[&outputs[..], &["--junit", "j.xml"]].concat());
        ended.refused(&[&format!("cannot write {}", outputs[1])]);
        let junit = place.read("j.xml");
        red(&junit);
        assert!(junit.contains(&format!("cannot write {}", outputs[1])), "{junit}");
    }
    place.five(&["--json", "a.json", "--junit", "file/j.xml"]).refused(&["cannot write file/j.xml"]);
    assert!(!place.at("a.json").exists());
}

#[test]
fn a_scenario_of_the_users_in_the_folder_is_not_replaced() {
    let place = Place::new();
    fs::create_dir(place.at("out")).unwrap();
    place.write("out/scenario.toml", "mine");
    place.five(&["--out", "out"]).refused(&["out/scenario.toml would be replaced", "another folder"]);
    assert_eq!(place.names("out"), ["scenario.toml"]);
    assert_eq!(place.read("out/scenario.toml"), "mine");
}

#[test]
fn a_second_run_into_a_folder_is_refused_and_does_no_harm() {
    let place = Place::new();
    let mut first = place.long(&["--junit", "first.xml"]);
    let files = place.names("out");
    place
        .five(&["--out", "out", "--junit", "second.xml"])
        .refused(&["--out out: another run", &format!("(process {})", first.id())]);
    assert_eq!(place.names("out"), files);
    red(&place.read("second.xml"));
    // Killed, it holds the folder no longer, and what it has left goes.
    first.kill().unwrap();
    first.wait().unwrap();
    red(&place.read("first.xml"));
    assert!(place.names("out").iter().any(|name| name.ends_with(".tmp")));
    place.five(&["--out", "out", "--junit", "first.xml"]).fine();
    assert_eq!(place.names("out"), FILES);
    assert!(place.names(".").iter().all(|name| !name.ends_with(".tmp")), "{:?}", place.names("."));
}

#[test]
fn an_interrupted_run_writes_what_there_is() {
    for on in ["loopback", "reference"] {
        for (name, code) in [("INT", 130), ("TERM", 130), ("HUP", 129)] {
            let place = Place::new();
            let more = [
                "--on",
                on,
                "--json",
                "a.json",
                "--junit",
                "j.xml",
                "--set",
                "expect={}",
                "--set",
                "time.duration=1h",
                "--every",
                "100ms",
            ];
            let child = place.long(&more);
            // The solver has to get to the second row, on a busy machine too.
            std::thread::sleep(Duration::from_millis(800));
            signal(name, &child);
            let ended = Ended::of(child.wait_with_output().unwrap());
            assert_eq!(ended.code, Some(code), "{on} {name}: {}", ended.err);
            assert_eq!(place.names("out"), FILES, "{on} {name}");
            let summary = place.summary("out/summary.json");
            let sentence = summary["ended_early"].as_str().unwrap();
            assert!(
                sentence.starts_with("after ") && sentence.ends_with(" ticks: interrupted"),
                "{sentence}"
            );
            assert_eq!(summary["passed"], false);
            assert_eq!(place.summary("a.json"), summary);
            assert!(place.read("out/trajectory.csv").lines().count() > 1);
            let junit = place.read("j.xml");
            red(&junit);
            assert!(junit.contains(&format!("the run ended {sentence}")), "{junit}");
            assert!(ended.err.starts_with("interrupted after "), "{}", ended.err);
        }
    }
}

/// Whatever rows are asked for, the last tick that was run has one.
#[test]
fn a_run_that_is_interrupted_before_its_second_row_has_its_last_tick() {
    let place = Place::new();
    let child = place.long(&["--set", "expect={}", "--every", "10h"]);
    std::thread::sleep(Duration::from_millis(300));
    signal("INT", &child);
    let ended = Ended::of(child.wait_with_output().unwrap());
    assert_eq!(ended.code, Some(130), "{}", ended.err);
    assert_eq!(place.names("out"), FILES);
    assert_eq!(place.read("out/trajectory.csv").lines().count(), 3);
}

/// The reference that the scenario's expectation asks for is solved before the first tick.
#[test]
fn a_run_that_is_interrupted_before_its_first_tick_says_so_and_leaves_nothing() {
    let place = Place::new();
    let child = place.long(&["--junit", "j.xml"]);
    signal("INT", &child);
    let ended = Ended::of(child.wait_with_output().unwrap());
    assert_eq!((ended.code, ended.err.as_str()), (Some(130), "interrupted; no output was written\n"));
    assert!(!place.at("out").exists());
    let junit = place.read("j.xml");
    red(&junit);
    assert!(junit.contains("type=\"interrupted\""), "{junit}");
}

#[test]
fn a_run_that_ends_at_its_end_is_complete() {
    let place = Place::new();
    place.five(&["--json", "a.json"]).fine();
    let summary = place.summary("a.json");
    assert_eq!(summary["ended_early"], Value::Null);
    let complete = summary["checks"].as_array().unwrap().iter().find(|check| check["name"] == "complete");
    assert_eq!(complete.unwrap()["pass"], true);
}

#[test]
fn a_hang_up_that_was_ignored_at_the_start_stays_ignored() {
    let place = Place::new();
    let script = "trap '' HUP; exec \"$@\"";
    let mut command = Command::new("sh");
    command.args(["-c", script, "sh", env!("CARGO_BIN_EXE_sim-host"), "run", "five.toml"]);
    command.args(["--set", LONG, "--every", "1min", "--out", "out"]).current_dir(place.0.path());
    let mut child = command.stdout(Stdio::null()).stderr(Stdio::null()).spawn().unwrap();
    while !fs::read_dir(place.at("out")).is_ok_and(|entries| entries.count() > 6) {
        std::thread::sleep(Duration::from_millis(5));
    }
    signal("HUP", &child);
    std::thread::sleep(Duration::from_millis(300));
    assert!(child.try_wait().unwrap().is_none());
    signal("TERM", &child);
    assert_eq!(child.wait().unwrap().code(), Some(130));
}

#[test]
fn the_folder_repeats_its_run() {
    let place = Place::new();
    for more in [vec![], vec!["--seed", "7", "--set", "title=\"it's\"", "--set", "bus.loss=0.02"]] {
        let arguments = [&["--out", "out"], more.as_slice()].concat();
        place.five(&arguments).fine();
        place.run(&["run", "out/scenario.toml", "--json", "again.json"]).fine();
        let (first, again) = (place.summary("out/summary.json"), place.summary("again.json"));
        for key in ["trace_hash", "seed", "scenario", "ticks"] {
            assert_eq!(first[key], again[key], "{key}");
        }
        assert_eq!(first["version"], env!("CARGO_PKG_VERSION"));
        let command = first["command"].as_str().unwrap();
        assert!(command.contains(" run five.toml --set time.duration=200ms --out out"), "{command}");
        let ended = Command::new("sh").args(["-c", command]).current_dir(place.0.path()).output().unwrap();
        assert!(ended.status.success(), "{command}");
        assert_eq!(place.summary("out/summary.json")["trace_hash"], again["trace_hash"]);
    }
}

#[test]
fn a_scenario_comes_through_standard_input_and_results_leave_through_standard_output() {
    let place = Place::new();
    let piped = |arguments: &[&str]| {
        let mut child = place.command(arguments);
        let child = child.stdin(Stdio::piped()).stdout(Stdio::piped()).stderr(Stdio::piped());
        let mut child = child.spawn().unwrap();
        child.stdin.take().unwrap().write_all(place.read("five.toml").as_bytes()).unwrap();
        Ended::of(child.wait_with_output().unwrap())
    };
    let ended = piped(&["run", "-", "--set", SHORT, "--json", "-"]);
    ended.fine();
    let summary: Value = serde_json::from_str(&ended.out).unwrap();
    place.five(&["--json", "a.json"]).fine();
    assert_eq!(summary["trace_hash"], place.summary("a.json")["trace_hash"]);
    let ended = piped(&["run", "-", "--set", SHORT, "--junit", "-"]);
    ended.fine();
    assert!(
        ended.out.starts_with("<?xml") && ended.out.trim_end().ends_with("</testsuites>"),
        "{}",
        ended.out
    );
    piped(&["run", "-", "--set", "time.tick=0s"]).refused(&["--set time.tick=0s"]);
    assert_eq!(piped(&["check", "-", "--json"]).code, Some(0));
    // What goes to the end of a log must not overwrite its beginning.
    place.write("log", "first line\n");
    let script = "exec \"$@\" >> log";
    let mut command = Command::new("sh");
    command.args(["-c", script, "sh", env!("CARGO_BIN_EXE_sim-host"), "run", "five.toml", "--set", SHORT]);
    command.args(["-q", "--json", "/dev/stdout"]).current_dir(place.0.path());
    assert!(command.status().unwrap().success());
    assert!(place.read("log").starts_with("first line\n{"), "{}", place.read("log"));
}

#[test]
fn times_are_those_of_the_ticks_and_the_last_tick_has_a_row() {
    let place = Place::new();
    place.five(&[
        "--set",
        "time.tick=100us",
        "--set",
        "time.duration=301.3ms",
        "--every",
        "700us",
        "--out",
        "out",
    ]);
    let text = place.read("out/trajectory.csv");
    let times: Vec<f64> =
        text.lines().skip(1).map(|row| row.split(',').next().unwrap().parse().unwrap()).collect();
    let ticks = (0..3013u32).step_by(7).chain([3013]);
    let exact: Vec<f64> = ticks.map(|tick| format!("{tick}e-4").parse().unwrap()).collect();
    assert_eq!(times, exact);
}

#[test]
fn no_control_character_reaches_the_terminal_or_the_junit_file() {
    let place = Place::new();
    let title = r#"title = "a\u001b[2J\u0007""#;
    let text: String = place.read("five.toml").lines().map(|line| format!("{line}\n")).collect();
    let at = text.lines().position(|line| line.starts_with("title")).unwrap();
    let line: Vec<_> = text.lines().enumerate().map(|(n, line)| if n == at { title } else { line }).collect();
    place.write("bad.toml", &line.join("\n"));
    let clean = |text: &str| {
        assert!(
            !text.contains(|c: char| c != '\n' && (c.is_control() || "\u{fffe}\u{ffff}".contains(c))),
            "{text:?}"
        );
    };
    let ended = place.run(&["run", "bad.toml", "--junit", "j.xml"]);
    let place_of = format!("bad.toml:{}:9: title = ", at + 1);
    ended.refused(&[&place_of, "without control characters such as \\u{1b}"]);
    clean(&ended.err);
    clean(&place.read("j.xml"));
    // In the name of a file, of a key, of an option and of an argument.
    let name = "e\u{1b}[2J\u{9b}\u{fffe}.toml";
    fs::copy(place.at("five.toml"), place.at(name)).unwrap();
    place.write("key.toml", "version = 1\n\"k\\u001b[2J\" = 1\n");
    for arguments in [
        vec!["run", name, "--set", "graph.nodes=0", "--junit", "j.xml"],
        vec!["run", "none\u{1b}[2J.toml", "--junit", "j.xml"],
        vec!["run", "key.toml", "--junit", "j.xml"],
        vec!["run", "five.toml", "--every", "1\u{1b}[2J"],
        vec!["run", name, "--set", SHORT, "--set", "expect.funnel_ratio=1e-9", "--junit", "j.xml"],
        vec!["run", name, "--json", name],
    ] {
        let ended = place.run(&arguments);
        assert!(matches!(ended.code, Some(1 | 2)), "{arguments:?}: {}", ended.err);
        clean(&ended.err);
        clean(&ended.out);
        clean(&place.read("j.xml"));
    }
}

#[test]
fn a_read_only_folder_is_code_2_by_name() {
    let place = Place::new();
    fs::create_dir(place.at("out")).unwrap();
    let mount = place.at("out");
    let mounted = Command::new("mount").args(["-t", "tmpfs", "-o", "ro", "tmpfs"]).arg(&mount).output();
    if !mounted.is_ok_and(|output| output.status.success()) {
        let _ =
            writeln!(std::io::stderr(), "SKIPPED: a_read_only_folder: no file system can be mounted here");
        return;
    }
    let ended = place.five(&["--out", "out", "--junit", "j.xml"]);
    assert!(Command::new("umount").arg(&mount).status().unwrap().success());
    ended.refused(&["cannot write out: Read-only file system"]);
    red(&place.read("j.xml"));
}

#[test]
fn an_image_where_nothing_is_emulated_is_refused() {
    let place = Place::new();
    for on in ["loopback", "reference"] {
        place.five(&["--on", on, "--image", "node.elf"]).refused(&["--image node.elf", "emulates no node"]);
    }
}
