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
        let column = |value: fn(&funnel_protocol::report::Telemetry) -> f32| {
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
fn also_for_nodes_that_differ() {
    assert_parity(&system_tests::heterogeneous("500ms"));
}
