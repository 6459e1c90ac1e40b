//! Disturbed bits against the error counters of CAN controllers: a node whose controller goes off the bus stops.

use serde_json::json;

use super::bus::BYTES;
use super::silence::Hazard;
use super::stops::Share;
use super::{Finding, Status, share};
use crate::scenario::{BusModel, Scenario};
use funnelnet_can_bus::Id;
use funnelnet_can_bus::length::INTERMISSION;
use funnelnet_can_bus::response;
use funnelnet_law::math;

/// Transmit error counter from which on a controller is off the bus (ISO 11898-1).
const OFF: usize = 256;
/// What the counter gains by an error; a frame that goes out takes one away.
const GAIN: usize = 8;
/// Bits of an error frame that can be disturbed themselves.
const ERROR_BITS: f64 = 20.0;
/// Bits of a frame in which a disturbance is an error for all who wait to send: half of those of the arbitration, since a recessive
/// bit that all read as dominant is no error but the arbitration lost.
const CONTENDED_BITS: f64 = 6.0;

/// What there is to say; nothing where no bit is disturbed, and of a bus that is not computed.
pub(super) fn finding(scenario: &Scenario) -> Option<Finding> {
    let bus = &scenario.bus;
    if bus.model != BusModel::Can || bus.bit_errors == 0 {
        return None;
    }
    let errors = f64::from(bus.bit_errors) * 1e-9;
    let frames = scenario.time.ticks as f64 * scenario.components() as f64;
    let disturbed = |bits: u32| -math::exp_m1(f64::from(bits) * math::ln_1p(-errors));
    let [longest, shortest] = [response::longest_classic, response::shortest_classic]
        .map(|bits| bits(Id::Base(0), BYTES) - INTERMISSION);
    let times = (0..scenario.nodes.len()).map(|ahead| Hazard {
        low: frames * offs(errors_of_a_frame(disturbed(shortest), 0.0)),
        high: frames
            * offs(errors_of_a_frame(
                disturbed(longest),
                errors * (ERROR_BITS + CONTENDED_BITS * ahead as f64),
            )),
    });
    let share_of_runs = Share::of(times.fold(Hazard::default(), Hazard::plus));
    let text = format!(
        "up to {} of the frames are disturbed, and sent again; controllers go off the bus in {share_of_runs}",
        share(disturbed(longest))
    );
    let values = json!({
        "bit_errors": errors, "disturbed_low": disturbed(shortest), "disturbed_high": disturbed(longest),
        "share": share_of_runs.high, "share_at_least": share_of_runs.low,
    });
    let found = Finding::new("bus-off", "Bus-off", text, values);
    let status = share_of_runs.status();
    if status == Status::Ok {
        return Some(found);
    }
    let advice = format!(
        "nodes stop then (FAULT 5): a counter of errors rises by {GAIN} with each, also with those in the arbitration of frames ahead, and falls by one \
         with a frame of its own that goes out"
    );
    Some(found.advise(status, advice))
}

/// Errors that a sender counts until a frame of its own is out: those of this frame, which is disturbed with this probability, and so many
/// besides each time.
fn errors_of_a_frame(disturbed: f64, besides: f64) -> f64 {
    (disturbed + besides) / (1.0 - disturbed)
}

/// How often a controller goes off the bus in the time that a frame of its own takes to go out, with so many errors in that time.
fn offs(errors: f64) -> f64 {
    let rise = GAIN as f64 * errors - 1.0;
    // Of the changes of the counter this share is errors.
    let up = errors / (1.0 + errors);
    // lost[k]: off the bus before the counter is below k, from k on.
    let mut lost = [1.0; OFF + GAIN];
    let passes = |lost: &[f64; OFF + GAIN], above: usize| {
        lost.iter().skip(above + 1).take(GAIN).fold(0.0, |some, one| some + one * (1.0 - some))
    };
    for k in (1..OFF).rev() {
        let some = passes(&lost, k);
        lost[k] = up * some / (1.0 - up * (1.0 - some));
    }
    // The counter is at zero for what it does not rise to on average.
    let at_zero = if rise < 0.0 { -rise } else { 0.0 };
    let first = errors * at_zero * passes(&lost, 0);
    let drifts = if rise > 0.0 { rise / OFF as f64 } else { 0.0 };
    first + drifts
}
