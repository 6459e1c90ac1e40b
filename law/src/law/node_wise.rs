//! Node-wise funnel coupling (paper, (3), funnel_coup) in the implicit sampled form of law.md 3:
//!
//! ```text
//! b = c T d / 2
//! r = nu + dnu / 2 + g (dnu - dnu[k-1]) + b (u[k-1] + 2 g (u[k-1] - u[k-2]))
//! find u[k]:   psi(t_k + T / 2) mu^-1(u) + b u = r          (**)
//! ```
//!
//! The left side is strictly increasing in `u`: there is exactly one solution for every `r`, inside the
//! funnel or far outside it. Explicit evaluation is unstable as soon as `T mu'(s) lambda_max / psi > 2`,
//! which a shrinking funnel always reaches (law.md 2). With `g` = 0 it is law (*) of the first edition, whose
//! excess over the funnel is `1 / (1 - 2 g)` times as large.

use crate::funnel::Widths;
use crate::gain::{GainFunction, Solution};
use crate::math::Real;
use crate::start::Pace;

pub use super::constants::{C, Constants, G, THETA};
pub use super::memory::Memory;
use super::memory::{LookBack, share_of_b};

/// Node-wise law (**) with its constants, fixed for a run.
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
    /// `b = theta c T d`, s.
    pub(super) b: F,
    /// `theta` and `g`.
    pub(super) look_back: LookBack<F>,
    /// Both as they are once a start is over.
    usual: (F, LookBack<F>),
}

impl<F: Real, G: GainFunction<F>> NodeWise<F, G> {
    /// The law for tick period `tick` (s) at a node of weighted degree `degree`, with the default constants.
    #[must_use]
    pub fn new(gain: G, tick: f64, degree: f64) -> Self {
        Self::with(gain, tick, degree, Constants::default())
    }

    /// The law with other constants.
    #[must_use]
    pub fn with(gain: G, tick: f64, degree: f64, constants: Constants) -> Self {
        let b = F::from_f64(constants.theta * constants.damping * tick * degree);
        let look_back = LookBack::new(constants);
        Self { gain, b, look_back, usual: (b, look_back) }
    }

    /// The same law with a gain of another type, such as the one that a [`Gain`](crate::Gain) stands for: a loop over many
    /// nodes then chooses once and not at each.
    #[must_use]
    pub fn with_gain<H>(self, gain: H) -> NodeWise<F, H> {
        NodeWise { gain, b: self.b, look_back: self.look_back, usual: self.usual }
    }

    /// Takes the constants of a pace (slow start).
    #[cold]
    pub fn keep_pace(&mut self, pace: Pace) {
        let (b, look_back) = self.usual;
        (self.b, self.look_back) = (b * share_of_b(pace), look_back.at(pace));
    }

    /// Sets `g` = 0, for a node whose state is measured and does not follow from its inputs to the last
    /// digit.
    pub fn stop_looking_back(&mut self) {
        self.look_back = self.look_back.off();
        self.usual.1 = self.look_back;
    }

    /// Weight `b` of the own input in (**), s.
    #[must_use]
    pub fn b(&self) -> F {
        self.b
    }

    /// One tick: input from the diffusive term `nu`, its change `dnu` over the last tick (both state units),
    /// and the funnel.
    #[inline]
    pub fn step(&self, memory: &mut Memory<F>, nu: F, dnu: F, psi: Widths<F>) -> Solution<F> {
        let last = match memory.last_input() {
            Some(u) => u,
            None => self.first_input(nu, psi),
        };
        let solution = self.gain.solve(psi.ahead, self.b, self.right_side(memory, nu, dnu, last));
        memory.note(last, solution.u, dnu);
        solution
    }

    /// Stand-in for the last input where there is none: the law without memory, `psi mu^-1(u) + b u = nu`.
    /// The paper's law as it stands would be an explicit step, which throws the states apart where the gain
    /// is steep (law.md 2).
    #[inline]
    pub(super) fn first_input(&self, nu: F, psi: Widths<F>) -> F {
        self.gain.solve(psi.ahead, self.b, nu).u
    }

    /// `r` of (**) for the last input `last` (state units / s).
    #[inline]
    pub(super) fn right_side(&self, memory: &Memory<F>, nu: F, dnu: F, last: F) -> F {
        self.look_back.right_side(memory, self.b, (nu, dnu), last)
    }
}
