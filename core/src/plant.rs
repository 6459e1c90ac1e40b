//! The plant of a node, as the sans-IO core sees it: when to ask the app for a sample or an input, what the actuator can do,
//! and how long the node goes on without a sensor (docs/notes/2026-11-24-real-nodes.md).

use crate::collect::collect;
use crate::field::State;
use crate::math::Real;
use core::fmt;
use heapless::Vec;

use funnel_protocol::config::MAX_COMPONENTS;

/// What an actuator can do to one component of the state, in the units of its input: state units / s.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct InputRange {
    low: f32,
    high: f32,
}

/// Why there is no such range.
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
    /// From `low` to `high` (state units / s). No input at all must be possible: that is what the law gives where all agree.
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

    /// The input nearest to `u` (state units / s) that the actuator can do.
    pub fn clamp<F: Real>(&self, u: F) -> F {
        u.max(F::from_f32(self.low)).min(F::from_f32(self.high))
    }
}

/// What a node has to know of its plant.
#[derive(Clone, Debug, PartialEq)]
pub struct PlantSetup {
    /// One per component of the state.
    pub inputs: Vec<InputRange, MAX_COMPONENTS>,
    /// Samples in a row that may fail; at the next one the node stops.
    pub coast_ticks: u32,
}

/// What the app is asked for next.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) enum Demand {
    Sample,
    Actuate,
}

/// What a sample is for.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) enum Purpose {
    /// The announcement of the initial state.
    Announce,
    /// A tick, which waits for it.
    Tick,
}

#[derive(Clone, Copy, Debug, PartialEq)]
enum Step {
    Idle,
    /// The app is to be asked for a sample.
    Ask(Purpose),
    /// The app has been asked for it.
    Await(Purpose),
    /// The app is to be told that there are inputs.
    Tell,
}

/// The plant of a node, between two ticks or in the middle of one.
#[derive(Clone, Debug)]
pub(crate) struct Plant<F> {
    setup: PlantSetup,
    step: Step,
    /// Samples in a row that have failed.
    missed: u32,
    /// State units / s.
    inputs: State<F>,
}

impl<F: Real> Plant<F> {
    pub fn new(setup: PlantSetup) -> Self {
        let inputs = collect(setup.inputs.iter().map(|_| F::ZERO));
        Self { setup, step: Step::Idle, missed: 0, inputs }
    }

    pub fn ask(&mut self, purpose: Purpose) {
        self.step = Step::Ask(purpose);
    }

    /// Drops what the app was asked for: the node has stopped.
    pub fn rest(&mut self) {
        self.step = Step::Idle;
    }

    pub fn is_idle(&self) -> bool {
        self.step == Step::Idle
    }

    /// Whether there is something to ask the app for.
    pub fn has_demand(&self) -> bool {
        matches!(self.step, Step::Ask(_) | Step::Tell)
    }

    /// What to ask the app for now: each once.
    pub fn demand(&mut self) -> Option<Demand> {
        let (demand, next) = match self.step {
            Step::Ask(purpose) => (Demand::Sample, Step::Await(purpose)),
            Step::Tell => (Demand::Actuate, Step::Idle),
            Step::Idle | Step::Await(_) => return None,
        };
        self.step = next;
        Some(demand)
    }

    /// Whether the app has been asked for a sample.
    pub fn awaits(&self) -> bool {
        matches!(self.step, Step::Await(_))
    }

    /// Takes up what has waited for the sample, with it or without.
    pub fn resume(&mut self) -> Option<Purpose> {
        let Step::Await(purpose) = self.step else { return None };
        self.step = Step::Idle;
        Some(purpose)
    }

    pub fn succeed(&mut self) {
        self.missed = 0;
    }

    /// Counts a sample that failed. Where the plant has been without one for too long: for how many samples.
    pub fn miss(&mut self) -> Option<u32> {
        self.missed = self.missed.saturating_add(1);
        (self.missed > self.setup.coast_ticks).then_some(self.missed)
    }

    /// What the actuator makes of the input `u` of `component` (both state units / s).
    pub fn apply(&mut self, component: usize, u: F) -> F {
        let u = self.setup.inputs.get(component).map_or(F::ZERO, |range| range.clamp(u));
        if let Some(slot) = self.inputs.get_mut(component) {
            *slot = u;
        }
        u
    }

    /// The inputs are there: the app is to be told.
    pub fn tell(&mut self) {
        self.step = Step::Tell;
    }

    /// Inputs of the last tick, state units / s, component by component.
    pub fn inputs(&self) -> &[F] {
        &self.inputs
    }
}
