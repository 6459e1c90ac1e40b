//! A node and its host: identity, configuration, telemetry, report. Frames and time in, outputs out.
//!
//! Firmware wraps a link around it; tests drive it in memory.

mod keep;

pub use keep::Task;

use crate::feeding::Progress;
use crate::model::{Configured, Model};
use crate::node::{Action, Node};
use crate::observe::{Event, Phase};
use crate::params::Params;
use funnelnet_protocol::NodeConfig;
use funnelnet_protocol::config::ConfigError;
use funnelnet_protocol::message::{Command, FaultCode, Message};
use funnelnet_protocol::refusal::Refusal;
use funnelnet_protocol::report::{Counters, Report, Telemetry};
use funnelnet_protocol::serial::{Frame, HOST};
use funnelnet_protocol::service::{Identity, Reply, Request, ResetCause, StageError, StoreError};
use keep::{Keep, Staged};

/// What the firmware shall do next.
#[derive(Clone, Debug, PartialEq)]
pub enum Output {
    /// Put this frame of the real-time plane on the link.
    Send(Message),
    /// Put this frame of the service plane on the link.
    Reply(Reply),
    /// Log this event.
    Report(Event),
    /// Put the actuator in its safe position: the program has started, or the node has stopped, whatever the reason.
    Safe,
    /// Measure the plant, and answer by [`Session::measured`] or [`Session::sample_failed`]: a tick waits for it.
    Sample,
    /// Drive the actuator with [`Session::inputs`].
    Actuate,
    /// Do [`Session::task`] with the storage, and say how that went by [`Session::performed`].
    Keep,
}

/// A node that may still be blank.
#[derive(Debug)]
pub struct Session<M: Model = Configured> {
    identity: Identity,
    model: M,
    node: Option<Node<f32, M::Field>>,
    /// What the node was made of.
    config: Option<NodeConfig>,
    /// For a configuration on its way to the storage or from there.
    room: Option<NodeConfig>,
    staged: Option<Staged>,
    /// Counters of a blank node.
    counters: Counters,
    telemetry_every: u32,
    /// Tick after the last one that telemetry was considered for, and how many components of it have been told.
    reported: (u32, u8),
    reply: Option<Reply>,
    keep: Option<Keep>,
    /// What the app has been asked to do with its storage.
    performing: Option<Keep>,
    /// The kind of a request that came before the one before it was answered, until that is said.
    refused: Option<u8>,
    /// Argument of the FAULT that says why the node was gone, until it has an id to say it with.
    confession: Option<u16>,
    /// The app is to be told that the actuator belongs in its safe position.
    safe: bool,
    /// Time of the outputs that are being given, ns, from the first one to the `None` that ends them.
    giving: Option<u64>,
}

impl Session {
    /// A blank node that will be what its configuration describes.
    pub fn new(identity: Identity) -> Self {
        Self::with_model(identity, Configured)
    }
}

impl<M: Model> Session<M> {
    /// A blank node that will have the field and the plant of `model`.
    pub fn with_model(identity: Identity, model: M) -> Self {
        let counters = Counters::default();
        Self {
            identity,
            model,
            node: None,
            config: None,
            room: None,
            staged: None,
            counters,
            telemetry_every: 0,
            reported: (0, 0),
            reply: None,
            keep: None,
            performing: None,
            refused: None,
            confession: confession(identity.reset),
            safe: true,
            giving: None,
        }
    }

    /// Where a stored configuration is read to before [`Session::restore`]: in place, since each copy of one is 2 KiB of stack.
    pub fn room(&mut self) -> &mut Option<NodeConfig> {
        &mut self.room
    }

    /// Makes a node of the stored configuration in the [room](Session::room), as a CONFIGURE would.
    ///
    /// # Errors
    /// As for CONFIGURE; `Malformed` where there is none. The session stays as it was.
    pub fn restore(&mut self) -> Result<(), ConfigError> {
        self.configure()
    }

    /// The configuration of the node; `None` while blank.
    pub fn config(&self) -> Option<&NodeConfig> {
        self.config.as_ref()
    }

    /// The node, once it is configured.
    pub fn node(&self) -> Option<&Node<f32, M::Field>> {
        self.node.as_ref()
    }

    /// What [`Output::Actuate`] is about, state units / s, component by component; empty without a plant.
    pub fn inputs(&self) -> &[f32] {
        self.node.as_ref().map_or(&[], Node::inputs)
    }

    /// Answers [`Output::Sample`], as [`Node::measured`] does.
    pub fn measured(&mut self, x: &[f32]) {
        if let Some(node) = self.node.as_mut() {
            node.measured(x);
        }
    }

