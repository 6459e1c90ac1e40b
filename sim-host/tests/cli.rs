//! The program as users meet it: exit codes, both output streams, and the text of every class of error.

#![allow(clippy::unwrap_used, reason = "helpers of tests, which clippy does not know as such")]

use std::io::Read;
use std::path::{Path, PathBuf};
use std::process::{Command, Output, Stdio};

fn sim_host() -> Command {
    let mut command = Command::new(env!("CARGO_BIN_EXE_sim-host"));
    command.current_dir(Path::new(env!("CARGO_MANIFEST_DIR")).join(".."));
    command
}

fn run(arguments: &[&str]) -> (Option<i32>, String, String) {
    let Output { status, stdout, stderr } = sim_host().args(arguments).output().unwrap();
    (status.code(), String::from_utf8(stdout).unwrap(), String::from_utf8(stderr).unwrap())
}

/// Checks that the arguments are refused with code 2, nothing on standard output, and the given message.
fn refused(arguments: &[&str], message: &str) {
    let (code, out, err) = run(arguments);
    assert_eq!((code, out.as_str()), (Some(2), ""), "{err}");
    assert_eq!(err.trim_end(), message);
}

/// A file of its own for one test.
fn write(name: &str, text: &[u8]) -> PathBuf {
    let path = Path::new(env!("CARGO_TARGET_TMPDIR")).join(name);
    std::fs::write(&path, text).unwrap();
    path
}

const FIVE: &str = "scenarios/five-agents.toml";

fn refused_set(set: &str, message: &str) {
    refused(&["check", FIVE, "--set", set], &format!("--set {set}: {message}"));
}

#[test]
fn every_scenario_that_is_shipped_passes_its_check() {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../scenarios");
    let mut count = 0;
    for entry in std::fs::read_dir(folder).unwrap() {
        let path = entry.unwrap().path();
        if path.extension().is_none_or(|extension| extension != "toml") {
            continue;
        }
        let (code, out, err) = run(&["check", path.to_str().unwrap()]);
        assert_eq!((code, err.as_str()), (Some(0), ""), "{}", path.display());
        assert!(out.contains("Assumption 1      undirected and connected"), "{out}");
        count += 1;
    }
    assert!(count >= 10);
}

#[test]
fn a_network_too_large_to_run_is_checked_and_not_run() {
    let set = ["--set", "graph.nodes=128"];
    let scenario = "scenarios/head-count-20.toml";
    for on in ["loopback", "reference"] {
        let (code, out, err) = run(&[&["run", scenario, "--on", on], set.as_slice()].concat());
        assert_eq!((code, out.as_str()), (Some(2), ""));
        assert!(
            err.contains("graph.nodes = 128: a run takes 127 nodes at most, since an id is 7 bits"),
            "{err}"
        );
    }
    // It counts heads, and would not end at 20.
    let any_end = ["--set", "expect.final_value.within=1000"];
    let (code, out, _) = run(&[&["check", scenario], set.as_slice(), &any_end].concat());
    assert_eq!(code, Some(0));
    assert!(out.contains("128 nodes can be checked, not run"), "{out}");
    assert!(!run(&["check", scenario]).1.contains("not run"));
}

#[test]
fn the_bound_holds_where_the_funnel_is_floored() {
    let json = Path::new(env!("CARGO_TARGET_TMPDIR")).join("floored.json");
    run(&["run", "scenarios/asymptotic-path-11.toml", "--json", json.to_str().unwrap()]);
    let summary: serde_json::Value = serde_json::from_slice(&std::fs::read(json).unwrap()).unwrap();
    let sync = |key: &str| summary["sync"][key].as_f64().unwrap();
    assert!(sync("final_spread") < sync("bound"), "{summary}");
}

#[test]
fn rows_farther_apart_than_the_run_is_long_are_refused() {
    let out = Path::new(env!("CARGO_TARGET_TMPDIR")).join("far-rows");
    let arguments = ["run", FIVE, "--every", "30s", "--out", out.to_str().unwrap()];
    refused(&arguments, "--every 30s: must be whole ticks of 1ms, from one to the whole run of 20s");
}

