//! `sim-host run` end to end: files, exit codes, and what a shell can do to a program.
#![allow(clippy::unwrap_used, clippy::panic, reason = "helpers of tests, which clippy does not know as such")]

use serde_json::Value;
use std::collections::BTreeMap;
use std::fs;
use std::io::{Read, Write};
use std::path::Path;
use std::process::{Command, Output, Stdio};
use tempfile::TempDir;

const FIVE: &str = "scenarios/five-agents.toml";
const LOSSY: &str = "scenarios/lossy-ring.toml";
const SHORT: &str = "time.duration=200ms";

fn repository() -> std::path::PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("..")
}

fn sim_host(arguments: &[&str]) -> Command {
    let mut command = Command::new(env!("CARGO_BIN_EXE_sim-host"));
    command.current_dir(repository()).args(arguments).stdin(Stdio::null());
    command
}

/// Exit code, standard output, standard error.
fn text(output: Output) -> (Option<i32>, String, String) {
    let Output { status, stdout, stderr } = output;
    (status.code(), String::from_utf8(stdout).unwrap(), String::from_utf8(stderr).unwrap())
}

fn run(arguments: &[&str]) -> (Option<i32>, String, String) {
    text(sim_host(arguments).output().unwrap())
}

/// 200 ticks of a scenario with `--out` and more: every file that it leaves, by name.
fn outputs(scenario: &str, more: &[&str]) -> BTreeMap<String, String> {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("made/on/the/way");
    let arguments = [&["run", scenario, "--set", SHORT, "--out", out.to_str().unwrap()], more].concat();
    let (code, _, err) = run(&arguments);
    assert_eq!((code, err.as_str()), (Some(0), ""));
    files(&out)
}

fn files(folder: &Path) -> BTreeMap<String, String> {
    let entry = |entry: std::io::Result<fs::DirEntry>| {
        let path = entry.unwrap().path();
        let name = path.file_name().unwrap().to_str().unwrap().to_owned();
        (name, fs::read_to_string(path).unwrap())
    };
    fs::read_dir(folder).unwrap().map(entry).collect()
}

fn summary(files: &BTreeMap<String, String>) -> Value {
    serde_json::from_str(&files["summary.json"]).unwrap()
}

fn hash(scenario: &str, more: &[&str]) -> Value {
    summary(&outputs(scenario, more))["trace_hash"].clone()
}

/// Without the wall time and the name of the folder, which are all that may differ between two runs of a
/// command.
fn without_wall_time(mut files: BTreeMap<String, String>) -> BTreeMap<String, String> {
    let summary = files.get_mut("summary.json").unwrap();
    let varies = |line: &&str| line.contains("\"wall_s\"") || line.contains("\"command\"");
    *summary = summary.lines().filter(|line| !varies(line)).collect();
    files
}

fn path(folder: &TempDir, name: &str) -> String {
    folder.path().join(name).to_str().unwrap().to_owned()
}

/// Not captured by the test runner, so that a skipped check is seen.
fn skip(what: &str) {
    let _ = writeln!(std::io::stderr(), "SKIPPED: {what}");
}

#[test]
fn the_folder_has_the_files_of_the_contract() {
    let files = outputs(FIVE, &[]);
    let names: Vec<_> = files.keys().map(String::as_str).collect();
    assert_eq!(
        names,
        [
            "agreement.svg",
            "events.txt",
            "funnels.svg",
            "inputs.svg",
            "scenario.toml",
            "states.svg",
            "summary.json",
            "trajectory.csv"
        ]
    );
    for name in ["agreement.svg", "funnels.svg", "inputs.svg", "states.svg"] {
        assert!(files[name].starts_with("<svg") && files[name].trim_end().ends_with("</svg>"), "{name}");
    }
    assert_eq!(files["events.txt"].matches(" started").count(), 5);
}

#[test]
fn verbose_says_what_nodes_report() {
    let run = |option: &str| {
        let mut command = std::process::Command::new(env!("CARGO_BIN_EXE_sim-host"));
        let scenario = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("../scenarios/five-agents.toml");
        command.arg("run").arg(scenario).args([option, "--set", "time.duration=5ms"]);
        String::from_utf8(command.output().unwrap().stderr).unwrap()
    };
    assert_eq!(run("--verbose").matches(" started\n").count(), 5);
    assert_eq!(run("--quiet"), "");
}

