//! The gain that averages: linear inside, a reciprocal one at the boundary.

use super::{Gain, Solution};
use crate::math::Real;
use crate::root;

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