#[test]
fn help_names_commands_examples_and_exit_codes() {
    let (code, out, err) = run(&["--help"]);
    assert_eq!((code, err.as_str()), (Some(0), ""));
    for word in ["run", "check", "report", "completions", "Examples:", "Exit codes:"] {
        assert!(out.contains(word), "{word} is not in\n{out}");
    }
    let (_, out, _) = run(&["run", "--help"]);
    for word in [
        "--on",
        "loopback",
        "reference",
        "emulator",
        "--out",
        "--every",
        "--seed",
        "--set",
        "--json",
        "--junit",
        "--quiet",
        "--verbose",
        "Examples:",
    ] {
        assert!(out.contains(word), "{word} is not in\n{out}");
    }
    assert!(run(&["check", "--help"]).1.contains("Runs nothing."));
    assert_eq!(run(&["--version"]).1, format!("sim-host {}\n", env!("CARGO_PKG_VERSION")));
}

/// No example is broken, so that it can be copied, and no paragraph is wrapped twice.
#[test]
fn help_fits_a_narrow_terminal() {
    const WIDTH: usize = 80;
    for command in ["", "run", "bench", "node", "sweep", "check", "report", "export", "completions", "man"] {
        let mut program = sim_host();
        program.args([command, "--help"].into_iter().filter(|word| !word.is_empty()));
        let text =
            String::from_utf8(program.env("COLUMNS", WIDTH.to_string()).output().unwrap().stdout).unwrap();
        let after: Vec<_> = text.lines().skip_while(|line| *line != "Options:").collect();
        let is_example = |line: &str| line.starts_with("  ") && line.contains("sim-host ");
        assert!(after.iter().any(|line| is_example(line)), "{text}");
        for lines in after.windows(2) {
            let [line, next] = [lines[0], lines[1]];
            if is_example(line) {
                assert!(next.is_empty() || is_example(next), "broken: {line}");
            } else if line.starts_with(char::is_alphabetic) && next.starts_with(char::is_alphanumeric) {
                let word = next.split(' ').next().unwrap();
                assert!(line.len() + 1 + word.len() > WIDTH, "wrapped twice: {line}");
            }
        }
    }
}

#[test]
fn what_commissioning_and_listing_have_no_use_for_is_refused() {
    let outputs = [["--out", "o"], ["--every", "1ms"], ["--json", "j.json"], ["--junit", "j.xml"]];
    let refused = |arguments: &[&str], option: &str| {
        let (code, out, err) = run(arguments);
        assert_eq!((code, out.as_str()), (Some(2), ""), "{err}");
        assert!(err.contains("cannot be used with") && err.contains(option), "{err}");
    };
    for option in outputs {
        refused(
            &[&["bench", FIVE, "--bench", "b.toml", "--commission"], option.as_slice()].concat(),
            option[0],
        );
    }
    let more = [["--commission", "-q"], ["--erase", "-q"], ["--list", "-q"], ["--image", "i"]];
    for option in outputs.into_iter().chain(more) {
        refused(
            &[&["bench", FIVE, "--bench", "b.toml", "--update", "image"], option.as_slice()].concat(),
            option[0],
        );
    }
    for option in outputs.into_iter().chain([["--seed", "3"], ["--set", "bus.loss=0"]]) {
        refused(&[&["bench", "--bench", "b.toml", "--erase"], option.as_slice()].concat(), option[0]);
        refused(&[&["bench", "--list"], option.as_slice()].concat(), option[0]);
    }
}

#[test]
fn bad_usage_is_code_2() {
    for arguments in [
        vec![],
        vec!["rum"],
        vec!["run"],
        vec!["run", FIVE, "--on", "paper"],
        vec!["run", FIVE, "--every", "5"],
        vec!["run", FIVE, "-q", "-v"],
        vec!["check", FIVE, "--seed", "-1"],
        vec!["check", FIVE, "--set", "time.tick"],
        vec!["completions", "tcsh-ish"],
    ] {
        let (code, out, err) = run(&arguments);
        assert_eq!((code, out.as_str()), (Some(2), ""), "{arguments:?}");
        assert!(err.contains("Usage:") || err.contains("error:"), "{err}");
    }
    let (_, _, err) = run(&["check", FIVE, "--set", "time.tick"]);
    assert!(err.contains("must be section.key=value"), "{err}");
    let (_, _, err) = run(&["run", FIVE, "--every", "5"]);
    assert!(err.contains("units: ns, us, ms, s, min, h"), "{err}");
    refused(
        &["run", FIVE, "--every", "1.5ms"],
        "--every 1.5ms: must be whole ticks of 1ms, from one to the whole run of 20s",
    );
}

