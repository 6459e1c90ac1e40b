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

/// Largest `|nu| / psi` from which an input is computed directly.
const FIRST_RATIO: f64 = 0.99;

/// A gain, odd in its argument.
pub trait Gain<F: Real> {
    /// `mu^-1(u)` in (-1, 1), odd and strictly increasing; rounding may give exactly -1 or 1.
    fn inverse(&self, u: F) -> F;

    /// Derivative of [`Gain::inverse`], positive, 1 / (state units / s).
    fn inverse_slope(&self, u: F) -> F;

    /// [`Gain::inverse`] and [`Gain::inverse_slope`] at once, for a gain that computes them from the same terms.
    #[inline]
    fn inverse_with_slope(&self, u: F) -> (F, F) {
        (self.inverse(u), self.inverse_slope(u))
    }

    /// `mu(s)`, state units / s, for `|s| < 1`.
    fn apply(&self, s: F) -> F;

    /// The paper's law as it stands, `mu(nu / psi)`, state units / s, with the ratio held below [`FIRST_RATIO`]: what the very
    /// first input is computed by.
    #[inline]
    fn input(&self, nu: F, psi: F) -> F {
        let limit = F::from_f64(FIRST_RATIO);
        self.apply((nu / psi).max(-limit).min(limit))
    }

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
    let left_side = |u| {
        let (inverse, slope) = gain.inverse_with_slope(u);
        (psi * inverse + b * u - rho, psi * slope + b)
    };
    // The first Newton step from zero, which needs no function value.
    let start = (rho / (psi * gain.inverse_slope(F::ZERO) + b)).max(low);
    let u = root::increasing(low, rho / b, start, left_side);
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
    fn inverse_with_slope(&self, u: F) -> (F, F) {
        let decay = (-(u.abs() / self.scale)).exp_m1();
        ((-decay).copysign(u), (F::ONE + decay) / self.scale)
    }

    #[inline]
    fn apply(&self, s: F) -> F {
        (-self.scale * (-s.abs()).ln_1p()).copysign(s)
    }
}

/// The paper's locally linear gain (Section "Effect of locally linear mu"): `4 M s` for `|s| < 1/2`, and
/// `4 M s + s / (1 - |s|) - 4 s |s|` beyond. Where all `|f_i| < M`, the emergent dynamics are the plain average.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LocallyLinear<F> {
    /// The paper's `M_f`, state units / s.
    pub bound: F,
}

impl<F: Real> LocallyLinear<F> {
    /// `g = 1 - s` with `psi s + b mu(s) = rho`, for `rho` beyond the linear part: the one root in (0, 1/2) of a cubic.
    ///
    /// In `g` nothing cancels where `s` tends to 1.
    #[inline]
    fn gap(&self, psi: F, b: F, rho: F) -> F {
        let slope = psi + F::from_u32(4) * self.bound * b;
        let first = rho + F::from_u32(5) * b - slope;
        let second = slope - F::from_u32(8) * b;
        let third = F::from_u32(4) * b;
        // Minus the cubic, which is -b at g = 0 and positive at g = 1/2.
        let cubic = |g: F| {
            let value = ((third * g + second) * g + first) * g - b;
            (value, (F::from_u32(3) * third * g + F::TWO * second) * g + first)
        };
        let guess = (b / (b + rho)).min(F::HALF);
        root::increasing(F::ZERO, F::HALF, guess, cubic)
    }

    /// `-d/d|u| ln(inverse_slope(u))`, 1 / (state units / s); zero in the linear part. For references.
    pub fn inverse_curvature(&self, u: F) -> F {
        let size = u.abs();
        if size <= self.bound + self.bound {
            return F::ZERO;
        }
        let g = self.gap(F::ZERO, F::ONE, size);
        let slope = self.inverse_slope(u);
        (F::TWO / (g * g * g) - F::from_u32(8)) * slope * slope
    }

    /// `mu(1 - g)` for `g` in (0, 1/2]: `1 / g - 4 s` is `(1 - 2 g)^2 / g`, which does not cancel at the knee.
    #[inline]
    fn apply_gap(&self, g: F) -> F {
        let s = F::ONE - g;
        let edge = F::ONE - F::TWO * g;
        s * (F::from_u32(4) * self.bound + edge * edge / g)
    }
}

impl<F: Real> Gain<F> for LocallyLinear<F> {
    #[inline]
    fn inverse(&self, u: F) -> F {
        let size = u.abs();
        if size <= self.bound + self.bound {
            u / (F::from_u32(4) * self.bound)
        } else {
            (F::ONE - self.gap(F::ZERO, F::ONE, size)).copysign(u)
        }
    }

    #[inline]
    fn inverse_slope(&self, u: F) -> F {
        let size = u.abs();
        let linear = F::from_u32(4) * self.bound;
        if size <= self.bound + self.bound {
            return F::ONE / linear;
        }
        let g = self.gap(F::ZERO, F::ONE, size);
        F::ONE / (linear + F::ONE / (g * g) - F::from_u32(8) * (F::ONE - g))
    }

    #[inline]
    fn apply(&self, s: F) -> F {
        let size = s.abs();
        let magnitude = match size < F::HALF {
            true => F::from_u32(4) * self.bound * size,
            false => self.apply_gap(F::ONE - size),
        };
        magnitude.copysign(s)
    }

    #[inline]
    fn solve(&self, psi: F, b: F, r: F) -> Solution<F> {
        let (rho, linear) = (r.abs(), F::from_u32(4) * self.bound);
        let s = r / (psi + linear * b);
        if s.abs() <= F::HALF {
            return Solution { u: linear * s, s };
        }
        if b <= F::ZERO {
            return Solution { u: F::ZERO, s: F::ZERO };
        }
        let g = self.gap(psi, b, rho);
        Solution { u: self.apply_gap(g).copysign(r), s: (F::ONE - g).copysign(r) }
    }
}

/// The gain of the distributed median (paper, Section "Finding median agent"): a reciprocal one whose inverse meets
/// `mu^-1(s) >= 1 - eps` for `s >= eta` (paper, eq. (beta_bound)) with equality, `scale = eta eps / (1 - eps)`.
///
/// `eta` in state units / s, above zero; `eps` in (0, 1). The result is within `eta` of the weighted median (paper, Lemma med)
/// if `eps < 2 / (N + 1)` and all funnels are equal.
pub fn median<F: Real>(eta: F, eps: F) -> Reciprocal<F> {
    Reciprocal { scale: eta * eps / (F::ONE - eps) }
}

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

    #[inline]
    fn input(&self, nu: F, _: F) -> F {
        self.slope * nu
    }

    /// `u / slope + b u = r`.
    #[inline]
    fn solve(&self, _: F, b: F, r: F) -> Solution<F> {
        let u = self.slope * r / (F::ONE + b * self.slope);
        Solution { u, s: (u / self.slope).max(-F::ONE).min(F::ONE) }
    }
}

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
    #[inline]
    fn input(&self, nu: F, psi: F) -> F {
        match self {
            Self::Reciprocal(gain) => gain.input(nu, psi),
            Self::Logarithmic(gain) => gain.input(nu, psi),
            Self::LocallyLinear(gain) => gain.input(nu, psi),
            Self::Linear(gain) => gain.input(nu, psi),
        }
    }
}
