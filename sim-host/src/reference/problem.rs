//! What the reference solves: the closed loop in SI units and `f64`, free of any file format.

use super::error::ReferenceError;
use crate::scenario::between;
use funnelnet_law::gain::{Gain as _, LocallyLinear};
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
    pub fields: Vec<Affine>,
    /// The gains `mu_i`.
    pub gains: Vec<Gain>,
    /// The performance funnels `psi_i`.
    pub funnels: Vec<Funnel>,
}

/// The vector field `slope * x + offset + sum amplitude * sin(frequency * t + phase)`, state units per
/// second.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Affine {
    /// `df/dx`, in 1/s.
    pub slope: f64,
    /// Constant part, in state units per second.
    pub offset: f64,
    /// Periodic parts.
    pub sines: Vec<Sine>,
}

/// One periodic part of an [`Affine`] field.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Sine {
    /// In state units per second.
    pub amplitude: f64,
    /// In rad/s.
    pub frequency: f64,
    /// In rad.
    pub phase: f64,
}

impl Affine {
    /// `f(t, x)` in state units per second, `t` in seconds.
    pub fn value(&self, t: f64, x: f64) -> f64 {
        let wave = |s: &Sine| s.amplitude * math::sin(s.frequency * t + s.phase);
        self.slope * x + self.offset + self.sines.iter().map(wave).sum::<f64>()
    }
}

/// A gain `mu(s)`, `s` in (-1, 1), odd and increasing, infinite at the boundary of the funnel.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Gain {
    /// `scale * s / (1 - |s|)`.
    Reciprocal {
        /// In state units per second.
        scale: f64,
    },
    /// `-scale * ln(1 - |s|) * sign(s)`.
    Logarithmic {
        /// In state units per second.
        scale: f64,
    },
    /// `4 bound s` for `|s| < 1/2`, steeper beyond (see [`LocallyLinear`]).
    LocallyLinear {
        /// The paper's `M_f`, in state units per second.
        bound: f64,
    },
}

impl Gain {
    /// The slope of `mu` at 0, in state units per second.
    pub fn scale(&self) -> f64 {
        match *self {
            Gain::Reciprocal { scale } | Gain::Logarithmic { scale } => scale,
            Gain::LocallyLinear { bound } => 4.0 * bound,
        }
    }

    /// `mu(s)` for `|s| < 1`, in state units per second; infinite at `|s| = 1`.
    pub fn apply(&self, s: f64) -> f64 {
        match *self {
            Gain::Reciprocal { scale } => scale * s / (1.0 - s.abs()),
            Gain::Logarithmic { scale } => -scale * math::ln_1p(-s.abs()) * s.signum(),
            Gain::LocallyLinear { bound } => LocallyLinear { bound }.apply(s),
        }
    }

    /// `mu^-1(u)`, in (-1, 1); a value that would round to 1 is the largest `f64` below 1.
    pub fn inverse(&self, u: f64) -> f64 {
        let s = match *self {
            Gain::Reciprocal { scale } => u / (scale + u.abs()),
            Gain::Logarithmic { scale } => -math::exp_m1(-u.abs() / scale) * u.signum(),
            Gain::LocallyLinear { bound } => LocallyLinear { bound }.inverse(u),
        };
        s.clamp(-LARGEST_RATIO, LARGEST_RATIO)
    }

    /// The derivative of [`inverse`](Self::inverse) at `u`, in s per state unit.
    pub fn inverse_slope(&self, u: f64) -> f64 {
        match *self {
            Gain::Reciprocal { scale } => scale / ((scale + u.abs()) * (scale + u.abs())),
            Gain::Logarithmic { scale } => math::exp(-u.abs() / scale) / scale,
            Gain::LocallyLinear { bound } => LocallyLinear { bound }.inverse_slope(u),
        }
    }

