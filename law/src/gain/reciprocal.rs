//! The reciprocal gain, whose law (*) has a closed form.

use super::named::{MAX_PARAMETERS, NamedGain};
use super::{GainFunction, Solution};
use crate::math::Real;
use crate::range::{INPUT, Parameter};

/// `mu(s) = scale * s / (1 - |s|)` (paper, Example 1).
///
/// ```
/// use funnelnet_law::gain::{GainFunction, Reciprocal};
/// // Half way to the edge of the funnel the input is the scale itself, and at 9/10 nine times that.
/// let gain = Reciprocal { scale: 2.0 };
/// assert_eq!(gain.apply(0.5), 2.0);
/// assert_eq!(gain.inverse(18.0), 0.9);
/// ```
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Reciprocal<F> {
    /// Scale, state units / s.
    pub scale: F,
}

impl<F: Real> GainFunction<F> for Reciprocal<F> {
    /// Beyond 1/2 from the gap, `1 - |s| = scale / (scale + |u|)`: it increases up to the last bit, as the
    /// quotient does not.
    #[inline]
    fn inverse(&self, u: F) -> F {
        let (size, sum) = (u.abs(), self.scale + u.abs());
        if size <= self.scale { u / sum } else { (F::ONE - self.scale / sum).copysign(u) }
    }

    #[inline]
    fn inverse_slope(&self, u: F) -> F {
        let sum = self.scale + u.abs();
        self.scale / sum / sum
    }

    fn inverse_curvature(&self, u: F) -> F {
        F::TWO / (self.scale + u.abs())
    }

    #[inline]
    fn gap_with_slope(&self, u: F, _lift: F) -> (F, F) {
        let sum = self.scale + u.abs();
        let gap = self.scale / sum;
        (gap, gap / sum)
    }

    #[inline]
    fn apply(&self, s: F) -> F {
        self.scale * s / (F::ONE - s.abs())
    }

    /// Closed form in the gap `1 - |s|`, without cancellation (law.md 3): one square root, two divisions.
    #[inline]
    fn solve(&self, psi: F, b: F, r: F) -> Solution<F> {
        let rho = r.abs();
        let scaled = b * self.scale;
        let excess = rho + scaled - psi;
        let product = psi * scaled;
        let root = (excess * excess + (product + product) * F::TWO).sqrt();
        let gap = if excess >= F::ZERO {
            (scaled + scaled) / (excess + root)
        } else {
            (root - excess) / (psi + psi)
        };
        let quotient = r / (psi * gap + scaled);
        // Rounding can push |s| just above 1.
        Solution { u: self.scale * quotient, s: (quotient * gap).max(-F::ONE).min(F::ONE) }
    }
}

impl<F: Real> NamedGain<F> for Reciprocal<F> {
    const KIND: &'static str = "reciprocal";
    const PARAMETERS: &'static [Parameter] = &[Parameter::positive("scale", INPUT, Some(1.0))];

    fn from_values([scale, _]: [F; MAX_PARAMETERS]) -> Self {
        Self { scale }
    }

    fn slope_at_zero(&self) -> F {
        self.scale
    }

    /// `mu^-1(u) = |u| / (scale + |u|)` leaves `scale / (scale + |u|)`.
    fn reaching(&self, gap: F, u: F) -> Option<Self> {
        Some(Self { scale: u * gap / (F::ONE - gap) })
    }
}
