//! `can.log`, `can.pcapng`, the table of a CAN bus, and `sim-host replay`, end to end.
#![cfg(target_os = "linux")]
#![allow(clippy::unwrap_used, clippy::panic, reason = "helpers of tests, which clippy does not know as such")]

use funnelnet_can_bus::{BitRate, Frame, Id, Length, Timing};
use serde_json::Value;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Command, Output, Stdio};
use std::time::{Duration, Instant};
use tempfile::TempDir;

const FIVE: &str = "scenarios/five-agents.toml";
/// Not judged: the ends of runs that are short, on a bus that is full, or noisy.
const UNJUDGED: [&str; 4] = ["--set", "expect.reference_error=1e9", "--set", "expect.funnel_ratio=1e9"];

fn sim_host(arguments: &[&str]) -> Command {
    let mut command = Command::new(env!("CARGO_BIN_EXE_sim-host"));
    command
        .current_dir(Path::new(env!("CARGO_MANIFEST_DIR")).join(".."))
        .args(arguments)
        .stdin(Stdio::null())
        .stdout(Stdio::piped())
        .stderr(Stdio::piped());
    command
}

/// Exit code, and all that was said.
fn said(output: Output) -> (Option<i32>, String) {
    let text = |bytes| String::from_utf8(bytes).unwrap();
    (output.status.code(), text(output.stdout) + &text(output.stderr))
}

/// A run on CAN with its folder.
struct Run {
    folder: TempDir,
    said: String,
}

impl Run {
    fn new(scenario: &str, sets: &[&str], more: &[&str]) -> Self {
        let folder = tempfile::tempdir().unwrap();
        let out = folder.path().to_str().unwrap();
        let sets = sets.iter().flat_map(|set| ["--set", set]);
        let mut arguments = vec!["run", scenario, "--out", out, "--set", "bus.model=can"];
        arguments.extend(sets);
        arguments.extend(more);
        let (code, said) = said(sim_host(&arguments).output().unwrap());
        assert!(code == Some(0) || code == Some(1), "{code:?} {said}");
        Self { folder, said }
    }

    fn path(&self, name: &str) -> PathBuf {
        self.folder.path().join(name)
    }

    fn text(&self, name: &str) -> String {
        fs::read_to_string(self.path(name)).unwrap()
    }

    fn summary(&self) -> Value {
        serde_json::from_str(&self.text("summary.json")).unwrap()
    }

    /// Replays its log, or what is made of it.
    fn replay(&self, log: &str, node: usize, more: &[&str]) -> (Option<i32>, String) {
        let (log, scenario) = (self.path(log), self.path("scenario.toml"));
        let node = node.to_string();
        let mut arguments =
            vec!["replay", log.to_str().unwrap(), "--scenario", scenario.to_str().unwrap(), "--node", &node];
        arguments.extend(more);
        said(sim_host(&arguments).output().unwrap())
    }

    /// Its log with one line made another.
    fn with_line(&self, line: usize, change: impl Fn(&str) -> Option<String>) -> &'static str {
        let log = self.text("can.log");
        let lines = log.lines().enumerate();
        let changed: Vec<String> = lines
            .filter_map(|(at, text)| if at == line { change(text) } else { Some(text.to_owned()) })
            .collect();
        fs::write(self.path("changed.log"), changed.join("\n") + "\n").unwrap();
        "changed.log"
    }

    /// The line, from 0, of the `nth` frame with an identifier.
    fn line_of(&self, id: &str, nth: usize) -> usize {
        let log = self.text("can.log");
        let is = |(_, line): &(usize, &str)| line.split(' ').nth(2).unwrap().starts_with(&format!("{id}#"));
        log.lines().enumerate().filter(is).nth(nth).unwrap().0
    }
}

/// Flips a bit of the data of a line.
fn flip(line: &str, byte: usize, bit: u8) -> String {
    let (head, data) = line.rsplit_once('#').unwrap();
    let old = u8::from_str_radix(&data[2 * byte..2 * byte + 2], 16).unwrap();
    format!("{head}#{}{:02X}{}", &data[..2 * byte], old ^ (1 << bit), &data[2 * byte + 2..])
}

