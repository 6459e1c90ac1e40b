//! Frames that wait for a CAN controller: of each identifier only the latest.

use crate::format::Frame;
use heapless::Vec;

/// Identifiers that one node sends: eight components of its state, a fault, an edge.
pub const CAPACITY: usize = 10;

/// What became of a frame that was put into the queue.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Put {
    /// It waits.
    Waits,
    /// It waits in the place of an older one with its identifier: the controller has not kept up.
    Replaced,
    /// No room: [`CAPACITY`] other identifiers wait. It is dropped.
    Dropped,
}

/// Waiting frames, at most one of each identifier, lowest identifier (highest priority) first.
#[derive(Debug, Default)]
pub struct TxQueue<F> {
    frames: Vec<F, CAPACITY>,
}

impl<F: Frame> TxQueue<F> {
    /// An empty one.
    pub const fn new() -> Self {
        Self { frames: Vec::new() }
    }

    /// Takes a frame; the latest of an identifier wins.
    pub fn put(&mut self, frame: F) -> Put {
        if let Some(older) = self.frames.iter_mut().find(|each| each.id() == frame.id()) {
            *older = frame;
            return Put::Replaced;
        }
        if self.frames.push(frame).is_err() {
            return Put::Dropped;
        }
        self.frames.sort_unstable_by_key(F::id);
        Put::Waits
    }

    /// The frame that the controller gets next; it stays until it is [taken](Self::taken).
    pub fn next(&self) -> Option<&F> {
        self.frames.first()
    }

    /// The controller has taken the [next](Self::next) frame.
    pub fn taken(&mut self) {
        if !self.frames.is_empty() {
            self.frames.remove(0);
        }
    }

    /// Drops everything.
    pub fn clear(&mut self) {
        self.frames.clear();
    }
}

#[cfg(test)]
mod tests {
    extern crate std;
    use super::*;
    use funnelnet_protocol::can::{CanFrame, decode, encode};
    use funnelnet_protocol::message::{Component, Message, NodeId, TickStamp};
    use std::vec::Vec;

    fn state(component: u8, tick: u32) -> CanFrame {
        encode(&Message::State {
            source: NodeId::new(5).unwrap(),
            component: Component::new(component).unwrap(),
            tick: TickStamp::full(tick),
            x: 1.5,
        })
    }

    fn drained(mut queue: TxQueue<CanFrame>) -> Vec<Message> {
        let mut messages = Vec::new();
        while let Some(frame) = queue.next() {
            messages.push(decode(frame.id(), frame.data()).unwrap());
            queue.taken();
        }
        messages
    }

    #[test]
    fn the_latest_value_of_an_identifier_wins() {
        let mut queue = TxQueue::new();
        assert_eq!(queue.put(state(0, 1)), Put::Waits);
        assert_eq!(queue.put(state(1, 1)), Put::Waits);
        assert_eq!(queue.put(state(0, 2)), Put::Replaced);
        let ticks: Vec<_> = drained(queue)
            .into_iter()
            .map(|message| match message {
                Message::State { component, tick, .. } => (component.get(), tick.value()),
                _ => unreachable!(),
            })
            .collect();
        assert_eq!(ticks, [(0, 2), (1, 1)]);
    }

    #[test]
    fn the_lowest_identifier_goes_first() {
        let mut queue = TxQueue::new();
        for component in [7, 0, 3] {
            queue.put(state(component, 1));
        }
        let fault = Message::Fault {
            source: NodeId::new(5).unwrap(),
            code: funnelnet_protocol::FaultCode::BUS_OFF,
            severity: funnelnet_protocol::Severity::Stopped,
            arg: 1,
            tick: TickStamp::low(9, 8),
        };
        queue.put(encode(&fault));
        assert_eq!(drained(queue).first(), Some(&fault));
    }

    #[test]
    fn what_has_no_room_is_dropped_and_nothing_else() {
        let mut queue = TxQueue::new();
        for id in 0..CAPACITY as u8 {
            let source = NodeId::new(id + 1).unwrap();
            let frame = encode(&Message::Sync {
                source: Some(source),
                previous_tick: TickStamp::low(0, 24),
                phase_us: 0,
            });
            assert_eq!(queue.put(frame), Put::Waits);
        }
        assert_eq!(queue.put(state(0, 1)), Put::Dropped);
        assert_eq!(drained(queue).len(), CAPACITY);
    }
}
