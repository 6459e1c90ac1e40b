//! The node's own dynamics `f(t, x)`.

use crate::math::{Real, turns_from_radians};
use funnel_protocol::config::{FieldConfig, MAX_SINES};
use heapless::Vec;

/// A node's own vector field (paper, eq. (eachdyn)). Users implement it for their plant model.
pub trait VectorField<F: Real> {
    /// `f(t, x)`, state units / s, at `t = half_ticks * T / 2`: integer time does not lose bits in long runs.
    fn at(&self, half_ticks: u64, x: F) -> F;
}

/// One sinusoid with an integer phase in 2^-64 turns.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
struct Phasor<F> {
    amplitude: F,
    start: u64,
    per_half_tick: u64,
}

/// `f(t, x) = slope * x + offset + sum amplitude * sin(frequency * t + phase)`.
#[derive(Clone, Debug, PartialEq)]
pub struct AffineSines<F> {
    slope: F,
    offset: F,
    phasors: Vec<Phasor<F>, MAX_SINES>,
}

impl<F: Real> AffineSines<F> {
    /// Prepares a validated configuration (see [`crate::params`]) for tick period `tick` (s).
    pub fn new(config: &FieldConfig, tick: f64) -> Self {
        let phasors = config.sines.iter().map(|sine| Phasor {
            amplitude: F::from_f32(sine.amplitude),
            start: turns_from_radians(sine.phase),
            per_half_tick: turns_from_radians(sine.frequency * tick * 0.5),
        });
        Self {
            slope: F::from_f32(config.slope),
            offset: F::from_f32(config.offset),
            phasors: phasors.collect(),
        }
    }
}

impl<F: Real> VectorField<F> for AffineSines<F> {
    #[inline]
    fn at(&self, half_ticks: u64, x: F) -> F {
        let mut sum = self.slope * x + self.offset;
        for phasor in &self.phasors {
            let turns = phasor.start.wrapping_add(phasor.per_half_tick.wrapping_mul(half_ticks));
            sum += phasor.amplitude * F::sin_turns(turns);
        }
        sum
    }
}

/// Advances `x` by one tick with `u` held and a midpoint step for `f` (LAW.md 4); compensated, since `T xdot` is small
/// beside `x`. `carry` is what rounding has left behind so far.
#[inline]
pub fn midpoint_step<F: Real, V: VectorField<F>>(field: &V, tick: F, k: u32, x: &mut F, carry: &mut F, u: F) {
    let half_ticks = u64::from(k) << 1;
    let middle = *x + tick * F::HALF * (field.at(half_ticks, *x) + u);
    let change = tick * (field.at(half_ticks | 1, middle) + u) - *carry;
    let next = *x + change;
    *carry = (next - *x) - change;
    *x = next;
}
