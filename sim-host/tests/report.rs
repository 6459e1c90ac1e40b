//! `sim-host report`: pages to hand over, read as a browser reads them.
#![allow(clippy::unwrap_used, clippy::panic, reason = "helpers of tests, which clippy does not know as such")]

mod html;

use html::Page;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Command, Output, Stdio};
use std::time::{Duration, Instant};
use tempfile::TempDir;

/// Looks like markup in every place that is not escaped.
const HOSTILE: &str =
    "</title></style></svg></p><script>alert(1)</script><img src=x onerror=alert(2)>\"' onload=\"alert(3)";

fn sim_host(arguments: &[&str]) -> (Option<i32>, String, String) {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("..");
    let output = Command::new(env!("CARGO_BIN_EXE_sim-host")).current_dir(root).args(arguments).output();
    let Output { status, stdout, stderr } = output.unwrap();
    (status.code(), String::from_utf8(stdout).unwrap(), String::from_utf8(stderr).unwrap())
}

/// A place for folders of runs.
struct Place(TempDir);

impl Place {
    fn new() -> Self {
        Self(tempfile::tempdir().unwrap())
    }

    fn at(&self, name: &str) -> PathBuf {
        self.0.path().join(name)
    }

    fn name(&self, name: &str) -> String {
        self.at(name).display().to_string()
    }

    /// A run of half a second with other settings, in the folder `name`.
    fn run(&self, name: &str, sets: &[&str]) -> Option<i32> {
        let folder = self.name(name);
        let mut arguments =
            vec!["run", "scenarios/five-agents.toml", "-q", "--set", "time.duration=500ms", "--out", &folder];
        sets.iter().for_each(|set| arguments.extend(["--set", set]));
        sim_host(&arguments).0
    }

    /// The report of the folder `name`, which must be written.
    fn report(&self, name: &str) -> String {
        let (code, _, err) = sim_host(&["report", &self.name(name)]);
        assert_eq!((code, err.as_str()), (Some(0), ""));
        fs::read_to_string(self.at(name).join("report.html")).unwrap()
    }

    fn refused(&self, arguments: &[&str]) -> String {
        let (code, out, err) = sim_host(arguments);
        assert_eq!((code, out.as_str()), (Some(2), ""), "{err}");
        err
    }
}

/// A page without a fault.
fn page(html: &str, scripts: usize) -> Page {
    let page = Page::read(html);
    assert_eq!(page.faults(scripts), Vec::<String>::new());
    page
}

#[test]
fn a_run_is_one_page_with_its_verdict_first_and_the_same_bytes_each_time() {
    let place = Place::new();
    assert_eq!(place.run("can", &["bus.model=can"]), Some(0));
    let html = place.report("can");
    let page = page(&html, 0);
    let texts: Vec<&str> = page.elements.iter().map(|element| element.text.trim()).collect();
    let verdict = texts.iter().position(|text| text.ends_with("Passed")).unwrap();
    assert!(verdict < texts.iter().position(|text| *text == "Expectations and checks").unwrap());
    let heads: Vec<&str> = page.named("h2").map(|head| head.text.as_str()).collect();
    let expected = [
        "Expectations and checks",
        "States, funnels, inputs, agreement",
        "Nodes and margins",
        "Events",
        "Bus",
        "Counters",
        "Reference",
        "Provenance",
    ];
    assert_eq!(heads, expected);
    assert_eq!(page.named("svg").count(), 4);
    let summary: serde_json::Value =
        serde_json::from_slice(&fs::read(place.at("can").join("summary.json")).unwrap()).unwrap();
    let text = page.text();
    for part in ["trace_hash", "version", "command"] {
        assert!(text.contains(summary[part].as_str().unwrap()), "{part}");
    }
    assert!(text.contains("can0: load ") && text.contains("node 1 hears node 2"), "{text}");
    assert_eq!(place.report("can"), html, "the same folder, and now with a report in it");
    // By another name, and to standard output.
    fs::rename(place.at("can"), place.at("moved")).unwrap();
    assert_eq!(sim_host(&["report", &place.name("moved"), "--html", "-"]).1, html);
}

