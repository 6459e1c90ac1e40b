//! Parity where there is no emulator: the loopback engine (CAN frames, timer) and sessions behind serial
//! lines (SYNC, telemetry) that the real conductor drives in virtual time. What is left for `parity.rs` is
//! the target: its compiler, FPU and UART.
#![allow(clippy::unwrap_used, reason = "helpers of tests, which clippy does not know as such")]

use funnelnet_node::Observation;
use funnelnet_protocol::config::TickSource;
use sim_host::conductor::{Conductor, Patience};
use sim_host::configure::Drive;
use sim_host::presence::Presence;
use sim_host::record::TraceHash;
use sim_host::run::Fidelity;
use sim_host::scenario::Scenario;
use std::time::{Duration, Instant};
use system_tests::world::{Peace, World, conductor};
use system_tests::{run, scenario};

const LOCKSTEP: Drive = Drive { tick_source: TickSource::Sync, telemetry_every: 1, is_simulated: false };
const PATIENCE: Patience = Patience { boot: Duration::from_secs(1), answer: Duration::from_secs(1) };
/// Time that a frame takes, ns.
const TRAVEL: u64 = 1_000_000;

/// A scenario on boards in memory.
struct Bench {
    conductor: Conductor,
    world: World,
    hash: TraceHash,
}

impl Bench {
    fn start(scenario: &Scenario) -> Self {
        Self::on_can(scenario, &[], false)
    }

    /// With nodes on these buses, of CAN FD if `fd`; the others are on lines.
    fn on_can(scenario: &Scenario, buses: &[&[usize]], fd: bool) -> Self {
        let interfaces = (0..buses.len()).map(|bus| (format!("can{bus}"), fd)).collect();
        let bus_of = |node| buses.iter().position(|bus| bus.contains(&node));
        let mut conductor = conductor(scenario, LOCKSTEP, PATIENCE).with_can(interfaces, bus_of);
        let world = World::new(scenario.nodes.len(), TRAVEL, Peace);
        let mut world = buses.iter().fold(world, |world, nodes| world.with_bus(nodes, fd));
        world.run(conductor.meet()).unwrap();
        world.run(conductor.start()).unwrap();
        Self { conductor, world, hash: TraceHash::new() }
    }

    /// Runs one tick on every node, and gives what they saw.
    fn advance(&mut self) -> &[Observation<f32>] {
        self.world.run(self.conductor.advance()).unwrap();
        assert!(self.conductor.presence().iter().all(|&presence| presence == Presence::Ran));
        let seen = self.conductor.observations();
        self.hash.extend(seen.iter().map(|seen| seen.x));
        seen
    }
}

/// Compares hash, inputs, funnels and diffusive terms over all ticks.
fn assert_parity(scenario: &Scenario) {
    let bench = assert_same_bits(scenario, Bench::start(scenario));
    // Stale and duplicate states are refused alike by both.
    let refused = run(scenario, Fidelity::Loopback).bus.unwrap().refused.values().sum::<u64>();
    assert_eq!(refused, bench.world.boards().iter().map(|board| board.refused()).sum::<u64>());
}

fn assert_same_bits(scenario: &Scenario, mut bench: Bench) -> Bench {
    let loopback = run(scenario, Fidelity::Loopback);
    for (k, row) in loopback.rows.iter().enumerate() {
        let seen = bench.advance();
        let column = |value: fn(&Observation<f32>) -> f32| {
            seen.iter().map(|seen| f64::from(value(seen))).collect::<Vec<_>>()
        };
        assert_eq!(row.nu, column(|seen| seen.nu), "nu at tick {k}");
        assert_eq!(row.psi, column(|seen| seen.psi), "psi at tick {k}");
        assert_eq!(row.u, column(|seen| seen.u), "u at tick {k}");
    }
    assert_eq!(loopback.hash, Some(bench.hash));
    assert_eq!(bench.conductor.contradictions(), [""; 0]);
    bench
}

