//! Events of a scenario, as this program makes them: it cuts links and lies where it relays, tells a node to leave, takes
//! its power away and gives it back (docs/book/src/faults.md).
//!
//! They happen in the order of the loopback engine, so that lockstep has its bits with events, too: before
//! the tick at their time, after what arrives until then.

use super::deadline::Deadline;
use super::shadow::Shadow;
use super::{Conductor, HubError, Received, STOP};
use crate::engine::{Lies, NOTHING, NodeEvent, Scene};
use crate::scenario::Change;
use funnelnet_node::Event;
use funnelnet_protocol::message::{Command, FaultCode, JOIN, Message, NodeId, Severity, Target};
use funnelnet_protocol::serial;

/// What a node says later than its own states, and not by itself.
pub(super) struct Later {
    /// ns.
    at: u64,
    /// Index of the node.
    node: usize,
    messages: Vec<Message>,
}

impl Conductor {
    /// With events that take nodes and links away and bring them back, and with nodes that say what is not so.
    #[must_use]
    pub fn with_events(mut self, scene: Option<Scene>, lies: Option<Box<Lies>>) -> Self {
        if let Some(scene) = &scene {
            self.bus.set_listeners(scene.listeners());
        }
        (self.scene, self.lies) = (scene, lies);
        self
    }

    /// Does what comes before the start: nodes that are absent at first are off.
    pub(super) async fn begin_events(&mut self) -> Result<(), HubError> {
        for index in 0..self.nodes.len() {
            if !self.is_on(index) {
                self.take_power(index).await?;
                self.forget(index);
                if let Some(own) = &mut self.own {
                    own.recording.leave(index);
                }
            }
        }
        self.happen(0).await
    }

    /// Does what events do up to `now`, each at its time.
    pub(super) async fn happen(&mut self, now: u64) -> Result<(), HubError> {
        while let Some(at) = self.next_change().filter(|&at| at <= now) {
            self.deliver_before(at).await?;
            while let Some(change) = self.scene.as_mut().and_then(|scene| scene.take_change(at)) {
                self.change(change, at).await?;
            }
            if let Some(scene) = &self.scene {
                self.bus.set_listeners(scene.listeners());
            }
        }
        Ok(())
    }

    /// Time of the next change, ns.
    pub(super) fn next_change(&self) -> Option<u64> {
        self.scene.as_ref().and_then(Scene::next_change)
    }

    /// Whether no event keeps a node off, by index.
    pub fn is_on(&self, index: usize) -> bool {
        self.scene.as_ref().is_none_or(|scene| scene.is_on(index))
    }

    /// Whether an event has brought a node during the run, by index.
    pub(super) fn has_come(&self, index: usize) -> bool {
        self.scene.as_ref().is_some_and(|scene| scene.has_come(index))
    }

    /// Whether two nodes are on and no event has cut their link, by index.
    pub(super) fn are_joined(&self, a: usize, b: usize) -> bool {
        self.scene.as_ref().is_none_or(|scene| scene.are_joined(a, b))
    }

    async fn change(&mut self, change: Change, at: u64) -> Result<(), HubError> {
        if self.own.is_some() {
            return self.change_own(change, at).await;
        }
        let done = match change {
            Change::Off { node, told } => self.take_off(node, told, at).await.map_err(|error| (node, error)),
            Change::On { node } => self.bring(node, at).await.map_err(|error| (node, error)),
            Change::Cut(..) | Change::Mend(..) => Ok(()),
        };
        if let Some(scene) = &mut self.scene {
            scene.make(change);
        }
        match (change, done) {
            (Change::Off { node, .. }, Ok(())) => self.forget(node),
            (Change::Off { .. }, Err((node, error))) => {
                self.lose(node, error).await?;
                // From here on it is the event that keeps it off.
                self.end_absence(node);
                self.forget(node);
            }
            (_, Err((node, error))) => {
                if let Some(node) = self.nodes.get_mut(node) {
                    node.off = false;
                }
                self.lose(node, error).await?;
            }
            _ => {}
        }
        Ok(())
    }

    /// Takes a node off, whose goodbye the others hear where it is told.
    async fn take_off(&mut self, index: usize, told: bool, at: u64) -> Result<(), HubError> {
        if self.nodes.get(index).is_some_and(|node| node.away.is_some()) {
            // It was lost before.
            self.end_absence(index);
            return Ok(());
        }
        if told { self.say_goodbye(index, at).await } else { self.take_power(index).await }
    }

    /// Tells a node to leave, and puts its goodbye on the bus.
    async fn say_goodbye(&mut self, index: usize, at: u64) -> Result<(), HubError> {
        // Before the start nobody is there to be told.
        let says_so = at > 0 || self.has_come(index);
        let deadline = Deadline::after(self.patience.answer, self.outside.now());
        let Some(node) = self.nodes.get_mut(index) else { return Ok(()) };
        // That node alone: so it knows that the others go on without it.
        let target = target(node.contact.id());
        let stop = Message::Ctrl { target, command: Command::Stop, arg: 0, at_tick: 0 };
        node.contact.queue(&serial::encode(&stop));
        node.contact.flush().await?;
        if node.stopped || !says_so {
            return Ok(());
        }
        loop {
            let Some(node) = self.nodes.get_mut(index) else { return Ok(()) };
            let fault = match node.on_can {
                // There its neighbours have heard it before the next SYNC.
                Some(_) => self.wait_on_its_bus(index, (deadline, "goodbye on CAN")).await?,
                None => node.contact.wait_until(deadline, "goodbye", fault).await?,
            };
            let Message::Fault { code, severity, .. } = fault else { continue };
            if code == FaultCode::LEAVES {
                self.events.push(NodeEvent { at, node: index, event: Event::Stopped });
                self.put_on_bus(index, fault, at);
                return Ok(());
            }
            self.note_fault(index, &fault, at);
            self.put_on_bus(index, fault, at);
            if severity == Severity::Stopped {
                return Ok(());
            }
        }
    }

