//! What the reference solves: the closed loop in SI units and `f64`, free of any file format.

use super::error::ReferenceError;
use crate::extremes::larger;
use crate::scenario::{Dynamics, Hosted};
use funnelnet_law::Coupling;
use funnelnet_law::funnel::{Funnel, Shape};
use funnelnet_law::gain::{Gain, GainFunction};
use funnelnet_law::math;

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

/// The closed loop of any coupling, for states of several components and inputs with limits.
///
/// Vectors that are one per node in [`ReferenceProblem`] are so here; `x0` is by node and then by component.
#[derive(Debug, Clone, PartialEq)]
pub struct CoupledProblem {
    /// How diffusive terms become inputs.
    pub coupling: Coupling<f64>,
    /// Components of a state.
    pub components: usize,
    /// States at `t = 0`, in state units.
    pub x0: Vec<f64>,
    /// As in [`ReferenceProblem`].
    pub edges: Vec<(usize, usize, f64)>,
    /// As in [`ReferenceProblem`].
    pub fields: Vec<Dynamics>,
    /// As in [`ReferenceProblem`]; edges and trackers take those of their nodes.
    pub gains: Vec<Gain<f64>>,
    /// As in [`ReferenceProblem`].
    pub funnels: Vec<Funnel<f64>>,
    /// The lowest and the highest input of each node, where it has some (state units / s).
    pub limits: Vec<Option<(f64, f64)>>,
}

impl CoupledProblem {
    /// Checks shapes, ranges and connectivity.
    ///
    /// # Errors
    /// As [`ReferenceProblem::validate`].
    pub fn validate(&self) -> Result<(), ReferenceError> {
        let nodes = self.fields.len();
        if self.x0.len() != nodes * self.components || self.components == 0 {
            let expected = nodes * self.components.max(1);
            return Err(ReferenceError::Shape { what: "x0", found: self.x0.len(), expected });
        }
        if self.limits.len() != nodes {
            return Err(ReferenceError::Shape { what: "limits", found: self.limits.len(), expected: nodes });
        }
        for (at, &value) in self.x0.iter().enumerate() {
            require("x0", at / self.components, value, value.is_finite())?;
        }
        let first = self.x0.chunks_exact(self.components).map(|state| state[0]).collect();
        self.like_scalars(first).check(self.keeps_funnels())
    }

    /// Whether every diffusive term stays inside a funnel.
    pub(super) fn keeps_funnels(&self) -> bool {
        self.is_funnel_law() && self.limits.iter().all(Option::is_none)
    }

    /// Whether `mu` is defined inside the funnel only.
    fn is_funnel_law(&self) -> bool {
        self.coupling.keeps_funnels() && self.gains.iter().all(Gain::keeps_funnels)
    }

    /// Whether a component of a node may be at the edge of its funnel and beyond: where `mu` is larger than
    /// any limit its input is at one. Not where inputs are sums over edges, or have the gain of another:
    /// those have no such limit.
    pub(super) fn may_leave(&self, node: usize) -> bool {
        let by_itself =
            matches!(self.coupling, Coupling::NodeWise | Coupling::ElementWise | Coupling::MaxGain);
        !self.is_funnel_law() || by_itself && self.limits[node].is_some()
    }

    /// The same network of scalar states.
    fn like_scalars(&self, x0: Vec<f64>) -> ReferenceProblem {
        ReferenceProblem {
            x0,
            edges: self.edges.clone(),
            fields: self.fields.clone(),
            gains: self.gains.clone(),
            funnels: self.funnels.clone(),
        }
    }

    /// The same in the form that has the better unknowns, where it is that law: node-wise, scalar, without
    /// limits. An input at its limit says nothing of the ratio.
    #[must_use]
    pub fn as_scalar(&self) -> Option<ReferenceProblem> {
        let law = matches!(self.coupling, Coupling::NodeWise | Coupling::ElementWise | Coupling::MaxGain);
        (law && self.components == 1 && self.keeps_funnels()).then(|| self.like_scalars(self.x0.clone()))
    }
}

