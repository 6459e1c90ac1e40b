//! A node and its host: identity, configuration, telemetry, report. Frames and time in, outputs out.
//!
//! Firmware wraps a link around it; tests drive it in memory.

mod storage_request;
mod telemetry;
mod timing;

pub use storage_request::Task;

use crate::model::{Configured, Model};
use crate::node::{Action, Node};
use crate::observe::{Event, Phase};
use crate::params::Params;
use crate::watchdog::Progress;
use funnelnet_protocol::NodeConfig;
use funnelnet_protocol::config::ConfigError;
use funnelnet_protocol::message::{Command, FaultCode, Message};
use funnelnet_protocol::refusal::Refusal;
use funnelnet_protocol::report::{Counters, Losses, Report};
use funnelnet_protocol::serial::{Frame, HOST};
use funnelnet_protocol::service::{Identity, Reply, Request, ResetCause, StageError, StoreError};
use storage_request::{Staged, StorageRequest};
use telemetry::Teller;
use timing::Timing;

/// Action that the firmware shall take next.
#[derive(Clone, Debug, PartialEq)]
pub enum Output {
    /// Put this frame of the real-time plane on the link.
    Send(Message),
    /// Put this SYNC of a time master on the link, and say by [`Session::sync_sent`] when it was on the wire.
    Sync(Message),
    /// Put this frame of the service plane on the link.
    Reply(Reply),
    /// Log this event.
    Report(Event),
    /// Put the actuator in its safe position: the program has started, or the node has stopped, whatever the
    /// reason.
    Safe,
    /// Measure the plant, and answer by [`Session::measured`] or [`Session::sample_failed`]: a tick waits for
    /// it.
    Sample,
    /// Drive the actuator with [`Session::inputs`].
    Actuate,
    /// Do [`Session::task`] with the storage, and say how that went by [`Session::performed`].
    StorageRequest,
}

/// Node behind a line to a host; it may still be blank.
#[derive(Debug)]
pub struct Session<M: Model = Configured> {
    identity: Identity,
    model: M,
    node: Option<Node<f32, M::Field>>,
    /// The time that the node keeps with others, where its configuration says how.
    timing: Option<Timing>,
    /// The configuration that the node was made of.
    config: Option<NodeConfig>,
    /// Buffer for a configuration on its way to the storage or from there.
    config_buffer: Option<NodeConfig>,
    staged: Option<Staged>,
    /// Counters of a blank node.
    counters: Counters,
    /// What the link has lost since the start, and what of it before the node was made.
    losses: Losses,
    losses_before: Losses,
    /// How often the configuration has changed.
    changes: u8,
    teller: Teller,
    reply: Option<Reply>,
    /// Request that the app is to be given.
    storage_request: Option<StorageRequest>,
    /// Request that the app has been given, and has not answered yet.
    performing: Option<StorageRequest>,
    /// The kind of a request that came before the one before it was answered, until that is said.
    refused: Option<u8>,
    /// Argument of the FAULT that says why the node was gone, until it has an id to say it with.
    restart_fault: Option<u16>,
    /// The app is to be told that the actuator belongs in its safe position.
    safe: bool,
    /// Time of the outputs that are being given, ns, from the first one to the `None` that ends them.
    giving: Option<u64>,
}

