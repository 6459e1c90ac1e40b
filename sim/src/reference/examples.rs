//! Problems with known solutions or known difficulties, for tests and for who compares solvers.

use super::ReferenceProblem;
use crate::scenario::{Affine, Sine};
use funnelnet_law::Gain;
use funnelnet_law::funnel::{Funnel, Shape};

/// Ends and weight of each edge.
pub type Edges = Vec<(usize, usize, f64)>;

/// A path.
#[must_use]
pub fn path(nodes: usize) -> Edges {
    (1..nodes).map(|i| (i - 1, i, 1.0)).collect()
}

/// A ring.
#[must_use]
pub fn ring(nodes: usize) -> Edges {
    (0..nodes).map(|i| (i, (i + 1) % nodes, 1.0)).collect()
}

/// A star around node 0.
#[must_use]
pub fn star(nodes: usize) -> Edges {
    (1..nodes).map(|i| (0, i, 1.0)).collect()
}

/// All with all.
#[must_use]
pub fn complete(nodes: usize) -> Edges {
    (0..nodes).flat_map(|i| (i + 1..nodes).map(move |j| (i, j, 1.0))).collect()
}

/// Example 3 of the paper with constants that look random, `psi = 38 e^-t + end`.
#[must_use]
pub fn five_agents(edges: Edges, end: f64) -> ReferenceProblem {
    let delta = [0.12, -0.31, 0.45, -0.08, 0.27];
    let slow = [(0.62, 1.31), (-0.85, 4.02), (0.33, 0.55), (1.10, 2.77), (-0.47, 5.60)];
    let fast = [(0.71, 3.90), (0.28, 0.84), (-0.96, 2.15), (0.54, 5.03), (-0.39, 1.48)];
    let sine = |amplitude, frequency, phase| Sine { component: 0, amplitude, frequency, phase };
    let field = |i: usize| {
        let sines = vec![
            sine(10.0, 1.0, 0.0),
            sine(10.0 * slow[i].0, 0.1, slow[i].1),
            sine(10.0 * fast[i].0, 10.0, fast[i].1),
        ];
        Affine::scalar(-1.0 + delta[i], 0.0, sines).into()
    };
    ReferenceProblem {
        x0: vec![3.5, -2.0, 6.1, 0.4, -4.7],
        edges,
        fields: (0..5).map(field).collect(),
        gains: vec![Gain::Reciprocal { scale: 1.0 }; 5],
        funnels: vec![
            Funnel { factor: 1.0, shape: Shape::Exponential { start: 38.0 + end, end, rate: 1.0 } };
            5
        ],
    }
}

/// `x_i' = f_i* - x_i + u_i` on a path of 11, `f_i*` over three decades, `psi = 1200 e^-t`.
#[must_use]
pub fn narrow_path() -> ReferenceProblem {
    let targets = [0.56, -3.1, 560.0, 12.0, -44.0, 1.9, 230.0, -8.7, 75.0, 0.9, -310.0];
    let field = |offset: &f64| Affine::scalar(-1.0, *offset, Vec::new()).into();
    ReferenceProblem {
        x0: targets.iter().map(|f| 0.1 * f).collect(),
        edges: path(11),
        fields: targets.iter().map(field).collect(),
        gains: vec![Gain::Reciprocal { scale: 1.0 }; 11],
        funnels: vec![
            Funnel { factor: 1.0, shape: Shape::Exponential { start: 1200.0, end: 0.0, rate: 1.0 } };
            11
        ],
    }
}
