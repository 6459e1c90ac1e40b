//! Sensors and actuators that fail by an event: what a node does then, and that it is judged by what is so.
#![allow(clippy::unwrap_used, clippy::panic, reason = "helpers of tests, which clippy does not know as such")]

use funnelnet_law::math;
use funnelnet_node::{Event, Phase};
use funnelnet_protocol::message::FaultCode;
use funnelnet_sim::loopback::{can_bus, engine_on, ideal_bus, uart_bus};
use funnelnet_sim::{Scenario, Simulation, Verdict};
use std::path::Path;

/// A ring of five that differ, for 2 s: inside a funnel of 0.2 from 1 s on.
const RING: &str = r#"version = 1
time = { tick = "1ms", duration = "2s" }
graph = { kind = "ring", nodes = 5 }
coupling.kind = "node-wise"
coupling.gain = { kind = "reciprocal", scale = 1.0 }
coupling.funnel = { kind = "exponential", start = 10.0, end = 0.2, rate = 4.0 }
agent.dynamics = { kind = "affine", slope = -1.0, offset = 1.0 }
"#;
const DRIVEN: &str =
    "[[node]]\nid = 3\nstate = 0.5\ndynamics = { sines = [{ amplitude = 2.0, frequency = 3.0 }] }\n";

fn scenario(event: &str, rest: &str) -> Scenario {
    let expect = if event.is_empty() { "" } else { "expect = { recovered_within = \"500ms\" }\n" };
    let events = if event.is_empty() { String::new() } else { format!("event = [{{ {event} }}]\n") };
    let text = format!("{RING}{expect}{events}{rest}{DRIVEN}");
    Scenario::parse(&text, Path::new("ring.toml"), &[]).unwrap_or_else(|errors| panic!("{errors}"))
}

/// The states of all nodes at each tick as they are judged, and the verdict.
fn played(event: &str) -> (Vec<[f32; 5]>, Verdict) {
    let scenario = scenario(event, "");
    let mut simulation = Simulation::new(&scenario).unwrap();
    let mut states = Vec::new();
    while simulation.step().is_some() {
        states.push([1, 2, 3, 4, 5].map(|id| simulation.node(id)[0].x));
    }
    (states, simulation.verdict())
}

/// How far two runs are apart at most in the ticks `from..to`, and how far node 3 is.
fn apart(a: &[[f32; 5]], b: &[[f32; 5]], ticks: std::ops::Range<usize>) -> (f32, f32) {
    let pairs = || a[ticks.clone()].iter().zip(&b[ticks.clone()]);
    let all = pairs().flat_map(|(a, b)| a.iter().zip(b).map(|(a, b)| (a - b).abs())).fold(0.0, f32::max);
    (all, pairs().map(|(a, b)| (a[2] - b[2]).abs()).fold(0.0, f32::max))
}

#[test]
fn before_anything_fails_a_plant_moves_as_the_node_by_itself() {
    let (calm, _) = played("");
    let (states, _) = played("at = '1.3s', kind = 'actuator', node = 3, for = '200ms', effectiveness = 0");
    let (all, _) = apart(&states, &calm, 0..1300);
    assert!(all < 1e-3, "{all}");
    // A world in which nothing fails would pass as well.
    let (_, own) = apart(&states, &calm, 1300..1500);
    assert!(own > 1e-2, "{own}");
}

#[test]
fn an_offset_moves_the_true_state_by_as_much_and_the_verdict_sees_it() {
    let (calm, _) = played("");
    let (states, verdict) = played("at = '1s', kind = 'sensor', node = 3, for = '500ms', offset = 0.5");
    // The others are held where they agree by what node 3 says; it is less by the offset, and nearly all of that is its own.
    let at = 1490;
    let moved = calm[at][2] - states[at][2];
    let others = calm[at][0] - states[at][0];
    assert!((moved - others - 0.5).abs() < 0.1, "{moved} {others}");
    let events = &verdict.findings.events[0];
    assert!(events.during.max_ratio > 2.0, "{}", events.during.max_ratio);
    assert!(events.recovery.after_s().is_some_and(|s| s < 0.1), "{:?}", events.recovery);
    assert!(verdict.holds(), "{verdict}");
}

