use super::*;
use crate::loopback::engine_on;
use crate::scenario::Override;
use std::path::Path;

fn gallery(file: &str, sets: &[&str]) -> Scenario {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../scenarios").join(file);
    let sets: Vec<_> = sets.iter().map(|set| Override::parse(set).unwrap()).collect();
    Scenario::load(&path, &sets).unwrap()
}

#[derive(Clone)]
struct Still;

impl VectorField<f32> for Still {
    fn at(&self, _: u64, _: f32) -> f32 {
        0.0
    }
}

#[test]
fn the_nodes_and_the_bits_are_those_of_the_engine() {
    for sets in [&["time.duration=1s"][..], &["time.duration=1s", "bus.loss=0.2"]] {
        let scenario = gallery("five-agents.toml", sets);
        let (mut simulation, mut engine) =
            (Simulation::new(&scenario).unwrap(), crate::loopback::engine(&scenario).unwrap());
        engine.start();
        while simulation.step().is_some() {
            let seen = engine.advance().unwrap();
            for (index, seen) in seen.iter().enumerate() {
                assert_eq!(simulation.node(index as u16 + 1)[0].x.to_bits(), seen.x.to_bits());
            }
        }
    }
}

/// Where nobody watches, receptions are no events of the bus: nothing that nodes hear depends on it, nor what
/// their controllers stamp.
#[test]
fn who_watches_a_bus_changes_nothing_on_it() {
    let drifting = "../sim-host/tests/clocks/five-agents.toml";
    let bounced = "event=[{at='300ms',kind='bounce',node=2},{at='500ms',kind='partition',link=[1,2]},{at='600ms',kind='repair'}]";
    for (file, sets) in [
        ("five-agents.toml", &["bus.bit_errors=1e-4"][..]),
        ("five-agents.toml", &["bus.loss=0.2"]),
        ("five-agents.toml", &["bus.bit_errors=1e-4", bounced]),
        (drifting, &[]),
        (drifting, &["bus.loss=0.1"]),
    ] {
        let scenario = gallery(file, &[&["bus.model=can", "time.duration=1s"], sets].concat());
        let engine = || engine_on(&scenario, can_bus::<Classic>(&scenario).unwrap()).unwrap();
        let (mut unwatched, mut watched) = (engine(), engine());
        watched.bus_mut().watch(scenario.time.tick_ns, true);
        unwatched.start();
        watched.start();
        let mut simulation = Simulation::new(&scenario).unwrap();
        for k in 0..=scenario.time.ticks {
            let bits = |seen: &[Observation<f32>]| -> Vec<u32> {
                seen.iter().map(|seen| seen.x.to_bits()).collect()
            };
            let seen = bits(watched.advance().unwrap());
            assert_eq!(bits(unwatched.advance().unwrap()), seen, "{sets:?} {k}");
            simulation.step();
            assert_eq!(bits(simulation.network.observations()), seen, "{sets:?} {k}");
        }
        assert_eq!(unwatched.skew(), watched.skew(), "{sets:?}");
        assert_eq!(unwatched.take_events(), watched.take_events(), "{sets:?}");
        assert_eq!(unwatched.traffic(), watched.traffic(), "{sets:?}");
    }
}

#[test]
fn every_bus_carries_it_and_a_dead_one_fails() {
    for bus in ["ideal", "can", "can-fd"] {
        let bus = format!("bus.model={bus}");
        let scenario = gallery("five-agents.toml", &["time.duration=1s", &bus]);
        let verdict = Simulation::new(&scenario).unwrap().run();
        assert!(verdict.holds(), "{bus}: {verdict}");
    }
}

/// At rest nobody leaves a funnel on a bus that carries nothing.
#[test]
fn nodes_that_nobody_hears_hold_nothing() {
    let rest = ["agent.state=0.0", "node=[]", "agent.dynamics={kind='affine'}", "time.duration=1s"];
    for (sets, holds) in [(&[][..], true), (&["bus.loss=1.0"], false)] {
        let scenario = gallery("five-agents.toml", &[&rest[..], sets].concat());
        let verdict = Simulation::new(&scenario).unwrap().run();
        assert!(verdict.holds() == holds && verdict.findings.breaches == 0, "{sets:?}: {verdict}");
        assert!(holds || verdict.to_string().contains("no neighbour has ever heard node 1"), "{verdict}");
    }
}

#[test]
fn a_funnel_that_f32_does_not_resolve_holds_nothing() {
    let narrow = "coupling.funnel={kind='exponential',start=40,end=1e-6,rate=5}";
    let scenario = gallery("five-agents.toml", &["time.duration=6s", narrow]);
    let verdict = Simulation::new(&scenario).unwrap().run();
    assert!(verdict.to_string().contains("has floored its funnel"), "{verdict}");
}

/// As the command judges them: more is allowed for some time after an event, and a node that is alone has no
/// term.
#[test]
fn events_are_judged_as_in_a_run() {
    let scenario = gallery("bounce-join.toml", &[]);
    let verdict = Simulation::new(&scenario).unwrap().run();
    assert!(verdict.holds() && verdict.findings.uncoupled > 0, "{verdict}");
}

#[test]
fn a_field_of_ones_own_moves_the_node_and_no_other_does() {
    let scenario = gallery("five-agents.toml", &["coupling.kind=none", "time.duration=1s"]);
    let mut simulation = Simulation::setup(&scenario).field(3, Still).start().unwrap();
    while simulation.step().is_some() {}
    let moved = |id: u16| f64::from(simulation.node(id)[0].x) - scenario.nodes[usize::from(id) - 1].state[0];
    assert_eq!(moved(3), 0.0);
    assert!([1, 2, 4, 5].iter().all(|&id| moved(id) != 0.0));
}

#[test]
fn what_is_said_of_a_node_that_is_not_there_is_refused() {
    let scenario = gallery("five-agents.toml", &[]);
    for id in [0, 6] {
        let refused = Simulation::setup(&scenario).field(id, Still).start().err().unwrap();
        assert!(refused.to_string() == format!("node {id}: there is none; ids are 1 to 5 here"), "{refused}");
    }
}

#[test]
fn a_run_that_is_not_whole_holds_nothing() {
    let scenario = gallery("five-agents.toml", &["time.duration=1s"]);
    let mut simulation = Simulation::new(&scenario).unwrap();
    for _ in 0..10 {
        simulation.step();
    }
    let verdict = simulation.verdict();
    assert!(
        !verdict.holds() && verdict.to_string().contains("the run ended after 10 of 1001 ticks"),
        "{verdict}"
    );
}
