//! Events in loopback: what they do to nodes and links, and worlds in which a verdict must not be fooled by
//! them.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic)]

use funnelnet_law::math;
use funnelnet_node::Event;
use funnelnet_protocol::message::NodeId;
use sim_host::exit::Exit;
use sim_host::interrupt::Interrupt;
use sim_host::record::{Row, Summary, TraceHash};
use sim_host::run::{Fidelity, Outcome, RunOptions, Verbosity, simulate};
use sim_host::scenario::{Override, Scenario};
use std::path::{Path, PathBuf};

/// A ring of five in a constant funnel of 2; two nodes are driven apart.
const RING: &str = r#"
version = 1
[time]
tick = "1ms"
duration = "1s"
[graph]
kind = "ring"
nodes = 5
[coupling]
kind = "node-wise"
gain = { kind = "reciprocal", scale = 1.0 }
funnel = { kind = "exponential", start = 9.0, end = 2.0, rate = 3.0 }
[agent]
dynamics = { kind = "affine", slope = -1.0 }
[[node]]
id = 1
state = 0.5
dynamics = { offset = 2 }
[[node]]
id = 3
state = -0.25
dynamics = { offset = -2 }
"#;

fn parsed(text: &str, events: &str, sets: &[&str]) -> Scenario {
    let sets: Vec<_> = sets.iter().map(|set| Override::parse(set).unwrap()).collect();
    let text = format!("event = [{events}]\n{text}");
    Scenario::parse(&text, Path::new("ring.toml"), &sets).unwrap_or_else(|errors| panic!("{errors}"))
}

fn ring(events: &str, sets: &[&str]) -> Scenario {
    parsed(RING, events, sets)
}