/// Time (us) and frame of a line.
fn frame_of(line: &str) -> Option<(u64, Frame)> {
    let mut words = line.split(' ');
    let time: u64 = words.next()?.trim_matches(['(', ')']).replace('.', "").parse().ok()?;
    let (id, data) = words.nth(1)?.split_once('#')?;
    let byte = |at: usize| u8::from_str_radix(&data[at..at + 2], 16).unwrap();
    let bytes: Vec<u8> = (0..data.len()).step_by(2).map(byte).collect();
    let id = Id::Base(u16::from_str_radix(id, 16).ok().filter(|_| id.len() == 3)?);
    Some((time, Frame::data(id, &bytes).unwrap()))
}

#[test]
fn the_log_is_equal_in_equal_runs_and_has_the_times_of_the_scenario() {
    let runs = [(); 2].map(|()| {
        Run::new(
            FIVE,
            &["time.duration=300ms", "bus.bit_errors=1e-4"],
            &[&["--pcapng"], &UNJUDGED[..]].concat(),
        )
    });
    let log = runs[0].text("can.log");
    assert_eq!(log, runs[1].text("can.log"));
    let capture = |run: &Run| fs::read(run.path("can.pcapng")).unwrap();
    assert!(!capture(&runs[0]).is_empty() && capture(&runs[0]) == capture(&runs[1]));
    assert!(log.lines().all(|line| line.starts_with("(0000000000.") && line.contains(") can0 ")));
    let times: Vec<u64> = log.lines().filter_map(frame_of).map(|(time, _)| time).collect();
    assert!(times.is_sorted() && *times.last().unwrap() < 300_000);
    // The announced states come before t = 0; then one of each node in each tick.
    let states = |tick: u64| {
        let of_tick = |&(time, frame): &(u64, Frame)| {
            matches!(frame.id(), Id::Base(id) if id >> 7 == 3) && time > 0 && time / 1000 == tick
        };
        log.lines().filter_map(frame_of).filter(of_tick).count()
    };
    assert!((0..299).all(|tick| states(tick) == 5));
    let errors = log.lines().filter(|line| line.contains(" 2000")).count();
    assert!(errors > 5 && runs[0].summary()["bus"]["can"]["error_frames"].as_u64().unwrap() > 1, "{errors}");
    assert_eq!(runs[0].summary()["bus"]["sent"], log.lines().filter_map(frame_of).count());
}

#[test]
fn the_capture_has_the_frames_and_errors_of_the_log_in_nanoseconds() {
    let sets = ["time.duration=100ms", "bus.bit_errors=1e-4"];
    let run = Run::new(FIVE, &sets, &[&["--pcapng"], &UNJUDGED[..]].concat());
    let bytes = fs::read(run.path("can.pcapng")).unwrap();
    let word = |at: usize| u32::from_le_bytes(bytes[at..at + 4].try_into().unwrap());
    let (mut at, mut times, mut link) = (0, Vec::new(), None);
    while at < bytes.len() {
        match word(at) {
            1 => link = Some(word(at + 8)),
            6 => times.push(u64::from(word(at + 12)) << 32 | u64::from(word(at + 16))),
            _ => {}
        }
        at += word(at + 4) as usize;
    }
    assert_eq!(link, Some(227));
    let log = run.text("can.log");
    let us = |line: &str| -> u64 { line[1..18].replace('.', "").parse().unwrap() };
    assert_eq!(times.iter().map(|ns| ns / 1000).collect::<Vec<_>>(), log.lines().map(us).collect::<Vec<_>>());
    // Frames end at a sample point.
    assert!(times.iter().any(|ns| ns % 1000 == 875));
}

