//! Funnels evaluated from the tick number, so that every node and the simulator agree bit for bit.

use super::{Funnel, Normalised, Shape};
use crate::math::{self, Real};

/// A funnel prepared for a tick period `T`: state units in, state units out.
///
/// ```
/// use funnelnet_law::funnel::{SampledFunnel, Shape};
/// use funnelnet_law::law::node_wise::THETA;
/// // At 1 ms, tick 2000 is t = 2 s; the law aims half a tick ahead.
/// let funnel = SampledFunnel::<f64>::new(&Shape::ReciprocalTime { scale: 1.0 }.into(), 1e-3, THETA);
/// let widths = funnel.widths(2000);
/// assert!((widths.now - 0.5).abs() < 1e-12 && widths.ahead < widths.now);
/// ```
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum SampledFunnel<F> {
    /// `end + (start - end) exp(-rate t)`.
    Exponential(Transient<F>),
    /// The same width for ever.
    Constant {
        /// `factor * width`.
        width: F,
    },
    /// `scale / t`: infinite at `t = 0`, so that any initial states are inside (paper, remark on the
    /// pseudo-global property).
    ReciprocalTime {
        /// `factor * scale / T`.
        per_tick: F,
        /// `theta`.
        theta: F,
    },
    /// `start * (1 - t / at)^power`, zero from `at` on (paper, remark on finite-time synchronization). The
    /// law (*) is then a damped exact consensus step, down to the floor of the node, which answers what the
    /// paper leaves open after `at`.
    FiniteTime {
        /// `factor * start`.
        start: F,
        /// `T / at`.
        per_tick: F,
        /// Exponent.
        power: F,
        /// `theta`.
        theta: F,
    },
    /// `eps psibar(t)` from `t_1` on, and before the exponential that joins the initial width to it (paper,
    /// theorem on emergent behaviour): continuous, with `|psi'| <= lambda psi` throughout.
    Schedule {
        /// `factor * start`.
        start: F,
        /// `ln(start / (eps psibar(t_1))) T / t_1`; below zero where the funnel widens.
        decay_per_tick: F,
        /// `exp` of minus `theta` times that.
        partial_decay: F,
        /// The first tick of the second part.
        switch: u32,
        /// `factor * eps * psibar(t_1)`, where the parts join.
        joined: F,
        /// `factor * eps * psibar`.
        later: Transient<F>,
    },
}

/// `end + (start - end) exp(-rate t)`, as the sum of two terms that are not negative: a funnel that widens
/// from a millionth of its end is as exact at its start as one that narrows (in f32 `span exp() + end` would
/// be zero there).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Transient<F> {
    /// The smaller one of start and end.
    least: F,
    /// How far the other one is from it.
    span: F,
    /// `rate * T`.
    decay_per_tick: F,
    /// `exp(-rate * theta * T)`, from a tick to the instant that the law aims at.
    partial_decay: F,
    /// `1 - exp(-rate * theta * T)` of one that widens.
    partial_rise: Option<F>,
}

impl<F: Real> Transient<F> {
    /// From `start` to `end` (state units) at `rate` (1/s).
    fn new((start, end, rate): (f64, f64, f64), scale: f64, tick: f64, theta: f64) -> Self {
        let part = -rate * theta * tick;
        Self {
            least: F::from_f64(scale * start.min(end)),
            span: F::from_f64(scale * (start - end).abs()),
            decay_per_tick: F::from_f64(rate * tick),
            partial_decay: F::from_f64(Real::exp(part)),
            partial_rise: (start < end).then(|| F::from_f64(-Real::exp_m1(part))),
        }
    }

    #[inline]
    fn widths(&self, k: u32) -> Widths<F> {
        let exponent = -(self.decay_per_tick * F::from_u32(k));
        let Some(partial_rise) = self.partial_rise else {
            let left = self.span * exponent.exp();
            return Widths { now: left + self.least, ahead: left * self.partial_decay + self.least };
        };
        let risen = -exponent.exp_m1();
        let ahead = risen * self.partial_decay + partial_rise;
        Widths { now: self.span * risen + self.least, ahead: self.span * ahead + self.least }
    }
}

/// Funnel widths that one tick needs.
///
/// ```
/// use funnelnet_law::funnel::Widths;
/// // Never narrower than what rounding leaves.
/// let closed = Widths { now: 1e-9, ahead: 0.0 };
/// assert!(!closed.clears(1e-6));
/// assert_eq!(closed.floored(1e-6), Widths { now: 1e-6, ahead: 1e-6 });
/// ```
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Widths<F> {
    /// `psi(k T)`: what the diffusive term is judged by.
    pub now: F,
    /// `psi((k + theta) T)`: what the law (*) uses.
    pub ahead: F,
}

impl<F: Real> Widths<F> {
    /// Widths that are nowhere narrower than `floor`. Not a number where the floor is none.
    #[inline]
    #[must_use]
    pub fn floored(self, floor: F) -> Self {
        let above = |width: F| if width > floor { width } else { floor };
        Self { now: above(self.now), ahead: above(self.ahead) }
    }

    /// Whether neither end of the tick is as narrow as `floor`.
    #[inline]
    #[must_use]
    pub fn clears(self, floor: F) -> bool {
        self.now > floor && self.ahead > floor
    }
}

