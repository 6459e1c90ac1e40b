//! Designs that `check` once called fine and that leave their funnels, and what it must say of them.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic)]

use sim_host::check::{Finding, Report, Setting, Status, check};
use sim_host::interrupt::Interrupt;
use sim_host::run::{Fidelity, RunOptions, Verbosity, simulate};
use sim_host::scenario::{Override, Scenario};
use std::path::{Path, PathBuf};
use std::process::Command;

fn path(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/cases").join(name).with_extension("toml")
}

fn case(name: &str, sets: &[&str]) -> Report {
    let sets: Vec<_> = sets.iter().map(|set| Override::parse(set).unwrap()).collect();
    check(&Scenario::load(&path(name), &sets).unwrap_or_else(|errors| panic!("{errors}")))
}

fn find<'r>(report: &'r Report, name: &str) -> &'r Finding {
    report.findings.iter().find(|found| found.name == name).unwrap_or_else(|| panic!("no {name}: {report}"))
}

fn value(report: &Report, name: &str, key: &str) -> f64 {
    find(report, name).values[key].as_f64().unwrap_or_else(|| panic!("no {key} of {name}: {report}"))
}

/// What `sim-host check` gives for a case: exit code and output.
fn command(name: &str, options: &[&str]) -> (Option<i32>, String) {
    let output = Command::new(env!("CARGO_BIN_EXE_sim-host"))
        .arg("check")
        .arg(path(name))
        .args(options)
        .output()
        .unwrap();
    (output.status.code(), String::from_utf8(output.stdout).unwrap())
}

#[test]
fn a_start_that_the_fields_throw_out_fails() {
    let report = case("fool1", &[]);
    assert_eq!((find(&report, "kick").status, report.pass), (Status::Fail, false));
    assert!((value(&report, "kick", "kick") - 2.5).abs() < 1e-12);
    // What the run does: 2.499 at tick 1.
    assert!((value(&report, "sampled", "ratio") - 2.499).abs() < 1e-3);
    assert_eq!(value(&report, "sampled", "t"), 0.01);
}

#[test]
fn the_tick_that_is_advised_cures_the_start() {
    let advice = find(&case("fool1", &[]), "kick").advice.clone().unwrap();
    let setting = advice.setting.unwrap();
    let cured = case("fool1", &[&format!("{}={}", setting.key, setting.value)]);
    assert_eq!(
        (find(&cured, "kick").status, find(&cured, "sampled").status),
        (Status::Ok, Status::Ok),
        "{cured}"
    );
    // Half a kick is warned about, and does not fail.
    assert_eq!(find(&case("fool1", &["time.tick=2500us"]), "kick").status, Status::Warn);
}

/// By machine: its key and value, and what has to be set beside it.
#[test]
fn a_slow_start_is_advised_where_the_start_alone_is_the_cause() {
    let keys = |report: &Report| -> Vec<Setting> {
        let advice = find(report, "sampled").advice.clone().unwrap();
        advice.settings().cloned().collect()
    };
    let settings = keys(&case("fool1", &[]));
    assert_eq!(settings[0].key, "time.slow_start", "{settings:?}");
    let sets: Vec<String> = settings.iter().map(|set| format!("{}={}", set.key, set.value)).collect();
    let sets: Vec<&str> = sets.iter().map(String::as_str).collect();
    assert_eq!(find(&case("fool1", &sets), "sampled").status, Status::Ok, "{sets:?}");
    // Here the funnel is left later, and noise goes on.
    for later in ["fan-path", "fool2"] {
        assert!(keys(&case(later, &[])).iter().all(|set| set.key != "time.slow_start"), "{later}");
    }
    // It has one, and something else is to be done.
    let slow = keys(&case("fool1", &["time.slow_start=10ms", "coupling.funnel.factor=0.2"]));
    assert!(slow.iter().all(|set| set.key != "time.slow_start"), "{slow:?}");
}

#[test]
fn noise_is_held_against_the_room_in_the_funnel() {
    let report = case("fool2", &[]);
    assert_eq!(find(&report, "noise").status, Status::Warn);
    assert!((value(&report, "noise", "deviation") - 0.05 * 2f64.sqrt()).abs() < 1e-12);
    assert_eq!(find(&report, "sampled").status, Status::Warn);
    let quiet = case("fool2", &["agent.noise=0.001"]);
    assert_eq!(
        (find(&quiet, "noise").status, find(&quiet, "sampled").status),
        (Status::Ok, Status::Ok),
        "{quiet}"
    );
    assert!(case("fool2", &["agent.noise=0"]).findings.iter().all(|found| found.name != "noise"));
}

