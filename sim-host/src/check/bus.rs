//! Loss and delay of the bus against the tick.

use serde_json::json;

use super::subject::Subject;
use super::{Finding, Status, share};
use crate::scenario::format_duration;
use funnelnet_node::neighbour::WINDOW_BACK;

/// Loss up to which nothing was seen to suffer; at 30 % a narrow funnel is left now and then (README).
const HARMLESS_LOSS: f64 = 0.1;

/// What there is to say about the bus; nothing where it loses and delays nothing.
pub(super) fn findings(subject: &Subject<'_>) -> Option<Finding> {
    let (bus, tick_ns) = (&subject.scenario.bus, subject.scenario.time.tick_ns);
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
    // What arrives with the next tick is taken after it.
    let ticks_late = |delay: u64| delay / tick_ns;
    let in_time = format_duration((ticks_late(delay) + 1).saturating_mul(tick_ns));
    if bus.loss >= 1.0 {
        return Some(found.advise(Status::Fail, "every frame is lost: nobody ever hears anybody".to_owned()));
    }
    if ticks_late(bus.latency_ns) > u64::from(WINDOW_BACK) {
        let advice = format!(
            "a frame is heard for {WINDOW_BACK} ticks at most, so that nobody ever hears anybody; use a tick of {in_time} or more"
        );
        return Some(found.advise(Status::Fail, advice).set("time.tick", in_time));
    }
    if delay >= tick_ns && !subject.keeps() {
        let advice = format!(
            "frames come a tick or more late, which a narrow funnel does not survive; keep the delay below the tick, or use one of {in_time}"
        );
        return Some(found.advise(Status::Warn, advice).set("time.tick", in_time));
    }
    if bus.loss > HARMLESS_LOSS {
        let advice = format!(
            "a narrow funnel is left now and then; up to {} was seen to be harmless",
            share(HARMLESS_LOSS)
        );
        return Some(found.advise(Status::Warn, advice).set("bus.loss", format!("{HARMLESS_LOSS}")));
    }
    if delay >= tick_ns {
        let advice = "frames come a tick or more late; the law, followed with that over the whole run, stays inside its funnels";
        return Some(found.advise(Status::Note, advice.to_owned()));
    }
    Some(found.stands(Status::Note))
}
