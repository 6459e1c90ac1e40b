//! Each oracle is shown what must not be, and has to say so.
#![allow(clippy::panic, reason = "helpers of tests, which clippy does not know as such")]

use super::clocks::together;
use super::commits::Adoptions;
use super::inputs::within_bounds;
use super::model::{Fate, Listener};
use super::motion::Motion;
use super::widths::Widths;
use super::{Broken, foretold, is_foretold, run_as};
use funnelnet_node::{Event, Observation};
use sim_host::check;
use sim_host::engine::{NodeEvent, Skew};
use sim_host::judge::Moment;
use sim_host::presence::Presence;
use sim_host::scenario::Scenario;
use std::path::Path;

const RAN: [Presence; 3] = [Presence::Ran; 3];

fn read(rest: &str) -> Scenario {
    let text = format!(
        "version = 1\nseed = 1\ntime = {{ tick = \"1ms\", duration = \"1s\" }}\ngraph = {{ kind = \"path\", nodes = 3 }}\n\
         coupling.kind = \"node-wise\"\ncoupling.gain = {{ kind = \"reciprocal\", scale = 1.0 }}\n\
         coupling.funnel = {{ kind = \"constant\", width = 0.5 }}\nagent.dynamics = {{ kind = \"affine\", slope = -1.0 }}\n{rest}"
    );
    Scenario::parse(&text, Path::new("oracle.toml"), &[]).unwrap_or_else(|errors| panic!("{errors}\n{text}"))
}

fn moment<'a>(k: u64, x: &'a [f64], u: &'a [f64]) -> Moment<'a> {
    Moment { k, part: 0, x, u, presence: &RAN }
}

const SET: &str =
    "[[event]]\nat = \"10ms\"\nkind = \"set\"\nnode = 1\nkey = \"coupling.funnel.width\"\nvalue = 0.25\n";

fn adopted(node: usize, tick: u32) -> [NodeEvent; 1] {
    [NodeEvent { at: 0, node, event: Event::Adopted { tick } }]
}

#[test]
fn an_input_beyond_its_bound_is_found_at_both_ends() {
    let scenario = read("coupling.u_max = 2.0\nagent.limits = { low = -1.0, high = 3.0 }\n");
    let adoptions = Adoptions::of(&scenario);
    let look = |u: f64| within_bounds(&scenario, &moment(5, &[0.0; 3], &[0.0, u, 0.0]), &adoptions);
    assert_eq!([look(2.0), look(-1.0)], [Ok(()), Ok(())]);
    assert_eq!(look(2.001), Err(Broken::Input(5, 1, 2.001)));
    assert_eq!(look(-1.001), Err(Broken::Input(5, 1, -1.001)));
}

#[test]
fn who_adopts_at_another_tick_or_what_is_not_staged_is_found() {
    let scenario = read(SET);
    let take = |node, tick| Adoptions::of(&scenario).take(&RAN, &adopted(node, tick));
    assert_eq!(take(0, 10), Ok(()));
    assert_eq!([take(0, 11), take(1, 10)], [Err(Broken::Adopted(0)), Err(Broken::Adopted(1))]);
}

#[test]
fn a_funnel_that_is_not_the_one_of_the_configuration_is_found() {
    let scenario = read(SET);
    let mut adoptions = Adoptions::of(&scenario);
    let look = |adoptions: &Adoptions<'_>, k, psi| {
        let seen =
            [psi, 0.5, 0.5].map(|psi| Observation { tick: 0, x: 0.0, nu: 0.0, psi, ratio: 0.0, u: 0.0 });
        Widths::of(&scenario).tick(&moment(k, &[0.0; 3], &[0.0; 3]), (&seen, &[]), adoptions)
    };
    assert_eq!([look(&adoptions, 9, 0.5), look(&adoptions, 9, 0.25)], [Ok(()), Err(Broken::Width(9, 0))]);
    assert_eq!(adoptions.take(&RAN, &adopted(0, 10)), Ok(()));
    assert_eq!([look(&adoptions, 10, 0.25), look(&adoptions, 10, 0.5)], [Ok(()), Err(Broken::Width(10, 0))]);
}

