//! Events: nothing here follows what they do.

use serde_json::json;

use super::text::plural;
use super::{Finding, Status};
use crate::scenario::{Detail, EventSpec, Scenario, Targets};

/// Says that events are not followed, where there are some.
pub(super) fn finding(scenario: &Scenario) -> Option<Finding> {
    let count = scenario.events.len();
    let text = format!(
        "{}: not followed; what is found here is of all nodes and links, from the start to the end{}",
        plural(count, "event"),
        what_is_set(scenario)
    );
    let values = json!({ "events": count });
    (count > 0).then(|| Finding::new("events", "Events", text, values).stands(Status::NotChecked))
}

/// How to check what events set for all nodes.
fn what_is_set(scenario: &Scenario) -> String {
    let of = |event: &EventSpec| match (&event.targets, &event.detail) {
        // A shell takes all between single quotes as it is, but for a single quote.
        (Targets::AllNodes, Detail::Set(new)) => {
            Some(format!("--set '{}={}'", new.key, new.toml.replace('\'', r"'\''")))
        }
        _ => None,
    };
    let sets: Vec<String> = scenario.events.iter().filter_map(of).collect();
    if sets.is_empty() {
        return String::new();
    }
    format!("; to check what is set, set it from the start: {}", sets.join(" "))
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
