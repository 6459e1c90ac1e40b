//! `sim-host export`, read by the libraries of other makers: cantools and networkx, which `./ci.sh setup` installs.
#![allow(clippy::unwrap_used, clippy::panic, reason = "helpers of tests, which clippy does not know as such")]

use funnelnet_protocol::{Command as Order, FaultCode, Message, NodeId, Severity, Target, TickStamp, can};
use serde_json::{Value, json};
use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Command, Output, Stdio};
use tempfile::TempDir;

const FIVE: &str = "scenarios/five-agents.toml";
const VECTORS: &str = "scenarios/vector-oscillators.toml";
/// Not judged: the ends of runs that are short.
const SHORT: [&str; 6] =
    ["--set", "time.duration=300ms", "--set", "expect={ funnel_ratio = 1e9 }", "--every", "1ms"];

fn repository() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("..")
}

/// Exit code, standard output, standard error.
fn said(command: &mut Command) -> (Option<i32>, String, String) {
    let Output { status, stdout, stderr } = command.stdin(Stdio::null()).output().unwrap();
    let text = |bytes: Vec<u8>| String::from_utf8_lossy(&bytes).into_owned();
    (status.code(), text(stdout), text(stderr))
}

fn sim_host(arguments: &[&str]) -> (Option<i32>, String, String) {
    said(Command::new(env!("CARGO_BIN_EXE_sim-host")).current_dir(repository()).args(arguments))
}

/// Python with the readers, or none, said aloud.
fn python() -> Option<PathBuf> {
    let python = repository().join("target/readers/bin/python");
    let has_readers = python.exists()
        && said(Command::new(&python).args(["-c", "import cantools, mcap, networkx"])).0 == Some(0);
    if !has_readers {
        eprintln!(
            "SKIPPED: no cantools, mcap and networkx in target/readers; ./ci.sh setup installs them where PyPI can be reached"
        );
    }
    has_readers.then_some(python)
}

fn read_by(python: &Path, script: &str, arguments: &[&str]) -> (Option<i32>, String, String) {
    said(Command::new(python).arg(repository().join("tests/readers").join(script)).args(arguments))
}

struct Place(TempDir);

impl Place {
    fn new() -> Self {
        Self(tempfile::tempdir().unwrap())
    }

    fn at(&self, name: &str) -> PathBuf {
        self.0.path().join(name)
    }

    fn name(&self, name: &str) -> String {
        self.at(name).to_str().unwrap().to_owned()
    }

    /// Exports, and expects nothing to be said.
    fn export(&self, what: &str, scenario: &str, to: &str, sets: &[&str]) {
        let to = self.name(to);
        let (code, out, err) = sim_host(&[&["export", what, scenario, "--out", &to], sets].concat());
        assert_eq!((code, out.as_str(), err.as_str()), (Some(0), "", ""));
    }

    /// A short run on a bus, with a row for each tick, and its DBC file.
    fn run(&self, scenario: &str, sets: &[&str]) {
        self.export("dbc", scenario, "five.dbc", sets);
        let out = self.name("out");
        let (code, _, err) =
            sim_host(&[&["run", scenario, "--quiet", "--out", &out], &SHORT[..], sets].concat());
        assert_eq!(code, Some(0), "{err}");
    }

    fn decode(&self, python: &Path) -> (Option<i32>, String, String) {
        let names = ["five.dbc", "out/can.log", "out/trajectory.csv"].map(|name| self.name(name));
        read_by(python, "dbc.py", &[&names[0], &names[1], &names[2], "1000000"])
    }

    fn change(&self, name: &str, change: impl FnOnce(String) -> String) {
        let text = fs::read_to_string(self.at(name)).unwrap();
        let changed = change(text.clone());
        assert_ne!(text, changed, "{name}");
        fs::write(self.at(name), changed).unwrap();
    }
}

