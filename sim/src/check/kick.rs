//! The first tick: the fields move the states before any input can answer (law.md 6).

use funnelnet_law::Real;
use serde_json::json;

use super::shorter;
use super::subject::Subject;
use super::{Finding, Status, figure, tick_of, width_of};
use crate::extremes::larger;
use crate::scenario::{Coupling, Scenario};

/// From where on it is warned about, and from where on the funnel is left at the first tick.
pub(super) const SMALL: f64 = 0.5;
const WHOLE: f64 = 1.0;
/// What advice aims at.
const GOOD: f64 = 0.4;

/// `T |sum_j alpha_ij (f_j - f_i)(0)| / psi_i(T)`; only for couplings that keep funnels.
pub(super) fn finding(subject: &Subject<'_>) -> Option<Finding> {
    let scenario = subject.scenario;
    if !scenario.coupling.keeps_funnels() {
        return None;
    }
    let (index, kick) = largest(scenario);
    let text = format!(
        "the fields alone move |nu| by {} of the funnel within the first tick, at node {}",
        figure(kick),
        index + 1
    );
    let found = Finding::new("kick", "Start kick", text, json!({ "kick": kick, "node": index + 1 }));
    // Written so that what is not a number is not small.
    let small = kick < SMALL;
    if small {
        return Some(found);
    }
    let seconds = scenario.time.tick_s() * GOOD / kick;
    let tick = tick_of(seconds).map(|tick| format!("use a tick of {tick} or less"));
    let times = width_of(kick / GOOD).map(|times| format!("start in a funnel {times} times as wide"));
    let ways: Vec<_> = tick.into_iter().chain(times).collect();
    let advice = match ways.is_empty() {
        true => {
            "no input can answer before that, and the funnel has closed by then; let it be wider at the start"
                .to_owned()
        }
        false => format!("no input can answer before that; {}", ways.join(", or ")),
    };
    let inside = kick < WHOLE || subject.followed.as_ref().is_some_and(|followed| followed.start.ratio < 1.0);
    let status = if inside { Status::Warn } else { Status::Fail };
    Some(shorter::set(found.advise(status, advice), scenario, seconds))
}

/// Index of the node that is kicked most, and how far.
pub(super) fn largest(scenario: &Scenario) -> (usize, f64) {
    let after = scenario.time.at_s(1);
    let mut kicks = vec![0.0; scenario.nodes.len()];
    for component in 0..scenario.components() {
        let fields: Vec<f64> =
            scenario.nodes.iter().map(|node| node.dynamics.component(component, 0.0, &node.state)).collect();
        for (kick, drift) in kicks.iter_mut().zip(drifts(scenario, &fields)) {
            *kick = larger(*kick, drift.abs());
        }
    }
    let nodes = scenario.nodes.iter().zip(kicks);
    // Nothing is thrown out where nothing moves, however narrow the funnel is.
    super::largest(nodes.map(|(node, kick)| match kick == 0.0 {
        true => 0.0,
        // More than nothing, so that a funnel that has closed by then has a ratio.
        false => scenario.time.period_s(0) * kick / larger(node.funnel.width(after), f64::TINY),
    }))
}

/// How fast the fields move what each node keeps in its funnel: its diffusive term, or that of its worst
/// edge.
fn drifts(scenario: &Scenario, fields: &[f64]) -> Vec<f64> {
    if scenario.coupling != Coupling::EdgeWise {
        return scenario.graph.diffusive_terms(fields);
    }
    let mut worst = vec![0.0; fields.len()];
    for edge in &scenario.graph.edges {
        let drift = edge.weight * (fields[edge.b] - fields[edge.a]).abs();
        worst[edge.a] = larger(worst[edge.a], drift);
        worst[edge.b] = larger(worst[edge.b], drift);
    }
    worst
}