impl Session {
    /// Blank node that will be what its configuration describes.
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
            timing: None,
            config: None,
            config_buffer: None,
            staged: None,
            counters,
            losses: Losses::default(),
            losses_before: Losses::default(),
            changes: 0,
            teller: Teller::default(),
            reply: None,
            storage_request: None,
            performing: None,
            refused: None,
            restart_fault: restart_fault(identity.reset),
            safe: true,
            giving: None,
        }
    }

    /// Buffer that a stored configuration is read to before [`Session::restore`]: in place, since each copy
    /// of one is 2 KiB of stack.
    pub fn config_buffer(&mut self) -> &mut Option<NodeConfig> {
        &mut self.config_buffer
    }

    /// Makes a node of the stored configuration in the [buffer](Session::config_buffer), as a CONFIGURE
    /// would.
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

    /// Count of changes of the configuration, wrapping. An app that hands parts of it to a driver does so
    /// when this changes.
    pub fn changes(&self) -> u8 {
        self.changes
    }

    /// Takes note of what the link has lost since the start: REPORT says what of it was since the
    /// configuration.
    pub fn note_losses(&mut self, losses: Losses) {
        self.losses = losses;
    }

    /// The node, once it is configured.
    pub fn node(&self) -> Option<&Node<f32, M::Field>> {
        self.node.as_ref()
    }

    /// Inputs that [`Output::Actuate`] is about, state units / s, component by component; empty without a
    /// plant.
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

    /// Id of the node, the source of its frames; 0 while blank.
    pub fn id(&self) -> u8 {
        self.node.as_ref().map_or(HOST, |node| node.id().get())
    }

    /// Ticks that its node has completed and waits for, for the watchdog; a blank one waits.
    pub fn progress(&self) -> Progress {
        let progress = self.node.as_ref().map_or_else(Progress::default, Node::progress);
        match &self.timing {
            None => progress,
            // Its node knows the time of the network, and who looks that of the clock.
            Some(timing) => Progress { next: progress.next.map(|next| timing.own(next)), ..progress },
        }
    }

    /// Time at which [`Session::poll`] has something to do next, ns on the caller's clock; `None`: not before
    /// a frame.
    pub fn poll_at(&self) -> Option<u64> {
        let asks = self.reply.is_some() || self.storage_request.is_some() || self.refused.is_some();
        let waits = self.safe || asks;
        if waits {
            return Some(0);
        }
        let at = self.node.as_ref()?.poll_at();
        if self.timing.is_none() { at } else { self.own_time(at) }
    }

    /// Takes what the link received at `now` (ns). What is refused is counted and changes nothing.
    pub fn on_frame(&mut self, frame: Result<Frame<'_>, Refusal>, now: u64) {
        let outcome = match frame {
            Ok(Frame::RealTime(message)) => return self.on_stamped(&message, (now, now)),
            Ok(Frame::Service { kind, body, .. }) => self.on_request(kind, body),
            Err(reason) => Err(reason),
        };
        if let Err(reason) = outcome {
            self.refuse(reason);
        }
    }

    /// Stops the node, with a safe output, where the platform cannot go on for it: its link is gone, for
    /// example.
    pub fn fail(&mut self, code: FaultCode, arg: u16) {
        if let Some(node) = self.node.as_mut() {
            node.fail(code, arg);
        }
    }

    /// Does what is due at `now` (ns) and gives the next output; call it until it gives `None`. Bounded as
    /// `Node::poll`.
    ///
    /// From the first output to that `None` time stands still, so that it comes, and the app gets back to its
    /// link and its watchdog, also where the outputs take longer than a tick.
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
        if self.storage_request.is_some() {
            self.performing = self.storage_request.take();
            return Some(Output::StorageRequest);
        }
        // After the answer to the one before, since a host takes answers in order.
        if self.performing.is_none()
            && let Some(reply) = self.refused.take().and_then(Reply::busy)
        {
            return Some(Output::Reply(reply));
        }
        let mut now = now;
        if self.timing.is_some() {
            if let Some(output) = self.keep_time(now) {
                return Some(output);
            }
            now = self.network_time(now);
        }
        let node = self.node.as_mut()?;
        match node.poll(now) {
            Some(Action::Send(message)) => Some(Output::Send(message)),
            Some(Action::Report(event)) => Some(Output::Report(event)),
            Some(Action::Safe) => Some(Output::Safe),
            Some(Action::Sample) => Some(Output::Sample),
            Some(Action::Actuate) => Some(Output::Actuate),
            None => match self.teller.next(node) {
                Some(telemetry) => Some(Output::Reply(Reply::Telemetry(telemetry))),
                None => self.take_commit().then_some(Output::StorageRequest),
            },
        }
    }

    /// Whether the actuator belongs in its safe position from now on; told once. It comes before any reply,
    /// which may take a while.
    fn take_safe(&mut self) -> bool {
        let stopped = self.node.as_mut().is_some_and(Node::take_stop);
        core::mem::take(&mut self.safe) || stopped
    }

    /// Takes a message that was on the wire at the first of these times, and is known at the second one, ns.
    fn on_stamped(&mut self, message: &Message, (stamp, now): (u64, u64)) {
        if let Message::Ctrl { target, command: Command::Commit, at_tick, .. } = *message {
            return self.on_commit(target, at_tick);
        }
        let mut now = now;
        if self.timing.is_some() {
            match self.take_timed(message, (stamp, now)) {
                Some(network) => now = network,
                None => return,
            }
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
                    Ok(()) => return self.request_storage(StorageRequest::Stage),
                    Err(reason) => Reply::Staged(Err(reason)),
                }
            }
            Request::Key(_) if self.is_running() => Reply::Keyed(Err(StoreError::Running)),
            Request::Key(key) => return self.request_storage(StorageRequest::Key(key)),
            Request::Report => Reply::Report(self.report()),
            Request::Configure(bytes) => Reply::Configured(self.read(bytes).and_then(|()| self.configure())),
            Request::Store => match self.may_store() {
                Ok(()) => return self.request_storage(StorageRequest::Store),
                Err(reason) => Reply::Stored(Err(reason)),
            },
            Request::Erase if self.is_running() => Reply::Erased(Err(StoreError::Running)),
            Request::Erase => return self.request_storage(StorageRequest::Erase),
        };
        self.reply = Some(reply);
        Ok(())
    }

    /// Whether another request has to be answered first. One that comes meanwhile must not touch what that
    /// one is about: the buffer, the configuration, the place of its answer.
    fn is_busy_for(&self, only_asks: bool) -> bool {
        let asked = self.storage_request.is_some() && !only_asks;
        self.reply.is_some() || self.performing.is_some() || asked
    }

    /// Reads a configuration into the buffer: in place, since each copy of it is 2 KiB of stack. One that
    /// cannot be read is counted, and answered all the same, so that no host waits for nothing.
    fn read(&mut self, bytes: &[u8]) -> Result<(), ConfigError> {
        self.config_buffer.insert(NodeConfig::empty()).read(bytes).map_err(|_| {
            self.config_buffer = None;
            self.refuse(Refusal::Value);
            ConfigError::Malformed
        })
    }

    fn is_running(&self) -> bool {
        self.node.as_ref().is_some_and(|node| node.phase() == Phase::Running)
    }

    /// Makes a node of what is in the buffer, which is empty then.
    fn configure(&mut self) -> Result<(), ConfigError> {
        let made = if self.is_running() { Err(ConfigError::Running) } else { self.make_node() };
        self.config_buffer = None;
        if made.is_ok() {
            self.set_timing();
        }
        made
    }

    // Not inlined because its callers would need stack for this beside all else that they do.
    #[inline(never)]
    fn make_node(&mut self) -> Result<(), ConfigError> {
        let config = self.config_buffer.as_ref().ok_or(ConfigError::Malformed)?;
        let params = Params::of_model(config, &self.model)?;
        // The old one may have stopped just now.
        let stopped = self.node.as_mut().is_some_and(Node::take_stop);
        self.safe |= stopped;
        let node = self.node.insert(Node::alone(params));
        node.meet(&config.neighbours);
        if let Some(arg) = self.restart_fault.take() {
            node.warn(FaultCode::PANIC, arg);
        }
        self.teller.restart();
        self.losses_before = self.losses;
        self.settle();
        Ok(())
    }

    /// Makes what is in the buffer the configuration that the node has.
    fn settle(&mut self) {
        core::mem::swap(&mut self.config, &mut self.config_buffer);
        self.changes = self.changes.wrapping_add(1);
        if let Some(config) = &self.config {
            self.teller.tell_every(config.telemetry_every);
            self.identity.checksum = config.checksum();
        }
    }

    fn report(&self) -> Report {
        let mut report = match &self.node {
            Some(node) => node.report(),
            None => Report { max_ratio: 0.0, counters: self.counters.clone() },
        };
        report.counters.link = self.losses.since(&self.losses_before);
        report
    }

    fn refuse(&mut self, reason: Refusal) {
        match self.node.as_mut() {
            Some(node) => node.refuse(reason),
            None => self.counters.refuse(reason),
        }
    }
}

/// Argument of the FAULT that tells other nodes of the last restart (protocol/README.md, fault code 3).
fn restart_fault(reset: ResetCause) -> Option<u16> {
    match reset {
        ResetCause::Panic => Some(1),
        ResetCause::HardFault => Some(2),
        _ => None,
    }
}