#[test]
fn the_trajectory_has_the_columns_of_the_contract_and_a_row_per_tick() {
    let files = outputs(FIVE, &[]);
    let rows: Vec<Vec<_>> = files["trajectory.csv"].lines().map(|row| row.split(',').collect()).collect();
    let columns = ["x", "nu", "psi", "u"].map(|name| (1..=5).map(move |id| format!("{name}_{id}")));
    let header: Vec<_> = ["t".to_owned()]
        .into_iter()
        .chain(columns.into_iter().flatten())
        .chain(["xi", "blended"].map(str::to_owned))
        .chain(["true_nu", "asked_psi"].iter().flat_map(|name| (1..=5).map(move |id| format!("{name}_{id}"))))
        .collect();
    assert_eq!(rows[0], header);
    assert_eq!(rows.len(), 1 + 201);
    assert!(rows.iter().all(|row| row.len() == header.len()));
    assert_eq!(rows[1][..6], ["0.0", "3.5", "-2.0", "4.5", "-4.0", "0.5"]);
    assert_eq!(rows[1][11..16], ["40.0"; 5]);
    assert_eq!(rows[201][0], "0.2");
    assert!(rows[1..].iter().flatten().all(|value| value.parse::<f64>().unwrap().is_finite()));
}

#[test]
fn the_summary_has_the_keys_of_the_contract() {
    let summary = summary(&outputs(FIVE, &[]));
    let keys = |value: &Value| value.as_object().unwrap().keys().cloned().collect::<Vec<_>>().join(" ");
    assert_eq!(
        keys(&summary),
        "bus checks command counters emergent ended_early expect funnel max_input nodes on overruns passed reference scenario seed stopped \
         sync tick_s ticks trace_hash version wall_s"
    );
    assert_eq!(keys(&summary["funnel"]), "believed breaches max_ratio reopened_ratio uncoupled unknown");
    assert_eq!(keys(&summary["funnel"]["believed"]), "breaches max_ratio");
    assert_eq!(keys(&summary["sync"]), "bound final_spread lambda2 max_spread");
    assert_eq!(
        keys(&summary["emergent"]),
        "blended_error blended_final contraction final_error steady_ratio steady_ratio_max xi_final"
    );
    assert_eq!(keys(&summary["reference"]), "error_estimate final_error max_error resolved");
    assert_eq!(
        keys(&summary["bus"]),
        "corrupted duplicated lost no_room refused reordered replaced sent utilisation"
    );
    assert_eq!(keys(&summary["expect"][0]), "limit name pass value");
    let hash = summary["trace_hash"].as_str().unwrap();
    assert!(hash.len() == 16 && hash.bytes().all(|byte| byte.is_ascii_hexdigit()), "{hash}");
    // One frame per node to begin with and one per tick, the last tick included; and the weight of each edge,
    // by both ends.
    assert_eq!(summary["bus"]["sent"], 5 * (1 + 201) + 2 * 5);
    assert_eq!(
        (&summary["ticks"], &summary["on"], &summary["seed"]),
        (&200.into(), &"loopback".into(), &1.into())
    );
}

#[test]
fn predictions_in_the_summary_are_those_of_the_last_row() {
    let files = outputs(FIVE, &["--set", "expect.blended_error=100"]);
    let (emergent, expect) = (&summary(&files)["emergent"], &summary(&files)["expect"]);
    let row = files["trajectory.csv"].lines().last().unwrap().split(',').map(|value| value.parse().unwrap());
    let row: Vec<f64> = row.collect();
    let (states, xi, blended) = (&row[1..6], row[21], row[22]);
    let distance = |to: f64| states.iter().map(|x| (x - to).abs()).fold(0.0, f64::max);
    let close = |value: &Value, exact: f64| (value.as_f64().unwrap() - exact).abs() < 1e-6;
    assert!(close(&emergent["xi_final"], xi) && close(&emergent["final_error"], distance(xi)));
    assert!(
        close(&emergent["blended_final"], blended) && close(&emergent["blended_error"], distance(blended))
    );
    assert!((xi - blended).abs() > 0.1);
    // The slopes of the five fields are from -1.24 to -0.72.
    let (slowest, mean) = (&emergent["contraction"]["slowest"], &emergent["contraction"]["mean"]);
    assert!(slowest.as_f64().unwrap() < -0.72 && mean.as_f64() < slowest.as_f64());
    let ratios = |key: &str| emergent[key].as_array().unwrap().iter().map(|s| s.as_f64().unwrap()).collect();
    let (end, largest): (Vec<f64>, Vec<f64>) = (ratios("steady_ratio"), ratios("steady_ratio_max"));
    // Equal funnels: the ratios sum to zero.
    assert!(end.len() == 5 && end.iter().sum::<f64>().abs() < 1e-12);
    assert!(end.iter().zip(&largest).all(|(end, largest)| end.abs() <= *largest && *largest < 1.0));
    let judged = expect.as_array().unwrap().iter().find(|line| line["name"] == "blended_error").unwrap();
    assert_eq!((&judged["value"], &judged["pass"]), (&emergent["blended_error"], &true.into()));
}

