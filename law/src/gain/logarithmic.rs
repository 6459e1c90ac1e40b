//! The logarithmic gain.

use super::Gain;
use crate::math::Real;

/// `mu(s) = -scale * ln(1 - |s|) * sign(s)` (paper, Example 2).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Logarithmic<F> {
    /// State units / s.
    pub scale: F,
}

impl<F: Real> Gain<F> for Logarithmic<F> {
    #[inline]
    fn inverse(&self, u: F) -> F {
        (-(-(u.abs() / self.scale)).exp_m1()).copysign(u)
    }

    #[inline]
    fn inverse_slope(&self, u: F) -> F {
        (-(u.abs() / self.scale)).exp() / self.scale
    }

    #[inline]
    fn inverse_with_slope(&self, u: F) -> (F, F) {
        let decay = (-(u.abs() / self.scale)).exp_m1();
        ((-decay).copysign(u), (F::ONE + decay) / self.scale)
    }

    #[inline]
    fn gap_with_slope(&self, u: F, lift: F) -> (F, F) {
        let gap = (lift - self.decay(u)).exp();
        (gap, gap / self.scale)
    }

    #[inline]
    fn decay(&self, u: F) -> F {
        u.abs() / self.scale
    }

    #[inline]
    fn apply(&self, s: F) -> F {
        (-self.scale * (-s.abs()).ln_1p()).copysign(s)
    }
}
