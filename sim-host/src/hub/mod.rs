//! Nodes behind streams of bytes, with this program as the bus between them: it relays their frames and makes them tick.
//!
//! The link model is that of the loopback engine, frame by frame and draw by draw: states that nodes send at tick `k` go on
//! the bus at the time of tick `k`, and what arrives before tick `k + 1` is written to the receivers before their next SYNC.
//! So the same scenario gives the same bits (tests/tests/parity.rs), at the pace of the slowest node. Nodes that tick by their own clock
//! are carried in real time instead (`own_clock`).

mod absence;
mod commission;
mod error;
mod halt;
mod hearing;
mod link;
mod on_can;
mod own_clock;
mod readers;

pub use crate::conductor::{Received, Stamps};
pub use absence::{Absence, OnLoss};
pub use commission::{Commissioned, Commissioning, Failed, Known};
pub use error::HubError;
pub use halt::Halted;
pub use link::{Link, SLICE, Stream};
pub use on_can::{CanCounts, CanSide};

use crate::bus::ideal::{IdealBus, Traffic};
use crate::conductor::doubt::Doubts;
use crate::conductor::{OTHER_COMPONENT, measure, observation};
use crate::engine::NodeEvent;
use crate::judge::Account;
use crate::noise::Noise;
use crate::presence::Presence;
use absence::Away;
use funnelnet_node::{Event, Observation};
use funnelnet_protocol::config::{Breach, NodeConfig};
use funnelnet_protocol::message::{Command, Component, FaultCode, Message, Severity, Target, TickStamp};
use funnelnet_protocol::report::{Report, Telemetry};
use funnelnet_protocol::service::{Identity, Reply, Request};
use funnelnet_protocol::{WIRE_VERSION, serial};
use hearing::Hearing;
use own_clock::OwnClock;
use std::time::{Duration, Instant, SystemTime};

/// How long a node that has said nothing is left alone before it is asked again who it is: it may have been booting.
const ASK_AGAIN: Duration = Duration::from_secs(1);

/// Bytes of a real-time frame on the wire.
pub type FrameBytes = heapless::Vec<u8, { serial::MAX_REAL_TIME_FRAME }>;

/// A frame on its way from node to node.
#[derive(Clone, Debug)]
pub struct Relayed {
    /// Index of the node that sent it.
    from: usize,
    /// Whether it is a component of its state.
    is_state: bool,
    bytes: FrameBytes,
}

/// How long a node has for a tick, whatever it says meanwhile.
#[derive(Clone, Copy, Debug)]
struct Deadline {
    end: Instant,
    /// From its begin to its end.
    limit: Duration,
}

impl Deadline {
    fn after(limit: Duration) -> Self {
        Self { end: Instant::now() + limit, limit }
    }

    fn is_over(&self) -> bool {
        Instant::now() > self.end
    }
}

/// What a node runs on.
pub trait Device {
    /// What there is to say about a failure of the node, a line each; `ended` where its line is gone.
    fn last_words(&mut self, ended: bool) -> Vec<String>;

    /// Opens the line of a device anew that was gone, such as a board that has been plugged in again; `None` where there is nothing to open.
    fn reopen(&mut self) -> Option<Box<dyn Stream>> {
        None
    }

    /// The node's log as text, where this program has it. Ends the device.
    fn into_log(self: Box<Self>) -> Option<String>;
}

/// A node that the hub can talk to.
pub struct Attached {
    /// Its line.
    pub link: Link,
    /// What it runs on.
    pub device: Box<dyn Device>,
    /// The unique number that its chip must have.
    pub uid: Option<u64>,
}

/// How long the hub waits for nodes.
#[derive(Clone, Copy, Debug)]
pub struct Patience {
    /// To boot and say who they are.
    pub boot: Duration,
    /// For an answer or for a tick.
    pub answer: Duration,
}

