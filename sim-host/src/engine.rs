//! The loopback engine: f32 nodes, a bus, and integer time. Every state travels as the bytes of a CAN frame.
//!
//! At equal times nodes tick before frames are delivered, so that the order of ids has no influence.

use crate::bus::Medium;
use crate::bus::ideal::{IdealBus, Traffic};
use crate::noise::Noise;
use crate::presence::Presence;
use funnelnet_node::{Action, Event, Node, Observation};
use funnelnet_protocol::can::{self, CanFrame};
use funnelnet_protocol::message::{Command, Message, Target};
use funnelnet_protocol::refusal::Refusal;

/// An event of a node, with the node's index and the engine's time (ns).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct NodeEvent {
    /// Time since the start, ns.
    pub at: u64,
    /// Index of the node.
    pub node: usize,
    /// The event.
    pub event: Event,
}

/// A node that waits for a message.
const NEVER: u64 = u64::MAX;

/// Nodes on a bus, an ideal one if no other is said.
pub struct Engine<M = IdealBus<CanFrame>> {
    nodes: Vec<Node>,
    bus: M,
    noise: Noise,
    /// Time at which each node wants to be polled, ns; `NEVER` if not. A scan of at most 127 entries beats a heap (measured).
    wakes: Vec<u64>,
    /// Node by node, and the components of each in order.
    observations: Vec<Observation<f32>>,
    events: Vec<NodeEvent>,
}

impl<M: Medium> Engine<M> {
    /// Nodes that are ready to start, all with as many components; `bus` must know as many nodes.
    pub fn new(nodes: Vec<Node>, bus: M) -> Self {
        let observations = nodes.iter().flat_map(|node| node.observations().iter().copied()).collect();
        let noise = Noise::default();
        Self { wakes: vec![NEVER; nodes.len()], observations, events: Vec::new(), nodes, bus, noise }
    }

    /// With noise on the states that nodes send.
    pub fn with_noise(self, noise: Noise) -> Self {
        Self { noise, ..self }
    }

    /// Starts all nodes at time 0.
    pub fn start(&mut self) {
        let start = Message::Ctrl { target: Target::All, command: Command::Start, arg: 0, at_tick: 0 };
        for index in 0..self.nodes.len() {
            receive(&mut self.nodes, index, Ok(start), 0);
            self.poll(index, 0);
        }
    }

    /// Runs until all nodes that are due at the next tick instant have ticked, and gives what they saw, by index and
    /// then by component. `None` when nothing is left to do.
    ///
    /// A node that has stopped keeps its last observation.
    pub fn advance(&mut self) -> Option<&[Observation<f32>]> {
        let now = self.wakes.iter().copied().min().filter(|&at| at != NEVER)?;
        self.deliver_before(now);
        for index in 0..self.nodes.len() {
            if self.wakes.get(index) == Some(&now) {
                self.poll(index, now);
            }
        }
        Some(&self.observations)
    }

    /// Observations of the nodes at their last tick, by index and then by component.
    pub fn observations(&self) -> &[Observation<f32>] {
        &self.observations
    }

    /// Presence of each node at tick `k`, at which all were due last, by index.
    pub fn presence(&self, k: u64) -> Vec<Presence> {
        let components = self.nodes.first().map_or(1, Node::components);
        let of = |seen: &[Observation<f32>]| match seen.first() {
            Some(seen) if u64::from(seen.tick) == k => Presence::Ran,
            // Its state is what it stopped with.
            _ => Presence::Stopped,
        };
        self.observations.chunks(components).map(of).collect()
    }

    /// The nodes, by index.
    pub fn nodes(&self) -> &[Node] {
        &self.nodes
    }

    /// Events that the nodes reported so far.
    pub fn events(&self) -> &[NodeEvent] {
        &self.events
    }

    /// Part of the time so far for which the bus was busy.
    pub fn utilisation(&self) -> f64 {
        self.bus.utilisation()
    }

    /// Frame counts so far.
    pub fn traffic(&self) -> Traffic {
        self.bus.traffic()
    }

    fn deliver_before(&mut self, now: u64) {
        while let Some(at) = self.bus.next_arrival().filter(|&at| at < now) {
            let nodes = &mut self.nodes;
            self.bus.deliver(|receiver, heard| receive(nodes, receiver, heard, at));
        }
    }

    fn poll(&mut self, index: usize, now: u64) {
        let Some(node) = self.nodes.get_mut(index) else { return };
        while let Some(action) = node.poll(now) {
            match action {
                Action::Send(message) => {
                    let message = self.noise.disturb(index, message);
                    self.bus.send(now, index, can::encode(&message));
                }
                Action::Report(event) => self.events.push(NodeEvent { at: now, node: index, event }),
                // Virtual nodes: nothing to drive, nothing to measure.
                Action::Safe | Action::Sample | Action::Actuate => {}
            }
        }
        // All nodes have as many components.
        let first = index * node.components();
        let slots = self.observations.iter_mut().skip(first);
        slots.zip(node.observations()).for_each(|(slot, &seen)| *slot = seen);
        if let Some(wake) = self.wakes.get_mut(index) {
            *wake = node.poll_at().unwrap_or(NEVER);
        }
    }
}

/// Hands a node what its link has heard, or counts that it could not be read.
fn receive(nodes: &mut [Node], index: usize, heard: Result<Message, Refusal>, now: u64) {
    let Some(node) = nodes.get_mut(index) else { return };
    match heard {
        // The node counts what it refuses; nothing else is to be done about it here.
        Ok(message) => drop(node.on_message(&message, now)),
        Err(reason) => node.refuse(reason),
    }
}
