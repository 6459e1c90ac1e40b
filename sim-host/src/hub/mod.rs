//! Nodes behind streams of bytes, with this program as the bus between them: it relays their frames and makes
//! them tick.
//!
//! What is said to whom and when is the [conductor](crate::conductor)'s. Here are what it has not: lines,
//! devices, CAN interfaces, the threads that read, the clock, and the user's wish to stop.

mod can;
mod commission;
mod link;
mod outlets;
mod readers;
mod talk;
mod update;

pub use crate::conductor::{
    Absence, CanCounts, Commissioned, Contact, Failed, FrameBytes, Halted, HubError, Known, OnLoss, Patience,
    Received, Relayed, Staged, Stamps, Updated,
};
pub use can::CanSide;
pub use commission::Commissioning;
pub use link::{Link, SLICE, Stream};
pub use talk::Talk;
pub use update::{Trial, UpdateStage, Updating};

use crate::bus::ideal::IdealBus;
use crate::can::Heard;
use crate::conductor::{Conductor, Task};
use crate::engine::{Lies, Scene};
use crate::noise::Noise;
use funnelnet_node::Observation;
use funnelnet_protocol::config::NodeConfig;
use funnelnet_protocol::report::Report;
use outlets::Outlets;
use std::time::Duration;

/// How long a node that reads nothing may hold up the stop of the others.
const STOP_WRITE: Duration = Duration::from_millis(100);

/// What a node runs on.
pub trait Device {
    /// What there is to say about a failure of the node, a line each; `ended` where its line is gone.
    fn last_words(&mut self, ended: bool) -> Vec<String>;

    /// Opens the line of a device anew that was gone, such as a board that has been plugged in again; `None`
    /// where there is nothing to open.
    fn reopen(&mut self) -> Option<Box<dyn Stream>> {
        None
    }

    /// Switches it off, or starts it anew as after power-on, and gives its line then; `None` where this
    /// program does not have its power.
    ///
    /// # Errors
    /// It does not start.
    fn switch(&mut self, _on: bool) -> Result<Option<Box<dyn Stream>>, HubError> {
        Ok(None)
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

/// A network of nodes with this program in its middle.
pub struct Hub {
    conductor: Conductor,
    outlets: Outlets,
}

impl Hub {
    /// Asks each node who it is, and, once all are who they should be, configures them; one node per
    /// configuration.
    ///
    /// # Errors
    /// A node that does not answer in time, another wire version, another chip, a refused configuration.
    pub fn new(
        attached: Vec<Attached>,
        configs: &[NodeConfig],
        bus: IdealBus<Relayed>,
        patience: Patience,
    ) -> Result<Self, HubError> {
        let (seats, outlets) = Outlets::of(attached);
        let mut hub = Self { conductor: Conductor::new(seats, configs, bus, patience), outlets };
        hub.run(Conductor::meet)?;
        Ok(hub)
    }

    /// With noise on the states that nodes send.
    pub fn with_noise(self, noise: Noise) -> Self {
        Self { conductor: self.conductor.with_noise(noise), ..self }
    }

    /// With lines between nodes, on which their states may take so long.
    pub fn with_wires(self, settle: Duration) -> Self {
        Self { conductor: self.conductor.with_wires(settle), ..self }
    }

    /// With events that take nodes and links away and bring them back, and with nodes that say what is not so.
    pub fn with_events(self, scene: Option<Scene>, lies: Option<Box<Lies>>) -> Self {
        Self { conductor: self.conductor.with_events(scene, lies), ..self }
    }

    /// With configurations that nodes adopt while they run, by index.
    pub fn with_staged(self, staged: Vec<Option<Staged>>) -> Self {
        Self { conductor: self.conductor.with_staged(staged), ..self }
    }

    /// What to do when a node is lost from now on.
    pub fn with_loss(self, on_loss: OnLoss) -> Self {
        Self { conductor: self.conductor.with_loss(on_loss), ..self }
    }

    /// With nodes that tick by their own clock.
    pub fn with_own_clock(self) -> Self {
        Self { conductor: self.conductor.with_own_clock(), ..self }
    }

    /// With time masters among nodes that tick by their own clock; `silences` are from and to when SYNC of a node is
    /// not carried, by index, ns since the start.
    pub fn with_sync(self, silences: Vec<Vec<(u64, u64)>>) -> Self {
        Self { conductor: self.conductor.with_sync(silences), ..self }
    }

    /// With these buses; `on_can` says which of them a node is on, both by index.
    pub fn with_can(self, sides: Vec<CanSide>, on_can: impl Fn(usize) -> Option<usize>) -> Self {
        let interfaces = sides.iter().map(CanSide::interface).collect();
        let (conductor, mut outlets) = (self.conductor.with_can(interfaces, on_can), self.outlets);
        outlets.set_buses(sides);
        Self { conductor, outlets }
    }

    /// Stages what nodes adopt while they run, starts all of them, and in lockstep takes their announced initial states.
    ///
    /// # Errors
    /// A node that does not stage what it is given, does not answer or dies.
    pub fn start(&mut self) -> Result<(), HubError> {
        self.run(Conductor::stage)?;
        if self.conductor.has_own_clock() {
            self.outlets.start_readers().map_err(|error| self.explain(error))?;
        }
        self.outlets.compare_clocks();
        self.run(Conductor::start)
    }

    /// Runs one tick on every node, or waits until every node has run it, and gives what they saw, by index
    /// and then by component.
    ///
    /// # Errors
    /// A node that does not answer or dies, clocks that run apart, or an interrupt.
    pub fn advance(&mut self) -> Result<&[Observation<f32>], HubError> {
        self.run(Conductor::advance)?;
        Ok(self.conductor.observations())
    }

    /// Stops all nodes and takes their reports, by index; a node that is away has none.
    ///
    /// # Errors
    /// A node that does not answer or dies.
    pub fn finish(&mut self) -> Result<Vec<Option<Report>>, HubError> {
        self.run(Conductor::finish)
    }

    /// Tells all nodes to stop, first, and only then waits for each to confirm it, a second at most for all
    /// of them.
    pub fn halt(&mut self) -> Halted {
        self.outlets.hurry(STOP_WRITE);
        self.outlets.run(self.conductor.halt())
    }

    /// What the nodes have said and done.
    pub fn conductor(&self) -> &Conductor {
        &self.conductor
    }

    /// What was heard on CAN since the last call, with the index of the bus; in order of bus time, those of
    /// one bus in the order in which they came.
    pub fn take_heard(&mut self) -> Vec<(usize, Heard)> {
        self.outlets.take_heard()
    }

    /// Ends all devices and gives the logs that this program has: id and text.
    pub fn into_logs(self) -> Vec<(u8, String)> {
        self.outlets.into_logs()
    }

    fn run<T>(
        &mut self,
        task: impl FnOnce(&mut Conductor) -> Task<'_, Result<T, HubError>>,
    ) -> Result<T, HubError> {
        let done = self.outlets.run(task(&mut self.conductor));
        done.map_err(|error| self.explain(error))
    }

    /// Adds to an error what there is to say about the node that it names.
    fn explain(&mut self, error: HubError) -> HubError {
        let Some(id) = error.node() else { return error };
        let Some(mut words) = self.outlets.last_words(id, &error) else { return error };
        words.extend(self.conductor.words_of(id));
        error.with_words(words.join("\n"))
    }
}