#[test]
fn a_matrix_that_turns_too_far_in_a_tick_fails() {
    let report = case("fool4", &[]);
    assert_eq!(find(&report, "speed").status, Status::Fail);
    assert!((value(&report, "speed", "tick_slope") - 3.0).abs() < 1e-12);
    assert_eq!(find(&report, "sampled").status, Status::Fail);
    assert_eq!(find(&report, "predictions").status, Status::NotChecked);
    assert_eq!(find(&report, "kick").status, Status::Warn);
}

#[test]
fn expectations_that_contradict_the_prediction_fail() {
    let report = case("expect-against-prediction", &[]);
    for name in ["expect-final-value", "expect-emergent-error", "expect-blended-error"] {
        assert_eq!(find(&report, name).status, Status::Fail, "{report}");
    }
    assert!((value(&report, "expect-final-value", "predicted") - 98.5).abs() < 1e-6);
    assert_eq!(find(&report, "expect-funnel-ratio").status, Status::Ok);
    let right = ["expect.final_value.is=1.5", "expect.emergent_error=1e-5", "expect.blended_error=1e-5"];
    assert!(case("expect-against-prediction", &right).pass);
    // Missed by less than a twentieth.
    let near = [&right[1..], &["expect.final_value.is=1.603"]].concat();
    let report = case("expect-against-prediction", &near);
    assert_eq!((find(&report, "expect-final-value").status, report.pass), (Status::Warn, true));
}

#[test]
fn neighbours_that_drift_slowly_are_judged_by_the_whole() {
    let report = case("fan-path", &[]);
    assert_eq!(find(&report, "narrowest-funnel").status, Status::Warn);
    assert!((value(&report, "narrowest-funnel", "predicted_ratio") - 1.73).abs() < 0.02, "{report}");
    assert_eq!(find(&report, "sampled").status, Status::Warn);
    assert!((value(&report, "sampled", "ratio") - 1.874).abs() < 1e-3);
    for name in ["narrowest-funnel", "sampled"] {
        let setting = find(&report, name).advice.clone().unwrap().setting.unwrap();
        let cured = case("fan-path", &[&format!("{}={}", setting.key, setting.value)]);
        assert_eq!(find(&cured, "sampled").status, Status::Ok, "{name}: {cured}");
    }
}

#[test]
fn exit_codes_are_those_of_the_worst_finding() {
    assert_eq!(command("fool1", &[]).0, Some(2));
    let noisy = ["--set", "expect.funnel_ratio=10"];
    assert_eq!(command("fool2", &noisy).0, Some(0));
    assert_eq!(command("fool2", &[&noisy[..], &["--strict"]].concat()).0, Some(1));
    assert_eq!(command("fool1", &["--strict"]).0, Some(2));
    assert_eq!(command("fool2", &["--strict", "--set", "agent.noise=0"]).0, Some(0));
}

#[test]
fn statuses_are_said_and_counted() {
    let (_, text) = command("fool4", &[]);
    assert!(text.contains("\nNOT CHECKED  Predictions"), "{text}");
    assert!(text.trim_end().ends_with("3 not checked, 1 warning and 2 failures"), "{text}");
    let (_, json) = command("fool4", &["--json"]);
    let report: serde_json::Value = serde_json::from_str(&json).unwrap();
    let of = |name: &str| {
        report["findings"].as_array().unwrap().iter().find(|found| found["name"] == name).unwrap().clone()
    };
    assert_eq!(of("predictions")["status"], "not-checked");
    assert_eq!((&of("kick")["status"], &of("speed")["status"]), (&"warn".into(), &"fail".into()));
    let advice = of("kick")["advice"].clone();
    // What the formula of this finding asks for does not help, so that what does is in its place.
    assert!(
        advice["text"].as_str().unwrap().contains("time.tick = 50ms was tried and does not help"),
        "{advice}"
    );
    assert!(advice["key"] != "time.tick" || advice["value"] != "50ms", "{advice}");
}

/// Five agents of a ring that keep their funnel in f64, and whose f32 cannot resolve it.
fn five(sets: &[&str]) -> Report {
    let scenario = Path::new(env!("CARGO_MANIFEST_DIR")).join("../scenarios/five-agents.toml");
    let sets: Vec<_> = sets.iter().map(|set| Override::parse(set).unwrap()).collect();
    check(&Scenario::load(&scenario, &sets).unwrap_or_else(|errors| panic!("{errors}")))
}