#[test]
fn every_thins_the_rows_and_nothing_else() {
    let (all, thinned) = (outputs(FIVE, &[]), outputs(FIVE, &["--every", "30ms"]));
    let all_rows: Vec<_> = all["trajectory.csv"].lines().collect();
    let rows: Vec<_> = thinned["trajectory.csv"].lines().collect();
    // The last tick has a row whether or not its turn has come.
    let wanted: Vec<_> = all_rows[1..].iter().step_by(30).chain(all_rows.last()).collect();
    assert!(rows[1..].iter().eq(wanted.iter().copied()), "{} rows", rows.len());
    assert_eq!(wanted.len(), 8);
    assert_eq!(summary(&all)["trace_hash"], summary(&thinned)["trace_hash"]);
    // Two thousand rows without --every.
    let long = outputs(FIVE, &["--set", "time.duration=5s", "--set", "expect.reference_error=0.01"]);
    assert_eq!(long["trajectory.csv"].lines().count(), 1 + 1 + 5000 / 3 + 1);
}

#[test]
fn the_same_command_gives_the_same_bytes() {
    for scenario in [FIVE, LOSSY] {
        let [first, second] = [(); 2].map(|()| without_wall_time(outputs(scenario, &["--seed", "3"])));
        assert_eq!(first, second);
    }
}

#[test]
fn the_seed_changes_lossy_runs_and_nothing_else() {
    assert_eq!(hash(FIVE, &["--seed", "1"]), hash(FIVE, &["--seed", "2"]));
    assert_eq!(hash(LOSSY, &["--seed", "2"]), hash(LOSSY, &["--seed", "2"]));
    assert_ne!(hash(LOSSY, &["--seed", "1"]), hash(LOSSY, &["--seed", "2"]));
    assert_eq!(hash(LOSSY, &[]), hash(LOSSY, &["--seed", "1"]));
    let other = ["--set", "bus.loss=0", "--seed", "5"];
    assert_eq!(hash(LOSSY, &other), hash(FIVE, &[]));
}

#[test]
fn an_expectation_that_fails_is_code_1_with_the_command_that_repeats_it() {
    let folder = tempfile::tempdir().unwrap();
    let (json, junit) = (path(&folder, "a.json"), path(&folder, "a.xml"));
    let (code, out, err) = run(&[
        "run",
        LOSSY,
        "--set",
        SHORT,
        "--set",
        "expect.funnel_ratio=0.01",
        "--json",
        &json,
        "--junit",
        &junit,
    ]);
    assert_eq!(code, Some(1), "{err}");
    assert!(out.contains("FAIL") && out.contains("funnel_ratio"), "{out}");
    assert!(err.contains("failed: funnel_ratio = 0."), "{err}");
    assert!(err.contains("seed 1; repeat with: ") && err.contains("--seed 1\n"), "{err}");
    let summary: Value = serde_json::from_str(&fs::read_to_string(json).unwrap()).unwrap();
    assert_eq!((&summary["expect"][0]["pass"], &summary["expect"][1]["pass"]), (&false.into(), &true.into()));
    let junit = fs::read_to_string(junit).unwrap();
    // Two expectations, eight checks and the breaches.
    assert!(junit.contains("tests=\"11\"") && junit.contains("failures=\"1\""), "{junit}");
    assert!(junit.contains("<failure") && junit.contains("--seed 1"), "{junit}");
}

#[test]
fn quiet_says_nothing_and_the_repeating_command_works() {
    assert_eq!(run(&["run", FIVE, "--set", SHORT, "-q"]), (Some(0), String::new(), String::new()));
    let (_, _, err) =
        run(&["run", LOSSY, "--set", SHORT, "--set", "expect.funnel_ratio=0.01", "-q", "--seed", "8"]);
    let again = err.lines().find_map(|line| line.split_once("repeat with: ")).unwrap().1;
    let output = Command::new("sh").args(["-c", again]).current_dir(repository()).output().unwrap();
    assert_eq!(text(output), (Some(1), String::new(), err));
}

#[test]
fn rows_that_go_nowhere_are_said() {
    let every = ["run", FIVE, "--set", SHORT, "--every", "10ms"];
    let (code, _, err) = run(&every);
    assert_eq!(code, Some(0));
    assert_eq!(err, "note: --every says which rows trajectory.csv has, and there is none without --out\n");
    assert_eq!(run(&[&every[..], &["-q"]].concat()).2, "");
}

