//! What the emergent dynamics predict: where the network goes, and how hard each node has to push.

use serde_json::json;

use super::forecast::Forecast;
use super::subject::Subject;
use super::{Finding, Status, about, extremes, figure, largest, share, width_of};
use crate::emergent::outgrown;
use crate::extremes::{beyond, larger};
use crate::scenario::Gain;
use funnelnet_node::params;

/// Margin `1 - |s|` below which a tick can carry `|nu|` across the funnel: with 1e-4 the ratio was seen at
/// 1.004 to 1.014 (law.md 4).
const TIGHT_MARGIN: f64 = 1e-3;
/// The margin that advice aims at.
const GOOD_MARGIN: f64 = 0.02;

pub(super) fn findings(subject: &Subject<'_>, forecast: &Forecast) -> Vec<Finding> {
    let mut found = vec![trajectory(subject, forecast), input(subject, forecast)];
    found.extend(linear_part(subject, forecast));
    found
}

/// Limits and predictions are those of the paper's law for scalar states; elsewhere nothing is said rather
/// than guessed. Of a law that promises no funnel there is nothing to be said but what it does, where it was
/// followed.
pub(super) fn none_here(subject: &Subject<'_>) -> Finding {
    let scenario = subject.scenario;
    let (coupling, components) = (scenario.coupling, scenario.components());
    let values = json!({ "coupling": coupling.kind(), "components": components });
    let (promise, stands) = match (subject.is_promised(), subject.run()) {
        (true, _) => ("", Status::NotChecked),
        (false, None) => (
            "; the law promises no funnel, so that ratios and breaches are counted and nothing more",
            Status::NotChecked,
        ),
        (false, Some(_)) => {
            ("; the law promises no funnel, and what it does was followed to the end (below)", Status::Note)
        }
    };
    let plural = if components == 1 { "component" } else { "components" };
    let text = format!(
        "none here for {} coupling of states with {components} {plural}: neither contraction, nor what tick and f32 can \
         hold{promise}",
        coupling.kind()
    );
    Finding::new("predictions", "Predictions", text, values).stands(stands)
}

/// `xi`, and the blended dynamics beside it.
fn trajectory(subject: &Subject<'_>, forecast: &Forecast) -> Finding {
    let (until, xi, blended) = (forecast.grid.end(), forecast.xi_end(), forecast.blended_end);
    let (low, high) = extremes(forecast.xi.iter().copied());
    let text = format!(
        "xi is {} at {} s, between {} and {} on the way; the blended dynamics (the average) end at {}, {} from it",
        figure(xi),
        figure(until),
        figure(low),
        figure(high),
        figure(blended),
        about((xi - blended).abs())
    );
    let values = json!({
        "xi_min": low, "xi_max": high, "xi_end": xi, "until": until, "steps": forecast.grid.steps,
        "blended_end": blended, "blended_distance": (xi - blended).abs(),
    });
    let found = Finding::new("prediction", "Prediction", text, values);
    let most = larger(low.abs(), high.abs());
    if most.is_nan() || most > params::LARGEST {
        let advice = format!(
            "a node stops at |x| = {}; make some fields more stable, or end the run earlier",
            figure(params::LARGEST)
        );
        return found.advise(Status::Fail, advice);
    }
    if outgrown(forecast.slope_mean * until, most) {
        let advice = "the emergent dynamics expand, and no digit of this is left by the end: any small error leads elsewhere";
        return found.advise(Status::NotChecked, advice.to_owned());
    }
    let end = subject.scenario.time.end_s();
    if !forecast.grid.reaches(subject.scenario) {
        let advice = format!(
            "the run is {} s, which is too long for steps that resolve the fields; later times were not looked at",
            figure(end)
        );
        return found.advise(Status::Note, advice);
    }
    found
}

/// How close to its funnel each node has to be for its input.
fn input(subject: &Subject<'_>, forecast: &Forecast) -> Finding {
    let nodes = &forecast.nodes;
    let (index, margin) = largest(nodes.iter().map(|node| -node.margin));
    let margin = -margin;
    let (pushing, most) = largest(nodes.iter().map(|node| node.input));
    let text = format!(
        "node {} is the tightest: |nu|/psi settles at {}, {} inside the funnel (t = {} s); the largest input |f_em - f_i| is \
         {}, at node {}",
        index + 1,
        figure(1.0 - margin),
        share(margin),
        figure(nodes[index].margin_at),
        figure(most),
        pushing + 1
    );
    let values = json!({
        "node": index + 1, "margin": margin, "steady_ratio": 1.0 - margin, "t": nodes[index].margin_at,
        "largest_input": most, "input_node": pushing + 1,
    });
    let found = Finding::new("input", "Steady margin", text, values);
    if margin >= TIGHT_MARGIN {
        return found;
    }
    let advice = format!(
        "one tick can carry |nu| across a margin this small; {}",
        wider(&subject.scenario.nodes[index].gain, nodes[index].input)
    );
    found.advise(Status::Note, advice)
}

/// The parameter that leaves [`GOOD_MARGIN`] at an input (state units / s), in words.
fn wider(gain: &Gain<f64>, input: f64) -> String {
    let Some(reaching) = gain.reaching(GOOD_MARGIN, input) else {
        return "give it a gain that is unbounded at the funnel's edge".to_owned();
    };
    let Some((parameter, value)) = reaching.parameters().next() else { return String::new() };
    let Some(value) = width_of(value) else { return "no gain that a node takes leaves more".to_owned() };
    let what = format!("{} = {value}", parameter.name);
    if let Gain::Median { .. } = gain {
        return format!(
            "that is what a gain close to a sign function costs ({what} would leave {}); a shorter tick or a wider funnel keeps the \
             excess small",
            share(GOOD_MARGIN)
        );
    }
    format!("gain {what} would leave {}", share(GOOD_MARGIN))
}

/// The locally linear gain averages only while every input is in its linear part, `|u| <= 2 M_f`.
fn linear_part(subject: &Subject<'_>, forecast: &Forecast) -> Option<Finding> {
    let nodes = subject.scenario.nodes.iter().zip(&forecast.nodes).enumerate();
    let shares = nodes.filter_map(|(index, (node, seen))| match node.gain.linear_up_to() {
        end if end > 0.0 => Some((index, seen.input / end, seen.input)),
        _ => None,
    });
    let (index, taken, input) =
        shares.reduce(|most, next| if beyond(next.1, most.1) { next } else { most })?;
    let text = format!(
        "node {} uses {} of the linear part of its gain, in which the emergent dynamics are the average",
        index + 1,
        share(taken)
    );
    let values = json!({ "node": index + 1, "share": taken });
    let found = Finding::new("linear-part", "Linear part", text, values);
    if taken <= 1.0 {
        return Some(found);
    }
    let advice = format!("outside it they are not; gain bound = {} or more would do", about(0.5 * input));
    Some(found.advise(Status::Note, advice))
}