#[test]
fn the_reader_of_pages_finds_each_kind_of_fault() {
    let good = "<!DOCTYPE html>\n<html><body><p id=\"a\">words about the picture</p><svg role=\"img\" aria-labelledby=\"a\"></svg></body></html>";
    assert_eq!(Page::read(good).faults(0), Vec::<String>::new());
    for (from, to) in [
        ("</p>", ""),
        ("</p>", "</p></div>"),
        ("</p>", "</p><script>alert(1)</script>"),
        ("</p>", "</p><img src=\"a.png\">"),
        ("<p id", "<p onclick=\"a()\" id"),
        ("</p>", "</p><style>p { background: url(a.png) }</style>"),
        ("</p>", "</p><table></table>"),
        (" about the picture", ""),
        ("labelledby=\"a\"", "labelledby=\"b\""),
        ("</p>", "</p><i id=\"a\"></i>"),
        ("words", "wo<rds"),
    ] {
        assert!(!Page::read(&good.replace(from, to)).faults(0).is_empty(), "{from} -> {to}");
    }
}

#[test]
fn nothing_that_comes_from_a_file_is_markup() {
    let place = Place::new();
    let toml = serde_json::to_string(HOSTILE).unwrap();
    assert_eq!(place.run("a", &[&format!("title={toml}")]), Some(0));
    let folder = place.at("a");
    let append = |name: &str, text: &str| {
        let before = fs::read_to_string(folder.join(name)).unwrap();
        fs::write(folder.join(name), before + text).unwrap();
    };
    append("events.txt", &format!("0.1 s, node 1 {HOSTILE}\n{HOSTILE}\n# {HOSTILE}\n"));
    append("scenario.toml", &format!("# {HOSTILE}\n"));
    // Every text of the summary, and every key.
    let summary: serde_json::Value =
        serde_json::from_slice(&fs::read(folder.join("summary.json")).unwrap()).unwrap();
    fs::write(folder.join("summary.json"), hostile(&summary).to_string()).unwrap();
    let svg = fs::read_to_string(folder.join("states.svg")).unwrap();
    fs::write(folder.join("states.svg"), svg.replace("</svg>", "<script>alert(1)</script></svg>")).unwrap();

    let html = place.report("a");
    let read = page(&html, 0);
    assert!(read.text().matches(HOSTILE).count() > 5, "{}", read.text());
    assert_eq!(read.named("svg").count(), 3, "a picture that runs something is left out");
    assert!(read.text().contains("No picture: states.svg"), "{}", read.text());
    // The broken world: any one of them not escaped, and the reader of this test sees it.
    let escaped =
        HOSTILE.replace('&', "&amp;").replace('<', "&lt;").replace('>', "&gt;").replace('"', "&quot;");
    let places: Vec<usize> = html.match_indices(&escaped).map(|(at, _)| at).collect();
    assert!(places.len() > 5);
    for at in places {
        let mut broken = html.clone();
        broken.replace_range(at..at + escaped.len(), HOSTILE);
        assert!(!Page::read(&broken).faults(0).is_empty(), "not escaped at byte {at}, and nobody sees it");
    }
}

/// The same with every text and every key hostile, but for names that the page asks for.
fn hostile(value: &serde_json::Value) -> serde_json::Value {
    match value {
        serde_json::Value::String(_) => HOSTILE.into(),
        serde_json::Value::Array(list) => list.iter().map(hostile).collect(),
        serde_json::Value::Object(map) => {
            let entries = map.iter().map(|(key, value)| (key.clone(), hostile(value)));
            let more = map.contains_key("cobs").then(|| (HOSTILE.to_owned(), 1.into()));
            entries.chain(more).collect()
        }
        other => other.clone(),
    }
}

