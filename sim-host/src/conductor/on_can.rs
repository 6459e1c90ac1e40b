//! Nodes whose states travel on CAN, with this program as one more participant of their buses.
//!
//! Those of one bus hear each other without it. It says START and SYNC on each, hears every state, and relays
//! to and from nodes that are on another bus or on serial lines only. SYNC of a tick follows all states of
//! that tick on the one bus, so every node has heard them before it: lockstep has the bits of loopback here
//! too (docs/notes/2026-11-24-real-nodes.md).

use super::deadline::Deadline;
use super::member::Member;
use super::task::{Action, Outside, Source};
use super::{Conductor, HubError, Received};
use crate::bus::links::{Payload, flip_bit};
use crate::can::{AnyFormat, Heard, PortFrame, Traffic};
use funnelnet_protocol::message::{FaultCode, Message, NodeId};
use funnelnet_protocol::serial::{self, Frame};
use std::collections::{BTreeMap, VecDeque};
use std::time::Duration;

/// How long a bus is listened to before a node's line is looked at.
const LISTEN: Duration = Duration::from_millis(50);

/// Bytes of a real-time frame on the wire.
pub type FrameBytes = heapless::Vec<u8, { serial::MAX_REAL_TIME_FRAME }>;

/// A frame on its way from node to node.
#[derive(Clone, Debug)]
pub struct Relayed {
    /// Index of the node that sent it.
    pub(super) from: usize,
    /// Whether it is a component of its state.
    pub(super) is_state: bool,
    pub(super) bytes: FrameBytes,
}

/// A bit that is wrong fails the check of the frame at its receiver.
impl Payload for Relayed {
    fn flip(&mut self, choose: impl FnOnce(usize) -> usize) {
        let at = choose(8 * self.bytes.len());
        flip_bit(&mut self.bytes, at);
    }
}

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
pub(super) struct Bus {
    /// As the outside knows it.
    index: usize,
    interface: String,
    /// What is said and what is heard; two of them, since each may have begun something.
    saying: AnyFormat,
    hearing: AnyFormat,
    /// By source: nodes of this run on this bus, with the bus times of what they said, ns.
    heard: BTreeMap<u8, VecDeque<(Message, u64)>>,
    /// Nodes of this run elsewhere: what is heard from them was said by this program.
    relayed: Vec<u8>,
    /// Components of a state.
    components: usize,
    /// By source: components of a state that is to be relayed in one frame and of which not all have come.
    incomplete: BTreeMap<u8, Vec<Message>>,
    counts: CanCounts,
    outside: Outside,
}

impl Bus {
    fn new(index: usize, interface: String, fd: bool, outside: &Outside) -> Self {
        Self {
            index,
            interface,
            saying: AnyFormat::new(fd),
            hearing: AnyFormat::new(fd),
            heard: BTreeMap::new(),
            relayed: Vec::new(),
            components: 1,
            incomplete: BTreeMap::new(),
            counts: CanCounts::default(),
            outside: outside.clone(),
        }
    }

    /// Says it now, or with what follows in the same frame.
    async fn say(&mut self, message: &Message) -> Result<(), HubError> {
        let frames = self.saying.pack(message);
        self.put(frames).await
    }

    async fn put(&self, frames: Vec<PortFrame>) -> Result<(), HubError> {
        if frames.is_empty() {
            return Ok(());
        }
        self.outside.act(Action::Say { bus: self.index, frames }).await
    }

    /// Says what a frame from elsewhere says, if that is the host's to relay.
    async fn relay(&mut self, frame: &FrameBytes) -> Result<(), HubError> {
        let mut bytes = frame.clone();
        // Without its final zero, as this program has encoded it.
        bytes.pop();
        let Ok(Frame::RealTime(message)) = serial::decode(&mut bytes) else { return Ok(()) };
        if source(&message).is_none_or(|source| self.heard.contains_key(&source.get())) {
            return Ok(());
        }
        for message in self.complete(message) {
            self.say(&message).await?;
        }
        let last = self.saying.flush();
        self.put(last.into_iter().collect()).await
    }

    /// What can be said with this message: in CAN FD a state waits for its last component, since a frame has
    /// all of them.
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

    /// The next message of a node on this bus that nobody has taken, with its bus time.
    fn next_of(&mut self, id: u8) -> Option<(Message, u64)> {
        self.take();
        self.heard.get_mut(&id)?.pop_front()
    }

    /// Takes everything that comes before `until`, or has come by now.
    async fn listen(&mut self, until: u64) -> Result<(), HubError> {
        self.outside.act(Action::Read { from: Source::Bus(self.index), until }).await?;
        self.take();
        Ok(())
    }

    /// Takes what the outside has read.
    fn take(&mut self) {
        while let Some((heard, at)) = self.outside.take_heard(self.index) {
            self.sort(&heard, at);
        }
    }

    fn sort(&mut self, heard: &Heard, at: u64) {
        match &heard.what {
            Traffic::Error { text, .. } => {
                self.counts.errors = (self.counts.errors.0 + 1, Some(text.clone()))
            }
            Traffic::Frame { .. } | Traffic::Other(_) => self.counts.frames += 1,
        }
        for message in heard.messages(&mut self.hearing) {
            match message {
                Ok(message) => self.sort_message(message, at),
                Err(_) => self.counts.unreadable += 1,
            }
        }
    }