#[test]
fn logs_are_left_out_where_that_is_asked_for_and_where_there_is_no_can() {
    let run = Run::new(FIVE, &["time.duration=10ms"], &[&["--no-can-log"], &UNJUDGED[..]].concat());
    assert!(!run.path("can.log").exists() && !run.path("can.pcapng").exists());
    assert!(run.summary()["bus"]["can"]["identifiers"][0]["frames"].as_u64().unwrap() > 5);
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().to_str().unwrap();
    let ideal = ["run", FIVE, "--out", out, "--set", "time.duration=10ms"];
    let (_, text) = said(sim_host(&[&ideal[..], &UNJUDGED].concat()).output().unwrap());
    assert!(!folder.path().join("can.log").exists(), "{text}");
    let (code, text) = said(sim_host(&[&ideal[..], &["--pcapng"]].concat()).output().unwrap());
    assert!(code == Some(2) && text.contains("--pcapng: there is no CAN bus in this run"), "{code:?} {text}");
}

#[test]
fn a_run_that_is_interrupted_leaves_a_log_that_can_be_read() {
    let folder = tempfile::tempdir().unwrap();
    let (out, scenario) = (folder.path().to_str().unwrap(), folder.path().join("long.toml"));
    // Without a reference, which would be computed first.
    let text = "version = 1\ntime = { tick = '1ms', duration = '10min' }\ngraph = { kind = 'ring', nodes = 5 }\nbus = { model = 'can' }\n\
                coupling = { kind = 'node-wise', gain = { kind = 'reciprocal', scale = 1.0 }, funnel = { kind = 'constant', width = 2.0 } }\n\
                agent = { dynamics = { kind = 'affine', slope = -1.0, offset = 1.0 } }\n";
    fs::write(&scenario, text).unwrap();
    let out = format!("{out}/out");
    let mut child =
        sim_host(&["run", scenario.to_str().unwrap(), "--out", &out, "--pcapng", "--quiet"]).spawn().unwrap();
    // Some of the log is on the disk, under its temporary name.
    let is_long = |entry: &fs::DirEntry| {
        entry.file_name().to_string_lossy().contains("can.log")
            && entry.metadata().is_ok_and(|it| it.len() > 50_000)
    };
    let begin = Instant::now();
    while !fs::read_dir(&out).is_ok_and(|entries| entries.flatten().any(|entry| is_long(&entry))) {
        assert!(begin.elapsed() < Duration::from_secs(120), "no log is written");
        std::thread::sleep(Duration::from_millis(20));
    }
    let killed = Command::new("kill").args(["-INT", &child.id().to_string()]).status();
    assert!(killed.unwrap().success());
    assert_eq!(child.wait().unwrap().code(), Some(130));
    let log = fs::read_to_string(folder.path().join("out/can.log")).unwrap();
    assert!(log.ends_with('\n') && log.lines().all(|line| frame_of(line).is_some()));
    let summary: Value =
        serde_json::from_str(&fs::read_to_string(folder.path().join("out/summary.json")).unwrap()).unwrap();
    let ended = summary["ended_early"].as_str().unwrap();
    assert!(log.lines().count() > 10, "{ended}");
    assert!(folder.path().join("out/can.pcapng").exists());
}

/// By the lengths of the frames of the log, and of nothing else: from t = 0 to the end.
#[test]
fn utilisation_is_the_time_of_the_frames_over_the_duration() {
    for rate in [1_000_000, 500_000] {
        let bitrate = format!("bus.bitrate={rate}");
        let run = Run::new(FIVE, &["time.duration=500ms", &bitrate], &UNJUDGED);
        let timing = Timing::classic(BitRate::new(rate, 875).unwrap());
        let log = run.text("can.log");
        let frames = log.lines().filter_map(frame_of).filter(|(time, _)| *time > 0);
        let busy: u64 = frames.map(|(_, frame)| Length::of(&frame, false).ns(timing)).sum();
        let told = run.summary()["bus"]["utilisation"].as_f64().unwrap();
        let frame = 105.0 * 1e9 / f64::from(rate);
        assert!((told * 500e6 - busy as f64).abs() <= frame, "{told} {busy}");
        assert_eq!(run.summary()["bus"]["can"]["utilisation"], run.summary()["bus"]["utilisation"]);
    }
}

