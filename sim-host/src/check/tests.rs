//! What check says.

use std::path::Path;

use super::*;
use crate::scenario::Override;

fn load(file: &str, sets: &[&str]) -> Report {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../scenarios").join(file);
    let overrides: Vec<_> = sets.iter().map(|set| Override::parse(set).unwrap()).collect();
    check(&Scenario::load(&path, &overrides).unwrap())
}

fn find<'r>(report: &'r Report, name: &str) -> &'r Finding {
    report.findings.iter().find(|finding| finding.name == name).unwrap()
}

#[test]
fn the_paper_example_holds() {
    let report = load("five-agents.toml", &[]);
    assert!(report.pass && report.findings.iter().all(|finding| finding.status != Status::Warn), "{report}");
    let lambda2 = find(&report, "graph").values["lambda2"].as_f64().unwrap();
    assert!((lambda2 - 1.381_966).abs() < 1e-6);
    let bound = find(&report, "sync-bound").values["end"].as_f64().unwrap();
    assert!((bound - 2.0 * 5f64.sqrt() / lambda2 * 2.0).abs() < 1e-4);
}

#[test]
fn a_funnel_below_what_the_tick_can_hold_is_warned_about() {
    // LAW.md 4: the prototype kept 0.02 at 2 ms, and left it at 10 ms.
    assert_eq!(find(&load("narrow-ring.toml", &["time.tick=2ms"]), "narrowest-funnel").status, Status::Ok);
    let report = load("narrow-ring.toml", &["time.tick=10ms"]);
    let found = find(&report, "narrowest-funnel");
    assert_eq!(found.status, Status::Warn);
    assert!(found.advice.as_ref().is_some_and(|advice| advice.contains("use a tick of")), "{report}");
}

#[test]
fn a_funnel_below_the_resolution_is_warned_about() {
    assert_eq!(find(&load("asymptotic-path-11.toml", &[]), "resolution").status, Status::Warn);
    assert_eq!(find(&load("narrow-ring.toml", &[]), "resolution").status, Status::Ok);
}

#[test]
fn the_resolution_is_the_floor_of_the_node() {
    let report = load("five-agents.toml", &["node.1.state=1e5", "coupling.funnel.start=1e6"]);
    let step = find(&report, "resolution").values["resolution"].as_f64().unwrap();
    assert!((step - FLOOR_ULPS * f64::from(f32::EPSILON) * 1e5).abs() < 1e-9, "{step}");
}

#[test]
fn the_bound_is_that_of_the_floored_funnel() {
    let report = load("asymptotic-path-11.toml", &[]);
    // The run ends 4e-4 apart; the funnel of the scenario, 1e-10, is not the one that the nodes keep.
    assert!(find(&report, "sync-bound").values["end"].as_f64().unwrap() > 4e-4, "{report}");
}

#[test]
fn a_margin_below_the_rounding_is_warned_about() {
    let margin = |sets: &[&str]| load("asymptotic-path-11.toml", sets).findings;
    let found = |sets: &[&str]| margin(sets).into_iter().find(|finding| finding.name == "margin");
    assert_eq!(found(&[]).unwrap().status, Status::Ok);
    let tight = found(&["coupling.gain.scale=1"]).unwrap();
    assert_eq!((tight.status, &tight.values["node"]), (Status::Warn, &json!(5)));
    // f_em - f_5 is about 6.6 - 100.
    assert!((tight.values["margin"].as_f64().unwrap() - 1.0 / 94.0).abs() < 1e-3, "{tight:?}");
    assert!(found(&["coupling.funnel.end=1"]).is_none());
}

#[test]
fn capacity_is_that_of_the_wire() {
    assert_eq!(capacity::classic_bits(8), 135);
    for (nodes, fast, slow) in [(5, 1037.0, 518.0), (20, 259.0, 129.0), (64, 81.0, 40.0), (127, 40.0, 20.0)] {
        assert_eq!(capacity::highest_rate(nodes, 1e6).floor(), fast);
        assert_eq!(capacity::highest_rate(nodes, 5e5).floor(), slow);
    }
}

#[test]
fn what_is_not_predicted_is_said_and_not_guessed() {
    for (file, sets, words) in [
        (
            "vector-oscillators.toml",
            &[][..],
            "none here for element-wise coupling of states with 2 components",
        ),
        ("five-agents.toml", &["coupling.kind=none"], "the law promises no funnel"),
    ] {
        let report = load(file, sets);
        assert!(find(&report, "predictions").text.contains(words), "{report}");
        for name in ["emergent", "sync-bound", "narrowest-funnel", "resolution", "margin"] {
            assert!(report.findings.iter().all(|finding| finding.name != name), "{report}");
        }
    }
    let load = |report: &Report| find(report, "capacity").values["can_1m_load"].as_f64().unwrap();
    // Every component has a frame of its own.
    assert_eq!(
        load(&self::load("vector-oscillators.toml", &[])),
        2.0 * load(&self::load("five-agents.toml", &[]))
    );
}

#[test]
fn late_frames_are_warned_about() {
    assert_eq!(find(&load("five-agents.toml", &["bus.latency=1ms"]), "bus").status, Status::Warn);
    assert_eq!(find(&load("five-agents.toml", &["bus.latency=100us"]), "bus").status, Status::Note);
}
