//! Node-wise funnel coupling (paper, (3), funnel_coup) in the implicit sampled form of LAW.md 3:
//!
//! ```text
//! b = theta c T d
//! r = nu + theta dnu + b u[k-1]
//! find u[k]:   psi(t_k + theta T) mu^-1(u) + b u = r          (*)
//! ```
//!
//! The left side is strictly increasing in `u`: there is exactly one solution for every `r`, inside the funnel or far
//! outside it. Explicit evaluation is unstable as soon as `T mu'(s) lambda_max / psi > 2`, which a shrinking funnel always
//! reaches (LAW.md 2).

use crate::funnel::Widths;
use crate::gain::{GainFunction, Solution};
use crate::math::Real;

/// `theta` = 1/2: second order in `T`.
pub const THETA: f64 = 0.5;
/// `c` = 2.2: above 2, which covers every weighted undirected graph (LAW.md 3), and 13 % more exact than 2.5 at the same
/// robustness to loss (docs/notes/2026-11-23-first-light.md).
pub const C: f64 = 2.2;

/// Node-wise law (*) with its constants, fixed for a run.
///
/// ```
/// use funnelnet_law::funnel::Widths;
/// use funnelnet_law::gain::Reciprocal;
/// use funnelnet_law::law::node_wise::{Memory, NodeWise};
/// // Far outside its funnel a node pushes hard, and nothing overflows: u is about (|nu| - psi) / b at the first tick.
/// let law = NodeWise::new(Reciprocal { scale: 1.0 }, 0.01, 2.0);
/// let solution = law.step(&mut Memory::default(), 50.0_f64, 0.0, Widths { now: 1.0, ahead: 1.0 });
/// assert!(solution.u > 1000.0 && solution.s < 1.0);
/// ```
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct NodeWise<F, G> {
    /// Gain.
    pub gain: G,
    /// `theta`.
    pub(super) theta: F,
    /// `b = theta c T d`, s.
    pub(super) b: F,
}

/// Memory of the law between ticks: the last input, once there is one.
///
/// ```
/// use funnelnet_law::law::node_wise::Memory;
/// // An actuator at its limit: the law goes on from what was really done.
/// let mut memory = Memory::default();
/// memory.feed_back(2.0);
/// assert_eq!(memory.last_input(), Some(2.0));
/// ```
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Memory<F> {
    pub(super) last_input: Option<F>,
}

impl<F: Real> Memory<F> {
    /// Replaces the last input by what an actuator really did (LAW.md 6).
    pub fn feed_back(&mut self, u: F) {
        self.last_input = Some(u);
    }

    /// The last input, state units / s, once there is one.
    #[must_use]
    pub fn last_input(&self) -> Option<F> {
        self.last_input
    }
}

impl<F: Real, G: GainFunction<F>> NodeWise<F, G> {
    /// The law for tick period `tick` (s) at a node of weighted degree `degree`, with the default `theta` and `c`.
    #[must_use]
    pub fn new(gain: G, tick: f64, degree: f64) -> Self {
        Self::with(gain, tick, degree, THETA, C)
    }

    /// The law with other constants: `theta` in [1/2, 1], `c > 2`.
    #[must_use]
    pub fn with(gain: G, tick: f64, degree: f64, theta: f64, c: f64) -> Self {
        Self { gain, theta: F::from_f64(theta), b: F::from_f64(theta * c * tick * degree) }
    }

    /// One tick: input from the diffusive term `nu`, its change `dnu` over the last tick (both state units), and the
    /// funnel.
    #[inline]
    pub fn step(&self, memory: &mut Memory<F>, nu: F, dnu: F, psi: Widths<F>) -> Solution<F> {
        let last = match memory.last_input {
            Some(u) => u,
            None => self.first_input(nu, psi),
        };
        let solution = self.gain.solve(psi.ahead, self.b, self.right_side(nu, dnu, last));
        memory.last_input = Some(solution.u);
        solution
    }

    /// Stand-in for the last input where there is none: (*) without memory, `psi mu^-1(u) + b u = nu`. The paper's law as it
    /// stands would be an explicit step, which throws the states apart where the gain is steep (LAW.md 2).
    #[inline]
    pub(super) fn first_input(&self, nu: F, psi: Widths<F>) -> F {
        self.gain.solve(psi.ahead, self.b, nu).u
    }

    /// `r` of (*) for the last input `last` (state units / s).
    #[inline]
    pub(super) fn right_side(&self, nu: F, dnu: F, last: F) -> F {
        nu + self.theta * dnu + self.b * last
    }
}