/// One node of the network.
struct HubNode {
    link: Link,
    device: Box<dyn Device>,
    uid: Option<u64>,
    identity: Option<Identity>,
    /// What it is told before the run.
    config: NodeConfig,
    /// Set while it is lost and the others go on.
    away: Option<Away>,
    /// The bus that its states travel on, by index; `None` for one that is on its line only.
    on_can: Option<usize>,
    /// State at the tick that comes next, by component.
    next_state: Vec<f32>,
    /// It has said that it stopped, and is not waited for any more.
    stopped: bool,
    /// What it said last is the outcome of a tick, so that its telemetry follows.
    ticked: bool,
    /// Components of its state that have come in this tick, a bit each.
    states: u8,
    /// Components of its telemetry that have.
    telemetries: usize,
    /// A telemetry of this tick was refused.
    refused: bool,
    /// The last warning that it has said: on CAN it comes by two ways.
    warned: Option<(FaultCode, u16, u32)>,
}

impl HubNode {
    /// Whether all components of its state have come in this tick.
    fn has_told_its_state(&self) -> bool {
        self.states.count_ones() as usize >= self.next_state.len()
    }

    /// Fails once its time for a tick is over: it may have said what it wants.
    fn check_patience(&self, deadline: Deadline, tick: u32, awaited: &'static str) -> Result<(), HubError> {
        if !deadline.is_over() {
            return Ok(());
        }
        Err(HubError::Babbles { node: self.link.id(), tick, awaited, waited: deadline.limit })
    }

    /// Takes note of who it is, if it is who it should be.
    fn meet(&mut self, identity: Identity) -> Result<(), HubError> {
        self.identity = Some(identity);
        check_identity(&self.link, &identity, self.uid)
    }

    fn configure(&mut self, config: &NodeConfig, patience: Duration) -> Result<(), HubError> {
        self.link.request(&Request::Configure(config.clone()))?;
        let answer = self.link.wait_for(patience, "configured", |received| match received {
            Received::Reply(Reply::Configured(answer)) => Some(answer),
            _ => None,
        })?;
        answer.map_err(|reason| HubError::Refused { node: config.id, reason })?;
        // What it said before belongs to another run.
        self.link.expect_its_own();
        Ok(())
    }
}

/// A network of nodes with this program in its middle.
pub struct Hub {
    nodes: Vec<HubNode>,
    bus: IdealBus<Relayed>,
    noise: Noise,
    patience: Patience,
    on_loss: OnLoss,
    absences: Vec<Absence>,
    tick_ns: u64,
    /// Tick that comes next.
    tick: u32,
    begin: Instant,
    /// The same instant by the clock that the kernel stamps frames with.
    begin_on_bus: SystemTime,
    /// The buses of nodes on CAN.
    can: Vec<CanSide>,
    /// Time before each SYNC for states on lines from node to node, where there are some.
    settle: Option<Duration>,
    /// Where nodes do not tick by SYNC.
    own: Option<OwnClock>,
    /// Of the last tick, by index.
    stamps: Vec<Stamps>,
    /// Node by node, and the components of each in order.
    observations: Vec<Observation<f32>>,
    /// What is known of each node at the last tick, by index.
    presence: Vec<Presence>,
    events: Vec<NodeEvent>,
    warnings: u64,
    doubts: Doubts,
    hearing: Hearing,
}

impl Hub {
    /// Asks each node who it is, and, once all are who they should be, configures them; one node per configuration.
    ///
    /// # Errors
    /// A node that does not answer in time, another wire version, another chip, a refused configuration.
    pub fn new(
        attached: Vec<Attached>,
        configs: &[NodeConfig],
        bus: IdealBus<Relayed>,
        patience: Patience,
    ) -> Result<Self, HubError> {
        let node = |(Attached { link, device, uid }, config): (_, &NodeConfig)| {
            let next_state = config.initial_state.to_vec();
            HubNode {
                link,
                device,
                uid,
                identity: None,
                config: config.clone(),
                away: None,
                on_can: None,
                next_state,
                stopped: false,
                ticked: false,
                states: 0,
                telemetries: 0,
                refused: false,
                warned: None,
            }
        };
        let nodes: Vec<_> = attached.into_iter().zip(configs).map(node).collect();
        let tick_ns = configs.first().map_or(0, |config| u64::from(config.tick_ns));
        let states = configs.iter().flat_map(|config| config.initial_state.iter().copied());
        let observations = states.map(|x| Observation { x, ..Observation::default() }).collect();
        let stamps = vec![Stamps::default(); nodes.len()];
        let presence = vec![Presence::Unrecorded; nodes.len()];
        let hearing = Hearing::of(nodes.len());
        let (noise, events, begin) = (Noise::default(), Vec::new(), Instant::now());
        let (on_loss, absences) = (OnLoss::default(), Vec::new());
        let mut hub = Self {
            nodes,
            bus,
            noise,
            patience,
            on_loss,
            absences,
            tick_ns,
            tick: 0,
            begin,
            begin_on_bus: SystemTime::now(),
            can: Vec::new(),
            settle: None,
            own: None,
            stamps,
            observations,
            presence,
            events,
            warnings: 0,
            doubts: Doubts::default(),
            hearing,
        };
        let ready = hub.identify().and_then(|()| hub.configure());
        ready.map_err(|error| hub.explain(error))?;
        Ok(hub)
    }

