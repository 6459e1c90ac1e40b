//! The paper's Assumptions 1 to 5, and the contraction that the theorem on emergent behaviour asks for.

use serde_json::json;

use super::forecast::Forecast;
use super::subject::Subject;
use super::{Finding, Status, extremes, figure, largest, range};
use crate::scenario::{Gain, NodeSpec};
use funnelnet_node::params;

/// Share of the largest eigenvalue below which `lambda2` is lost in the rounding of the spectrum.
const LOST: f64 = 1e-9;

pub(super) fn findings(subject: &Subject<'_>) -> Vec<Finding> {
    let mut found =
        vec![graph(subject), fields(subject), funnels(subject), gains(subject), regularity(subject)];
    found.extend(subject.forecast.as_ref().map(|forecast| contraction(subject, forecast)));
    found
}

/// The largest of values that are zero or more.
fn larger_of(values: impl IntoIterator<Item = f64>) -> f64 {
    crate::extremes::largest(0.0, values)
}

/// Assumption 1.
fn graph(subject: &Subject<'_>) -> Finding {
    let (lambda2, lambda_max) = (subject.lambda2, subject.lambda_max);
    let (low, high) = extremes(subject.degrees.iter().copied());
    let text = format!(
        "undirected and connected; lambda2 = {}, lambda_max = {}, degrees {}",
        figure(lambda2),
        figure(lambda_max),
        range(low, high)
    );
    let values = json!({ "lambda2": lambda2, "lambda_max": lambda_max, "degree": subject.degrees });
    let found = Finding::new("graph", "Assumption 1", text, values);
    let kept = lambda2 >= LOST * lambda_max;
    if subject.scenario.nodes.len() > 1 && !kept {
        let advice = format!(
            "lambda2 is lost in rounding, and with it the bound on |x_i - x_j|; bring the edge weights closer together \
             (lambda2 above {})",
            figure(LOST * lambda_max)
        );
        return found.advise(Status::Warn, advice);
    }
    found
}

/// Assumptions 2 and 4: affine fields are globally Lipschitz, so nothing escapes in finite time.
fn fields(subject: &Subject<'_>) -> Finding {
    let nodes = &subject.scenario.nodes;
    let lipschitz = larger_of(nodes.iter().map(|node| node.dynamics.steepness()));
    if let Some(node) = nodes.iter().find(|node| node.dynamics.affine().is_none()) {
        return expressions(node, lipschitz);
    }
    let mut text =
        format!("affine fields, Lipschitz with {}/s: no state escapes in finite time", figure(lipschitz));
    let Some(forecast) = &subject.forecast else {
        return Finding::new("fields", "Assumptions 2, 4", text, json!({ "lipschitz": lipschitz }));
    };
    let (reach, until) = (forecast.reach, forecast.grid.end());
    text.push_str(&format!(", |x_i| < {} up to {} s", figure(reach), figure(until)));
    let values = json!({ "lipschitz": lipschitz, "state_bound": reach, "until": until });
    let found = Finding::new("fields", "Assumptions 2, 4", text, values);
    if reach <= params::LARGEST {
        return found;
    }
    let advice = format!(
        "a node stops at |x| = {}; this bound is the worst case, the prediction below what to expect",
        figure(params::LARGEST)
    );
    found.advise(Status::Note, advice)
}

/// Nothing is known of an expression but where it was looked at.
fn expressions(node: &NodeSpec, steepest: f64) -> Finding {
    let text = format!(
        "node {} has an expression, of which no Lipschitz constant is known: a state may escape in finite time; the steepest slope \
         found near the start is {}/s",
        node.id,
        figure(steepest)
    );
    Finding::new("fields", "Assumptions 2, 4", text, json!({ "steepest_found": steepest }))
        .stands(Status::NotChecked)
}

/// Assumption 3, the funnels.
fn funnels(subject: &Subject<'_>) -> Finding {
    let (scenario, end) = (subject.scenario, subject.scenario.time.end_s());
    let bound = subject.widths.widest;
    let theta = larger_of(scenario.nodes.iter().map(|node| node.funnel.steepest_slope()));
    let last = scenario.widest_funnel(end);
    let text = format!(
        "0 < psi <= {} and |psi'| <= {}/s; at the end psi is {} at most",
        figure(bound),
        figure(theta),
        figure(last)
    );
    let (_, narrowest) = largest(subject.widths.narrowest.iter().map(|width| -width));
    let values = json!({
        "psi_bound": bound, "psi_slope_bound": theta, "psi_end": last, "psi_min": -narrowest,
    });
    let found = Finding::new("funnels", "Assumption 3", text, values);
    if bound.is_nan() || theta.is_nan() || narrowest.is_nan() {
        return found
            .advise(Status::Warn, "a width or a slope is not a number; choose other funnels".to_owned());
    }
    if bound.is_infinite() {
        return found.advise(
            Status::Note,
            "a funnel is infinite at t = 0, so that any start is allowed (paper, remark on the pseudo-global property); the \
             assumption holds from the first tick on"
                .to_owned(),
        );
    }
    if narrowest == 0.0 {
        return found.advise(
            Status::Note,
            "a funnel closes within the run (paper, remark on finite-time synchronisation): the guarantee ends there, and the \
             node goes on at the floor of its funnel"
                .to_owned(),
        );
    }
    found
}

