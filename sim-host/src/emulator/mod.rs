//! Fidelity `emulator`: the firmware image on one QEMU per node, with this program as the bus between their UARTs.
//!
//! The link model is that of the loopback engine, frame by frame and draw by draw: states that nodes send at tick `k` go on
//! the bus at the time of tick `k`, and what arrives before tick `k + 1` is written to the receivers before their next SYNC.
//! So the same scenario gives the same bits (tests/tests/parity.rs).

mod error;
mod link;
pub mod log;
mod process;

pub use error::EmulatorError;
pub use log::decode as decode_log;

use crate::bus::ideal::{IdealBus, Traffic};
use crate::engine::NodeEvent;
use crate::interrupt::Interrupt;
use crate::noise::Noise;
use funnel_core::{Event, Observation};
use funnel_protocol::config::NodeConfig;
use funnel_protocol::message::{Command, FaultCode, Message, Severity, Target, TickStamp};
use funnel_protocol::report::{Report, Telemetry};
use funnel_protocol::service::{Reply, Request};
use funnel_protocol::{WIRE_VERSION, serial};
use link::{Link, Received};
use process::Process;
use std::path::PathBuf;
use std::time::Duration;

/// How long a node may take to boot and say who it is.
const BOOT: Duration = Duration::from_secs(10);
/// How long a node may take for an answer or for a tick.
const ANSWER: Duration = Duration::from_secs(5);
/// How much later than the end of its serial line a dead emulator's exit status may come.
const EXIT: Duration = Duration::from_secs(1);
/// Lines of a node's log that an error quotes.
const LAST_LINES: usize = 5;

/// Bytes of a real-time frame on the wire.
pub type FrameBytes = heapless::Vec<u8, { serial::MAX_REAL_TIME_FRAME }>;

/// Where the pieces are.
#[derive(Clone, Debug)]
pub struct EmulatorOptions {
    /// Firmware image (ELF) for `mps2-an386`.
    pub image: PathBuf,
    /// Name or path of the emulator.
    pub qemu: String,
    /// Set when the user wants to stop.
    pub interrupt: Interrupt,
}

/// One node on its emulator.
struct EmulatedNode {
    process: Process,
    link: Link,
    /// State at the tick that comes next, by component.
    next_state: Vec<f32>,
    /// It has said that it stopped, and is not waited for any more.
    stopped: bool,
    /// What it said last is the outcome of a tick, so that its telemetry follows.
    ticked: bool,
}

/// A network of emulated nodes.
pub struct Emulator {
    nodes: Vec<EmulatedNode>,
    image: PathBuf,
    bus: IdealBus<FrameBytes>,
    noise: Noise,
    tick_ns: u64,
    /// Tick that comes next.
    tick: u32,
    /// Node by node, and the components of each in order.
    observations: Vec<Observation<f32>>,
    events: Vec<NodeEvent>,
}

impl Emulator {
    /// Starts one emulator per configuration, asks each node who it is, and configures it.
    ///
    /// # Errors
    /// No emulator, no image, a node that does not answer in time, another wire version, a refused configuration.
    pub fn new(
        configs: &[NodeConfig],
        bus: IdealBus<FrameBytes>,
        options: &EmulatorOptions,
    ) -> Result<Self, EmulatorError> {
        if !options.image.is_file() {
            return Err(EmulatorError::NoImage { path: options.image.clone() });
        }
        let mut processes = Vec::new();
        for config in configs {
            processes.push(Process::start(config.id, options)?);
        }
        let mut nodes = Vec::new();
        for (mut process, config) in processes.into_iter().zip(configs) {
            let stream = process.connect(BOOT, &options.interrupt)?;
            let link = Link::new(config.id, stream, options.interrupt.clone())?;
            let next_state = config.initial_state.to_vec();
            nodes.push(EmulatedNode { process, link, next_state, stopped: false, ticked: false });
        }
        let tick_ns = configs.first().map_or(0, |config| u64::from(config.tick_ns));
        let states = configs.iter().flat_map(|config| config.initial_state.iter().copied());
        let observations = states.map(|x| Observation { x, ..Observation::default() }).collect();
        let (image, noise, events) = (options.image.clone(), Noise::default(), Vec::new());
        let mut network = Self { nodes, image, bus, noise, tick_ns, tick: 0, observations, events };
        let ready = network.identify().and_then(|()| network.configure(configs));
        ready.map_err(|error| network.explain(error))?;
        Ok(network)
    }

    /// With noise on the states that nodes send.
    pub fn with_noise(self, noise: Noise) -> Self {
        Self { noise, ..self }
    }

