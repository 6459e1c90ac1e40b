//! Events that happen to frames, and nodes that lie: what they do, and what they must not do.
#![allow(clippy::unwrap_used, clippy::panic, reason = "helpers of tests, which clippy does not know as such")]

use funnelnet_node::Event;
use funnelnet_protocol::message::FaultCode;
use funnelnet_protocol::refusal::Refusal;
use funnelnet_sim::bus::{Medium, Traffic};
use funnelnet_sim::engine::{Engine, NodeEvent};
use funnelnet_sim::loopback::{can_bus, engine_on, ideal_bus};
use funnelnet_sim::{Scenario, Simulation, Verdict};
use std::path::Path;

/// A ring of five that differ, for 2 s.
const RING: &str = r#"version = 1
time = { tick = "1ms", duration = "2s" }
graph = { kind = "ring", nodes = 5 }
coupling.kind = "node-wise"
coupling.gain = { kind = "reciprocal", scale = 1.0 }
coupling.funnel = { kind = "exponential", start = 10.0, end = 0.2, rate = 4.0 }
agent.dynamics = { kind = "affine", slope = -1.0, offset = 1.0 }
expect = { recovered_within = "500ms" }
"#;
const DRIVEN: &str = "[[node]]\nid = 3\ndynamics = { sines = [{ amplitude = 2.0, frequency = 3.0 }] }\n";

fn scenario(events: &str, rest: &str) -> Scenario {
    let expect = if events.is_empty() { "" } else { "expect = { recovered_within = \"500ms\" }\n" };
    let text = RING.replace("expect = { recovered_within = \"500ms\" }\n", expect);
    let text = format!("{text}event = [{events}]\n{rest}{DRIVEN}");
    Scenario::parse(&text, Path::new("ring.toml"), &[]).unwrap_or_else(|errors| panic!("{errors}"))
}

fn verdict(scenario: &Scenario) -> Verdict {
    Simulation::new(scenario).unwrap().run()
}

/// Runs all ticks on a medium: the states of all nodes at each tick.
fn played<M: Medium>(scenario: &Scenario, medium: M) -> (Vec<u32>, Engine<M>) {
    let mut engine = engine_on(scenario, medium).unwrap();
    engine.start();
    let mut states = Vec::new();
    for _ in 0..=scenario.time.ticks {
        states.extend(engine.advance().unwrap().iter().map(|seen| seen.x.to_bits()));
    }
    (states, engine)
}

fn on_ideal(events: &str) -> (Vec<u32>, Traffic, u64) {
    let scenario = scenario(events, "");
    let (states, engine) = played(&scenario, ideal_bus(&scenario));
    let refused = |refusal: Refusal| -> u64 {
        let counted = |report: &funnelnet_protocol::report::Report| report.counters.refused(refusal);
        engine.reports().iter().flatten().map(|report| u64::from(counted(report))).sum()
    };
    let old = [Refusal::TickWindow, Refusal::Stale, Refusal::Duplicate].map(refused).iter().sum();
    (states, engine.traffic(), old)
}

#[test]
fn a_burst_loses_what_it_says_and_no_frame_before_or_after() {
    let (calm, none, _) = on_ideal("");
    let (states, traffic, _) = on_ideal("{ at = '1s', kind = 'burst', for = '50ms', loss = 1 }");
    // Two neighbours hear each of five nodes.
    assert_eq!((none.lost, traffic.lost), (0, 50 * 10));
    let first = states.iter().zip(&calm).position(|(now, before)| now != before).unwrap() / 5;
    assert!((1000..1010).contains(&first), "{first}");
    let (_, half, _) = on_ideal("{ at = '1s', kind = 'burst', link = [1, 2], for = '500ms', loss = 0.5 }");
    assert!((450..550).contains(&half.lost), "{}", half.lost);
}

#[test]
fn the_network_bears_a_burst_of_fifty_ticks_and_is_inside_soon_after_a_longer_one() {
    let short = verdict(&scenario("{ at = '1s', kind = 'burst', for = '50ms', loss = 1 }", ""));
    assert!(short.holds() && short.findings.during_events.unwrap().breaches == 0, "{short}");
    let long = verdict(&scenario("{ at = '1s', kind = 'burst', for = '300ms', loss = 1 }", ""));
    assert!(
        long.findings.during_events.unwrap().breaches > 0 && long.findings.recovered_s.unwrap() < 0.1,
        "{long}"
    );
}

#[test]
fn frames_that_are_held_come_all_at_once_and_only_the_fresh_ones_count() {
    let (calm, ..) = on_ideal("");
    let hold = "{ at = '1s', kind = 'hold', link = [2, 3], for = '100ms' }";
    let (states, traffic, old) = on_ideal(hold);
    // Each end refuses all that came but the last value of its neighbour, and no more: those that the tick window takes are older.
    assert_eq!(traffic.lost, 0);
    assert!((150..200).contains(&old), "{old}");
    assert!(states != calm);
    let by_release =
        "{ at = '1s', kind = 'hold', link = [2, 3] }, { at = '1.1s', kind = 'release', node = 3 }";
    assert!(on_ideal(by_release).0 == states);
}

#[test]
fn disturbed_bits_of_a_link_are_as_many_as_said() {
    let (_, traffic, _) =
        on_ideal("{ at = '1s', kind = 'corrupt', link = [2, 3], for = '500ms', probability = 0.1 }");
    assert!((70..130).contains(&traffic.corrupted), "{}", traffic.corrupted);
}

