//! What nodes say, whoever has carried it: taken for what it is, refused and named where it cannot be so, and
//! put on the bus.

use super::line::DOUBLES;
use super::{Conductor, OTHER_COMPONENT, OTHER_TICK, Relayed};
use crate::engine::NodeEvent;
use funnelnet_node::Event;
use funnelnet_protocol::message::{Component, FaultCode, Message, Severity, TickStamp};
use funnelnet_protocol::serial;

/// How far the tick of a frame may lie from the one that is awaited: less than half of what the 8 bits on CAN
/// can tell.
const STAMP_REACH: u32 = 100;

impl Conductor {
    pub(super) fn take_message(&mut self, index: usize, message: Message, now: u64) {
        match message {
            Message::State { component, tick, x, .. } => {
                if !self.take_state(index, (tick, component, x), now) {
                    return;
                }
            }
            Message::Fault { code, severity, .. } => {
                if let Some(node) = self.nodes.get_mut(index).filter(|_| severity == Severity::Stopped) {
                    // Only these faults are the outcome of a tick, which the node has seen as any other.
                    node.ticked = matches!(
                        code,
                        FaultCode::STATE_LIMIT | FaultCode::FUNNEL_LEFT | FaultCode::NEIGHBOURS_LOST
                    );
                }
                self.note_fault(index, &message, now);
            }
            Message::Edge { neighbour, weight, .. } => self.check_weight(index, neighbour.get(), weight),
            Message::Ctrl { .. } | Message::Sync { .. } => return,
        }
        self.put_on_bus(index, message, now);
    }

    /// Takes a component of a state that is of the tick after the one that ends at `now`; whether it is.
    fn take_state(
        &mut self,
        index: usize,
        (stamp, component, x): (TickStamp, Component, f32),
        now: u64,
    ) -> bool {
        let since_start = self.since_start();
        let Some(node) = self.nodes.get_mut(index) else { return false };
        let (id, tick) = (node.contact.id(), self.tick);
        let due = now.checked_div(self.tick_ns).and_then(|due| u32::try_from(due).ok()).unwrap_or(0);
        if stamp.rebuild(due, 0, 0).is_none() {
            let value = || format!("the stamp {} where {due} was awaited", stamp.value());
            self.doubts.note(id, OTHER_TICK, tick, value);
            return false;
        }
        let Some(next) = node.next_state.get_mut(usize::from(component.get())) else {
            self.doubts.note(id, OTHER_COMPONENT, tick, || format!("state {}", component.get()));
            return false;
        };
        let bit = 1 << component.get();
        if node.states & bit != 0 {
            if next.to_bits() == x.to_bits() {
                // On CAN: a line has told its doubles apart.
                self.doubts.note(id, DOUBLES, tick, || "a state".to_owned());
                return false;
            }
            let value = format!("{next} and {x}");
            self.doubts.note(id, "sent two states of one tick", tick, || value);
        }
        *next = x;
        node.states |= bit;
        node.ticked = true;
        if let Some(stamps) = self.stamps.get_mut(index) {
            stamps.state = Some(since_start);
        }
        true
    }

    /// Compares a weight that a node announces with the one that it was given.
    pub(super) fn check_weight(&mut self, index: usize, neighbour: u8, weight: f32) {
        let Some(node) = self.nodes.get(index) else { return };
        let own = node.config.neighbours.iter().find(|edge| edge.id == neighbour).map(|edge| edge.weight);
        if own != Some(weight) {
            let value = || match own {
                Some(own) => format!("{weight} for the edge to node {neighbour}, which has {own}"),
                None => format!("{weight} for an edge to node {neighbour}, which is none"),
            };
            self.doubts.note(
                node.contact.id(),
                "announced another weight than it was given",
                self.tick,
                value,
            );
        }
    }

    /// The whole tick of a frame, if it is anywhere near what is awaited from the node.
    pub(super) fn rebuilt(&self, index: usize, stamp: TickStamp) -> Option<u32> {
        // What one that comes has told of before says nothing of where it begins: that is where the others are.
        let own = self.own.as_ref().filter(|_| !self.is_coming(index));
        let telling = own.map_or(self.tick, |own| own.telling(index));
        let awaited = telling.wrapping_add(1);
        stamp.rebuild(awaited, STAMP_REACH.min(awaited), STAMP_REACH)
    }

    /// Takes note of a FAULT: one that stopped the node, or a warning. A warning after a stop does not make
    /// it run again.
    pub(super) fn note_fault(&mut self, index: usize, fault: &Message, now: u64) {
        let Message::Fault { code, severity, arg, tick, .. } = *fault else { return };
        // It is no warning, and comes with a state.
        if code == FaultCode::STARTS_ANEW {
            return;
        }
        let Some(node) = self.nodes.get_mut(index) else { return };
        if code == FaultCode::COMMIT
            && let Some(commit) = &mut node.commit
        {
            commit.fail();
        }
        let event = match severity {
            Severity::Stopped if node.stopped => return,
            Severity::Stopped => {
                node.stopped = true;
                Event::Fault(code)
            }
            Severity::Notice | Severity::Warning => {
                let low = tick.value() & u32::from(u8::MAX);
                if node.warned.replace((code, arg, low)) == Some((code, arg, low)) {
                    return;
                }
                self.warnings += 1;
                Event::Warned(code)
            }
        };
        self.events.push(NodeEvent { at: now, node: index, event });
    }

    /// Takes note of the warnings among faults that came with something else.
    pub(super) fn note_warnings(&mut self, index: usize, faults: &[Message]) {
        let now = (u64::from(self.tick) + 1) * self.tick_ns;
        for fault in faults {
            if matches!(fault, Message::Fault { severity, .. } if *severity != Severity::Stopped) {
                self.note_fault(index, fault, now);
            }
        }
    }

    /// A stamp of eight bits, from CAN, would be taken for a whole one by who reads sixteen, so what is
    /// relayed has its whole tick.
    pub(super) fn put_on_bus(&mut self, index: usize, mut message: Message, now: u64) {
        if let Message::State { tick, .. } | Message::Fault { tick, .. } = &mut message {
            *tick = self.rebuilt(index, *tick).map_or(*tick, TickStamp::full);
        }
        let message = self.noise.disturb(index, message);
        let message = self.lie(index, message, now);
        self.send(index, &message, now);
    }

    /// Sends it as it is.
    pub(super) fn send(&mut self, index: usize, message: &Message, now: u64) {
        let is_state = matches!(message, Message::State { .. });
        self.bus.send(now, index, Relayed { from: index, is_state, bytes: serial::encode(message) });
    }

    /// Takes note of what lines have refused.
    pub(super) fn collect_doubts(&mut self) {
        for node in &mut self.nodes {
            let id = node.contact.id();
            for (what, value) in node.contact.take_doubts() {
                self.doubts.note(id, what, self.tick, || value);
            }
        }
    }
}