#[test]
fn files_that_cannot_be_read_are_code_2() {
    let (code, _, err) = run(&["check", "no/such.toml"]);
    assert_eq!(code, Some(2));
    assert!(err.starts_with("no/such.toml: cannot be read: "), "{err}");
    assert!(run(&["check", "scenarios"]).2.starts_with("scenarios: cannot be read: "));
    let path = write("latin1.toml", b"version = 1\ntitle = \"\xe9t\xe9\"\n");
    let name = path.to_str().unwrap();
    refused(&["check", name], &format!("{name}: must be UTF-8 text, and is not at byte 21"));
    let path = write("syntax.toml", b"version = 1\n[time\n");
    assert!(run(&["check", path.to_str().unwrap()]).2.contains("syntax.toml:2:6: not valid TOML: "));
}

#[test]
fn a_mistake_in_a_file_is_shown_with_file_line_and_column() {
    let text = std::fs::read_to_string(Path::new(env!("CARGO_MANIFEST_DIR")).join("..").join(FIVE)).unwrap();
    let path = write("typo.toml", text.replace("nodes = 5", "nodse = 5").as_bytes());
    let (code, _, err) = run(&["run", path.to_str().unwrap()]);
    assert_eq!(code, Some(2));
    assert!(err.contains("typo.toml:14:1: unknown key 'nodse' in [graph] of kind 'ring'; "), "{err}");
    assert!(err.contains("did you mean 'nodes'?"), "{err}");
}

#[test]
fn each_class_of_bad_value_is_refused_with_its_range() {
    refused_set("coupling.funnel.rate=-1", "coupling.funnel.rate = -1: must be > 0 (1/s)");
    refused_set("agent.state=nan", "agent.state = nan: must be a finite number (state units)");
    refused_set("graph.weight=0", "graph.weight = 0: must be > 0 (edge weight)");
    refused_set("bus.loss=1.5", "bus.loss = 1.5: must be from 0 to 1 (probability)");
    refused_set(
        "time.tick=1 fortnight",
        "time.tick = 1 fortnight: must be a duration with a unit, as \"1ms\" (units: ns, us, ms, s, min, h)",
    );
    let message = "must be a whole number of ticks of 3ms; \"20.001s\" would do";
    let (code, _, err) = run(&["check", FIVE, "--set", "time.tick=3ms"]);
    assert_eq!(code, Some(2));
    assert!(err.contains(message), "{err}");
}

#[test]
fn networks_that_cannot_be_are_refused() {
    for nodes in ["0", "2001"] {
        let range =
            "must be an integer from 1 to 2000 (and a run takes 127 at most, without bus.model = \"none\")";
        refused_set(&format!("graph.nodes={nodes}"), &format!("graph.nodes = {nodes}: {range}"));
    }
    refused_set(
        "graph={kind=\"edges\",nodes=5,edges=[[1,2],[3,4]]}",
        "graph: must be connected (Assumption 1), but it falls into 3 parts: {1, 2}, {3, 4}, {5}; \
         add an edge between them",
    );
    refused_set(
        "graph={kind=\"edges\",nodes=5,edges=[[1,2,1.0],[2,1,0.5]]}",
        "graph.edges[1] = [2,1,0.5]: must have one weight: 1 and 2 are already joined with weight \
         1, and the graph \
         is undirected",
    );
}

#[test]
fn what_no_node_adopts_while_it_runs_says_so() {
    refused_set(
        "event=[{at='1s',kind='set',key='time.tick',value='2ms'}]",
        "event[0].key = 'time.tick': must be one of coupling.funnel, coupling.gain, coupling.damping, agent.dynamics, agent.limits, or a key in one of them: nothing else changes while nodes run",
    );
    refused_set(
        "event=[{at='1s',kind='set',key='coupling.funnel.rate',value=-1}]",
        "coupling.funnel.rate = -1: must be > 0 (1/s)",
    );
}

