//! The hub's logic: bytes and time come in as arguments, what is to be done comes out, and nothing here
//! waits, reads a clock or knows a port (docs/notes/2026-11-28-conductor.md). The [`Hub`](crate::hub::Hub)
//! does it on real lines; tests do it in virtual time.
//!
//! The link model is that of the loopback engine, frame by frame and draw by draw: states that nodes send at
//! tick `k` go on the bus at the time of tick `k`, and what arrives before tick `k + 1` is written to the
//! receivers before their next SYNC. So the same scenario gives the same bits (tests/tests/parity.rs), at the
//! pace of the slowest node. Nodes that tick by their own clock are carried in real time instead
//! (`own_clock`).

mod absence;
mod claims;
mod commission;
mod commits;
mod contact;
mod deadline;
mod doubles;
pub(crate) mod doubt;
mod error;
mod events;
mod finish;
mod halt;
mod hearing;
mod intake;
mod line;
mod lockstep;
pub(crate) mod measure;
mod member;
mod on_can;
mod own_clock;
mod own_presence;
mod own_sync;
pub(crate) mod recording;
mod shadow;
mod sound;
mod task;
mod update;
pub(crate) mod watch;

pub use absence::{Absence, OnLoss};
pub use commission::{Commission, Commissioned, Failed, Known};
pub use commits::Staged;
pub use contact::{Contact, Seat};
pub use error::HubError;
pub use halt::Halted;
pub use line::{Line, Received};
pub use on_can::{CanCounts, FrameBytes, Relayed};
pub use task::{Action, Source, Step, Task};
pub use update::{Update, Updated};

pub(crate) use task::Outside;

use crate::bus::Traffic;
use crate::bus::ideal::IdealBus;
use crate::engine::{Lies, NodeEvent, Scene};
use crate::noise::Noise;
use crate::presence::Presence;
use doubt::Doubts;
use events::Later;
use funnelnet_node::Observation;
use funnelnet_protocol::config::NodeConfig;
use funnelnet_protocol::message::{Command, Message, Target};
use funnelnet_protocol::report::{Report, Telemetry};
use funnelnet_protocol::serial;
use funnelnet_protocol::service::Identity;
use hearing::Hearing;
use member::Member;
use on_can::Bus;
use own_clock::OwnClock;
pub use own_sync::SyncCounts;
use std::collections::VecDeque;
use std::time::Duration;

/// What a node does that names a component which no state has.
pub(crate) const OTHER_COMPONENT: &str = "spoke of a component that its state does not have";
/// What a node does whose states are not of the tick that is awaited.
const OTHER_TICK: &str = "sent a state of another tick";
/// Begins the run on every node.
const START: Message = Message::Ctrl { target: Target::All, command: Command::Start, arg: 0, at_tick: 0 };
/// Ends the run on every node.
const STOP: Message = Message::Ctrl { target: Target::All, command: Command::Stop, arg: 0, at_tick: 0 };

/// How long nodes are waited for.
#[derive(Clone, Copy, Debug)]
pub struct Patience {
    /// To boot and say who they are.
    pub boot: Duration,
    /// For an answer or for a tick.
    pub answer: Duration,
}

/// When the host sent and read what belongs to a tick of a node, since the start. In lockstep the host reads
/// nodes in the order of their ids, so a time is at or after the arrival.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Stamps {
    /// Its SYNC was sent.
    pub sync: Option<Duration>,
    /// Its state was read.
    pub state: Option<Duration>,
    /// Its telemetry was read.
    pub telemetry: Option<Duration>,
    /// Its state was on CAN, by the kernel's clock.
    pub bus: Option<Duration>,
}

/// A network of nodes with this program in its middle.
pub struct Conductor {
    outside: Outside,
    nodes: Vec<Member>,
    bus: IdealBus<Relayed>,
    noise: Noise,
    /// Where events take nodes and links away.
    scene: Option<Scene>,
    /// Where nodes say what is not so.
    lies: Option<Box<Lies>>,
    /// What they say later, in the order of time.
    later: VecDeque<Later>,
    patience: Patience,
    on_loss: OnLoss,
    absences: Vec<Absence>,
    /// Indices of nodes that have lost what was staged in them before they were told to adopt it.
    missed_commits: Vec<usize>,
    tick_ns: u64,
    /// Tick that comes next.
    tick: u32,
    /// Time of the start, ns.
    begin: u64,
    /// The buses of nodes on CAN.
    can: Vec<Bus>,
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

impl Conductor {
    /// Of nodes in these seats; one configuration each.
    pub fn new(seats: Vec<Seat>, configs: &[NodeConfig], bus: IdealBus<Relayed>, patience: Patience) -> Self {
        let outside = Outside::default();
        let seats = seats.into_iter().zip(configs).enumerate();
        let nodes: Vec<_> =
            seats.map(|(index, (seat, config))| Member::new(index, seat, config, &outside)).collect();
        let states = configs.iter().flat_map(|config| config.initial_state.iter().copied());
        let observations = states.map(|x| Observation { x, ..Observation::default() }).collect();
        let count = nodes.len();
        Self {
            outside,
            nodes,
            bus,
            noise: Noise::default(),
            scene: None,
            lies: None,
            later: VecDeque::new(),
            patience,
            on_loss: OnLoss::default(),
            absences: Vec::new(),
            missed_commits: Vec::new(),
            tick_ns: configs.first().map_or(0, NodeConfig::period_ns),
            tick: 0,
            begin: 0,
            can: Vec::new(),
            settle: None,
            own: None,
            stamps: vec![Stamps::default(); count],
            observations,
            presence: vec![Presence::Unrecorded; count],
            events: Vec::new(),
            warnings: 0,
            doubts: Doubts::default(),
            hearing: Hearing::of(count),
        }
    }