    /// Takes the power of a node away, without a word of its own. Where this program does not have its power,
    /// it tells the node to stop as if all did: then it says nothing, and its memory goes with the next configuration.
    pub(super) async fn take_power(&mut self, index: usize) -> Result<(), HubError> {
        let Some(node) = self.nodes.get_mut(index) else { return Ok(()) };
        node.contact.drop_queued();
        if self.outside.switch(index, false).await? {
            node.contact.forget();
            return Ok(());
        }
        node.contact.write(&serial::encode(&STOP)).await?;
        if node.on_can.is_some() && self.own.is_none() {
            // As when it comes: it is not to run the next tick, which begins on its bus.
            node.ask_again_who_it_is(self.patience.answer).await?;
        }
        Ok(())
    }

    /// Brings a node that is off: its stored configuration, and a start that says that the others run.
    async fn bring(&mut self, index: usize, at: u64) -> Result<(), HubError> {
        let patience = self.patience;
        self.forget_heard(index).await?;
        let Some(node) = self.nodes.get_mut(index) else { return Ok(()) };
        if self.outside.switch(index, true).await? {
            node.contact.forget();
            node.identify(patience.boot).await?;
        } else {
            // A line that was lost meanwhile may be back.
            node.contact.reopen().await?;
        }
        let config = node.config.clone();
        node.configure(&config, patience.answer).await?;
        let target = target(config.id);
        let start = Message::Ctrl { target, command: Command::Start, arg: 0, at_tick: JOIN };
        node.contact.write(&serial::encode(&start)).await?;
        if let Some(commit) = node.commit.as_ref().filter(|commit| commit.is_lost()) {
            // As in loopback it refuses a commit (`phase`): by now it knows no tick, so that it does so also where its
            // storage still has what this program could not take from it.
            node.contact.write(&serial::encode(&commit.message())).await?;
        }
        if node.on_can.is_some() {
            // SYNC comes on its bus, and its line may be slower. Its answer says that it has had all of that before.
            node.ask_again_who_it_is(patience.answer).await?;
        }
        node.begin_anew();
        self.hearing.forget(index);
        if node.listens_first() {
            node.shadow = Shadow::of(&config);
            node.listens = true;
            return Ok(());
        }
        // It announces itself at once, and nobody needs to know.
        let deadline = Deadline::after(patience.answer, self.outside.now());
        for _ in &config.initial_state {
            let Some(node) = self.nodes.get_mut(index) else { return Ok(()) };
            let state = match node.on_can {
                Some(_) => self.wait_on_its_bus(index, (deadline, "state on CAN")).await?,
                None => node.contact.wait_until(deadline, "state", state).await?,
            };
            self.put_on_bus(index, state, at);
        }
        Ok(())
    }

    /// Forgets what was known of a node that is off now.
    pub(super) fn forget(&mut self, index: usize) {
        self.later.retain(|later| later.node != index);
        let Some(node) = self.nodes.get_mut(index) else { return };
        (node.off, node.was_off) = (true, true);
        node.lose_staged();
        (node.listens, node.shadow) = (false, None);
        let components = node.next_state.len();
        self.observations
            .iter_mut()
            .skip(index * components)
            .take(components)
            .for_each(|seen| *seen = NOTHING);
    }

    /// What node `index` says in place of a message; what it says beside that goes later.
    pub(super) fn lie(&mut self, index: usize, message: Message, now: u64) -> Message {
        let Some(lies) = &mut self.lies else { return message };
        let (said, messages) = lies.tell(index, now, message);
        if !messages.is_empty() {
            let at = now.saturating_add(lies.later_ns());
            let place = self.later.partition_point(|before| before.at <= at);
            self.later.insert(place, Later { at, node: index, messages });
        }
        said
    }

    /// When somebody says something later, ns.
    pub(super) fn next_later(&self) -> Option<u64> {
        self.later.front().map(|later| later.at)
    }

    /// Puts what is said next of that on the bus.
    pub(super) fn say_later(&mut self) {
        let Some(Later { at, node, messages }) = self.later.pop_front() else { return };
        messages.iter().for_each(|message| self.send(node, message, at));
    }
}

/// That node alone.
pub(super) fn target(id: u8) -> Target {
    NodeId::new(id).map_or(Target::All, Target::Node)
}

fn fault(received: Received) -> Option<Message> {
    match received {
        Received::Message(message @ Message::Fault { .. }) => Some(message),
        _ => None,
    }
}

fn state(received: Received) -> Option<Message> {
    match received {
        Received::Message(message @ Message::State { .. }) => Some(message),
        _ => None,
    }
}
