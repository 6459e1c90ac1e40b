//! The lambda-tracker (paper, Section "Related approaches"): `u = k nu`, and `k' = |nu| (|nu| - eta)` while
//! `|nu| > eta`.
//!
//! A baseline: its gain never falls, and amplifies noise for ever. It gets the implicit step of law (*) as
//! well, with `psi mu^-1(u)` replaced by `u / k`: in a comparison an explicit step would only show that it is
//! unstable.

use super::node_wise::{Memory, NodeWise};
use crate::gain::{GainFunction, Linear};
use crate::math::Real;

/// Lambda-tracker with its constants, fixed for a run.
///
/// ```
/// use funnelnet_law::gain::Linear;
/// use funnelnet_law::law::LambdaTracker;
/// use funnelnet_law::law::node_wise::{Memory, NodeWise};
/// // The gain grows while the error is above eta, and never falls.
/// let (law, tracker) = (NodeWise::new(Linear { slope: 1.0 }, 0.01, 1.0), LambdaTracker::new(0.1_f64, 0.01));
/// let (mut memory, mut k) = (Memory::default(), 1.0);
/// tracker.step(&law, &mut memory, &mut k, 2.0, 0.0);
/// assert!((k - 1.038).abs() < 1e-12);
/// ```
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LambdaTracker<F> {
    /// `eta`, state units: errors below this are left alone.
    eta: F,
    /// Tick period, s.
    tick: F,
}

impl<F: Real> LambdaTracker<F> {
    /// The law for a dead zone `eta` (state units) and tick period `tick` (s).
    #[must_use]
    pub fn new(eta: F, tick: f64) -> Self {
        Self { eta, tick: F::from_f64(tick) }
    }

    /// One tick: grows `k` (1/s), then gives the input (state units / s) for the diffusive term `nu` and its
    /// change `dnu` (both state units). `law` carries the step of law (*) of the node.
    #[inline]
    pub fn step<G>(&self, law: &NodeWise<F, G>, memory: &mut Memory<F>, k: &mut F, nu: F, dnu: F) -> F {
        let size = nu.abs();
        // Explicit: a tracker has no better knowledge of the error to come. Bounded, so that nothing
        // overflows.
        *k = (*k + self.tick * size * (size - self.eta).max(F::ZERO)).min(F::WIDEST);
        let gain = Linear { slope: *k };
        let last = memory.last_input().unwrap_or(gain.solve(F::ONE, law.b, nu).u);
        let u = gain.solve(F::ONE, law.b, nu + law.look_back.theta * dnu + law.b * last).u;
        memory.feed_back(u);
        u
    }
}
