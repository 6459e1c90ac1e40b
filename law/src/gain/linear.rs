//! The linear gain, a baseline.

use super::named::{MAX_PARAMETERS, NamedGain};
use super::{GainFunction, Solution};
use crate::math::Real;
use crate::range::Parameter;

/// The high-gain coupling `u = slope nu`, whatever the funnel is: what funnels are compared with (paper,
/// Introduction).
///
/// It is no funnel gain, since it is bounded at the boundary (Assumption 3). `psi` does not enter:
/// `mu^-1(u) = u / slope`.
///
/// ```
/// use funnelnet_law::gain::{GainFunction, Linear};
/// // With b = 0.5 s the implicit step gives a third of the explicit u = slope nu = 12.
/// let solution = Linear { slope: 4.0 }.solve(1.0, 0.5, 3.0);
/// assert_eq!(solution.u, 4.0);
/// ```
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Linear<F> {
    /// Slope, 1/s.
    pub slope: F,
}

impl<F: Real> GainFunction<F> for Linear<F> {
    #[inline]
    fn inverse(&self, u: F) -> F {
        u / self.slope
    }

    #[inline]
    fn inverse_slope(&self, _: F) -> F {
        F::ONE / self.slope
    }

    fn inverse_curvature(&self, _: F) -> F {
        F::ZERO
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

impl<F: Real> NamedGain<F> for Linear<F> {
    const KIND: &'static str = "linear";
    const PARAMETERS: &'static [Parameter] = &[Parameter::positive("slope", "1/s", None)];
    const KEEPS_FUNNELS: bool = false;

    fn from_values([slope, _]: [F; MAX_PARAMETERS]) -> Self {
        Self { slope }
    }

    fn slope_at_zero(&self) -> F {
        self.slope
    }

    fn linear_up_to(&self) -> F {
        F::WIDEST
    }

    fn reaching(&self, _: F, _: F) -> Option<Self> {
        None
    }
}
