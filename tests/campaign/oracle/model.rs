//! What a neighbour with limits makes of a liar, by the book's words alone: a second, small form of the rule.

use sim_host::scenario::{Lie, SafetySpec};

/// What f32 may round away of a state, state units.
const ROUNDING: f64 = 1e-4;

/// What was taken last, and how many were not since.
#[derive(Clone, Copy, Debug)]
pub(super) struct Listener {
    /// Tick and state.
    taken: (u64, f64),
    doubts: u32,
}

/// What becomes of a state.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Fate {
    /// It is taken, or not, and the edge stays.
    Goes,
    /// It costs the edge.
    Bars,
    /// It is so near to a limit that rounding or noise decides.
    Unknown,
}

impl Listener {
    /// One that has taken a state at a tick.
    pub(super) fn of(taken: (u64, f64)) -> Self {
        Self { taken, doubts: 0 }
    }

    /// Hears the state `x` of tick `k`; `tick_s` is a tick, and `room` what noise may add to a state.
    pub(super) fn hears(&mut self, (k, x): (u64, f64), safety: &SafetySpec, tick_s: f64, room: f64) -> Fate {
        let room = room + ROUNDING;
        let (at, last) = self.taken;
        let allowed = safety.heard_rate.map_or(f64::INFINITY, |rate| rate * tick_s * (k - at) as f64);
        let beyond = [(x - last).abs() - allowed, x.abs() - safety.heard_limit.unwrap_or(f64::INFINITY)];
        if beyond.iter().any(|beyond| beyond.abs() < 2.0 * room) {
            return Fate::Unknown;
        }
        if beyond.iter().all(|&beyond| beyond < 0.0) {
            (self.taken, self.doubts) = ((k, x), 0);
            return Fate::Goes;
        }
        self.doubts += 1;
        if safety.drop_after != 0 && self.doubts >= safety.drop_after.into() {
            Fate::Bars
        } else {
            Fate::Goes
        }
    }
}

/// What a liar says: `first` is its state when the lie began, `x` the one now, `t` the time since (s).
pub(super) fn said(lie: Lie, first: f64, x: f64, t: f64) -> f64 {
    match lie {
        Lie::Constant(value) => value,
        Lie::Ramp(slope) => first + slope * t,
        Lie::Offset(offset) => x + offset,
    }
}