#[test]
fn also_on_can_on_two_buses_and_between_them_and_lines() {
    let ring = scenario("five-agents.toml", &["time.duration=300ms"]);
    let vectors = scenario("vector-oscillators.toml", &["time.duration=300ms"]);
    for fd in [false, true] {
        for (buses, shared) in
            [([0, 1, 2, 3, 4].as_slice(), [].as_slice()), (&[0, 1, 2], &[]), (&[0, 2], &[1, 4])]
        {
            let buses: Vec<_> = [buses, shared].into_iter().filter(|nodes| !nodes.is_empty()).collect();
            assert_same_bits(&ring, Bench::on_can(&ring, &buses, fd));
        }
        assert_same_bits(&vectors, Bench::on_can(&vectors, &[&[0, 1], &[2]], fd));
    }
}

#[test]
fn an_hour_of_five_nodes_takes_seconds_and_has_the_bits_of_loopback() {
    let scenario = scenario("average.toml", &["time.tick=100ms", "time.duration=1h"]);
    let begin = Instant::now();
    let mut bench = Bench::start(&scenario);
    for _ in 0..=scenario.time.ticks {
        bench.advance();
    }
    let took = begin.elapsed();
    assert_eq!(scenario.time.ticks, 36_000);
    let reports = bench.world.run(bench.conductor.finish()).unwrap();
    assert!(reports.iter().all(|report| report.as_ref().unwrap().counters.ticks == 36_001), "{reports:?}");
    assert_eq!(run(&scenario, Fidelity::Loopback).hash, Some(bench.hash));
    println!("an hour of five nodes at 10 Hz took {took:?}");
    assert!(took < Duration::from_secs(10), "{took:?}");
}

#[test]
fn sessions_on_serial_lines_run_the_bits_of_the_loopback_engine() {
    assert_parity(&scenario("five-agents.toml", &["time.duration=500ms"]));
}

#[test]
fn also_where_frames_are_lost_late_and_out_of_order() {
    let bus = ["time.duration=500ms", "bus.loss=0.1", "bus.latency=300us", "bus.jitter=900us"];
    assert_parity(&scenario("five-agents.toml", &bus));
    let worse = ["time.duration=500ms", "bus.loss=0.6", "bus.latency=2500us", "bus.jitter=5ms"];
    assert_parity(&scenario("five-agents.toml", &worse));
}

#[test]
fn also_with_vector_states() {
    assert_parity(&scenario("vector-oscillators.toml", &["time.duration=300ms", "bus.loss=0.1"]));
    assert_parity(&scenario("vector-max-gain.toml", &["time.duration=300ms", "bus.jitter=900us"]));
}

#[test]
fn also_with_every_coupling_that_runs_on_nodes() {
    let short = "time.duration=300ms";
    assert_parity(&scenario(
        "five-agents.toml",
        &[short, "coupling.kind=edge-wise", "coupling.funnel.rate=8"],
    ));
    assert_parity(&scenario("five-agents.toml", &[short, "coupling.kind=none"]));
    let linear = "coupling.gain={kind='linear',slope=20}";
    assert_parity(&scenario("five-agents.toml", &[short, "coupling.kind=linear", linear]));
    let tracker = [short, "coupling.kind=lambda-tracker", "coupling.eta=0.1", linear, "bus.loss=0.05"];
    assert_parity(&scenario("five-agents.toml", &tracker));
}

#[test]
fn also_with_schedules_noise_and_breaches() {
    let schedule =
        "coupling.funnel={kind='schedule',start=40,at='150ms',eps=0.01,then={kind='constant',width=1}}";
    // Noise that throws nodes out of the narrow part of the funnel.
    let noisy = |policy| {
        let sets = ["time.duration=300ms", schedule, "agent.noise=0.02", policy];
        scenario("five-agents.toml", &sets)
    };
    let reopen = noisy("coupling.on_breach={kind='reopen',margin=1.5,rate=20}");
    assert_parity(&reopen);
    let counters = run(&reopen, Fidelity::Loopback).counters;
    assert!(counters.iter().all(|counters| counters.reopened > 0), "{counters:?}");
    assert_ne!(
        run(&noisy("coupling.on_breach=ride"), Fidelity::Loopback).hash,
        run(&reopen, Fidelity::Loopback).hash
    );
}

#[test]
fn also_for_nodes_that_differ() {
    assert_parity(&system_tests::heterogeneous("500ms"));
}