#[test]
fn a_run_that_failed_or_was_interrupted_says_so() {
    let place = Place::new();
    assert_eq!(place.run("failed", &["expect.funnel_ratio=0.1"]), Some(1));
    let text = page(&place.report("failed"), 0).text();
    assert!(text.contains("Failed") && text.contains("One expectation or check does not hold."), "{text}");
    assert!(!text.contains("Passed"), "{text}");

    // Without a reference, which would be computed first.
    let text = "version = 1\ntime = { tick = '1ms', duration = '10min' }\ngraph = { kind = 'ring', nodes = 5 }\nbus = { model = 'can' }\n\
                coupling = { kind = 'node-wise', gain = { kind = 'reciprocal', scale = 1.0 }, funnel = { kind = 'constant', width = 2.0 } }\n\
                agent = { dynamics = { kind = 'affine', slope = -1.0, offset = 1.0 } }\n";
    fs::write(place.at("long.toml"), text).unwrap();
    let child = Command::new("env")
        .args(["--default-signal=INT", env!("CARGO_BIN_EXE_sim-host"), "run", &place.name("long.toml")])
        .args(["-q", "--every", "1ms", "--out", &place.name("early")])
        .stdin(Stdio::null())
        .spawn();
    let mut child = child.unwrap();
    // Some of it is on the disk, under its temporary name.
    let is_long = |entry: &fs::DirEntry| {
        entry.file_name().to_string_lossy().contains("can.log")
            && entry.metadata().is_ok_and(|it| it.len() > 50_000)
    };
    let begin = Instant::now();
    while !fs::read_dir(place.at("early")).is_ok_and(|entries| entries.flatten().any(|entry| is_long(&entry)))
    {
        assert!(begin.elapsed() < Duration::from_secs(120), "nothing is written");
        std::thread::sleep(Duration::from_millis(20));
    }
    let waiting = place.refused(&["report", &place.name("early")]);
    assert!(waiting.contains("a run is writing into this folder"), "{waiting}");
    assert!(Command::new("kill").args(["-INT", &child.id().to_string()]).status().unwrap().success());
    assert_eq!(child.wait().unwrap().code(), Some(130));
    let text = page(&place.report("early"), 0).text();
    assert!(text.contains("Ended early") && text.contains("did not come to its last tick"), "{text}");

    // Killed while it gave the files their names: the summary comes last.
    fs::remove_file(place.at("failed").join("summary.json")).unwrap();
    let text = page(&place.report("failed"), 0).text();
    assert!(text.contains("Not finished") && text.contains("States from 0 to 0.5 s"), "{text}");
}

#[test]
fn what_is_no_run_is_refused_and_no_file_of_others_is_replaced() {
    let place = Place::new();
    fs::create_dir(place.at("empty")).unwrap();
    let message = place.refused(&["report", &place.name("empty")]);
    assert!(
        message.contains("is no folder of a run or of a sweep: it has neither summary.json"),
        "{message}"
    );
    assert!(place.refused(&["report", "scenarios/five-agents.toml"]).contains("is no folder"));
    assert!(place.refused(&["report", &place.name("none")]).contains("cannot be read"));
    for (file, text, why) in [
        ("summary.json", "[1]", "summary.json: is no summary: it is no object"),
        ("summary.json", "{", "summary.json: is no summary"),
        ("trajectory.csv", "a,b\n1,2\n", "trajectory.csv: is no trajectory"),
    ] {
        fs::write(place.at("empty").join(file), text).unwrap();
        let message = place.refused(&["report", &place.name("empty")]);
        assert!(message.contains(why), "{message}");
        fs::remove_file(place.at("empty").join(file)).unwrap();
    }

    assert_eq!(place.run("a", &[]), Some(0));
    let mine = place.at("a").join("report.html");
    fs::write(&mine, "<html>mine</html>").unwrap();
    let message = place.refused(&["report", &place.name("a")]);
    assert!(message.contains("would be replaced by the report"), "{message}");
    assert_eq!(fs::read_to_string(&mine).unwrap(), "<html>mine</html>");
    let message = place.refused(&[
        "report",
        &place.name("a"),
        "--html",
        &place.at("a").join("states.svg").display().to_string(),
    ]);
    assert!(message.contains("states.svg would be replaced"), "{message}");
    // A run leaves it alone, and takes a report of its own away with the figures that it was of.
    assert_eq!(place.run("a", &[]), Some(0));
    assert_eq!(fs::read_to_string(&mine).unwrap(), "<html>mine</html>");
    fs::remove_file(&mine).unwrap();
    place.report("a");
    assert_eq!(place.run("a", &[]), Some(0));
    assert!(!mine.exists());
}