#[test]
fn a_breach_that_stops_a_node_fails() {
    // A run rides through it, and with this policy it stops.
    let rides = case("fan-path", &[]);
    assert_eq!(find(&rides, "sampled").status, Status::Warn);
    let stops = case("fan-path", &["coupling.on_breach=stop"]);
    assert_eq!((find(&stops, "sampled").status, stops.pass), (Status::Fail, false));
}

#[test]
fn a_floor_that_the_scenario_does_not_accept_fails_as_the_run_does() {
    let narrow = ["time.duration=3s", "coupling.funnel.end=1e-6", "coupling.funnel.rate=10"];
    let with = |floor: &'static str| five(&[&narrow[..], &[floor]].concat());
    let refused = with("coupling.floor=1e-6");
    let found = find(&refused, "sampled");
    assert_eq!((found.status, refused.pass), (Status::Fail, false));
    let setting = found.advice.clone().unwrap().setting.unwrap();
    assert_eq!((setting.key.as_str(), setting.value.as_str()), ("coupling.floor", "f32"));
    let accepted = with("coupling.floor='f32'");
    assert!(find(&accepted, "sampled").status != Status::Fail, "{accepted}");
    // One that is wide enough is kept.
    assert!(find(&with("coupling.floor=0.01"), "sampled").status != Status::Fail);
}

#[test]
fn a_tick_that_sets_no_limit_is_said_without_an_infinite_funnel() {
    let still = five(&["agent.dynamics={kind='affine',slope=-1,offset=1}"]);
    let text = find(&still, "narrowest-funnel").text.clone();
    assert!(!text.contains("inf"), "{text}");
}

fn gallery(file: &str, sets: &[String]) -> Scenario {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../scenarios").join(file);
    let sets: Vec<_> = sets.iter().map(|set| Override::parse(set).unwrap()).collect();
    Scenario::load(&path, &sets).unwrap_or_else(|errors| panic!("{errors}"))
}

/// What is advised helps, and what does not help is not advised.
#[test]
fn cures_are_tried_before_they_are_advised() {
    for (file, sets) in [
        // More damping makes it worse.
        ("narrow-star.toml", &["bus.loss=0.4"][..]),
        // A round of 4 ms is long enough for every frame, and too long for the funnel.
        ("narrow-ring.toml", &["bus.latency=2ms"]),
        ("narrow-ring.toml", &["bus.latency=1ms"]),
        ("five-agents.toml", &["coupling.u_max=3", "time.duration=4s"]),
        ("narrow-complete.toml", &["time.tick=4ms"]),
    ] {
        let sets: Vec<_> = sets.iter().map(|set| (*set).to_owned()).collect();
        let report = check(&gallery(file, &sets));
        assert!(matches!(find(&report, "sampled").status, Status::Warn | Status::Fail), "{report}");
        let open = report.findings.iter().filter(|found| matches!(found.status, Status::Warn | Status::Fail));
        let mut advised = 0;
        for found in open {
            let Some(advice) = &found.advice else { continue };
            let settings: Vec<_> =
                advice.settings().map(|set| format!("{}={}", set.key, set.value)).collect();
            if settings.is_empty() {
                continue;
            }
            advised += 1;
            let cured = check(&gallery(file, &[sets.as_slice(), &settings].concat()));
            let ratio = value(&cured, "sampled", "ratio");
            assert!(ratio < 1.0, "{file} {sets:?} {settings:?} of {}: {ratio}", found.name);
        }
        let says_none = report.to_string().contains("nothing that was tried");
        assert!(advised > 0 || says_none, "{file} {sets:?}: {report}");
        println!("{file} {sets:?}: {advised} advised");
    }
}

/// The longest tick that is named, s, and the ratio of a run at so many times it.
fn longest(file: &str, sets: &[&str]) -> (f64, impl Fn(f64) -> f64 + use<>) {
    let sets: Vec<_> = sets.iter().map(|set| (*set).to_owned()).collect();
    let scenario = gallery(file, &sets);
    let (named, end_us) =
        (value(&check(&scenario), "narrowest-funnel", "longest_tick_s"), 1e6 * scenario.time.end_s());
    let file = file.to_owned();
    let run = move |times: f64| {
        let tick_us = (times * named * 1e6) as u64;
        let end = format!("time.duration={}us", tick_us * (end_us / tick_us as f64) as u64);
        run_ratio(&gallery(&file, &[format!("time.tick={tick_us}us"), end]))
    };
    (named, run)
}

/// The longest tick that is named is where the run crosses its funnel, within 10 %.
#[test]
fn the_longest_tick_is_that_of_the_run() {
    for graph in ["ring", "path", "star", "complete"] {
        let (named, run) = longest(&format!("narrow-{graph}.toml"), &["time.duration=4s"]);
        let (below, above) = (run(1.0), run(1.1));
        assert!(below < 1.0 && above > 1.0, "{graph}: {named} s, {below} below and {above} above");
    }
}