    /// With noise on the states that nodes send.
    pub fn with_noise(self, noise: Noise) -> Self {
        Self { noise, ..self }
    }

    /// With lines between nodes, on which their states may take so long.
    pub fn with_wires(self, settle: Duration) -> Self {
        Self { settle: Some(settle), ..self }
    }

    /// Starts all nodes, and in lockstep takes their announced initial states.
    ///
    /// # Errors
    /// A node that does not answer or dies.
    pub fn start(&mut self) -> Result<(), HubError> {
        let started = if self.own.is_some() { self.start_clocks() } else { self.announce() };
        started.map_err(|error| self.explain(error))
    }

    fn announce(&mut self) -> Result<(), HubError> {
        (self.begin, self.begin_on_bus) = (Instant::now(), SystemTime::now());
        self.say_on_can(&START)?;
        for node in self.nodes.iter_mut().filter(|node| node.on_can.is_none()) {
            node.link.write(&serial::encode(&START))?;
        }
        for index in 0..self.nodes.len() {
            self.take_announcement(index)?;
        }
        Ok(())
    }

    /// Runs one tick on every node, or waits until every node has run it, and gives what they saw, by index and then by component.
    ///
    /// # Errors
    /// A node that does not answer or dies, clocks that run apart, or an interrupt.
    pub fn advance(&mut self) -> Result<&[Observation<f32>], HubError> {
        let ran = if self.own.is_some() { self.carry_a_tick() } else { self.run_tick() };
        self.collect_doubts();
        ran.map_err(|error| self.explain(error))?;
        Ok(&self.observations)
    }

    fn run_tick(&mut self) -> Result<(), HubError> {
        // As in loopback, nothing is delivered any more once all nodes have stopped by themselves.
        if self.nodes.iter().any(|node| !node.stopped) {
            self.look_for_lost()?;
            self.note_presence();
            let now = (u64::from(self.tick) + 1) * self.tick_ns;
            self.deliver_before(now)?;
            self.settle()?;
            self.say_on_can(&self.sync())?;
            for index in 0..self.nodes.len() {
                let sent = self.send_sync(index);
                sent.or_else(|error| self.lose(index, error))?;
            }
            for index in 0..self.nodes.len() {
                let taken = self.take_tick(index, now);
                taken.or_else(|error| self.lose(index, error))?;
            }
        } else {
            self.note_presence();
        }
        // Those of this tick.
        self.collect_doubts();
        self.tick += 1;
        Ok(())
    }

    /// Leaves states their time on lines from node to node. What this program relays goes out before, too: a SYNC that one node passes
    /// on to another must not overtake it.
    fn settle(&mut self) -> Result<(), HubError> {
        let Some(settle) = self.settle else { return Ok(()) };
        for index in 0..self.nodes.len() {
            let node = self.nodes.get_mut(index).filter(|node| node.away.is_none());
            let sent = node.map_or(Ok(()), |node| node.link.flush());
            sent.or_else(|error| self.lose(index, error))?;
        }
        std::thread::sleep(settle);
        Ok(())
    }

    /// What makes the nodes tick.
    fn sync(&self) -> Message {
        let previous_tick = TickStamp::full(self.tick.wrapping_sub(1));
        Message::Sync { source: None, previous_tick, phase_us: 0 }
    }

