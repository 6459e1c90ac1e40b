//! Loss and delay of the bus against the tick.

use serde_json::json;

use super::{Finding, Status, share};
use crate::scenario::{Scenario, format_duration};

/// Loss up to which nothing was seen to suffer; at 30 % a narrow funnel is left now and then (README).
const HARMLESS_LOSS: f64 = 0.1;

/// What there is to say about the bus; nothing where it loses and delays nothing.
pub(super) fn findings(scenario: &Scenario) -> Option<Finding> {
    let bus = &scenario.bus;
    let delay = bus.latency_ns.saturating_add(bus.jitter_ns);
    if bus.loss == 0.0 && delay == 0 {
        return None;
    }
    let text = format!(
        "{} of the frames lost per receiver, delay from {} to {}",
        share(bus.loss),
        format_duration(bus.latency_ns),
        format_duration(delay)
    );
    let (latency, jitter) = (bus.latency_ns as f64 * 1e-9, bus.jitter_ns as f64 * 1e-9);
    let values = json!({ "loss": bus.loss, "latency_s": latency, "jitter_s": jitter });
    let found = Finding::new("bus", "Bus", text, values);
    if delay >= scenario.time.tick_ns {
        let advice = format!(
            "frames come a tick or more late, which a narrow funnel does not survive; keep the delay below the tick of {}",
            format_duration(scenario.time.tick_ns)
        );
        return Some(found.advise(Status::Warn, advice));
    }
    if bus.loss > HARMLESS_LOSS {
        let advice = format!(
            "a narrow funnel is left now and then; up to {} was seen to be harmless",
            share(HARMLESS_LOSS)
        );
        return Some(found.advise(Status::Warn, advice));
    }
    Some(found.stands(Status::Note))
}
