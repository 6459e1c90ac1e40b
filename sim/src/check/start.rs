//! The start inside the funnel, and the paper's bound on the distance between any two states over time.

use serde_json::json;

use super::subject::Subject;
use super::widths::instants;
use super::{Finding, Status, about, figure, largest};

/// Ratio at the start from which the input is nearly all gain and no state: the reciprocal gain is at 10
/// times its scale.
const TIGHT_START: f64 = 0.9;

pub(super) fn findings(subject: &Subject<'_>) -> Vec<Finding> {
    let mut found = vec![start(subject)];
    found.extend(subject.forecast.as_ref().map(|_| sync_bound(subject)));
    found
}

/// The theorem's condition on the start.
fn start(subject: &Subject<'_>) -> Finding {
    let ratios = &subject.ratios;
    let (entry, worst) = largest(ratios.iter().copied());
    // One ratio per component.
    let index = entry / subject.scenario.components();
    let text = format!("|nu| / psi is {} at most, at node {}", figure(worst), index + 1);
    let values = json!({ "ratio": ratios, "worst": worst, "node": index + 1 });
    let found = Finding::new("start", "Start", text, values);
    if worst < TIGHT_START {
        return found;
    }
    let factor = subject.scenario.nodes[index].funnel.factor * worst / (0.5 * TIGHT_START);
    let advice = format!(
        "node {} starts close to its funnel, with a large input; factor = {} or more would start it at {}",
        index + 1,
        figure(factor),
        about(0.5 * TIGHT_START)
    );
    found
        .advise(Status::Warn, advice)
        .set(format!("node.{}.funnel.factor", index + 1), figure(1.001 * factor))
}

/// The paper's bound on the distance between any two states, over time.
fn sync_bound(subject: &Subject<'_>) -> Finding {
    let end = subject.scenario.time.end_s();
    let bound = |t: f64| subject.bound_per_width() * subject.widest_kept(t);
    let table: Vec<_> = [0.0, 0.05, 0.1, 0.25, 0.5, 1.0].map(|part| (part * end, bound(part * end))).to_vec();
    let listed: Vec<_> =
        table.iter().map(|(t, bound)| format!("{} at {} s", figure(*bound), figure(*t))).collect();
    let limit = subject.scenario.expect.final_spread;
    let reached = limit.and_then(|limit| first_below(bound, limit, end));
    let mut text = format!(
        "|x_i - x_j| < (2 sqrt(N) / lambda2) max psi = {} max psi: {}",
        figure(subject.bound_per_width()),
        listed.join(", ")
    );
    if let (Some(limit), Some(t)) = (limit, reached) {
        text.push_str(&format!("; below final_spread = {} from {} s on", figure(limit), figure(t)));
    }
    let rows: Vec<_> = table.iter().map(|(t, bound)| json!({ "t": t, "bound": bound })).collect();
    let (first, last) = (bound(0.0), bound(end));
    let values = json!({
        "start": first, "end": last, "per_width": subject.bound_per_width(), "times": rows,
        "final_spread": limit, "below_final_spread_at": reached,
    });
    let found = Finding::new("sync-bound", "Bound", text, values);
    match limit {
        Some(limit) if reached.is_none() => {
            let width = limit / subject.bound_per_width();
            let advice = format!(
                "final_spread = {} asks for more than this bound promises, and may well hold; it is promised where every psi \
                 ends below {}",
                figure(limit),
                about(width)
            );
            found.advise(Status::Note, advice)
        }
        _ => found,
    }
}

/// When a bound falls below `limit` to stay there until `end` (s); none where it ends above it.
fn first_below(bound: impl Fn(f64) -> f64, limit: f64, end: f64) -> Option<f64> {
    let times: Vec<_> = instants(end).collect();
    // What is not a number is not below.
    let below = |t: f64| bound(t) < limit;
    if !below(end) {
        return None;
    }
    let Some(above) = times.iter().rposition(|t| !below(*t)) else { return Some(0.0) };
    let (mut low, mut high) = (times[above], times.get(above + 1).copied().unwrap_or(end));
    for _ in 0..50 {
        let middle = 0.5 * (low + high);
        if below(middle) { high = middle } else { low = middle }
    }
    Some(high)
}
