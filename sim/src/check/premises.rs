//! What a prediction rests on. Where a premise does not hold, the finding says so and no longer reads as if
//! it held.

use super::forecast::Forecast;
use super::subject::Subject;
use super::{Advice, Finding, Status, about, figure};
use crate::extremes::{larger, largest, smallest};
use crate::scenario::{BusModel, FloorSpec};

/// Time constants of the emergent dynamics after which a wrong start is forgotten: e^-4 is 2 %.
const SETTLED: f64 = 4.0;
/// Findings that say where the network goes.
const OF_XI: [&str; 3] = ["prediction", "expect-emergent-error", "expect-final-value"];

/// Lowers what says more than its premises allow.
pub(super) fn lower(subject: &Subject<'_>, findings: &mut [Finding]) {
    let Some(forecast) = &subject.forecast else { return };
    let missing: Vec<_> = [
        floors(subject, forecast),
        contraction(subject, forecast),
        shift(subject, forecast),
        mean(subject),
        looked_at(subject),
    ]
    .into_iter()
    .flatten()
    .collect();
    if missing.is_empty() {
        return;
    }
    for finding in findings.iter_mut().filter(|finding| finding.name == OF_XI[0]) {
        let before = finding.advice.take().map(|advice| advice.text);
        let text: Vec<_> = before.into_iter().chain(missing.iter().cloned()).collect();
        finding.advice = Some(Advice::new(text.join("; ")));
        if finding.status == Status::Ok {
            finding.status = Status::Note;
        }
    }
    // An expectation that was compared with xi and not with the law.
    let rests_on_xi = |finding: &&mut Finding| OF_XI[1..].contains(&finding.name) && subject.run().is_none();
    for finding in findings.iter_mut().filter(rests_on_xi).filter(|finding| finding.status == Status::Ok) {
        finding.status = Status::NotChecked;
        finding.text += ", by xi alone: the law was not followed to the end";
    }
}

/// A node at its floor counts with the width of that, and not of its funnel.
fn floors(subject: &Subject<'_>, forecast: &Forecast) -> Option<String> {
    let end = subject.scenario.time.end_s();
    let asked = match subject.scenario.floor {
        FloorSpec::Width(width) => width,
        FloorSpec::None | FloorSpec::F32 => 0.0,
    };
    let widths = subject.widths.at(end).map(|width| larger(width, asked)).zip(&forecast.resolution);
    // How much wider than its funnel each node keeps it.
    let wider: Vec<f64> = widths.map(|(psi, floor)| larger(psi, *floor) / psi).collect();
    let (low, high) = (smallest(f64::INFINITY, wider.iter().copied()), largest(0.0, wider.iter().copied()));
    let alike = high <= 1.01 * low || !high.is_finite() && same_floors(forecast);
    (!alike).then(|| {
        "floors of f32 make funnels unequal that the scenario has equal (or change their ratio), so that the weights in xi are not those of the \
         funnels at the end"
            .to_owned()
    })
}

/// Funnels that have all closed are kept at their floors, which are the weights then.
fn same_floors(forecast: &Forecast) -> bool {
    let floors = || forecast.resolution.iter().copied();
    largest(0.0, floors()) <= 1.01 * smallest(f64::INFINITY, floors())
}

/// The start is forgotten by contraction only.
fn contraction(subject: &Subject<'_>, forecast: &Forecast) -> Option<String> {
    let constants = -forecast.slope_mean * subject.scenario.time.end_s();
    // Not a number is not settled.
    let settled = constants >= SETTLED;
    (!settled).then(|| {
        format!(
            "the emergent dynamics contract by {} time constants within the run ({} make a start forgotten), so that xi is only as good as its \
             start, the mean of the states",
            about(constants.max(0.0)),
            about(SETTLED)
        )
    })
}

/// How far the law itself ends from xi, beside what the funnels allow for.
fn shift(subject: &Subject<'_>, forecast: &Forecast) -> Option<String> {
    let run = subject.run()?;
    if !forecast.grid.reaches(subject.scenario) {
        return None;
    }
    let (xi, psi) = (forecast.xi_end(), subject.widest_kept(subject.scenario.time.end_s()));
    let away = largest(0.0, run.last.iter().map(|x| (x - xi).abs()));
    let allowed = subject.bound_per_width() * psi;
    let near = away <= allowed;
    (!near).then(|| {
        format!(
            "the law, followed in f64, ends {} from xi, {} funnels: a tick this long, or a start that is not forgotten, shifts it by that",
            figure(away),
            about(away / psi)
        )
    })
}

/// The mean of the states is kept by inputs that add up to nothing.
fn mean(subject: &Subject<'_>) -> Option<String> {
    let scenario = subject.scenario;
    let what = if !scenario.bus.loss.is_none() {
        "frames that are lost"
    } else if scenario.bus.latency_ns.saturating_add(scenario.bus.jitter_ns) >= scenario.time.tick_ns {
        "frames that come late"
    } else if scenario.nodes.iter().any(|node| node.noise > 0.0) {
        "noise"
    } else if scenario.u_max.is_some() {
        "inputs that are clipped"
    } else if scenario.bus.model != BusModel::Ideal {
        "frames that a real bus loses or delays"
    } else {
        return None;
    };
    // Forgotten with the start.
    let forgets = subject.forecast.as_ref().is_some_and(|forecast| {
        let constants = -forecast.slope_mean * scenario.time.end_s();
        constants >= SETTLED
    });
    (!forgets).then(|| format!("{what} move the mean of the states, which nothing brings back"))
}

/// Times that nobody has looked at.
fn looked_at(subject: &Subject<'_>) -> Option<String> {
    match &subject.followed {
        None => Some(
            "the law is not followed here: how far a tick this long shifts the states from xi is not known"
                .to_owned(),
        ),
        Some(followed) if !followed.whole && followed.lost.is_none() => Some(format!(
            "the law was followed for {} s of {} s: how far a tick this long shifts the states from xi later is not known",
            figure(followed.until),
            figure(subject.scenario.time.end_s())
        )),
        Some(_) => None,
    }
}
