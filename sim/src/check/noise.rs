//! Noise on the states that nodes send, against the room that the steady ratio leaves in the funnel (law.md
//! 6).

use serde_json::json;

use super::subject::Subject;
use super::{Finding, Status, about, figure};
use crate::extremes::{beyond, larger};
use crate::scenario::Coupling;
use funnelnet_law::math;

/// The noise of one node.
struct Noisy {
    index: usize,
    /// Standard deviation of `nu` (state units).
    deviation: f64,
    /// `psi (1 - |s|)` at its least (state units).
    room: f64,
}

/// What there is to say about noise; nothing where there is none, and where no funnel is promised.
pub(super) fn finding(subject: &Subject<'_>) -> Option<Finding> {
    let scenario = subject.scenario;
    if !scenario.coupling.keeps_funnels() {
        return None;
    }
    let nodes = deviations(subject).into_iter().enumerate().map(|(index, deviation)| {
        let margin = subject.forecast.as_ref().map_or(1.0, |forecast| forecast.nodes[index].margin);
        Noisy { index, deviation, room: margin * subject.narrowest(index) }
    });
    let worst = nodes.filter(|node| node.deviation > 0.0).reduce(|worst, next| {
        if beyond(next.deviation / next.room, worst.deviation / worst.room) { next } else { worst }
    })?;
    let draws = (scenario.time.ticks as f64).max(2.0);
    // The largest of so many is about there.
    let reach = (2.0 * math::ln(draws)).sqrt();
    let share = worst.deviation / worst.room;
    let text = format!(
        "noise moves nu of node {} by {} (standard deviation), {} times that at its largest, where its funnel leaves {}",
        worst.index + 1,
        figure(worst.deviation),
        about(reach),
        figure(worst.room)
    );
    let values = json!({
        "node": worst.index + 1, "deviation": worst.deviation, "room": worst.room, "share": share, "reach": reach,
    });
    let found = Finding::new("noise", "Noise", text, values);
    let within = reach * share < 1.0;
    if within {
        return Some(found);
    }
    let roomy = worst.room > 0.0;
    let advice = match roomy {
        true => format!(
            "noise alone carries |nu| out of the funnel; let psi be {} or more, or bring the noise down to a share of {}",
            about(reach * worst.deviation * subject.narrowest(worst.index) / worst.room),
            about(1.0 / (reach * share))
        ),
        false => format!(
            "noise alone carries |nu| out of the funnel, which leaves it no room; let psi end at {} or more",
            about(reach * worst.deviation)
        ),
    };
    Some(found.advise(Status::Warn, advice))
}

/// Standard deviation of what each node believes its diffusive term to be, by index: a node knows its own
/// state exactly. With edge-wise coupling that of its worst edge.
fn deviations(subject: &Subject<'_>) -> Vec<f64> {
    let scenario = subject.scenario;
    let mut squares = vec![0.0; scenario.nodes.len()];
    for edge in &scenario.graph.edges {
        for (at, from) in [(edge.a, edge.b), (edge.b, edge.a)] {
            let deviation = edge.weight * scenario.nodes[from].noise;
            let square = deviation * deviation;
            squares[at] = match scenario.coupling {
                Coupling::EdgeWise => larger(squares[at], square),
                _ => squares[at] + square,
            };
        }
    }
    squares.into_iter().map(f64::sqrt).collect()
}
