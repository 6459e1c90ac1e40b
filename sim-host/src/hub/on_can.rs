//! Nodes whose states travel on CAN, with this program as one more participant of their buses.
//!
//! Those of one bus hear each other without it. It says START and SYNC on each, hears every state, and relays to and from nodes that are on
//! another bus or on serial lines only. SYNC of a tick follows all states of that tick on the one bus, so every node has heard them before it: lockstep has the
//! bits of loopback here too (docs/notes/2026-11-24-real-nodes.md).

use super::{Deadline, FrameBytes, Hub, HubError, HubNode, Received, SLICE};
use crate::can::{AnyFormat, CanPort, Heard, Traffic};
use funnelnet_protocol::message::{Message, NodeId};
use funnelnet_protocol::serial::{self, Frame};
use std::collections::{BTreeMap, VecDeque};
use std::io;
use std::sync::Arc;
use std::time::{Duration, SystemTime};

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
    /// States that were not relayed in a frame of CAN FD, since a component of them was lost on its way here.
    pub incomplete: u64,
    /// Errors that the controller reported, and the last of them.
    pub errors: (u64, Option<String>),
}

/// A bus as this program sees it.
pub struct CanSide {
    interface: String,
    port: Arc<CanPort>,
    /// What is said and what is heard; two of them, since each may have begun something.
    saying: AnyFormat,
    hearing: AnyFormat,
    /// By source: nodes of this run on this bus.
    heard: BTreeMap<u8, VecDeque<(Message, SystemTime)>>,
    /// Nodes of this run elsewhere: what is heard from them was said by this program.
    relayed: Vec<u8>,
    /// Components of a state.
    components: usize,
    /// By source: components of a state that is to be relayed in one frame and of which not all have come.
    incomplete: BTreeMap<u8, Vec<Message>>,
    counts: CanCounts,
    /// What was heard and not [taken](Hub::take_heard) yet.
    log: Vec<Heard>,
}

impl CanSide {
    /// The bus on `interface`, open as `port`, for frames of CAN FD if `fd`.
    pub fn new(interface: String, port: CanPort, fd: bool) -> Self {
        Self {
            interface,
            port: Arc::new(port),
            saying: AnyFormat::new(fd),
            hearing: AnyFormat::new(fd),
            heard: BTreeMap::new(),
            relayed: Vec::new(),
            components: 1,
            incomplete: BTreeMap::new(),
            counts: CanCounts::default(),
            log: Vec::new(),
        }
    }

