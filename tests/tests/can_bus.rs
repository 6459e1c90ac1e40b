//! The network of a scenario on a CAN bus, bit for bit, against the ideal bus.
#![allow(clippy::unwrap_used, reason = "helpers of tests, which clippy does not know as such")]

use funnelnet_can_bus::{BitErrors, BitRate, Noise, Quiet, Timing};
use funnelnet_node::{Event, Node, Params};
use funnelnet_protocol::config::TickSource;
use funnelnet_protocol::message::{FaultCode, NodeId};
use sim_host::bus::can::CanBus;
use sim_host::configure::{Drive, listeners, node_configs};
use sim_host::engine::Engine;
use sim_host::run::Fidelity;
use sim_host::scenario::Scenario;
use system_tests::{run, scenario};

/// What a run shows: the states of all nodes at each tick, the largest ratio, the utilisation, errors on the
/// bus.
struct Seen {
    states: Vec<Vec<f64>>,
    ratio: f64,
    utilisation: f64,
    frames: u64,
}

fn on_can(scenario: &Scenario, rate: u32, noise: impl Noise) -> Seen {
    let drive = Drive { tick_source: TickSource::Timer, telemetry_every: 0, is_simulated: true };
    let configs = node_configs(scenario, drive).unwrap();
    let nodes =
        configs.iter().map(|config| Node::new(Params::new(config).unwrap(), &config.neighbours)).collect();
    let ids: Vec<NodeId> = configs.iter().map(|config| NodeId::new(config.id).unwrap()).collect();
    let timing = Timing::classic(BitRate::new(rate, 875).unwrap());
    let mut engine = Engine::new(nodes, CanBus::new(timing, noise, &ids, &listeners(scenario)));
    engine.start();
    let (mut states, mut ratio) = (Vec::new(), 0.0_f64);
    for _ in 0..=scenario.time.ticks {
        let seen = engine.advance().unwrap();
        states.push(seen.iter().map(|seen| f64::from(seen.x)).collect());
        ratio = seen.iter().fold(ratio, |ratio, seen| ratio.max(f64::from(seen.ratio)));
    }
    let (utilisation, frames) = (engine.utilisation(), engine.traffic().sent);
    Seen { states, ratio, utilisation, frames }
}

fn on_ideal(scenario: &Scenario) -> Vec<Vec<f64>> {
    run(scenario, Fidelity::Loopback).rows.into_iter().map(|row| row.x).collect()
}

