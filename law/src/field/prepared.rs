//! The vector field that a configuration describes, whatever its kind.

use super::{AffineSines, Field, MAX_COMPONENTS, MAX_SINES, Phasor, VectorField};
use crate::collect::collect;
use crate::math::Real;
use crate::program::{MAX_CONSTANTS, MAX_OPERATIONS, Operation, Program, Surroundings, run};
use heapless::Vec;

/// Inputs from outside that a program may name. Simulations have them, nodes do not.
pub trait Inputs<F> {
    /// The input with this index at `t = half_ticks T / 2`.
    fn value(&self, index: usize, half_ticks: u64) -> F;
}

/// Absence of inputs, as on a node.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct NoInputs;

impl<F: Real> Inputs<F> for NoInputs {
    fn value(&self, _: usize, _: u64) -> F {
        F::ZERO
    }
}

/// A vector field of one of the kinds that a configuration can describe, prepared for a tick period.
///
/// ```
/// use funnelnet_law::program::Operation::{Add, State, Wave};
/// use funnelnet_law::{Field, PreparedField, Program, VectorField, field::Sine};
/// // x + 2 sin(t) at t = 0, where the sinusoid is what the program reads.
/// let sine = Sine { component: 0, amplitude: 2.0, frequency: 1.0, phase: 0.0 };
/// let program = Program::new([State(0), Wave(0), Add], []);
/// let field = PreparedField::<f32>::new(&Field::scalar(0.0, 0.0, [sine]), &program, 1e-3);
/// assert_eq!(field.at(0, 5.0), 5.0);
/// ```
#[derive(Clone, Debug, PartialEq)]
#[allow(clippy::large_enum_variant)] // no allocator to box one with, and they are of nearly the same size
pub enum PreparedField<F, I = NoInputs> {
    /// Affine in the state, and sinusoids.
    Affine(AffineSines<F>),
    /// An expression.
    Expression(Expression<F, I>),
}

impl<F: Real> PreparedField<F> {
    /// Prepares a validated field and program for tick period `tick` (s). A program, where there is one, is
    /// the whole field, and reads the sinusoids by their index. The numbers are f32, as they travel, whatever
    /// `F` is.
    #[must_use]
    pub fn new(field: &Field<f32>, program: &Program<f32>, tick: f64) -> Self {
        Self::with_inputs(field, program, tick, NoInputs)
    }
}

impl<F: Real, I> PreparedField<F, I> {
    /// Prepares a field as [`Self::new`] does, with inputs from outside.
    #[must_use]
    pub fn with_inputs(field: &Field<f32>, program: &Program<f32>, tick: f64, inputs: I) -> Self {
        if program.is_empty() {
            Self::Affine(AffineSines::new(field, tick))
        } else {
            Self::Expression(Expression::new(field, program, tick, inputs))
        }
    }
}

impl<F: Real, I: Inputs<F>> VectorField<F> for PreparedField<F, I> {
    #[inline]
    fn at(&self, half_ticks: u64, x: F) -> F {
        match self {
            Self::Affine(affine) => affine.at(half_ticks, x),
            Self::Expression(expression) => expression.component(half_ticks, &[x], 0),
        }
    }

    #[inline]
    fn component(&self, half_ticks: u64, x: &[F], index: usize) -> F {
        match self {
            Self::Affine(affine) => affine.component(half_ticks, x, index),
            Self::Expression(expression) => expression.component(half_ticks, x, index),
        }
    }
}

/// A field that is a program.
#[derive(Clone, Debug, PartialEq)]
pub struct Expression<F, I = NoInputs> {
    operations: Vec<Operation, MAX_OPERATIONS>,
    /// Where the operations of each component end.
    ends: Vec<u8, MAX_COMPONENTS>,
    constants: Vec<F, MAX_CONSTANTS>,
    phasors: Vec<Phasor<F>, MAX_SINES>,
    /// `T / 2` in s as a fraction in its lowest terms: as many ticks as possible have the number nearest to
    /// their time.
    half_tick: (u64, F),
    inputs: I,
}