    /// Answers [`Output::Sample`], as [`Node::sample_failed`] does.
    pub fn sample_failed(&mut self) {
        if let Some(node) = self.node.as_mut() {
            node.sample_failed();
        }
    }

    /// Own id, 0 while blank: the source of its frames.
    pub fn id(&self) -> u8 {
        self.node.as_ref().map_or(HOST, |node| node.id().get())
    }

    /// What its node has done and waits for, for the watchdog; a blank one waits.
    pub fn progress(&self) -> Progress {
        self.node.as_ref().map_or_else(Progress::default, Node::progress)
    }

    /// When [`Session::poll`] has something to do next, ns on the caller's clock; `None`: not before a frame.
    pub fn poll_at(&self) -> Option<u64> {
        let waits = self.safe || self.reply.is_some() || self.keep.is_some() || self.refused.is_some();
        if waits { Some(0) } else { self.node.as_ref()?.poll_at() }
    }

    /// Takes what the link received at `now` (ns). What is refused is counted and changes nothing.
    pub fn on_frame(&mut self, frame: Result<Frame<'_>, Refusal>, now: u64) {
        let outcome = match frame {
            Ok(Frame::RealTime(message)) => return self.on_message(&message, now),
            Ok(Frame::Service { kind, body, .. }) => self.on_request(kind, body),
            Err(reason) => Err(reason),
        };
        if let Err(reason) = outcome {
            self.refuse(reason);
        }
    }

    /// The platform cannot go on for the node: its link is gone, for example. The node stops, with a safe output.
    pub fn fail(&mut self, code: FaultCode, arg: u16) {
        if let Some(node) = self.node.as_mut() {
            node.fail(code, arg);
        }
    }

    /// Does what is due at `now` (ns) and gives the next output; call it until it gives `None`. Bounded as `Node::poll`.
    ///
    /// From the first output to that `None` time stands still, so that it comes, and the app gets back to its link and its watchdog, also
    /// where the outputs take longer than a tick.
    pub fn poll(&mut self, now: u64) -> Option<Output> {
        let now = *self.giving.get_or_insert(now);
        let output = self.next_output(now);
        if output.is_none() {
            self.giving = None;
        }
        output
    }

    fn next_output(&mut self, now: u64) -> Option<Output> {
        if self.take_safe() {
            return Some(Output::Safe);
        }
        if let Some(reply) = self.reply.take() {
            return Some(Output::Reply(reply));
        }
        if self.keep.is_some() {
            self.performing = self.keep.take();
            return Some(Output::Keep);
        }
        // After the answer to the one before, since a host takes answers in order.
        if self.performing.is_none()
            && let Some(reply) = self.refused.take().and_then(Reply::busy)
        {
            return Some(Output::Reply(reply));
        }
        let node = self.node.as_mut()?;
        match node.poll(now) {
            Some(Action::Send(message)) => Some(Output::Send(message)),
            Some(Action::Report(event)) => Some(Output::Report(event)),
            Some(Action::Safe) => Some(Output::Safe),
            Some(Action::Sample) => Some(Output::Sample),
            Some(Action::Actuate) => Some(Output::Actuate),
            None => match self.telemetry() {
                Some(telemetry) => Some(Output::Reply(Reply::Telemetry(telemetry))),
                None => self.take_commit().then_some(Output::Keep),
            },
        }
    }

    /// Whether the actuator belongs in its safe position from now on; told once. It comes before any reply, which may take a while.
    fn take_safe(&mut self) -> bool {
        let stopped = self.node.as_mut().is_some_and(Node::take_stop);
        core::mem::take(&mut self.safe) || stopped
    }

    fn on_message(&mut self, message: &Message, now: u64) {
        if let Message::Ctrl { target, command: Command::Commit, at_tick, .. } = *message {
            return self.on_commit(target, at_tick);
        }
        match self.node.as_mut() {
            // The node counts what it refuses.
            Some(node) => drop(node.on_message(message, now)),
            None => self.counters.refuse(Refusal::Phase),
        }
    }

