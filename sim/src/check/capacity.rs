//! What one state per node and tick takes of a bus (protocol/README.md, "Capacity").

use serde_json::json;

use super::{Finding, Status, figure};
use crate::scenario::{BusModel, Scenario, Wiring};

/// Load that a bus is planned for.
const PLANNED_LOAD: f64 = 0.7;

/// Worst-case load at which frames have no room any more, whatever their stuffing: 135 bits at most, 111 at
/// least.
const FULL: f64 = 135.0 / 111.0;

/// Data bytes of an authenticated state frame of one component.
const STATE_BYTES: u64 = 8;

/// The same in its plain form.
const PLAIN_BYTES: u64 = 5;
/// Bits of a state of one component on a serial line.
const LINE_BITS: f64 = 120.0;

/// The same in CAN FD, where a frame has all components, by their number less one.
const STATE_FD_BYTES: [u64; 8] = [16, 20, 24, 32, 32, 48, 48, 48];

/// Bit rates of CAN FD that the boards have (docs/book/src/boards.md): arbitration and data phase, bit/s.
const FD_RATES: (f64, f64) = (1e6, 2e6);

/// Bits of a classic CAN frame with an 11-bit id and `bytes` data bytes: worst-case stuffing, interframe
/// space included.
pub(super) fn classic_bits(bytes: u64) -> u64 {
    47 + 8 * bytes + (33 + 8 * bytes) / 4
}

/// Highest tick rate (Hz) at 70 % load for `nodes` on classic CAN with `bitrate` (bit/s).
pub(super) fn highest_rate(nodes: usize, bitrate: f64) -> f64 {
    PLANNED_LOAD * bitrate / (nodes as f64 * classic_bits(STATE_BYTES) as f64)
}

/// Time of a frame of CAN FD with an 11-bit id and `bytes` data bytes, s: worst-case stuffing, fixed stuff
/// bits of the CRC field, and interframe space included. Rates of arbitration and data phase in bit/s.
pub(super) fn fd_time(bytes: u64, (arbitration, data): (f64, f64)) -> f64 {
    let crc_field = if bytes > 16 { 32 } else { 27 };
    33.0 / arbitration + (7 + 10 * bytes + crc_field) as f64 / data
}

/// Highest tick rate (Hz) at 70 % load for `nodes` with states of so many components on CAN FD with these
/// rates (bit/s).
pub(super) fn highest_fd_rate(nodes: usize, components: usize, rates: (f64, f64)) -> f64 {
    // A state has eight components at most.
    let bytes = STATE_FD_BYTES.get(components.saturating_sub(1)).copied().unwrap_or(48);
    PLANNED_LOAD / (nodes as f64 * fd_time(bytes, rates))
}

/// Highest tick rate (Hz) at 70 % load on serial lines: a state of one component is a frame of twelve bytes
/// with ten bits each. The line from a hub to a node carries the states of all its neighbours.
fn highest_line_rate(scenario: &Scenario) -> f64 {
    let neighbours = (0..scenario.nodes.len()).map(|node| scenario.graph.neighbours(node).len()).max();
    let states = if scenario.bus.wiring == Wiring::Hub { neighbours.unwrap_or(1).max(1) } else { 1 };
    PLANNED_LOAD * f64::from(scenario.bus.bitrate) / (LINE_BITS * (states * scenario.components()) as f64)
}

/// The load that the scenario would put on classic CAN; a failure only where the bus is a real one.
pub(super) fn finding(scenario: &Scenario) -> Finding {
    // Every component has a frame of its own.
    let nodes = scenario.nodes.len() * scenario.components();
    let rate = 1.0 / scenario.time.tick_s();
    let (slow, fast) = (highest_rate(nodes, 5e5), highest_rate(nodes, 1e6));
    let fd = highest_fd_rate(scenario.nodes.len(), scenario.components(), FD_RATES);
    let load = PLANNED_LOAD * rate / fast;
    // Whether it carries them is said by the finding on the bus itself.
    let can = scenario.bus.model.is_can();
    let plain = classic_bits(STATE_BYTES) as f64 / classic_bits(PLAIN_BYTES) as f64;
    let rates = (f64::from(scenario.bus.bitrate), f64::from(scenario.bus.data_bitrate));
    let most = match scenario.bus.model {
        BusModel::Can => plain * highest_rate(nodes, rates.0),
        BusModel::CanFd => highest_fd_rate(scenario.nodes.len(), scenario.components(), rates),
        BusModel::Uart => highest_line_rate(scenario),
        BusModel::Ideal => fast,
    };
    let over = scenario.bus.model != BusModel::Ideal && rate > most;
    let scope = if can {
        let bitrate = figure(scenario.bus.bitrate.into());
        let most = figure(most.floor());
        let plainly = if scenario.bus.model == BusModel::Can {
            " as nodes speak now, without authentication"
        } else {
            ""
        };
        format!("the CAN bus of {bitrate} bit/s carries ticks of {most} Hz at 70 % load{plainly}")
    } else if scenario.bus.model == BusModel::Uart {
        let bitrate = figure(scenario.bus.bitrate.into());
        format!("serial lines of {bitrate} bit/s carry ticks of {} Hz at 70 % load", figure(most.floor()))
    } else {
        "no limit on the ideal bus".to_owned()
    };
    let text = format!(
        "{scope}; classic CAN at 1 Mbit/s would be loaded to {} % by a tick of {} Hz, and carries {} Hz at \
         70 % ({} Hz at 500 kbit/s; CAN FD with 2 Mbit/s in the data phase: {} Hz)",
        figure(100.0 * load),
        figure(rate),
        figure(fast.floor()),
        figure(slow.floor()),
        figure(fd.floor())
    );
    let values = json!({
        "tick_hz": rate,
        "can_1m_load": load,
        "can_1m_highest_hz": fast,
        "can_500k_highest_hz": slow,
        "can_fd_1m_2m_highest_hz": fd,
    });
    let found = Finding::new("capacity", "Capacity", text, values);
    let advice = || format!("lengthen the tick to {} s or more", figure(1.0 / most));
    match over {
        // More than there are bits, even where none is stuffed.
        true if !can && PLANNED_LOAD * rate / most > FULL => found.advise(Status::Fail, advice()),
        true => found.advise(Status::Warn, advice()),
        false => found.stands(Status::Note),
    }
}
