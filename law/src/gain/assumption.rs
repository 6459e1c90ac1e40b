//! Whether a user's own gain is one: Assumption 3 (funnel) of the paper, and the consistency that the law
//! relies on.
//!
//! `gamma : [0, 1) -> R_>0` is non-decreasing and tends to infinity, so that `mu(s) = gamma(|s|) s` is odd,
//! strictly increasing and unbounded. Samples, not a proof: `u` over 18 decades around `mu(1/2)`, `s` down to
//! the last bits before 1, (*) over 12 decades of every term. A gain that passes can still be wrong between
//! two samples.

#![allow(clippy::neg_cmp_op_on_partial_ord, reason = "a comparison that NaN fails is the point")]

use super::{GainFunction, Solution};
use crate::math::Real;
use core::fmt;

/// Figures of a gain that has passed, from the samples.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Constants<F> {
    /// `gamma(0)`, the smallest gain there is, state units / s.
    pub lowest: F,
    /// `mu(1/2)`, state units / s.
    pub half: F,
    /// Largest `|mu^-1(mu(s)) - s| / s`.
    pub round_trip: F,
    /// Largest `|psi mu^-1(u) + b u - r| / |r|` at what `solve` finds.
    pub residual: F,
}

/// Violation of Assumption 3, and where. Every `u` in state units / s.
#[derive(Clone, Copy, Debug, PartialEq)]
#[non_exhaustive]
pub enum Violation<F> {
    /// `mu^-1(0)` is not zero.
    NotZero {
        /// Value found.
        s: F,
    },
    /// `mu^-1(-u)` is not `-mu^-1(u)`.
    NotOdd {
        /// Where.
        u: F,
        /// `mu^-1(u)`.
        s: F,
        /// `mu^-1(-u)`.
        mirrored: F,
    },
    /// `mu^-1(u)` is outside [-1, 1], or not a number.
    OutOfRange {
        /// Where.
        u: F,
        /// `mu^-1(u)`.
        s: F,
    },
    /// `mu^-1` does not grow, and is not at 1 either.
    NotIncreasing {
        /// From here,
        from: F,
        /// where it is this,
        s_from: F,
        /// to here,
        to: F,
        /// where it is this.
        s_to: F,
    },
    /// `mu^-1` is still below 31/32 at the largest input there is, [`Real::WIDEST`].
    BelowOne {
        /// Where.
        u: F,
        /// `mu^-1(u)`.
        s: F,
    },
    /// `inverse_slope` is not the derivative of `inverse`.
    WrongSlope {
        /// Where.
        u: F,
        /// Value that the gain gives.
        slope: F,
        /// The difference quotient of `inverse`.
        quotient: F,
    },
    /// `inverse_with_slope` is not `inverse` and `inverse_slope`.
    NotBoth {
        /// Where.
        u: F,
    },
    /// `gamma(0) = mu'(0)` is not a positive number.
    NoLowest {
        /// `inverse_slope(0)`, its reciprocal.
        slope: F,
    },
    /// `mu^-1(mu(s))` is not `s`.
    NotInverse {
        /// Where.
        s: F,
        /// `mu(s)`.
        u: F,
        /// `mu^-1(mu(s))`.
        back: F,
    },
    /// `gamma(s) = mu(s) / s` falls.
    GammaFalls {
        /// Up to here.
        s: F,
        /// `gamma(s)`.
        gamma: F,
        /// Value before.
        before: F,
    },
    /// `mu` seems to have a limit at the boundary: its growth per halving of `1 - s` dies out.
    Bounded {
        /// Where the growth ends.
        s: F,
        /// `mu(s)`.
        u: F,
        /// Growth over the last halving, state units / s.
        growth: F,
        /// Growth ten halvings before.
        before: F,
    },
    /// `solve` does not solve (*).
    NotSolved {
        /// Funnel.
        psi: F,
        /// `b`, s.
        b: F,
        /// Right side.
        r: F,
        /// Value that `solve` gives.
        found: Solution<F>,
        /// `|psi mu^-1(u) + b u - r| / |r|`.
        residual: F,
    },
}