#[test]
fn a_state_that_goes_another_way_than_field_and_input_is_found() {
    let scenario = read("");
    let adoptions = Adoptions::of(&scenario);
    let look = |next: f64| {
        let mut motion = Motion::of(&scenario);
        let first = motion.tick(&moment(7, &[1.0, 0.0, 0.0], &[3.0, 0.0, 0.0]), &[], &adoptions);
        first.and_then(|()| motion.tick(&moment(8, &[next, 0.0, 0.0], &[0.0; 3]), &[], &adoptions))
    };
    // x' = -x + 3 for a millisecond.
    assert_eq!(look(1.001_999), Ok(()));
    assert_eq!([look(1.003), look(0.999)], [Err(Broken::Moved(8, 0)), Err(Broken::Moved(8, 0))]);
}

#[test]
fn clocks_that_are_apart_are_found_and_sooner_where_nothing_keeps_sync_away() {
    let clocks = "bus.model = \"can\"\nclock.drift_ppm = 50.0\nsync = { period = \"50ms\", masters = [1] }\n";
    let apart =
        |scenario: &Scenario, worst_ns| together(scenario, Some(Skew { worst_ns, ..Skew::default() }));
    let quiet = read(clocks);
    assert_eq!([apart(&quiet, 5_000), apart(&quiet, 60_000)], [Ok(true), Err(Broken::Apart(60_000))]);
    let dark = read(&format!("{clocks}[[event]]\nat = \"200ms\"\nkind = \"sync-loss\"\nfor = \"300ms\"\n"));
    assert_eq!([apart(&dark, 60_000), apart(&dark, 200_000)], [Ok(true), Err(Broken::Apart(200_000))]);
}

#[test]
fn a_run_that_is_not_as_check_has_followed_it_is_found() {
    let scenario = read("[[node]]\nid = 1\nstate = 0.3\n[[node]]\nid = 3\ndynamics = { offset = 0.5 }\n");
    let Some(law) = foretold(&scenario, &check::check(&scenario)) else {
        panic!("check has not followed it")
    };
    assert_eq!(is_foretold(&law, (law.ratio, law.input, Some(law.spread))), Ok(()));
    let other = |ratio: f64, input: f64, spread: f64| {
        is_foretold(&law, (law.ratio * ratio, law.input * input, Some(law.spread * spread))).is_err()
    };
    assert!(other(1.01, 1.0, 1.0) && other(1.0, 1.05, 1.0) && other(1.0, 1.0, 0.95));
}

#[test]
fn the_second_form_of_the_rule_bars_after_so_many_states_and_no_sooner() {
    let scenario = read("coupling.u_max = 5.0\nsafety = { heard_rate = 10.0, drop_after = 3 }\n");
    let mut listener = Listener::of((0, 0.0));
    let mut hears = |k, x| listener.hears((k, x), &scenario.safety, 1e-3, 0.0);
    assert_eq!([hears(1, 1.0), hears(2, 1.0), hears(3, 0.0)], [Fate::Goes; 3]);
    assert_eq!([hears(4, 1.0), hears(5, 1.0), hears(6, 1.0)], [Fate::Goes, Fate::Goes, Fate::Bars]);
}

/// What is found where a network has these lines, and should have those.
fn found(should: &str, does: &str) -> Option<Broken> {
    run_as(&read(should), &read(should)).unwrap_or_else(|broken| panic!("{broken}"));
    run_as(&read(should), &read(does)).err()
}

const LIMITS: &str = "coupling.u_max = 5.0\nsafety = { heard_rate = 10.0, drop_after = 10 }\n";
const LIE: &str = "[[event]]\nat = \"200ms\"\nkind = \"liar\"\nnode = 2\nfor = \"100ms\"\nconstant = 3.0\n";

