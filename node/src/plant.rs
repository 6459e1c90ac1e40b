//! The plant of a node, as the sans-IO core sees it: when to ask the app for a sample or an input, what the
//! actuator can do, and how long the node goes on without a sensor (docs/notes/2026-11-24-real-nodes.md).

use core::fmt;
use funnelnet_law::collect::collect;
use funnelnet_law::field::State;
use funnelnet_law::math::Real;
use heapless::Vec;

use funnelnet_protocol::config::MAX_COMPONENTS;

/// Range of an actuator for one component of the state, in the units of its input: state units / s.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct InputRange {
    low: f32,
    high: f32,
}

/// Reason why a range is refused.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct BadRange {
    /// Lower limit that was asked for, state units / s.
    pub low: f32,
    /// Upper limit that was asked for, state units / s.
    pub high: f32,
}

impl fmt::Display for BadRange {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "input range {} to {}: both finite, low <= 0 <= high and low < high", self.low, self.high)
    }
}

impl InputRange {
    /// The range from `low` to `high` (state units / s). No input at all must be possible: that is what the
    /// law gives where all agree.
    ///
    /// # Errors
    /// The limits, unless they are finite with `low <= 0 <= high` and `low < high`.
    pub fn new(low: f32, high: f32) -> Result<Self, BadRange> {
        let sound = low.is_finite() && high.is_finite() && low <= 0.0 && high >= 0.0 && low < high;
        if sound { Ok(Self { low, high }) } else { Err(BadRange { low, high }) }
    }

    /// Lower limit, state units / s.
    pub fn low(&self) -> f32 {
        self.low
    }

    /// Upper limit, state units / s.
    pub fn high(&self) -> f32 {
        self.high
    }

    /// The input nearest to `u` (state units / s) that the actuator can do; none at all for what is not a
    /// number.
    pub fn clamp<F: Real>(&self, u: F) -> F {
        let (low, high) = (F::from_f32(self.low), F::from_f32(self.high));
        if u >= high {
            high
        } else if u >= low {
            u
        } else if u < low {
            low
        } else {
            F::ZERO
        }
    }
}

/// Facts of a plant that its node has to know.
#[derive(Clone, Debug, PartialEq)]
pub struct PlantSetup {
    /// Ranges of the inputs, one per component of the state.
    pub inputs: Vec<InputRange, MAX_COMPONENTS>,
    /// Samples in a row that may fail; at the next one the node stops.
    pub coast_ticks: u32,
}

impl PlantSetup {
    /// A plant with these inputs, one per component of the state, 8 at most.
    pub fn new(inputs: impl IntoIterator<Item = InputRange>, coast_ticks: u32) -> Self {
        Self { inputs: collect(inputs), coast_ticks }
    }
}

/// The plant of a node.
#[derive(Clone, Debug)]
pub(crate) struct Plant<F> {
    setup: PlantSetup,
    /// Samples in a row that have failed.
    missed: u32,
    /// State units / s.
    inputs: State<F>,
}

impl<F: Real> Plant<F> {
    pub fn new(setup: PlantSetup) -> Self {
        let inputs = collect(setup.inputs.iter().map(|_| F::ZERO));
        Self { setup, missed: 0, inputs }
    }

    pub fn succeed(&mut self) {
        self.missed = 0;
    }

    /// Counts a sample that failed. Where the plant has been without one for too long: for how many samples.
    pub fn miss(&mut self) -> Option<u32> {
        self.missed = self.missed.saturating_add(1);
        (self.missed > self.setup.coast_ticks).then_some(self.missed)
    }

    /// Applies the input `u` to `component` as the actuator can (both state units / s).
    pub fn apply(&mut self, component: usize, u: F) -> F {
        let u = self.setup.inputs.get(component).map_or(F::ZERO, |range| range.clamp(u));
        if let Some(slot) = self.inputs.get_mut(component) {
            *slot = u;
        }
        u
    }

    /// Largest input that even the weakest actuator can do, state units / s.
    pub fn largest_input(&self) -> F {
        let sizes = self.setup.inputs.iter().map(|range| F::from_f32(range.high.max(-range.low)));
        sizes.fold(F::WIDEST, |least, size| if size < least { size } else { least })
    }

    /// Inputs of the last tick, state units / s, component by component.
    pub fn inputs(&self) -> &[F] {
        &self.inputs
    }
}
