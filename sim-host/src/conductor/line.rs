//! What comes from a node's serial line: bytes in, what the node has said out.

use super::doubles::Doubles;
use super::sound::Sound;
use funnelnet_protocol::Refusal;
use funnelnet_protocol::message::Message;
use funnelnet_protocol::serial::{Deframer, Frame, HOST};
use funnelnet_protocol::service::{Body, Reply};
use std::collections::VecDeque;

/// What the line of a node does on which a frame comes again, with nothing lost.
pub(super) const DOUBLES: &str = "has a line that doubles frames";

/// What a node said.
pub enum Received {
    /// Real-time plane.
    Message(Message),
    /// Service plane.
    Reply(Reply),
}

/// A node's serial line as a stream of frames.
pub struct Line {
    id: u8,
    deframer: Deframer,
    sound: Sound,
    received: VecDeque<Received>,
    /// Frames that could not be read, and why the last of them.
    refused: (u64, Option<Refusal>),
    /// The node has been given its id.
    has_its_id: bool,
    /// What it has said whole and cannot mean, and nobody has taken: what it did, and the value.
    doubts: Vec<(&'static str, String)>,
    doubles: Doubles,
}

impl Line {
    /// The line of node `id`.
    #[must_use]
    pub fn new(id: u8) -> Self {
        Self {
            id,
            deframer: Deframer::new(),
            sound: Sound::default(),
            received: VecDeque::new(),
            refused: (0, None),
            has_its_id: false,
            doubts: Vec::new(),
            doubles: Doubles::default(),
        }
    }

    /// Takes what was read of it.
    pub fn on_bytes(&mut self, bytes: &[u8]) {
        self.sound.hear(bytes);
        for &byte in bytes {
            // A frame that cannot be read is as good as none: whoever waits for it runs into the time limit.
            match self.deframer.push(byte).map(|frame| frame.and_then(received)) {
                Some(Ok((source, received))) => self.on_frame(source, received),
                Some(Err(reason)) => self.refuse(reason),
                None => {}
            }
        }
    }

    fn on_frame(&mut self, source: u8, received: Received) {
        // Passed on, and told by that one itself.
        if matches!(received, Received::Message(Message::Fault { .. })) && source != self.id {
            return;
        }
        if let Some(what) = self.doubles.of(&received) {
            self.doubts.push((DOUBLES, what.to_owned()));
            return;
        }
        match told(&received) {
            Some(what) if self.has_its_id && source != self.id => {
                self.doubts.push(("spoke as another node", format!("{what} of node {source}")));
            }
            _ => self.received.push_back(received),
        }
    }

    fn refuse(&mut self, reason: Refusal) {
        self.refused = (self.refused.0.saturating_add(1), Some(reason));
        // It has passed its checksum.
        if reason == Refusal::NotFinite {
            self.doubts.push(("sent what is not a number", "a state or a weight".to_owned()));
        }
    }

    /// Forgets what an old line to the same node has left.
    pub fn replace(&mut self) {
        self.deframer = Deframer::new();
        self.has_its_id = false;
        self.doubles = Doubles::default();
        self.received.clear();
    }

    /// From now on the node has its id: what another one says of itself is not taken from its line.
    pub fn expect_its_own(&mut self) {
        self.has_its_id = true;
        self.doubts.clear();
    }

    /// The node's id.
    #[must_use]
    pub fn id(&self) -> u8 {
        self.id
    }

    /// The oldest thing that the node has said and nobody has taken.
    pub fn pop(&mut self) -> Option<Received> {
        self.received.pop_front()
    }

    /// The same, without what `pick` does not take.
    pub fn pop_picked<T>(&mut self, mut pick: impl FnMut(Received) -> Option<T>) -> Option<T> {
        while let Some(received) = self.received.pop_front() {
            if let Some(picked) = pick(received) {
                return Some(picked);
            }
        }
        None
    }

    /// The first thing that `pick` picks; all of it stays.
    pub fn peek<T>(&self, pick: impl Fn(&Received) -> Option<T>) -> Option<T> {
        self.received.iter().find_map(pick)
    }

    /// Frames from the node that could not be read so far, and why the last of them.
    #[must_use]
    pub fn refused(&self) -> (u64, Option<Refusal>) {
        self.refused
    }

    /// What the line sounds like, where that is not a node.
    #[must_use]
    pub fn sound(&self) -> Option<String> {
        self.sound.words()
    }

    /// What the node has said whole and cannot mean, since the last call: what it did, and the value.
    pub fn take_doubts(&mut self) -> Vec<(&'static str, String)> {
        std::mem::take(&mut self.doubts)
    }
}

/// What a frame says, and the node that says so of itself.
fn received(frame: Frame<'_>) -> Result<(u8, Received), Refusal> {
    match frame {
        Frame::RealTime(message) => Ok((source(&message), Received::Message(message))),
        Frame::Service { kind, source, body } => {
            Reply::decode(kind, body).map(|reply| (source, Received::Reply(reply)))
        }
    }
}

fn source(message: &Message) -> u8 {
    match message {
        Message::State { source, .. } | Message::Edge { source, .. } | Message::Fault { source, .. } => {
            source.get()
        }
        Message::Ctrl { .. } | Message::Sync { .. } => HOST,
    }
}

/// What only the node behind a line can say there.
fn told(received: &Received) -> Option<&'static str> {
    match received {
        Received::Message(Message::State { .. }) => Some("a state"),
        Received::Message(Message::Edge { .. }) => Some("an edge"),
        Received::Reply(Reply::Telemetry(_)) => Some("telemetry"),
        Received::Reply(Reply::Report(_)) => Some("a report"),
        Received::Message(_) | Received::Reply(_) => None,
    }
}
