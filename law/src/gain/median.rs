//! The gain that finds the median.

use super::named::{MAX_PARAMETERS, NamedGain};
use super::{GainFunction, Reciprocal, Solution};
use crate::math::Real;
use crate::range::{Allowed, INPUT, Parameter, SMALLEST};

/// The gain of the distributed median (paper, Section "Finding median agent"): a reciprocal one whose inverse
/// meets `mu^-1(s) >= 1 - eps` for `s >= eta` (paper, (27), beta_bound) with equality,
/// `scale = eta eps / (1 - eps)`.
///
/// The result is within `eta` of the weighted median (paper, Lemma med) if `eps < 2 / (N + 1)` and all
/// funnels are equal.
///
/// ```
/// use funnelnet_law::gain::{GainFunction, Median};
/// // An agent whose field is eta = 0.1 away from the rest already takes 1 - eps = 95 % of its funnel.
/// let gain = Median { eta: 0.1, eps: 0.05 };
/// assert!((gain.inverse(0.1_f64) - 0.95).abs() < 1e-12);
/// ```
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Median<F> {
    /// The paper's `eta`, state units / s, above zero.
    pub eta: F,
    /// The paper's `eps`, from 0 to 1, both excluded.
    pub eps: F,
}

impl<F: Real> Median<F> {
    /// Reciprocal gain with the same values.
    #[inline]
    #[must_use]
    pub fn reciprocal(self) -> Reciprocal<F> {
        Reciprocal { scale: self.eta * self.eps / (F::ONE - self.eps) }
    }
}

impl<F: Real> GainFunction<F> for Median<F> {
    #[inline]
    fn inverse(&self, u: F) -> F {
        self.reciprocal().inverse(u)
    }

    #[inline]
    fn inverse_slope(&self, u: F) -> F {
        self.reciprocal().inverse_slope(u)
    }

    fn inverse_curvature(&self, u: F) -> F {
        self.reciprocal().inverse_curvature(u)
    }

    #[inline]
    fn gap_with_slope(&self, u: F, lift: F) -> (F, F) {
        self.reciprocal().gap_with_slope(u, lift)
    }

    #[inline]
    fn apply(&self, s: F) -> F {
        self.reciprocal().apply(s)
    }

    #[inline]
    fn solve(&self, psi: F, b: F, r: F) -> Solution<F> {
        self.reciprocal().solve(psi, b, r)
    }
}

impl<F: Real> NamedGain<F> for Median<F> {
    const KIND: &'static str = "median";
    const PARAMETERS: &'static [Parameter] = &[
        Parameter::positive("eta", INPUT, None),
        Parameter { name: "eps", unit: "1", allowed: Allowed::Between(SMALLEST, 0.999), default: None },
    ];

    fn from_values([eta, eps]: [F; MAX_PARAMETERS]) -> Self {
        Self { eta, eps }
    }

    fn slope_at_zero(&self) -> F {
        self.reciprocal().scale
    }

    fn reaching(&self, gap: F, u: F) -> Option<Self> {
        let wanted = self.reciprocal().reaching(gap, u)?;
        Some(Self { eta: wanted.scale / self.reciprocal().scale * self.eta, ..*self })
    }
}
