//! What the scenario expects, against what is predicted.

use serde_json::json;

use super::subject::Subject;
use super::{Finding, Status, extremes, figure};
use crate::extremes::{larger, largest};
use crate::sampled::Followed;
use crate::scenario::Window;

/// Part by which a prediction may miss its limit before it counts as missed.
const MISSED: f64 = 1.05;

/// One finding per expectation that is set.
pub(super) fn findings(subject: &Subject<'_>) -> Vec<Finding> {
    let expect = &subject.scenario.expect;
    let run = subject.run();
    let mut found = Vec::new();
    let mut judge = |name, key, limit: Option<f64>, value: Option<f64>| {
        found.extend(limit.map(|limit| judged(name, key, limit, value)));
    };
    judge("expect-funnel-ratio", "funnel_ratio", expect.funnel_ratio, run.map(|run| run.worst.ratio));
    judge("expect-final-spread", "final_spread", expect.final_spread, run.map(|run| spread(subject, run)));
    // Looked at where they are expected only.
    let to_xi = expect.emergent_error.and_then(|_| from_xi(subject));
    judge("expect-emergent-error", "emergent_error", expect.emergent_error, to_xi);
    let to_blended = expect.blended_error.and_then(|_| from_blended(subject));
    judge("expect-blended-error", "blended_error", expect.blended_error, to_blended);
    judge("expect-reference-error", "reference_error", expect.reference_error, None);
    judge("expect-max-input", "max_input", expect.max_input, run.map(|run| run.input));
    let within = expect.recovered_within_ns.map(|ns| ns as f64 / 1e9);
    judge("expect-recovered-within", "recovered_within", within, None);
    found.extend(expect.final_value.map(|value| {
        let missed = final_states(subject).map(|states| {
            let apart = states.iter().map(|x| (x - value.is).abs());
            largest(0.0, apart)
        });
        let found = judged("expect-final-value", "final_value", value.within, missed);
        Finding { text: format!("{} (from {})", found.text, figure(value.is)), ..found }
    }));
    for (index, window) in expect.windows.iter().enumerate() {
        found.extend(of_window(subject, window, index));
    }
    found
}

/// The same for a part of the run.
fn of_window(subject: &Subject<'_>, window: &Window, index: usize) -> Vec<Finding> {
    let seen = subject.run().and_then(|run| run.windows.get(index));
    let mut found = Vec::new();
    let mut judge = |key: &str, limit: Option<f64>, value: Option<f64>| {
        let key = format!("windows.{index}.{key}");
        found.extend(limit.map(|limit| judged("expect-windows", &key, limit, value)));
    };
    judge("funnel_ratio", window.funnel_ratio, seen.map(|seen| seen.ratio));
    judge("spread", window.spread, seen.map(|seen| seen.spread));
    judge("max_input", window.max_input, seen.map(|seen| seen.input));
    let from_xi = seen.filter(|seen| !seen.reach.is_empty()).and_then(|seen| {
        let forecast =
            subject.forecast.as_ref().filter(|forecast| forecast.grid.reaches(subject.scenario))?;
        let apart = seen.reach.iter().map(|&(t, low, high)| {
            let xi = forecast.xi_at(t);
            larger((low - xi).abs(), (high - xi).abs())
        });
        Some(largest(0.0, apart))
    });
    judge("emergent_error", window.emergent_error, from_xi);
    judge("reference_error", window.reference_error, None);
    found
}

fn judged(name: &'static str, key: &str, limit: f64, value: Option<f64>) -> Finding {
    let values = json!({ "limit": limit, "predicted": value });
    let Some(value) = value else {
        let text = format!("{key} below {}: not predicted here", figure(limit));
        return Finding::new(name, "Expected", text, values).stands(Status::NotChecked);
    };
    let text = format!("{key} below {}: predicted {}", figure(limit), figure(value));
    let found = Finding::new(name, "Expected", text, values);
    let (holds, nearly) = (value < limit, value < MISSED * limit);
    match (holds, nearly) {
        (true, _) => found,
        (false, true) => found.advise(Status::Warn, "the prediction is at the limit".to_owned()),
        (false, false) => {
            found.advise(Status::Fail, "the prediction and the expectation contradict each other".to_owned())
        }
    }
}

/// The states at the end, by index: those of the law, or `xi` for all, which is what they meet at.
fn final_states(subject: &Subject<'_>) -> Option<Vec<f64>> {
    match (subject.run(), &subject.forecast) {
        (Some(run), _) => Some(run.last.clone()),
        (None, Some(forecast)) if forecast.grid.reaches(subject.scenario) => Some(vec![forecast.xi_end()]),
        _ => None,
    }
}

/// The largest distance between two states, component by component.
fn spread(subject: &Subject<'_>, run: &Followed) -> f64 {
    let components = subject.scenario.components();
    let of = |component: usize| {
        let (low, high) = extremes(run.last.iter().skip(component).step_by(components).copied());
        high - low
    };
    larger(largest(0.0, (0..components).map(of)), rounding(run))
}

/// What f32 leaves of the states at the end.
fn rounding(run: &Followed) -> f64 {
    0.5 * f64::from(f32::EPSILON) * largest(0.0, run.last.iter().map(|x| x.abs()))
}

fn from_xi(subject: &Subject<'_>) -> Option<f64> {
    match &subject.forecast {
        Some(forecast) => from(subject, &[forecast.xi_end()]),
        None => from(subject, &subject.aims()?.xi),
    }
}

fn from_blended(subject: &Subject<'_>) -> Option<f64> {
    match &subject.forecast {
        Some(forecast) => from(subject, &[forecast.blended_end]),
        None => from(subject, &subject.aims()?.blended),
    }
}

/// The largest distance of the law's last states from a point, by component; none where the law or the point
/// is not known to the end.
fn from(subject: &Subject<'_>, point: &[f64]) -> Option<f64> {
    let reaches = subject.forecast.as_ref().is_none_or(|forecast| forecast.grid.reaches(subject.scenario));
    let run = subject.run().filter(|_| reaches && !point.is_empty())?;
    let apart = run.last.iter().zip(point.iter().cycle()).map(|(x, point)| (x - point).abs());
    Some(larger(largest(0.0, apart), rounding(run)))
}
