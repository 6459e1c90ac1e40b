//! `sim-host sweep` as users meet it: tables, kills, shards as processes, and what is refused.
#![allow(clippy::unwrap_used, clippy::panic, reason = "helpers of tests, which clippy does not know as such")]

use serde_json::Value;
use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Output, Stdio};
use std::time::{Duration, Instant};
use tempfile::TempDir;

/// Noise, so that seeds matter; a spread that some of the runs keep.
const SCENARIO: &str = r#"
version = 1
title = "Three on a path"
seed = 4
time = { tick = "1ms", duration = "100ms" }
graph = { kind = "path", nodes = 3 }
coupling = { kind = "node-wise", gain = { kind = "reciprocal", scale = 1.0 }, funnel = { kind = "constant", width = 9.0 } }
agent = { state = 1.0, noise = 0.01, dynamics = { kind = "affine", slope = -1.0, offset = 1.0 } }
expect = { final_spread = 1.0 }
"#;

/// A folder with a scenario, in which the program runs.
struct Place(TempDir);

struct Ended {
    code: Option<i32>,
    out: String,
    err: String,
}

impl Place {
    fn new() -> Self {
        let place = Self(tempfile::tempdir().unwrap());
        place.write("a.toml", SCENARIO);
        place
    }

    fn at(&self, name: &str) -> PathBuf {
        self.0.path().join(name)
    }

    fn write(&self, name: &str, text: &str) {
        fs::write(self.at(name), text).unwrap();
    }

    fn read(&self, name: &str) -> String {
        fs::read_to_string(self.at(name)).unwrap_or_else(|error| panic!("{name}: {error}"))
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

    fn sweep(&self, arguments: &[&str]) -> Ended {
        self.run(&[&["sweep", "a.toml"], arguments].concat())
    }

    /// The names in a folder, and in those in it.
    fn names(&self, folder: &str) -> Vec<String> {
        let mut names = Vec::new();
        for entry in fs::read_dir(self.at(folder)).unwrap() {
            let path = entry.unwrap().path();
            names.push(path.strip_prefix(self.at(folder)).unwrap().display().to_string());
        }
        names.sort();
        names
    }

    fn table(&self, name: &str) -> Vec<BTreeMap<String, String>> {
        let text = self.read(name);
        let mut reader = csv::Reader::from_reader(text.as_bytes());
        let names = reader.headers().unwrap().clone();
        let row = |record: csv::StringRecord| {
            names.iter().zip(record.iter()).map(|(name, cell)| (name.to_owned(), cell.to_owned())).collect()
        };
        reader.records().map(|record| row(record.unwrap())).collect()
    }

    /// The text of a table without the columns that depend on the machine.
    fn figures(&self, name: &str) -> String {
        let text = self.read(name);
        let mut reader = csv::Reader::from_reader(text.as_bytes());
        let names = reader.headers().unwrap().clone();
        let is_kept = |name: &str| !name.starts_with("wall_") && !name.starts_with("cpu_");
        let mut writer = csv::Writer::from_writer(Vec::new());
        let mut write = |record: &csv::StringRecord| {
            let cells = names.iter().zip(record).filter(|(name, _)| is_kept(name));
            writer.write_record(cells.map(|(_, cell)| cell)).unwrap();
        };
        write(&names);
        reader.records().for_each(|record| write(&record.unwrap()));
        String::from_utf8(writer.into_inner().unwrap()).unwrap()
    }
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
}

fn column<'t>(table: &'t [BTreeMap<String, String>], name: &str) -> Vec<&'t str> {
    table.iter().map(|row| row.get(name).unwrap_or_else(|| panic!("no column {name}")).as_str()).collect()
}

/// Numbers from a seed (SplitMix64).
struct Random(u64);