/// Width below which a funnel that closes at an instant stays (state units): from there on the paper's law
/// has no solution, and this one is the emergent motion.
const CLOSED: f64 = 1e-9;

/// `psi(t)` (state units).
pub(super) fn width(funnel: &Funnel<f64>, t: f64) -> f64 {
    match funnel.shape {
        Shape::FiniteTime { .. } => larger(funnel.width(t), CLOSED),
        _ => funnel.width(t),
    }
}

/// Its derivative (state units / s).
pub(super) fn slope(funnel: &Funnel<f64>, t: f64) -> f64 {
    match funnel.shape {
        Shape::FiniteTime { .. } if funnel.width(t) <= CLOSED => 0.0,
        _ => funnel.slope(t),
    }
}

/// Times at which a funnel has a kink (s): where a schedule joins its parts, and where a funnel has closed.
pub(super) fn kinks(funnels: &[Funnel<f64>]) -> impl Iterator<Item = f64> + '_ {
    funnels.iter().filter_map(|funnel| match funnel.shape {
        Shape::Schedule { .. } => funnel.join(),
        Shape::FiniteTime { start, at_ns, power } => {
            let left = math::pow(CLOSED / (funnel.factor * start), 1.0 / power);
            Some(at_ns as f64 * 1e-9 * (1.0 - left))
        }
        _ => None,
    })
}

/// The first of some times after `t`, and not so near that no step fits in between.
pub(super) fn next_of(times: impl Iterator<Item = f64>, t: f64) -> Option<f64> {
    let after = times.filter(|at| *at > t * (1.0 + 4.0 * f64::EPSILON)).fold(f64::INFINITY, f64::min);
    after.is_finite().then_some(after)
}

/// The numbers of a funnel.
fn numbers(funnel: &Funnel<f64>) -> [f64; 4] {
    match funnel.shape {
        Shape::Exponential { start, end, rate } => [start, end, rate, funnel.factor],
        Shape::Constant { width } => [width, 0.0, 0.0, funnel.factor],
        Shape::ReciprocalTime { scale } => [scale, 0.0, 0.0, funnel.factor],
        Shape::FiniteTime { start, power, .. } => [start, power, 0.0, funnel.factor],
        Shape::Schedule { start, eps, then, .. } => [start, eps, then.width(0.0), funnel.factor],
    }
}

impl ReferenceProblem {
    /// Checks shapes, ranges and connectivity.
    ///
    /// # Errors
    /// [`ReferenceError::Shape`], [`Value`](ReferenceError::Value) or
    /// [`Disconnected`](ReferenceError::Disconnected).
    pub fn validate(&self) -> Result<(), ReferenceError> {
        self.check(true)
    }

    /// The same, for gains that keep funnels or for any.
    fn check(&self, keep: bool) -> Result<(), ReferenceError> {
        let nodes = self.x0.len();
        self.check_shapes(nodes)?;
        self.check_nodes(keep)?;
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

    fn check_nodes(&self, keep: bool) -> Result<(), ReferenceError> {
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
            require(
                "gain scale",
                node,
                scale,
                scale > 0.0 && scale.is_finite() && (!keep || gain.keeps_funnels()),
            )?;
        }
        for (node, funnel) in self.funnels.iter().enumerate() {
            for value in numbers(funnel) {
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

/// Tells the host's fields that all of them will be asked at `t` (s) and the states `x`.
pub(super) fn announce(fields: &[Dynamics], t: f64, x: &[f64]) {
    fields.iter().filter_map(Dynamics::hosted).for_each(|hosted| hosted.field().announce(t, x));
}

/// The same for the states at which the slopes of scalar fields at `x` are looked for.
pub(super) fn announce_slopes(fields: &[Dynamics], t: f64, x: &[f64]) {
    if !fields.iter().any(|field| field.hosted().is_some()) {
        return;
    }
    for side in [1.0, -1.0] {
        let moved: Vec<f64> = x.iter().map(|x| x + side * Hosted::quotient_step(*x)).collect();
        announce(fields, t, &moved);
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
