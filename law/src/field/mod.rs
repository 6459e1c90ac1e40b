//! The node's own dynamics `f(t, x)`.

mod prepared;

pub use prepared::{Expression, Inputs, NoInputs, PreparedField};

use crate::collect::collect;
use crate::math::{Real, turns_from_radians};
use heapless::Vec;

/// Most sinusoids in a node's own vector field, over all components.
pub const MAX_SINES: usize = 8;
/// Most components of a state.
pub const MAX_COMPONENTS: usize = 8;
/// Most entries of the matrix of a field.
pub const MAX_MATRIX: usize = MAX_COMPONENTS * MAX_COMPONENTS;

/// One value per component of a state.
pub type State<F> = Vec<F, MAX_COMPONENTS>;

/// The state of a node with one component, state units.
///
/// ```
/// use funnelnet_law::field::scalar;
/// assert_eq!(scalar(2.5).as_slice(), [2.5]);
/// ```
#[must_use]
pub fn scalar<F>(x: F) -> State<F> {
    [x].into_iter().collect()
}

/// One sinusoid of a vector field: `amplitude * sin(frequency * t + phase)`.
///
/// ```
/// use funnelnet_law::field::{AffineSines, Field, Sine, VectorField};
/// // 2 sin(t) at t = pi / 2, with ticks of pi / 100 s: half-tick 100.
/// let sine = Sine { component: 0, amplitude: 2.0, frequency: 1.0, phase: 0.0 };
/// let field = AffineSines::<f64>::new(&Field::scalar(0.0, 0.0, [sine]), std::f64::consts::PI / 100.0);
/// assert!((field.at(100, 0.0) - 2.0).abs() < 1e-9);
/// ```
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct Sine<F> {
    /// Component of the state that the sinusoid drives, from 0.
    pub component: u8,
    /// Amplitude, state units / s.
    pub amplitude: F,
    /// Frequency, rad/s. f64, since its error grows with the length of the run.
    pub frequency: f64,
    /// Phase, rad.
    pub phase: f64,
}

/// The numbers of a vector field `f(t, x) = slope * x + offset + sum of sines`, for a state of n components.
///
/// ```
/// use funnelnet_law::field::{AffineSines, Field, VectorField};
/// // f(x) = -x + 3, at rest in 3.
/// let field = AffineSines::<f64>::new(&Field::scalar(-1.0, 3.0, []), 1e-3);
/// assert_eq!(field.at(0, 3.0), 0.0);
/// ```
#[derive(Clone, Debug, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize))]
pub struct Field<F> {
    /// Slope, 1/s: one number for all components, or n times n, row by row.
    pub slope: Vec<F, MAX_MATRIX>,
    /// Offset, state units / s, n numbers.
    pub offset: State<F>,
    /// Sinusoids.
    pub sines: Vec<Sine<F>, MAX_SINES>,
}

impl<F> Field<F> {
    /// Field of a state with one component, from slope (1/s) and offset (state units / s).
    pub fn scalar(slope: F, offset: F, sines: impl IntoIterator<Item = Sine<F>>) -> Self {
        let slope = [slope].into_iter().collect();
        Self { slope, offset: scalar(offset), sines: sines.into_iter().take(MAX_SINES).collect() }
    }
}

/// A node's own vector field (paper, (1), eachdyn). Users implement it for their plant model.
///
/// ```
/// use funnelnet_law::field::{VectorField, midpoint_step};
/// /// `f(x) = x (1 - x)`.
/// struct Logistic;
/// impl VectorField<f64> for Logistic {
///     fn at(&self, _: u64, x: f64) -> f64 {
///         x * (1.0 - x)
///     }
/// }
/// let (mut x, mut carry) = (0.1, 0.0);
/// (0..20_000).for_each(|k| midpoint_step(&Logistic, 1e-3, k, &mut x, &mut carry, 0.0));
/// assert!((x - 1.0).abs() < 1e-6);
/// ```
pub trait VectorField<F: Real> {
    /// `f(t, x)` of a state with one component, state units / s, at `t = half_ticks * T / 2`: integer time
    /// does not lose bits in long runs.
    fn at(&self, half_ticks: u64, x: F) -> F;

    /// Component `index` of `f(t, x)` for a vector state. Unless it is overridden, every component has
    /// [`Self::at`] to itself.
    #[inline]
    fn component(&self, half_ticks: u64, x: &[F], index: usize) -> F {
        x.get(index).map_or(F::ZERO, |&x| self.at(half_ticks, x))
    }
}

/// One sinusoid prepared for a tick period, with an integer phase in 2^-64 turns.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Phasor<F> {
    component: u8,
    amplitude: F,
    start: u64,
    per_half_tick: u64,
}

impl<F: Real> Phasor<F> {
    /// Prepares a sinusoid for tick period `tick` (s).
    #[must_use]
    pub fn new(sine: &Sine<f32>, tick: f64) -> Self {
        Self {
            component: sine.component,
            amplitude: F::from_f32(sine.amplitude),
            start: turns_from_radians(sine.phase),
            per_half_tick: turns_from_radians(sine.frequency * tick * 0.5),
        }
    }

    #[inline]
    fn at(&self, half_ticks: u64) -> F {
        let turns = self.start.wrapping_add(self.per_half_tick.wrapping_mul(half_ticks));
        self.amplitude * F::sin_turns(turns)
    }
}

