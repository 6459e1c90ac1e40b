//! What a simulation drives: nodes on any of the simulated buses, or the one loop of weakly-centralised coupling.

use crate::bus::Medium;
use crate::central::Central;
use crate::engine::{Engine, NodeEvent};
use crate::presence::Presence;
use funnelnet_law::field::VectorField;
use funnelnet_node::Observation;

/// Nodes that tick together.
pub(super) trait Network {
    fn start(&mut self);
    fn advance(&mut self);
    fn observations(&self) -> &[Observation<f32>];
    fn presence(&self, k: u64) -> Vec<Presence>;
    fn take_events(&mut self) -> Vec<NodeEvent>;
}

impl<M: Medium, V: VectorField<f32> + Clone> Network for Engine<M, V> {
    fn start(&mut self) {
        Self::start(self);
    }

    fn advance(&mut self) {
        // `None` where all nodes have stopped by themselves: what they saw last stays.
        let _ = Self::advance(self);
    }

    fn observations(&self) -> &[Observation<f32>] {
        Self::observations(self)
    }

    fn presence(&self, k: u64) -> Vec<Presence> {
        Self::presence(self, k)
    }

    fn take_events(&mut self) -> Vec<NodeEvent> {
        Self::take_events(self)
    }
}

impl Network for Central {
    fn start(&mut self) {}

    fn advance(&mut self) {
        Self::advance(self);
    }

    fn observations(&self) -> &[Observation<f32>] {
        Self::observations(self)
    }

    fn presence(&self, _: u64) -> Vec<Presence> {
        Self::presence(self)
    }

    fn take_events(&mut self) -> Vec<NodeEvent> {
        Self::take_events(self)
    }
}