#[test]
fn two_runs_are_one_page_that_says_where_they_differ() {
    let place = Place::new();
    for (name, set) in [("a", "seed=1"), ("again", "seed=1"), ("b", "node.2.state=1")] {
        assert_eq!(place.run(name, &[set]), Some(0));
    }
    let compared = |other: &str| {
        let (code, out, err) = sim_host(&["report", &place.name("a"), &place.name(other), "--html", "-"]);
        assert_eq!((code, err.as_str()), (Some(0), ""));
        page(&out, 0)
    };
    let text = compared("again").text();
    assert!(text.contains("= Equal") || text.contains("Equal"), "{text}");
    assert!(text.contains("no column differs") && !text.contains("Different"), "{text}");
    let differs = compared("b");
    let text = differs.text();
    assert!(text.contains("t = 0 s (row 0): x_2 = -2 in A, 1 in B"), "{text}");
    assert_eq!(differs.named("svg").count(), 1);
    let message = place.refused(&["report", &place.name("a"), &place.name("b")]);
    assert!(message.contains("--html"), "{message}");
}

const HEAD: &str =
    "run,bus.loss,graph.kind,repetition,seed,funnel.max_ratio,max_input,verdict,why,wall_s,cpu_s\n";

/// Rows of a sweep over two parameters, by their numbers; one in five fails.
fn rows(which: impl Fn(u32) -> bool) -> String {
    let row = |n: u32| {
        let (loss, kind, seed) =
            (f64::from(n / 6) / 10.0, if n.is_multiple_of(2) { "ring" } else { "star" }, n % 3 + 1);
        let verdict = if n % 5 == 4 { "failed,\"funnel_ratio, <b>1.2</b>\"" } else { "passed," };
        format!(
            "{},{loss},{kind},{seed},{seed},{},{},{verdict},0.1,0.1\n",
            n + 1,
            0.1 + f64::from(n) / 50.0,
            n * n
        )
    };
    (0..24).filter(|n| which(*n)).map(row).collect()
}

#[test]
fn a_sweep_shows_its_failures_first_and_its_shards_become_one_table() {
    let place = Place::new();
    fs::create_dir(place.at("whole")).unwrap();
    fs::write(place.at("whole").join("runs.csv"), format!("{HEAD}{}", rows(|_| true))).unwrap();
    let html = place.report("whole");
    let read = page(&html, 1);
    let text = read.text();
    assert!(text.contains("4 failed") && text.contains("funnel_ratio, <b>1.2</b>"), "{text}");
    let heads: Vec<&str> = read.named("h2").map(|head| head.text.as_str()).collect();
    assert_eq!(heads[0], "Runs that did not pass");
    let maps = read.named("table").filter(|table| table.attribute("class") == Some("map")).count();
    assert_eq!(maps, 3, "the share of runs that pass, and two figures");

    fs::create_dir(place.at("shards")).unwrap();
    for i in [3, 1] {
        let name = format!("runs-{i}-of-3.csv");
        fs::write(place.at("shards").join(name), format!("{HEAD}{}", rows(|n| n % 3 == i - 1))).unwrap();
    }
    let partly = page(&place.report("shards"), 1).text();
    assert!(partly.contains("Shards 2 are not there."), "{partly}");
    assert!(!place.at("shards").join("runs.csv").exists(), "a part is no table of the sweep");
    fs::write(place.at("shards").join("runs-2-of-3.csv"), format!("{HEAD}{}", rows(|n| n % 3 == 1))).unwrap();
    assert_eq!(place.report("shards"), html);
    let merged = fs::read_to_string(place.at("shards").join("runs.csv")).unwrap();
    assert_eq!(merged, format!("{HEAD}{}", rows(|_| true)));
}