/// On CAN a disturbed bit is an error frame, and the frame goes again: the states are those of a bus without noise.
#[test]
fn a_noisy_can_bus_sends_again_and_only_while_it_is_noisy() {
    let can = "bus.model = \"can\"\n";
    let errors = |events: &str| {
        let scenario = scenario(events, can);
        let seen = std::rc::Rc::new(std::cell::RefCell::new((0u64, u64::MAX, 0u64)));
        let tap = {
            let seen = seen.clone();
            Box::new(move |event: &funnelnet_can_bus::Event| {
                if matches!(event.what, funnelnet_can_bus::What::Error { .. }) {
                    let mut seen = seen.borrow_mut();
                    *seen = (seen.0 + 1, seen.1.min(event.at), seen.2.max(event.at));
                }
            })
        };
        let bus = can_bus::<funnelnet_link::Classic>(&scenario).unwrap().with_tap(tap);
        let (states, _) = played(&scenario, bus);
        let seen = *seen.borrow();
        (states, seen.0, seen.1, seen.2)
    };
    let (calm, none, ..) = errors("");
    assert_eq!(none, 0);
    let noise = "{ at = '1s', kind = 'noise', for = '200ms', bit_errors = 1e-4 }";
    let (states, count, first, last) = errors(noise);
    // Some 500 bits of frames in a tick: ten of them wrong in 200 ticks, and each seen by one controller or more.
    assert!(count > 5 && count < 100, "{count}");
    // Tick 0 is a tick after the start.
    assert!(first >= 1_001_000_000 && last < 1_201_200_000, "{first} {last}");
    assert!(states == calm);
    // A link that reads wrong breaks frames of its sender alone.
    let corrupt = "{ at = '1s', kind = 'corrupt', link = [2, 3], for = '200ms', probability = 0.05 }";
    let (states, count, first, last) = errors(corrupt);
    assert!(count > 10 && first >= 1_001_000_000 && last < 1_201_200_000, "{count} {first} {last}");
    assert!(states == calm);
}

#[test]
fn who_lies_a_little_moves_its_neighbours_and_is_judged_by_what_it_is() {
    let calm = verdict(&scenario("", ""));
    let small =
        verdict(&scenario("{ at = '1s', kind = 'liar', node = 2, for = '300ms', offset = 0.05 }", ""));
    assert!(calm.holds() && small.holds(), "{small}");
    let large = verdict(&scenario("{ at = '1s', kind = 'liar', node = 2, for = '300ms', constant = 5 }", ""));
    let during = large.findings.during_events.unwrap();
    // Nodes bear no large lie: the guarantee is of nodes that say their own states. It is back once that ends.
    assert!(during.breaches > 100 && during.max_ratio > 1.5, "{during:?}");
    assert!(large.findings.recovered_s.unwrap() < 0.3 && large.findings.breaches == 0, "{large}");
}

#[test]
fn old_states_are_refused_but_where_their_stamps_are_those_of_the_next_tick() {
    let (calm, ..) = on_ideal("");
    let replay = |age: &str| {
        on_ideal(&format!("{{ at = '1s', kind = 'replayer', node = 2, for = '300ms', age = '{age}' }}"))
    };
    for age in ["1ms", "20ms", "256ms", "257ms", "900ms"] {
        let (states, _, old) = replay(age);
        assert!(states == calm && old == 600, "{age}: {old} refused");
    }
    // A frame has eight bits of the tick: what is one or two ticks younger than a multiple of 256 is taken for a state of the next ones.
    for age in ["254ms", "255ms", "511ms"] {
        assert!(replay(age).0 != calm, "{age}");
    }
}

#[test]
fn an_impostor_stops_the_one_whose_name_it_takes_where_that_hears_it() {
    let hears = verdict(&scenario(
        "{ at = '1s', kind = 'impostor', node = 2, as = 3, for = '300ms', constant = 5 }",
        "",
    ));
    let [stop] = &hears.stops[..] else { panic!("{:?}", hears.stops) };
    assert!(stop.id == 3 && stop.why.contains("another node has its id"), "{stop:?}");
    assert!(!hears.holds());
    // On CAN it hears whoever has its id, neighbour or not.
    let event = "{ at = '1s', kind = 'impostor', node = 2, as = 5, for = '300ms', constant = 5 }";
    let on_can = verdict(&scenario(event, "bus.model = \"can\"\n"));
    assert!(on_can.stops.len() == 1 && on_can.stops[0].id == 5, "{:?}", on_can.stops);
    let scenario_on_can = scenario(event, "bus.model = \"can\"\n");
    let mut engine =
        engine_on(&scenario_on_can, can_bus::<funnelnet_link::Classic>(&scenario_on_can).unwrap()).unwrap();
    engine.start();
    while engine.advance().is_some_and(|seen| seen[0].tick < 1_100) {}
    let own_id = |report: &Option<funnelnet_protocol::report::Report>| {
        report.as_ref().map_or(0, |report| report.counters.refused(Refusal::OwnId))
    };
    // It goes on hearing its twin, and counts that.
    let counted: Vec<_> = engine.reports().iter().map(own_id).collect();
    assert!(counted[..4] == [0; 4] && counted[4] > 90, "{counted:?}");
    let told = engine.take_events();
    let twin = |told: &&NodeEvent| told.event == Event::Fault(FaultCode::DUPLICATE_ID);
    assert_eq!(told.iter().filter(twin).map(|told| told.node).collect::<Vec<_>>(), [4]);
    // Where it does not, its other neighbours believe the impostor.
    let does_not = verdict(&scenario(event, ""));
    assert!(does_not.stops.is_empty() && does_not.findings.during_events.unwrap().breaches > 0, "{does_not}");
}
