//! Runs and checks without a bus, as users type them.
#![allow(clippy::unwrap_used, clippy::panic, reason = "a test that cannot go on has failed")]

use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Command, Output};

const SCENARIO: &str = r#"
version = 1
title = "Five thousand nodes"
[time]
tick = "1ms"
duration = "300ms"
[graph]
kind = "random-regular"
nodes = 5000
degree = 4
[coupling]
kind = "node-wise"
gain = { kind = "reciprocal" }
funnel = { kind = "exponential", start = 60, end = 2, rate = 10 }
[agent]
dynamics = { kind = "affine", slope = -1.0 }
random = { state = { uniform = [-2, 2] }, offset = { normal = [0, 1] } }
[bus]
model = "none"
[expect]
funnel_ratio = 1.0
"#;

fn sim_host(folder: &Path, arguments: &[&str]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_sim-host")).current_dir(folder).args(arguments).output().unwrap()
}

fn folder() -> (tempfile::TempDir, PathBuf) {
    let folder = tempfile::tempdir().unwrap();
    fs::write(folder.path().join("large.toml"), SCENARIO).unwrap();
    let path = folder.path().to_owned();
    (folder, path)
}

fn text(bytes: &[u8]) -> String {
    String::from_utf8_lossy(bytes).into_owned()
}

fn json(path: &Path) -> serde_json::Value {
    serde_json::from_str(&fs::read_to_string(path).unwrap()).unwrap()
}

#[test]
fn files_are_the_same_for_any_number_of_threads() {
    let (_keep, at) = folder();
    for threads in ["1", "3"] {
        let out = format!("out{threads}");
        let done =
            sim_host(&at, &["run", "large.toml", "--out", &out, "--nodes", "9,1,4999", "--threads", threads]);
        assert!(done.status.success(), "{}", text(&done.stderr));
        let told = text(&done.stdout);
        assert!(told.contains("left out") && told.contains("nothing is lost"), "{told}");
    }
    for name in ["quantiles.csv", "quantiles.svg", "trajectory.csv", "scenario.toml"] {
        let [a, b] = ["out1", "out3"].map(|out| fs::read_to_string(at.join(out).join(name)).unwrap());
        assert_eq!(a, b, "{name}");
    }
    // Each area has its colour in the legend as well.
    let picture = fs::read_to_string(at.join("out1/quantiles.svg")).unwrap();
    for colour in ["#7F9FBF", "#ECEFF2"] {
        assert_eq!(picture.matches(&format!("fill=\"{colour}\"")).count(), 2, "{colour}");
    }
    let [a, b] = ["out1", "out3"].map(|out| json(&at.join(out).join("summary.json")));
    assert_eq!(a["trace_hash"], b["trace_hash"]);
    assert_eq!((&a["passed"], &a["on"], &a["nodes"]), (&true.into(), &"none".into(), &5000.into()));
    assert!(a["left_out"].as_array().is_some_and(|list| !list.is_empty()));
    let trajectory = fs::read_to_string(at.join("out1/trajectory.csv")).unwrap();
    assert_eq!(
        trajectory.lines().next().unwrap(),
        "t,x_1,x_9,x_4999,nu_1,nu_9,nu_4999,psi_1,psi_9,psi_4999,u_1,u_9,u_4999"
    );
    let quantiles = fs::read_to_string(at.join("out1/quantiles.csv")).unwrap();
    let rows: Vec<Vec<f64>> = quantiles
        .lines()
        .skip(1)
        .map(|line| line.split(',').map(|value| value.parse().unwrap()).collect())
        .collect();
    // Every second tick, and the last one.
    assert_eq!((rows.len(), rows[0][0], rows[rows.len() - 1][0]), (151, 0.0, 0.3));
    assert!(rows.iter().all(|row| row[2..9].is_sorted() && row[9..12].is_sorted()));
    // Uniform draws from -2 to 2.
    assert!(
        rows[0][2] < -1.99 && rows[0][8] > 1.99 && (rows[0][3] + 1.8).abs() < 0.1 && rows[0][5].abs() < 0.1
    );
}