    /// Writes what is queued for a node, and a SYNC if it runs and is on no CAN.
    fn send_sync(&mut self, index: usize) -> Result<(), HubError> {
        let sync = serial::encode(&self.sync());
        let (Some(node), Some(stamps)) = (self.nodes.get_mut(index), self.stamps.get_mut(index)) else {
            return Ok(());
        };
        *stamps = Stamps::default();
        if node.away.is_some() {
            return Ok(());
        }
        if !node.stopped {
            if node.on_can.is_none() {
                node.link.queue(&sync);
            }
            stamps.sync = Some(self.begin.elapsed());
        }
        node.link.flush()
    }

    /// Stops all nodes and takes their reports, by index; a node that is away has none.
    ///
    /// # Errors
    /// A node that does not answer or dies.
    pub fn finish(&mut self) -> Result<Vec<Option<Report>>, HubError> {
        let stopped = self.stop();
        self.collect_doubts();
        stopped.map_err(|error| self.explain(error))
    }

    fn stop(&mut self) -> Result<Vec<Option<Report>>, HubError> {
        // All of them first: nodes with clocks of their own tick on until they hear it.
        self.stop_on_can()?;
        for index in 0..self.nodes.len() {
            let told = self.tell_to_stop(index);
            told.or_else(|error| self.lose(index, error))?;
        }
        self.end_readers();
        let mut reports = Vec::new();
        for index in 0..self.nodes.len() {
            let reported = self.ask_for_report(index);
            reports.push(reported.or_else(|error| self.lose(index, error).map(|()| None))?);
        }
        self.listen_on_can()?;
        Ok(reports)
    }

    fn tell_to_stop(&mut self, index: usize) -> Result<(), HubError> {
        match self.nodes.get_mut(index) {
            Some(node) if node.away.is_none() && !node.stopped => node.link.write(&serial::encode(&STOP)),
            _ => Ok(()),
        }
    }

    fn ask_for_report(&mut self, index: usize) -> Result<Option<Report>, HubError> {
        let Some(node) = self.nodes.get_mut(index).filter(|node| node.away.is_none()) else {
            return Ok(None);
        };
        node.link.request(&Request::Report)?;
        let mut faults = Vec::new();
        let reported = node.link.wait_for(self.patience.answer, "report", |received| match received {
            Received::Message(message @ Message::Fault { .. }) => {
                faults.push(message);
                None
            }
            received => report(received),
        });
        self.note_warnings(index, &faults);
        reported.map(Some)
    }

    /// Takes note of the warnings among faults that came with something else.
    fn note_warnings(&mut self, index: usize, faults: &[Message]) {
        let now = (u64::from(self.tick) + 1) * self.tick_ns;
        for fault in faults {
            if matches!(fault, Message::Fault { severity, .. } if *severity != Severity::Stopped) {
                self.note_fault(index, fault, now);
            }
        }
    }

    /// Faults that nodes reported so far.
    pub fn events(&self) -> &[NodeEvent] {
        &self.events
    }

    /// Frame counts so far.
    pub fn traffic(&self) -> Traffic {
        self.bus.traffic()
    }

    /// What the nodes saw at their last tick, by index and then by component.
    pub fn observations(&self) -> &[Observation<f32>] {
        &self.observations
    }

    /// What is known of each node at the last tick, by index.
    pub fn presence(&self) -> &[Presence] {
        &self.presence
    }

    /// What is known of each node at a tick before it has said anything about it.
    fn note_presence(&mut self) {
        for (slot, node) in self.presence.iter_mut().zip(&self.nodes) {
            *slot = match node {
                HubNode { away: Some(_), .. } => Presence::Absent,
                HubNode { stopped: true, .. } => Presence::Stopped,
                HubNode { .. } => Presence::Unrecorded,
            };
        }
    }

    fn set_presence(&mut self, index: usize, presence: Presence) {
        if let Some(slot) = self.presence.get_mut(index) {
            *slot = presence;
        }
    }

    /// FAULT frames that did not stop their node.
    pub fn warnings(&self) -> u64 {
        self.warnings
    }

    /// What nodes have said that cannot be so, a sentence each.
    pub fn contradictions(&self) -> Vec<String> {
        self.doubts.sentences()
    }

    /// Whether what a node reports is of the whole run: it has not been away.
    pub fn was_there_throughout(&self, index: usize) -> bool {
        let id = self.nodes.get(index).map(|node| node.link.id());
        self.absences.iter().all(|absence| Some(absence.node) != id)
    }