    fn on_request(&mut self, kind: u8, body: &[u8]) -> Result<(), Refusal> {
        let request = Request::split(kind, body)?;
        let only_asks = matches!(request, Request::Hello | Request::Report);
        if self.is_busy_for(only_asks) {
            self.refused = self.refused.or((!only_asks).then_some(kind));
            return Err(Refusal::Phase);
        }
        let reply = match request {
            Request::Hello => Reply::Identity(Identity { id: self.id(), ..self.identity }),
            Request::Stage(bytes) => {
                match self.read(bytes).map_err(StageError::Config).and_then(|()| self.may_stage()) {
                    Ok(()) => return self.keep(Keep::Stage),
                    Err(reason) => Reply::Staged(Err(reason)),
                }
            }
            Request::Key(_) if self.is_running() => Reply::Keyed(Err(StoreError::Running)),
            Request::Key(key) => return self.keep(Keep::Key(key)),
            Request::Report => Reply::Report(self.report()),
            Request::Configure(bytes) => Reply::Configured(self.read(bytes).and_then(|()| self.configure())),
            Request::Store => match self.may_store() {
                Ok(()) => return self.keep(Keep::Store),
                Err(reason) => Reply::Stored(Err(reason)),
            },
            Request::Erase if self.is_running() => Reply::Erased(Err(StoreError::Running)),
            Request::Erase => return self.keep(Keep::Erase),
        };
        self.reply = Some(reply);
        Ok(())
    }

    /// Whether another request has to be answered first. One that comes meanwhile must not touch what that one is about: the room, the
    /// configuration, the place of its answer.
    fn is_busy_for(&self, only_asks: bool) -> bool {
        let keeps = self.keep.is_some() && !only_asks;
        self.reply.is_some() || self.performing.is_some() || keeps
    }

    /// Reads a configuration into the room: in place, since each copy of it is 2 KiB of stack. One that cannot be read is counted, and
    /// answered all the same, so that no host waits for nothing.
    fn read(&mut self, bytes: &[u8]) -> Result<(), ConfigError> {
        self.room.insert(NodeConfig::empty()).read(bytes).map_err(|_| {
            self.room = None;
            self.refuse(Refusal::Value);
            ConfigError::Malformed
        })
    }

    fn is_running(&self) -> bool {
        self.node.as_ref().is_some_and(|node| node.phase() == Phase::Running)
    }

    /// Makes a node of what is in the room, which is empty then.
    fn configure(&mut self) -> Result<(), ConfigError> {
        let made = if self.is_running() { Err(ConfigError::Running) } else { self.make_node() };
        self.room = None;
        made
    }

    // Not into its callers, which would have room on their stacks for this and for what else they do.
    #[inline(never)]
    fn make_node(&mut self) -> Result<(), ConfigError> {
        let config = self.room.as_ref().ok_or(ConfigError::Malformed)?;
        let params = Params::of_model(config, &self.model)?;
        // The old one may have stopped just now.
        let stopped = self.node.as_mut().is_some_and(Node::take_stop);
        self.safe |= stopped;
        let node = self.node.insert(Node::alone(params));
        node.meet(&config.neighbours);
        if let Some(arg) = self.confession.take() {
            node.warn(FaultCode::PANIC, arg);
        }
        self.reported = (0, 0);
        self.settle();
        Ok(())
    }

    /// What is in the room is what the node is now.
    fn settle(&mut self) {
        core::mem::swap(&mut self.config, &mut self.room);
        if let Some(config) = &self.config {
            self.telemetry_every = config.telemetry_every;
            self.identity.checksum = config.checksum();
        }
    }

    fn report(&self) -> Report {
        match &self.node {
            Some(node) => node.report(),
            None => Report { max_ratio: 0.0, counters: self.counters.clone() },
        }
    }

    /// Telemetry of the last tick, once per tick and component, where the configuration asks for it.
    fn telemetry(&mut self) -> Option<Telemetry> {
        let node = self.node.as_ref()?;
        let (tick, told) = self.reported;
        let component = if tick == node.tick() { told } else { 0 };
        let seen = node.observations().get(usize::from(component))?;
        // Nothing has been seen before the first tick, nor where SYNC has moved the node on and its next tick waits.
        let ran = node.tick() != 0 && seen.tick.wrapping_add(1) == node.tick();
        let wanted = self.telemetry_every != 0 && ran;
        if !wanted || !seen.tick.is_multiple_of(self.telemetry_every) {
            return None;
        }
        self.reported = (node.tick(), component + 1);
        Some(Telemetry { tick: seen.tick, component, nu: seen.nu, psi: seen.psi, u: seen.u })
    }

    fn refuse(&mut self, reason: Refusal) {
        match self.node.as_mut() {
            Some(node) => node.refuse(reason),
            None => self.counters.refuse(reason),
        }
    }
}

/// What the other nodes are to know of the last restart (protocol/README.md, fault code 3).
fn confession(reset: ResetCause) -> Option<u16> {
    match reset {
        ResetCause::Panic => Some(1),
        ResetCause::HardFault => Some(2),
        _ => None,
    }
}
