//! The node's real code, fed with what the others said; what it sends waits to be found in the log.

use super::survey::{Drive, Survey};
use super::{Entry, says};
use crate::bus::table::node_of;
use crate::can::{AnyFormat, PortFrame};
use crate::configure::node_configs;
use crate::loopback::LOOPBACK;
use crate::noise::Noise;
use crate::run::{LOCKSTEP, RunError};
use crate::scenario::Scenario;
use funnelnet_can_bus::Id;
use funnelnet_link::Frame as _;
use funnelnet_node::{Action, Node, Params};
use funnelnet_protocol::message::{Command, Message, Target};
use funnelnet_protocol::refusal::Refusal;
use std::collections::{BTreeMap, VecDeque};

/// How far the tick of a frame may be from the node's, of the 256 that a classic frame tells apart.
const NEAR: u32 = 100;

/// A frame that the node sends.
#[derive(Clone, Debug)]
pub struct Sent {
    pub frame: PortFrame,
    /// The tick of its state; of another frame, the one that the node is at.
    pub tick: u32,
    /// When, ns of the node's time.
    pub at: u64,
}

/// The node.
#[derive(Clone)]
pub struct Twin {
    index: usize,
    node: Node,
    /// What is added to its states as they are sent, where a scenario has noise and no sensor.
    noise: Noise,
    neighbours: Vec<u8>,
    by_timer: bool,
    /// When its timer wakes it next, ns: what it hears until then does not.
    wake: Option<u64>,
    tick_ns: u64,
    fd: bool,
    /// By identifier, in the order in which they were sent.
    pub sent: BTreeMap<u16, VecDeque<Sent>>,
}

impl Twin {
    /// Node `id` of `scenario`, as the run of the log had it.
    ///
    /// # Errors
    /// The scenario is none that nodes can run.
    pub fn new(scenario: &Scenario, id: u8, survey: &Survey) -> Result<Self, RunError> {
        let drive = match survey.drive {
            Drive::Simulated => LOOPBACK,
            Drive::Host => LOCKSTEP,
            Drive::OwnClock => crate::run::OWN_CLOCK,
        };
        let index = usize::from(id) - 1;
        let configs = node_configs(scenario, drive).map_err(RunError::bad_input)?;
        let Some(config) = configs.get(index) else {
            let nodes = scenario.nodes.len();
            return Err(RunError::bad_input(format!("--node {id}: the scenario has nodes 1 to {nodes}")));
        };
        let params = Params::new(config)
            .map_err(|error| RunError::bad_input(format!("node {id} refused its configuration: {error}")))?;
        let noise = if survey.drive == Drive::Simulated { Noise::of(scenario) } else { Noise::default() };
        let node = Node::new(params, &config.neighbours);
        let neighbours = config.neighbours.iter().map(|neighbour| neighbour.id).collect();
        let by_timer = survey.drive != Drive::Host;
        let tick_ns = u64::from(config.tick_ns);
        Ok(Self {
            index,
            node,
            noise,
            neighbours,
            by_timer,
            wake: None,
            tick_ns,
            fd: survey.fd,
            sent: BTreeMap::new(),
        })
    }

    /// Tells it to start, as the simulator does.
    pub fn start(&mut self) {
        let start = Message::Ctrl { target: Target::All, command: Command::Start, arg: 0, at_tick: 0 };
        self.tell(&start, 0);
        self.poll(0);
    }

    /// Runs the ticks that are due up to `until`, ns.
    pub fn run(&mut self, until: u64) {
        while let Some(at) = self.wake.filter(|&at| at <= until) {
            self.poll(at);
            if self.wake == Some(at) {
                return;
            }
        }
    }

    /// Runs its next tick, or what else makes it send something, `late` ticks after it is due.
    pub fn step(&mut self, late: u32) {
        let state = |twin: &Self| (twin.node.tick(), twin.sent.values().map(VecDeque::len).sum::<usize>());
        let before = state(self);
        while let Some(at) = self.node.poll_at() {
            self.poll(at.saturating_add(u64::from(late) * self.tick_ns));
            // What it only had to report is no step.
            if state(self) != before || self.wake == Some(at) {
                return;
            }
        }
    }

    /// Gives it a frame of the log.
    pub fn hear(&mut self, entry: &Entry, now: u64) {
        let Some((id, bytes)) = entry.real_time() else {
            self.node.refuse(Refusal::Kind);
            return;
        };
        for message in says(&mut AnyFormat::new(self.fd), id, bytes) {
            match message {
                Ok(message) => self.tell(&message, now),
                Err(reason) => self.node.refuse(reason),
            }
        }
    }

    /// Whether a frame can make it another one: of a host, or of a neighbour.
    pub fn listens_to(&self, entry: &Entry) -> bool {
        let from = entry.real_time().and_then(|(id, _)| node_of(Id::Base(id)).filter(|_| id >> 7 > 0));
        from.is_none_or(|from| self.neighbours.contains(&from))
    }

    /// Tick that it runs next.
    pub fn tick(&self) -> u32 {
        self.node.tick()
    }

    fn tell(&mut self, message: &Message, now: u64) {
        // The node counts what it refuses.
        let _ = self.node.on_message(message, now);
        // In simulation its timer alone makes it do something.
        if !self.by_timer && self.node.poll_at().is_some_and(|at| at <= now) {
            self.poll(now);
        }
    }

    fn poll(&mut self, now: u64) {
        let mut format = AnyFormat::new(self.fd);
        while let Some(action) = self.node.poll(now) {
            let Action::Send(message) = action else { continue };
            let message = self.noise.disturb(self.index, message);
            format.pack(&message).into_iter().for_each(|frame| self.put(frame, now));
        }
        format.flush().into_iter().for_each(|frame| self.put(frame, now));
        self.wake = self.node.poll_at();
    }

    fn put(&mut self, frame: PortFrame, at: u64) {
        let tick = tick_of(frame.id(), frame.data(), self.fd, self.node.tick());
        self.sent.entry(frame.id()).or_default().push_back(Sent { frame, tick, at });
    }
}

/// The whole tick that a frame says, near `own`; `own`, where it says none.
pub fn tick_of(id: u16, bytes: &[u8], fd: bool, own: u32) -> u32 {
    let stamp =
        says(&mut AnyFormat::new(fd), id, bytes).into_iter().flatten().find_map(|message| match message {
            Message::State { tick, .. } | Message::Fault { tick, .. } => Some(tick),
            _ => None,
        });
    stamp.and_then(|stamp| stamp.rebuild(own, NEAR, NEAR)).unwrap_or(own)
}