/// Five nodes that speak at once: each identifier waits for all before it, and loses to each of them once a
/// tick.
#[test]
fn the_table_says_who_waits_how_long_and_for_whom() {
    let run = Run::new(FIVE, &["time.duration=200ms"], &UNJUDGED);
    let summary = run.summary();
    let rows = summary["bus"]["can"]["identifiers"].as_array().unwrap();
    for (at, row) in rows.iter().take(5).enumerate() {
        let (id, frames) = (format!("{:03X}", 0x181 + at), row["frames"].as_u64().unwrap());
        assert_eq!((&row["id"], &row["node"], frames), (&id.into(), &(at + 1).into(), 201));
        assert_eq!(row["lost"].as_u64().unwrap(), at as u64 * 201);
        let latency = row["latency_s"]["max"].as_f64().unwrap();
        let frames_before = (at + 1) as f64;
        assert!((frames_before * 84e-6..frames_before * 105e-6).contains(&latency), "{row}");
        assert!(row["latency_s"]["p50"].as_f64().unwrap() <= latency);
    }
    assert_eq!(rows[2]["lost_to"], serde_json::json!([["181", 201], ["182", 201]]));
    assert!(run.said.contains("can0: busy for") && run.said.contains("181 (201), 182 (201)"), "{}", run.said);
}

/// What check computes is what a run stays below: exactly the frames, at most the latencies.
#[test]
fn check_predicts_the_utilisation_and_the_latencies_of_a_run() {
    for (rate, tick) in [("1000000", "1ms"), ("500000", "2500us"), ("250000", "5ms")] {
        let sets =
            [format!("bus.bitrate={rate}"), format!("time.tick={tick}"), "time.duration=1s".to_owned()];
        let sets: Vec<&str> = sets.iter().map(String::as_str).collect();
        let run = Run::new(FIVE, &sets, &UNJUDGED);
        let scenario = run.path("scenario.toml");
        let checked = sim_host(&["check", scenario.to_str().unwrap(), "--json"]).output().unwrap();
        let report: Value = serde_json::from_slice(&checked.stdout).unwrap();
        let findings = report["findings"].as_array().unwrap();
        let bus = findings.iter().find(|finding| finding["name"] == "bus").unwrap();
        assert_eq!(bus["status"], "ok", "{bus}");
        let of = |name: &str| bus["values"][name].as_f64().unwrap();
        let told = run.summary()["bus"]["utilisation"].as_f64().unwrap();
        // The announced edges are once, and not in the prediction.
        let edges = 10.0 * 105.0 / rate.parse::<f64>().unwrap();
        assert!(of("utilisation_low") <= told && told <= of("utilisation_high") + edges, "{told} {bus}");
        let summary = run.summary();
        let measured = summary["bus"]["can"]["identifiers"].as_array().unwrap();
        let predicted = bus["values"]["table"]["identifiers"].as_array().unwrap();
        let bit = 1.0 / rate.parse::<f64>().unwrap();
        for (place, (predicted, measured)) in predicted.iter().zip(measured).enumerate() {
            let max = |row: &Value| row["latency_s"]["max"].as_f64().unwrap();
            assert_eq!(predicted["id"], measured["id"]);
            let stuff = 18.0 * bit * (place + 1) as f64;
            assert!(max(measured) <= max(predicted), "{predicted} {measured}");
            // A frame that blocks it, and stuff bits: nothing else is between them.
            assert!(max(predicted) - max(measured) <= 105.0 * bit + stuff, "{predicted} {measured}");
        }
    }
}

#[test]
fn check_warns_of_a_bus_on_which_states_are_late_and_fails_one_that_cannot_carry_them() {
    for (rate, status, code) in [("1000000", "ok", 0), ("500000", "warn", 0), ("125000", "fail", 2)] {
        let bitrate = format!("bus.bitrate={rate}");
        let arguments =
            ["check", FIVE, "--set", "bus.model=can", "--set", &bitrate, "--set", "time.tick=1ms", "--json"];
        let output = sim_host(&arguments).output().unwrap();
        assert_eq!(output.status.code(), Some(code), "{rate}");
        let report: Value = serde_json::from_slice(&output.stdout).unwrap();
        let bus =
            report["findings"].as_array().unwrap().iter().find(|finding| finding["name"] == "bus").unwrap();
        assert_eq!(bus["status"], status, "{bus}");
        if status != "ok" {
            assert_eq!(bus["advice"]["key"], "bus.bitrate", "{bus}");
            assert_eq!(bus["advice"]["value"], "1000000", "{bus}");
        }
    }
}