    /// Ticks that a node may have run beside those that were told of: those with clocks of their own go on until they hear the stop, and
    /// after an error a tick may be under way.
    pub fn unseen(&self, ended_early: bool) -> u64 {
        match &self.own {
            Some(_) => {
                let elapsed = self.elapsed_ns().checked_div(self.tick_ns).unwrap_or(0);
                elapsed.saturating_sub(u64::from(self.tick)) + CLOCK_SPARE
            }
            None => u64::from(ended_early),
        }
    }

    /// What a node cannot have counted, of which every tick was seen.
    pub fn cannot_have_counted(&self, index: usize, account: &Account) -> Vec<String> {
        let (Some((_, counters)), Some(node)) = (&account.report, self.nodes.get(index)) else {
            return Vec::new();
        };
        let (id, mut found) = (account.id, Vec::new());
        let asked = matches!(node.config.on_breach, Breach::Reopen { .. });
        if counters.reopened > 0 && !asked {
            let times = counters.reopened;
            found.push(format!(
                "node {id} reports that it has reopened its funnel {times} times, which nobody has asked for"
            ));
        }
        // By SYNC only.
        if self.own.is_none() && account.whole && account.unknown == 0 {
            if counters.sync_gaps > 0 {
                let gaps = counters.sync_gaps;
                found.push(format!("node {id} reports {gaps} SYNC gaps, and was seen to run every tick"));
            }
            if counters.overruns > 0 {
                let late = counters.overruns;
                found.push(format!("node {id} reports {late} overruns, and was told when to tick"));
            }
        }
        found
    }

    /// Takes note of what lines have refused.
    fn collect_doubts(&mut self) {
        for node in &mut self.nodes {
            let id = node.link.id();
            for (what, value) in node.link.take_doubts() {
                self.doubts.note(id, what, self.tick, || value);
            }
        }
    }

    /// When the host sent and read what belongs to the last tick, by index.
    pub fn stamps(&self) -> &[Stamps] {
        &self.stamps
    }

    /// The nodes' lines and who they say they are, by index.
    pub fn members(&self) -> impl Iterator<Item = (&Link, Identity)> {
        // All were asked before the hub was made.
        self.nodes.iter().filter_map(|node| Some((&node.link, node.identity?)))
    }

    /// Ends all devices and gives the logs that this program has: id and text.
    pub fn into_logs(self) -> Vec<(u8, String)> {
        let log = |node: HubNode| Some((node.link.id(), node.device.into_log()?));
        self.nodes.into_iter().filter_map(log).collect()
    }

    /// Adds to an error what there is to say about the node that it names.
    fn explain(&mut self, error: HubError) -> HubError {
        let node = error.node().and_then(|id| self.nodes.iter_mut().find(|node| node.link.id() == id));
        let Some(node) = node else { return error };
        let mut words = node.device.last_words(matches!(error, HubError::Died { .. }));
        if let (count, Some(reason)) = node.link.refused() {
            words.push(format!(
                "frames from it that could not be read: {count} (the last one: {})",
                reason.name()
            ));
        }
        words.extend(node.link.sound());
        words.extend(self.doubts.of(node.link.id()));
        error.with_words(words.join("\n"))
    }

    fn identify(&mut self) -> Result<(), HubError> {
        for node in &mut self.nodes {
            let identity = identify(&mut node.link, self.patience.boot)?;
            node.meet(identity)?;
        }
        Ok(())
    }

    fn configure(&mut self) -> Result<(), HubError> {
        for node in &mut self.nodes {
            if node.identity.is_some_and(|identity| identity.id != serial::HOST) {
                // Left over from another run, perhaps running still; then it would refuse.
                node.link.write(&serial::encode(&STOP))?;
            }
            let config = node.config.clone();
            node.configure(&config, self.patience.answer)?;
        }
        Ok(())
    }

    fn deliver_before(&mut self, now: u64) -> Result<(), HubError> {
        while self.bus.next_arrival().is_some_and(|at| at < now) {
            // Several receivers on a bus are one.
            let mut for_can: Vec<(usize, FrameBytes)> = Vec::new();
            let (nodes, hearing, tick) = (&mut self.nodes, &mut self.hearing, self.tick);
            self.bus.deliver(|receiver, frame| {
                let Some(node) = nodes.get_mut(receiver).filter(|node| node.away.is_none()) else { return };
                hearing.hand(frame.from, receiver, frame.is_state, tick);
                match node.on_can {
                    None => node.link.queue(&frame.bytes),
                    Some(bus) if for_can.iter().any(|&(other, _)| other == bus) => {}
                    Some(bus) => for_can.push((bus, frame.bytes.clone())),
                }
            });
            for_can.iter().try_for_each(|(bus, frame)| self.relay_to_can(*bus, frame))?;
        }
        Ok(())
    }