/// A run that ends where a node would stop has the row of that tick.
#[test]
fn the_last_row_is_that_of_the_end() {
    let (_keep, at) = folder();
    let mut arguments = vec!["run", "large.toml", "--out", "out", "--nodes", "77", "--every", "300ms"];
    let runs_away = ["node.77.dynamics.slope=900", "coupling.u_max=1"];
    let wide = "coupling.funnel={ kind = \"constant\", width = 1e6 }";
    runs_away.iter().chain([&wide]).for_each(|set| arguments.extend(["--set", set]));
    let done = sim_host(&at, &arguments);
    assert_eq!(done.status.code(), Some(1), "{}", text(&done.stderr));
    for name in ["trajectory.csv", "quantiles.csv"] {
        let rows = fs::read_to_string(at.join("out").join(name)).unwrap();
        let times: Vec<f64> =
            rows.lines().skip(1).map(|line| line.split(',').next().unwrap().parse().unwrap()).collect();
        assert!(times.len() == 2 && times[1] > 0.0 && times[1] < 0.1, "{name}: {times:?}");
    }
}

/// A page about all nodes, and about those of the columns as such.
#[test]
fn the_report_shows_the_quantiles_of_all_and_the_nodes_that_were_asked_for() {
    let (_keep, at) = folder();
    for (out, nodes, columns) in [("with", "--nodes=1,5", true), ("without", "--threads=1", false)] {
        let done = sim_host(&at, &["run", "large.toml", "--quiet", "--out", out, nodes]);
        assert!(done.status.success(), "{}", text(&done.stderr));
        let done = sim_host(&at, &["report", out]);
        assert!(done.status.success(), "{}", text(&done.stderr));
        let page = fs::read_to_string(at.join(out).join("report.html")).unwrap();
        for words in ["Quantiles over all nodes", "<svg", "median state", "Such a run leaves out: "] {
            assert!(page.contains(words), "no '{words}'");
        }
        assert_eq!(page.contains("Nodes that were asked for"), columns);
        // What the columns of a few nodes come to is not what all nodes come to.
        assert!(!page.contains("of all nodes over time") && !page.contains("No picture"));
        let last = fs::read_to_string(at.join(out).join("quantiles.csv")).unwrap();
        let highest: f64 = last.lines().last().unwrap().split(',').nth(8).unwrap().parse().unwrap();
        let shown = format!("{highest:.3}");
        assert!(page.contains(&shown[..4]), "no {shown}");
    }
    // A picture that is gone is named, and a table that is broken too.
    fs::remove_file(at.join("with/quantiles.svg")).unwrap();
    fs::write(at.join("without/quantiles.csv"), "t,x_mean\n").unwrap();
    assert!(sim_host(&at, &["report", "with"]).status.success());
    assert!(fs::read_to_string(at.join("with/report.html")).unwrap().contains("No picture: quantiles.svg"));
    let refused = sim_host(&at, &["report", "without"]);
    assert!(
        !refused.status.success() && text(&refused.stderr).contains("quantiles.csv: has no column x_q00")
    );
    // So is a folder that has the name of the table: for a report as for the run itself.
    fs::remove_file(at.join("without/quantiles.csv")).unwrap();
    fs::create_dir(at.join("without/quantiles.csv")).unwrap();
    let refused = sim_host(&at, &["report", "without"]);
    assert_eq!(refused.status.code(), Some(2));
    assert!(text(&refused.stderr).contains("quantiles.csv: is no file"), "{}", text(&refused.stderr));
    let refused = sim_host(&at, &["run", "large.toml", "--quiet", "--out", "without"]);
    assert_eq!(refused.status.code(), Some(2));
    assert!(text(&refused.stderr).contains("cannot write without/quantiles.csv: is a directory"));
}

