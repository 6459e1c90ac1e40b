//! The linear gain, a baseline.

use super::{Gain, Solution};
use crate::math::Real;

/// The high-gain coupling `u = slope nu`, whatever the funnel is: what funnels are compared with (paper, Introduction).
///
/// It is no funnel gain, since it is bounded at the boundary (Assumption 3). `psi` does not enter: `mu^-1(u) = u / slope`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Linear<F> {
    /// 1/s.
    pub slope: F,
}

impl<F: Real> Gain<F> for Linear<F> {
    #[inline]
    fn inverse(&self, u: F) -> F {
        u / self.slope
    }

    #[inline]
    fn inverse_slope(&self, _: F) -> F {
        F::ONE / self.slope
    }

    #[inline]
    fn apply(&self, s: F) -> F {
        self.slope * s
    }

    /// `u / slope + b u = r`.
    #[inline]
    fn solve(&self, _: F, b: F, r: F) -> Solution<F> {
        let u = self.slope * r / (F::ONE + b * self.slope);
        Solution { u, s: (u / self.slope).max(-F::ONE).min(F::ONE) }
    }
}