impl Random {
    fn below(&mut self, limit: u64) -> u64 {
        self.0 = self.0.wrapping_add(0x9E37_79B9_7F4A_7C15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
        (z ^ (z >> 31)) % limit
    }
}

#[test]
fn a_grid_with_seeds_has_a_row_for_each_run_with_every_figure_of_its_summary() {
    let place = Place::new();
    let grid = ["--grid", "graph.kind=path,complete", "--grid", "agent.noise=0.01,0.1"];
    let ended = place.sweep(&[&grid[..], &["--seeds", "3", "--out", "o"]].concat());
    assert_eq!((ended.code, ended.err.as_str()), (Some(0), ""));
    assert_eq!(ended.out, "12 runs: 12 passed, 0 failed; o/runs.csv\n");
    assert_eq!(place.names("o"), ["runs.csv", "scenario.toml", "sweep.json"]);
    let table = place.table("o/runs.csv");
    assert_eq!(column(&table, "run"), (1..=12).map(|run| run.to_string()).collect::<Vec<_>>());
    assert_eq!(column(&table, "seed"), ["4", "5", "6"].repeat(4));
    assert_eq!(column(&table, "graph.kind")[..6], ["path"; 6]);
    assert_eq!(column(&table, "agent.noise")[..6], ["0.01", "0.01", "0.01", "0.1", "0.1", "0.1"]);
    let head = "run,graph.kind,agent.noise,repetition,seed,trace_hash,nodes,";
    let text = place.read("o/runs.csv");
    assert!(
        text.starts_with(head) && text.lines().next().unwrap().ends_with(",verdict,why,wall_s,cpu_s"),
        "{text}"
    );
    assert!(!text.contains(&*place.0.path().to_string_lossy()) && !text.contains("a.toml"));
    // The very run, by itself.
    let sets = ["--set", "graph.kind=complete", "--set", "agent.noise=0.1", "--seed", "5"];
    place.run(&[&["run", "a.toml"], &sets[..], &["-q", "--json", "s.json"]].concat());
    let summary: Value = serde_json::from_str(&place.read("s.json")).unwrap();
    let row = &table[10];
    let mut count = 0;
    for (part, pointer) in [("", ""), ("funnel.", "/funnel"), ("sync.", "/sync"), ("counters.", "/counters")]
    {
        for (name, value) in summary.pointer(pointer).unwrap().as_object().unwrap() {
            let is_figure = value.is_number() && !["seed", "wall_s"].contains(&name.as_str());
            if is_figure || name == "trace_hash" {
                let text = value.as_str().map_or(value.to_string(), str::to_owned);
                assert_eq!(row[&format!("{part}{name}")], text, "{part}{name}");
                count += 1;
            }
        }
    }
    assert!(count > 25, "{count}");
    assert_eq!(row["expect.final_spread.value"], summary["expect"][0]["value"].to_string());
    assert_eq!((row["verdict"].as_str(), row["why"].as_str()), ("passed", ""));
}

#[test]
fn threads_change_nothing_but_times_and_independent_seeds_no_order() {
    let place = Place::new();
    // Runs of different lengths, so that they end in another order than they began.
    let grid = ["--grid", "time.duration=2s,20ms,400ms", "--grid", "agent.noise=0.01,0.1", "--seeds", "4"];
    for jobs in ["1", "2", "7"] {
        let ended = place.sweep(&[&grid[..], &["--jobs", jobs, "--out", jobs]].concat());
        assert_eq!(ended.code, Some(0), "{}", ended.err);
    }
    assert_eq!(place.figures("1/runs.csv"), place.figures("2/runs.csv"));
    assert_eq!(place.figures("1/runs.csv"), place.figures("7/runs.csv"));
    assert_eq!(place.figures("1/runs.csv").lines().count(), 25);
    let seeds = |grid: [&str; 4], out: &str| {
        let ended = place.sweep(&[&grid[..], &["--seeds", "2", "--independent", "--out", out]].concat());
        assert_eq!(ended.code, Some(0), "{}", ended.err);
        let mut hashes: Vec<_> =
            place.table(&format!("{out}/runs.csv")).iter().map(|row| row["trace_hash"].clone()).collect();
        hashes.sort();
        hashes
    };
    let one = seeds(["--grid", "graph.kind=path,complete", "--grid", "agent.noise=0.01,0.1"], "i");
    assert_eq!(one, seeds(["--grid", "agent.noise=0.1,0.01", "--grid", "graph.kind=complete,path"], "j"));
    let distinct: std::collections::BTreeSet<_> =
        column(&place.table("i/runs.csv"), "seed").into_iter().map(str::to_owned).collect();
    assert_eq!(distinct.len(), 8);
}

#[test]
fn points_come_from_lists_and_drawings_too() {
    let place = Place::new();
    place.write("points.csv", "# mine\nagent.noise,time.tick\n0.01,1ms\n0.2,2ms\n");
    let ended = place.sweep(&["--list", "points.csv", "--grid", "graph.kind=path,complete", "--out", "l"]);
    assert_eq!(ended.code, Some(0), "{}", ended.err);
    let table = place.table("l/runs.csv");
    assert_eq!(column(&table, "time.tick"), ["1ms", "1ms", "2ms", "2ms"]);
    assert_eq!(column(&table, "tick_s"), ["0.001", "0.001", "0.002", "0.002"]);
    for method in ["--sobol", "--lhs"] {
        let ranges = [
            "--range",
            "agent.noise=0.0..0.5",
            "--range",
            "graph.nodes=2..9",
            "--range",
            "coupling.gain.scale=0.1..10.0:log",
        ];
        let out = &method[2..];
        let ended =
            place.sweep(&[&[method, "8", "--out", out], &ranges[..], &["--set", "expect={}"]].concat());
        assert_eq!(ended.code, Some(0), "{}", ended.err);
        assert!(ended.err.contains("the scenario expects nothing"), "{}", ended.err);
        let table = place.table(&format!("{out}/runs.csv"));
        let mut nodes = column(&table, "nodes");
        assert_eq!(nodes, column(&table, "graph.nodes"));
        nodes.sort_unstable();
        assert_eq!(nodes, ["2", "3", "4", "5", "6", "7", "8", "9"], "{method}");
        // One row has figures of nine nodes, and others none.
        assert_eq!(
            column(&table, "emergent.steady_ratio.9").iter().filter(|cell| !cell.is_empty()).count(),
            1
        );
    }
}

#[test]
fn a_wrong_key_or_value_is_refused_before_any_run_by_the_reader() {
    let place = Place::new();
    let refused = |arguments: &[&str], words: &[&str]| {
        place.sweep(&[arguments, &["--out", "o"]].concat()).refused(words);
        assert!(!place.at("o").exists(), "{arguments:?}");
    };
    refused(
        &["--grid", "graph.nodse=3,4"],
        &["--grid graph.nodse=3: unknown key 'nodse' in [graph] of kind 'path'", "did you mean 'nodes'?"],
    );
    refused(
        &["--grid", "bus.loss=0.1,1.5", "--seeds", "2"],
        &[
            "--grid bus.loss=1.5: bus.loss = 1.5: must be from 0 to 1",
            "2 of 4 runs are refused; --allow-refused",
        ],
    );
    refused(&["--grid", "bus.loss"], &["--grid", "must be key=a,b,c"]);
    refused(&["--grid", "seed=1,2"], &["seed cannot be swept", "--seeds K"]);
    // Columns of every table: with --allow-refused they would be in it twice.
    for name in ["run", "repetition", "verdict", "why", "wall_s", "cpu_s"] {
        let grid = format!("{name}=1,2");
        refused(&["--allow-refused", "--grid", &grid], &[&format!("{name} cannot be swept")]);
    }
    refused(&["--set", "seed=3"], &["use --seed"]);
    refused(
        &["--grid", "bus.loss=0.1", "--set", "bus.loss=0.2"],
        &["bus.loss is swept, and set by --set, too"],
    );
    refused(&["--sobol", "8"], &["--sobol 8: needs a range"]);
    refused(&["--range", "bus.loss=0.0..0.3"], &["--sobol N or --lhs N"]);
    refused(&["--shard", "3/2"], &["--shard", "must be i/n"]);
    refused(&["--seeds", "0"], &["--seeds"]);
    place.write("points.csv", "bus.loss\n0.1\n7\n");
    refused(&["--list", "points.csv"], &["--list points.csv, line 3: bus.loss = 7: must be from 0 to 1"]);
    refused(&["--list", "none.csv"], &["none.csv: cannot be read"]);
    let ended = place.run(&["sweep", "a.toml"]);
    ended.refused(&["--out <DIR>"]);
}

#[test]
fn refused_runs_are_rows_where_that_is_allowed() {
    let place = Place::new();
    let grid = ["--grid", "bus.loss=0.1,1.5", "--seeds", "2", "--allow-refused", "--out", "o"];
    let ended = place.sweep(&grid);
    assert_eq!(ended.code, Some(0), "{}", ended.err);
    assert_eq!(ended.out, "4 runs: 2 passed, 0 failed, 2 refused; o/runs.csv\n");
    let table = place.table("o/runs.csv");
    assert_eq!(column(&table, "verdict"), ["passed", "passed", "refused", "refused"]);
    assert!(table[2]["why"].contains("must be from 0 to 1") && table[2]["trace_hash"].is_empty());
}

#[test]
fn a_failing_run_prints_its_command_and_leaves_its_scenario() {
    let place = Place::new();
    let grid =
        ["--grid", "node.1.state=1.0,4.5", "--set", "time.duration=20ms", "--seeds", "2", "--out", "o"];
    let ended = place.sweep(&grid);
    assert_eq!(
        (ended.code, ended.out.as_str()),
        (Some(1), "4 runs: 2 passed, 2 failed; o/runs.csv\n"),
        "{}",
        ended.err
    );
    let table = place.table("o/runs.csv");
    assert_eq!(column(&table, "verdict"), ["passed", "passed", "failed", "failed"]);
    assert!(table[2]["why"].starts_with("final_spread = "), "{}", table[2]["why"]);
    assert_eq!(place.names("o/failed"), ["run-3", "run-4"]);
    // Both the command and the scenario are the run, to the bit.
    let told = ended.err.split("run 4 failed: ").nth(1).unwrap();
    let command = told.split("repeat with: ").nth(1).unwrap().split("; its scenario: ").next().unwrap();
    assert!(
        command.contains(" run a.toml --set time.duration=20ms --set node.1.state=4.5 --seed 5"),
        "{command}"
    );
    let shell = Command::new("sh")
        .args(["-c", &format!("{command} -q --json s.json")])
        .current_dir(place.0.path())
        .output();
    assert_eq!(shell.unwrap().status.code(), Some(1));
    let hash = |name: &str| {
        serde_json::from_str::<Value>(&place.read(name)).unwrap()["trace_hash"].as_str().unwrap().to_owned()
    };
    assert_eq!(hash("s.json"), table[3]["trace_hash"]);
    assert_eq!(place.run(&["run", "o/failed/run-4/scenario.toml", "-q", "--json", "t.json"]).code, Some(1));
    assert_eq!(hash("t.json"), table[3]["trace_hash"]);
    // Gone on with, it still fails.
    let again = place.sweep(&[&grid[..], &["--resume"]].concat());
    assert_eq!((again.code, again.err.as_str()), (Some(1), ""));
}

#[test]
fn a_scenario_from_standard_input_is_repeated_from_what_is_left() {
    let place = Place::new();
    let mut command = place.command(&[
        "sweep",
        "-",
        "--grid",
        "node.1.state=4.5",
        "--set",
        "time.duration=20ms",
        "--out",
        "o",
    ]);
    command.stdin(fs::File::open(place.at("a.toml")).unwrap());
    let ended = Ended::of(command.output().unwrap());
    assert_eq!(ended.code, Some(1), "{}", ended.err);
    assert!(ended.err.contains(" run o/failed/run-1/scenario.toml"), "{}", ended.err);
}

#[test]
fn the_same_sweep_goes_on_and_another_one_is_refused() {
    let place = Place::new();
    let grid = ["--grid", "bus.loss=0.0,0.1", "--seeds", "2", "--out", "o"];
    assert_eq!(place.sweep(&[&grid[..], &["--resume"]].concat()).code, Some(0));
    let before = place.read("o/runs.csv");
    place.sweep(&grid).refused(&["o/runs.csv has rows of this sweep; --resume goes on"]);
    let again = place.sweep(&[&grid[..], &["--resume"]].concat());
    assert_eq!((again.code, again.out.as_str()), (Some(0), "4 runs: 4 passed, 0 failed; o/runs.csv\n"));
    let differs = |arguments: &[&str], words: &[&str]| {
        place.sweep(&[arguments, &["--resume", "--out", "o"]].concat()).refused(words);
    };
    differs(&["--grid", "bus.loss=0.0,0.2", "--seeds", "2"], &["another sweep, by its grid"]);
    differs(
        &["--grid", "bus.loss=0.0,0.1", "--seeds", "3"],
        &["runs (4 there, 6 here)", "seeds (2 there, 3 here)"],
    );
    differs(&["--grid", "bus.loss=0.0,0.1", "--seeds", "2", "--seed", "9"], &["seed (4 there, 9 here)"]);
    differs(
        &["--grid", "bus.loss=0.0,0.1", "--seeds", "2", "--independent"],
        &["independent (false there, true here)"],
    );
    differs(&["--grid", "bus.loss=0.0,0.1", "--seeds", "2", "--shard", "1/2"], &["shards (0 there, 2 here)"]);
    differs(&["--grid", "bus.loss=0.0,0.1", "--seeds", "2", "--set", "agent.noise=0.02"], &["scenario_hash"]);
    // Words that change nothing do not matter, and values that do, do.
    place.write("a.toml", &format!("# A comment\n{SCENARIO}"));
    assert_eq!(place.sweep(&[&grid[..], &["--resume"]].concat()).code, Some(0));
    place.write("a.toml", &SCENARIO.replace("slope = -1.0", "slope = -1.1"));
    differs(&["--grid", "bus.loss=0.0,0.1", "--seeds", "2"], &["another sweep, by its scenario_hash"]);
    assert_eq!(place.read("o/runs.csv"), before);
}

#[test]
fn a_run_does_not_remove_a_sweep_and_a_sweep_overwrites_no_input() {
    let place = Place::new();
    assert_eq!(place.sweep(&["--out", "o"]).code, Some(0));
    let before = place.read("o/runs.csv");
    place.run(&["run", "a.toml", "--out", "o"]).refused(&["--out o: has a sweep"]);
    assert_eq!(place.read("o/runs.csv"), before);
    place
        .run(&["sweep", "o/scenario.toml", "--out", "o", "--resume"])
        .refused(&["o/scenario.toml, which must not be overwritten"]);
    // Outputs of an earlier run go when a sweep begins, and a stranger's files stay.
    assert_eq!(place.run(&["run", "a.toml", "-q", "--out", "p"]).code, Some(0));
    place.write("p/thesis.tex", "mine");
    assert_eq!(place.sweep(&["--out", "p"]).code, Some(0));
    assert_eq!(place.names("p"), ["runs.csv", "scenario.toml", "sweep.json", "thesis.tex"]);
    fs::create_dir(place.at("q")).unwrap();
    place.write("q/runs.csv", "mine");
    place.sweep(&["--out", "q", "--resume"]).refused(&["q/runs.csv is there, without the sweep.json"]);
    assert_eq!(place.read("q/runs.csv"), "mine");
}

fn wait(child: &mut Child) -> Option<i32> {
    let begin = Instant::now();
    loop {
        if let Some(status) = child.try_wait().unwrap() {
            return status.code();
        }
        assert!(begin.elapsed() < Duration::from_secs(120), "it has not ended");
        std::thread::sleep(Duration::from_millis(2));
    }
}

fn signal(name: &str, child: &Child) {
    let sent = Command::new("kill").args([&format!("-{name}"), &child.id().to_string()]).status();
    assert!(sent.unwrap().success());
}

/// Some columns come late, so that the table is replaced in between; some runs fail, so that files are left.
const MANY: [&str; 9] = [
    "sweep",
    "a.toml",
    "--grid",
    "bus.model=ideal,can",
    "--grid",
    "node.1.state=1.0,4.5,1.5",
    "--seeds",
    "12",
    "--resume",
];

#[test]
fn the_rows_are_the_same_after_kills_at_any_moment() {
    let place = Place::new();
    let short = ["--set", "time.duration=60ms"];
    let whole = place.run(&[&MANY[..], &short, &["--out", "whole"]].concat());
    assert_eq!(
        (whole.code, whole.out.as_str()),
        (Some(1), "72 runs: 48 passed, 24 failed; whole/runs.csv\n"),
        "{}",
        whole.err
    );
    let mut random = Random(23);
    let (mut kills, mut partial) = (0, 0);
    let begin = Instant::now();
    loop {
        let mut child = place.command(&[&MANY[..], &short, &["--out", "o"]].concat());
        let mut child = child.stdout(Stdio::null()).stderr(Stdio::null()).spawn().unwrap();
        // Until something has changed, and then a random moment more.
        let size = || fs::metadata(place.at("o/runs.csv")).map_or(0, |metadata| metadata.len());
        let before = size();
        while size() == before && child.try_wait().unwrap().is_none() {
            std::thread::sleep(Duration::from_micros(200));
        }
        std::thread::sleep(Duration::from_micros(random.below(20_000)));
        if child.try_wait().unwrap().is_some() {
            break;
        }
        signal("KILL", &child);
        child.wait().unwrap();
        kills += 1;
        // What is there is whole rows, but for the last line.
        let text = place.read("o/runs.csv");
        let rows = text.lines().count() - 1;
        partial += usize::from(rows < 72);
        if kills % 4 == 0 {
            // A row that was cut, wherever: what a kill leaves where a write is torn.
            let cut = text.len() - random.below(text.lines().last().unwrap().len() as u64) as usize - 1;
            fs::write(place.at("o/runs.csv"), &text[..cut]).unwrap();
        }
        assert!(begin.elapsed() < Duration::from_secs(300), "{kills} kills");
    }
    println!("{kills} kills, {partial} of them before the end");
    assert!(partial >= 5, "{kills} kills, {partial} of them before the end");
    let last = place.run(&[&MANY[..], &short, &["--out", "o"]].concat());
    assert_eq!(last.code, whole.code, "{}", last.err);
    assert_eq!(place.figures("o/runs.csv"), place.figures("whole/runs.csv"));
    assert_eq!(place.names("o"), place.names("whole"));
    assert_eq!(place.names("o/failed"), place.names("whole/failed"));
}

#[test]
fn ctrl_c_ends_cleanly_and_says_how_to_go_on() {
    for (name, code) in [("INT", 130), ("TERM", 130), ("HUP", 129)] {
        let place = Place::new();
        let arguments = ["sweep", "a.toml", "--set", "time.duration=1s", "--seeds", "400", "--out", "o"];
        let mut child =
            place.command(&arguments).stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().unwrap();
        while !place.at("o/runs.csv").exists() {
            assert!(child.try_wait().unwrap().is_none());
            std::thread::sleep(Duration::from_millis(2));
        }
        signal(name, &child);
        wait(&mut child);
        let ended = Ended::of(child.wait_with_output().unwrap());
        assert_eq!((ended.code, ended.out.as_str()), (Some(code), ""), "{}", ended.err);
        let rows = column(&place.table("o/runs.csv"), "run").len();
        let told = format!("stopped by SIG{name}: {rows} of 400 runs are in o/runs.csv; go on with: ");
        assert!(ended.err.contains(&told), "{}", ended.err);
        assert!(
            ended.err.contains(" sweep a.toml --set time.duration=1s --seeds 400 --out o --resume"),
            "{}",
            ended.err
        );
        assert_eq!(place.names("o"), ["runs.csv", "scenario.toml", "sweep.json"]);
        assert!(rows < 400);
    }
}

#[test]
fn a_second_process_for_the_same_table_is_refused() {
    let place = Place::new();
    let arguments = ["--set", "time.duration=1s", "--seeds", "400", "--resume", "--out", "o"];
    let mut first = place.command(&[&["sweep", "a.toml"], &arguments[..]].concat());
    let mut first = first.stdout(Stdio::null()).stderr(Stdio::null()).spawn().unwrap();
    while !place.at("o/runs.csv").exists() {
        std::thread::sleep(Duration::from_millis(2));
    }
    let process = format!("another process (process {}) is running this sweep", first.id());
    place.sweep(&arguments).refused(&[&process]);
    place.run(&["run", "a.toml", "--out", "o"]).refused(&["another run"]);
    signal("KILL", &first);
    first.wait().unwrap();
}

#[test]
fn a_full_disk_is_an_error_that_names_the_file() {
    let place = Place::new();
    let sweep = format!(
        "trap '' XFSZ; ulimit -f 12; exec {} sweep a.toml --set time.duration=10ms --seeds 50 --out o",
        env!("CARGO_BIN_EXE_sim-host")
    );
    // A limit of 12 blocks of 512 or 1,024 bytes.
    let output = Command::new("bash").args(["-c", &sweep]).current_dir(place.0.path()).output().unwrap();
    Ended::of(output).refused(&["cannot write o/runs.csv: "]);
    let rows = place.table("o/runs.csv").len();
    assert!((1..50).contains(&rows), "{rows}");
    let ended = place.sweep(&["--set", "time.duration=10ms", "--seeds", "50", "--out", "o", "--resume"]);
    assert_eq!((ended.code, place.table("o/runs.csv").len()), (Some(0), 50), "{}", ended.err);
}

#[test]
fn shards_as_processes_of_their_own_are_merged_into_the_table_of_one_process() {
    let place = Place::new();
    let whole = place.run(&[&MANY[..], &["--out", "whole"]].concat());
    let start = |shard: &str| {
        let mut command =
            place.command(&[&MANY[..], &["--shard", shard, "--jobs", "1", "--out", "o"]].concat());
        command.stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().unwrap()
    };
    let shards: Vec<_> = ["1/4", "2/4", "3/4"].into_iter().map(start).collect();
    let ended: Vec<_> =
        shards.into_iter().map(|child| Ended::of(child.wait_with_output().unwrap())).collect();
    for ended in &ended {
        assert_eq!(
            (ended.code, ended.out.contains("merged")),
            (whole.code, false),
            "{} {}",
            ended.err,
            whole.err
        );
    }
    assert!(!place.at("o/runs.csv").exists());
    let last = Ended::of(start("4/4").wait_with_output().unwrap());
    assert!(
        last.out.contains("18 runs: ") && last.out.contains("merged into runs.csv"),
        "{} {}",
        last.out,
        last.err
    );
    assert_eq!(place.figures("o/runs.csv"), place.figures("whole/runs.csv"));
    let names = [
        "failed",
        "runs-1-of-4.csv",
        "runs-2-of-4.csv",
        "runs-3-of-4.csv",
        "runs-4-of-4.csv",
        "runs.csv",
        "scenario.toml",
        "sweep.json",
    ];
    assert_eq!(place.names("o"), names);
    place
        .run(&[&MANY[..], &["--shard", "1/5", "--out", "o"]].concat())
        .refused(&["shards (4 there, 5 here)"]);
}

/// Of two different sweeps that begin at once in one folder one is refused, and does no harm.
#[test]
fn different_sweeps_that_begin_at_once_do_not_mix() {
    for _ in 0..5 {
        let place = Place::new();
        let start = |loss: &str, shard: &str| {
            let grid = format!("bus.loss={loss}");
            let arguments = [
                "sweep", "a.toml", "--grid", &grid, "--seeds", "4", "--shard", shard, "--resume", "--out",
                "o",
            ];
            place.command(&arguments).stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().unwrap()
        };
        let children = [start("0.1", "1/2"), start("0.2", "2/2")];
        let ended = children.map(|child| Ended::of(child.wait_with_output().unwrap()));
        let mut codes = ended.each_ref().map(|ended| ended.code);
        codes.sort_unstable();
        assert_eq!(codes, [Some(0), Some(2)], "{} {}", ended[0].err, ended[1].err);
        let identity: Value = serde_json::from_str(&place.read("o/sweep.json")).unwrap();
        let loss = identity["grid"][0]["values"][0].as_str().unwrap().to_owned();
        let table = if loss == "0.1" { "o/runs-1-of-2.csv" } else { "o/runs-2-of-2.csv" };
        assert_eq!(column(&place.table(table), "bus.loss"), [loss.as_str(); 2]);
    }
}

/// Ten times as many threads as there are cores take the same rows, and a bar on a terminal says how far it is.
#[test]
fn on_a_terminal_there_is_a_bar_with_the_time_left() {
    let place = Place::new();
    let program = env!("CARGO_BIN_EXE_sim-host");
    // `script` gives it a terminal.
    let command = format!("{program} sweep a.toml --set time.duration=1s --seeds 40 --jobs 20 --out o");
    let output = Command::new("script")
        .args(["-qec", &command, "/dev/null"])
        .current_dir(place.0.path())
        .stdin(Stdio::null())
        .output();
    let Ok(output) = output else {
        println!("skipped: no `script` on this machine");
        return;
    };
    let text = String::from_utf8_lossy(&output.stdout);
    assert_eq!(output.status.code(), Some(0), "{text}");
    assert!(text.contains(" of 40 runs") && text.contains(" s left"), "{text}");
    assert!(text.contains("40 runs: 40 passed"), "{text}");
}

#[test]
fn the_page_of_the_book_names_every_option() {
    let page =
        fs::read_to_string(Path::new(env!("CARGO_MANIFEST_DIR")).join("../docs/book/src/sweeps.md")).unwrap();
    let help = Place::new().run(&["sweep", "--help"]).out;
    let options = help.split_whitespace().filter(|word| word.starts_with("--") && word.len() > 2);
    let names = options.map(|word| word.trim_end_matches(|c: char| !c.is_ascii_alphanumeric()));
    for name in names.filter(|name| !["--help", "--version"].contains(name)) {
        assert!(page.contains(name), "{name} is not in docs/book/src/sweeps.md");
    }
}

/// The same in one process and in shards, the last of which writes it; without the feature nothing is begun.
#[test]
fn a_whole_sweep_leaves_parquet_where_the_build_has_it() {
    let place = Place::new();
    let sweep = ["--grid", "bus.loss=0.0,0.1", "--seeds", "2", "--parquet", "--out"];
    let alone = place.sweep(&[&sweep[..], &["alone"]].concat());
    if !sim_host::sweep::HAS_PARQUET {
        alone.refused(&["--parquet: this build writes no Parquet", "--features parquet"]);
        assert!(!place.at("alone").exists());
        return;
    }
    assert_eq!(alone.code, Some(0), "{}", alone.err);
    for (shard, is_last) in [("1/2", false), ("2/2", true)] {
        assert_eq!(place.sweep(&[&sweep[..], &["shards", "--shard", shard]].concat()).code, Some(0));
        assert_eq!(place.at("shards/runs.parquet").exists(), is_last);
    }
    for folder in ["alone", "shards"] {
        let bytes = fs::read(place.at(&format!("{folder}/runs.parquet"))).unwrap();
        assert!(bytes.starts_with(b"PAR1") && bytes.ends_with(b"PAR1"));
    }
}
