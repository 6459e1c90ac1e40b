//! The outbox of a node: what waits for its link and its app, and in which order it goes.

use super::{Action, Node};
use crate::observe::Event;
use funnelnet_law::field::VectorField;
use funnelnet_law::gain::GainFunction;
use funnelnet_law::math::Real;
use funnelnet_protocol::message::{Component, Message, TickStamp};
use funnelnet_protocol::report::count;
use heapless::Deque;

/// Events that wait for the app at most; more are dropped, oldest first kept.
const EVENT_CAPACITY: usize = 8;

/// Messages and events that wait. Latest value wins: states that were not fetched before the next tick are
/// replaced.
#[derive(Clone, Debug)]
pub(super) struct Outbox {
    events: Deque<Event, EVENT_CAPACITY>,
    pub fault: Option<Message>,
    /// Components to send, by bit.
    states: u8,
    /// Edges that are still to be announced.
    edges_left: u8,
    /// Whether the next of them may be announced at this tick.
    announce: bool,
}

impl Outbox {
    pub fn new() -> Self {
        Self { events: Deque::new(), fault: None, states: 0, edges_left: 0, announce: false }
    }

    /// Whether nothing waits.
    #[inline]
    pub fn is_empty(&self) -> bool {
        self.states == 0 && !self.announce && self.fault.is_none() && self.events.is_empty()
    }

    /// Has so many edges announced from now on, one at each tick.
    pub fn introduce(&mut self, edges: u8) {
        self.edges_left = edges;
    }

    /// Has the state sent, all of its components.
    #[inline]
    pub fn send_state(&mut self, components: usize) {
        self.states = (0..components).fold(0, |bits, component| bits | 1 << component);
    }

    /// Has the next edge announced, where one is left.
    #[inline]
    pub fn send_edge(&mut self) {
        self.announce = self.edges_left != 0;
    }

    /// Empties it of what a node that has stopped does not send. A warning that waits is still true: why the
    /// node was restarted, for example.
    pub fn halt(&mut self) {
        (self.states, self.edges_left, self.announce) = (0, 0, false);
    }

    /// Queues an event for the app.
    #[cold]
    pub fn report(&mut self, event: Event) {
        // A full queue keeps the oldest events: they tell the cause.
        let _ = self.events.push_back(event);
    }

    /// Queues an event that happens once and must not be missing, unlike the others.
    pub fn report_surely(&mut self, event: Event) {
        if self.events.is_full() {
            let _ = self.events.pop_back();
        }
        self.report(event);
    }

    /// The next component of the state that is to be sent.
    #[inline]
    fn take_component(&mut self) -> Option<u8> {
        if self.states == 0 {
            return None;
        }
        let component = self.states.trailing_zeros() as u8;
        self.states &= self.states.wrapping_sub(1);
        Some(component)
    }

    /// Index of the next edge that is to be announced, last one first.
    #[inline]
    fn take_edge(&mut self) -> Option<u8> {
        if !core::mem::take(&mut self.announce) {
            return None;
        }
        self.edges_left = self.edges_left.checked_sub(1)?;
        Some(self.edges_left)
    }
}

impl<F: Real, V: VectorField<F>, G: GainFunction<F>> Node<F, V, G> {
    /// Takes what is to go out next: events, then messages.
    pub(super) fn next_outgoing(&mut self) -> Option<Action> {
        if let Some(event) = self.outbox.events.pop_front() {
            return Some(Action::Report(event));
        }
        let message = self.next_message()?;
        count(&mut self.counters.sent);
        Some(Action::Send(message))
    }

    /// Takes the next message for the link: a fault, then the components of the state, then an edge.
    fn next_message(&mut self) -> Option<Message> {
        if self.outbox.fault.is_some() {
            return self.outbox.fault.take();
        }
        match self.outbox.take_component() {
            Some(component) => self.state_message(component),
            None => self.edge_message(),
        }
    }

    fn edge_message(&mut self) -> Option<Message> {
        let index = self.outbox.take_edge()?;
        let (neighbour, weight) = self.neighbours.edge(usize::from(index))?;
        Some(Message::Edge { source: self.params.id, neighbour, weight: weight.to_f32() })
    }

    fn state_message(&self, component: u8) -> Option<Message> {
        Some(Message::State {
            source: self.params.id,
            component: Component::new(component)?,
            tick: TickStamp::full(self.clock.tick),
            x: self.parts.get(usize::from(component))?.x.to_f32(),
        })
    }
}
