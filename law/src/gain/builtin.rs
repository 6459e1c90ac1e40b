//! The gains by name, behind one type.

use super::{Gain, Linear, LocallyLinear, Logarithmic, Reciprocal, Solution};
use crate::math::Real;

/// The gains that a configuration can name.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum BuiltinGain<F> {
    /// See [`Reciprocal`].
    Reciprocal(Reciprocal<F>),
    /// See [`Logarithmic`].
    Logarithmic(Logarithmic<F>),
    /// See [`LocallyLinear`].
    LocallyLinear(LocallyLinear<F>),
    /// See [`Linear`].
    Linear(Linear<F>),
}

impl<F: Real> Gain<F> for BuiltinGain<F> {
    #[inline]
    fn inverse(&self, u: F) -> F {
        match self {
            Self::Reciprocal(gain) => gain.inverse(u),
            Self::Logarithmic(gain) => gain.inverse(u),
            Self::LocallyLinear(gain) => gain.inverse(u),
            Self::Linear(gain) => gain.inverse(u),
        }
    }

    #[inline]
    fn inverse_slope(&self, u: F) -> F {
        match self {
            Self::Reciprocal(gain) => gain.inverse_slope(u),
            Self::Logarithmic(gain) => gain.inverse_slope(u),
            Self::LocallyLinear(gain) => gain.inverse_slope(u),
            Self::Linear(gain) => gain.inverse_slope(u),
        }
    }

    #[inline]
    fn inverse_with_slope(&self, u: F) -> (F, F) {
        match self {
            Self::Reciprocal(gain) => gain.inverse_with_slope(u),
            Self::Logarithmic(gain) => gain.inverse_with_slope(u),
            Self::LocallyLinear(gain) => gain.inverse_with_slope(u),
            Self::Linear(gain) => gain.inverse_with_slope(u),
        }
    }

    #[inline]
    fn gap_with_slope(&self, u: F, lift: F) -> (F, F) {
        match self {
            Self::Reciprocal(gain) => gain.gap_with_slope(u, lift),
            Self::Logarithmic(gain) => gain.gap_with_slope(u, lift),
            Self::LocallyLinear(gain) => gain.gap_with_slope(u, lift),
            Self::Linear(gain) => gain.gap_with_slope(u, lift),
        }
    }

    #[inline]
    fn decay(&self, u: F) -> F {
        match self {
            Self::Logarithmic(gain) => gain.decay(u),
            _ => F::ZERO,
        }
    }

    #[inline]
    fn apply(&self, s: F) -> F {
        match self {
            Self::Reciprocal(gain) => gain.apply(s),
            Self::Logarithmic(gain) => gain.apply(s),
            Self::LocallyLinear(gain) => gain.apply(s),
            Self::Linear(gain) => gain.apply(s),
        }
    }

    #[inline]
    fn solve(&self, psi: F, b: F, r: F) -> Solution<F> {
        match self {
            Self::Reciprocal(gain) => gain.solve(psi, b, r),
            Self::Logarithmic(gain) => gain.solve(psi, b, r),
            Self::LocallyLinear(gain) => gain.solve(psi, b, r),
            Self::Linear(gain) => gain.solve(psi, b, r),
        }
    }
}