#[test]
fn a_start_outside_the_funnel_says_what_would_do() {
    refused_set(
        "node.3.state=30",
        "node 3: starts outside its funnel: |nu| = 66 at t = 0 must be below psi(0) = 40, and is 26 too much \
         (ratio 1.65); funnel start = 70 (or factor = 1.8) would do",
    );
    assert_eq!(
        run(&["check", FIVE, "--set", "node.3.state=30", "--set", "coupling.funnel.start=70"]).0,
        Some(0)
    );
}

#[test]
fn check_gives_json_for_machines() {
    let (code, out, _) = run(&["check", FIVE, "--json", "--seed", "9", "--set", "graph.kind=complete"]);
    let report: serde_json::Value = serde_json::from_str(&out).unwrap();
    assert_eq!(code, Some(0));
    assert_eq!(report["seed"], 9);
    assert_eq!(report["edges"], 10);
    assert_eq!(report["pass"], true);
    assert_eq!(report["findings"][0]["name"], "graph");
    assert!((report["findings"][0]["values"]["lambda2"].as_f64().unwrap() - 5.0).abs() < 1e-9);
}

#[test]
fn warnings_come_with_what_to_change() {
    let (code, out, _) = run(&["check", "scenarios/narrow-ring.toml", "--set", "time.tick=10ms"]);
    // The scenario expects a ratio below 1.
    assert_eq!(code, Some(2));
    assert!(out.contains("WARN         Tick "), "{out}");
    assert!(out.contains("-> |nu| may leave the funnel; use a tick of"), "{out}");
    assert!(out.contains("2 warnings and "), "{out}");
}

#[test]
fn completions_are_printed_for_the_common_shells() {
    for shell in ["bash", "zsh", "fish", "elvish", "powershell"] {
        let (code, out, err) = run(&["completions", shell]);
        assert_eq!((code, err.as_str()), (Some(0), ""));
        assert!(out.contains("sim-host") && out.contains("junit"), "{shell}");
    }
}

#[test]
fn manual_pages_are_printed_for_the_program_and_its_commands() {
    for (arguments, title) in [(&["man"][..], ".TH sim-host 1"), (&["man", "run"], ".TH sim-host-run 1")] {
        let (code, out, err) = run(arguments);
        assert_eq!((code, err.as_str()), (Some(0), ""));
        assert!(out.contains(title) && out.contains(".SH OPTIONS"), "{arguments:?}: {out}");
    }
    refused(
        &["man", "fly"],
        "man fly: there is no such command; there are run, bench, node, sweep, check, diff, replay, report, export, schema, completions, man, help",
    );
}

#[test]
fn a_reader_that_goes_away_is_no_panic() {
    for arguments in [vec!["completions", "bash"], vec!["check", FIVE], vec!["--help"]] {
        let mut child =
            sim_host().args(&arguments).stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().unwrap();
        drop(child.stdout.take());
        let mut err = String::new();
        child.stderr.take().unwrap().read_to_string(&mut err).unwrap();
        assert_eq!((child.wait().unwrap().code(), err.as_str()), (Some(0), ""), "{arguments:?}");
    }
}

/// What is called as the emulator is may be anything: one that never answers is given up, and is not left behind.
#[cfg(unix)]
#[test]
fn an_emulator_that_never_answers_is_given_up() {
    use std::os::unix::fs::PermissionsExt;
    let folder = tempfile::tempdir().unwrap();
    let fake = folder.path().join("qemu-system-arm");
    let pid = folder.path().join("pid");
    std::fs::write(&fake, format!("#!/bin/sh\necho $$ > {}\nexec sleep 1000\n", pid.display())).unwrap();
    std::fs::set_permissions(&fake, std::fs::Permissions::from_mode(0o755)).unwrap();
    let path = format!("{}:{}", folder.path().display(), std::env::var("PATH").unwrap());
    let scenario = concat!(env!("CARGO_MANIFEST_DIR"), "/../scenarios/five-agents.toml");
    let output = sim_host()
        .env("PATH", path)
        .args(["run", scenario, "--on", "emulator", "--image", scenario, "--set", "time.duration=10ms"])
        .output()
        .unwrap();
    let words = String::from_utf8_lossy(&output.stderr);
    assert_eq!(output.status.code(), Some(3), "{words}");
    assert!(words.contains("node 1 did not answer"), "{words}");
    let pid = std::fs::read_to_string(pid).unwrap();
    assert!(!std::path::Path::new(&format!("/proc/{}", pid.trim())).exists(), "process {pid} is left");
}