impl<F: Real> SampledFunnel<F> {
    /// Prepares a validated funnel for tick period `tick` (s) and the law's `theta`. Its numbers are f32, as
    /// they travel, whatever `F` is.
    #[must_use]
    pub fn new(funnel: &Funnel<f32>, tick: f64, theta: f64) -> Self {
        let factor = f64::from(funnel.factor);
        match funnel.shape {
            Shape::Exponential { start, end, rate } => {
                let shape = (f64::from(start), f64::from(end), f64::from(rate));
                Self::Exponential(Transient::new(shape, factor, tick, theta))
            }
            Shape::Constant { width } => Self::Constant { width: F::from_f64(factor * f64::from(width)) },
            Shape::ReciprocalTime { scale } => Self::ReciprocalTime {
                per_tick: F::from_f64(factor * f64::from(scale) / tick),
                theta: F::from_f64(theta),
            },
            Shape::FiniteTime { start, at_ns, power } => Self::FiniteTime {
                start: F::from_f64(factor * f64::from(start)),
                per_tick: F::from_f64(tick / (at_ns as f64 * 1e-9)),
                power: F::from_f32(power),
                theta: F::from_f64(theta),
            },
            Shape::Schedule { start, at_ns, eps, then } => {
                let (start, at) = (f64::from(start), at_ns as f64 * 1e-9);
                let shape = normalised(then);
                let scale = factor * f64::from(eps);
                // A funnel that has closed by then has no logarithm.
                let joined = (f64::from(eps) * at_time(shape, at)).max(f64::TINY);
                let per_tick = math::ln(start / joined) * tick / at;
                Self::Schedule {
                    start: F::from_f64(factor * start),
                    decay_per_tick: F::from_f64(per_tick),
                    partial_decay: F::from_f64(Real::exp(-per_tick * theta)),
                    // From the first tick at or after t_1 on; saturates, as a node's ticks do.
                    switch: -math::floor(1e-9 - at / tick) as u32,
                    joined: F::from_f64(factor * joined),
                    later: Transient::new(shape, scale, tick, theta),
                }
            }
        }
    }

    /// Widths at tick `k`. Never negative; the caller floors them at the resolution of `nu`.
    #[inline]
    #[must_use]
    pub fn widths(&self, k: u32) -> Widths<F> {
        match *self {
            Self::Exponential(ref transient) => transient.widths(k),
            Self::Constant { width } => Widths { now: width, ahead: width },
            Self::ReciprocalTime { per_tick, theta } => {
                let ticks = F::from_u32(k);
                let now = if k == 0 { F::WIDEST } else { (per_tick / ticks).min(F::WIDEST) };
                Widths { now, ahead: (per_tick / (ticks + theta)).min(F::WIDEST) }
            }
            Self::FiniteTime { start, per_tick, power, theta } => {
                let ticks = F::from_u32(k);
                let width = |ticks: F| start * (F::ONE - ticks * per_tick).max(F::ZERO).pow(power);
                Widths { now: width(ticks), ahead: width(ticks + theta) }
            }
            Self::Schedule { start, decay_per_tick, partial_decay, switch, joined, ref later } => {
                if k < switch {
                    let now = start * (-(decay_per_tick * F::from_u32(k))).exp();
                    // Not past the join, which may lie far within a tick.
                    let ahead = now * partial_decay;
                    let ahead = if decay_per_tick < F::ZERO { ahead.min(joined) } else { ahead.max(joined) };
                    return Widths { now, ahead };
                }
                later.widths(k)
            }
        }
    }
}

impl<F: Real> SampledFunnel<F> {
    /// Widths at the time of `k` ticks that are `parts` times as short, and one of those later (`theta` = 1):
    /// at a start (law.md 7).
    #[cold]
    #[must_use]
    pub fn widths_of_start(&self, k: u32, parts: u32) -> Widths<F> {
        let fine = self.divided(parts);
        Widths { now: fine.widths(k).now, ahead: fine.widths(k.wrapping_add(1)).now }
    }

    /// The same funnel for a tick of a part of `T`; what it has ahead is of no use.
    fn divided(&self, parts: u32) -> Self {
        let share = F::ONE / F::from_u32(parts);
        let slower = |transient: Transient<F>| Transient {
            decay_per_tick: transient.decay_per_tick * share,
            ..transient
        };
        match *self {
            Self::Exponential(transient) => Self::Exponential(slower(transient)),
            Self::Constant { width } => Self::Constant { width },
            Self::ReciprocalTime { per_tick, theta } => {
                Self::ReciprocalTime { per_tick: per_tick * F::from_u32(parts), theta }
            }
            Self::FiniteTime { start, per_tick, power, theta } => {
                Self::FiniteTime { start, per_tick: per_tick * share, power, theta }
            }
            Self::Schedule { start, decay_per_tick, partial_decay, switch, joined, later } => {
                Self::Schedule {
                    start,
                    decay_per_tick: decay_per_tick * share,
                    partial_decay,
                    switch: switch.saturating_mul(parts),
                    joined,
                    later: slower(later),
                }
            }
        }
    }
}

/// Start, end and rate (1/s) of a normalised funnel.
fn normalised(shape: Normalised<f32>) -> (f64, f64, f64) {
    match shape {
        Normalised::Constant { width } => (f64::from(width), f64::from(width), 0.0),
        Normalised::Exponential { start, end, rate } => (f64::from(start), f64::from(end), f64::from(rate)),
    }
}

/// That funnel at `t` (s).
fn at_time((start, end, rate): (f64, f64, f64), t: f64) -> f64 {
    let left = Real::exp(-rate * t);
    if start < end { start - (end - start) * Real::exp_m1(-rate * t) } else { end + (start - end) * left }
}