    fn failed(&self, source: io::Error) -> HubError {
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

    /// Says what a frame from elsewhere says, if that is the host's to relay.
    fn relay(&mut self, frame: &FrameBytes) -> Result<(), HubError> {
        let mut bytes = frame.clone();
        // Without its final zero, as this program has encoded it.
        bytes.pop();
        let Ok(Frame::RealTime(message)) = serial::decode(&mut bytes) else { return Ok(()) };
        if source(&message).is_none_or(|source| self.heard.contains_key(&source.get())) {
            return Ok(());
        }
        let complete = self.complete(message);
        complete.iter().try_for_each(|message| self.say(message))?;
        self.finish()
    }

    /// What can be said with this message: in CAN FD a state waits for its last component, since a frame has all of them.
    fn complete(&mut self, message: Message) -> Vec<Message> {
        let (AnyFormat::Fd(_), Message::State { source, tick, .. }) = (&self.saying, message) else {
            return vec![message];
        };
        let state = self.incomplete.entry(source.get()).or_default();
        // A component of the tick before was lost on its way, and with it the frame.
        if state
            .first()
            .is_some_and(|first| matches!(*first, Message::State { tick: first, .. } if first != tick))
        {
            state.clear();
            self.counts.incomplete += 1;
        }
        state.push(message);
        if state.len() < self.components {
            return Vec::new();
        }
        // Whatever was delayed.
        state.sort_by_key(component);
        std::mem::take(state)
    }

    /// The port, for a thread that listens.
    pub(super) fn port(&self) -> Arc<CanPort> {
        Arc::clone(&self.port)
    }

    /// Takes what a thread has heard.
    pub(super) fn take(&mut self, heard: io::Result<Heard>) -> Result<(), HubError> {
        let heard = heard.map_err(|error| self.failed(error))?;
        self.sort(&heard);
        self.log.push(heard);
        Ok(())
    }

    /// The next message of a node on this bus that nobody has taken, with its bus time.
    fn next_of(&mut self, id: u8) -> Option<(Message, SystemTime)> {
        self.heard.get_mut(&id)?.pop_front()
    }

    /// Takes everything that has come.
    fn listen(&mut self) -> Result<(), HubError> {
        while let Some(heard) = self.port.receive().transpose() {
            self.take(heard)?;
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
    /// With these buses; `on_can` says which of them a node is on, both by index.
    pub fn with_can(mut self, mut sides: Vec<CanSide>, on_can: impl Fn(usize) -> Option<usize>) -> Self {
        for (index, node) in self.nodes.iter_mut().enumerate() {
            node.on_can = on_can(index);
            for (bus, side) in sides.iter_mut().enumerate() {
                side.components = node.next_state.len();
                match node.on_can == Some(bus) {
                    true => drop(side.heard.insert(node.link.id(), VecDeque::new())),
                    false => side.relayed.push(node.link.id()),
                }
            }
        }
        Self { can: sides, ..self }
    }

    /// Interface and counts of each bus.
    pub fn can(&self) -> impl Iterator<Item = (&str, &CanCounts)> {
        self.can.iter().map(|side| (side.interface.as_str(), &side.counts))
    }

    /// What was heard on CAN since the last call, with the index of the bus; in order of bus time, those of one bus in the order in which they came.
    pub fn take_heard(&mut self) -> Vec<(usize, Heard)> {
        let logs = self.can.iter_mut().map(|side| std::mem::take(&mut side.log));
        let mut heard: Vec<_> =
            logs.enumerate().flat_map(|(bus, log)| log.into_iter().map(move |heard| (bus, heard))).collect();
        if self.can.len() > 1 {
            heard.sort_by_key(|(_, heard)| heard.at);
        }
        heard
    }

    /// Says `message` once on each bus with nodes that run.
    pub(super) fn say_on_can(&mut self, message: &Message) -> Result<(), HubError> {
        let nodes = &self.nodes;
        let runs =
            |bus| nodes.iter().any(|node| node.on_can == Some(bus) && node.away.is_none() && !node.stopped);
        let mut sides = self.can.iter_mut().enumerate().filter(|&(bus, _)| runs(bus));
        sides.try_for_each(|(_, side)| side.say(message))
    }

    /// Relays a frame from elsewhere to the nodes of a bus.
    pub(super) fn relay_to_can(&mut self, bus: usize, frame: &FrameBytes) -> Result<(), HubError> {
        self.can.get_mut(bus).map_or(Ok(()), |side| side.relay(frame))
    }

    /// Takes everything that has come on any bus.
    pub(super) fn listen_on_can(&mut self) -> Result<(), HubError> {
        self.can.iter_mut().try_for_each(CanSide::listen)
    }

    /// The next message of a node on CAN that nobody has taken, with its bus time.
    pub(super) fn next_on_its_bus(&mut self, index: usize) -> Option<(Message, SystemTime)> {
        let (node, side) = self.on_its_bus(index)?;
        side.next_of(node.link.id())
    }

    /// A node, and the bus that it is on.
    fn on_its_bus(&mut self, index: usize) -> Option<(&mut HubNode, &mut CanSide)> {
        let node = self.nodes.get_mut(index)?;
        let side = self.can.get_mut(node.on_can?)?;
        Some((node, side))
    }

    /// Waits for the next message of a node on CAN, or for the fault that it may say on its line instead; with its bus time.
    pub(super) fn wait_on_can(
        &mut self,
        index: usize,
        deadline: Deadline,
    ) -> Result<(Message, SystemTime), HubError> {
        loop {
            let Some((node, side)) = self.on_its_bus(index) else { return Err(HubError::Interrupted) };
            side.listen()?;
            let id = node.link.id();
            if let Some(message) = side.next_of(id) {
                return Ok(message);
            }
            if deadline.is_over() {
                return Err(HubError::NoAnswer { node: id, awaited: "state on CAN", waited: deadline.limit });
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
        let Some((node, side)) = self.on_its_bus(index) else { return Ok(()) };
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

/// The component that a state is of.
fn component(message: &Message) -> Option<u8> {
    match *message {
        Message::State { component, .. } => Some(component.get()),
        _ => None,
    }
}

fn is_fault(received: &Received) -> Option<Message> {
    match received {
        Received::Message(message @ Message::Fault { .. }) => Some(*message),
        _ => None,
    }
}
