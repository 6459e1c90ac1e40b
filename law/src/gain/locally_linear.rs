//! The gain that averages: linear inside, a reciprocal one at the boundary.

use super::named::{MAX_PARAMETERS, NamedGain};
use super::{GainFunction, Solution};
use crate::math::Real;
use crate::range::{INPUT, Parameter};
use crate::root;

/// The paper's locally linear gain (Section "Effect of locally linear mu"): `4 M s` for `|s| < 1/2`, and
/// `4 M s + s / (1 - |s|) - 4 s |s|` beyond. Where all `|f_i| < M`, the emergent dynamics are the plain
/// average.
///
/// ```
/// use funnelnet_law::gain::{GainFunction, LocallyLinear, NamedGain};
/// // Linear while the agents' fields are less than M_f = 20 away from what emerges: the network then averages.
/// let gain = LocallyLinear { bound: 20.0_f64 };
/// assert_eq!(gain.apply(0.25), 20.0);
/// assert_eq!(gain.linear_up_to(), 40.0);
/// ```
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LocallyLinear<F> {
    /// The paper's `M_f`, state units / s.
    pub bound: F,
}

/// A ratio beyond the linear part. Near the knee the edge has the digits, near the boundary the gap.
#[derive(Clone, Copy)]
struct Beyond<F> {
    /// `e = 2 |s| - 1`, in [0, 1].
    edge: F,
    /// `g = 1 - |s|`, in [0, 1/2].
    gap: F,
}

impl<F: Real> Beyond<F> {
    fn at_edge(edge: F) -> Self {
        Self { edge, gap: (F::ONE - edge) * F::HALF }
    }

    fn at_gap(gap: F) -> Self {
        Self { edge: F::ONE - F::TWO * gap, gap }
    }

    fn ratio(self) -> F {
        F::ONE - self.gap
    }
}

impl<F: Real> LocallyLinear<F> {
    /// Where `psi s + b mu(s) = rho`, for `rho` beyond the linear part: the one root of a cubic, up to
    /// `s = 3/4` in `e` and from there in `g`, so that nothing cancels, neither at the knee, where the root
    /// in `g` is almost double, nor where `s` tends to 1.
    #[inline]
    fn beyond(&self, psi: F, b: F, rho: F) -> Beyond<F> {
        let slope = psi + F::from_u32(4) * self.bound * b;
        // (*) at s = 3/4, times 4/3.
        if rho + rho <= F::from_f64(1.5) * (slope + b) {
            Beyond::at_edge(edge(slope, b, rho))
        } else {
            Beyond::at_gap(gap(slope, b, rho))
        }
    }

    /// `mu` there: `1 / g - 4 s` is `e^2 / g`, which does not cancel at the knee.
    #[inline]
    fn apply_beyond(&self, at: Beyond<F>) -> F {
        at.ratio() * (F::from_u32(4) * self.bound + at.edge * at.edge / at.gap)
    }
}

/// `e` with `b e^3 + (b - slope / 2) e^2 + rho e = rho - slope / 2`, in [0, 1/2].
#[inline]
fn edge<F: Real>(slope: F, b: F, rho: F) -> F {
    let excess = (rho - slope * F::HALF).max(F::ZERO);
    let second = b - slope * F::HALF;
    let cubic = |e: F| {
        let value = ((b * e + second) * e + rho) * e - excess;
        (value, (F::from_u32(3) * b * e + second + second) * e + rho)
    };
    // Without the cubic term.
    let root = (rho * rho + F::from_u32(4) * second * excess).max(F::ZERO).sqrt();
    let guess = ((excess + excess) / (rho + root)).min(F::HALF);
    root::increasing(F::ZERO, F::HALF, guess, cubic)
}

/// `g` with `psi s + b mu(s) = rho`, in (0, 1/4].
#[inline]
fn gap<F: Real>(slope: F, b: F, rho: F) -> F {
    let quarter = F::HALF * F::HALF;
    // The difference first: it is exact where the two are close, and b small beside them.
    let first = (rho - slope) + F::from_u32(5) * b;
    let second = slope - F::from_u32(8) * b;
    let third = F::from_u32(4) * b;
    // Minus the cubic, which is -b at g = 0 and positive at g = 1/4.
    let cubic = |g: F| {
        let value = ((third * g + second) * g + first) * g - b;
        (value, (F::from_u32(3) * third * g + F::TWO * second) * g + first)
    };
    let guess = (b / (b + rho)).min(quarter);
    root::increasing(F::ZERO, quarter, guess, cubic)
}

impl<F: Real> GainFunction<F> for LocallyLinear<F> {
    #[inline]
    fn inverse(&self, u: F) -> F {
        let size = u.abs();
        if size <= self.bound + self.bound {
            u / (F::from_u32(4) * self.bound)
        } else {
            self.beyond(F::ZERO, F::ONE, size).ratio().copysign(u)
        }
    }

    /// `mu'(s)` is `4 M + 1 / g^2 - 8 s`, which is `4 M + e (1 + e - e^2) / g^2`.
    #[inline]
    fn inverse_slope(&self, u: F) -> F {
        self.gap_with_slope(u, F::ZERO).1
    }

    fn inverse_curvature(&self, u: F) -> F {
        let size = u.abs();
        if size <= self.bound + self.bound {
            return F::ZERO;
        }
        let g = self.beyond(F::ZERO, F::ONE, size).gap;
        let slope = self.inverse_slope(u);
        (F::TWO / (g * g * g) - F::from_u32(8)) * slope * slope
    }

    #[inline]
    fn gap_with_slope(&self, u: F, _lift: F) -> (F, F) {
        let size = u.abs();
        let linear = F::from_u32(4) * self.bound;
        if size <= self.bound + self.bound {
            return (F::ONE - size / linear, F::ONE / linear);
        }
        let Beyond { edge, gap } = self.beyond(F::ZERO, F::ONE, size);
        (gap, F::ONE / (linear + edge * (F::ONE + edge - edge * edge) / (gap * gap)))
    }

    #[inline]
    fn apply(&self, s: F) -> F {
        let size = s.abs();
        let magnitude = match size < F::HALF {
            true => F::from_u32(4) * self.bound * size,
            false => self.apply_beyond(Beyond::at_gap(F::ONE - size)),
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
        let at = self.beyond(psi, b, rho);
        Solution { u: self.apply_beyond(at).copysign(r), s: at.ratio().copysign(r) }
    }
}

impl<F: Real> NamedGain<F> for LocallyLinear<F> {
    const KIND: &'static str = "locally-linear";
    const PARAMETERS: &'static [Parameter] = &[Parameter::positive("bound", INPUT, None)];

    fn from_values([bound, _]: [F; MAX_PARAMETERS]) -> Self {
        Self { bound }
    }

    fn slope_at_zero(&self) -> F {
        F::from_u32(4) * self.bound
    }

    fn linear_up_to(&self) -> F {
        self.bound + self.bound
    }

    /// Within the linear part, so that the emergent dynamics stay the average: `mu(1/2) = u` leaves half of
    /// the funnel, more than was asked for.
    fn reaching(&self, _: F, u: F) -> Option<Self> {
        Some(Self { bound: F::HALF * u })
    }
}