#[test]
fn outputs_that_cannot_be_written_are_code_2_by_name() {
    let folder = tempfile::tempdir().unwrap();
    let file = path(&folder, "file");
    fs::write(&file, "kept").unwrap();
    let inside = format!("{file}/out");
    for (option, path) in [("--out", &file), ("--out", &inside), ("--json", &inside), ("--junit", &inside)] {
        // A run of hours, which a refusal does not wait for.
        let (code, out, err) = run(&["run", FIVE, "--set", "time.duration=10h", option, path]);
        assert_eq!((code, out.as_str()), (Some(2), ""), "{err}");
        assert!(err.starts_with("cannot write ") && err.contains(&file), "{err}");
    }
    let name = folder.path().to_str().unwrap();
    assert_eq!(run(&["run", FIVE, "--set", SHORT, "--json", name]).0, Some(2), "a folder is no file");
    assert_eq!(files(folder.path()), [("file".to_owned(), "kept".to_owned())].into());
}

#[test]
fn a_full_disk_is_code_2_and_leaves_no_half_file() {
    let folder = tempfile::tempdir().unwrap();
    let mount = folder.path().to_str().unwrap();
    let mounted = Command::new("mount").args(["-t", "tmpfs", "-o", "size=64k", "tmpfs", mount]).output();
    if !mounted.is_ok_and(|output| output.status.success()) {
        return skip(
            "a_full_disk_is_code_2_and_leaves_no_half_file: a small file system cannot be mounted here",
        );
    }
    let (code, _, err) = run(&["run", FIVE, "--set", "time.duration=1s", "--out", mount]);
    let left = files(folder.path());
    assert!(Command::new("umount").arg(mount).status().unwrap().success());
    assert_eq!(code, Some(2), "{err}");
    assert!(err.starts_with("cannot write ") && err.contains("No space left"), "{err}");
    assert_eq!(left, BTreeMap::new());
}

#[test]
fn devices_are_written_to_and_stay_devices() {
    let (code, out, err) =
        run(&["run", FIVE, "--set", SHORT, "-q", "--json", "/dev/stdout", "--junit", "/dev/null"]);
    assert_eq!((code, err.as_str()), (Some(0), ""));
    assert_eq!(serde_json::from_str::<Value>(&out).unwrap()["ticks"], 200);
    use std::os::unix::fs::FileTypeExt;
    assert!(fs::metadata("/dev/null").unwrap().file_type().is_char_device());
    let (code, _, err) = run(&["run", FIVE, "--set", SHORT, "-q", "--json", "/dev/full"]);
    assert_eq!(code, Some(2));
    assert!(err.starts_with("cannot write /dev/full: No space left"), "{err}");
}

/// A shell's redirections, with the program and its arguments as `"$@"`.
fn shell(script: &str) -> (Option<i32>, String, String) {
    let mut command = Command::new("sh");
    command.args(["-c", script, "sh", env!("CARGO_BIN_EXE_sim-host"), "run", FIVE, "--set", SHORT]);
    text(command.current_dir(repository()).output().unwrap())
}

#[test]
fn closed_streams_are_no_defect() {
    let (code, out, err) = shell("exec \"$@\" <&-");
    assert_eq!((code, err.as_str()), (Some(0), ""));
    assert!(out.contains("largest |nu|/psi"), "{out}");
    assert_eq!(shell("exec \"$@\" >&-"), (Some(0), String::new(), String::new()));
    assert_eq!(shell("exec \"$@\" 2>&- >&- <&-"), (Some(0), String::new(), String::new()));
    let (code, _, err) = shell("exec \"$@\" >/dev/full");
    assert_eq!(code, Some(2));
    assert!(err.starts_with("cannot write to standard output: "), "{err}");
}

#[test]
fn without_a_terminal_there_is_no_progress_bar() {
    let (code, out, err) = run(&["run", FIVE]);
    assert_eq!((code, err.as_str()), (Some(0), ""));
    assert!(!out.contains(['\r', '\x1b']), "{out}");
}

#[test]
fn a_reader_that_goes_away_does_not_change_the_verdict() {
    for (limit, verdict) in [("1.0", 0), ("0.01", 1)] {
        let limit = format!("expect.funnel_ratio={limit}");
        let mut child = sim_host(&["run", FIVE, "--set", SHORT, "--set", &limit])
            .stdout(Stdio::piped())
            .stderr(Stdio::piped())
            .spawn()
            .unwrap();
        drop(child.stdout.take());
        let mut err = String::new();
        child.stderr.take().unwrap().read_to_string(&mut err).unwrap();
        assert_eq!(child.wait().unwrap().code(), Some(verdict), "{err}");
        assert!(!err.contains("panicked") && !err.contains("Broken pipe"), "{err}");
    }
}

