//! Nodes whose states travel on CAN, with this program as one more participant of their bus.
//!
//! They hear each other without it. It says START and SYNC there, hears every state, and relays to and from nodes that are on serial
//! lines only. SYNC of a tick follows all states of that tick on the one bus, so every node has heard them before it: lockstep has the
//! bits of loopback here too (docs/notes/2026-11-24-real-nodes.md).

use super::{FrameBytes, Hub, HubError, HubNode, Received, SLICE};
use crate::can::{CanPort, Heard, Traffic};
use funnel_protocol::message::Message;
use funnel_protocol::serial::{self, Frame};
use std::collections::{BTreeMap, VecDeque};
use std::time::{Duration, Instant, SystemTime};

/// How long the host waits for room in its transmit queue: some 500 frames at the lowest bit rate.
const ROOM: Duration = Duration::from_secs(1);

/// What was heard on a bus, beside the frames that a run is made of.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct CanCounts {
    /// Data frames, with those of this program.
    pub frames: u64,
    /// Frames of nodes that are not of this run.
    pub strangers: u64,
    /// Frames that are none of the real-time plane.
    pub unreadable: u64,
    /// Errors that the controller reported, and the last of them.
    pub errors: (u64, Option<String>),
}

/// The bus as this program sees it.
pub struct CanSide {
    interface: String,
    port: CanPort,
    /// By source: nodes of this run on CAN.
    heard: BTreeMap<u8, VecDeque<(Message, SystemTime)>>,
    /// Nodes of this run on serial lines: what is heard from them was said by this program.
    relayed: Vec<u8>,
    /// Frames of this tick that were relayed to CAN: several receivers are one there.
    said: Vec<FrameBytes>,
    counts: CanCounts,
    /// What was heard and not [taken](Hub::take_heard) yet.
    log: Vec<Heard>,
}

impl CanSide {
    /// The bus on `interface`, open as `port`.
    pub fn new(interface: String, port: CanPort) -> Self {
        Self {
            interface,
            port,
            heard: BTreeMap::new(),
            relayed: Vec::new(),
            said: Vec::new(),
            counts: CanCounts::default(),
            log: Vec::new(),
        }
    }

    fn failed(&self, source: std::io::Error) -> HubError {
        HubError::Can { interface: self.interface.clone(), source }
    }

    fn say(&self, message: &Message) -> Result<(), HubError> {
        self.port.say(message, ROOM).map_err(|error| self.failed(error))
    }

    /// Takes everything that has come.
    fn listen(&mut self) -> Result<(), HubError> {
        while let Some(heard) = self.port.receive().map_err(|error| self.failed(error))? {
            self.sort(&heard);
            self.log.push(heard);
        }
        Ok(())
    }

    fn sort(&mut self, heard: &Heard) {
        match &heard.what {
            Traffic::Error { text, .. } => {
                self.counts.errors = (self.counts.errors.0 + 1, Some(text.clone()))
            }
            Traffic::Frame { .. } | Traffic::Other(_) => self.counts.frames += 1,
        }
        match heard.message() {
            Ok(message) => self.sort_message(message, heard.at),
            Err(Some(_)) => self.counts.unreadable += 1,
            Err(None) => {}
        }
    }

    fn sort_message(&mut self, message: Message, at: SystemTime) {
        let source = match message {
            Message::State { source, .. } | Message::Edge { source, .. } | Message::Fault { source, .. } => {
                source.get()
            }
            // Of this program.
            Message::Ctrl { .. } | Message::Sync { source: None, .. } => return,
            Message::Sync { .. } => return self.counts.strangers += 1,
        };
        match self.heard.get_mut(&source) {
            Some(queue) => queue.push_back((message, at)),
            None if self.relayed.contains(&source) => {}
            None => self.counts.strangers += 1,
        }
    }
}