impl<F: Real, I> Expression<F, I> {
    fn new(field: &Field<f32>, program: &Program<f32>, tick: f64, inputs: I) -> Self {
        let operations: Vec<_, MAX_OPERATIONS> = collect(program.operations());
        let is_end = |operation: &Operation| *operation == Operation::Next;
        let ends = operations.iter().enumerate().filter(|(_, operation)| is_end(operation));
        Self {
            ends: collect(ends.map(|(at, _)| at as u8).chain([operations.len() as u8])),
            constants: collect(program.constants.iter().map(|&constant| F::from_f32(constant))),
            phasors: collect(field.sines.iter().map(|sine| Phasor::new(sine, tick))),
            half_tick: half_tick(tick),
            operations,
            inputs,
        }
    }
}

impl<F: Real, I: Inputs<F>> Expression<F, I> {
    // Not inlined because two loops in each of several places would be as many copies of the machine.
    #[inline(never)]
    fn component(&self, half_ticks: u64, x: &[F], index: usize) -> F {
        let end = self.ends.get(index).map_or(0, |&end| usize::from(end));
        let before = index.checked_sub(1).and_then(|before| self.ends.get(before));
        let start = before.map_or(0, |&end| usize::from(end) + 1);
        let operations = self.operations.get(start..end).unwrap_or(&[]);
        let Self { phasors, half_tick, inputs, .. } = self;
        run(operations, &self.constants, x, &Instant { half_ticks, phasors, half_tick: *half_tick, inputs })
    }
}

/// Half a tick of `tick` (s), which is whole nanoseconds.
fn half_tick<F: Real>(tick: f64) -> (u64, F) {
    /// Half nanoseconds in a second: 2^10 5^9, and each of its divisors has a place in an f32.
    const SECOND: u64 = 2_000_000_000;
    let tick_ns = (tick * 1e9 + 0.5) as u64;
    let (mut a, mut b) = (SECOND, tick_ns);
    while b != 0 {
        (a, b) = (b, a % b);
    }
    (tick_ns / a, F::from_u64(SECOND / a))
}

/// What a program sees at a half-tick.
struct Instant<'a, F, I> {
    half_ticks: u64,
    phasors: &'a [Phasor<F>],
    half_tick: (u64, F),
    inputs: &'a I,
}

impl<F: Real, I: Inputs<F>> Surroundings<F> for Instant<'_, F, I> {
    fn time(&self) -> F {
        let (numerator, denominator) = self.half_tick;
        F::from_u64(self.half_ticks.wrapping_mul(numerator)) / denominator
    }

    fn wave(&self, index: usize) -> F {
        self.phasors.get(index).map_or(F::ZERO, |phasor| phasor.at(self.half_ticks))
    }

    fn input(&self, index: usize) -> F {
        self.inputs.value(index, self.half_ticks)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::field::{Sine, State};
    use Operation::*;

    fn field(components: usize) -> Field<f32> {
        let offset: State<f32> = (0..components).map(|_| 0.0).collect();
        let sine = Sine { component: 0, amplitude: 2.0, frequency: 3.0, phase: 0.5 };
        Field { slope: [0.0].into_iter().collect(), offset, sines: [sine].into_iter().collect() }
    }

    #[test]
    fn components_are_evaluated_one_by_one() {
        let program = Program::new([State(1), Next, State(0), Negate, Time, Add], []);
        assert_eq!(program.check(2, 1, 0), Ok(()));
        let field = PreparedField::<f32>::new(&field(2), &program, 1e-3);
        let x = [3.0, 7.0];
        assert_eq!((field.component(4000, &x, 0), field.component(4000, &x, 1)), (7.0, -1.0));
    }

    #[test]
    fn time_is_exact_where_f32_has_it_and_waves_keep_their_phase_for_years() {
        let of = |operation| PreparedField::<f32>::new(&field(1), &Program::new([operation], []), 1e-3);
        let time = of(Time);
        for (half_ticks, t) in [(0, 0.0), (1, 0.0005), (10_000, 5.0), (14_600, 7.3), (2_000_000_000, 1e6)] {
            assert_eq!(time.at(half_ticks, 0.0), t);
        }
        let wave = of(Wave(0));
        let after = |half_ticks: u64| {
            let t = half_ticks as f64 * 5e-4;
            (f64::from(wave.at(half_ticks, 0.0)) - 2.0 * crate::math::sin(3.0 * t + 0.5)).abs()
        };
        // A year of milliseconds.
        assert!(after(1) < 1e-6 && after(123_457) < 1e-6 && after(63_072_000_001) < 2e-6);
    }
}
