//! A node that is lost while the others go on, and its way back.
//!
//! A board that was unplugged has restarted, and its state is gone. It joins as LAW.md 5 says a node does that integrates its own state: it
//! adopts the weighted mean of its neighbours' states, where its own diffusive term is zero; theirs jump by what the mean is from them.
//! Its first SYNC tells it the tick.

use super::{Deadline, Hub, HubError, HubNode, Received, START, STOP, identify};
use crate::presence::Presence;
use funnelnet_protocol::config::NodeConfig;
use funnelnet_protocol::message::Message;
use funnelnet_protocol::serial;
use std::fmt;
use std::time::{Duration, Instant};

/// How often a lost node is looked for.
const LOOK_EVERY: Duration = Duration::from_millis(500);
/// How long each look may take from the others.
const LOOK: Duration = Duration::from_millis(100);

/// What happens when a node is lost during a run.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum OnLoss {
    /// The run ends, and all nodes are stopped.
    #[default]
    Stop,
    /// The others go on, and the node may come back.
    GoOn,
}

/// The time that a node was away.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Absence {
    /// Its id.
    pub node: u8,
    /// First tick that it has missed.
    pub from: u32,
    /// First tick that it took part in again.
    pub to: Option<u32>,
    /// Why it was given up.
    pub why: String,
}

impl fmt::Display for Absence {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { node, from, to, why } = self;
        match to {
            Some(to) => write!(f, "node {node} is back at tick {to}, after {} ticks", to.wrapping_sub(*from)),
            None => write!(f, "node {node} is lost at tick {from}, the others go on: {why}"),
        }
    }
}

/// That a node is away, and when it is looked for next.
pub(super) struct Away {
    next_look: Instant,
}

impl Hub {
    /// What to do when a node is lost from now on.
    pub fn with_loss(self, on_loss: OnLoss) -> Self {
        Self { on_loss, ..self }
    }

    /// The absences so far, in the order in which they began.
    pub fn absences(&self) -> &[Absence] {
        &self.absences
    }

    /// Gives up a node that failed, where the others can go on without it.
    ///
    /// # Errors
    /// The error itself, where the run has to end.
    pub(super) fn lose(&mut self, index: usize, error: HubError) -> Result<(), HubError> {
        let alone = self.nodes.iter().enumerate().all(|(other, node)| other == index || node.away.is_some());
        if self.on_loss == OnLoss::Stop || alone || matches!(error, HubError::Interrupted) {
            return Err(error);
        }
        let why = error.to_string();
        let Some(node) = self.nodes.get_mut(index) else { return Err(error) };
        if matches!(error, HubError::Died { .. }) {
            // A port that is gone keeps its name from the board that comes back, until it is closed.
            node.link.replace(Box::new(std::io::empty()));
        }
        node.away = Some(Away { next_look: Instant::now() + LOOK_EVERY });
        self.absences.push(Absence { node: node.link.id(), from: self.tick, to: None, why });
        self.set_presence(index, Presence::Absent);
        Ok(())
    }

    /// Looks for those who are away, where that is due.
    ///
    /// # Errors
    /// An interrupt.
    pub(super) fn look_for_lost(&mut self) -> Result<(), HubError> {
        for index in 0..self.nodes.len() {
            let Some(node) = self.nodes.get_mut(index) else { continue };
            let Some(away) = node.away.as_mut().filter(|away| away.next_look <= Instant::now()) else {
                continue;
            };
            away.next_look = Instant::now() + LOOK_EVERY;
            match self.bring_back(index) {
                Ok(()) => self.note_return(index),
                Err(HubError::Interrupted) => return Err(HubError::Interrupted),
                Err(_) => {}
            }
        }
        Ok(())
    }

    fn note_return(&mut self, index: usize) {
        let Some(node) = self.nodes.get_mut(index) else { return };
        node.away = None;
        let (id, tick) = (node.link.id(), self.tick);
        if let Some(absence) = self.absences.iter_mut().rev().find(|absence| absence.node == id) {
            absence.to = Some(tick);
        }
    }

    /// Finds the node, configures and starts it.
    fn bring_back(&mut self, index: usize) -> Result<(), HubError> {
        let Some(config) = self.config_to_join(index) else { return Ok(()) };
        self.forget_heard(index)?;
        let patience = self.patience;
        let Some(node) = self.nodes.get_mut(index) else { return Ok(()) };
        if let Some(stream) = node.device.reopen() {
            node.link.replace(stream);
        }
        let identity = identify(&mut node.link, LOOK)?;
        node.meet(identity)?;
        // It may have been running on, without anybody to listen to it.
        node.link.write(&serial::encode(&STOP))?;
        node.configure(&config, patience.answer)?;
        node.link.write(&serial::encode(&START))?;
        node.stopped = false;
        node.next_state = config.initial_state.to_vec();
        let deadline = Deadline::after(patience.answer);
        if node.on_can.is_some() {
            // Stamped tick 0, which nobody could use any more.
            return (0..config.initial_state.len())
                .try_for_each(|_| self.wait_on_can(index, deadline).map(|_| ()));
        }
        let (mut left, mut faults) = (config.initial_state.len(), Vec::new());
        let announced = node.link.wait_for(patience.answer, "state", |received| {
            match received {
                Received::Message(Message::State { .. }) => left = left.saturating_sub(1),
                // Why it was restarted, for example.
                Received::Message(message @ Message::Fault { .. }) => faults.push(message),
                _ => {}
            }
            (left == 0).then_some(())
        });
        self.note_warnings(index, &faults);
        announced
    }

    /// Its configuration, with the weighted mean of its neighbours' states as its own; without neighbours, its last one.
    fn config_to_join(&self, index: usize) -> Option<NodeConfig> {
        let node = self.nodes.get(index)?;
        let mut config = node.config.clone();
        let present = |id: u8| {
            self.nodes.iter().find(|other| other.link.id() == id && other.away.is_none() && !other.stopped)
        };
        let neighbours: Vec<_> = config
            .neighbours
            .iter()
            .filter_map(|edge| Some((f64::from(edge.weight), present(edge.id)?)))
            .collect();
        let total: f64 = neighbours.iter().map(|(weight, _)| weight).sum();
        for (component, x) in config.initial_state.iter_mut().enumerate() {
            let state = |node: &HubNode| node.next_state.get(component).copied().unwrap_or_default();
            let sum: f64 = neighbours.iter().map(|(weight, other)| weight * f64::from(state(other))).sum();
            *x = if total > 0.0 { (sum / total) as f32 } else { state(node) };
        }
        Some(config)
    }
}