#[test]
fn weakly_centralised_coupling_runs_on_no_node() {
    let central =
        ["run", FIVE, "--set", SHORT, "--set", "coupling.kind=weakly-centralised", "--set", "expect={}"];
    let (code, out, _) = run(&central);
    assert_eq!(code, Some(0));
    assert!(out.contains("0 frames sent"), "{out}");
    let (code, _, err) = run(&[&central[..], &["--on", "emulator"]].concat());
    assert_eq!(code, Some(2));
    assert!(err.contains("each would have to know the gains of all others within the same tick"), "{err}");
}

#[test]
fn an_emergent_error_is_not_judged_where_xi_is_not_known() {
    let sets = ["--set", SHORT, "--set", "expect.emergent_error=1"];
    let (code, _, err) = run(&[&["run", "scenarios/vector-max-gain.toml"], &sets[..]].concat());
    assert_eq!(code, Some(2));
    assert!(err.contains("not known for max-gain coupling of states with 2 components"), "{err}");
}

#[test]
fn there_is_a_reference_for_vectors_and_edges_and_none_with_events() {
    let short = ["run", "--quiet", "--set", SHORT, "--set", "expect={}", "--on", "reference"];
    for scenario in ["scenarios/vector-oscillators.toml", "scenarios/economic-dispatch.toml"] {
        let (code, _, err) = run(&[&short[..], &[scenario]].concat());
        assert_eq!((code, err.as_str()), (Some(0), ""), "{scenario}");
    }
    let (code, _, err) = run(&["run", "--on", "reference", "scenarios/partition.toml"]);
    assert_eq!(code, Some(2), "{err}");
    assert!(err.contains("event"), "{err}");
}

#[test]
fn vector_states_have_columns_of_their_own_in_every_output() {
    let files =
        outputs("scenarios/vector-oscillators.toml", &["--set", "expect={final_value={is=0,within=9}}"]);
    let header = files["trajectory.csv"].lines().next().unwrap();
    assert!(
        header.starts_with("t,x_1_0,x_1_1,x_2_0,")
            && header.contains(",u_5_1,xi_0,xi_1,blended_0,blended_1,true_nu_1_0,")
            && header.ends_with(",asked_psi_5_1"),
        "{header}"
    );
    for (picture, label) in [
        ("funnels.svg", "node 1, x0"),
        ("funnels.svg", "node 5, x1"),
        ("states.svg", "state x1"),
        ("inputs.svg", "input u1"),
    ] {
        assert!(files[picture].contains(label), "{label}");
    }
    let summary = summary(&files);
    assert_eq!(summary["emergent"]["xi_final"].as_array().unwrap().len(), 2);
    let judged = summary["expect"].as_array().unwrap();
    let last = judged.last().unwrap();
    assert_eq!(
        (&last["name"], &last["limit"], &last["pass"]),
        (&"final_value".into(), &9.0.into(), &true.into())
    );
    let states: Vec<f64> = files["trajectory.csv"]
        .lines()
        .last()
        .unwrap()
        .split(',')
        .skip(1)
        .take(10)
        .map(|x| x.parse().unwrap())
        .collect();
    let farthest = states.iter().fold(0.0f64, |most, x| most.max(x.abs()));
    assert_eq!(last["value"].as_f64().unwrap() as f32, farthest as f32);
}

#[test]
fn a_node_that_stops_by_itself_and_refused_frames_are_told_without_asking() {
    let stop = ["run", FIVE, "--set", SHORT, "--set", "coupling.on_breach=stop", "--set", "agent.noise=1e3"];
    let (code, _, err) = run(&stop);
    assert_eq!(code, Some(1), "{err}");
    assert!(err.contains("stopped by itself") && !err.contains("hears node"), "{err}");
    let (_, _, err) = run(&[&stop[..], &["-q"]].concat());
    // That it is why the run has failed is said all the same.
    assert!(
        err.lines().all(|line| !line.contains("stopped by itself") || line.starts_with("failed: stopped: ")),
        "{err}"
    );
    let (_, out, _) = run(&["run", FIVE, "--set", SHORT]);
    assert!(out.contains("deliveries lost\n"), "{out}");
    // Noise that takes every state beyond what a node accepts.
    let (_, out, _) = run(&["run", FIVE, "--set", SHORT, "--set", "agent.noise=1e9"]);
    assert!(out.contains(" refused"), "{out}");
}