/// Node by node, and to the scenario's last tick: vectors, noise, errors on the bus, a bus that is too full,
/// a tick that is not whole microseconds.
#[test]
fn a_log_replays_clean_in_every_node_of_its_run() {
    let cases: [(&str, &[&str], usize); 10] = [
        (FIVE, &["time.duration=500ms"], 5),
        (FIVE, &["time.duration=300ms", "bus.bitrate=500000"], 5),
        (FIVE, &["time.duration=300ms", "bus.bit_errors=2e-4", "bus.bitrate=500000"], 5),
        (FIVE, &["time.duration=300ms", "bus.bitrate=125000"], 2),
        (FIVE, &["time.duration=300ms", "agent.noise=0.01"], 5),
        ("scenarios/vector-oscillators.toml", &["time.duration=300ms"], 3),
        ("scenarios/median-11.toml", &["time.duration=200ms", "bus.bitrate=1000000"], 11),
        (FIVE, &["bus.model=can-fd", "time.duration=300ms", "bus.bit_errors=2e-4"], 5),
        (
            FIVE,
            &["bus.model=can-fd", "time.duration=300ms", "bus.bitrate=125000", "bus.data_bitrate=250000"],
            2,
        ),
        ("scenarios/vector-oscillators.toml", &["bus.model=can-fd", "time.duration=300ms"], 3),
    ];
    for (scenario, sets, nodes) in cases {
        let run = Run::new(scenario, sets, &["--quiet"]);
        for node in 1..=nodes {
            let (code, text) = run.replay("can.log", node, &[]);
            assert_eq!(code, Some(0), "{scenario} {sets:?} node {node}: {text}");
            assert!(text.contains("frames as in the log, bit for bit, to tick"), "{text}");
        }
    }
}

#[test]
fn one_bit_that_is_changed_is_found_at_its_tick_with_its_field_and_both_values() {
    let run = Run::new(FIVE, &["time.duration=200ms"], &UNJUDGED);
    // The first frame of an identifier is the announced state, of tick 0.
    let own = run.with_line(run.line_of("183", 120), |line| Some(flip(line, 0, 0)));
    let (code, text) = run.replay(own, 3, &["--json"]);
    let found: Value = serde_json::from_str(&text).unwrap();
    let difference = &found["difference"];
    assert_eq!(
        (code, &difference["tick"], &difference["field"]),
        (Some(1), &120.into(), &"x".into()),
        "{text}"
    );
    assert_eq!(found["frames"], 120 + 2);
    assert_eq!(difference["line"], run.line_of("183", 120) + 1);
    let bits = |value: &Value| -> u32 {
        let value = value.as_str().unwrap();
        u32::from_str_radix(&value[value.find('(').unwrap() + 1..value.find(')').unwrap()], 16).unwrap()
    };
    assert_eq!(bits(&difference["log"]) ^ bits(&difference["node"]), 1);
    let said = run.replay(own, 3, &[]).1;
    assert!(said.contains("first difference at tick 120, x: the log says"), "{said}");
    // The stamp.
    let stamp = run.with_line(run.line_of("183", 120), |line| Some(flip(line, 4, 6)));
    let found: Value = serde_json::from_str(&run.replay(stamp, 3, &["--json"]).1).unwrap();
    assert_eq!(found["difference"]["field"], "tick", "{found}");
    // A neighbour's state of tick 120 makes the node's of tick 121 another one; that of a node that it does
    // not hear makes none.
    let other = run.with_line(run.line_of("182", 120), |line| Some(flip(line, 1, 7)));
    let found: Value = serde_json::from_str(&run.replay(other, 3, &["--json"]).1).unwrap();
    assert_eq!(
        (&found["difference"]["tick"], &found["difference"]["field"]),
        (&121.into(), &"x".into()),
        "{found}"
    );
    let stranger = run.with_line(run.line_of("185", 120), |line| Some(flip(line, 1, 7)));
    assert_eq!(run.replay(stranger, 3, &[]).0, Some(0));
    // The very first.
    let first = run.with_line(run.line_of("183", 0), |line| Some(flip(line, 2, 0)));
    let found: Value = serde_json::from_str(&run.replay(first, 3, &["--json"]).1).unwrap();
    assert_eq!(
        (&found["difference"]["tick"], &found["difference"]["field"]),
        (&0.into(), &"x".into()),
        "{found}"
    );
}

