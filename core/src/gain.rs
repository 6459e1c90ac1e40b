//! Gains `mu(s) = gamma(|s|) s` on (-1, 1), built around their inverse.
//!
//! `mu^-1 : R -> (-1, 1)` is the primitive of the whole system: the implicit law (*) needs it, and so does the emergent
//! vector field `sum_i psi_i mu_i^-1(h - f_i) = 0` (paper, eq. (alg)). Assumption 3 (funnel): odd, strictly increasing,
//! unbounded at the boundary.

use crate::math::Real;
use crate::root;

/// Solution of the implicit law (*): the input, and the ratio at the end of the step that it aims at.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Solution<F> {
    /// Input `u`, state units / s.
    pub u: F,
    /// `s = mu^-1(u)`, within [-1, 1].
    pub s: F,
}

/// A gain, odd in its argument.
pub trait Gain<F: Real> {
    /// `mu^-1(u)` in (-1, 1), odd and strictly increasing; rounding may give exactly -1 or 1.
    fn inverse(&self, u: F) -> F;

    /// Derivative of [`Gain::inverse`], positive, 1 / (state units / s).
    fn inverse_slope(&self, u: F) -> F;

    /// `mu(s)`, state units / s, for `|s| < 1`.
    fn apply(&self, s: F) -> F;

    /// The one solution of `psi mu^-1(u) + b u = r` (LAW.md 3, (*)), for `psi > 0` and `b >= 0` (s).
    ///
    /// The default is a bracketed Newton iteration; a gain with a closed form overrides it.
    #[inline]
    fn solve(&self, psi: F, b: F, r: F) -> Solution<F> {
        newton(self, psi, b, r)
    }
}

/// Bracketed Newton for `psi mu^-1(u) + b u = r`, solved for `|u|`, since every gain is odd.
///
/// Below the solution the left side is concave where `mu` is convex, so that Newton from below converges monotonically;
/// where it is not, the bracket `[max(0, (|r| - psi) / b), |r| / b]` catches the step (LAW.md 3).
pub fn newton<F: Real, G: Gain<F> + ?Sized>(gain: &G, psi: F, b: F, r: F) -> Solution<F> {
    let rho = r.abs();
    if !(rho > F::ZERO && b > F::ZERO) {
        return Solution { u: F::ZERO, s: F::ZERO };
    }
    let low = ((rho - psi) / b).max(F::ZERO);
    let left_side = |u| (psi * gain.inverse(u) + b * u - rho, psi * gain.inverse_slope(u) + b);
    let u = root::increasing(low, rho / b, low, left_side);
    Solution { u: u.copysign(r), s: gain.inverse(u).copysign(r) }
}

/// `mu(s) = scale * s / (1 - |s|)` (paper, Example 1).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Reciprocal<F> {
    /// State units / s.
    pub scale: F,
}

impl<F: Real> Gain<F> for Reciprocal<F> {
    #[inline]
    fn inverse(&self, u: F) -> F {
        u / (self.scale + u.abs())
    }

    #[inline]
    fn inverse_slope(&self, u: F) -> F {
        let sum = self.scale + u.abs();
        self.scale / sum / sum
    }

    #[inline]
    fn apply(&self, s: F) -> F {
        self.scale * s / (F::ONE - s.abs())
    }

    /// Closed form in `g = 1 - |s|`, without cancellation (LAW.md 3): one square root, two divisions.
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
    fn apply(&self, s: F) -> F {
        (-self.scale * (-s.abs()).ln_1p()).copysign(s)
    }
}

/// The gains that a configuration can name.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum BuiltinGain<F> {
    /// See [`Reciprocal`].
    Reciprocal(Reciprocal<F>),
    /// See [`Logarithmic`].
    Logarithmic(Logarithmic<F>),
}

impl<F: Real> Gain<F> for BuiltinGain<F> {
    #[inline]
    fn inverse(&self, u: F) -> F {
        match self {
            Self::Reciprocal(gain) => gain.inverse(u),
            Self::Logarithmic(gain) => gain.inverse(u),
        }
    }

    #[inline]
    fn inverse_slope(&self, u: F) -> F {
        match self {
            Self::Reciprocal(gain) => gain.inverse_slope(u),
            Self::Logarithmic(gain) => gain.inverse_slope(u),
        }
    }

    #[inline]
    fn apply(&self, s: F) -> F {
        match self {
            Self::Reciprocal(gain) => gain.apply(s),
            Self::Logarithmic(gain) => gain.apply(s),
        }
    }

    #[inline]
    fn solve(&self, psi: F, b: F, r: F) -> Solution<F> {
        match self {
            Self::Reciprocal(gain) => gain.solve(psi, b, r),
            Self::Logarithmic(gain) => gain.solve(psi, b, r),
        }
    }
}
