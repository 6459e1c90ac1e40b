//! Nodes whose states travel on CAN, with this program as one more participant of their bus.
//!
//! They hear each other without it. It says START and SYNC there, hears every state, and relays to and from nodes that are on serial
//! lines only. SYNC of a tick follows all states of that tick on the one bus, so every node has heard them before it: lockstep has the
//! bits of loopback here too (docs/notes/2026-11-24-real-nodes.md).

use super::{FrameBytes, Hub, HubError, HubNode, Received, SLICE};
use crate::can::{AnyFormat, CanPort, Heard, Traffic};
use funnel_protocol::message::{Message, NodeId};
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
    /// What is said and what is heard; two of them, since each may have begun something.
    saying: AnyFormat,
    hearing: AnyFormat,
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
    /// The bus on `interface`, open as `port`, for frames of CAN FD if `fd`.
    pub fn new(interface: String, port: CanPort, fd: bool) -> Self {
        Self {
            interface,
            port,
            saying: AnyFormat::new(fd),
            hearing: AnyFormat::new(fd),
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

    /// Says it now, or with what follows in the same frame.
    fn say(&mut self, message: &Message) -> Result<(), HubError> {
        let frames = self.saying.pack(message);
        self.port.send_all(&frames, ROOM).map_err(|error| self.failed(error))
    }

    /// Says what was begun.
    fn finish(&mut self) -> Result<(), HubError> {
        let last = self.saying.flush();
        self.port.send_all(last.as_slice(), ROOM).map_err(|error| self.failed(error))
    }

    /// What a frame from a serial line says to the nodes on CAN, if that is the host's to relay and was not said yet.
    fn take_for_relay(&mut self, frame: &FrameBytes) -> Option<Message> {
        if self.said.contains(frame) {
            return None;
        }
        let mut bytes = frame.clone();
        // Without its final zero, as this program has encoded it.
        bytes.pop();
        let Ok(Frame::RealTime(message)) = serial::decode(&mut bytes) else { return None };
        if self.heard.contains_key(&source(&message)?.get()) {
            return None;
        }
        self.said.push(frame.clone());
        Some(message)
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
        for message in heard.messages(&mut self.hearing) {
            match message {
                Ok(message) => self.sort_message(message, heard.at),
                Err(_) => self.counts.unreadable += 1,
            }
        }
    }

    fn sort_message(&mut self, message: Message, at: SystemTime) {
        let source = match (source(&message), &message) {
            (Some(source), _) => source.get(),
            (None, Message::Sync { source: Some(_), .. }) => return self.counts.strangers += 1,
            // Of this program.
            (None, _) => return,
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

    /// Relays frames from nodes on serial lines to those on CAN, each once.
    pub(super) fn relay_to_can(&mut self, frames: &[FrameBytes]) -> Result<(), HubError> {
        let Some(side) = &mut self.can else { return Ok(()) };
        let mut messages: Vec<_> = frames.iter().filter_map(|frame| side.take_for_relay(frame)).collect();
        messages.sort_by_key(place);
        messages.iter().try_for_each(|message| side.say(message))?;
        side.finish()
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

/// The node that says of itself what a message says; a command or a SYNC has none.
fn source(message: &Message) -> Option<NodeId> {
    match *message {
        Message::State { source, .. } | Message::Edge { source, .. } | Message::Fault { source, .. } => {
            Some(source)
        }
        Message::Ctrl { .. } | Message::Sync { .. } => None,
    }
}

/// Where a message belongs among those of a tick: the components of a state one after the other, since CAN FD has one frame for them.
fn place(message: &Message) -> Option<(NodeId, u8)> {
    match *message {
        Message::State { source, component, .. } => Some((source, component.get())),
        _ => None,
    }
}

fn is_fault(received: &Received) -> Option<Message> {
    match received {
        Received::Message(message @ Message::Fault { .. }) => Some(*message),
        _ => None,
    }
}