#[test]
fn one_bit_that_is_changed_in_a_frame_of_can_fd_is_found_too() {
    let run = Run::new(FIVE, &["bus.model=can-fd", "time.duration=200ms"], &UNJUDGED);
    let line = run.line_of("583", 120);
    // After the two signs of CAN FD its flags, then the tick and x.
    let changed = run.with_line(line, |line| {
        let (head, data) = line.split_once("##").unwrap();
        Some(format!(
            "{head}#{}",
            flip(&format!("#{}", &data[1..]), 4, 0).replace('#', &format!("#{}", &data[..1]))
        ))
    });
    assert!(run.text(changed).lines().nth(line).unwrap().contains("##"));
    let (code, text) = run.replay(changed, 3, &["--json"]);
    let found: Value = serde_json::from_str(&text).unwrap();
    let difference = &found["difference"];
    assert_eq!(
        (code, &difference["tick"], &difference["field"], &difference["line"]),
        (Some(1), &120.into(), &"x".into(), &(line + 1).into()),
        "{text}"
    );
    // Of the other format the log says it.
    let (code, text) = run.replay("can.log", 3, &["--set", "bus.model=can"]);
    assert!(
        code == Some(2) && text.contains("with bus.model = \"can-fd\", and the scenario has \"can\""),
        "{text}"
    );
}

#[test]
fn a_frame_that_is_missing_or_too_many_is_found() {
    let run = Run::new(FIVE, &["time.duration=200ms"], &UNJUDGED);
    let line = run.line_of("183", 120);
    let missing = run.with_line(line, |_| None);
    let found: Value = serde_json::from_str(&run.replay(missing, 3, &["--json"]).1).unwrap();
    let difference = &found["difference"];
    assert_eq!(
        (&difference["tick"], &difference["field"], &difference["log"]),
        (&120.into(), &"frame".into(), &"nothing".into())
    );
    let twice = run.with_line(line, |line| Some(format!("{line}\n{line}")));
    let found: Value = serde_json::from_str(&run.replay(twice, 3, &["--json"]).1).unwrap();
    assert_eq!(
        (&found["difference"]["tick"], &found["difference"]["field"]),
        (&120.into(), &"frame".into()),
        "{found}"
    );
    // One state of a neighbour is extrapolated so well that nothing of it is seen; twenty are not.
    let log = run.text("can.log");
    let mut seen = 0;
    let lost = log.lines().filter(|line| {
        seen += usize::from(line.contains(" 182#"));
        !(line.contains(" 182#") && (120..140).contains(&seen))
    });
    fs::write(run.path("lost.log"), lost.map(|line| format!("{line}\n")).collect::<String>()).unwrap();
    let found: Value = serde_json::from_str(&run.replay("lost.log", 3, &["--json"]).1).unwrap();
    let tick = found["difference"]["tick"].as_u64().unwrap();
    assert!((120..145).contains(&tick), "a neighbour that was not heard: {found}");
}

