//! Events: nothing here follows what they do.

use serde_json::json;

use super::text::plural;
use super::{Finding, Status};
use crate::scenario::Scenario;

/// Says that events are not followed, where there are some.
pub(super) fn finding(scenario: &Scenario) -> Option<Finding> {
    let count = scenario.events.len();
    let text = format!(
        "{}: not followed; what is found here is of all nodes and links, from the start to the end",
        plural(count, "event")
    );
    let values = json!({ "events": count });
    (count > 0).then(|| Finding::new("events", "Events", text, values).stands(Status::NotChecked))
}

/// Takes the verdict from findings about a run that is another one with events: what the scenario expects,
/// and, where nodes are absent at first, what the law does from the start.
pub(super) fn unsettle(scenario: &Scenario, findings: &mut [Finding]) {
    if scenario.events.is_empty() {
        return;
    }
    let course = scenario.course();
    let anew = (0..scenario.nodes.len()).any(|node| course.begins_absent(node));
    for finding in findings {
        let of_the_run = finding.name.starts_with("expect-");
        if of_the_run || anew && FROM_THE_START.contains(&finding.name) {
            finding.status = Status::NotChecked;
            finding.text += ", without events";
            finding.advice = None;
        }
    }
}

/// Findings that follow all nodes from their initial states on.
const FROM_THE_START: [&str; 2] = ["kick", "sampled"];
