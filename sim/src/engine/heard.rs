//! Who was heard, by what the nodes of a simulated network know of each other at the end.

use super::Engine;
use crate::bus::Medium;
use crate::scenario::Graph;
use funnelnet_law::field::VectorField;
use funnelnet_node::neighbour::Presence;
use funnelnet_node::{Node, Phase};
use funnelnet_protocol::NodeId;

impl<M: Medium, V: VectorField<f32> + Clone> Engine<M, V> {
    /// Ids of nodes that no neighbour on `graph` has ever heard, and of nodes that were heard and that all
    /// their neighbours have lost at the end. Nodes that have stopped say nothing any more, as they should;
    /// but a stop does not make heard what never was. Nor does anybody hear over a link that an event keeps
    /// cut at the end, or a node that it keeps off.
    #[must_use]
    pub fn unheard_and_silent(&self, graph: &Graph) -> (Vec<u16>, Vec<u16>) {
        let (mut unheard, mut silent) = (Vec::new(), Vec::new());
        for (index, node) in self.nodes.iter().enumerate() {
            let id = node.id();
            let neighbours = graph.neighbours(index);
            let joined = neighbours.iter().filter(|&&(other, _)| self.are_joined(index, other));
            let listeners: Vec<&Node<f32, V>> =
                joined.filter_map(|&(other, _)| self.nodes.get(other)).collect();
            if listeners.is_empty() {
                continue;
            }
            let has_stopped = matches!(node.phase(), Phase::Faulted(_));
            if !listeners.iter().any(|listener| has_heard(listener, id)) {
                unheard.push(id.get().into());
            } else if !has_stopped && !listeners.iter().any(|listener| hears(listener, id)) {
                silent.push(id.get().into());
            }
        }
        (unheard, silent)
    }
}

/// Who is barred is heard, and not believed.
fn hears<V: VectorField<f32>>(listener: &Node<f32, V>, id: NodeId) -> bool {
    listener.neighbour_presence(id) == Some(Presence::Known) || listener.neighbour_is_barred(id) == Some(true)
}

fn has_heard<V: VectorField<f32>>(listener: &Node<f32, V>, id: NodeId) -> bool {
    listener.neighbour_was_heard(id) == Some(true)
}
