//! Limits of actuators against what the law asks for.

use serde_json::json;

use super::subject::Subject;
use super::{Finding, Status, figure, largest};
use crate::extremes::larger;
use crate::scenario::NodeSpec;

/// `None` where no node has limits.
pub(super) fn finding(subject: &Subject<'_>) -> Option<Finding> {
    let nodes = &subject.scenario.nodes;
    let limited = |node: &NodeSpec| node.limits.is_some();
    if !nodes.iter().any(limited) {
        return None;
    }
    let new = |text, values| Finding::new("limits", "Limits of inputs", text, values);
    let Some(forecast) = &subject.forecast else {
        let text = "what inputs are needed is not known for this coupling and these states".to_owned();
        return Some(new(text, json!({})).stands(Status::NotChecked));
    };
    // How much of what its actuator can do a node needs; with a sign that is not known here, of the stronger
    // side.
    let share = |(node, seen): (&NodeSpec, &super::forecast::NodeSeen)| {
        node.limits.map_or(0.0, |limits| seen.input / larger(-limits.low, limits.high))
    };
    let (index, share) = largest(nodes.iter().zip(&forecast.nodes).map(share));
    let (node, needed) = (&nodes[index], forecast.nodes[index].input);
    let (low, high) = node.limits.map_or((0.0, 0.0), |limits| (limits.low, limits.high));
    let text = format!(
        "once the states have met, node {} needs inputs up to {} (limits {} to {})",
        node.id,
        figure(needed),
        figure(low),
        figure(high)
    );
    let found =
        new(text, json!({ "node": node.id, "needed": needed, "low": low, "high": high, "share": share }));
    if share < 1.0 {
        return Some(found);
    }
    if subject.keeps() {
        let advice = "its actuator is at a limit then, and the prediction of xi does not hold; the law itself, followed over the whole run, \
                      stays inside (below)";
        return Some(found.advise(Status::Note, advice.to_owned()));
    }
    let advice = "it cannot follow, its diffusive term leaves the funnel while its actuator is at a limit, and the prediction of xi does \
                  not hold; widen the limits, or bring the fields closer together";
    Some(found.advise(Status::Warn, advice.to_owned()))
}