#[test]
fn a_log_of_another_scenario_is_told() {
    let run = Run::new(FIVE, &["time.duration=100ms"], &UNJUDGED);
    let other = |sets: &[&str], node| {
        let sets: Vec<&str> = sets.iter().flat_map(|set| ["--set", set]).collect();
        run.replay("can.log", node, &sets)
    };
    for (sets, node, code, words) in [
        (
            &["node.2.state=-2.5"][..],
            3,
            2,
            "node 2 begins with x = -2 in line 2, and with -2.5 in the scenario (tick 0, component 0)",
        ),
        (&["node.3.state=4.25"], 3, 1, "first difference at tick 0, x: the log says 4.5 "),
        (&["graph.kind=star"], 3, 1, "is the log of this scenario, its seed and its settings?"),
        (&["coupling.funnel.rate=2.0"], 3, 1, "is the log of this scenario, its seed and its settings?"),
        (&["bus.model=ideal"], 3, 2, "there is no START in it"),
        (&[], 6, 2, "--node 6: the scenario has nodes 1 to 5"),
    ] {
        let (found, text) = other(sets, node);
        assert_eq!(found, Some(code), "{sets:?}: {text}");
        assert!(text.contains(words), "{sets:?}: no '{words}' in {text}");
    }
    let strange = run.with_line(run.line_of("185", 0), |line| Some(line.replace(" 185#", " 187#")));
    let (code, text) = run.replay(strange, 3, &[]);
    let words = "not a log of this scenario, its seed and its settings: line 5 is of node 7, and the scenario has 5 nodes";
    assert!(code == Some(2) && text.contains(words), "{code:?} {text}");
    // A node that the log does not have, far from the one that is replayed.
    let log = run.text("can.log");
    let of_five = |line: &str| line.contains(" 185#") || line.contains(" 605#");
    let without = log.lines().filter(|line| !of_five(line)).collect::<Vec<_>>().join("\n");
    fs::write(run.path("without.log"), without + "\n").unwrap();
    let (code, text) = run.replay("without.log", 3, &[]);
    assert!(code == Some(2) && text.contains("node 5 says nothing in it"), "{code:?} {text}");
}

#[test]
fn a_log_that_is_cut_off_or_no_log_is_told() {
    let run = Run::new(FIVE, &["time.duration=200ms"], &UNJUDGED);
    let log = run.text("can.log");
    let at = log.lines().take(600).map(|line| line.len() + 1).sum::<usize>();
    let write = |text: &str| fs::write(run.path("part.log"), text).unwrap();
    // In the middle of a line, which alone could pass for a shorter frame.
    write(&log[..at - 3]);
    let (code, text) = run.replay("part.log", 3, &[]);
    assert_eq!(code, Some(1), "{text}");
    assert!(text.contains("the log is cut off in line 600"), "{text}");
    // Between two lines.
    write(&log[..at]);
    let (code, text) = run.replay("part.log", 3, &[]);
    assert_eq!(code, Some(1), "{text}");
    assert!(text.contains("the log ends before the scenario, which has 200 ticks"), "{text}");
    // That part can be asked for.
    let (code, text) = run.replay("part.log", 3, &["--set", "time.duration=100ms"]);
    assert_eq!(code, Some(0), "{text}");
    write("");
    let (code, text) = run.replay("part.log", 3, &[]);
    assert!(code == Some(2) && text.contains("no frame of node 3 is in it"), "{code:?} {text}");
    write(&log.replacen("can0 183#", "can0 18#", 1));
    let (code, text) = run.replay("part.log", 3, &[]);
    assert!(code == Some(2) && text.contains("part.log:3: not a line of candump -L"), "{code:?} {text}");
    let (code, text) = run.replay("none.log", 3, &[]);
    assert!(code == Some(2) && text.contains("none.log: No such file"), "{code:?} {text}");
}

/// What a full bus has no room for is told, in text and counters; and no replay takes it for a difference.
#[test]
fn frames_without_room_are_counted() {
    let run =
        Run::new(FIVE, &["time.duration=200ms", "bus.bitrate=125000"], &["--set", "expect.stopped='any'"]);
    let summary = run.summary();
    let can = &summary["bus"]["can"];
    assert!(can["unsent"].as_u64().unwrap() > 100, "{can}");
    assert!(
        can["utilisation"].as_f64().unwrap() > 0.99 && can["utilisation"].as_f64().unwrap() <= 1.0,
        "{can}"
    );
    assert!(run.said.contains("frames without room"), "{}", run.said);
    // All that nodes gave is sent, or has had no room, or waits: one announced state, and one per tick, the
    // last one among them.
    for row in can["identifiers"].as_array().unwrap().iter().filter(|row| row["id"].as_str().unwrap() < "200")
    {
        let given = row["frames"].as_u64().unwrap() + row["unsent"].as_u64().unwrap();
        assert!((200..=202).contains(&given), "{row}");
    }
}
