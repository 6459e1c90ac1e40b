//! What an event says beside its kind, its targets and its time.

use crate::scenario::Loss;

/// What an event says beside its kind, its targets and its time.
#[derive(Clone, Debug, Default, PartialEq)]
pub enum Detail {
    /// Its kind says all.
    #[default]
    None,
    /// What becomes of a clock.
    Clock(ClockChange),
    /// How frames get lost, beside what the bus and its links lose.
    Loss(Loss),
    /// Probability that a receiver reads a bit of a frame wrong.
    Corrupt(f64),
    /// Disturbed bits among a billion.
    BitErrors(u32),
    /// The 11-bit identifier of what a node sends without end.
    Babble(u16),
    /// What a node says in place of its state.
    Lie(Lie),
    /// What it says in the name of another node.
    Impostor {
        /// Index of the other node.
        name: usize,
        /// What is said.
        lie: Lie,
    },
    /// How old the states are that a node says once more, ns.
    Age(u64),
    /// What a node measures in place of its state.
    Sensor(SensorFault),
    /// What an actuator does in place of the input.
    Actuator(ActuatorFault),
    /// What nodes are configured with from then on.
    Set(NewValue),
}

/// A value that a key of the scenario gets while the network runs.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct NewValue {
    /// The full key, such as `coupling.funnel.end`.
    pub key: String,
    /// The value as written, shortened.
    pub value: String,
    /// The value, all of it in one line of TOML.
    pub toml: String,
    /// Place of the event among those of the file, from 0.
    pub place: usize,
}

/// How a sensor fails; of each component alike.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum SensorFault {
    /// It gives another value, as [`Lie`] has it: `Ramp(0.0)` is a sensor that is stuck.
    Gives(Lie),
    /// It is noisy: standard deviation of Gaussian noise (state units).
    Noise(f64),
    /// It gives no value, with this probability at each sample.
    Loss(f64),
    /// It gives what was so long ago, ns.
    Age(u64),
}

/// How an actuator fails; of each component alike.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum ActuatorFault {
    /// It does this part of the input, from 0 to below 1.
    Part(f64),
    /// It can do no more than this, in both directions (state units / s).
    Limit(f64),
    /// It does always the same (state units / s).
    Constant(f64),
    /// It does what it did when the event began, and that much more each second (state units / s^2).
    Ramp(f64),
}

impl ActuatorFault {
    /// What it does for the input `u` after the time `t` (s), where it did `first` at the begin (state units / s).
    #[must_use]
    pub fn of(self, first: f32, u: f32, t: f64) -> f32 {
        match self {
            Self::Part(part) => (f64::from(u) * part) as f32,
            Self::Limit(limit) => u.clamp(-limit as f32, limit as f32),
            Self::Constant(value) => value as f32,
            Self::Ramp(slope) => (f64::from(first) + slope * t) as f32,
        }
    }
}

/// What becomes of a clock at an event.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct ClockChange {
    /// How far it jumps, ns.
    pub by_ns: i64,
    /// How much too fast it is from then on, parts in a billion; none where that stays.
    pub drift_ppb: Option<i64>,
}

/// A state that is not the one that a node has; of each component alike.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Lie {
    /// Always the same (state units).
    Constant(f64),
    /// From its state when the event begins, that much more each second (state units / s).
    Ramp(f64),
    /// Its state, and so much more (state units).
    Offset(f64),
}

impl Lie {
    /// What is said after the time `t` (s) by a node whose state was `first` at the begin and is `x` now (state units).
    #[must_use]
    pub fn of(self, first: f32, x: f32, t: f64) -> f32 {
        match self {
            Self::Constant(value) => value as f32,
            Self::Ramp(slope) => (f64::from(first) + slope * t) as f32,
            Self::Offset(offset) => (f64::from(x) + offset) as f32,
        }
    }
}