/// One state of each component and node in each of 300 ticks and at the end, and the announced ones.
#[test]
fn cantools_decodes_a_log_to_the_bits_of_the_trajectory() {
    let Some(python) = python() else { return };
    for (scenario, bus, states) in [
        (FIVE, "bus.model=can", 5),
        (FIVE, "bus.model=can-fd", 5),
        (VECTORS, "bus.model=can", 10),
        (VECTORS, "bus.model=can-fd", 10),
    ] {
        let place = Place::new();
        place.run(scenario, &["--set", bus, "--set", "agent.unit=°C"]);
        let (code, out, err) = place.decode(&python);
        assert_eq!(code, Some(0), "{scenario} {bus}: {err}");
        let told: Value = serde_json::from_str(&out).unwrap();
        assert!(told["compared"].as_u64().unwrap() >= 299 * states, "{scenario} {bus}: {told}");
        assert_eq!(told["units"], json!(["°C"]));
        assert!(told["kinds"]["EDGE"].as_u64().unwrap() > 0, "{told}");
        assert!(told["edges"].as_object().unwrap().values().all(|alpha| *alpha == 1.0), "{told}");
    }
}

/// Frames that a run of its own does not have, as the encoder of the wire writes them.
#[test]
fn cantools_reads_commands_sync_faults_and_edges_as_they_are_encoded() {
    let Some(python) = python() else { return };
    let place = Place::new();
    let clocks = ["--set", "bus.model=can", "--set", "clock.drift_ppm=10", "--set", "sync.masters=[2]"];
    place.export("dbc", FIVE, "five.dbc", &clocks);
    let node = |id| NodeId::new(id).unwrap();
    let (tick, code) = (TickStamp::full(0xABCDEF), FaultCode::HOLDOVER);
    let ctrl = |target, command| Message::Ctrl { target, command, arg: 7, at_tick: 0xABCD };
    let sync = |source| Message::Sync { source, previous_tick: tick, phase_us: 1234 };
    let messages = [
        (
            ctrl(Target::All, Order::Start),
            json!({ "name": "CTRL_all", "from": "Host", "cmd": "start", "arg": 7, "at_tick": 0xABCD }),
        ),
        (
            ctrl(Target::Node(node(4)), Order::Commit),
            json!({ "name": "CTRL_4", "from": "Host", "cmd": "commit", "arg": 7, "at_tick": 0xABCD }),
        ),
        (sync(None), json!({ "name": "SYNC_host", "from": "Host", "tick": 0xABCDEF, "phase": 1234 })),
        (sync(Some(node(2))), json!({ "name": "SYNC_2", "from": "Node2", "tick": 0xABCDEF, "phase": 1234 })),
        (
            Message::Fault { source: node(3), code, severity: Severity::Stopped, arg: 515, tick },
            json!({ "name": "FAULT_3", "from": "Node3", "code": code.to_string(), "severity": "stopped", "arg": 515, "tick": 0xEF }),
        ),
        (
            Message::Edge { source: node(5), neighbour: node(1), weight: 0.75 },
            json!({ "name": "EDGE_5", "from": "Node5", "other": 1, "alpha": 0.75 }),
        ),
    ];
    let frames = messages.iter().map(|(message, _)| {
        let frame = can::encode(message);
        let data: String = frame.data().iter().map(|byte| format!("{byte:02X}")).collect();
        format!("{:03X}#{data}", frame.id())
    });
    let arguments: Vec<String> = std::iter::once(place.name("five.dbc")).chain(frames).collect();
    let (code, out, err) =
        read_by(&python, "frames.py", &arguments.iter().map(String::as_str).collect::<Vec<_>>());
    assert_eq!(code, Some(0), "{err}");
    let read: Vec<Value> = out.lines().map(|line| serde_json::from_str(line).unwrap()).collect();
    let expected: Vec<_> = messages.into_iter().map(|(_, expected)| expected).collect();
    assert_eq!(read, expected);
}

/// What the comparison with the trajectory is worth: each of these is found.
#[test]
fn a_wrong_bit_a_wrong_type_and_a_missing_frame_are_found() {
    let Some(python) = python() else { return };
    let place = Place::new();
    place.run(FIVE, &["--set", "bus.model=can"]);
    assert_eq!(place.decode(&python).0, Some(0));
    let broken = |name: &str, change: &dyn Fn(String) -> String, message: &str| {
        let sound = fs::read(place.at(name)).unwrap();
        place.change(name, change);
        let (code, out, err) = place.decode(&python);
        assert_eq!((code, out.as_str()), (Some(1), ""));
        assert!(err.contains(message), "{err}");
        fs::write(place.at(name), sound).unwrap();
    };
    // The last state of node 3, its lowest bit.
    let flip = |log: String| {
        let at = log.rfind(" 183#").unwrap() + " 183#".len();
        let byte = u8::from_str_radix(&log[at..at + 2], 16).unwrap() ^ 1;
        format!("{}{byte:02X}{}", &log[..at], &log[at + 2..])
    };
    broken("out/can.log", &flip, "x_3: ");
    broken("five.dbc", &|dbc| dbc.replace("SIG_VALTYPE_ 387 x_3 : 1;\n", ""), "x_3: ");
    broken("five.dbc", &|dbc| dbc.replace("BO_ 387 STATE_3:", "BO_ 1387 STATE_3:"), "387");
    broken("five.dbc", &|dbc| dbc.replace("x_3 : 0|32@1-", "x_3 : 0|32@0-"), "");
}

