//! Worlds in which a run must not pass, and a few in which it must: the verdict of `run`, as the library
//! gives it.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic)]

use sim_host::interrupt::Interrupt;
use sim_host::judge::Check;
use sim_host::record::Summary;
use sim_host::run::{Fidelity, Outcome, RunOptions, Verbosity, simulate};
use sim_host::scenario::{Override, Scenario};
use std::path::{Path, PathBuf};

/// A ring of five in a constant funnel of 2; node 1 alone is driven.
const RING: &str = r#"
version = 1
[time]
tick = "1ms"
duration = "5s"
[graph]
kind = "ring"
nodes = 5
[coupling]
kind = "node-wise"
gain = { kind = "reciprocal", scale = 1.0 }
funnel = { kind = "constant", width = 2.0 }
[agent]
dynamics = { kind = "affine", slope = -1.0 }
[[node]]
id = 1
dynamics = { offset = 2 }
"#;

fn overrides(sets: &[&str]) -> Vec<Override> {
    sets.iter().map(|set| Override::parse(set).unwrap_or_else(|error| panic!("{set}: {error}"))).collect()
}

fn ring(sets: &[&str]) -> Scenario {
    Scenario::parse(RING, Path::new("ring.toml"), &overrides(sets))
        .unwrap_or_else(|errors| panic!("{errors}"))
}

fn gallery(name: &str, sets: &[&str]) -> Scenario {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../scenarios").join(name);
    Scenario::load(&path, &overrides(sets)).unwrap_or_else(|errors| panic!("{errors}"))
}

fn options(on: Fidelity, every_ticks: Option<u64>) -> RunOptions {
    RunOptions {
        on,
        out: None,
        every_ticks,
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

fn outcome(scenario: &Scenario) -> Outcome {
    simulate(scenario, &options(Fidelity::Loopback, None)).unwrap_or_else(|error| panic!("{error}"))
}

fn judged(scenario: &Scenario) -> Summary {
    outcome(scenario).judge(scenario, Fidelity::Loopback)
}

/// Names of the expectations and checks that fail.
fn failed(summary: &Summary) -> Vec<String> {
    let expected = summary.expect.iter().filter(|expectation| !expectation.pass);
    let checks = summary.checks.iter().filter(|check| !check.pass).map(|check| check.name.to_owned());
    expected.map(|expectation| expectation.name.clone()).chain(checks).collect()
}

fn check<'a>(summary: &'a Summary, name: &str) -> &'a Check {
    summary.checks.iter().find(|check| check.name == name).unwrap_or_else(|| panic!("no check {name}"))
}

#[test]
fn a_network_that_does_what_is_asked_passes_every_check() {
    let summary =
        judged(&ring(&["expect.funnel_ratio=1.0", "expect.max_input=2.0", "expect.final_spread=2.0"]));
    assert_eq!((failed(&summary), summary.passed), (vec![], true));
    let funnel = summary.funnel.unwrap();
    assert_eq!((funnel.breaches, funnel.unknown), (0, 0));
    // By the same bits: nothing was lost, late or noisy.
    let believed = funnel.believed.unwrap();
    assert!((believed.max_ratio - funnel.max_ratio).abs() < 1e-6, "{funnel:?}");
}

#[test]
fn a_bus_that_delivers_nothing_fails_though_no_node_knows() {
    let sets = ["bus.loss=1.0", "node.1.dynamics.offset=30", "expect.funnel_ratio=1.0"];
    let summary = judged(&ring(&sets));
    let funnel = summary.funnel.unwrap();
    assert!(failed(&summary).contains(&"funnel_ratio".to_owned()), "{summary:?}");
    // Node 1 ends at 30 (1 - e^-5), its neighbours at 0: |nu| / psi = 2 x 29.798 / 2.
    assert!((funnel.max_ratio - 29.798).abs() < 0.01, "{funnel:?}");
    assert_eq!(funnel.believed.unwrap().max_ratio, 0.0);
    // Also where nothing at all is expected of the funnel.
    assert!(!judged(&ring(&["bus.loss=1.0"])).passed);
}

