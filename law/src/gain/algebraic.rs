//! The algebraic gain.

use super::GainFunction;
use super::named::{MAX_PARAMETERS, NamedGain};
use crate::math::Real;
use crate::range::{INPUT, Parameter};

/// `mu(s) = scale * s / sqrt(1 - s^2)`: almost linear in the middle of the funnel, since `mu''(0) = 0`. At
/// the edge it grows more slowly than the reciprocal gain, so that the same input takes a node nearer to the
/// edge.
///
/// ```
/// use funnelnet_law::gain::{Algebraic, GainFunction};
/// // At 3/5 of the funnel the input is 3/4 of the scale.
/// let gain = Algebraic { scale: 4.0 };
/// assert!((gain.apply(0.6_f64) - 3.0).abs() < 1e-12);
/// assert!((gain.inverse(3.0_f64) - 0.6).abs() < 1e-12);
/// ```
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Algebraic<F> {
    /// Scale, state units / s.
    pub scale: F,
}

/// `|u|` beside the scale, with the smaller one over the larger one, so that no square overflows.
enum Size<F> {
    /// `q = |u| / scale` up to 1, and `sqrt(1 + q^2)`.
    Small(F, F),
    /// `p = scale / |u|` below 1, and `sqrt(1 + p^2)`.
    Large(F, F),
}

impl<F: Real> Algebraic<F> {
    #[inline]
    fn size(&self, u: F) -> Size<F> {
        let size = u.abs();
        if size <= self.scale {
            let q = size / self.scale;
            Size::Small(q, (F::ONE + q * q).sqrt())
        } else {
            let p = self.scale / size;
            Size::Large(p, (F::ONE + p * p).sqrt())
        }
    }
}

impl<F: Real> GainFunction<F> for Algebraic<F> {
    #[inline]
    fn inverse(&self, u: F) -> F {
        self.inverse_with_slope(u).0
    }

    #[inline]
    fn inverse_slope(&self, u: F) -> F {
        self.inverse_with_slope(u).1
    }

    /// Far out from the gap, `1 - |s| = p^2 / (r (r + 1))`, which increases up to the last bit as the
    /// quotient does not.
    #[inline]
    fn inverse_with_slope(&self, u: F) -> (F, F) {
        match self.size(u) {
            Size::Small(q, root) => ((q / root).copysign(u), F::ONE / (self.scale * root * root * root)),
            Size::Large(p, root) => {
                let ratio = p / root;
                let gap = p * p / (root * (root + F::ONE));
                ((F::ONE - gap).copysign(u), ratio * ratio * ratio / self.scale)
            }
        }
    }

    #[inline]
    fn gap_with_slope(&self, u: F, _lift: F) -> (F, F) {
        match self.size(u) {
            // 1 - q / r is 1 / (r (r + q)).
            Size::Small(q, root) => {
                (F::ONE / (root * (root + q)), F::ONE / (self.scale * root * root * root))
            }
            Size::Large(p, root) => {
                let ratio = p / root;
                (p * p / (root * (root + F::ONE)), ratio * ratio * ratio / self.scale)
            }
        }
    }

    fn inverse_curvature(&self, u: F) -> F {
        let three = F::from_u32(3);
        match self.size(u) {
            Size::Small(q, root) => three * q / (self.scale * root * root),
            Size::Large(p, root) => three * p / (self.scale * root * root),
        }
    }

    #[inline]
    fn apply(&self, s: F) -> F {
        self.scale * s / ((F::ONE - s) * (F::ONE + s)).sqrt()
    }
}

impl<F: Real> NamedGain<F> for Algebraic<F> {
    const KIND: &'static str = "algebraic";
    const PARAMETERS: &'static [Parameter] = &[Parameter::positive("scale", INPUT, Some(1.0))];

    fn from_values([scale, _]: [F; MAX_PARAMETERS]) -> Self {
        Self { scale }
    }

    fn slope_at_zero(&self) -> F {
        self.scale
    }

    fn reaching(&self, gap: F, u: F) -> Option<Self> {
        let unit = Self { scale: F::ONE }.apply(F::ONE - gap);
        Some(Self { scale: u / unit })
    }
}
