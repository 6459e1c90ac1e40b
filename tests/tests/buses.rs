//! Whole runs on buses with bits, against the ideal one.
#![allow(clippy::unwrap_used, reason = "helpers of tests, which clippy does not know as such")]

use funnelnet_can_bus::{BitErrors, Event, Frame, Length, Line, Noise, Quiet, Record, Timing, What};
use funnelnet_node::{Node, Params};
use funnelnet_protocol::config::TickSource;
use funnelnet_protocol::message::NodeId;
use rand_pcg::Pcg64;
use rand_pcg::rand_core::Rng as _;
use sim_host::bus::can::CanBus;
use sim_host::configure::{Drive, listeners, node_configs};
use sim_host::engine::Engine;
use sim_host::record::{BusSummary, TraceHash};
use sim_host::run::{Fidelity, Outcome};
use sim_host::scenario::{Expect, Scenario};
use std::cell::RefCell;
use std::rc::Rc;
use system_tests::{run, scenario};

fn of(file: &str, sets: &[&str]) -> Outcome {
    run(&scenario(file, sets), Fidelity::Loopback)
}

fn five(sets: &[&str]) -> Outcome {
    of("five-agents.toml", &[&["time.duration=1s"], sets].concat())
}

fn states(outcome: &Outcome) -> Vec<Vec<f64>> {
    outcome.rows.iter().map(|row| row.x.clone()).collect()
}

fn bus(outcome: &Outcome) -> &BusSummary {
    outcome.bus.as_ref().unwrap()
}

/// Largest distance to the reference over the 20 s of the scenario.
fn reference_error(sets: &[&str]) -> (f64, Outcome) {
    let scenario = scenario("five-agents.toml", sets);
    let expect = Expect { reference_error: Some(1.0), ..Expect::default() };
    let outcome = run(&Scenario { expect, ..scenario }, Fidelity::Loopback);
    (outcome.reference.unwrap().max_error, outcome)
}

/// One frame in a hundred is spoilt: it has some 95 bits.
#[test]
fn one_per_cent_of_error_frames_at_most_doubles_the_reference_error() {
    for tick in ["1ms", "2500us"] {
        let tick = format!("time.tick={tick}");
        let (ideal, _) = reference_error(&[&tick]);
        for rate in ["bus.bitrate=1000000", "bus.bitrate=500000"] {
            let (error, outcome) = reference_error(&["bus.model=can", rate, "bus.bit_errors=1.05e-4", &tick]);
            println!(
                "{rate} {tick}: reference error {error:.3e}, ideal {ideal:.3e}, ratio {:.4}, utilisation {:.4}",
                outcome.max_ratio,
                bus(&outcome).utilisation
            );
            assert!(error <= 2.0 * ideal, "{rate} {tick}: {error} {ideal}");
            assert!(outcome.max_ratio < 1.0, "{}", outcome.max_ratio);
        }
    }
}

/// A run with somebody who sees all that happens on the bus: the events, the hash of the states, the
/// utilisation.
fn tapped(scenario: &Scenario, noise: impl Noise) -> (Vec<Event>, u64, f64) {
    let drive = Drive { tick_source: TickSource::Timer, telemetry_every: 0, is_simulated: true };
    let configs = node_configs(scenario, drive).unwrap();
    let nodes: Vec<_> =
        configs.iter().map(|config| Node::new(Params::new(config).unwrap(), &config.neighbours)).collect();
    let ids: Vec<NodeId> = configs.iter().map(|config| NodeId::new(config.id).unwrap()).collect();
    let (events, timing) = (Rc::new(RefCell::new(Vec::new())), scenario.bus.timing().unwrap());
    let tap = Rc::clone(&events);
    let medium = CanBus::new(timing, noise, &ids, &listeners(scenario));
    let medium = medium.with_tap(Box::new(move |event| tap.borrow_mut().push(*event)));
    let mut engine = Engine::new(nodes, medium);
    let mut hash = TraceHash::default();
    engine.start();
    for _ in 0..=scenario.time.ticks {
        engine.advance().unwrap().iter().for_each(|seen| hash.push(seen.x));
    }
    let utilisation = engine.utilisation();
    drop(engine);
    (events.take(), hash.value(), utilisation)
}

fn sent(events: &[Event]) -> Vec<(u64, Frame)> {
    let of = |event: &Event| match event.what {
        What::Sent { frame, started, .. } => Some((started, frame)),
        _ => None,
    };
    events.iter().filter_map(of).collect()
}

/// The time that the bus is busy is that of the lengths of its frames, to the bit.
#[test]
fn the_utilisation_is_that_of_the_frames() {
    let scenario = scenario("five-agents.toml", &["time.duration=1s", "bus.model=can", "bus.bitrate=500000"]);
    let (events, _, utilisation) = tapped(&scenario, Quiet);
    let timing: Timing = scenario.bus.timing().unwrap();
    let busy: u64 = sent(&events).iter().map(|(_, frame)| Length::of(frame, false).ns(timing)).sum();
    // The last tick begins a tick after the end, and its frames are on their way.
    let time = (scenario.time.ticks + 1) * scenario.time.tick_ns;
    assert!((utilisation - busy as f64 / time as f64).abs() < 1e-3, "{utilisation}");
    assert!(sent(&events).windows(2).all(|pair| {
        let (before, frame) = pair[0];
        pair[1].0 >= before + Length::of(&frame, false).ns(timing)
    }));
}