    /// Starts all nodes and takes their announced initial states.
    ///
    /// # Errors
    /// A node that does not answer or dies.
    pub fn start(&mut self) -> Result<(), EmulatorError> {
        self.announce().map_err(|error| self.explain(error))
    }

    fn announce(&mut self) -> Result<(), EmulatorError> {
        let start = Message::Ctrl { target: Target::All, command: Command::Start, arg: 0, at_tick: 0 };
        for node in &mut self.nodes {
            node.link.write(&serial::encode(&start))?;
        }
        for index in 0..self.nodes.len() {
            self.take_announcement(index)?;
        }
        Ok(())
    }

    /// Runs one tick on every node, and gives what they saw, by index and then by component.
    ///
    /// # Errors
    /// A node that does not answer or dies, or an interrupt.
    pub fn advance(&mut self) -> Result<&[Observation<f32>], EmulatorError> {
        self.run_tick().map_err(|error| self.explain(error))?;
        Ok(&self.observations)
    }

    fn run_tick(&mut self) -> Result<(), EmulatorError> {
        // As in loopback, nothing is delivered any more once all nodes have stopped by themselves.
        if self.nodes.iter().any(|node| !node.stopped) {
            let now = (u64::from(self.tick) + 1) * self.tick_ns;
            self.deliver_before(now);
            self.send_sync()?;
            for index in 0..self.nodes.len() {
                self.take_tick(index, now)?;
            }
        }
        self.tick += 1;
        Ok(())
    }

    /// Writes what is queued, and a SYNC to the nodes that run.
    fn send_sync(&mut self) -> Result<(), EmulatorError> {
        let previous_tick = TickStamp::full(self.tick.wrapping_sub(1));
        let sync = serial::encode(&Message::Sync { source: None, previous_tick, phase_us: 0 });
        for node in &mut self.nodes {
            if !node.stopped {
                node.link.queue(&sync);
            }
            node.link.flush()?;
        }
        Ok(())
    }

    /// Stops all nodes and takes their reports, by index.
    ///
    /// # Errors
    /// A node that does not answer or dies.
    pub fn finish(&mut self) -> Result<Vec<Report>, EmulatorError> {
        self.stop().map_err(|error| self.explain(error))
    }

    fn stop(&mut self) -> Result<Vec<Report>, EmulatorError> {
        let stop = Message::Ctrl { target: Target::All, command: Command::Stop, arg: 0, at_tick: 0 };
        let mut reports = Vec::new();
        for node in &mut self.nodes {
            if !node.stopped {
                node.link.write(&serial::encode(&stop))?;
            }
            node.link.request(&Request::Report)?;
            reports.push(node.link.wait_for(ANSWER, "report", |received| match received {
                Received::Reply(Reply::Report(report)) => Some(report),
                _ => None,
            })?);
        }
        Ok(reports)
    }

    /// Faults that nodes reported so far.
    pub fn events(&self) -> &[NodeEvent] {
        &self.events
    }

    /// Frame counts so far.
    pub fn traffic(&self) -> Traffic {
        self.bus.traffic()
    }

    /// Ends all emulators and gives each node's raw defmt log, by index.
    pub fn into_logs(self) -> Vec<Vec<u8>> {
        self.nodes.into_iter().map(|node| node.process.into_log()).collect()
    }

    /// Adds to an error what the node that it names had to say.
    fn explain(&mut self, error: EmulatorError) -> EmulatorError {
        let node = error.node().and_then(|id| self.nodes.iter_mut().find(|node| node.link.id() == id));
        let Some(node) = node else { return error };
        let ended = matches!(error, EmulatorError::Died { .. });
        let mut words = node.process.last_words(if ended { EXIT } else { Duration::ZERO });
        // Without the image the log cannot be read, and the error stands alone.
        let image = std::fs::read(&self.image).unwrap_or_default();
        let log = decode_log(&image, &node.process.log());
        let lines: Vec<_> = log.lines().collect();
        words.extend(lines.iter().rev().take(LAST_LINES).rev().map(|line| format!("its log: {line}")));
        error.with_words(words.join("\n"))
    }

    fn identify(&mut self) -> Result<(), EmulatorError> {
        for node in &mut self.nodes {
            node.link.request(&Request::Hello)?;
            let identity = node.link.wait_for(BOOT, "identity", |received| match received {
                Received::Reply(Reply::Identity(identity)) => Some(identity),
                _ => None,
            })?;
            if identity.wire_version != WIRE_VERSION {
                return Err(EmulatorError::WireVersion {
                    node: node.link.id(),
                    found: identity.wire_version,
                });
            }
        }
        Ok(())
    }