impl<F: Real> fmt::Display for Violation<F> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match *self {
            Self::NotZero { s } => write!(f, "mu^-1(0) is {s:?}, not 0"),
            Self::NotOdd { u, s, mirrored } => {
                write!(f, "not odd: mu^-1 is {s:?} at {u:?} and {mirrored:?} at minus that")
            }
            Self::OutOfRange { u, s } => write!(f, "mu^-1({u:?}) is {s:?}, not within [-1, 1]"),
            Self::NotIncreasing { from, s_from, to, s_to } => {
                write!(f, "not increasing: mu^-1 is {s_from:?} at {from:?} and {s_to:?} at {to:?}")
            }
            Self::BelowOne { u, s } => write!(f, "mu^-1 does not tend to 1: it is {s:?} at {u:?}"),
            Self::WrongSlope { u, slope, quotient } => {
                write!(f, "wrong slope at {u:?}: {slope:?}, but mu^-1 grows by {quotient:?} per unit")
            }
            Self::NotBoth { u } => write!(f, "inverse_with_slope({u:?}) is not inverse and inverse_slope"),
            Self::NoLowest { slope } => {
                write!(f, "gamma(0) is not positive: the slope of mu^-1 at 0 is {slope:?}")
            }
            Self::NotInverse { s, u, back } => write!(f, "mu({s:?}) is {u:?}, but mu^-1 of that is {back:?}"),
            Self::GammaFalls { s, gamma, before } => {
                write!(f, "gamma falls from {before:?} to {gamma:?} at {s:?}")
            }
            Self::Bounded { s, u, growth, before } => {
                write!(f, "mu is bounded: {u:?} at {s:?}, where it grows by {growth:?}, after {before:?}")
            }
            Self::NotSolved { psi, b, r, found, residual } => write!(
                f,
                "not a solution for psi = {psi:?}, b = {b:?}, r = {r:?}: u = {:?}, s = {:?}, off by {residual:?} of r",
                found.u, found.s
            ),
        }
    }
}

impl<F: Real> core::error::Error for Violation<F> {}

/// Relative error allowed, in [`Real::EPSILON`]: gains of few operations keep below 8.
const TOLERANCE: u32 = 256;
/// Samples of `u`: factor between two, and how many to either side of `mu(1/2)`: 9 decades.
const STEP: f64 = 1.25;
const SAMPLES: u32 = 93;
/// Half of the relative distance of a difference quotient.
const QUOTIENT_STEP: f64 = 1.0 / 64.0;
/// Halvings of `1 - s` between which growth is compared, and what must be left of it. Bounded and smooth
/// leaves 1/1000, a logarithm everything.
const HALVINGS: usize = 10;
const GROWTH_LEFT: f64 = 0.25;

/// Checks a gain against Assumption 3, and its functions against each other.
///
/// Some ten thousand evaluations: for tests and for start-up on a host, not for a tick.
///
/// ```
/// use funnelnet_law::gain::{self, GainFunction};
/// use funnelnet_law::math::Real;
///
/// /// `mu(s) = s / sqrt(1 - s^2)`.
/// struct Root;
///
/// impl<F: Real> GainFunction<F> for Root {
///     fn inverse(&self, u: F) -> F {
///         u / (F::ONE + u * u).sqrt()
///     }
///     fn inverse_slope(&self, u: F) -> F {
///         let square = F::ONE + u * u;
///         F::ONE / (square * square.sqrt())
///     }
///     fn apply(&self, s: F) -> F {
///         s / ((F::ONE - s) * (F::ONE + s)).sqrt()
///     }
/// }
///
/// let constants = gain::check::<f64>(&Root).unwrap();
/// assert_eq!(constants.lowest, 1.0);
/// // mu(s) = 2 s, clipped, does not know the funnel.
/// struct Clipped;
///
/// impl GainFunction<f64> for Clipped {
///     fn inverse(&self, u: f64) -> f64 {
///         (u / 2.0).clamp(-1.0, 1.0)
///     }
///     fn inverse_slope(&self, u: f64) -> f64 {
///         if u.abs() < 2.0 { 0.5 } else { 0.0 }
///     }
///     fn apply(&self, s: f64) -> f64 {
///         2.0 * s
///     }
/// }
///
/// assert!(matches!(gain::check(&Clipped), Err(gain::Violation::Bounded { .. })));
/// ```
///
/// # Errors
/// The first property that does not hold, where, and by how much.
pub fn check<F: Real>(gain: &(impl GainFunction<F> + ?Sized)) -> Result<Constants<F>, Violation<F>> {
    let lowest = lowest(gain)?;
    let half = gain.apply(F::HALF);
    shape(gain, half)?;
    slopes(gain, half)?;
    let round_trip = round_trips(gain)?;
    unbounded(gain)?;
    let residual = solutions(gain, half)?;
    Ok(Constants { lowest, half, round_trip, residual })
}