    fn sort_message(&mut self, message: Message, at: u64) {
        let source = match (source(&message), message) {
            (Some(source), _) | (None, Message::Sync { source: Some(source), .. }) => source.get(),
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

impl Conductor {
    /// With these buses: interfaces, and whether their frames are those of CAN FD; `on_can` says which of
    /// them a node is on, both by index.
    #[must_use]
    pub fn with_can(
        mut self,
        interfaces: Vec<(String, bool)>,
        on_can: impl Fn(usize) -> Option<usize>,
    ) -> Self {
        let named = interfaces.into_iter().enumerate();
        self.can = named.map(|(index, (name, fd))| Bus::new(index, name, fd, &self.outside)).collect();
        for (index, node) in self.nodes.iter_mut().enumerate() {
            node.on_can = on_can(index);
            for (bus, side) in self.can.iter_mut().enumerate() {
                side.components = node.next_state.len();
                match node.on_can == Some(bus) {
                    true => drop(side.heard.insert(node.contact.id(), VecDeque::new())),
                    false => side.relayed.push(node.contact.id()),
                }
            }
        }
        self
    }

    /// Interface and counts of each bus.
    pub fn can(&self) -> impl Iterator<Item = (&str, &CanCounts)> {
        self.can.iter().map(|side| (side.interface.as_str(), &side.counts))
    }

    /// Says `message` once on each bus with nodes that run.
    pub(super) async fn say_on_can(&mut self, message: &Message) -> Result<(), HubError> {
        self.say_on_others(None, message).await
    }

    /// The same on each of these buses but `from`, by index.
    pub(super) async fn say_on_others(
        &mut self,
        from: Option<usize>,
        message: &Message,
    ) -> Result<(), HubError> {
        let nodes = &self.nodes;
        let runs = |bus| nodes.iter().any(|node| node.on_can == Some(bus) && node.is_here() && !node.stopped);
        let others = self.can.iter_mut().enumerate().filter(|&(bus, _)| Some(bus) != from && runs(bus));
        for (_, side) in others {
            side.say(message).await?;
        }
        Ok(())
    }

    /// Relays a frame from elsewhere to the nodes of a bus.
    pub(super) async fn relay_to_can(&mut self, bus: usize, frame: &FrameBytes) -> Result<(), HubError> {
        match self.can.get_mut(bus) {
            Some(side) => side.relay(frame).await,
            None => Ok(()),
        }
    }

    /// Takes everything that has come on any bus.
    pub(super) async fn listen_on_can(&mut self) -> Result<(), HubError> {
        let now = self.outside.now();
        for side in &mut self.can {
            side.listen(now).await?;
        }
        Ok(())
    }

    /// The next message of a node on CAN that nobody has taken, with its bus time, ns.
    pub(super) fn next_on_its_bus(&mut self, index: usize) -> Option<(Message, u64)> {
        let (node, side) = self.on_its_bus(index)?;
        side.next_of(node.contact.id())
    }

    /// A node, and the bus that it is on.
    fn on_its_bus(&mut self, index: usize) -> Option<(&mut Member, &mut Bus)> {
        let node = self.nodes.get_mut(index)?;
        let side = self.can.get_mut(node.on_can?)?;
        Some((node, side))
    }

    /// Waits for the next message of a node on CAN, or for the fault that it may say on its line instead;
    /// with its bus time, ns.
    pub(super) async fn wait_on_can(
        &mut self,
        index: usize,
        deadline: Deadline,
    ) -> Result<(Message, u64), HubError> {
        loop {
            let now = self.outside.now();
            let Some((node, side)) = self.on_its_bus(index) else { return Err(HubError::Interrupted) };
            side.listen(now).await?;
            let id = node.contact.id();
            if let Some(message) = side.next_of(id) {
                return Ok(message);
            }
            let now = side.outside.now();
            if deadline.is_over(now) {
                return Err(HubError::NoAnswer { node: id, awaited: "state on CAN", waited: deadline.limit });
            }
            side.listen(Deadline::after(LISTEN, now).until()).await?;
            // A node that is gone says nothing on CAN; one that is off the bus says so here.
            if side.heard.get(&id).is_some_and(VecDeque::is_empty)
                && let Some(message) = node.contact.look(is_fault).await?
            {
                return Ok((message, side.outside.now()));
            }
        }
    }

    /// Waits for the next message of a node on its bus, whatever it says on its line: the others there have
    /// heard it, too.
    pub(super) async fn wait_on_its_bus(
        &mut self,
        index: usize,
        (deadline, awaited): (Deadline, &'static str),
    ) -> Result<Message, HubError> {
        loop {
            if let Some((message, _)) = self.next_on_its_bus(index) {
                return Ok(message);
            }
            let now = self.outside.now();
            let Some((node, side)) = self.on_its_bus(index) else { return Err(HubError::Interrupted) };
            if deadline.is_over(now) {
                return Err(HubError::NoAnswer { node: node.contact.id(), awaited, waited: deadline.limit });
            }
            side.listen(Deadline::after(LISTEN, now).until()).await?;
        }
    }

    /// Forgets what a node has said on CAN.
    pub(super) async fn forget_heard(&mut self, index: usize) -> Result<(), HubError> {
        let now = self.outside.now();
        let Some((node, side)) = self.on_its_bus(index) else { return Ok(()) };
        side.listen(now).await?;
        if let Some(queue) = side.heard.get_mut(&node.contact.id()) {
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

/// A fault that a node on CAN may say on its line alone. That it starts anew is said right before a state, which is on its bus.
pub(super) fn is_fault(received: &Received) -> Option<Message> {
    match received {
        Received::Message(Message::Fault { code: FaultCode::STARTS_ANEW, .. }) => None,
        Received::Message(message @ Message::Fault { .. }) => Some(*message),
        _ => None,
    }
}