/// Each arbitration has one winner, which goes on at once, and the losers have the larger identifiers.
#[test]
fn a_tap_sees_who_lost_to_whom() {
    let scenario = scenario("five-agents.toml", &["time.duration=1s", "bus.model=can"]);
    let (events, _, _) = tapped(&scenario, Quiet);
    let lost: Vec<_> = events
        .iter()
        .filter_map(|event| match event.what {
            What::LostArbitration { id, to } => Some((id, to.unwrap())),
            _ => None,
        })
        .collect();
    // Five send at once in each tick: four lose, then three, two, one.
    assert!(lost.len() >= 10 * scenario.time.ticks as usize, "{}", lost.len());
    assert!(lost.iter().all(|(id, to)| id > to));
}

fn noise() -> impl Noise {
    let mut stream = Pcg64::new(11, 12);
    BitErrors::on_the_bus(105_000, move || stream.next_u64()).unwrap()
}

/// The hash of the states, and that of the log as `candump -L` would write it.
fn hashes(file: &str, rate: &str) -> (u64, u64) {
    let sets = ["time.duration=2s", "bus.model=can", &format!("bus.bitrate={rate}")];
    let (events, hash, _) = tapped(&scenario(file, &sets), noise());
    let mut log: u64 = 0xCBF2_9CE4_8422_2325;
    for record in events.iter().filter_map(Record::of_event) {
        let line = Line { interface: "can0", record: &record }.to_string();
        line.bytes().for_each(|byte| log = (log ^ u64::from(byte)).wrapping_mul(0x100_0000_01B3));
    }
    (hash, log)
}

#[test]
fn a_run_and_its_log_are_the_same_twice() {
    for (file, rate) in
        [("five-agents.toml", "500000"), ("narrow-ring.toml", "1000000"), ("head-count-20.toml", "1000000")]
    {
        let (one, again) = (hashes(file, rate), hashes(file, rate));
        println!("{file} at {rate} bit/s: states {:016x}, log {:016x}", one.0, one.1);
        assert_eq!(one, again, "{file}");
    }
}

/// A state takes 120 us on a line of 1 Mbit/s, and by a hub that and 120 us for each neighbour: all within
/// the tick.
#[test]
fn serial_lines_that_are_fast_enough_give_the_bits_of_the_ideal_bus() {
    let ideal = states(&five(&[]));
    for wiring in ["bus.wiring=lines", "bus.wiring=hub"] {
        let fast = five(&["bus.model=uart", wiring]);
        assert_eq!(states(&fast), ideal, "{wiring}");
        let sent = bus(&fast).sent as f64 / 1000.0;
        // Ten lines from node to node; five up and ten frames down.
        let expected = if wiring.ends_with("hub") { 15.0 } else { 10.0 };
        assert!((sent - expected).abs() < 0.2, "{sent}");
        let slow = five(&["bus.model=uart", wiring, "bus.bitrate=57600"]);
        assert_ne!(states(&slow), ideal);
        assert!(bus(&slow).replaced > 1000 && bus(&slow).utilisation > 0.99, "{:?}", bus(&slow));
    }
}

#[test]
fn disturbed_bits_of_a_line_are_refused_frames_and_no_wrong_states() {
    let noisy = five(&["bus.model=uart", "bus.bit_errors=1e-4"]);
    let refused: u64 = bus(&noisy).refused.values().sum();
    // Some 1.2 % of 10,000 frames, and now and then the next one, too.
    assert!((60..300).contains(&refused), "{refused}");
    assert!(noisy.max_ratio < 1.0);
    let link = five(&["bus.model=uart", "link=[{between=[1,2],corrupt=0.1}]"]);
    let (refused, corrupted) = (bus(&link).refused.values().sum::<u64>(), bus(&link).corrupted);
    assert!((150..250).contains(&corrupted) && refused >= corrupted, "{refused} {corrupted}");
}

/// What a node hears in a tick it uses in the next one, so that only being too late matters.
#[test]
fn frames_that_are_computed_in_time_change_nothing() {
    let ideal = states(&five(&[]));
    for sets in [["agent.compute=900us", "bus.model=ideal"], ["agent.compute=300us", "bus.model=can"]] {
        assert_eq!(states(&five(&sets)), ideal, "{sets:?}");
    }
    // 700 us and 475 us of frames are more than a tick.
    assert_ne!(states(&five(&["agent.compute=700us", "bus.model=can"])), ideal);
}

/// Nineteen frames come while node 1 computes, twice as many while edges are announced; its driver holds
/// sixteen.
#[test]
fn a_node_that_computes_for_long_has_no_room_for_all_frames() {
    let sets = ["graph={kind='complete',nodes=20}", "time.tick=10ms", "time.duration=1s", "bus.model=can"];
    let long = [&sets[..], &["node.1.compute=9ms"]].concat();
    let (quick, slow) = (of("head-count-20.toml", &sets), of("head-count-20.toml", &long));
    assert_eq!(bus(&quick).no_room, 0);
    assert!((620..700).contains(&bus(&slow).no_room), "{}", bus(&slow).no_room);
    assert_eq!(bus(&slow).lost, 0);
}
