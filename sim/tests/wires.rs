//! Events that happen to the wire of a CAN bus: a connector that comes off, a short circuit, a node that sends without end.
#![allow(clippy::unwrap_used, clippy::panic, reason = "helpers of tests, which clippy does not know as such")]

use funnelnet_can_bus::{Counters, Mode};
use funnelnet_sim::bus::Medium;
use funnelnet_sim::loopback::{can_bus, engine_on};
use funnelnet_sim::{Scenario, Simulation, Verdict};
use std::path::Path;

/// A ring of five that differ, for 2 s on CAN.
const RING: &str = r#"version = 1
time = { tick = "1ms", duration = "2s" }
graph = { kind = "ring", nodes = 5 }
coupling.kind = "node-wise"
coupling.gain = { kind = "reciprocal", scale = 1.0 }
coupling.funnel = { kind = "exponential", start = 10.0, end = 0.2, rate = 4.0 }
agent.dynamics = { kind = "affine", slope = -1.0, offset = 1.0 }
bus.model = "can"
expect.recovered_within = "500ms"
"#;
const DRIVEN: &str = "[[node]]\nid = 3\ndynamics = { sines = [{ amplitude = 2.0, frequency = 3.0 }] }\n";

fn read(event: &str, bus: &str) -> Result<Scenario, String> {
    let text = format!("{RING}event = [{event}]\n{DRIVEN}").replace("bus.model = \"can\"", bus);
    let text =
        if event.is_empty() { text.replace("expect.recovered_within = \"500ms\"\n", "") } else { text };
    Scenario::parse(&text, Path::new("ring.toml"), &[]).map_err(|errors| errors.to_string())
}

fn verdict(event: &str) -> Verdict {
    Simulation::new(&read(event, "bus.model = \"can\"").unwrap()).unwrap().run()
}

/// States of all nodes at each tick, what the controllers count then, and frames that have gone out.
struct Played {
    states: Vec<Vec<f32>>,
    counters: Vec<Vec<(Mode, Counters)>>,
    sent: Vec<u64>,
}

fn played(event: &str) -> Played {
    let scenario = read(event, "bus.model = \"can\"").unwrap();
    let mut engine = engine_on(&scenario, can_bus::<funnelnet_link::Classic>(&scenario).unwrap()).unwrap();
    engine.start();
    let mut played = Played { states: vec![], counters: vec![], sent: vec![] };
    for _ in 0..=scenario.time.ticks {
        played.states.push(engine.advance().unwrap().iter().map(|seen| seen.x).collect());
        let bus = engine.bus().bus();
        played.counters.push((0..5).map(|node| (bus.mode(node), bus.counters(node))).collect());
        played.sent.push(engine.bus().traffic().sent);
    }
    played
}

/// It hears nobody, and nobody hears it: all hold together what they can, and are together again after it.
#[test]
fn a_node_whose_connector_is_off_is_error_passive_and_comes_back() {
    let event = "{ at = '1s', kind = 'cut', node = 2, for = '100ms' }";
    let (calm, cut) = (played(""), played(event));
    assert!(cut.states[..1000] == calm.states[..1000]);
    // It sends one frame a tick, again and again: 16 attempts make it passive, and it never goes off the bus.
    let of_two = |tick: usize| (cut.counters[tick][1].0, cut.counters[tick][1].1.transmit);
    assert_eq!(
        (of_two(999), of_two(1010), of_two(1090)),
        ((Mode::Active, 0), (Mode::Passive, 128), (Mode::Passive, 128))
    );
    assert_eq!(of_two(1500).0, Mode::Active);
    // The others acknowledge each other: nothing happens to them.
    assert!(cut.counters.iter().all(|nodes| nodes[0] == (Mode::Active, Counters::default())));
    assert_eq!(cut.sent[1090] - cut.sent[1010], 4 * 80);
    let verdict = verdict(event);
    assert!(verdict.holds() && verdict.stops.is_empty(), "{verdict}");
    assert!(verdict.findings.during_events.unwrap().max_ratio > 0.0, "{verdict}");
    // Each side goes on by what it has heard last.
    assert!(cut.states[1090][1].to_bits() != calm.states[1090][1].to_bits());
}

/// Controllers count errors, and none goes off where the bus was idle at the begin: frames of 2 ms are late, and no more.
#[test]
fn a_short_circuit_between_frames_is_borne() {
    let short = played("{ at = '1000500us', kind = 'short', for = '2ms' }");
    assert!(short.counters[1002].iter().all(|(mode, _)| *mode == Mode::Passive));
    assert!(short.counters[1500].iter().all(|(mode, _)| *mode == Mode::Active));
    assert_eq!(short.sent[1002] - short.sent[1001], 0);
    assert!(verdict("{ at = '1000500us', kind = 'short', for = '2ms' }").holds());
}

/// The one that is sending goes off the bus, and its node stops.
#[test]
fn a_short_circuit_in_a_frame_takes_its_sender_off() {
    // A tick's five frames of some 100 bits begin with the tick: this is the middle of the second one.
    let verdict = verdict("{ at = '1000160us', kind = 'short', for = '2ms' }");
    let [stop] = &verdict.stops[..] else { panic!("{:?}", verdict.stops) };
    assert!(stop.why.contains("went off the bus"), "{stop:?}");
    assert!(!verdict.holds());
}