/// Weights that are not short, so that a lost digit is seen.
const WEIGHTS: &str = "graph={kind=\"edges\",nodes=5,weight=0.1,edges=[[1,2,0.30000000000000004],[3,2,1e-3],[3,4],[5,4,2],[1,5,1.2345678901234567]]}";

#[test]
fn networkx_reads_the_edges_and_weights_and_writes_what_a_scenario_reads() {
    let Some(python) = python() else { return };
    let place = Place::new();
    place.export("graphml", FIVE, "a.graphml", &["--set", WEIGHTS]);
    let (code, out, err) =
        read_by(&python, "graphml.py", &[&place.name("a.graphml"), &place.name("of-networkx.graphml")]);
    assert_eq!(code, Some(0), "{err}");
    let told: Value = serde_json::from_str(&out).unwrap();
    let edges = json!([
        [1, 2, 0.300_000_000_000_000_04],
        [1, 5, 1.234_567_890_123_456_7],
        [2, 3, 1e-3],
        [3, 4, 0.1],
        [4, 5, 2.0]
    ]);
    assert_eq!(told, json!({ "directed": false, "nodes": [1, 2, 3, 4, 5], "edges": edges }));
    for file in ["a.graphml", "of-networkx.graphml"] {
        let graph = format!("graph={{kind=\"file\",file=\"{}\"}}", place.name(file));
        place.export("graphml", FIVE, "again.graphml", &["--set", &graph]);
        assert_eq!(
            fs::read(place.at("again.graphml")).unwrap(),
            fs::read(place.at("a.graphml")).unwrap(),
            "{file}"
        );
    }
}

/// The folder of the run has the graph, so that it is repeated when the file is gone.
#[test]
fn a_run_with_a_graph_in_a_file_has_the_bits_of_the_listed_one_and_is_repeated_from_its_folder() {
    let place = Place::new();
    let hash = |scenario: &str, sets: &[&str], out: &str| {
        let out = place.name(out);
        let arguments = [&["run", scenario, "--quiet", "--out", &out], &SHORT[..], sets].concat();
        let (code, _, err) = sim_host(&arguments);
        assert_eq!(code, Some(0), "{err}");
        let summary = fs::read_to_string(Path::new(&out).join("summary.json")).unwrap();
        serde_json::from_str::<Value>(&summary).unwrap()["trace_hash"].clone()
    };
    let listed = "graph={kind=\"edges\",nodes=5,weight=0.7,edges=[[1,2,0.5],[2,3],[3,4],[4,5],[5,1,1.25]]}";
    fs::write(place.at("g.csv"), "from,to,weight\n5,1,1.25\n1,2,0.5\n2,3,\n4,3,\n4,5,0.7\n").unwrap();
    let graph = format!("graph={{kind=\"file\",weight=0.7,file=\"{}\"}}", place.name("g.csv"));
    let expected = hash(FIVE, &["--set", listed], "listed");
    assert_eq!(hash(FIVE, &["--set", &graph], "out"), expected);
    assert_ne!(hash(FIVE, &[], "ring"), expected);
    fs::remove_file(place.at("g.csv")).unwrap();
    assert_eq!(hash(&place.name("out/scenario.toml"), &[], "again"), expected);
    assert!(place.at("again/scenario-graph.csv").exists());
    // A run without one leaves none.
    hash(FIVE, &[], "out");
    assert!(!place.at("out/scenario-graph.csv").exists());
}

