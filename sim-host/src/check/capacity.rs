//! What one state per node and tick takes of a bus (protocol/README.md, "Capacity").

use serde_json::json;

use super::{Finding, Status, figure};
use crate::scenario::{BusModel, Scenario};

/// Load that a bus is planned for.
const PLANNED_LOAD: f64 = 0.7;

/// Data bytes of an authenticated state frame.
const STATE_BYTES: u64 = 8;

/// Bits of a classic CAN frame with an 11-bit id and `bytes` data bytes: worst-case stuffing, interframe
/// space included.
pub(super) fn classic_bits(bytes: u64) -> u64 {
    47 + 8 * bytes + (33 + 8 * bytes) / 4
}

/// Highest tick rate (Hz) at 70 % load for `nodes` on classic CAN with `bitrate` (bit/s).
pub(super) fn highest_rate(nodes: usize, bitrate: f64) -> f64 {
    PLANNED_LOAD * bitrate / (nodes as f64 * classic_bits(STATE_BYTES) as f64)
}

/// The load that the scenario would put on classic CAN; a failure only where the bus is a real one.
pub(super) fn finding(scenario: &Scenario) -> Finding {
    // Every component has a frame of its own.
    let nodes = scenario.nodes.len() * scenario.components();
    let rate = 1.0 / scenario.time.tick_s();
    let (slow, fast) = (highest_rate(nodes, 5e5), highest_rate(nodes, 1e6));
    let load = PLANNED_LOAD * rate / fast;
    let over = scenario.bus.model != BusModel::Ideal && rate > fast;
    let text = format!(
        "no limit on the ideal bus; classic CAN at 1 Mbit/s would be loaded to {} % by a tick of {} Hz, and carries {} Hz at \
         70 % ({} Hz at 500 kbit/s)",
        figure(100.0 * load),
        figure(rate),
        figure(fast.floor()),
        figure(slow.floor())
    );
    let values = json!({
        "tick_hz": rate,
        "can_1m_load": load,
        "can_1m_highest_hz": fast,
        "can_500k_highest_hz": slow,
    });
    let found = Finding::new("capacity", "Capacity", text, values);
    match over {
        true => found.advise(Status::Fail, format!("lengthen the tick to {} s or more", figure(1.0 / fast))),
        false => found.stands(Status::Note),
    }
}