impl Hub {
    /// With those nodes on this bus whose index `on_can` holds for.
    pub fn with_can(mut self, mut side: CanSide, on_can: impl Fn(usize) -> bool) -> Self {
        for (index, node) in self.nodes.iter_mut().enumerate() {
            node.on_can = on_can(index);
            match node.on_can {
                true => drop(side.heard.insert(node.link.id(), VecDeque::new())),
                false => side.relayed.push(node.link.id()),
            }
        }
        Self { can: Some(side), ..self }
    }

    /// Interface and counts, where there is a bus.
    pub fn can(&self) -> Option<(&str, &CanCounts)> {
        self.can.as_ref().map(|side| (side.interface.as_str(), &side.counts))
    }

    /// What was heard on CAN since the last call, in order.
    pub fn take_heard(&mut self) -> Vec<Heard> {
        self.can.as_mut().map_or_else(Vec::new, |side| std::mem::take(&mut side.log))
    }

    /// Says `message` once to all nodes on CAN; nothing where there are none that run.
    pub(super) fn say_on_can(&mut self, message: &Message) -> Result<(), HubError> {
        let runs = |node: &HubNode| node.on_can && node.away.is_none() && !node.stopped;
        match &mut self.can {
            Some(side) if self.nodes.iter().any(runs) => {
                side.said.clear();
                side.say(message)
            }
            _ => Ok(()),
        }
    }

    /// Relays a frame from a node on a serial line to those on CAN, once.
    pub(super) fn relay_to_can(&mut self, frame: &FrameBytes) -> Result<(), HubError> {
        let Some(side) = self.can.as_mut().filter(|side| !side.said.contains(frame)) else { return Ok(()) };
        let mut bytes = frame.clone();
        // Without its final zero, as this program has encoded it.
        bytes.pop();
        let Ok(Frame::RealTime(message)) = serial::decode(&mut bytes) else { return Ok(()) };
        let source = match message {
            Message::State { source, .. } | Message::Edge { source, .. } | Message::Fault { source, .. } => {
                source.get()
            }
            Message::Ctrl { .. } | Message::Sync { .. } => return Ok(()),
        };
        if side.heard.contains_key(&source) {
            return Ok(());
        }
        side.said.push(frame.clone());
        side.say(&message)
    }

    /// Waits for the next message of a node on CAN, or for the fault that it may say on its line instead; with its bus time.
    pub(super) fn wait_on_can(&mut self, index: usize) -> Result<(Message, SystemTime), HubError> {
        let begin = Instant::now();
        loop {
            let (Some(side), Some(node)) = (&mut self.can, self.nodes.get_mut(index)) else {
                return Err(HubError::Interrupted);
            };
            side.listen()?;
            let id = node.link.id();
            if let Some(message) = side.heard.get_mut(&id).and_then(VecDeque::pop_front) {
                return Ok(message);
            }
            if begin.elapsed() > self.patience.answer {
                let waited = self.patience.answer;
                return Err(HubError::NoAnswer { node: id, awaited: "state on CAN", waited });
            }
            side.port.wait(SLICE);
            side.listen()?;
            // A node that is gone says nothing on CAN; one that is off the bus says so here.
            if side.heard.get(&id).is_some_and(VecDeque::is_empty)
                && let Some(message) = node.link.look(is_fault)?
            {
                return Ok((message, SystemTime::now()));
            }
        }
    }

    /// Forgets what a node has said on CAN.
    pub(super) fn forget_heard(&mut self, index: usize) -> Result<(), HubError> {
        let (Some(side), Some(node)) = (&mut self.can, self.nodes.get(index)) else { return Ok(()) };
        side.listen()?;
        if let Some(queue) = side.heard.get_mut(&node.link.id()) {
            queue.clear();
        }
        Ok(())
    }
}

fn is_fault(received: &Received) -> Option<Message> {
    match received {
        Received::Message(message @ Message::Fault { .. }) => Some(*message),
        _ => None,
    }
}