/// The copy has edges alone, and this graph has none.
#[test]
fn a_network_of_one_node_is_repeated_from_its_folder() {
    let place = Place::new();
    let graph = "<graphml>\n<graph edgedefault=\"undirected\">\n<node id=\"1\"/></graph></graphml>";
    fs::write(place.at("one.graphml"), graph).unwrap();
    let scenario = "version = 1\ntime = { tick = \"1ms\", duration = \"50ms\" }\ngraph.file = \"one.graphml\"\n\
                    coupling = { kind = \"node-wise\", gain = { kind = \"reciprocal\", scale = 1.0 }, funnel = { kind = \"constant\", width = 1.0 } }\n\
                    agent.dynamics = { kind = \"affine\", slope = -1.0, offset = 0.5 }\n";
    fs::write(place.at("one.toml"), scenario).unwrap();
    let hash = |scenario: &str, out: &str| {
        let (code, _, err) = sim_host(&["run", &place.name(scenario), "--quiet", "--out", &place.name(out)]);
        // Without an edge no term is known, which fails.
        assert_eq!(code, Some(1), "{err}");
        let summary = fs::read_to_string(place.at(out).join("summary.json")).unwrap();
        serde_json::from_str::<Value>(&summary).unwrap()["trace_hash"].clone()
    };
    let expected = hash("one.toml", "out");
    fs::remove_file(place.at("one.graphml")).unwrap();
    assert_eq!(hash("out/scenario.toml", "again"), expected);
    let kept = |folder: &str| fs::read_to_string(place.at(folder).join("scenario.toml")).unwrap();
    assert!(kept("out").contains("nodes = 1"), "{}", kept("out"));
}

#[test]
fn a_graph_that_is_wrong_is_refused_with_file_line_and_value() {
    let place = Place::new();
    let refused = |name: &str, text: &str, more: &str, message: &str| {
        fs::write(place.at(name), text).unwrap();
        let graph = format!("graph={{kind=\"file\",file=\"{}\"{more}}}", place.name(name));
        let (code, out, err) = sim_host(&["check", FIVE, "--set", &graph]);
        assert_eq!((code, out.as_str()), (Some(2), ""), "{err}");
        let err = err.replace(&place.name(name), "F");
        assert!(err.contains("graph") && err.contains(message), "{err}");
    };
    let head = "from,to,weight\n";
    refused("a.csv", &format!("{head}1,2,1\n2,x,1\n"), "", "F, line 3: 'x' must be an id");
    refused("a.csv", &format!("{head}1,2,0\n"), "", "F, line 2: weight '0' must be > 0 (edge weight)");
    refused(
        "a.csv",
        &format!("{head}1,2,1\n4,5,1\n"),
        "",
        "must be connected (Assumption 1), but it falls into 3 parts",
    );
    refused(
        "a.csv",
        &format!("{head}1,2,1\n2,3,1\n3,4,1\n4,5,1\n5,6,1\n"),
        ",nodes=5",
        "F, line 6: '6' must be an id from 1 to 5",
    );
    refused("a.csv", &format!("{head}1,2001,1\n"), "", "must have 2000 nodes at most");
    refused("a.csv", head, "", "names no node; graph.nodes must say how many there are");
    refused("a.csv", head, ",nodes=5", "must be connected (Assumption 1), but it falls into 5 parts");
    refused("a.csv", "from,from,to\n1,2,3\n", "", "F, line 1: has the column 'from' more than once");
    refused(
        "a.graphml",
        "<graphml>\n<graph edgedefault=\"directed\">\n<edge source=\"1\" target=\"2\"/></graph></graphml>",
        "",
        "F, line 3: the edge from 1 to 2 is directed",
    );
    refused("a.xml", "<graphml>\n<graph></graphml>", "", "F, line 2: not valid XML");
    let (_, _, err) = sim_host(&["check", FIVE, "--set", "graph={kind=\"file\",file=\"none.csv\"}"]);
    assert!(err.contains("none.csv: cannot be read"), "{err}");
    let (_, _, err) = sim_host(&["check", FIVE, "--set", "graph={kind=\"file\"}"]);
    assert!(err.contains("missing key 'file' in [graph] of kind 'file'"), "{err}");
}

#[test]
fn what_cannot_be_exported_is_refused() {
    let (code, out, err) = sim_host(&["export", "dbc", FIVE, "--set", "bus.model=uart"]);
    assert_eq!((code, out.as_str()), (Some(2), ""));
    assert!(err.contains("bus.model = \"uart\": no frame of it is on CAN"), "{err}");
    let (code, _, err) = sim_host(&["export", "dbc", "no/such.toml"]);
    assert_eq!(code, Some(2));
    assert!(err.starts_with("no/such.toml: cannot be read: "), "{err}");
    assert_eq!(sim_host(&["export", "xml", FIVE]).0, Some(2));
}

