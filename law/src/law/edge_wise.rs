//! Edge-wise funnel coupling: every edge has a funnel of its own, `u_i = sum_j u_ij`,
//! `u_ij = mu(nu_ij / psi)` with `nu_ij = alpha_ij (x_j - x_i)`.
//!
//! `u_ij = -u_ji`, so the inputs of a network add up to zero and the emergent dynamics are the plain average
//! (paper, (4), blend). In sampled form (**) holds for every edge, with
//!
//! ```text
//! b_ij = theta (c / 2) T alpha_ij (n_i + n_j)
//! ```
//!
//! where `n` counts the edges at either end: `T alpha_ij (n_i + n_j)` bounds the change of `nu_ij` that
//! inputs cause, as `2 T d_i` does for `nu_i` (docs/notes/2026-11-23-whole-paper.md). Both ends compute it
//! from the same numbers, and (**) is odd in `r`: the two inputs cancel bit for bit while no frame is lost.

use super::memory::{LookBack, Memory, share_of_b};
use super::node_wise::Constants;
use crate::floor::Floor;
use crate::funnel::Widths;
use crate::gain::GainFunction;
use crate::math::Real;
use crate::start::Pace;

/// Edge-wise law with its constants, fixed for a run; the gain is handed in.
///
/// ```
/// use funnelnet_law::funnel::Widths;
/// use funnelnet_law::gain::Reciprocal;
/// use funnelnet_law::law::node_wise::{Constants, Memory};
/// use funnelnet_law::law::{EdgeWise, edge_wise::EdgeTerm};
/// // Both ends of an edge push alike, against each other.
/// let law = EdgeWise::new(0.01, Constants::default());
/// let (gain, psi) = (Reciprocal { scale: 1.0 }, Widths { now: 1.0, ahead: 1.0 });
/// let end = |nu: f64| EdgeTerm { nu, dnu: 0.0, stiffness: 2.0 };
/// let push = |nu| law.step(&gain, &mut Memory::default(), &end(nu), psi);
/// assert_eq!(push(0.3), -push(-0.3));
/// ```
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct EdgeWise<F> {
    /// `theta (c / 2) T`, s.
    share: F,
    look_back: LookBack<F>,
    /// Both as they are once a start is over.
    usual: (F, LookBack<F>),
    /// Floor of the funnel of an edge of stiffness 1.
    pub floor: Floor<F>,
}

/// One edge at one tick, as one end sees it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct EdgeTerm<F> {
    /// `alpha_ij (x_j - x_i)`, state units.
    pub nu: F,
    /// Change of `nu` over the last tick, state units.
    pub dnu: F,
    /// Stiffness `alpha_ij (n_i + n_j)` of the edge.
    pub stiffness: F,
}

impl<F: Real> EdgeWise<F> {
    /// The law for tick period `tick` (s).
    #[must_use]
    pub fn new(tick: f64, constants: Constants) -> Self {
        // Half its stiffness is to an edge what its degree is to a node: it stands in `b` alike.
        let floor = Floor::new(0.5, tick);
        let share = F::from_f64(constants.theta * constants.damping / 2.0 * tick);
        let look_back = LookBack::new(constants);
        Self { share, look_back, usual: (share, look_back), floor }
    }

    /// Takes the constants of a pace (slow start).
    #[cold]
    pub fn keep_pace(&mut self, pace: Pace) {
        let (share, look_back) = self.usual;
        (self.share, self.look_back) = (share * share_of_b(pace), look_back.at(pace));
    }

    /// Sets `g` = 0, as [`NodeWise::stop_looking_back`](super::node_wise::NodeWise::stop_looking_back).
    pub fn stop_looking_back(&mut self) {
        self.look_back = self.look_back.off();
        self.usual.1 = self.look_back;
    }

    /// One tick: the input of one edge, state units / s. The memory is that of the edge.
    #[inline]
    pub fn step<G: GainFunction<F>>(
        &self,
        gain: &G,
        memory: &mut Memory<F>,
        edge: &EdgeTerm<F>,
        psi: Widths<F>,
    ) -> F {
        let b = self.share * edge.stiffness;
        let last = match memory.last_input() {
            Some(u) => u,
            // As the first input of `node_wise`.
            None => gain.solve(psi.ahead, b, edge.nu).u,
        };
        let r = self.look_back.right_side(memory, b, (edge.nu, edge.dnu), last);
        let u = gain.solve(psi.ahead, b, r).u;
        memory.note(last, u, edge.dnu);
        u
    }
}
