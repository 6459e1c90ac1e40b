//! The logarithmic gain.

use super::GainFunction;
use super::named::{MAX_PARAMETERS, NamedGain};
use crate::math::Real;
use crate::range::{INPUT, Parameter};

/// `mu(s) = -scale * ln(1 - |s|) * sign(s)` (paper, Example 2).
///
/// ```
/// use funnelnet_law::gain::{GainFunction, Logarithmic};
/// // An input of three times the scale still leaves e^-3 = 5 % of the funnel.
/// let left = 1.0 - Logarithmic { scale: 2.0 }.inverse(6.0_f64);
/// assert!((left - 0.0498).abs() < 1e-4);
/// ```
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Logarithmic<F> {
    /// Scale, state units / s.
    pub scale: F,
}

impl<F: Real> GainFunction<F> for Logarithmic<F> {
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

    fn inverse_curvature(&self, _: F) -> F {
        F::ONE / self.scale
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

impl<F: Real> NamedGain<F> for Logarithmic<F> {
    const KIND: &'static str = "logarithmic";
    const PARAMETERS: &'static [Parameter] = &[Parameter::positive("scale", INPUT, Some(1.0))];

    fn from_values([scale, _]: [F; MAX_PARAMETERS]) -> Self {
        Self { scale }
    }

    fn slope_at_zero(&self) -> F {
        self.scale
    }

    fn reaching(&self, gap: F, u: F) -> Option<Self> {
        Some(Self { scale: -u / (gap - F::ONE).ln_1p() })
    }
}
