//! What happens between two ticks of the network, where the law decides once in a round of several ticks
//! (law.md 5).
//!
//! Inputs are held there and nobody hears anybody, so the states follow from those at the round and the
//! nodes' own fields. The law does not see them; rows and verdicts do.

use crate::presence::Presence;
use crate::scenario::{Dynamics, Scenario};
use funnelnet_node::Observation;

/// A round that has begun.
pub(super) struct Round {
    /// Its number.
    pub k: u64,
    /// What the nodes saw at its beginning, by index and then by component. States go on from there; the rest
    /// is held.
    pub seen: Vec<Observation<f32>>,
    /// The states without the rounding of f32, state units.
    x: Vec<f64>,
    /// By index.
    pub presence: Vec<Presence>,
}

impl Round {
    pub fn new(k: u64, seen: &[Observation<f32>], presence: &[Presence]) -> Self {
        let x = seen.iter().map(|seen| f64::from(seen.x)).collect();
        Self { k, seen: seen.to_vec(), x, presence: presence.to_vec() }
    }

    /// Takes it that these are at the end of the round. Who has stopped in it has stayed where it was; events
    /// come between two rounds.
    pub fn ends_with(&mut self, presence: &[Presence]) {
        for (before, after) in self.presence.iter_mut().zip(presence) {
            if (*before, *after) == (Presence::Ran, Presence::Stopped) {
                *before = Presence::Stopped;
            }
        }
    }

    /// Goes on by the tick number `part` of the round, from 0.
    pub fn step(&mut self, scenario: &Scenario, part: u8) {
        let (from, to) = (scenario.time.part_at_s(self.k, part), scenario.time.part_at_s(self.k, part + 1));
        let components = scenario.components();
        let nodes = (0..).map_while(|index| scenario.field_at(index, self.k)).zip(&self.presence);
        let states = self.x.chunks_mut(components).zip(self.seen.chunks_mut(components));
        for ((field, presence), (x, seen)) in nodes.zip(states) {
            if *presence == Presence::Ran {
                step(field, (from, to - from), x, seen);
                x.iter().zip(seen).for_each(|(x, seen)| seen.x = *x as f32);
            }
        }
    }
}

/// The midpoint step of a node, with its inputs held.
fn step(field: &Dynamics, (t, tick): (f64, f64), x: &mut [f64], seen: &[Observation<f32>]) {
    let rate = |component: usize, t: f64, x: &[f64]| {
        let held = seen.get(component).map_or(0.0, |seen| f64::from(seen.u));
        field.component(component, t, x) + held
    };
    let ahead = |x: &[f64], part: f64, t: f64, at: &[f64]| -> Vec<f64> {
        x.iter().enumerate().map(|(component, x)| x + part * tick * rate(component, t, at)).collect()
    };
    let middle = ahead(x, 0.5, t, x);
    let end = ahead(x, 1.0, t + 0.5 * tick, &middle);
    x.copy_from_slice(&end);
}