    /// Waits for the initial state of a node, or for the fault that it may say instead, and puts it on the bus.
    fn take_announcement(&mut self, index: usize) -> Result<(), HubError> {
        let deadline = Deadline::after(self.patience.answer);
        if let Some(node) = self.nodes.get_mut(index) {
            node.states = 0;
        }
        while let Some(node) =
            self.nodes.get_mut(index).filter(|node| !node.stopped && !node.has_told_its_state())
        {
            node.check_patience(deadline, 0, "state")?;
            let message = match node.on_can {
                Some(_) => self.wait_on_can(index, deadline)?.0,
                None => node.link.wait_until(deadline.end, deadline.limit, "state", announcement)?,
            };
            self.take_message(index, message, 0);
        }
        Ok(())
    }

    /// Waits for everything that a node says about a tick: its state (of the tick after the one that ran) or a fault, perhaps an
    /// edge, and its telemetry, which ends it.
    fn take_tick(&mut self, index: usize, now: u64) -> Result<(), HubError> {
        let Some(node) = self.nodes.get_mut(index).filter(|node| !node.stopped && node.away.is_none()) else {
            return Ok(());
        };
        node.ticked = false;
        (node.states, node.telemetries, node.refused) = (0, 0, false);
        let state = node.next_state.clone();
        let deadline = Deadline::after(self.patience.answer);
        if node.on_can.is_some() {
            self.take_states_on_can(index, now, deadline)?;
        }
        loop {
            let Some(node) = self.nodes.get_mut(index) else { return Ok(()) };
            if node.stopped && !node.ticked {
                self.set_presence(index, Presence::Stopped);
                return Ok(());
            }
            let awaited = if node.ticked { "telemetry" } else { "state" };
            node.check_patience(deadline, self.tick, awaited)?;
            match node.link.wait_until(deadline.end, deadline.limit, awaited, Some)? {
                // A fault, which most often has been heard on the bus. A twin's state there may have been taken for the node's.
                Received::Message(message) if node.on_can.is_some() => {
                    if matches!(message, Message::Fault { .. }) && !node.stopped {
                        self.take_message(index, message, now);
                    }
                }
                Received::Message(message) => self.take_message(index, message, now),
                Received::Reply(Reply::Telemetry(telemetry)) => {
                    if self.take_telemetry(index, &state, &telemetry)? {
                        return Ok(());
                    }
                }
                Received::Reply(_) => {}
            }
        }
    }

    /// Waits for the states of a node on CAN, or for a fault.
    fn take_states_on_can(&mut self, index: usize, now: u64, deadline: Deadline) -> Result<(), HubError> {
        while let Some(node) =
            self.nodes.get(index).filter(|node| !node.stopped && !node.has_told_its_state())
        {
            node.check_patience(deadline, self.tick, "state on CAN")?;
            let (message, at) = self.wait_on_can(index, deadline)?;
            self.take_message(index, message, now);
            if let Some(stamps) = self.stamps.get_mut(index) {
                stamps.bus = at.duration_since(self.begin_on_bus).ok();
            }
        }
        Ok(())
    }