/// Its field drives it on, with its actuator in its safe position.
#[test]
fn the_plant_of_a_node_that_has_stopped_goes_on_and_is_judged() {
    let (states, verdict) = played("at = '1s', kind = 'sensor', node = 3, for = '200ms', loss = 1");
    assert_eq!(verdict.stops.len(), 1);
    let (stopped, end) = (states[1011][2], states[2000][2]);
    assert!((stopped - end).abs() > 0.3, "{stopped} {end}");
    // x' = -x + 1 + 2 sin 3t, of which the part that dies out has 1 s for it.
    let free = |t: f64| 1.0 + 2.0 * (math::sin(3.0 * t) - 3.0 * math::cos(3.0 * t)) / 10.0;
    let gone = (f64::from(stopped) - free(1.011)) * math::exp(-0.989);
    assert!((f64::from(end) - free(2.0) - gone).abs() < 2e-3, "{end}");
}

/// Then nobody is left that ticks.
#[test]
fn plants_go_on_where_all_nodes_have_stopped() {
    let (states, verdict) =
        played("at = '1s', kind = 'sensor', nodes = [1, 2, 3, 4, 5], for = '200ms', loss = 1");
    assert_eq!((states.len(), verdict.stops.len()), (2001, 5));
    let moved = (states[1100][2] - states[2000][2]).abs();
    assert!(moved > 0.3, "{moved}");
}

#[test]
fn a_sensor_without_a_value_stops_its_node_after_ten_ticks_and_half_of_them_do_not() {
    let stopped = |event: &str| {
        let scenario = scenario(event, "");
        let mut engine = engine_on(&scenario, ideal_bus(&scenario)).unwrap();
        engine.start();
        let mut at = None;
        for k in 0..=scenario.time.ticks {
            engine.advance();
            if at.is_none() && engine.nodes()[2].phase() == Phase::Faulted(FaultCode::PLANT) {
                at = Some(k);
            }
        }
        (at, engine.nodes()[2].counters().coasted)
    };
    // Ten samples may fail, and the node stops at the next one.
    assert_eq!(stopped("at = '1s', kind = 'sensor', node = 3, for = '200ms', loss = 1"), (Some(1010), 11));
    assert_eq!(stopped("at = '1s', kind = 'sensor', node = 3, for = '10ms', loss = 1"), (None, 10));
    let (at, coasted) = stopped("at = '1s', kind = 'sensor', node = 3, for = '200ms', loss = 0.3");
    assert!(at.is_none() && (40..80).contains(&coasted), "{at:?} {coasted}");
}

#[test]
fn a_sensor_that_is_stuck_old_or_noisy_leaves_its_mark_and_all_are_back_soon() {
    let (calm, _) = played("");
    for (fails, least) in [("ramp = 0.0", 1e-3), ("age = '20ms'", 1e-3), ("noise = 0.05", 1e-3)] {
        let (states, verdict) =
            played(&format!("at = '1s', kind = 'sensor', node = 3, for = '200ms', {fails}"));
        let (_, own) = apart(&states, &calm, 1000..1200);
        assert!(own > least, "{fails}: {own}");
        let (all, _) = apart(&states, &calm, 1900..2001);
        assert!(all < 0.05, "{fails}: {all}");
        assert!(verdict.holds(), "{fails}: {verdict}");
    }
}

/// The input that node 3 asks for is not the one that is judged.
#[test]
fn an_actuator_does_what_it_can_and_its_input_is_judged_so() {
    let applied = |fails: &str| {
        let scenario =
            scenario(&format!("at = '1s', kind = 'actuator', node = 3, for = '300ms', {fails}"), "");
        let mut engine = engine_on(&scenario, ideal_bus(&scenario)).unwrap();
        engine.start();
        let mut inputs = Vec::new();
        for _ in 0..=scenario.time.ticks {
            let done = engine.advance().unwrap()[2].u;
            inputs.push((done, engine.nodes()[2].inputs()[0]));
        }
        inputs
    };
    let of = |fails: &str| applied(fails)[1000..1300].to_vec();
    assert!(of("effectiveness = 0.5").iter().all(|(done, asked)| (done - 0.5 * asked).abs() < 1e-6));
    assert!(of("effectiveness = 0").iter().all(|(done, _)| done.abs() < 1e-9));
    let limited = of("limit = 0.3");
    assert!(limited.iter().all(|(done, _)| done.abs() <= 0.3));
    assert!(limited.iter().any(|(done, asked)| asked.abs() > 1.0 && (done.abs() - 0.3).abs() < 1e-6));
    assert!(of("constant = -1.5").iter().all(|(done, _)| (done + 1.5).abs() < 1e-6));
    let inputs = applied("ramp = 0.0");
    let last = inputs[999].0;
    assert!(inputs[1000..1300].iter().all(|(done, _)| (done - last).abs() < 1e-6) && last.abs() > 0.1);
    let differs = |k: usize| (inputs[k].0 - inputs[k].1).abs() > 1e-6;
    assert!((1000..1300).any(differs) && !(0..1000).chain(1300..2001).any(differs));
}