/// Frames that win against all others keep them from the bus; frames that lose against all others fill what is left.
#[test]
fn who_sends_without_end_starves_those_whose_frames_lose() {
    let calm = played("");
    let weak = played("{ at = '1s', kind = 'babble', node = 2, id = 0x7FF, for = '100ms' }");
    // A frame that has begun is waited for, and all of a tick still come in it.
    assert!(weak.states == calm.states);
    // Frames without data have 47 bits and the stuffed ones.
    let extra = (weak.sent[1100] - weak.sent[1000]) - (calm.sent[1100] - calm.sent[1000]);
    assert!((800..1_200).contains(&extra), "{extra}");
    let strong = played("{ at = '1s', kind = 'babble', node = 2, for = '100ms' }");
    assert!(strong.states[..1000] == calm.states[..1000] && strong.states[1200] != calm.states[1200]);
    let all = strong.sent[1100] - strong.sent[1000];
    assert!((1_700..2_200).contains(&all), "{all}");
    // From the second tick on, where its controller is full of its own states, nothing else gets through: 53 bits a frame.
    let later = strong.sent[1090] - strong.sent[1010];
    assert!((80_000 / 53 - 2..=80_000 / 53 + 2).contains(&later), "{later}");
    // The 100 ticks before and after: five frames each.
    assert_eq!((strong.sent[999] - strong.sent[899], strong.sent[1900] - strong.sent[1800]), (500, 500));
    let verdict = verdict("{ at = '1s', kind = 'babble', node = 2, for = '100ms' }");
    assert!(verdict.holds() && verdict.findings.during_events.unwrap().max_ratio > 0.0, "{verdict}");
}

/// A second event, and one inside another, do what they say.
#[test]
fn a_node_babbles_as_often_as_it_is_told_to() {
    let sent = |event: &str| {
        let played = played(event);
        played.sent[1500] - played.sent[400]
    };
    let calm = sent("");
    let one = |at: &str, id: u32, lasts: u32| {
        format!("{{ at = '{at}', kind = 'babble', node = 2, id = {id}, for = '{lasts}ms' }}")
    };
    let first = sent(&one("500ms", 0x7FF, 100)) - calm;
    let both = sent(&format!("{}, {}", one("500ms", 0x7FF, 100), one("1s", 0x7FF, 100))) - calm;
    let other = sent(&format!("{}, {}", one("500ms", 0x7FF, 100), one("1s", 0x7FE, 100))) - calm;
    assert!(
        first > 800 && both.abs_diff(2 * first) < 4 && other.abs_diff(2 * first) < 30,
        "{first} {both} {other}"
    );
    let long = sent(&one("500ms", 0x7FF, 300)) - calm;
    let inside = sent(&format!("{}, {}", one("500ms", 0x7FF, 300), one("600ms", 0x7FE, 100))) - calm;
    // Identifiers differ by a stuffed bit.
    assert!(inside.abs_diff(long) < 30, "{long} {inside}");
}

/// An empty frame with the identifier of a SYNC is refused: no clock is set by it, during the event or after it.
#[test]
fn who_babbles_as_a_time_master_sets_no_clock() {
    let states = |id: u32| {
        let event = format!("{{ at = '500ms', kind = 'babble', node = 2, id = {id}, for = '20ms' }}");
        let bus = "bus.model = \"can\"\nclock.drift_ppm = 50.0\nsync = { period = \"100ms\", masters = [1] }";
        let scenario = read(&event, bus).unwrap();
        let mut engine =
            engine_on(&scenario, can_bus::<funnelnet_link::Classic>(&scenario).unwrap()).unwrap();
        engine.start();
        for _ in 0..=scenario.time.ticks {
            engine.advance().unwrap();
        }
        engine.observations().iter().map(|seen| seen.x.to_bits()).collect::<Vec<_>>()
    };
    // 0x081 is the SYNC of node 1, 0x0FF of nobody, and both win against all states.
    assert!(states(0x081) == states(0x0FF));
}

/// Events of one node that overlap end each at its own time.
#[test]
fn a_connector_is_back_when_the_last_event_is_over() {
    let cut = played(
        "{ at = '1s', kind = 'cut', node = 2, for = '50ms' }, { at = '1020ms', kind = 'cut', node = 2, for = '100ms' }",
    );
    assert_eq!(cut.sent[1115] - cut.sent[1010], 4 * 105);
    assert_eq!(cut.sent[1900] - cut.sent[1800], 500);
}

#[test]
fn there_is_no_wire_on_an_ideal_bus() {
    for event in ["kind = 'cut', node = 2", "kind = 'short', for = '2ms'", "kind = 'babble', node = 2"] {
        let error = read(&format!("{{ at = '1s', {event} }}"), "bus.model = \"ideal\"").unwrap_err();
        assert!(error.contains("needs bus.model = \"can\" or \"can-fd\", which have a wire"), "{error}");
    }
    let error =
        read("{ at = '1s', kind = 'babble', node = 2, id = 2048 }", "bus.model = \"can\"").unwrap_err();
    assert!(error.contains("must be an integer from 0 to 2047 (an 11-bit identifier)"), "{error}");
}