    /// Takes what a node says that it saw; whether that was all of the tick.
    fn take_telemetry(
        &mut self,
        index: usize,
        state: &[f32],
        telemetry: &Telemetry,
    ) -> Result<bool, HubError> {
        let (tick, component) = (self.tick, usize::from(telemetry.component));
        let Some(node) = self.nodes.get_mut(index) else { return Ok(true) };
        let id = node.link.id();
        if telemetry.tick != tick {
            return Err(HubError::OutOfStep { node: id, tick, found: telemetry.tick });
        }
        let measured = measure::refusal(telemetry, state.len());
        if let Some((what, value)) = &measured {
            self.doubts.note(id, what, tick, || value.clone());
            if component >= state.len() {
                return Ok(false);
            }
        }
        // Without its state nobody knows any more what it is.
        let lost = match () {
            () if !node.stopped && !node.has_told_its_state() => Some("state"),
            () if component != node.telemetries => Some("telemetry"),
            () => None,
        };
        if let Some(what) = lost {
            return Err(HubError::Lost { node: id, tick, what });
        }
        node.telemetries += 1;
        node.refused |= measured.is_some();
        let (is_last, refused) = (node.telemetries >= state.len(), node.refused);
        if let Some(stamps) = self.stamps.get_mut(index) {
            stamps.telemetry = Some(self.begin.elapsed());
        }
        // All nodes have as many components.
        let slot = self.observations.get_mut(index * state.len() + component);
        if let (Some(slot), Some(&x)) = (slot, state.get(component)) {
            slot.x = x;
            if measured.is_none() {
                *slot = observation(x, telemetry);
            }
        }
        if is_last && !refused {
            self.set_presence(index, Presence::Ran);
        }
        Ok(is_last)
    }

    fn take_message(&mut self, index: usize, message: Message, now: u64) {
        match message {
            Message::State { component, tick, x, .. } => {
                if !self.take_state(index, (tick, component, x), now) {
                    return;
                }
            }
            Message::Fault { code, severity, .. } => {
                if let Some(node) = self.nodes.get_mut(index).filter(|_| severity == Severity::Stopped) {
                    // Only these faults are the outcome of a tick, which the node has seen as any other.
                    node.ticked = matches!(
                        code,
                        FaultCode::STATE_LIMIT | FaultCode::FUNNEL_LEFT | FaultCode::NEIGHBOURS_LOST
                    );
                }
                self.note_fault(index, &message, now);
            }
            Message::Edge { neighbour, weight, .. } => self.check_weight(index, neighbour.get(), weight),
            Message::Ctrl { .. } | Message::Sync { .. } => return,
        }
        self.put_on_bus(index, message, now);
    }

    /// Takes a component of a state that is of the tick after the one that ends at `now`; whether it is.
    fn take_state(
        &mut self,
        index: usize,
        (stamp, component, x): (TickStamp, Component, f32),
        now: u64,
    ) -> bool {
        let Some(node) = self.nodes.get_mut(index) else { return false };
        let (id, tick) = (node.link.id(), self.tick);
        let due = now.checked_div(self.tick_ns).and_then(|due| u32::try_from(due).ok()).unwrap_or(0);
        if stamp.rebuild(due, 0, 0).is_none() {
            let value = || format!("the stamp {} where {due} was awaited", stamp.value());
            self.doubts.note(id, OTHER_TICK, tick, value);
            return false;
        }
        let Some(next) = node.next_state.get_mut(usize::from(component.get())) else {
            self.doubts.note(id, OTHER_COMPONENT, tick, || format!("state {}", component.get()));
            return false;
        };
        let bit = 1 << component.get();
        if node.states & bit != 0 && next.to_bits() != x.to_bits() {
            let value = format!("{next} and {x}");
            self.doubts.note(id, "sent two states of one tick", tick, || value);
        }
        *next = x;
        node.states |= bit;
        node.ticked = true;
        if let Some(stamps) = self.stamps.get_mut(index) {
            stamps.state = Some(self.begin.elapsed());
        }
        true
    }

    /// Compares a weight that a node announces with the one that it was given.
    fn check_weight(&mut self, index: usize, neighbour: u8, weight: f32) {
        let Some(node) = self.nodes.get(index) else { return };
        let own = node.config.neighbours.iter().find(|edge| edge.id == neighbour).map(|edge| edge.weight);
        if own != Some(weight) {
            let value = || match own {
                Some(own) => format!("{weight} for the edge to node {neighbour}, which has {own}"),
                None => format!("{weight} for an edge to node {neighbour}, which is none"),
            };
            self.doubts.note(node.link.id(), "announced another weight than it was given", self.tick, value);
        }
    }

    /// The whole tick of a frame, if it is anywhere near what is awaited from the node.
    fn rebuilt(&self, index: usize, stamp: TickStamp) -> Option<u32> {
        let telling = self.own.as_ref().map_or(self.tick, |own| own.telling(index));
        let awaited = telling.wrapping_add(1);
        stamp.rebuild(awaited, STAMP_REACH.min(awaited), STAMP_REACH)
    }