fn options(on: Fidelity) -> RunOptions {
    RunOptions {
        on,
        out: None,
        every_ticks: Some(1),
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
    simulate(scenario, &options(Fidelity::Loopback)).unwrap_or_else(|error| panic!("{error}"))
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

/// Ticks at which the state of a node is not known, by id.
fn gaps(outcome: &Outcome, id: usize) -> Vec<usize> {
    (0..outcome.rows.len()).filter(|&k| outcome.rows[k].x[id - 1].is_nan()).collect()
}

fn range(from: usize, to: usize) -> Vec<usize> {
    (from..to).collect()
}

/// What nodes have said, by id, with the tick at which they did.
fn said(outcome: &Outcome, id: usize) -> Vec<(u64, Event)> {
    let of = outcome.events.iter().filter(|event| event.node + 1 == id);
    of.map(|event| (event.at.saturating_sub(1_000_000) / 1_000_000, event.event)).collect()
}

#[test]
fn nothing_is_different_before_the_first_event() {
    let calm = outcome(&ring("", &[]));
    for event in [
        "{ at = '400ms', kind = 'crash', node = 2 }",
        "{ at = '400ms', kind = 'leave', node = 2 }",
        "{ at = '400ms', kind = 'bounce', node = 2 }",
        "{ at = '400ms', kind = 'partition', groups = [[1, 2], [3, 4, 5]] }",
    ] {
        let disturbed = outcome(&ring(event, &[]));
        let states = |outcome: &Outcome, to: usize| -> Vec<Vec<f64>> {
            outcome.rows[..to].iter().map(|row| row.x.clone()).collect()
        };
        assert_eq!(states(&calm, 400), states(&disturbed, 400), "{event}");
        assert_ne!(calm.rows[500].x[0], disturbed.rows[500].x[0], "{event}");
    }
}

#[test]
fn a_node_that_crashes_has_no_state_and_no_edge() {
    let run = outcome(&ring("{ at = '400ms', kind = 'crash', node = 2 }", &[]));
    assert_eq!(gaps(&run, 2), range(400, 1001));
    let Row { x, true_nu, nu, psi, u, .. } = &run.rows[700];
    assert!([x[1], true_nu[1], nu[1], psi[1], u[1]].iter().all(|value| value.is_nan()));
    // Node 1 has only node 5 left, and node 3 only node 4.
    assert!((true_nu[0] - (x[4] - x[0])).abs() < 1e-12 && (true_nu[2] - (x[3] - x[2])).abs() < 1e-12);
    // The neighbours extrapolate it as long as these wide funnels allow, at most for 120 ticks, and then
    // know.
    let summary = run.judge(&ring("", &[]), Fidelity::Loopback);
    assert_eq!(said(&run, 1).last().map(|(tick, _)| *tick), Some(521));
    assert!(
        summary.passed && summary.stopped.is_empty() && summary.funnel.unwrap().unknown == 0,
        "{summary:?}"
    );
    // It does not say that it goes.
    assert!(said(&run, 2).iter().all(|&(tick, _)| tick < 400));
}

#[test]
fn a_node_that_leaves_is_told_to_stop() {
    let scenario = ring("{ at = '400ms', kind = 'leave', node = 2 }", &[]);
    let run = outcome(&scenario);
    assert_eq!(gaps(&run, 2), range(400, 1001));
    assert_eq!(said(&run, 2).last(), Some(&(400, Event::Stopped)));
    // It says so, and nobody extrapolates it.
    let lost = (401, Event::NeighbourLost(NodeId::new(2).unwrap()));
    assert!([1, 3].iter().all(|&id| said(&run, id).contains(&lost)), "{:?}", said(&run, 1));
    assert_eq!(run.counters[0].extrapolated, 0);
    let summary = run.judge(&scenario, Fidelity::Loopback);
    assert!(summary.passed && summary.stopped.is_empty(), "{summary:?}");
}

#[test]
fn a_node_that_is_bounced_comes_back_with_its_stored_configuration_and_knows_the_tick() {
    let run = outcome(&ring("{ at = '400ms', kind = 'bounce', node = 3 }", &[]));
    assert_eq!(gaps(&run, 3), range(400, 500));
    // Its state was lost: it begins with the one that is configured, and hears nobody yet.
    assert_ne!(run.rows[399].x[2], -0.25);
    assert_eq!((run.rows[500].x[2], run.rows[500].nu[2]), (-0.25, 0.0));
    // A node that had begun at tick 0 again would be in a funnel of 9.
    let psi = |k: usize| 7.0 * math::exp(-0.003 * k as f64) + 2.0;
    assert!((run.rows[500].psi[2] - psi(500)).abs() < 1e-5, "{}", run.rows[500].psi[2]);
    let words = said(&run, 3);
    assert!(
        words.contains(&(500, Event::Started)) && words.contains(&(500, Event::SyncGap { missed: 500 })),
        "{words:?}"
    );
    // From the next tick on it hears its neighbours. They have extrapolated it all the time, and it was never
    // lost to them.
    let heard = |id: usize| {
        said(&run, id)
            .iter()
            .filter(|(tick, event)| *tick == 501 && matches!(event, Event::NeighbourFound(_)))
            .count()
    };
    assert_eq!([2, 3, 4].map(heard), [0, 2, 0]);
    // It takes their mean, and is one of them at once.
    assert!(
        words.contains(&(500, Event::Listens { tick: 500 }))
            && words.contains(&(501, Event::Joins { tick: 501 }))
    );
    assert!((run.rows[502].nu[2] - run.rows[502].true_nu[2]).abs() < 1e-4);
}

#[test]
fn a_short_bounce_between_two_ticks_takes_the_state_and_no_tick() {
    let run = outcome(&ring("{ at = '400.25ms', kind = 'bounce', node = 3, for = '500us' }", &[]));
    assert_eq!(gaps(&run, 3), range(0, 0));
    assert_eq!(run.rows[401].x[2], -0.25);
}

#[test]
fn a_node_whose_first_event_is_a_join_is_absent_from_the_start() {
    let scenario = ring("{ at = '400ms', kind = 'join', node = 2 }", &["node.2.state=3.0"]);
    let run = outcome(&scenario);
    assert_eq!(gaps(&run, 2), range(0, 400));
    assert_eq!(run.rows[400].x[1], 3.0);
    // Nobody has heard it, and nobody counts its edge.
    let Row { x, true_nu, nu, .. } = &run.rows[0];
    assert!((true_nu[0] - (x[4] - x[0])).abs() < 1e-12 && (nu[0] - true_nu[0]).abs() < 1e-6);
    let summary = run.judge(&scenario, Fidelity::Loopback);
    assert!(failed(&summary).is_empty(), "{:?}", summary.checks);
}

#[test]
fn a_node_may_go_and_come_again() {
    let events = "{ at = '100ms', kind = 'crash', node = 2 }, { at = '200ms', kind = 'join', node = 2 }, \
                  { at = '300ms', kind = 'leave', node = 2 }, { at = '400ms', kind = 'join', node = 2 }, \
                  { at = '500ms', kind = 'bounce', node = 2, for = '50ms' }";
    let run = outcome(&ring(events, &[]));
    assert_eq!(gaps(&run, 2), [range(100, 200), range(300, 400), range(500, 550)].concat());
}

#[test]
fn time_goes_on_while_nobody_is_there() {
    let events = "{ at = '0s', kind = 'crash', nodes = [1, 2, 3, 4, 5] }, { at = '300ms', kind = 'join', nodes = [1, 2, 3, 4, 5] }";
    let scenario = ring(events, &[]);
    let run = outcome(&scenario);
    assert!((1..=5).all(|id| gaps(&run, id) == range(0, 300)));
    let psi = 7.0 * math::exp(-0.9) + 2.0;
    assert!((run.rows[300].psi[0] - psi).abs() < 1e-5);
    assert!(failed(&run.judge(&scenario, Fidelity::Loopback)).is_empty());
}

const HALVES: &str = "{ at = '300ms', kind = 'partition', groups = [[1, 2], [3, 4, 5]] }";
const MENDED: &str = "{ at = '600ms', kind = 'repair' }";

/// Two halves that are driven 60 apart.
const APART: &[&str] = &["node.1.dynamics.offset=30", "node.2.dynamics.offset=30", "coupling.gain.scale=20"];

#[test]
fn the_links_of_a_partition_carry_nothing_and_count_all_the_same() {
    let run = outcome(&ring(HALVES, APART));
    let Row { x, true_nu, nu, psi, .. } = &run.rows[599];
    // Node 2 believes that there is only node 1.
    assert!((nu[1] - (x[0] - x[1])).abs() < 1e-3 && nu[1].abs() < psi[1]);
    assert!((true_nu[1] - (x[0] + x[2] - 2.0 * x[1])).abs() < 1e-12 && true_nu[1].abs() > 2.0 * psi[1]);
    let summary = judged(&ring(HALVES, &[APART, &["expect.funnel_ratio=1.0"]].concat()));
    assert_eq!(failed(&summary), ["funnel_ratio"]);
}

#[test]
fn a_repair_mends_what_it_names() {
    let events = format!("{HALVES}, {{ at = '600ms', kind = 'repair', link = [2, 3] }}");
    let run = outcome(&ring(&events, APART));
    let found = |id: usize| {
        said(&run, id).iter().any(|(tick, event)| *tick == 601 && matches!(event, Event::NeighbourFound(_)))
    };
    assert_eq!([1, 2, 3, 4, 5].map(found), [false, true, true, false, false]);
}

#[test]
fn a_frame_that_is_under_way_when_a_link_is_cut_is_lost() {
    let cut = |at: &str| format!("{{ at = '{at}', kind = 'partition', link = [1, 2] }}");
    // What node 1 has sent at tick 400 arrives 0.5 ms later.
    let extrapolated = |at: &str| {
        let run = outcome(&ring(&cut(at), &["bus.latency=500us", "time.duration=401ms"]));
        run.counters[1].extrapolated
    };
    assert_eq!((extrapolated("400.4ms"), extrapolated("400.6ms")), (1, 0));
}

#[test]
fn ticks_that_events_disturb_are_counted_by_themselves() {
    let events = format!("{HALVES}, {MENDED}");
    let expect = ["expect.funnel_ratio=1.0", "expect.recovered_within=200ms"];
    let scenario = ring(&events, &[APART, &expect].concat());
    let run = outcome(&scenario);
    let summary = run.judge(&scenario, Fidelity::Loopback);
    assert_eq!(failed(&summary), Vec::<String>::new(), "{summary:?}");
    let funnel = summary.funnel.unwrap();
    let during = funnel.during_events.unwrap();
    // From tick 300 to the one before 800.
    assert_eq!((during.node_ticks, funnel.breaches), (500 * 5, 0));
    assert!(during.breaches > 500 && during.max_ratio > 2.0 && funnel.max_ratio < 1.0, "{funnel:?}");
    let recovered = summary.expect.iter().find(|found| found.name == "recovered_within").unwrap();
    let last = (0..=1000).rev().find(|&k| is_outside(&run.rows[k])).unwrap();
    assert_eq!(recovered.value, Some((last - 600) as f64 / 1e3));
    assert!((601..620).contains(&last), "{last}");
}

fn is_outside(row: &Row) -> bool {
    row.true_nu.iter().zip(&row.asked_psi).any(|(nu, psi)| nu.abs() >= *psi)
}

#[test]
fn a_network_that_takes_too_long_fails_by_both() {
    let events = format!("{HALVES}, {MENDED}");
    let expect = ["expect.funnel_ratio=1.0", "expect.recovered_within=1ms"];
    let summary = judged(&ring(&events, &[APART, &expect].concat()));
    assert_eq!(failed(&summary), ["funnel_ratio", "recovered_within"]);
}

#[test]
fn a_network_that_never_recovers_has_not_recovered_within_any_time() {
    // The crash of node 3 is over at once; what comes is the driven nodes' own doing, at which no tick is
    // disturbed any more.
    let sets = ["coupling.kind=none", "node.1.dynamics.offset=60", "expect.recovered_within=200ms"];
    let summary = judged(&ring("{ at = '300ms', kind = 'crash', node = 3 }", &sets));
    let recovered = summary.expect.iter().find(|found| found.name == "recovered_within").unwrap();
    assert_eq!((recovered.value, recovered.pass), (None, false));
    assert!(summary.funnel.unwrap().breaches > 0);
}

#[test]
fn without_an_expected_recovery_every_tick_counts() {
    let events = format!("{HALVES}, {MENDED}");
    let funnel = judged(&ring(&events, APART)).funnel.unwrap();
    assert!(funnel.during_events.is_none() && funnel.max_ratio > 2.0 && funnel.breaches > 500);
}

#[test]
fn an_event_excuses_no_node_that_stops_by_itself() {
    // Node 2 crashes, and its neighbours stop for it.
    let events = "{ at = '300ms', kind = 'crash', node = 2 }";
    let summary = judged(&ring(events, &["safety.lost_neighbours=1"]));
    assert!(summary.stopped.starts_with(&[1, 3]), "{:?}", summary.stopped);
    assert!(failed(&summary).contains(&"stopped".to_owned()));
    // Nor does it excuse what was before it.
    let runaway = &["node.2.dynamics.slope=200", "node.2.state=0.1", "coupling.kind=none"][..];
    let summary = judged(&ring("{ at = '900ms', kind = 'crash', node = 2 }", runaway));
    assert_eq!(summary.stopped, [2]);
    assert!(failed(&summary).contains(&"stopped".to_owned()));
}

#[test]
fn a_network_whose_bus_delivers_nothing_is_not_excused_by_its_events() {
    let events = format!("{HALVES}, {MENDED}, {{ at = '700ms', kind = 'bounce', node = 4 }}");
    let summary = judged(&ring(&events, &["bus.loss=1.0"]));
    assert!(failed(&summary).contains(&"heard".to_owned()), "{:?}", summary.checks);
}

#[test]
fn a_node_that_events_keep_apart_at_the_end_is_not_silent() {
    let apart = "{ at = '300ms', kind = 'partition', groups = [[1], [2, 3, 4, 5]] }";
    let summary = judged(&ring(apart, &["node.1.dynamics.offset=0"]));
    assert_eq!(failed(&summary), Vec::<String>::new(), "{:?}", summary.checks);
}

#[test]
fn the_hash_has_a_fixed_value_where_a_node_is_off() {
    let run = outcome(&ring("{ at = '400ms', kind = 'bounce', node = 2 }", &[]));
    let mut hash = TraceHash::new();
    for x in run.rows.iter().flat_map(|row| &row.x) {
        hash.push(if x.is_nan() { f32::from_bits(0x7fc0_0000) } else { *x as f32 });
    }
    assert_eq!(run.hash, Some(hash));
    let again = outcome(&ring("{ at = '400ms', kind = 'bounce', node = 2 }", &[]));
    assert_eq!(again.hash, run.hash);
    let later = outcome(&ring("{ at = '401ms', kind = 'bounce', node = 2 }", &[]));
    assert_ne!(later.hash, run.hash);
}

#[test]
fn every_component_of_a_node_goes_and_comes() {
    let sets =
        ["agent.state=[1.0, -1.0]", "node.1.state=[2.0, 1.0]", "node.3.state=0.5", "expect.final_spread=9.0"];
    let scenario = ring(
        "{ at = '400ms', kind = 'bounce', node = 2 }, { at = '900ms', kind = 'leave', node = 4 }",
        &sets,
    );
    let run = outcome(&scenario);
    let known = |k: usize| run.rows[k].x.iter().map(|x| !x.is_nan()).collect::<Vec<_>>();
    let all_but = |id: usize| (0..10).map(|at| at / 2 + 1 != id).collect::<Vec<_>>();
    assert_eq!(
        [399, 400, 499, 500, 950].map(known),
        [all_but(0), all_but(2), all_but(2), all_but(0), all_but(4)]
    );
    assert_eq!((run.rows[500].x[2], run.rows[500].x[3]), (1.0, -1.0));
    let summary = run.judge(&scenario, Fidelity::Loopback);
    assert!(failed(&summary).is_empty() && summary.sync.unwrap().final_spread.is_finite(), "{summary:?}");
}

#[test]
fn the_distance_to_a_final_value_is_that_of_the_nodes_that_are_there() {
    let leaves = "{ at = '400ms', kind = 'leave', node = 1 }";
    let summary = judged(&ring(leaves, &["expect.final_value={is=0.0,within=2.0}"]));
    assert!(summary.passed && summary.sync.unwrap().bound.is_nan(), "{summary:?}");
    let nobody = "{ at = '400ms', kind = 'leave', nodes = [1, 2, 3, 4, 5] }";
    let summary = judged(&ring(nobody, &["expect.final_value={is=0.0,within=2.0}"]));
    assert!(failed(&summary).contains(&"measured".to_owned()), "{summary:?}");
}

/// What was expected of a ring and was not measured.
fn unmeasured(summary: &Summary) -> Vec<&str> {
    let none = summary.expect.iter().filter(|expectation| expectation.value.is_none());
    assert!(summary.expect.iter().all(|expectation| expectation.value.is_some() || !expectation.pass));
    none.map(|expectation| expectation.name.as_str()).collect()
}

const ALL: [&str; 4] = [
    "expect.final_spread=9.0",
    "expect.emergent_error=9.0",
    "expect.blended_error=9.0",
    "expect.recovered_within='400ms'",
];

#[test]
fn where_nobody_is_left_nothing_passes_and_words_say_so() {
    let nobody = "{ at = '400ms', kind = 'crash', nodes = [1, 2, 3, 4, 5] }";
    let window =
        "expect.window=[{from='500ms',to='1s',funnel_ratio=1.0,spread=9.0,emergent_error=9.0,max_input=9.0}]";
    let summary =
        judged(&ring(nobody, &[&ALL[..], &[window, "expect.final_value={is=0.0,within=2.0}"]].concat()));
    let expected = [
        "final_spread",
        "emergent_error",
        "blended_error",
        "final_value",
        "recovered_within",
        "window.1.funnel_ratio",
        "window.1.spread",
        "window.1.emergent_error",
        "window.1.max_input",
    ];
    assert_eq!(unmeasured(&summary), expected);
    let text = summary.to_string();
    assert!(text.contains("final spread not known, no bound"), "{text}");
    assert!(text.contains("final distance not known to xi = ") && !text.contains("NaN"), "{text}");
}

#[test]
fn a_survivor_without_a_link_is_in_step_with_nobody() {
    let others = "{ at = '400ms', kind = 'crash', nodes = [2, 3, 4, 5] }";
    let window = "expect.window=[{from='500ms',to='1s',funnel_ratio=1.0,spread=9.0,max_input=9.0}]";
    let scenario = ring(others, &[&ALL[..], &[window, "expect.funnel_ratio=1.0"]].concat());
    let outcome = outcome(&scenario);
    let summary = outcome.judge(&scenario, Fidelity::Loopback);
    let expected = ["final_spread", "recovered_within", "window.1.funnel_ratio", "window.1.spread"];
    assert_eq!(unmeasured(&summary), expected, "what it does by itself is known: {summary}");
    assert_eq!(summary.funnel.unwrap().uncoupled, 601);
    assert!(summary.to_string().contains("; no neighbour at 601 node-ticks"), "{summary}");
    assert!(outcome.rows[700].true_nu[0].is_nan() && outcome.rows[300].true_nu[0].is_finite());
}

#[test]
fn who_joins_in_a_partition_recovers_from_its_end() {
    let comes = "{ at = '200ms', kind = 'crash', node = 5 }, { at = '350ms', kind = 'join', node = 5 }";
    let scenario = ring(
        &format!("{HALVES}, {MENDED}, {comes}"),
        &[APART, &["expect.recovered_within='200ms'"]].concat(),
    );
    let outcome = outcome(&scenario);
    let last = outcome.rows.iter().rposition(is_outside).expect("they are driven apart");
    assert!(last > 600 && is_outside(&outcome.rows[599]), "{last}");
    let summary = outcome.judge(&scenario, Fidelity::Loopback);
    let found = summary.expect.iter().find(|expectation| expectation.name == "recovered_within");
    // Not from 350 ms on, when it came.
    assert_eq!(found.and_then(|expectation| expectation.value), Some((last - 600) as f64 / 1e3), "{summary}");
}

#[test]
fn an_edge_of_its_own_funnel_is_gone_with_its_node() {
    let run = outcome(&ring("{ at = '400ms', kind = 'crash', node = 2 }", &["coupling.kind=edge-wise"]));
    let Row { x, true_nu, .. } = &run.rows[700];
    assert!((true_nu[0] - (x[4] - x[0])).abs() < 1e-12);
}

/// A bus on which all frames of a tick arrive within it.
const ON_CAN: &[&str] = &["bus.model=can", "bus.bitrate=1000000"];
const CAN_FD: &[&str] = &["bus.model=can-fd", "bus.bitrate=1000000"];

/// What events do on the wire is what they do without one, to the bit of each state: who is off sends nothing
/// and hears nothing, and the links that are cut carry nothing. Who comes at a tick takes part too late for
/// its first frame, and knows that neighbour a tick later.
#[test]
fn events_on_can_are_those_of_the_ideal_bus_where_frames_are_in_time() {
    for (events, comes) in [
        ("{ at = '300ms', kind = 'crash', node = 2 }, { at = '600ms', kind = 'join', node = 2 }", Some(600)),
        ("{ at = '300ms', kind = 'bounce', node = 3 }", None),
        ("{ at = '300ms', kind = 'leave', node = 2 }", None),
        ("{ at = '300ms', kind = 'leave', node = 2 }, { at = '600ms', kind = 'join', node = 2 }", Some(600)),
        ("{ at = '300ms', kind = 'join', node = 2 }", Some(300)),
        (
            "{ at = '300ms', kind = 'partition', groups = [[1, 2], [3, 4, 5]] }, { at = '600ms', kind = 'repair' }",
            None,
        ),
    ] {
        let expect = ["expect.funnel_ratio=1.0", "expect.recovered_within=200ms"];
        let judged = |bus: &[&str]| {
            let scenario = ring(events, &[APART, &expect, bus].concat());
            let run = outcome(&scenario);
            let summary = run.judge(&scenario, Fidelity::Loopback);
            let funnel = summary.funnel.as_ref().unwrap();
            assert!(funnel.during_events.is_some(), "{bus:?} {events}");
            (states(&run), format!("{funnel:?} {:?}", summary.expect), failed(&summary))
        };
        let (ideal, summary, failed) = judged(&[]);
        for bus in [ON_CAN, CAN_FD] {
            let (on_can, can_summary, can_failed) = judged(bus);
            let first = (0..ideal.len()).find(|&k| ideal[k] != on_can[k]);
            if let Some(comes) = comes {
                assert_eq!(first, Some(comes + 1), "{bus:?} {events}");
                assert_eq!(can_failed, failed, "{bus:?} {events}");
            } else {
                assert_eq!((first, &can_summary), (None, &summary), "{bus:?} {events}");
            }
        }
    }
}

/// Bits of all states, tick by tick.
fn states(outcome: &Outcome) -> Vec<Vec<u64>> {
    outcome.rows.iter().map(|row| row.x.iter().map(|x| x.to_bits()).collect()).collect()
}

/// Worlds that must fail on CAN: nobody mends it, and too little time to recover.
#[test]
fn a_network_on_can_that_does_not_recover_in_time_fails() {
    let expect = |within: &'static str| [APART, ON_CAN, &["expect.funnel_ratio=1.0", within]].concat();
    let mended = format!("{HALVES}, {MENDED}");
    let in_time = judged(&ring(&mended, &expect("expect.recovered_within=200ms")));
    assert!(failed(&in_time).is_empty(), "{:?}", failed(&in_time));
    let late = judged(&ring(&mended, &expect("expect.recovered_within=1ms")));
    assert!(failed(&late).contains(&"recovered_within".to_owned()), "{:?}", failed(&late));
}

/// A node that leaves has its goodbye on the wire before it goes; one that crashes has not.
#[test]
fn a_node_that_leaves_on_can_says_so_and_one_that_crashes_does_not() {
    let lost_at = |kind: &str| {
        let run = outcome(&ring(&format!("{{ at = '400ms', kind = '{kind}', node = 2 }}"), ON_CAN));
        assert_eq!(gaps(&run, 2), range(400, 1001), "{kind}");
        let two = NodeId::new(2).unwrap();
        [1, 3].map(|id| {
            said(&run, id).iter().find(|(_, event)| *event == Event::NeighbourLost(two)).map(|(at, _)| *at)
        })
    };
    assert_eq!(lost_at("leave"), [Some(401), Some(401)]);
    assert_eq!(lost_at("crash"), [Some(521), Some(521)]);
}

#[test]
fn a_serial_line_refuses_events() {
    let text = format!("event = [{{ at = '400ms', kind = 'crash', node = 2 }}]\n{RING}");
    let uart = Override::parse("bus.model=uart").unwrap();
    let errors = Scenario::parse(&text, Path::new("ring.toml"), &[uart]).unwrap_err();
    assert!(errors.to_string().contains("events happen on the ideal bus and on CAN"), "{errors}");
}

#[test]
fn who_cannot_make_events_refuses_them() {
    for (on, event) in [
        (Fidelity::Emulator, "{ at = '400ms', kind = 'sensor', node = 2, offset = 1.0 }"),
        (Fidelity::Reference, "{ at = '400ms', kind = 'crash', node = 2 }"),
    ] {
        let error = simulate(&ring(event, &[]), &options(on)).unwrap_err();
        assert_eq!(error.exit, Exit::BadInput);
        assert!(error.message.contains("[[event]]") && error.message.contains("--on loopback"), "{error}");
    }
    let compared = ring("{ at = '400ms', kind = 'crash', node = 2 }", &["expect.reference_error=1.0"]);
    assert!(
        simulate(&compared, &options(Fidelity::Loopback)).is_err_and(|error| error.exit == Exit::BadInput)
    );
}

/// The funnel of node 1 that it has and the one that it is judged by at a row, and the number of predictions there.
fn funnels(row: &Row) -> (f64, f64, usize) {
    (row.psi[0], row.asked_psi[0], row.xi.len() + row.blended.len())
}

#[test]
fn a_funnel_that_is_set_is_that_of_the_row_from_its_tick_on_and_xi_goes_on() {
    let events =
        "{ at = '600ms', kind = 'set', key = 'coupling.funnel', value = { kind = 'constant', width = 1.5 } }";
    let outcome = outcome(&ring(events, &[]));
    for k in 0..=1000 {
        let expected = if k < 600 { 2.0 + 7.0 * math::exp(-3e-3 * k as f64) } else { 1.5 };
        let (own, asked, predictions) = funnels(&outcome.rows[k]);
        assert!((own - expected).abs() < 1e-5 && (asked - expected).abs() < 1e-9, "{k}: {own} {asked}");
        assert_eq!(predictions, 2, "{k}");
    }
}

#[test]
fn where_a_load_is_set_predictions_end_and_what_is_expected_of_them_is_not_measured() {
    let events = "{ at = '600ms', kind = 'set', key = 'agent.dynamics.offset', value = 1.0, nodes = [2, 4] }";
    let scenario = ring(events, &["expect.emergent_error=1e9", "expect.final_spread=1e9"]);
    let outcome = outcome(&scenario);
    for (k, row) in outcome.rows.iter().enumerate() {
        assert_eq!(funnels(row).2, if k < 600 { 2 } else { 0 }, "{k}");
    }
    let summary = outcome.judge(&scenario, Fidelity::Loopback);
    assert_eq!(failed(&summary), ["emergent_error"]);
    let emergent = summary.emergent.unwrap();
    assert!(emergent.xi_final.is_none() && emergent.final_error.is_none());
    assert!(emergent.unresolved.unwrap().contains("an event sets at 0.6 s what the network moves by"));
}

/// Rows between two rounds follow from the fields that nodes have there.
#[test]
fn between_two_rounds_states_go_by_the_field_that_is_set() {
    let events = "{ at = '600ms', kind = 'set', key = 'agent.dynamics.offset', value = 100.0 }";
    let outcome = outcome(&ring(events, &["time.round=5ms"]));
    let steps = outcome.rows.windows(2).map(|rows| (rows[1].x[1] - rows[0].x[1]).abs());
    // A hundred per second in ticks of 1 ms; by the old field five of them would come at once.
    let largest = steps.fold(0.0, f64::max);
    assert!((0.08..0.12).contains(&largest), "{largest}");
}
