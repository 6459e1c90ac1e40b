//! Performance funnels `psi(t)`, evaluated from the tick number, so that every node and the simulator agree bit for bit.

use crate::math::{self, Real};
use funnel_protocol::config::{FunnelConfig, FunnelShape, NormalisedShape};

/// A funnel prepared for a tick period `T`: state units in, state units out.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Funnel<F> {
    /// `span * exp(-rate t) + end`.
    Exponential {
        /// `factor * (start - end)`.
        span: F,
        /// `factor * end`.
        end: F,
        /// `rate * T`.
        decay_per_tick: F,
        /// `exp(-rate * theta * T)`, from a tick to the instant that the law aims at.
        partial_decay: F,
    },
    /// The same width for ever.
    Constant {
        /// `factor * width`.
        width: F,
    },
    /// `scale / t`: infinite at `t = 0`, so that any initial states are inside (paper, remark on the pseudo-global property).
    ReciprocalTime {
        /// `factor * scale / T`.
        per_tick: F,
        /// `theta`.
        theta: F,
    },
    /// `start * (1 - t / at)^power`, zero from `at` on (paper, remark on finite-time synchronization). The law (*) is then
    /// a damped exact consensus step, down to the floor of the node, which answers what the paper leaves open after `at`.
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
    /// `eps psibar(t)` from `t_1` on, and before the exponential that joins the initial width to it (paper, theorem on emergent
    /// behaviour): continuous, with `|psi'| <= lambda psi` throughout.
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
        /// `factor * eps *` the span of `psibar`.
        span: F,
        /// `factor * eps *` the limit of `psibar`.
        end: F,
        /// The rate of `psibar` times T.
        later_decay: F,
        /// `exp` of minus `theta` times that.
        later_partial: F,
    },
}

/// Funnel widths that one tick needs.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Widths<F> {
    /// `psi(k T)`: what the diffusive term is judged by.
    pub now: F,
    /// `psi((k + theta) T)`: what the law (*) uses.
    pub ahead: F,
}

impl<F: Real> Widths<F> {
    /// The same, nowhere narrower than `floor`, from where the width ahead reaches it.
    #[inline]
    pub fn floored(self, floor: F) -> Self {
        if self.ahead > floor { self } else { Self { now: self.now.max(floor), ahead: floor } }
    }
}

impl<F: Real> Funnel<F> {
    /// Prepares a validated configuration (see [`crate::params`]) for tick period `tick` (s) and the law's `theta`.
    pub fn new(config: &FunnelConfig, tick: f64, theta: f64) -> Self {
        let factor = f64::from(config.factor);
        match config.shape {
            FunnelShape::Exponential { start, end, rate } => {
                let rate = f64::from(rate);
                Self::Exponential {
                    span: F::from_f64(factor * (f64::from(start) - f64::from(end))),
                    end: F::from_f64(factor * f64::from(end)),
                    decay_per_tick: F::from_f64(rate * tick),
                    partial_decay: F::from_f64(Real::exp(-rate * theta * tick)),
                }
            }
            FunnelShape::Constant { width } => {
                Self::Constant { width: F::from_f64(factor * f64::from(width)) }
            }
            FunnelShape::ReciprocalTime { scale } => Self::ReciprocalTime {
                per_tick: F::from_f64(factor * f64::from(scale) / tick),
                theta: F::from_f64(theta),
            },
            FunnelShape::FiniteTime { start, at_ns, power } => Self::FiniteTime {
                start: F::from_f64(factor * f64::from(start)),
                per_tick: F::from_f64(tick / (at_ns as f64 * 1e-9)),
                power: F::from_f32(power),
                theta: F::from_f64(theta),
            },
            FunnelShape::Schedule { start, at_ns, eps, then } => {
                let (start, at) = (f64::from(start), at_ns as f64 * 1e-9);
                let (span, end, rate) = normalised(then);
                let scale = factor * f64::from(eps);
                // A funnel that has closed by then has no logarithm.
                let joined = (f64::from(eps) * (span * Real::exp(-rate * at) + end)).max(f64::TINY);
                let per_tick = math::ln(start / joined) * tick / at;
                Self::Schedule {
                    start: F::from_f64(factor * start),
                    decay_per_tick: F::from_f64(per_tick),
                    partial_decay: F::from_f64(Real::exp(-per_tick * theta)),
                    // From the first tick at or after t_1 on; saturates, as a node's ticks do.
                    switch: -math::floor(1e-9 - at / tick) as u32,
                    joined: F::from_f64(factor * joined),
                    span: F::from_f64(scale * span),
                    end: F::from_f64(scale * end),
                    later_decay: F::from_f64(rate * tick),
                    later_partial: F::from_f64(Real::exp(-rate * theta * tick)),
                }
            }
        }
    }

    /// Widths at tick `k`. Never negative; the caller floors them at the resolution of `nu`.
    #[inline]
    pub fn widths(&self, k: u32) -> Widths<F> {
        match *self {
            Self::Exponential { span, end, decay_per_tick, partial_decay } => {
                let transient = span * (-(decay_per_tick * F::from_u32(k))).exp();
                Widths { now: transient + end, ahead: transient * partial_decay + end }
            }
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
            Self::Schedule {
                start,
                decay_per_tick,
                partial_decay,
                switch,
                joined,
                span,
                end,
                later_decay,
                later_partial,
            } => {
                if k < switch {
                    let now = start * (-(decay_per_tick * F::from_u32(k))).exp();
                    // Not past the join, which may lie far within a tick.
                    let ahead = now * partial_decay;
                    let ahead = if decay_per_tick < F::ZERO { ahead.min(joined) } else { ahead.max(joined) };
                    return Widths { now, ahead };
                }
                let transient = span * (-(later_decay * F::from_u32(k))).exp();
                Widths { now: transient + end, ahead: transient * later_partial + end }
            }
        }
    }
}

/// Span, limit and rate (1/s) of a normalised funnel.
fn normalised(shape: NormalisedShape) -> (f64, f64, f64) {
    match shape {
        NormalisedShape::Constant { width } => (0.0, f64::from(width), 0.0),
        NormalisedShape::Exponential { start, end, rate } => {
            (f64::from(start) - f64::from(end), f64::from(end), f64::from(rate))
        }
    }
}
