//! One component of a node's state, and the midpoint step of several at once.

use crate::neighbour::Own;
use funnelnet_law::collect::collect;
use funnelnet_law::field::{State, Stride, VectorField, compensated_add};
use funnelnet_law::law::node_wise::Memory;
use funnelnet_law::math::Real;

/// One component of the state, and what belongs to it.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Part<F> {
    pub x: F,
    /// Rest that rounding has left behind in `x` (compensated summation).
    pub carry: F,
    /// Change of `x` over the last tick.
    pub dx: F,
    /// Diffusive term and its change over the last tick.
    pub nu: F,
    pub dnu: F,
    /// Input of this tick, state units / s.
    pub u: F,
    pub memory: Memory<F>,
    /// Gain of a lambda-tracker, 1/s.
    pub k: F,
}

impl<F: Real> Part<F> {
    pub fn own(&self) -> Own<F> {
        Own { x: self.x, dx: self.dx }
    }

    /// Replaces the prediction by the measurement `x` of the same tick.
    pub fn correct(&mut self, x: F) {
        self.dx += x - self.x;
        (self.x, self.carry) = (x, F::ZERO);
    }
}

/// Does the midpoint step of [`Stride::midpoint_step`] for all components at once.
pub(super) fn vector_step<F: Real, V: VectorField<F>>(
    field: &V,
    Stride { tick, half }: Stride<F>,
    half_ticks: u64,
    parts: &mut [Part<F>],
) {
    let now: State<F> = collect(parts.iter().map(|part| part.x));
    let to_middle = |(index, part): (usize, &Part<F>)| {
        part.x + tick * F::HALF * (field.component(half_ticks, &now, index) + part.u)
    };
    let middle: State<F> = collect(parts.iter().enumerate().map(to_middle));
    for (index, part) in parts.iter_mut().enumerate() {
        let rate = field.component(half_ticks + half, &middle, index) + part.u;
        compensated_add(&mut part.x, &mut part.carry, tick * rate);
    }
}
