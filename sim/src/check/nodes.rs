//! The figures of every node, in one row each.

use serde::Serialize;

use super::largest;
use super::subject::Subject;

/// The figures of one node.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct NodeRow {
    /// From 1.
    pub id: u16,
    /// The weighted degree `d_i`.
    pub degree: f64,
    /// `|nu_i| / psi_i` at the start, the largest of its components.
    pub start_ratio: f64,
    /// The narrowest funnel that the node keeps, its floor included (state units).
    pub psi_min: f64,
    /// The narrowest funnel that one exchange per tick can hold (state units); none, as below, where nothing
    /// is predicted.
    pub tick_floor: Option<f64>,
    /// The narrowest funnel that f32 resolves (state units).
    pub resolution: Option<f64>,
    /// The largest `|f_em - f_i|` along `xi` (state units / s).
    pub input: Option<f64>,
    /// The largest `|s_i|`, `s_i = mu_i^-1(f_em - f_i)`, along `xi`.
    pub steady_ratio: Option<f64>,
    /// The smallest `1 - |s_i|`, without cancellation.
    pub margin: Option<f64>,
}

/// One row per node, by index.
pub(super) fn rows(subject: &Subject<'_>) -> Vec<NodeRow> {
    let components = subject.scenario.components();
    let row = |(index, node): (usize, &crate::scenario::NodeSpec)| {
        let seen = subject.forecast.as_ref().map(|forecast| &forecast.nodes[index]);
        NodeRow {
            id: node.id,
            degree: subject.degrees[index],
            start_ratio: largest(subject.ratios.iter().skip(index * components).take(components).copied()).1,
            psi_min: subject.narrowest(index),
            tick_floor: seen.map(|seen| seen.floor),
            resolution: subject.forecast.as_ref().map(|forecast| forecast.resolution[index]),
            input: seen.map(|seen| seen.input),
            steady_ratio: seen.map(|seen| 1.0 - seen.margin),
            margin: seen.map(|seen| seen.margin),
        }
    };
    subject.scenario.nodes.iter().enumerate().map(row).collect()
}