#[test]
fn breaches_of_a_lossy_bus_are_counted_by_true_terms() {
    let summary = judged(&gallery("narrow-ring.toml", &["bus.loss=0.5"]));
    let funnel = summary.funnel.unwrap();
    let believed = funnel.believed.unwrap();
    assert!(funnel.breaches > believed.breaches && believed.breaches > 0, "{funnel:?}");
    assert!(!summary.passed && summary.counters.unwrap().extrapolated > 10_000);
}

#[test]
fn noise_is_not_the_state() {
    let summary = judged(&ring(&["agent.noise=1.0"]));
    let funnel = summary.funnel.unwrap();
    // Two neighbours with a deviation of one each, in a funnel of two.
    let believed = funnel.believed.unwrap();
    assert!(believed.max_ratio > 2.0 && funnel.max_ratio < believed.max_ratio, "{funnel:?}");
}

#[test]
fn nodes_that_stop_fail_the_run_unless_the_scenario_allows_it() {
    // Without loss all would be well; at half of it a node leaves its funnel and stops.
    let sets = &["coupling.on_breach=stop", "bus.loss=0.9", "node.1.dynamics.offset=60"][..];
    let summary = judged(&ring(sets));
    assert!(!summary.stopped.is_empty(), "{summary:?}");
    assert!(failed(&summary).contains(&"stopped".to_owned()), "{summary:?}");
    let text = &check(&summary, "stopped").text;
    assert!(text.contains("stopped by itself at") && text.contains("funnel"), "{text}");
    let some = judged(&ring(&[sets, &["expect.stopped=[4]"]].concat()));
    assert!(!check(&some, "stopped").pass);
    let all = judged(&ring(&[sets, &["expect.stopped=any"]].concat()));
    assert!(check(&all, "stopped").pass && check(&all, "stopped").text.contains("as expect.stopped allows"));
}

#[test]
fn all_nodes_at_rest_after_a_few_ticks_are_no_agreement() {
    // A field that runs away: every node stops at its state limit.
    let summary = judged(&ring(&["agent.dynamics.slope=20", "node.2.state=0.1", "expect.final_spread=1e12"]));
    assert_eq!(summary.stopped, [1, 2, 3, 4, 5]);
    assert!(!summary.passed);
}

#[test]
fn a_floored_funnel_fails_unless_the_scenario_says_which_floor_it_accepts() {
    let closing = "coupling.funnel={kind='exponential',start=40.0,end=0.0,rate=20.0}";
    let summary = judged(&ring(&[closing]));
    assert!(failed(&summary).contains(&"floor".to_owned()), "{summary:?}");
    let accepted = judged(&ring(&[closing, "coupling.floor='f32'", "node.1.dynamics.offset=0"]));
    assert_eq!(failed(&accepted), Vec::<String>::new(), "{accepted:?}");
    // Narrower than f32 can keep.
    let narrow = judged(&ring(&[closing, "coupling.floor=1e-9"]));
    assert!(failed(&narrow).contains(&"floor".to_owned()), "{narrow:?}");
    // As wide as is asked for: what the node floors it to is inside.
    let wide = judged(&ring(&[closing, "coupling.floor=0.01", "expect.funnel_ratio=1.0"]));
    assert_eq!(failed(&wide), Vec::<String>::new(), "{wide:?}");
}

#[test]
fn a_reopened_funnel_is_judged_by_the_scenarios() {
    let sets = [
        "coupling.funnel={kind='exponential',start=2.0,end=0.001,rate=50.0}",
        "coupling.on_breach={kind='reopen',margin=2.0,rate=0.1}",
        "bus.loss=0.8",
        "node.1.dynamics={offset=40,sines=[{amplitude=400,frequency=300}]}",
        "expect.funnel_ratio=1.0",
    ];
    let summary = judged(&ring(&sets));
    let funnel = summary.funnel.unwrap();
    let reopened = funnel.reopened_ratio.expect("a reopened funnel");
    assert!(summary.counters.unwrap().reopened > 0 && funnel.max_ratio > 3.0 * reopened, "{funnel:?}");
    assert!(failed(&summary).contains(&"funnel_ratio".to_owned()));
}