    /// `d/du ln(inverse_slope(u))`, in s per state unit; 0 where it jumps, at `u = 0`.
    pub(super) fn inverse_curvature(&self, u: f64) -> f64 {
        let sign = if u == 0.0 { 0.0 } else { u.signum() };
        match *self {
            Gain::Reciprocal { scale } => -2.0 * sign / (scale + u.abs()),
            Gain::Logarithmic { scale } => -sign / scale,
            Gain::LocallyLinear { bound } => -sign * LocallyLinear { bound }.inverse_curvature(u),
        }
    }
}

/// The largest ratio `|nu| / psi` that `f64` tells from 1.
const LARGEST_RATIO: f64 = 1.0 - f64::EPSILON / 2.0;

/// A performance funnel `psi(t) > 0`, in state units.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Funnel {
    /// `factor * ((start - end) exp(-rate t) + end)`.
    Exponential {
        /// Width at `t = 0`, before `factor`.
        start: f64,
        /// Width for `t -> inf`, before `factor`; 0 asks for asymptotic agreement.
        end: f64,
        /// In 1/s.
        rate: f64,
        /// The paper's `r_i`.
        factor: f64,
    },
    /// `factor * width`.
    Constant {
        /// Before `factor`.
        width: f64,
        /// The paper's `r_i`.
        factor: f64,
    },
}

impl Funnel {
    /// `psi(t)` in state units, `t` in seconds.
    pub fn width(&self, t: f64) -> f64 {
        match *self {
            Funnel::Exponential { start, end, rate, factor } => factor * between(start, end, rate * t),
            Funnel::Constant { width, factor } => factor * width,
        }
    }

    /// `psi'(t)` in state units per second.
    pub fn slope(&self, t: f64) -> f64 {
        match *self {
            Funnel::Exponential { start, end, rate, factor } => {
                -rate * factor * (start - end) * math::exp(-rate * t)
            }
            Funnel::Constant { .. } => 0.0,
        }
    }

    fn parameters(&self) -> [f64; 4] {
        match *self {
            Funnel::Exponential { start, end, rate, factor } => [start, end, rate, factor],
            Funnel::Constant { width, factor } => [width, 0.0, 0.0, factor],
        }
    }
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
            for value in field.numbers() {
                require("field", node, value, value.is_finite())?;
            }
        }
        for (node, gain) in self.gains.iter().enumerate() {
            require("gain scale", node, gain.scale(), gain.scale() > 0.0 && gain.scale().is_finite())?;
        }
        for (node, funnel) in self.funnels.iter().enumerate() {
            for value in funnel.parameters() {
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

impl Affine {
    fn numbers(&self) -> impl Iterator<Item = f64> + '_ {
        let waves = self.sines.iter().flat_map(|s| [s.amplitude, s.frequency, s.phase]);
        [self.slope, self.offset].into_iter().chain(waves)
    }
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

    const GAINS: [Gain; 2] = [Gain::Reciprocal { scale: 0.7 }, Gain::Logarithmic { scale: 3.0 }];

    #[test]
    fn the_inverse_inverts_the_gain_and_its_slope_is_its_slope() {
        for gain in GAINS {
            for s in [-0.999, -0.3, 0.0, 1e-9, 0.5, 0.97] {
                let u = gain.apply(s);
                assert!((gain.inverse(u) - s).abs() < 1e-15, "{gain:?} at {s}");
                let h = 1e-6 * (1.0 + u.abs());
                let slope = (gain.inverse(u + h) - gain.inverse(u - h)) / (2.0 * h);
                assert!(
                    (slope - gain.inverse_slope(u)).abs() < 1e-5 * gain.inverse_slope(u),
                    "{gain:?} at {s}"
                );
            }
            assert!(gain.inverse(1e300) < 1.0);
        }
    }

    #[test]
    fn the_slope_of_a_funnel_is_its_derivative() {
        let funnel = Funnel::Exponential { start: 40.0, end: 2.0, rate: 0.5, factor: 3.0 };
        assert_eq!(funnel.width(0.0), 120.0);
        let slope = (funnel.width(1.0 + 1e-5) - funnel.width(1.0 - 1e-5)) / 2e-5;
        assert!((slope - funnel.slope(1.0)).abs() < 1e-7);
    }
}
