//! Limits of what nodes take of each other, against what honest ones say.

use serde_json::json;

use super::subject::Subject;
use super::{Finding, Status, figure, largest};

use crate::sampled::{self, Bounds};

/// Noise of two states in a row that goes beyond this many standard deviations is not waited for.
const DEVIATIONS: f64 = 6.0;
/// What is advised, over what is needed.
const ROOM: f64 = 1.5;

/// What there is to say; nothing where there is no such limit.
pub(super) fn finding(subject: &Subject<'_>) -> Option<Finding> {
    let scenario = subject.scenario;
    let safety = scenario.safety;
    if safety.heard_limit.is_none() && safety.heard_rate.is_none() {
        return None;
    }
    let new = |text, values| Finding::new("heard", "What is heard", text, values);
    let Some(followed) = sampled::undisturbed(scenario) else {
        let text =
            "how fast honest nodes move is not known for this law, or for a run of this length".to_owned();
        return Some(new(text, json!({})).stands(Status::NotChecked));
    };
    let tick = scenario.time.tick_s();
    let noise = largest(scenario.nodes.iter().map(|node| node.noise)).1;
    let rate = followed.slope + DEVIATIONS * 2.0_f64.sqrt() * noise / tick;
    let far = largest(followed.last.iter().map(|x| x.abs())).1;
    let mut text = format!("honest states change by up to {} per second undisturbed", figure(rate));
    if let Some(limit) = safety.heard_rate {
        text += &format!(
            "; {} is taken. A jump of more than {} is not, and one of more than {} drops the edge",
            figure(limit),
            figure(limit * tick),
            figure(limit * tick * f64::from(safety.drop_after))
        );
    }
    let values = json!({
        "rate": rate, "heard_rate": safety.heard_rate, "ends_at": far, "heard_limit": safety.heard_limit,
        "drop_after": safety.drop_after,
    });
    let found = new(text, values);
    let then = "honest states are not taken then, and their edges are dropped";
    if safety.heard_rate.is_some_and(|limit| limit < rate) {
        let advice = format!("{then}; let safety.heard_rate be {} or more", figure(ROOM * rate));
        return Some(found.advise(Status::Warn, advice).set("safety.heard_rate", figure(ROOM * rate)));
    }
    let bound = Bounds::of(scenario).input;
    if let Some((limit, bound)) = safety.heard_rate.zip(bound).filter(|(limit, bound)| limit < bound) {
        let advice = format!(
            "after an event inputs reach {}, and honest nodes may be faster than what is taken: edges between them can be dropped; let \
             coupling.u_max be below {} by what the fields do",
            figure(bound),
            figure(limit)
        );
        return Some(found.advise(Status::Warn, advice));
    }
    if safety.heard_limit.is_some_and(|limit| limit < far) {
        let advice = format!("states end at {}; {then}; let safety.heard_limit be larger", figure(far));
        return Some(found.advise(Status::Warn, advice).set("safety.heard_limit", figure(ROOM * far)));
    }
    Some(found)
}