/// SplitMix64.
fn random(mut state: u64) -> impl FnMut() -> u64 {
    move || {
        state = state.wrapping_add(0x9E37_79B9_7F4A_7C15);
        let z = (state ^ (state >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
        let z = (z ^ (z >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
        z ^ (z >> 31)
    }
}

/// One frame in a hundred: a frame of five bytes has some 95 bits.
fn one_percent() -> impl Noise {
    BitErrors::on_the_bus(105_000, random(11)).unwrap()
}

/// First tick at which they differ.
fn first_difference(left: &[Vec<f64>], right: &[Vec<f64>]) -> Option<usize> {
    left.iter().zip(right).position(|(left, right)| left != right)
}

/// Five frames of five bytes, 85 bits and stuff bits, at most 18, in each tick.
fn assert_utilisation(seen: &Seen, rate: f64, tick_s: f64) {
    let of = |bits: f64| 5.0 * bits / rate / tick_s;
    assert!((of(87.0)..of(87.0 + 18.0)).contains(&seen.utilisation), "{}", seen.utilisation);
}

/// What arrives within the tick is what the ideal bus brings, to the bit.
#[test]
fn five_agents_on_a_fast_bus_have_the_bits_of_the_ideal_one() {
    for (rate, tick) in [(1_000_000, "1ms"), (1_000_000, "2500us"), (500_000, "2500us")] {
        let scenario = scenario("five-agents.toml", &[&format!("time.tick={tick}")]);
        let ideal = on_ideal(&scenario);
        let tick_s = scenario.time.tick_s();
        for seen in [on_can(&scenario, rate, Quiet), on_can(&scenario, rate, one_percent())] {
            assert_eq!(first_difference(&seen.states, &ideal), None, "{rate} {tick}");
            assert!(seen.ratio < 1.0, "{}", seen.ratio);
            println!("{rate} bit/s, {tick}: {} frames, utilisation {:.4}", seen.frames, seen.utilisation);
            assert!(seen.frames >= 5 * scenario.time.ticks);
            assert!(seen.utilisation < 0.55);
        }
        assert_utilisation(&on_can(&scenario, rate, Quiet), f64::from(rate), tick_s);
    }
}

/// At 500 kbit/s and 1 kHz the bus is busy for 90 % of the time. Where a node announces something beside its
/// state, a state comes a tick late; with errors more of them do. The funnel bears it.
#[test]
fn on_a_nearly_full_bus_some_states_are_late_and_the_funnel_holds() {
    let scenario = scenario("five-agents.toml", &[]);
    let ideal = on_ideal(&scenario);
    let apart = |seen: &Seen| {
        let at = |(seen, ideal): (&Vec<f64>, &Vec<f64>)| {
            seen.iter().zip(ideal).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max)
        };
        seen.states.iter().zip(&ideal).map(at).fold(0.0, f64::max)
    };
    let (quiet, noisy) = (on_can(&scenario, 500_000, Quiet), on_can(&scenario, 500_000, one_percent()));
    for seen in [&quiet, &noisy] {
        println!(
            "utilisation {:.4}, states apart by {:.2e}, ratio {:.4}",
            seen.utilisation,
            apart(seen),
            seen.ratio
        );
        assert!(first_difference(&seen.states, &ideal).is_some_and(|tick| tick > 5));
        assert!(seen.ratio < 1.0, "{}", seen.ratio);
    }
    assert_utilisation(&quiet, 5e5, 1e-3);
    assert!(apart(&quiet) < apart(&noisy));
    assert!(noisy.utilisation > quiet.utilisation);
}

/// The bus that cannot carry it: what the tests above would not see if the bus were ideal after all.
#[test]
fn on_a_bus_that_is_too_slow_the_less_urgent_nodes_are_not_heard() {
    let scenario = scenario("five-agents.toml", &["time.duration=2s"]);
    let seen = on_can(&scenario, 125_000, Quiet);
    assert!(first_difference(&seen.states, &on_ideal(&scenario)).is_some_and(|tick| tick < 5));
    assert!(seen.utilisation > 0.99, "{}", seen.utilisation);
    assert!(seen.frames < 2 * 2000, "{}", seen.frames);
}

/// One seed, one run.
#[test]
fn the_same_noise_gives_the_same_run() {
    let scenario = scenario("five-agents.toml", &["time.duration=2s"]);
    let runs = [(); 2].map(|()| on_can(&scenario, 500_000, one_percent()));
    assert_eq!(runs[0].states, runs[1].states);
    assert_eq!(runs[0].utilisation.to_bits(), runs[1].utilisation.to_bits());
}

/// Nearly every frame is spoilt: controllers go off the bus, and their nodes stop, say why, and do not drive
/// on.
#[test]
fn a_node_that_its_bus_has_lost_stops_with_a_fault() {
    let sets = ["bus.model=can", "bus.bit_errors=0.03", "time.duration=2s", "expect.stopped='any'"];
    let scenario = scenario("five-agents.toml", &sets);
    let run = run(&scenario, Fidelity::Loopback);
    let off: Vec<usize> = run
        .events
        .iter()
        .filter(|event| event.event == Event::Fault(FaultCode::BUS_OFF))
        .map(|event| event.node)
        .collect();
    assert!(!off.is_empty(), "{:?}", run.events);
    for node in off {
        let last = run.rows.last().unwrap();
        assert!(last.u[node].is_nan(), "node {} has no input any more", node + 1);
    }
}