#[test]
fn an_export_never_overwrites_its_scenario_and_goes_to_standard_output_by_itself() {
    let place = Place::new();
    let text = fs::read(repository().join(FIVE)).unwrap();
    fs::write(place.at("five.toml"), &text).unwrap();
    std::os::unix::fs::symlink("five.toml", place.at("link")).unwrap();
    for out in ["five.toml", "./five.toml", "link"] {
        let (code, _, err) =
            sim_host(&["export", "dbc", &place.name("five.toml"), "--out", &place.name(out)]);
        assert_eq!(code, Some(2));
        assert!(err.contains("which must not be overwritten"), "{err}");
        assert_eq!(fs::read(place.at("five.toml")).unwrap(), text);
    }
    place.export("dbc", FIVE, "five.dbc", &[]);
    let written = fs::read_to_string(place.at("five.dbc")).unwrap();
    for more in [&[][..], &["--out", "-"]] {
        let (code, out, _) = sim_host(&[&["export", "dbc", FIVE], more].concat());
        assert_eq!((code, out), (Some(0), written.clone()));
    }
    assert!(written.contains("BO_ 389 STATE_5: 5 Node5\n SG_ x_5 : 0|32@1- (1,0) [0|0] \"\" Vector__XXX\n"));
}

/// What a scenario reads is no place for an output: of a run, of a sweep, or of an export.
#[test]
fn no_output_takes_the_place_of_a_file_that_the_scenario_reads() {
    let folder = tempfile::tempdir().unwrap();
    let at = folder.path();
    fs::create_dir(at.join("o")).unwrap();
    let scenario = |graph: &str| {
        format!(
            "version = 1\ntime = {{ tick = \"1ms\", duration = \"5ms\" }}\n[graph]\nfile = \"{graph}\"\n[coupling]\nkind = \"node-wise\"\n\
             gain = {{ kind = \"reciprocal\" }}\nfunnel = {{ kind = \"constant\", width = 9.0 }}\n[agent]\n\
             dynamics = {{ kind = \"affine\", slope = -1.0 }}\n"
        )
    };
    let edges = "from,to\n1,2\n2,3\n";
    for (graph, command) in [
        ("o/scenario-graph.csv", &["run", "s.toml", "--out", "o"][..]),
        ("o/trajectory.csv", &["run", "s.toml", "--out", "o"]),
        ("g.csv", &["run", "s.toml", "--json", "g.csv"]),
        ("g.csv", &["run", "s.toml", "--junit", "./o/../g.csv"]),
        ("o/scenario-graph.csv", &["sweep", "s.toml", "--seeds", "2", "--out", "o"]),
        ("g.csv", &["export", "graphml", "s.toml", "--out", "g.csv"]),
    ] {
        fs::write(at.join(graph), edges).unwrap();
        fs::write(at.join("s.toml"), scenario(graph)).unwrap();
        let done =
            Command::new(env!("CARGO_BIN_EXE_sim-host")).current_dir(at).args(command).output().unwrap();
        let said = String::from_utf8(done.stderr).unwrap();
        assert_eq!(done.status.code(), Some(2), "{command:?}: {said}");
        assert!(said.contains(graph), "{command:?}: {said}");
        assert_eq!(fs::read_to_string(at.join(graph)).unwrap(), edges, "{command:?}");
        fs::remove_file(at.join(graph)).unwrap();
    }
}

/// A pipe can be read once: who looks for names in it takes the scenario away.
#[test]
fn a_scenario_in_a_pipe_is_read_by_who_runs_it() {
    let folder = tempfile::tempdir().unwrap();
    let scenario = Path::new(env!("CARGO_MANIFEST_DIR")).join("../scenarios/five-agents.toml");
    let script = format!(
        "'{}' run <(cat '{}') --quiet --out o --set time.duration=20ms",
        env!("CARGO_BIN_EXE_sim-host"),
        scenario.display()
    );
    let done = Command::new("bash").args(["-c", &script]).current_dir(folder.path()).output().unwrap();
    assert!(
        done.status.code() == Some(0) || done.status.code() == Some(1),
        "{}",
        String::from_utf8_lossy(&done.stderr)
    );
    assert!(folder.path().join("o/summary.json").is_file(), "{}", String::from_utf8_lossy(&done.stderr));
}
