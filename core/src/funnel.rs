//! Performance funnels `psi(t)`, evaluated from the tick number, so that every node and the simulator agree bit for bit.

use crate::math::Real;
use funnel_protocol::config::{FunnelConfig, FunnelShape};

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
}

/// Funnel widths that one tick needs.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Widths<F> {
    /// `psi(k T)`: what the diffusive term is judged by.
    pub now: F,
    /// `psi((k + theta) T)`: what the law (*) uses.
    pub ahead: F,
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
        }
    }
}
