//! Who was heard, by what the nodes of a simulated network know of each other at the end.

use crate::bus::Medium;
use crate::engine::Engine;
use crate::engine::SimNode;
use crate::scenario::Scenario;
use funnelnet_node::Phase;
use funnelnet_node::neighbour::Presence;
use funnelnet_protocol::NodeId;

/// Ids of nodes that no neighbour has ever heard, and of nodes that were heard and that all their neighbours have lost at the end. Nodes
/// that have stopped say nothing any more, as they should, and have a check of their own; but a stop does not make heard what never was. Nor does anybody hear over a link that an event keeps cut
/// at the end, or a node that it keeps off.
pub(super) fn unheard_and_silent<M: Medium>(scenario: &Scenario, engine: &Engine<M>) -> (Vec<u16>, Vec<u16>) {
    let (mut unheard, mut silent) = (Vec::new(), Vec::new());
    for (index, node) in engine.nodes().iter().enumerate() {
        let id = node.id();
        let neighbours = scenario.graph.neighbours(index);
        let joined = neighbours.iter().filter(|&&(other, _)| engine.are_joined(index, other));
        let listeners: Vec<&SimNode> = joined.filter_map(|&(other, _)| engine.nodes().get(other)).collect();
        if listeners.is_empty() {
            continue;
        }
        let has_stopped = matches!(node.phase(), Phase::Faulted(_));
        if !listeners.iter().any(|listener| has_heard(listener, id)) {
            unheard.push(id.get().into());
        } else if !has_stopped
            && !listeners.iter().any(|listener| listener.neighbour_presence(id) == Some(Presence::Known))
        {
            silent.push(id.get().into());
        }
    }
    (unheard, silent)
}

fn has_heard(listener: &SimNode, id: NodeId) -> bool {
    listener.neighbour_was_heard(id) == Some(true)
}