/// As single runs give them, for any number of threads.
#[test]
fn a_sweep_has_the_figures_of_its_runs() {
    let (_keep, at) = folder();
    let sweep = |out: &str, more: &[&str]| {
        let sweep = ["sweep", "large.toml", "--grid", "graph.nodes=300,5000", "--seeds", "2", "--out", out];
        let done = sim_host(&at, &[&sweep, more].concat());
        assert!(done.status.success(), "{}", text(&done.stderr));
        let table = fs::read_to_string(at.join(out).join("runs.csv")).unwrap();
        let names: Vec<_> = table.lines().next().unwrap().split(',').map(str::to_owned).collect();
        let place = |name: &str| names.iter().position(|it| it == name).unwrap();
        let places = ["graph.nodes", "seed", "trace_hash", "funnel.max_ratio"].map(place);
        let row = |line: &str| {
            let cells: Vec<_> = line.split(',').collect();
            places.map(|at| cells[at].to_owned())
        };
        table.lines().skip(1).map(row).collect::<Vec<_>>()
    };
    let rows = sweep("alone", &["--jobs", "1"]);
    assert_eq!(rows.len(), 4);
    assert_eq!(sweep("both", &["--jobs", "2"]), rows);
    for [nodes, seed, hash, ratio] in &rows {
        let set = format!("graph.nodes={nodes}");
        let done = sim_host(&at, &["run", "large.toml", "--set", &set, "--seed", seed, "--json", "a.json"]);
        assert!(done.status.success(), "{}", text(&done.stderr));
        let summary = json(&at.join("a.json"));
        assert_eq!(summary["trace_hash"], hash.as_str());
        assert_eq!(summary["funnel"]["max_ratio"].to_string(), *ratio);
    }
}

#[test]
fn an_expectation_that_is_missed_fails_and_says_the_seed() {
    let (_keep, at) = folder();
    let done = sim_host(&at, &["run", "large.toml", "--set", "expect.max_input=1e-3", "--json", "-"]);
    assert_eq!(done.status.code(), Some(1));
    assert!(text(&done.stderr).contains("max_input") && text(&done.stderr).contains("--seed 1"));
    let summary: serde_json::Value = serde_json::from_slice(&done.stdout).unwrap();
    assert_eq!(summary["passed"], false);
}

#[test]
fn options_that_mean_nothing_are_refused() {
    let (_keep, at) = folder();
    for (arguments, words) in [
        (vec!["run", "large.toml", "--out", "out", "--nodes", "5001"], "--nodes 5001: ids are 1 to 5000"),
        (vec!["run", "large.toml", "--on", "reference"], "bus.model = \"none\""),
        (vec!["run", "large.toml", "--set", "bus.loss=0.1"], "bus.loss"),
        (vec!["run", "large.toml", "--out", "out", "--pcapng"], "--pcapng: there is no CAN bus"),
        (vec!["run", "large.toml", "--out", "out", "--no-can-log"], "--no-can-log: there is no CAN bus"),
        (vec!["run", "large.toml", "--verbose"], "--verbose: nodes report nothing"),
        (vec!["run", "large.toml", "--image", "node.elf"], "--image"),
        (
            vec![
                "run",
                "large.toml",
                "--set",
                "bus.model=ideal",
                "--set",
                "graph.nodes=20",
                "--threads",
                "2",
            ],
            "--threads",
        ),
        (vec!["export", "dbc", "large.toml", "--out", "a.dbc"], "`run`, `check` and `sweep` only"),
    ] {
        let done = sim_host(&at, &arguments);
        assert_eq!(done.status.code(), Some(2), "{arguments:?}");
        assert!(text(&done.stderr).contains(words), "{arguments:?}: {}", text(&done.stderr));
    }
}

#[test]
fn check_says_what_it_knows_and_by_name_what_it_does_not() {
    let (_keep, at) = folder();
    let status = |report: &serde_json::Value, name: &str| {
        let findings = report["findings"].as_array().unwrap();
        findings.iter().find(|finding| finding["name"] == name).unwrap_or_else(|| panic!("{name}"))["status"]
            .clone()
    };
    let check = |set: &[&str]| {
        let mut arguments = vec!["check", "large.toml", "--json"];
        set.iter().for_each(|set| arguments.extend(["--set", set]));
        let done = sim_host(&at, &arguments);
        let report: serde_json::Value = serde_json::from_slice(&done.stdout).unwrap();
        (done.status.code(), report)
    };
    let (code, report) = check(&[]);
    assert_eq!((code, status(&report, "connectivity")), (Some(0), "ok".into()));
    for name in ["emergent", "narrowest-funnel", "followed"] {
        assert_eq!(status(&report, name), "not-checked", "{name}");
    }
    let (_, ring) = check(&["graph={ kind = \"ring\", nodes = 5000 }"]);
    assert_eq!(status(&ring, "connectivity"), "not-checked");
    let (code, fast) = check(&["agent.dynamics.slope=-3000", "time.duration=1s"]);
    assert_eq!((code, status(&fast, "fields")), (Some(2), "fail".into()));
}