fn tolerance<F: Real>() -> F {
    F::from_u32(TOLERANCE) * F::EPSILON
}

/// Written so that NaN is not near anything.
fn near<F: Real>(x: F, y: F, distance: F) -> bool {
    (x - y).abs() <= distance
}

/// `from`, `from * factor`, ...: `count` numbers, less what is beyond [`Real::WIDEST`].
fn geometric<F: Real>(from: F, factor: F, count: u32) -> impl Iterator<Item = F> {
    (0..count)
        .scan(from, move |x, _| {
            let here = *x;
            *x = here * factor;
            Some(here)
        })
        .take_while(|x| *x <= F::WIDEST)
}

/// Ascending, 9 decades to either side of `half`.
fn inputs<F: Real>(half: F) -> impl Iterator<Item = F> {
    let nine_decades = F::from_u32(1_000_000_000);
    geometric(half / nine_decades, F::from_f64(STEP), 2 * SAMPLES)
}

/// Ratios, ascending: decades from 1e-9 up to 1/2, then `1 - s` halved down to two bits, as long as `mu` is a
/// number.
fn ratios<F: Real>(gain: &(impl GainFunction<F> + ?Sized)) -> impl Iterator<Item = F> {
    let small = geometric(F::from_f64(1e-9), F::from_f64(STEP), 200).take_while(|s| *s < F::HALF);
    small.chain(boundary(gain).map(|(s, _)| s))
}

/// `(s, mu(s))` with `1 - s` halved from 1/2 down to two bits, as long as `mu` is not infinite for every
/// purpose.
fn boundary<F: Real>(gain: &(impl GainFunction<F> + ?Sized)) -> impl Iterator<Item = (F, F)> {
    geometric(F::HALF, F::HALF, 64)
        .take_while(|gap| *gap > F::EPSILON + F::EPSILON)
        .map(|gap| (F::ONE - gap, gain.apply(F::ONE - gap)))
        // Written so that NaN is kept, and found.
        .take_while(|(_, u)| !(*u > F::WIDEST))
}

fn lowest<F: Real>(gain: &(impl GainFunction<F> + ?Sized)) -> Result<F, Violation<F>> {
    let s = gain.inverse(F::ZERO);
    if s != F::ZERO {
        return Err(Violation::NotZero { s });
    }
    let slope = gain.inverse_slope(F::ZERO);
    let lowest = F::ONE / slope;
    if lowest > F::ZERO && lowest.is_finite() { Ok(lowest) } else { Err(Violation::NoLowest { slope }) }
}

/// `mu^-1` within [-1, 1], odd, increasing, and 1 in the end.
fn shape<F: Real>(gain: &(impl GainFunction<F> + ?Sized), half: F) -> Result<(), Violation<F>> {
    let (mut from, mut s_from) = (F::ZERO, F::ZERO);
    for u in inputs(half).chain([F::WIDEST]) {
        let (s, mirrored) = (gain.inverse(u), gain.inverse(-u));
        if !(s.abs() <= F::ONE) {
            return Err(Violation::OutOfRange { u, s });
        }
        if !near(s, -mirrored, F::from_u32(4) * F::EPSILON) {
            return Err(Violation::NotOdd { u, s, mirrored });
        }
        if !(s > s_from || (saturated(s_from) && near(s, s_from, F::EPSILON))) {
            return Err(Violation::NotIncreasing { from, s_from, to: u, s_to: s });
        }
        (from, s_from) = (u, s);
    }
    let enough = F::ONE - F::ONE / F::from_u32(32);
    if s_from >= enough { Ok(()) } else { Err(Violation::BelowOne { u: from, s: s_from }) }
}

/// Whether `mu^-1` is so close to 1 that rounding hides its growth.
fn saturated<F: Real>(s: F) -> bool {
    s >= F::ONE - F::from_u32(32) * F::EPSILON
}

