//! Frames that wait for one serial line. What a line is too slow for is replaced by what is newer, and holds up nothing else.

use funnel_protocol::message::Message;
use heapless::{Deque, Vec};

/// Commands that wait at most: each of them counts, so none replaces another.
pub const COMMANDS: usize = 8;
/// Faults that wait at most: those of many nodes come at once where a host dies.
pub const FAULTS: usize = 16;
/// A SYNC, eight components of the node's state, an edge.
const LATEST: usize = 10;

/// Waiting frames: commands first, then faults, then the rest, each in the order in which they came.
#[derive(Debug, Default)]
pub struct Outbox {
    commands: Deque<Message, COMMANDS>,
    faults: Deque<Message, FAULTS>,
    /// Of SYNC, of each component and of the edges only the latest, in the place of the one before: a state that waits leaves before a SYNC
    /// that came after it, so that it is not late for the tick.
    latest: Vec<Message, LATEST>,
    /// Frames that had no room.
    dropped: u32,
}

impl Outbox {
    /// An empty one.
    pub const fn new() -> Self {
        Self { commands: Deque::new(), faults: Deque::new(), latest: Vec::new(), dropped: 0 }
    }

    /// Takes a frame.
    pub fn put(&mut self, message: Message) {
        let put = match message {
            Message::Ctrl { .. } => self.commands.push_back(message),
            Message::Fault { .. } => self.faults.push_back(message),
            _ => match self.latest.iter_mut().find(|each| is_replaced(each, &message)) {
                Some(older) => {
                    *older = message;
                    Ok(())
                }
                None => self.latest.push(message),
            },
        };
        if put.is_err() {
            self.dropped = self.dropped.saturating_add(1);
        }
    }

    /// The frame that the line gets next.
    pub fn take(&mut self) -> Option<Message> {
        let urgent = self.commands.pop_front().or_else(|| self.faults.pop_front());
        urgent.or_else(|| (!self.latest.is_empty()).then(|| self.latest.remove(0)))
    }

    /// Whether nothing waits.
    pub fn is_empty(&self) -> bool {
        self.commands.is_empty() && self.faults.is_empty() && self.latest.is_empty()
    }

    /// Commands and faults that had no room so far.
    pub fn dropped(&self) -> u32 {
        self.dropped
    }
}

/// Whether a frame that waits is worth nothing once the newer one is there.
fn is_replaced(waits: &Message, newer: &Message) -> bool {
    match (waits, newer) {
        (Message::Sync { .. }, Message::Sync { .. }) | (Message::Edge { .. }, Message::Edge { .. }) => true,
        (Message::State { component, .. }, Message::State { component: newer, .. }) => component == newer,
        _ => false,
    }
}