    /// With noise on the states that nodes send.
    #[must_use]
    pub fn with_noise(self, noise: Noise) -> Self {
        Self { noise, ..self }
    }

    /// With lines between nodes, on which their states may take so long.
    #[must_use]
    pub fn with_wires(self, settle: Duration) -> Self {
        Self { settle: Some(settle), ..self }
    }

    /// Asks each node who it is, and, once all are who they should be, configures them.
    ///
    /// Its error: a node that does not answer in time, another wire version, another chip, a refused
    /// configuration.
    pub fn meet(&mut self) -> Task<'_, Result<(), HubError>> {
        let outside = self.outside.clone();
        Task::new(&outside, async move {
            self.identify().await?;
            self.configure().await
        })
    }

    /// Starts all nodes, and in lockstep takes their announced initial states.
    ///
    /// Its error: a node that does not answer or dies.
    pub fn start(&mut self) -> Task<'_, Result<(), HubError>> {
        let outside = self.outside.clone();
        Task::new(&outside, async move {
            if self.own.is_some() { self.start_clocks().await } else { self.announce().await }
        })
    }

    /// Runs one tick on every node, or waits until every node has run it.
    ///
    /// Its error: a node that does not answer or dies, clocks that run apart, or an interrupt.
    pub fn advance(&mut self) -> Task<'_, Result<(), HubError>> {
        let outside = self.outside.clone();
        Task::new(&outside, async move {
            let ran = if self.own.is_some() { self.carry_a_tick().await } else { self.run_tick().await };
            self.collect_doubts();
            ran
        })
    }

    /// Stops all nodes and takes their reports, by index; a node that is away has none.
    ///
    /// Its error: a node that does not answer or dies.
    pub fn finish(&mut self) -> Task<'_, Result<Vec<Option<Report>>, HubError>> {
        let outside = self.outside.clone();
        Task::new(&outside, async move {
            let stopped = self.stop().await;
            self.collect_doubts();
            stopped
        })
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

    /// FAULT frames that did not stop their node.
    pub fn warnings(&self) -> u64 {
        self.warnings
    }

    /// What nodes have said that cannot be so, a sentence each.
    pub fn contradictions(&self) -> Vec<String> {
        self.doubts.sentences()
    }

    /// The tick that comes next.
    pub fn next_tick(&self) -> u32 {
        self.tick
    }

    /// When the host sent and read what belongs to the last tick, by index.
    pub fn stamps(&self) -> &[Stamps] {
        &self.stamps
    }

    /// Those that were asked who they are, and what they have said, by index.
    pub fn members(&self) -> impl Iterator<Item = (&Contact, Identity)> {
        self.nodes.iter().filter_map(|node| Some((&node.contact, node.identity?)))
    }

    /// What came of a node that could not be read, and what it has said that cannot be so.
    pub(crate) fn words_of(&self, id: u8) -> Vec<String> {
        let contact = self.nodes.iter().map(|node| &node.contact).find(|contact| contact.id() == id);
        let refused = contact.map_or((0, None), Contact::refused);
        let unread = refused.1.map(|reason| {
            format!("frames from it that could not be read: {} (the last one: {})", refused.0, reason.name())
        });
        let sound = contact.and_then(Contact::sound);
        unread.into_iter().chain(sound).chain(self.doubts.of(id)).collect()
    }

    /// Since the start, ns.
    fn now_ns(&self) -> u64 {
        self.outside.now().saturating_sub(self.begin)
    }

    /// Since the start.
    fn since_start(&self) -> Duration {
        Duration::from_nanos(self.now_ns())
    }

    async fn identify(&mut self) -> Result<(), HubError> {
        for node in &mut self.nodes {
            node.identify(self.patience.boot).await?;
        }
        Ok(())
    }

    async fn configure(&mut self) -> Result<(), HubError> {
        for node in &mut self.nodes {
            if node.is_configured() {
                // Left over from another run, perhaps running still; then it would refuse.
                node.contact.write(&serial::encode(&STOP)).await?;
            }
            let config = node.config.clone();
            node.configure(&config, self.patience.answer).await?;
        }
        Ok(())
    }

    /// What is known of each node at a tick before it has said anything about it.
    fn note_presence(&mut self) {
        for (slot, node) in self.presence.iter_mut().zip(&self.nodes) {
            *slot = node.presence();
        }
    }

    fn set_presence(&mut self, index: usize, presence: Presence) {
        if let Some(slot) = self.presence.get_mut(index) {
            *slot = presence;
        }
    }
}

/// What a node saw at a tick: its state from the bus, the rest from its telemetry. The ratio is one f32
/// division, which has the same bits here and there.
pub(crate) fn observation(x: f32, telemetry: &Telemetry) -> Observation<f32> {
    let Telemetry { tick, nu, psi, u, .. } = *telemetry;
    Observation { tick, x, nu, psi, ratio: nu.abs() / psi, u }
}

#[cfg(test)]
mod guard;
#[cfg(test)]
mod tests;
