//! The bounds of a disturbed network (law.md 9), and whether a bound that the designer gives clips what the
//! law does undisturbed.

use serde_json::json;

use super::subject::Subject;
use super::{Finding, Status, figure};
use crate::sampled::{self, Bounds};

/// What there is to say; nothing where nothing can disturb and no bound is given.
pub(super) fn finding(subject: &Subject<'_>) -> Option<Finding> {
    let scenario = subject.scenario;
    let bounds = Bounds::of(scenario);
    if bounds == Bounds::NONE {
        return None;
    }
    let input = bounds.input.map_or("without bound".to_owned(), |input| format!("at most {}", figure(input)));
    let slope = bounds
        .slope
        .map_or("without bound".to_owned(), |slope| format!("by at most {} per second", figure(slope)));
    let text = format!(
        "inputs {input}; a silent neighbour is extrapolated for {} ticks, {slope}",
        bounds.extrapolate
    );
    let values = json!({
        "u_max": bounds.input, "slope_max": bounds.slope, "extrapolate_ticks": bounds.extrapolate,
    });
    let found = Finding::new("bounds", "Bounds", text, values).stands(Status::Note);
    let (Some(given), Some(largest)) = (scenario.u_max, undisturbed_input(subject)) else {
        return Some(found);
    };
    if given >= largest {
        return Some(found);
    }
    let advice = format!(
        "the law asks for {} undisturbed, so that this bound clips it; twelve times as much is what a node is told by default",
        figure(largest)
    );
    Some(found.advise(Status::Warn, advice).set("coupling.u_max", figure(12.0 * largest)))
}

fn undisturbed_input(subject: &Subject<'_>) -> Option<f64> {
    sampled::undisturbed(subject.scenario).map(|followed| followed.input)
}
