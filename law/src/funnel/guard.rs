//! The part of a funnel that a law leaves alone at its edge (law.md 7).

use super::Widths;
use crate::math::Real;

/// Ticks over which a guard grows from nothing: a start near the edge gets worse by a guard that is there at
/// once.
pub const GROWN_AFTER: u32 = 100;

/// A law with guard `delta` runs in `(1 - delta) psi`, and is judged by `psi`. At all nodes alike it leaves
/// the emergent dynamics as they are, which depend on the ratios of the funnels only.
///
/// ```
/// use funnelnet_law::funnel::{Guard, Widths};
/// let (guard, psi) = (Guard::new(0.1), Widths { now: 2.0, ahead: 2.0 });
/// assert_eq!(guard.of(0, psi), psi);
/// assert_eq!(guard.of(1000, psi), Widths { now: 2.0, ahead: 2.0 * (1.0 - 0.1) });
/// ```
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Guard<F> {
    delta: F,
    per_tick: F,
    grown_after: u32,
}

impl<F: Real> Guard<F> {
    /// A guard `delta` in [0, 1).
    #[must_use]
    pub fn new(delta: f64) -> Self {
        Self::grown_over(delta, GROWN_AFTER)
    }

    /// Guard `delta` that grows over `ticks` ticks, 1 or more.
    #[must_use]
    pub fn grown_over(delta: f64, ticks: u32) -> Self {
        let per_tick = F::from_f64(delta / f64::from(ticks));
        Self { delta: F::from_f64(delta), per_tick, grown_after: ticks }
    }

    /// Funnel at tick `k` as the law sees it; the width by which the node is judged stays.
    #[inline]
    #[must_use]
    pub fn of(&self, k: u32, psi: Widths<F>) -> Widths<F> {
        if self.delta == F::ZERO {
            return psi;
        }
        let delta = if k < self.grown_after { self.per_tick * F::from_u32(k) } else { self.delta };
        Widths { now: psi.now, ahead: psi.ahead * (F::ONE - delta) }
    }
}