#[test]
fn an_input_above_its_limit_fails() {
    let summary = judged(&ring(&["expect.max_input=0.5"]));
    assert_eq!(failed(&summary), ["max_input"], "{}", summary.max_input);
}

#[test]
fn windows_judge_their_part_of_the_run() {
    let windows = |limit: &str| {
        format!(
            "expect.window=[{{from='0s',to='100ms',spread=10.0}},{{from='4s',to='5s',spread={limit},funnel_ratio=1.0,emergent_error=2.0,max_input=9.0}}]"
        )
    };
    let wide = judged(&ring(&[&windows("2.0"), "node.2.state=0.5"]));
    assert_eq!(failed(&wide), Vec::<String>::new(), "{:?}", wide.expect);
    assert_eq!(wide.expect.len(), 5);
    let narrow = judged(&ring(&[&windows("1e-6"), "node.2.state=0.5"]));
    assert_eq!(failed(&narrow), ["window.2.spread"]);
}

#[test]
fn a_window_of_the_reference_is_judged_too() {
    let window = |limit: &str| format!("expect.window=[{{from='1s',to='2s',reference_error={limit}}}]");
    assert!(judged(&gallery("five-agents.toml", &["time.duration=2s", &window("1e-3")])).passed);
    let narrow = judged(&gallery("five-agents.toml", &["time.duration=2s", &window("1e-9")]));
    assert_eq!(failed(&narrow), ["window.1.reference_error"]);
}

#[test]
fn what_is_judged_does_not_depend_on_the_rows() {
    for on in [Fidelity::Loopback, Fidelity::Reference] {
        let scenario = gallery("five-agents.toml", &["time.duration=1500ms"]);
        let summary = |every| {
            let outcome = simulate(&scenario, &options(on, Some(every))).unwrap();
            let summary = outcome.judge(&scenario, on);
            (summary.funnel, summary.sync, summary.max_input, summary.reference, summary.trace_hash)
        };
        assert_eq!(summary(1), summary(7), "{on}");
        assert_eq!(summary(1), summary(1500), "{on}");
    }
}

#[test]
fn the_last_tick_has_a_row_at_the_nearest_time() {
    let scenario = ring(&["time.duration=5s"]);
    let rows = simulate(&scenario, &options(Fidelity::Loopback, Some(3))).unwrap().rows;
    assert_eq!((rows[1].t, rows.last().unwrap().t), (0.003, 5.0));
}

#[test]
fn a_frame_that_comes_late_is_counted() {
    let summary = judged(&ring(&["bus.latency=4ms"]));
    let counters = summary.counters.unwrap();
    assert!(counters.late > 40_000 && summary.passed, "{counters:?}");
    assert_eq!(judged(&ring(&[])).counters.unwrap().late, 0);
}

#[test]
fn frames_that_are_older_than_a_node_takes_are_heard_by_nobody() {
    let summary = judged(&ring(&["bus.latency=20ms"]));
    assert!(failed(&summary).contains(&"heard".to_owned()), "{summary:?}");
    let text = &check(&summary, "heard").text;
    assert!(
        text.starts_with("no neighbour has ever heard node 1") && text.ends_with("1 more of the kind"),
        "{text}"
    );
}

#[test]
fn a_funnel_that_begins_very_narrow_and_opens_has_its_width_at_every_tick() {
    let opening = "coupling.funnel={kind='exponential',start=1e-6,end=100.0,rate=1.0}";
    let at_rest =
        ["agent.dynamics.slope=0", "node.1.dynamics.offset=0", "node.2.state=1e-7", "time.duration=20ms"];
    for policy in ["ride", "{kind='reopen',margin=2.0,rate=1.0}"] {
        let on_breach = format!("coupling.on_breach={policy}");
        let scenario = ring(&[&[opening, &on_breach, "expect.funnel_ratio=1.0"][..], &at_rest].concat());
        let summary = judged(&scenario);
        assert_eq!(failed(&summary), Vec::<String>::new(), "{policy}: {summary:?}");
        // nu = 1e-7 or twice that, in 1e-6.
        assert!((summary.funnel.unwrap().max_ratio - 0.2).abs() < 1e-6 && summary.max_input.is_finite());
    }
}
