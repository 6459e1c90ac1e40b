//! The figures of every node, in one row each.

use serde::Serialize;

use super::subject::Subject;

/// The figures of one node.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct NodeRow {
    /// From 1.
    pub id: u16,
    /// The weighted degree `d_i`.
    pub degree: f64,
    /// `|nu_i| / psi_i` at the start.
    pub start_ratio: f64,
    /// The narrowest funnel that the node keeps, its floor included (state units).
    pub psi_min: f64,
    /// The narrowest funnel that one exchange per tick can hold (state units).
    pub tick_floor: f64,
    /// The narrowest funnel that f32 resolves (state units).
    pub resolution: f64,
    /// The largest `|f_em - f_i|` along `xi` (state units / s); none where nothing is predicted.
    pub input: Option<f64>,
    /// The largest `|s_i|`, `s_i = mu_i^-1(f_em - f_i)`, along `xi`.
    pub steady_ratio: Option<f64>,
    /// The smallest `1 - |s_i|`, without cancellation.
    pub margin: Option<f64>,
}

/// One row per node, by index.
pub(super) fn rows(subject: &Subject<'_>) -> Vec<NodeRow> {
    let row = |(index, node): (usize, &crate::scenario::NodeSpec)| {
        let seen = &subject.forecast.nodes[index];
        let predicted = |value: f64| subject.forecast.predicts.then_some(value);
        NodeRow {
            id: node.id,
            degree: subject.degrees[index],
            start_ratio: subject.ratios[index],
            psi_min: subject.narrowest(index),
            tick_floor: seen.floor,
            resolution: subject.forecast.resolution[index],
            input: predicted(seen.input),
            steady_ratio: predicted(1.0 - seen.margin),
            margin: predicted(seen.margin),
        }
    };
    subject.scenario.nodes.iter().enumerate().map(row).collect()
}
