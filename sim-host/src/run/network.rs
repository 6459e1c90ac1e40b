//! Networks of f32 nodes as a run drives them, whatever carries their frames.

use super::error::RunError;
use super::event_log::EventLog;
use crate::bus::Medium;
use crate::bus::Traffic;
use crate::bus::watch::Watch;
use crate::central::Central;
use crate::engine::Engine;
use crate::hub::Hub;
use crate::presence::Presence;
use crate::record::OnBus;
use funnelnet_law::field::VectorField;
use funnelnet_node::Observation;

/// Nodes that tick together.
pub(super) trait Network {
    /// Starts all nodes.
    fn start(&mut self) -> Result<(), RunError>;

    /// Runs the next tick of all nodes. Those that have stopped by themselves stay as they are.
    fn advance(&mut self) -> Result<(), RunError>;

    /// Observations of the nodes at their last tick, by index and then by component.
    fn observations(&self) -> &[Observation<f32>];

    /// Presence of each node at tick `k`, which was the last to run, by index.
    fn presence(&self, k: u64) -> Vec<Presence>;

    /// Tells `log` what the nodes reported since the last call.
    fn tell(&mut self, log: &mut EventLog);

    /// What was on its buses since the last call, as far as it is kept.
    fn take_heard(&mut self) -> Vec<OnBus> {
        Vec::new()
    }

    /// Frame counts so far.
    fn traffic(&self) -> Traffic;

    /// Part of the time so far for which the bus was busy; 0 without a bit rate.
    fn utilisation(&self) -> f64 {
        0.0
    }
}

/// Loopback: nodes on a bus in this program.
impl<M: Medium, V: VectorField<f32> + Clone> Network for Engine<M, V> {
    fn start(&mut self) -> Result<(), RunError> {
        Self::start(self);
        Ok(())
    }

    fn advance(&mut self) -> Result<(), RunError> {
        // `None` where all nodes have stopped by themselves: what they saw last stays.
        let _ = Self::advance(self);
        Ok(())
    }

    fn observations(&self) -> &[Observation<f32>] {
        self.observations()
    }

    fn presence(&self, k: u64) -> Vec<Presence> {
        self.presence(k)
    }

    fn tell(&mut self, log: &mut EventLog) {
        log.take(self.take_events());
    }

    fn take_heard(&mut self) -> Vec<OnBus> {
        let records = self.bus_mut().watched().map(Watch::take_records).unwrap_or_default();
        records.into_iter().map(|record| (0, record)).collect()
    }

    fn traffic(&self) -> Traffic {
        self.traffic()
    }

    fn utilisation(&self) -> f64 {
        self.utilisation()
    }
}

/// Weakly-centralised coupling: one loop over all nodes, without a bus.
impl Network for Central {
    fn start(&mut self) -> Result<(), RunError> {
        Ok(())
    }

    fn advance(&mut self) -> Result<(), RunError> {
        Self::advance(self);
        Ok(())
    }

    fn observations(&self) -> &[Observation<f32>] {
        self.observations()
    }

    fn presence(&self, _: u64) -> Vec<Presence> {
        self.presence()
    }

    fn tell(&mut self, log: &mut EventLog) {
        log.take(self.take_events());
    }

    fn traffic(&self) -> Traffic {
        Traffic::default()
    }
}

/// Emulated nodes and those of a bench: this program is their bus.
impl Network for Hub {
    fn start(&mut self) -> Result<(), RunError> {
        Ok(Self::start(self)?)
    }

    fn advance(&mut self) -> Result<(), RunError> {
        Self::advance(self).map(drop).map_err(RunError::in_the_run)
    }

    fn observations(&self) -> &[Observation<f32>] {
        self.conductor().observations()
    }

    fn presence(&self, _: u64) -> Vec<Presence> {
        self.conductor().presence().to_vec()
    }

    fn tell(&mut self, log: &mut EventLog) {
        // The conductor keeps them: a bench compares its faults with those of loopback.
        log.catch_up(self.conductor().events());
    }

    fn take_heard(&mut self) -> Vec<OnBus> {
        Self::take_heard(self).into_iter().map(|(bus, heard)| (bus, heard.record())).collect()
    }

    fn traffic(&self) -> Traffic {
        self.conductor().traffic()
    }
}
