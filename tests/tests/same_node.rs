//! Parity where there is no emulator: the loopback engine (CAN frames, timer) and sessions behind serial lines (SYNC,
//! telemetry) in one process. What is left for `parity.rs` is the target: its compiler, FPU and UART.
#![allow(clippy::unwrap_used, reason = "helpers of tests, which clippy does not know as such")]

use sim_host::run::Fidelity;
use sim_host::scenario::Scenario;
use system_tests::memory::MemoryNet;
use system_tests::{run, scenario};

/// Compares hash, inputs, funnels and diffusive terms over all ticks.
fn assert_parity(scenario: &Scenario) {
    let loopback = run(scenario, Fidelity::Loopback);
    let mut net = MemoryNet::start(scenario);
    for (k, row) in loopback.rows.iter().enumerate() {
        let seen = net.advance();
        let column = |value: fn(&funnelnet_protocol::report::Telemetry) -> f32| {
            seen.iter().map(|telemetry| f64::from(value(telemetry))).collect::<Vec<_>>()
        };
        assert_eq!(row.nu, column(|seen| seen.nu), "nu at tick {k}");
        assert_eq!(row.psi, column(|seen| seen.psi), "psi at tick {k}");
        assert_eq!(row.u, column(|seen| seen.u), "u at tick {k}");
    }
    assert_eq!(loopback.hash, Some(net.hash()));
    // Stale and duplicate states are refused alike by both.
    let refused = loopback.bus.unwrap().refused.values().sum::<u64>();
    assert_eq!(refused, net.boards().iter().map(|board| u64::from(board.refused())).sum::<u64>());
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
