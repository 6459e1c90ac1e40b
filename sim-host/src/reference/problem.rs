//! What the reference solves: the closed loop in SI units and `f64`, free of any file format.

use super::error::ReferenceError;
use crate::scenario::Dynamics;
use funnelnet_law::funnel::{Funnel, Shape};
use funnelnet_law::gain::{Gain, GainFunction};

/// The closed loop `x_i' = f_i(t, x_i) + mu_i(nu_i / psi_i(t))` with
/// `nu_i = sum_j alpha_ij (x_j - x_i)` (the paper's node-wise funnel coupling), from `t = 0`.
///
/// All vectors but `edges` have one entry per node; nodes count from 0.
#[derive(Debug, Clone, PartialEq)]
pub struct ReferenceProblem {
    /// States at `t = 0`, in state units.
    pub x0: Vec<f64>,
    /// Undirected edges `(i, j, alpha_ij)`, each once, `alpha_ij > 0`; repeated pairs add up.
    pub edges: Vec<(usize, usize, f64)>,
    /// The nodes' own vector fields `f_i`.
    pub fields: Vec<Dynamics>,
    /// The gains `mu_i`.
    pub gains: Vec<Gain<f64>>,
    /// The performance funnels `psi_i`.
    pub funnels: Vec<Funnel<f64>>,
}

/// The largest ratio `|nu| / psi` that `f64` tells from 1.
const LARGEST_RATIO: f64 = 1.0 - f64::EPSILON / 2.0;

/// `mu^-1(u)`, in (-1, 1); a value that would round to 1 is the largest `f64` below 1.
pub(super) fn inverse(gain: &Gain<f64>, u: f64) -> f64 {
    gain.inverse(u).clamp(-LARGEST_RATIO, LARGEST_RATIO)
}

/// `d/du ln((mu^-1)'(u))`, in s per state unit; 0 where it jumps, at `u = 0`.
pub(super) fn curvature(gain: &Gain<f64>, u: f64) -> f64 {
    let sign = if u == 0.0 { 0.0 } else { u.signum() };
    -sign * gain.inverse_curvature(u)
}

/// The numbers of a funnel that has a reference.
fn numbers(funnel: &Funnel<f64>) -> Option<[f64; 4]> {
    match funnel.shape {
        Shape::Exponential { start, end, rate } => Some([start, end, rate, funnel.factor]),
        Shape::Constant { width } => Some([width, 0.0, 0.0, funnel.factor]),
        _ => None,
    }
}

/// Whether there is a reference for a gain.
pub(crate) fn has_reference(gain: &Gain<f64>, funnel: &Funnel<f64>) -> bool {
    gain.keeps_funnels() && numbers(funnel).is_some()
}

impl ReferenceProblem {
    /// Checks shapes, ranges and connectivity.
    ///
    /// # Errors
    /// [`ReferenceError::Shape`], [`Value`](ReferenceError::Value) or
    /// [`Disconnected`](ReferenceError::Disconnected).
    pub fn validate(&self) -> Result<(), ReferenceError> {
        let nodes = self.x0.len();
        self.check_shapes(nodes)?;
        self.check_nodes()?;
        self.check_edges(nodes)?;
        match unreached(nodes, &self.edges) {
            Some(node) => Err(ReferenceError::Disconnected { node }),
            None => Ok(()),
        }
    }

    fn check_shapes(&self, nodes: usize) -> Result<(), ReferenceError> {
        let lengths = [
            ("x0", nodes),
            ("fields", self.fields.len()),
            ("gains", self.gains.len()),
            ("funnels", self.funnels.len()),
        ];
        match lengths.into_iter().find(|&(_, n)| n != nodes || n == 0) {
            Some((what, found)) => Err(ReferenceError::Shape { what, found, expected: nodes.max(1) }),
            None => Ok(()),
        }
    }

    fn check_nodes(&self) -> Result<(), ReferenceError> {
        for (node, &value) in self.x0.iter().enumerate() {
            require("x0", node, value, value.is_finite())?;
        }
        for (node, field) in self.fields.iter().enumerate() {
            for value in numbers_of(field) {
                require("field", node, value, value.is_finite())?;
            }
        }
        for (node, gain) in self.gains.iter().enumerate() {
            let scale = gain.slope_at_zero();
            require("gain scale", node, scale, scale > 0.0 && scale.is_finite() && gain.keeps_funnels())?;
        }
        for (node, funnel) in self.funnels.iter().enumerate() {
            for value in numbers(funnel).unwrap_or([f64::NAN; 4]) {
                require("funnel", node, value, value.is_finite() && value >= 0.0)?;
            }
            require("funnel width at t = 0", node, funnel.width(0.0), funnel.width(0.0) > 0.0)?;
        }
        Ok(())
    }

