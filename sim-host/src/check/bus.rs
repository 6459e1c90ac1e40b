//! Loss and delay of the bus against the tick.

use serde_json::json;

use super::subject::Subject;
use super::{Finding, Status, share};
use crate::scenario::{BusModel, format_duration};
use funnelnet_node::neighbour::WINDOW_BACK;
use funnelnet_node::params::LONGEST_ROUND;

/// Loss up to which `c` may stay as it is (LAW.md 4).
const HARMLESS_LOSS: f64 = 0.1;
/// `c` for a loss up to 20 %, and beyond.
const DAMPED: [(f64, f64); 2] = [(0.2, 3.0), (1.0, 4.0)];

/// Rounds that are long enough for every frame (LAW.md 5), as the setting where the run is a whole number of them.
fn decide_less_often(found: Finding, status: Status, why: &str, subject: &Subject<'_>) -> Finding {
    let (bus, time) = (&subject.scenario.bus, subject.scenario.time);
    let step_ns = time.tick_ns / u64::from(time.round);
    let steps = time.ticks.saturating_mul(time.round.into());
    let needed = bus.latency_ns.saturating_add(bus.jitter_ns) / step_ns + 1;
    let whole = (needed..=u64::from(LONGEST_ROUND)).find(|round| steps.is_multiple_of(*round));
    match whole {
        Some(round) => {
            let round = format_duration(round.saturating_mul(step_ns));
            found
                .advise(
                    status,
                    format!("{why}; decide once in a round of {round}, by which every frame has come"),
                )
                .set("time.round", round)
        }
        None => {
            let tick = format_duration(needed.saturating_mul(step_ns));
            found.advise(status, format!("{why}; use a tick of {tick}, by which every frame has come"))
        }
    }
}

/// `c` that bounds what steep gains make of the loss.
fn needed_damping(subject: &Subject<'_>) -> f64 {
    let loss = subject.scenario.bus.loss.mean();
    DAMPED.into_iter().find(|(up_to, _)| loss <= *up_to).map_or(4.0, |(_, damping)| damping)
}

fn is_damped(subject: &Subject<'_>) -> bool {
    let needed = needed_damping(subject);
    subject.scenario.nodes.iter().all(|node| node.damping >= needed)
}

/// More damping, which bounds what steep gains make of a lossy bus.
fn damp(found: Finding, subject: &Subject<'_>) -> Finding {
    if is_damped(subject) {
        let advice = format!(
            "a narrow funnel is left now and then, whatever the damping; up to {} was seen to be harmless",
            share(HARMLESS_LOSS)
        );
        return found.advise(Status::Warn, advice).set("bus.loss", format!("{HARMLESS_LOSS}"));
    }
    let damping = needed_damping(subject);
    let advice = format!(
        "a narrow funnel is left now and then, and steep gains run away; a damping of {damping} bounds them"
    );
    found.advise(Status::Warn, advice).set("coupling.damping", format!("{damping}"))
}

/// What links do is not followed: the law is, with the bus alone.
fn of_links(subject: &Subject<'_>) -> Finding {
    let count = subject.scenario.links.len();
    let text = format!(
        "what {count} [[link]] directions do to frames is not followed: all that is predicted is without them"
    );
    Finding::new("bus", "Bus", text, json!({ "links": count })).stands(Status::NotChecked)
}

/// A bus with bits: what is followed is the ideal one.
fn real(bit_errors: f64) -> Finding {
    let errors = match bit_errors {
        0.0 => String::new(),
        share => format!(", nor what {share} of its bits in error do"),
    };
    let text = format!(
        "the time that frames take on it is not followed{errors}: all that is predicted is of the ideal bus"
    );
    Finding::new("bus", "Bus", text, json!({ "bit_errors": bit_errors })).stands(Status::NotChecked)
}

/// What there is to say about the bus; nothing where it loses and delays nothing.
pub(super) fn findings(subject: &Subject<'_>) -> Option<Finding> {
    let (bus, tick_ns) = (&subject.scenario.bus, subject.scenario.time.tick_ns);
    let delay = bus.latency_ns.saturating_add(bus.jitter_ns);
    let loss = bus.loss.mean();
    if bus.model != BusModel::Ideal {
        return Some(real(f64::from(bus.bit_errors) * 1e-9));
    }
    if bus.loss.is_none() && delay == 0 {
        return (!subject.scenario.links.is_empty()).then(|| of_links(subject));
    }
    let text = format!(
        "{} of the frames lost per receiver, delay from {} to {}",
        share(loss),
        format_duration(bus.latency_ns),
        format_duration(delay)
    );
    let (latency, jitter) = (bus.latency_ns as f64 * 1e-9, bus.jitter_ns as f64 * 1e-9);
    let values = json!({ "loss": loss, "latency_s": latency, "jitter_s": jitter });
    let found = Finding::new("bus", "Bus", text, values);
    // What arrives with the next tick is taken after it.
    let ticks_late = |delay: u64| delay / tick_ns;
    if loss >= 1.0 {
        return Some(found.advise(Status::Fail, "every frame is lost: nobody ever hears anybody".to_owned()));
    }
    if ticks_late(bus.latency_ns) > u64::from(WINDOW_BACK) {
        let why =
            format!("a frame is heard for {WINDOW_BACK} ticks at most, so that nobody ever hears anybody");
        return Some(decide_less_often(found, Status::Fail, &why, subject));
    }
    if delay >= tick_ns && !subject.keeps() {
        let why = "frames come a tick or more late, which a narrow funnel does not survive";
        return Some(decide_less_often(found, Status::Warn, why, subject));
    }
    if loss > HARMLESS_LOSS && !(subject.keeps() && is_damped(subject)) {
        return Some(damp(found, subject));
    }
    if delay >= tick_ns {
        let advice = "frames come a tick or more late; the law, followed with that over the whole run, stays inside its funnels";
        return Some(found.advise(Status::Note, advice.to_owned()));
    }
    Some(found.stands(Status::Note))
}
