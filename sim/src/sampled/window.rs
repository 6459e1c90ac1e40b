//! A part of the run that the scenario expects something of.

use super::member::Member;

use crate::extremes::{extremes, larger};
use crate::scenario::Window;

/// What the law does there.
#[derive(Clone, Debug)]
pub(crate) struct Watched {
    from_tick: u64,
    to_tick: u64,
    /// The largest `|nu| / psi`.
    pub ratio: f64,
    /// The largest `max x - min x` of a component (state units).
    pub spread: f64,
    /// The largest `|u|` (state units / s).
    pub input: f64,
    /// Time (s), lowest and highest state of each tick, where an emergent error is expected of a scalar
    /// state.
    pub reach: Vec<(f64, f64, f64)>,
    wants_reach: bool,
}

impl Watched {
    pub fn new(window: &Window) -> Self {
        Self {
            from_tick: window.from_tick,
            to_tick: window.to_tick,
            ratio: 0.0,
            spread: 0.0,
            input: 0.0,
            reach: Vec::new(),
            wants_reach: window.emergent_error.is_some(),
        }
    }

    pub fn is_open(&self, k: u64) -> bool {
        (self.from_tick..=self.to_tick).contains(&k)
    }

    /// Takes a tick at `t` (s) with its largest ratio.
    pub(super) fn note(&mut self, t: f64, ratio: f64, members: &[Member<'_>]) {
        self.ratio = larger(self.ratio, ratio);
        let components = members.first().map_or(0, |member| member.parts.len());
        for component in 0..components {
            let (low, high) = extremes(members.iter().map(|member| member.parts[component].x));
            self.spread = larger(self.spread, high - low);
            if self.wants_reach && components == 1 {
                self.reach.push((t, low, high));
            }
        }
    }
}
