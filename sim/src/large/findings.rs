//! What a run came to, in parts that are put together in the order of blocks.

use crate::extremes::larger;

/// End of a run where a node would have stopped.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Halt {
    /// Tick at which it would have.
    pub tick: u64,
    /// Index of the node; the first one where there are several.
    pub node: usize,
    /// Why, as a part of a sentence.
    pub why: &'static str,
}

/// Figures of a run so far. True ones are of the states of a tick, in f64, and the scenario's funnel; believed ones are of
/// what f32 nodes compute.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Findings {
    /// The largest true `|nu| / psi`; NaN where one was not a number.
    pub max_ratio: f64,
    /// Node-ticks with a true `|nu| >= psi`.
    pub breaches: u64,
    /// The first of them: tick, and index of the node.
    pub first_breach: Option<(u64, usize)>,
    /// Node-ticks that were judged.
    pub judged: u64,
    /// Node-ticks of nodes without a neighbour.
    pub uncoupled: u64,
    /// The largest `|nu| / psi` as nodes believe it.
    pub believed_ratio: f32,
    /// Node-ticks that a node believes to have spent outside its funnel.
    pub believed_breaches: u64,
    /// Node-ticks with the funnel at the floor of f32.
    pub floored: u64,
    /// Node-ticks at which the law asked for more than `coupling.u_max`.
    pub limited: u64,
    /// Node-ticks at which an actuator could not do what the law asked for.
    pub saturated: u64,
    /// The largest `|u|`, state units / s.
    pub max_input: f32,
    /// Lowest and highest state of the last tick, state units.
    pub last: (f32, f32),
    /// The largest `max x - min x` at any tick, state units.
    pub max_spread: f64,
    /// Where the run ended before its last tick.
    pub halt: Option<Halt>,
}

impl Findings {
    /// Distance of the lowest to the highest state of the last tick, state units.
    #[must_use]
    pub fn final_spread(&self) -> f64 {
        f64::from(self.last.1) - f64::from(self.last.0)
    }

    /// The largest distance of a state of the last tick to `value`, state units.
    #[must_use]
    pub fn distance(&self, value: f64) -> f64 {
        larger((f64::from(self.last.0) - value).abs(), (f64::from(self.last.1) - value).abs())
    }

    /// Adds what the next block has found over the same ticks.
    pub(super) fn add(&mut self, other: &Self) {
        self.max_ratio = larger(self.max_ratio, other.max_ratio);
        self.breaches += other.breaches;
        self.first_breach = match (self.first_breach, other.first_breach) {
            (Some(a), Some(b)) => Some(a.min(b)),
            (a, b) => a.or(b),
        };
        self.judged += other.judged;
        self.uncoupled += other.uncoupled;
        if other.believed_ratio > self.believed_ratio || other.believed_ratio.is_nan() {
            self.believed_ratio = other.believed_ratio;
        }
        self.believed_breaches += other.believed_breaches;
        self.floored += other.floored;
        self.limited += other.limited;
        self.saturated += other.saturated;
        self.max_input = self.max_input.max(other.max_input);
        self.halt = self.halt.take().or_else(|| other.halt.clone());
    }
}