/// Where a funnel is wide it is never longer.
#[test]
fn the_longest_tick_of_a_wide_funnel_keeps_it() {
    for graph in ["", "-path", "-star", "-complete"] {
        let (named, run) = longest(&format!("five-agents{graph}.toml"), &[]);
        let at = run(1.0);
        println!("five-agents{graph}: {named} s, {at}");
        assert!(at < 1.0, "{graph}: {named} s, {at}");
    }
}

fn run_ratio(scenario: &Scenario) -> f64 {
    let outcome = simulate(scenario, &options()).unwrap_or_else(|error| panic!("{}", error.message));
    outcome.judge(scenario, Fidelity::Loopback).funnel.map_or(f64::NAN, |funnel| funnel.max_ratio)
}

fn options() -> RunOptions {
    RunOptions {
        on: Fidelity::Loopback,
        out: None,
        every_ticks: Some(1_000_000),
        json: None,
        junit: None,
        image: PathBuf::new(),
        bench: None,
        bus_logs: Default::default(),
        mcap: false,
        verbosity: Verbosity::Quiet,
        interrupt: Interrupt::default(),
        repeat: String::new(),
    }
}

#[test]
fn windows_are_held_against_what_the_law_does_there() {
    let windows = |ratio: f64| {
        format!(
            "expect.window=[{{ from = \"2s\", to = \"4s\", funnel_ratio = {ratio}, spread = 5.0, emergent_error = 5.0 }}]"
        )
    };
    let of = |ratio| check(&gallery("five-agents.toml", &["time.duration=5s".to_owned(), windows(ratio)]));
    let found = |report: &Report| -> Vec<(Status, f64)> {
        let all = report.findings.iter().filter(|found| found.name == "expect-windows");
        all.map(|found| (found.status, found.values["predicted"].as_f64().unwrap())).collect()
    };
    let report = of(1.0);
    let held = found(&report);
    assert_eq!(held.len(), 3, "{report}");
    assert!(held.iter().all(|(status, _)| *status == Status::Ok), "{report}");
    assert!(held[0].1 > 0.5 && held[2].1 > 0.1, "{held:?}");
    assert_eq!(found(&of(0.5 * held[0].1))[0].0, Status::Fail);
}

#[test]
fn a_sine_near_the_slowest_mode_is_noted() {
    let of = |frequency: f64| {
        let sets = [
            "time.duration=2s".to_owned(),
            format!("node.1.dynamics.sines=[{{ amplitude = 1.0, frequency = {frequency} }}]"),
            "time.tick=10ms".to_owned(),
        ];
        check(&gallery("five-agents.toml", &sets))
    };
    // lambda_2 of the normalised ring of five is 1 - cos 72 degrees.
    let mode = ((1.0 - 0.309_017) / 1.1f64).sqrt() / 0.01;
    for (frequency, noted) in [(mode, true), (mode / 3.0, true), (mode / 10.0, false), (mode * 2.0, false)] {
        let report = of(frequency);
        let found = report.findings.iter().any(|found| found.name == "resonance");
        assert_eq!(found, noted, "{frequency}: {report}");
    }
}

/// A prediction of where the network goes is as good as its premises.
#[test]
fn premises_that_do_not_hold_lower_a_prediction() {
    let of = |file: &str, sets: &[&str]| {
        let sets: Vec<_> = sets.iter().map(|set| (*set).to_owned()).collect();
        let report = check(&gallery(file, &sets));
        let found = find(&report, "prediction");
        (found.status, found.advice.as_ref().map_or(String::new(), |advice| advice.text.clone()))
    };
    // Over in a second, and forgotten within four.
    let (status, why) = of("five-agents.toml", &["time.duration=1s"]);
    assert!(status == Status::Note && why.contains("time constants"), "{why}");
    assert_eq!(of("five-agents.toml", &[]).0, Status::Ok);
    // Nothing forgets the start, and what loss does to the mean stays.
    let still = "agent.dynamics={kind='affine',slope=0,offset=0}";
    let (status, why) = of("average.toml", &["bus.loss=0.1", still]);
    assert!(status != Status::Ok && why.contains("move the mean"), "{why}");
    // A tick that is far too long for the funnel.
    let (status, why) = of("narrow-ring.toml", &["time.tick=20ms"]);
    assert!(status == Status::Note && why.contains("from xi"), "{why}");
}