    fn check_edges(&self, nodes: usize) -> Result<(), ReferenceError> {
        for &(i, j, weight) in &self.edges {
            require("edge weight", i, weight, weight.is_finite() && weight > 0.0)?;
            require("edge end", i, j as f64, i < nodes && j < nodes && i != j)?;
        }
        Ok(())
    }
}

/// The numbers of a field.
fn numbers_of(field: &Dynamics) -> impl Iterator<Item = f64> + '_ {
    let waves = field.sines().iter().flat_map(|s| [s.amplitude, s.frequency, s.phase]);
    let of_affine = field.affine().into_iter().flat_map(|field| field.slope.iter().chain(&field.offset));
    let of_expression = field.expression().into_iter().flat_map(|field| &field.program.constants);
    of_affine.chain(of_expression).copied().chain(waves)
}

fn require(what: &'static str, node: usize, value: f64, holds: bool) -> Result<(), ReferenceError> {
    if holds { Ok(()) } else { Err(ReferenceError::Value { what, node, value }) }
}

/// The first node that no path joins to node 0.
fn unreached(nodes: usize, edges: &[(usize, usize, f64)]) -> Option<usize> {
    let mut neighbours = vec![Vec::new(); nodes];
    for &(i, j, _) in edges {
        neighbours[i].push(j);
        neighbours[j].push(i);
    }
    let mut seen = vec![false; nodes];
    seen[0] = true;
    let mut waiting = vec![0];
    while let Some(i) = waiting.pop() {
        for &j in &neighbours[i] {
            if !std::mem::replace(&mut seen[j], true) {
                waiting.push(j);
            }
        }
    }
    seen.iter().position(|&s| !s)
}

#[cfg(test)]
mod tests {
    use super::*;
    use funnelnet_law::math;

    /// `mu^-1` and its slope once more, as the paper writes them.
    fn by_the_paper(gain: &Gain<f64>, u: f64) -> (f64, f64) {
        match *gain {
            Gain::Reciprocal { scale } => {
                (u / (scale + u.abs()), scale / ((scale + u.abs()) * (scale + u.abs())))
            }
            Gain::Logarithmic { scale } => {
                (-math::exp_m1(-u.abs() / scale) * u.signum(), math::exp(-u.abs() / scale) / scale)
            }
            _ => (f64::NAN, f64::NAN),
        }
    }

    #[test]
    fn the_law_inverts_the_gain_as_the_paper_does() {
        for gain in [Gain::Reciprocal { scale: 0.7 }, Gain::Logarithmic { scale: 3.0 }] {
            for s in [-0.999, -0.3, 0.0, 1e-9, 0.5, 0.97] {
                let u = gain.apply(s);
                let (inverted, slope) = by_the_paper(&gain, u);
                assert!((gain.inverse(u) - s).abs() < 1e-15, "{gain:?} at {s}");
                assert!((inverted - s).abs() < 1e-15, "{gain:?} at {s}");
                assert!((slope - gain.inverse_slope(u)).abs() < 1e-14 * slope, "{gain:?} at {s}");
            }
            assert!(inverse(&gain, 1e300) < 1.0);
        }
    }

    #[test]
    fn the_bend_of_a_gain_is_the_derivative_of_its_slope() {
        for gain in [
            Gain::Reciprocal { scale: 0.7 },
            Gain::Logarithmic { scale: 3.0 },
            Gain::LocallyLinear { bound: 2.0 },
            Gain::Linear { slope: 2.0 },
            Gain::Algebraic { scale: 1.5 },
        ] {
            for u in [-7.0, -0.4, 0.9, 6.5] {
                let h = 1e-5;
                let (before, after) = (gain.inverse_slope(u - h), gain.inverse_slope(u + h));
                let bend = (after - before) / (2.0 * h) / gain.inverse_slope(u);
                assert!((bend - curvature(&gain, u)).abs() < 1e-6, "{gain:?} at {u}: {bend}");
            }
        }
    }

    #[test]
    fn the_slope_of_a_funnel_is_its_derivative() {
        let funnel = Funnel { factor: 3.0, shape: Shape::Exponential { start: 40.0, end: 2.0, rate: 0.5 } };
        assert_eq!(funnel.width(0.0), 120.0);
        let slope = (funnel.width(1.0 + 1e-5) - funnel.width(1.0 - 1e-5)) / 2e-5;
        assert!((slope - funnel.slope(1.0)).abs() < 1e-7);
    }
}