/// Assumption 3, the gains.
fn gains(subject: &Subject<'_>) -> Finding {
    let nodes = &subject.scenario.nodes;
    let mut names: Vec<_> = nodes.iter().map(|node| node.gain.kind()).collect();
    names.sort_unstable();
    names.dedup();
    let (low, high) = extremes(nodes.iter().map(|node| node.gain.slope_at_zero()));
    let bounded = nodes.iter().find(|node| !node.gain.keeps_funnels());
    let what = match bounded {
        None => "non-decreasing and unbounded at the funnel's edge",
        Some(_) => "not all unbounded at the funnel's edge",
    };
    let text = format!("gains ({}) {what}; gamma(0) = {}", names.join(", "), range(low, high));
    let values = json!({ "kinds": names, "gamma0_min": low, "gamma0_max": high });
    let found = Finding::new("gains", "Assumption 3", text, values);
    if let Some(node) = bounded {
        let advice =
            format!("nothing keeps node {} inside its funnel; give it another kind of gain", node.id);
        return found.advise(Status::Warn, advice);
    }
    match loose_median(subject) {
        Some(advice) => found.advise(Status::Warn, advice),
        None => found,
    }
}

/// The paper's condition on the median gain, `eps < 2 / (N + 1)`.
fn loose_median(subject: &Subject<'_>) -> Option<String> {
    let most = 2.0 / (subject.scenario.nodes.len() as f64 + 1.0);
    let loose = subject.scenario.nodes.iter().find_map(|node| match node.gain {
        Gain::Median { eps, .. } if eps >= most => Some((node.id, eps)),
        _ => None,
    })?;
    Some(format!(
        "the median is only within eta where eps < 2 / (N + 1) = {}; node {} has {}",
        figure(most),
        loose.0,
        figure(loose.1)
    ))
}

/// Assumption 5.
fn regularity(subject: &Subject<'_>) -> Finding {
    let (nodes, end) = (&subject.scenario.nodes, subject.scenario.time.end_s());
    let lambda = larger_of(nodes.iter().map(|node| node.funnel.steepest_decay(end)));
    let speed = |node: &NodeSpec| {
        node.dynamics.sines().iter().map(|sine| (sine.amplitude * sine.frequency).abs()).sum::<f64>()
    };
    let theta = larger_of(nodes.iter().map(speed));
    let spread = subject.widths.spread;
    let text = format!(
        "theta_f = max |df/dt| = {}, lambda_psi = max |psi'| / psi = {}/s, r_psi = max psi_i / psi_j = {}",
        figure(theta),
        figure(lambda),
        figure(spread)
    );
    let values = json!({ "theta_f": theta, "lambda_psi": lambda, "r_psi": spread });
    let found = Finding::new("regularity", "Assumption 5", text, values);
    if nodes.iter().any(|node| node.dynamics.affine().is_none()) {
        let advice = "theta_f is that of the sines alone, and an expression may change faster by time";
        return found.advise(Status::NotChecked, advice.to_owned());
    }
    if !spread.is_finite() {
        let advice = "some funnels close while others stay open, so that only the nodes of the open ones shape the emergent \
                      dynamics; let all close at the same pace, as r_i psi(t)";
        return found.advise(Status::Warn, advice.to_owned());
    }
    if !(lambda.is_finite() && theta.is_finite()) {
        let advice = "lambda_psi is finite away from the instant at which a funnel opens or closes; the prediction is not \
                      covered by the theorem there";
        return found.advise(Status::Note, advice.to_owned());
    }
    found
}

/// The contraction that the prediction by the emergent dynamics rests on, along the predicted `xi`.
fn contraction(subject: &Subject<'_>, forecast: &Forecast) -> Finding {
    let steepest = forecast.steepest;
    let (slowest, mean, at) = (-forecast.slope_largest, -forecast.slope_mean, forecast.slope_largest_at);
    let values = json!({
        "largest_slope": steepest, "funnel_ratio_bound": subject.widths.spread,
        "slowest_rate": slowest, "slowest_at": at, "mean_rate": mean,
    });
    let by_itself = match steepest < 0.0 {
        true => "every field contracts".to_owned(),
        false => format!("not every field contracts (slopes up to {}/s)", figure(steepest)),
    };
    let text = format!(
        "the emergent dynamics contract along xi by {}/s on average, by {}/s at the slowest (t = {} s); {by_itself}",
        figure(mean),
        figure(slowest),
        figure(at)
    );
    let found = Finding::new("emergent", "Contraction", text, values);
    if slowest > 0.0 {
        return found;
    }
    if mean > 0.0 {
        let advice = "they expand now and then but contract on average: an error in xi shrinks in the long run, the theorem \
                      does not cover it";
        return found.advise(Status::Note, advice.to_owned());
    }
    let advice = "they do not forget their initial value, so emergent_error says little; make some fields more stable, or give \
                  the nodes with stable fields a wider funnel (factor), which is more weight";
    found.advise(Status::Note, advice.to_owned())
}