    /// Takes note of a FAULT: one that stopped the node, or a warning. A warning after a stop does not make it run again.
    fn note_fault(&mut self, index: usize, fault: &Message, now: u64) {
        let Message::Fault { code, severity, arg, tick, .. } = *fault else { return };
        let Some(node) = self.nodes.get_mut(index) else { return };
        let event = match severity {
            Severity::Stopped if node.stopped => return,
            Severity::Stopped => {
                node.stopped = true;
                Event::Fault(code)
            }
            Severity::Notice | Severity::Warning => {
                let low = tick.value() & u32::from(u8::MAX);
                if node.warned.replace((code, arg, low)) == Some((code, arg, low)) {
                    return;
                }
                self.warnings += 1;
                Event::Warned(code)
            }
        };
        self.events.push(NodeEvent { at: now, node: index, event });
    }

    /// A stamp of eight bits, from CAN, would be taken for a whole one by who reads sixteen, so what is relayed has its whole tick.
    fn put_on_bus(&mut self, index: usize, mut message: Message, now: u64) {
        if let Message::State { tick, .. } | Message::Fault { tick, .. } = &mut message {
            *tick = self.rebuilt(index, *tick).map_or(*tick, TickStamp::full);
        }
        let message = self.noise.disturb(index, message);
        let is_state = matches!(message, Message::State { .. });
        self.bus.send(now, index, Relayed { from: index, is_state, bytes: serial::encode(&message) });
    }
}

/// What a node does whose states are not of the tick that is awaited.
const OTHER_TICK: &str = "sent a state of another tick";
/// Ticks by which a clock may be ahead of this program's, and that a stop may take to be heard.
const CLOCK_SPARE: u64 = 4;
/// How far the tick of a frame may lie from the one that is awaited: less than half of what the 8 bits on CAN can tell.
const STAMP_REACH: u32 = 100;
/// Begins the run on every node.
const START: Message = Message::Ctrl { target: Target::All, command: Command::Start, arg: 0, at_tick: 0 };
/// Ends the run on every node.
const STOP: Message = Message::Ctrl { target: Target::All, command: Command::Stop, arg: 0, at_tick: 0 };

/// Whether the node behind `link` speaks this wire, and has the unique number `uid` if one is expected.
fn check_identity(link: &Link, identity: &Identity, uid: Option<u64>) -> Result<(), HubError> {
    let node = link.id();
    if identity.wire_version != WIRE_VERSION {
        return Err(HubError::WireVersion { node, found: identity.wire_version });
    }
    match uid.filter(|&uid| uid != identity.uid) {
        Some(expected) => {
            let place = link.place().to_owned();
            Err(HubError::Uid { node, place, expected, found: identity.uid })
        }
        None => Ok(()),
    }
}

/// Asks a node who it is, again and again, until it answers.
///
/// # Errors
/// No answer within `limit`, or the node is gone, or an interrupt.
pub fn identify(link: &mut Link, limit: Duration) -> Result<Identity, HubError> {
    ask_who(link, limit, |received| match received {
        Received::Reply(Reply::Identity(identity)) => Some(identity),
        _ => None,
    })
}

/// The same, for whoever takes more for an answer.
fn ask_who<T>(link: &mut Link, limit: Duration, pick: impl Fn(Received) -> Option<T>) -> Result<T, HubError> {
    let begin = Instant::now();
    loop {
        link.request(&Request::Hello)?;
        match link.wait_for(ASK_AGAIN.min(limit), "identity", &pick) {
            Err(HubError::NoAnswer { .. }) if begin.elapsed() < limit => {}
            Err(HubError::NoAnswer { node, awaited, .. }) => {
                return Err(HubError::NoAnswer { node, awaited, waited: limit });
            }
            answer => return answer,
        }
    }
}

fn report(received: Received) -> Option<Report> {
    match received {
        Received::Reply(Reply::Report(report)) => Some(report),
        _ => None,
    }
}

/// What a node answers to a start.
fn announcement(received: Received) -> Option<Message> {
    match received {
        Received::Message(message @ (Message::State { .. } | Message::Fault { .. })) => Some(message),
        _ => None,
    }
}
