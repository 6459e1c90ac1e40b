//! Gains `mu(s) = gamma(|s|) s` on (-1, 1), built around their inverse.
//!
//! `mu^-1 : R -> (-1, 1)` is the primitive of the whole system: the implicit law (**) needs it, and so does
//! the emergent vector field `sum_i psi_i mu_i^-1(h - f_i) = 0` (paper, (19), alg). Assumption 3 (funnel):
//! `gamma` is positive, non-decreasing and unbounded at the boundary, so that `mu` is odd and strictly
//! increasing.

use crate::math::Real;
use crate::root;

mod algebraic;
mod assumption;
mod linear;
mod locally_linear;
mod logarithmic;
mod median;
mod named;
mod reciprocal;

pub use algebraic::Algebraic;
pub use assumption::{Constants, Violation, check};
pub use linear::Linear;
pub use locally_linear::LocallyLinear;
pub use logarithmic::Logarithmic;
pub use median::Median;
pub use named::{Gain, Kind, MAX_PARAMETERS, NamedGain};
pub use reciprocal::Reciprocal;

/// Solution of the implicit law (**): the input, and the ratio at the end of the step that it aims at.
///
/// ```
/// use funnelnet_law::gain::{GainFunction, Reciprocal, Solution};
/// // psi mu^-1(u) + b u = r with psi = 1, b = 0.5, r = 1: s = 1/2, u = 1.
/// let Solution { u, s } = Reciprocal { scale: 1.0 }.solve(1.0, 0.5, 1.0);
/// assert_eq!((u, s), (1.0, 0.5));
/// ```
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Solution<F> {
    /// Input `u`, state units / s.
    pub u: F,
    /// `s = mu^-1(u)`, within [-1, 1].
    pub s: F,
}

/// A gain, odd in its argument.
///
/// ```
/// use funnelnet_law::gain::{GainFunction, check};
/// /// `mu(s) = s / (1 - s^2)`: only what is needed, the rest has defaults.
/// struct Mine;
/// impl GainFunction<f64> for Mine {
///     fn inverse(&self, u: f64) -> f64 {
///         2.0 * u / (1.0 + (1.0 + 4.0 * u * u).sqrt())
///     }
///     fn inverse_slope(&self, u: f64) -> f64 {
///         let s = self.inverse(u);
///         (1.0 - s * s) * (1.0 - s * s) / (1.0 + s * s)
///     }
///     fn apply(&self, s: f64) -> f64 {
///         s / (1.0 - s * s)
///     }
/// }
/// assert_eq!(check(&Mine).unwrap().lowest, 1.0);
/// let solution = Mine.solve(1.0, 0.1, 0.5);
/// assert!((solution.s + 0.1 * solution.u - 0.5).abs() < 1e-12);
/// ```
pub trait GainFunction<F: Real> {
    /// `mu^-1(u)` in (-1, 1), odd and strictly increasing; rounding may give exactly -1 or 1.
    fn inverse(&self, u: F) -> F;

    /// Derivative of [`GainFunction::inverse`], positive, 1 / (state units / s).
    fn inverse_slope(&self, u: F) -> F;

    /// [`GainFunction::inverse`] and [`GainFunction::inverse_slope`] at once, for a gain that computes them
    /// from the same terms.
    #[inline]
    fn inverse_with_slope(&self, u: F) -> (F, F) {
        (self.inverse(u), self.inverse_slope(u))
    }

    /// `-d/d|u| ln((mu^-1)'(u))`, 1 / (state units / s); zero where `mu` is linear. For references and
    /// forecasts.
    ///
    /// The default is a difference quotient of [`GainFunction::inverse_slope`].
    fn inverse_curvature(&self, u: F) -> F {
        let (size, slope) = (u.abs(), self.inverse_slope(u));
        let step = (size + F::ONE / slope) * F::from_f64(1e-4);
        let ahead = self.inverse_slope(size + step);
        (slope - ahead) / (step * slope)
    }

    /// `gap(u) e^lift` and `inverse_slope(u) e^lift` with the gap `1 - |mu^-1(u)|`, both with all their
    /// digits where `mu^-1(u)` itself rounds to 1: what is left of an agent whose field is far from the
    /// emergent one.
    ///
    /// `lift` is from 0 to [`GainFunction::decay`]. The default is for gains without exponential tails and
    /// without a better formula.
    #[inline]
    fn gap_with_slope(&self, u: F, _lift: F) -> (F, F) {
        let (inverse, slope) = self.inverse_with_slope(u);
        (F::ONE - inverse.abs(), slope)
    }

    /// The exponent `d >= 0` of a gap that falls as `e^-d`, which would underflow far out; zero for a gain
    /// whose gap falls as a power of `1 / |u|`.
    #[inline]
    fn decay(&self, _u: F) -> F {
        F::ZERO
    }

    /// `mu(s)`, state units / s, for `|s| < 1`.
    fn apply(&self, s: F) -> F;

    /// The one solution of `psi mu^-1(u) + b u = r` (law.md 3, (**)), for `psi > 0` and `b >= 0` (s).
    ///
    /// The default is a bracketed Newton iteration; a gain with a closed form overrides it.
    #[inline]
    fn solve(&self, psi: F, b: F, r: F) -> Solution<F> {
        newton(self, psi, b, r)
    }
}

/// Bracketed Newton for `psi mu^-1(u) + b u = r`, solved for `|u|`, since every gain is odd.
///
/// Below the solution the left side is concave where `mu` is convex, so that Newton from below converges
/// monotonically; where it is not, the bracket `[max(0, (|r| - psi) / b), |r| / b]` catches the step (law.md
/// 3).
///
/// ```
/// use funnelnet_law::gain::{GainFunction, Reciprocal, newton};
/// // The same solution as the closed form.
/// let gain = Reciprocal { scale: 1.0 };
/// assert!((newton(&gain, 1.0, 0.5, 1.0_f64).u - gain.solve(1.0, 0.5, 1.0).u).abs() < 1e-12);
/// ```
#[must_use]
pub fn newton<F: Real, G: GainFunction<F> + ?Sized>(gain: &G, psi: F, b: F, r: F) -> Solution<F> {
    let rho = r.abs();
    if !(rho > F::ZERO && b > F::ZERO) {
        // Zero, and not a number where `r` is none.
        let nothing = rho * F::ZERO;
        return Solution { u: nothing, s: nothing };
    }
    let low = ((rho - psi) / b).max(F::ZERO);
    let left_side = |u| {
        let (inverse, slope) = gain.inverse_with_slope(u);
        (psi * inverse + b * u - rho, psi * slope + b)
    };
    // The first Newton step from zero, which needs no function value.
    let start = (rho / (psi * gain.inverse_slope(F::ZERO) + b)).max(low);
    let u = root::increasing(low, rho / b, start, left_side);
    Solution { u: u.copysign(r), s: gain.inverse(u).copysign(r) }
}
