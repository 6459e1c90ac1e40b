//! What one line gets of the values that change with every tick. What it is too slow for is replaced by what
//! is newer.

use funnelnet_protocol::message::Message;
use heapless::Vec;

/// A SYNC, eight components of the node's state, and edges, of which the node announces one per tick.
const ROOM: usize = 12;

/// Waiting frames, at most one of a kind, in the order in which their kinds came: a state that waits leaves
/// before a SYNC that came after it, so that it is not late for the tick, and none waits for ever.
#[derive(Debug, Default)]
pub struct LineQueue {
    frames: Vec<Message, ROOM>,
}

impl LineQueue {
    /// Nothing waits.
    pub const fn new() -> Self {
        Self { frames: Vec::new() }
    }

    /// Takes a frame; `false` where there is no room for it.
    pub fn put(&mut self, frame: Message) -> bool {
        match self.frames.iter_mut().find(|waits| is_replaced(waits, &frame)) {
            Some(older) => {
                *older = frame;
                true
            }
            None => self.frames.push(frame).is_ok(),
        }
    }

    /// The frame that the line gets next.
    pub fn take(&mut self) -> Option<Message> {
        if self.frames.is_empty() { None } else { Some(self.frames.remove(0)) }
    }

    /// Drops a SYNC that waits.
    pub fn drop_sync(&mut self) {
        self.frames.retain(|frame| !matches!(frame, Message::Sync { .. }));
    }
}

/// Whether a frame that waits is worth nothing once the newer one is there. An edge is announced once.
fn is_replaced(waits: &Message, newer: &Message) -> bool {
    match (waits, newer) {
        (Message::Sync { .. }, Message::Sync { .. }) => true,
        (Message::State { component, .. }, Message::State { component: newer, .. }) => component == newer,
        (Message::Edge { neighbour, .. }, Message::Edge { neighbour: newer, .. }) => neighbour == newer,
        _ => false,
    }
}