#[test]
fn a_sweep_over_one_parameter_has_lines_and_one_over_seeds_has_none() {
    let place = Place::new();
    for (name, swept) in [("one", "0.1 0.2 0.3"), ("seeds", "0.1 0.1 0.1")] {
        fs::create_dir(place.at(name)).unwrap();
        let row = |(n, loss)| format!("{n},{loss},1,{n},{},passed,,1,1\n", 2 * n);
        let rows: String = swept.split(' ').enumerate().map(row).collect();
        let head = "run,bus.loss,repetition,seed,max_input,verdict,why,wall_s,cpu_s\n";
        fs::write(place.at(name).join("runs.csv"), format!("{head}{rows}")).unwrap();
        let pictures = page(&place.report(name), 1).named("svg").count();
        assert_eq!(pictures, if name == "one" { 2 } else { 0 }, "{name}");
    }
}

/// As `--sobol` and `--lhs` draw them: no value twice.
#[test]
fn a_sweep_of_thousands_of_drawn_points_has_maps_of_ranges() {
    let place = Place::new();
    fs::create_dir(place.at("drawn")).unwrap();
    let row = |n: u64| {
        let (a, b) = (n * 7919 % 10_007, n * 104_729 % 10_007);
        format!("{n},0.{a:05},0.{b:05},1,1,{},passed,,1,1\n", a + b)
    };
    let rows: String = (1..=6000).map(row).collect();
    let head = "run,bus.loss,coupling.funnel.rate,repetition,seed,max_input,verdict,why,wall_s,cpu_s\n";
    fs::write(place.at("drawn").join("runs.csv"), format!("{head}{rows}")).unwrap();
    let read = page(&place.report("drawn"), 1);
    assert!(!read.text().contains("too large"));
    let maps: Vec<_> = read.named("table").filter(|table| table.attribute("class") == Some("map")).collect();
    assert_eq!(maps.len(), 2);
    assert!(read.text().contains("The first 5000 of 6000 runs"));
    assert_eq!(
        read.elements
            .iter()
            .filter(|cell| cell.attribute("class").is_some_and(|c| c.contains("shade-")))
            .count(),
        200
    );
}

/// A row every 30 ms, and noise, which is the most that pictures can have.
#[test]
fn a_run_of_127_nodes_over_a_minute_is_a_page_of_5_mb_at_most() {
    let place = Place::new();
    let scenario = "version = 1\ntime = { tick = \"10ms\", duration = \"60s\" }\n\
        graph = { kind = \"ring-lattice\", nodes = 127, degree = 4 }\n\
        coupling = { kind = \"node-wise\", gain = { kind = \"reciprocal\", scale = 1.0 }, funnel = { kind = \"constant\", width = 30.0 } }\n\
        agent = { dynamics = { kind = \"affine\", slope = -1.0, offset = 1.0 }, noise = 1.0 }\n";
    fs::write(place.at("a.toml"), scenario).unwrap();
    let (code, _, err) = sim_host(&["run", &place.name("a.toml"), "-q", "--out", &place.name("a")]);
    assert!(code.is_some_and(|code| code < 2), "{err}");
    let html = place.report("a");
    println!("{} bytes", html.len());
    assert!(html.len() <= 5_000_000, "{} bytes", html.len());
    assert_eq!(page(&html, 0).named("svg").count(), 4);
}
