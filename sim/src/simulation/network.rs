//! What a simulation drives: nodes on any of the simulated buses, or the one loop of weakly-centralised
//! coupling.

use crate::bus::Medium;
use crate::central::Central;
use crate::engine::{Engine, NodeEvent};
use crate::presence::Presence;
use crate::scenario::Graph;
use funnelnet_law::field::VectorField;
use funnelnet_node::Observation;
use funnelnet_protocol::report::Report;

/// Nodes that tick together.
pub(super) trait Network {
    fn start(&mut self);
    fn advance(&mut self);
    fn observations(&self) -> &[Observation<f32>];
    /// States that the nodes have now, ahead of what they observed at the last tick, by index and then by
    /// component.
    fn states(&self) -> Vec<f64>;
    fn presence(&self, k: u64) -> Vec<Presence>;
    /// Indices of nodes that have missed what they should have adopted.
    fn missed(&self) -> &[usize];
    fn take_events(&mut self) -> Vec<NodeEvent>;
    /// What the nodes report, by index; none for one that is off.
    fn reports(&self) -> Vec<Option<Report>>;
    /// Ids of nodes that nobody has ever heard, and of those that all have lost.
    fn unheard_and_silent(&self, graph: &Graph) -> (Vec<u16>, Vec<u16>);
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

    fn states(&self) -> Vec<f64> {
        self.nodes().iter().flat_map(|node| node.state()).map(f64::from).collect()
    }

    fn presence(&self, k: u64) -> Vec<Presence> {
        Self::presence(self, k)
    }

    fn missed(&self) -> &[usize] {
        Self::missed(self)
    }

    fn take_events(&mut self) -> Vec<NodeEvent> {
        Self::take_events(self)
    }

    fn reports(&self) -> Vec<Option<Report>> {
        Self::reports(self)
    }

    fn unheard_and_silent(&self, graph: &Graph) -> (Vec<u16>, Vec<u16>) {
        Self::unheard_and_silent(self, graph)
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

    /// Its fields are those of the scenario, which nobody is told of.
    fn states(&self) -> Vec<f64> {
        Vec::new()
    }

    fn presence(&self, _: u64) -> Vec<Presence> {
        Self::presence(self)
    }

    /// It has no events.
    fn missed(&self) -> &[usize] {
        &[]
    }

    fn take_events(&mut self) -> Vec<NodeEvent> {
        Self::take_events(self)
    }

    fn reports(&self) -> Vec<Option<Report>> {
        Self::reports(self).into_iter().map(Some).collect()
    }

    /// It has no bus.
    fn unheard_and_silent(&self, _: &Graph) -> (Vec<u16>, Vec<u16>) {
        (Vec::new(), Vec::new())
    }
}