    fn configure(&mut self, configs: &[NodeConfig]) -> Result<(), EmulatorError> {
        for (node, config) in self.nodes.iter_mut().zip(configs) {
            node.link.request(&Request::Configure(config.clone()))?;
            let answer = node.link.wait_for(ANSWER, "configured", |received| match received {
                Received::Reply(Reply::Configured(answer)) => Some(answer),
                _ => None,
            })?;
            answer.map_err(|reason| EmulatorError::Refused { node: config.id, reason })?;
        }
        Ok(())
    }

    fn deliver_before(&mut self, now: u64) {
        while self.bus.next_arrival().is_some_and(|at| at < now) {
            let nodes = &mut self.nodes;
            self.bus.deliver(|receiver, frame| {
                if let Some(node) = nodes.get_mut(receiver) {
                    node.link.queue(frame);
                }
            });
        }
    }

    /// Waits for the initial state of a node, or for the fault that it may say instead, and puts it on the bus.
    fn take_announcement(&mut self, index: usize) -> Result<(), EmulatorError> {
        let mut left = self.nodes.get(index).map_or(0, |node| node.next_state.len());
        while left > 0 {
            let Some(node) = self.nodes.get_mut(index).filter(|node| !node.stopped) else { break };
            let message = node.link.wait_for(ANSWER, "state", |received| match received {
                Received::Message(message @ (Message::State { .. } | Message::Fault { .. })) => Some(message),
                _ => None,
            })?;
            self.take_message(index, message, 0);
            left -= 1;
        }
        Ok(())
    }

    /// Waits for everything that a node says about a tick: its state (of the tick after the one that ran) or a fault, perhaps an
    /// edge, and its telemetry, which ends it.
    fn take_tick(&mut self, index: usize, now: u64) -> Result<(), EmulatorError> {
        let Some(node) = self.nodes.get_mut(index).filter(|node| !node.stopped) else { return Ok(()) };
        node.ticked = false;
        let state = node.next_state.clone();
        loop {
            let Some(node) = self.nodes.get_mut(index) else { return Ok(()) };
            if node.stopped && !node.ticked {
                return Ok(());
            }
            let awaited = if node.ticked { "telemetry" } else { "state" };
            match node.link.wait_for(ANSWER, awaited, Some)? {
                Received::Message(message) => self.take_message(index, message, now),
                Received::Reply(Reply::Telemetry(telemetry)) => {
                    self.take_telemetry(index, &state, &telemetry)?;
                    if usize::from(telemetry.component) + 1 >= state.len() {
                        return Ok(());
                    }
                }
                Received::Reply(_) => {}
            }
        }
    }

    fn take_telemetry(
        &mut self,
        index: usize,
        state: &[f32],
        telemetry: &Telemetry,
    ) -> Result<(), EmulatorError> {
        if let Some(node) = self.nodes.get(index).filter(|_| telemetry.tick != self.tick) {
            let (node, tick, found) = (node.link.id(), self.tick, telemetry.tick);
            return Err(EmulatorError::OutOfStep { node, tick, found });
        }
        let component = usize::from(telemetry.component);
        // All nodes have as many components.
        let slot = self.observations.get_mut(index * state.len() + component);
        if let (Some(slot), Some(&x)) = (slot, state.get(component)) {
            *slot = observation(x, telemetry);
        }
        Ok(())
    }

    fn take_message(&mut self, index: usize, message: Message, now: u64) {
        let Some(node) = self.nodes.get_mut(index) else { return };
        match message {
            Message::State { component, x, .. } => {
                if let Some(next) = node.next_state.get_mut(usize::from(component.get())) {
                    *next = x;
                }
                node.ticked = true;
            }
            Message::Fault { code, severity, .. } => {
                node.stopped = severity == Severity::Stopped;
                // Only these faults are the outcome of a tick, which the node has seen as any other.
                node.ticked = matches!(code, FaultCode::STATE_LIMIT | FaultCode::FUNNEL_LEFT);
                self.events.push(NodeEvent { at: now, node: index, event: Event::Fault(code) });
            }
            Message::Edge { .. } => {}
            Message::Ctrl { .. } | Message::Sync { .. } => return,
        }
        let message = self.noise.disturb(index, message);
        self.bus.send(now, index, serial::encode(&message));
    }
}

/// What a node saw at a tick: its state from the bus, the rest from its telemetry. The ratio is one f32 division, which
/// has the same bits here and there.
fn observation(x: f32, telemetry: &Telemetry) -> Observation<f32> {
    let Telemetry { tick, nu, psi, u, .. } = *telemetry;
    Observation { tick, x, nu, psi, ratio: nu.abs() / psi, u }
}