/// The difference quotient lies between the slopes at its ends, give or take rounding and 1 % for what lies
/// between.
fn slopes<F: Real>(gain: &(impl GainFunction<F> + ?Sized), half: F) -> Result<(), Violation<F>> {
    let steepest = gain.inverse_slope(F::ZERO);
    for u in inputs(half) {
        let (s, slope) = (gain.inverse(u), gain.inverse_slope(u));
        let both = gain.inverse_with_slope(u);
        if !(near(both.0, s, tolerance::<F>() * s) && near(both.1, slope, tolerance::<F>() * steepest)) {
            return Err(Violation::NotBoth { u });
        }
        let (below, above) = (u - u * F::from_f64(QUOTIENT_STEP), u + u * F::from_f64(QUOTIENT_STEP));
        let width = above - below;
        let quotient = (gain.inverse(above) - gain.inverse(below)) / width;
        let (left, right) = (gain.inverse_slope(below), gain.inverse_slope(above));
        let rounding = F::from_u32(8) * F::EPSILON * s / width;
        let low = left.min(right).min(slope) * F::from_f64(0.99) - rounding;
        let high = left.max(right).max(slope) * F::from_f64(1.01) + rounding;
        if !(slope >= F::ZERO && quotient >= low && quotient <= high) {
            return Err(Violation::WrongSlope { u, slope, quotient });
        }
    }
    Ok(())
}

/// `mu^-1(mu(s)) = s`, and `gamma(s) = mu(s) / s` never falls. The largest relative error of the round trip.
fn round_trips<F: Real>(gain: &(impl GainFunction<F> + ?Sized)) -> Result<F, Violation<F>> {
    let (mut worst, mut before) = (F::ZERO, F::ZERO);
    for s in ratios(gain) {
        let u = gain.apply(s);
        let back = gain.inverse(u);
        let odd = near(gain.apply(-s), -u, tolerance::<F>() * u.abs());
        if !(odd && near(back, s, tolerance::<F>() * s)) {
            return Err(Violation::NotInverse { s, u, back });
        }
        worst = worst.max((back - s).abs() / s);
        let gamma = u / s;
        if !(gamma >= before - tolerance::<F>() * before) {
            return Err(Violation::GammaFalls { s, gamma, before });
        }
        before = before.max(gamma);
    }
    Ok(worst)
}

/// `gamma -> infinity`: the growth of `mu` over halvings of `1 - s` does not die out.
fn unbounded<F: Real>(gain: &(impl GainFunction<F> + ?Sized)) -> Result<(), Violation<F>> {
    let growth = boundary(gain).zip(boundary(gain).skip(1)).map(|((_, u), (s, next))| (s, next, next - u));
    let early = boundary(gain).zip(boundary(gain).skip(1)).map(|((_, u), (_, next))| next - u);
    match growth.skip(HALVINGS).zip(early).last() {
        Some(((s, u, growth), before)) if !(growth >= F::from_f64(GROWTH_LEFT) * before) => {
            Err(Violation::Bounded { s, u, growth, before })
        }
        // Fewer halvings than that: it has grown beyond every number before.
        _ => Ok(()),
    }
}

/// (*) with its three terms in every proportion over 12 decades. The largest relative residual.
fn solutions<F: Real>(gain: &(impl GainFunction<F> + ?Sized), half: F) -> Result<F, Violation<F>> {
    let (low, factor) = (F::from_f64(1e-6), F::from_u32(3));
    let mut worst = F::ZERO;
    for psi in [F::from_f64(1e-3), F::ONE, F::from_u32(1000)] {
        for damping in geometric(low, factor, 26) {
            for ratio in geometric(low, factor, 26) {
                let (b, r) = (damping * psi / half, ratio * psi);
                worst = worst.max(solution(gain, psi, b, r)?).max(solution(gain, psi, b, -r)?);
            }
        }
    }
    Ok(worst)
}

fn solution<F: Real>(gain: &(impl GainFunction<F> + ?Sized), psi: F, b: F, r: F) -> Result<F, Violation<F>> {
    let found = gain.solve(psi, b, r);
    let residual = (psi * gain.inverse(found.u) + b * found.u - r).abs() / r.abs();
    let ratio_fits = found.s.abs() <= F::ONE && near(found.s, gain.inverse(found.u), tolerance());
    if residual <= tolerance() && ratio_fits {
        Ok(residual)
    } else {
        Err(Violation::NotSolved { psi, b, r, found, residual })
    }
}