/// The affine field of a state with one component, whose sinusoids lie elsewhere: a caller with a million
/// fields has no room for [`AffineSines`], which holds eight of them and a matrix. The same bits.
///
/// ```
/// use funnelnet_law::field::{AffineSines, Field, Phasor, Scalar, Sine, VectorField};
/// let sine = Sine { component: 0, amplitude: 2.0, frequency: 3.0, phase: 0.5 };
/// let phasors = [Phasor::<f32>::new(&sine, 1e-3)];
/// let lean = Scalar { slope: -1.0, offset: 0.3, phasors: &phasors };
/// let whole = AffineSines::<f32>::new(&Field::scalar(-1.0, 0.3, [sine]), 1e-3);
/// assert_eq!(lean.at(77, 0.1).to_bits(), whole.at(77, 0.1).to_bits());
/// ```
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Scalar<'a, F> {
    /// Slope, 1/s.
    pub slope: F,
    /// Offset, state units / s.
    pub offset: F,
    /// Sinusoids, whatever component they name.
    pub phasors: &'a [Phasor<F>],
}

impl<F: Real> VectorField<F> for Scalar<'_, F> {
    #[inline]
    fn at(&self, half_ticks: u64, x: F) -> F {
        let mut sum = self.slope * x + self.offset;
        for phasor in self.phasors {
            sum += phasor.at(half_ticks);
        }
        sum
    }
}

/// `f(t, x) = slope x + offset + sum amplitude sin(frequency t + phase)`, where the slope may be a matrix.
#[derive(Clone, Debug, PartialEq)]
pub struct AffineSines<F> {
    /// The one number for all components; zero where there is a matrix.
    slope: F,
    /// Row by row, or empty.
    matrix: Vec<F, MAX_MATRIX>,
    offset: [F; MAX_COMPONENTS],
    phasors: Vec<Phasor<F>, MAX_SINES>,
}

impl<F: Real> AffineSines<F> {
    /// Prepares a validated field for tick period `tick` (s). Its numbers are f32, as they travel, whatever
    /// `F` is.
    #[must_use]
    pub fn new(field: &Field<f32>, tick: f64) -> Self {
        let phasors = field.sines.iter().map(|sine| Phasor::new(sine, tick));
        let mut offset = [F::ZERO; MAX_COMPONENTS];
        offset.iter_mut().zip(&field.offset).for_each(|(slot, &value)| *slot = F::from_f32(value));
        let (slope, matrix) = match field.slope.as_slice() {
            [slope] => (F::from_f32(*slope), Vec::new()),
            entries => (F::ZERO, collect(entries.iter().map(|&entry| F::from_f32(entry)))),
        };
        Self { slope, matrix, offset, phasors: collect(phasors) }
    }
}

impl<F: Real> VectorField<F> for AffineSines<F> {
    #[inline]
    fn at(&self, half_ticks: u64, x: F) -> F {
        let [offset, ..] = self.offset;
        Scalar { slope: self.slope, offset, phasors: &self.phasors }.at(half_ticks, x)
    }

    fn component(&self, half_ticks: u64, x: &[F], index: usize) -> F {
        let own = x.get(index).copied().unwrap_or(F::ZERO);
        let mut sum = self.slope * own + self.offset.get(index).copied().unwrap_or(F::ZERO);
        if !self.matrix.is_empty() {
            let row = self.matrix.chunks(x.len().max(1)).nth(index).unwrap_or(&[]);
            row.iter().zip(x).for_each(|(&entry, &x)| sum += entry * x);
        }
        for phasor in self.phasors.iter().filter(|phasor| usize::from(phasor.component) == index) {
            sum += phasor.at(half_ticks);
        }
        sum
    }
}

/// Advances `x` by tick `k` with `u` held and a midpoint step for `f` (law.md 4); compensated, since `T xdot`
/// is small beside `x`. `carry` is what rounding has left behind so far.
#[inline]
pub fn midpoint_step<F: Real, V: VectorField<F>>(field: &V, tick: F, k: u64, x: &mut F, carry: &mut F, u: F) {
    Stride { tick, half: 1 }.midpoint_step(field, k << 1, x, carry, u);
}

/// Length of a step, which may be longer than the `T` that a field was prepared for.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Stride<F> {
    /// Length, s.
    pub tick: F,
    /// Half of the length, in half ticks of the field.
    pub half: u64,
}

impl<F: Real> Stride<F> {
    /// The step of [`midpoint_step`] from the time `from` on, in half ticks of the field.
    #[inline]
    pub fn midpoint_step<V: VectorField<F>>(self, field: &V, from: u64, x: &mut F, carry: &mut F, u: F) {
        (*x, *carry) = self.midpoint(field, from, (*x, *carry), u);
    }

    /// The state and what rounding leaves behind after the step, from those before it. Always inlined, for loops over many nodes.
    #[inline(always)]
    #[must_use]
    pub fn midpoint<V: VectorField<F>>(
        self,
        field: &V,
        from: u64,
        (mut x, mut carry): (F, F),
        u: F,
    ) -> (F, F) {
        let middle = x + self.tick * F::HALF * (field.at(from, x) + u);
        compensated_add(&mut x, &mut carry, self.tick * (field.at(from + self.half, middle) + u));
        (x, carry)
    }
}

/// `x += change`, with what rounding leaves behind kept in `carry` (Kahan).
///
/// ```
/// use funnelnet_law::field::compensated_add;
/// // A million steps of 1e-8 are lost on 1.0 in f32 one by one, and kept together.
/// let (mut x, mut carry) = (1.0_f32, 0.0);
/// (0..1_000_000).for_each(|_| compensated_add(&mut x, &mut carry, 1e-8));
/// assert!((x - 1.01).abs() < 1e-6);
/// ```
#[inline]
pub fn compensated_add<F: Real>(x: &mut F, carry: &mut F, change: F) {
    let change = change - *carry;
    let next = *x + change;
    *carry = (next - *x) - change;
    *x = next;
}