/// Node 3 asks for more and more, and nobody sees that nothing comes of it.
#[test]
fn an_actuator_that_fails_throws_nodes_out_and_all_are_inside_soon_after_it() {
    let ratio = |fails: &str| {
        let (_, verdict) =
            played(&format!("at = '1.2s', kind = 'actuator', node = 3, for = '300ms', {fails}"));
        let event = &verdict.findings.events[0];
        assert!(event.recovery.after_s().is_some_and(|s| s < 0.1), "{fails}: {:?}", event.recovery);
        assert!(verdict.holds() && verdict.stops.is_empty(), "{fails}: {verdict}");
        event.during.max_ratio
    };
    // Its input needs less than that.
    let whole = ratio("limit = 100");
    let (dead, away) = (ratio("effectiveness = 0"), ratio("constant = -10"));
    assert!(whole < 1.0 && dead > 1.5 && away > 1.5, "{whole} {dead} {away}");
}

/// What fails stands in the node: every bus carries it, and gives the same states.
#[test]
fn every_bus_has_sensors_and_actuators_that_fail() {
    let event = "at = '1s', kind = 'sensor', node = 3, for = '300ms', offset = 0.5";
    let states = |bus: &str| {
        let scenario = scenario(event, bus);
        let mut states: Vec<u32> = Vec::new();
        macro_rules! all {
            ($medium:expr) => {{
                let mut engine = engine_on(&scenario, $medium).unwrap();
                engine.start();
                for _ in 0..=scenario.time.ticks {
                    states.extend(engine.advance().unwrap().iter().map(|seen| seen.x.to_bits()));
                }
                assert!(engine.take_events().iter().all(|event| !matches!(event.event, Event::Fault(_))));
            }};
        }
        match bus {
            "" => all!(ideal_bus(&scenario)),
            bus if bus.contains("can-fd") => all!(can_bus::<funnelnet_link::Fd>(&scenario).unwrap()),
            bus if bus.contains("can") => all!(can_bus::<funnelnet_link::Classic>(&scenario).unwrap()),
            _ => all!(uart_bus(&scenario)),
        }
        states
    };
    let ideal = states("");
    for bus in ["bus.model = \"can\"\n", "bus.model = \"can-fd\"\n", "bus.model = \"uart\"\n"] {
        assert!(states(bus) == ideal, "{bus}");
    }
}

/// Two runs of chance are the same, and two nodes do not share it.
#[test]
fn what_is_drawn_follows_from_the_seed() {
    let noisy = "at = '1s', kind = 'sensor', nodes = [2, 3], for = '300ms', noise = 0.1";
    let (first, _) = played(noisy);
    assert!(first == played(noisy).0);
    let (lossy, _) = played("at = '1s', kind = 'sensor', nodes = [2, 3], for = '300ms', loss = 0.3");
    assert!(first != lossy);
}

/// A bounce takes the node's memory, and not what it moves: it comes back where its plant is.
#[test]
fn a_plant_goes_on_without_its_node() {
    let text = format!(
        "{RING}event = [{{ at = '1s', kind = 'bounce', node = 3, for = '300ms' }}, {{ at = '1.1s', kind = 'actuator', node = 3, for = '100ms', limit = 1 }}]\n{DRIVEN}"
    );
    let scenario =
        Scenario::parse(&text, Path::new("ring.toml"), &[]).unwrap_or_else(|errors| panic!("{errors}"));
    let mut engine = engine_on(&scenario, ideal_bus(&scenario)).unwrap();
    engine.start();
    let states: Vec<f32> = (0..=scenario.time.ticks).map(|_| engine.advance().unwrap()[2].x).collect();
    assert!(states[1100].is_nan());
    // By its field alone, -x + 1 + 2 sin(3 t), for 0.3 s; and not at its initial state.
    let (mut x, tick) = (f64::from(states[999]), 1e-3);
    for k in 999..1300 {
        let t = f64::from(k) * tick;
        x += tick * (-x + 1.0 + 2.0 * funnelnet_law::math::sin(3.0 * t));
    }
    assert!((f64::from(states[1300]) - x).abs() < 0.02, "{} {x}", states[1300]);
    assert!((states[1300] - 0.5).abs() > 0.1);
}