#[test]
fn nodes_with_other_limits_than_the_scenario_says_are_found() {
    let should = format!("{LIMITS}{LIE}");
    let with =
        |limits: &str| found(&should, &format!("coupling.u_max = 5.0\nsafety = {{ {limits} }}\n{LIE}"));
    let late = with("heard_rate = 10.0, drop_after = 11");
    assert!(matches!(late, Some(Broken::Unnoticed(_, _, 1))), "{late:?}");
    let trusting = with("heard_rate = 1e6, drop_after = 10");
    assert!(matches!(trusting, Some(Broken::Unnoticed(_, _, 1))), "{trusting:?}");
    let early = with("heard_rate = 10.0, drop_after = 8");
    assert!(matches!(early, Some(Broken::Wronged(_, _, 1))), "{early:?}");
}

#[test]
fn an_honest_node_that_is_called_too_fast_is_found() {
    let moves = "[[node]]\nid = 1\ndynamics = { offset = 2.0 }\n";
    let broken = found(
        &format!("{LIMITS}{moves}"),
        &format!("coupling.u_max = 5.0\nsafety = {{ heard_rate = 0.1, drop_after = 10 }}\n{moves}"),
    );
    assert!(matches!(broken, Some(Broken::Wronged(_, _, 0))), "{broken:?}");
}

#[test]
fn a_node_that_has_started_anew_and_is_not_heard_is_found() {
    let long = |rest: &str| {
        format!("{LIMITS}{LIE}[[event]]\nat = \"350ms\"\n{rest}").replace("constant = 3.0", "constant = -3.0")
    };
    let bounce = |ms: u32| long(&format!("kind = \"bounce\"\nnode = 2\nfor = \"{ms}ms\"\n"));
    let cut =
        long("kind = \"partition\"\ngroups = [[2], [1, 3]]\n[[event]]\nat = \"500ms\"\nkind = \"repair\"\n");
    let nothing = long("kind = \"burst\"\nfor = \"1ms\"\nloss = 0.001\n");
    for should in [bounce(50), bounce(150)] {
        let (scenario, does) = (during(&should), during(&nothing));
        run_as(&scenario, &scenario).unwrap_or_else(|broken| panic!("{broken}"));
        let broken = run_as(&scenario, &does).err();
        assert!(matches!(broken, Some(Broken::StillBarred(_, 1))), "{broken:?}");
    }
    // Who was silent for long is heard again, without a word.
    let seen = run_as(&during(&cut), &during(&cut)).unwrap_or_else(|broken| panic!("{broken}"));
    assert_eq!(seen.renewed, 1);
}

/// The same for long enough that a node may listen before it speaks.
fn during(rest: &str) -> Scenario {
    let mut scenario = read(rest);
    scenario.time.ticks = 1_500;
    scenario
}

#[test]
fn what_nodes_do_that_they_should_not_is_found_in_a_run() {
    let field = |slope: f64| {
        format!(
            "[[event]]\nat = \"500ms\"\nkind = \"set\"\nkey = \"agent.dynamics\"\nvalue = {{ kind = \"affine\", slope = {slope:?}, offset = 1.0 }}\n"
        )
    };
    let broken = found(&field(-1.0), &field(-1.1));
    assert!(matches!(broken, Some(Broken::Moved(..))), "{broken:?}");
    let broken = found(SET, &SET.replace("0.25", "0.3"));
    assert!(matches!(broken, Some(Broken::Width(10, 0))), "{broken:?}");
    let broken = found(SET, &SET.replace("10ms", "11ms"));
    assert_eq!(broken, Some(Broken::Adopted(0)));
    let moves = "[[node]]\nid = 1\ndynamics = { offset = 3.0 }\n";
    let broken = found(&format!("coupling.u_max = 0.5\n{moves}"), moves);
    assert!(matches!(broken, Some(Broken::Input(..))), "{broken:?}");
    let clocks = |ppm: &str| {
        format!(
            "bus.model = \"can\"\nclock.drift_ppm = {ppm}\nsync = {{ period = \"50ms\", masters = [1] }}\n"
        )
    };
    let broken = found(&clocks("20.0"), &clocks("1000.0"));
    assert!(matches!(broken, Some(Broken::Apart(_))), "{broken:?}");
}
