//! A node that is lost while the others go on, and its way back.
//!
//! A board that was unplugged has restarted, and its state is gone. It joins as law.md 5 says a node does
//! that integrates its own state: it adopts the weighted mean of its neighbours' states, where its own
//! diffusive term is zero; theirs jump by what the mean is from them. Its first SYNC tells it the tick.

use super::deadline::{Deadline, ns};
use super::member::Member;
use super::{Conductor, HubError, Received, START, STOP};
use crate::presence::Presence;
use funnelnet_protocol::config::NodeConfig;
use funnelnet_protocol::message::Message;
use funnelnet_protocol::serial;
use std::fmt;
use std::time::Duration;

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
    /// ns.
    next_look: u64,
}

impl Conductor {
    /// What to do when a node is lost from now on.
    #[must_use]
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
    pub(super) async fn lose(&mut self, index: usize, error: HubError) -> Result<(), HubError> {
        self.lose_from(index, error, self.tick).await?;
        self.set_presence(index, Presence::Absent);
        Ok(())
    }

    /// The same of a node that has missed no tick before `from`.
    ///
    /// # Errors
    /// As [`Self::lose`].
    pub(super) async fn lose_from(
        &mut self,
        index: usize,
        error: HubError,
        from: u32,
    ) -> Result<(), HubError> {
        let alone = self.nodes.iter().enumerate().all(|(other, node)| other == index || !node.is_here());
        if self.on_loss == OnLoss::Stop || alone || matches!(error, HubError::Interrupted) {
            return Err(error);
        }
        let why = error.to_string();
        let Some(node) = self.nodes.get_mut(index) else { return Err(error) };
        if matches!(error, HubError::Died { .. }) {
            // A port that is gone keeps its name from the board that comes back, until it is closed.
            node.contact.close().await?;
        }
        if let Some(commit) = &mut node.commit {
            commit.lose_sight();
        }
        node.away = Some(Away { next_look: self.outside.now().saturating_add(ns(LOOK_EVERY)) });
        self.absences.push(Absence { node: node.contact.id(), from, to: None, why });
        Ok(())
    }

    /// Looks for those who are away, where that is due.
    ///
    /// # Errors
    /// An interrupt.
    pub(super) async fn look_for_lost(&mut self) -> Result<(), HubError> {
        for index in 0..self.nodes.len() {
            let now = self.outside.now();
            let Some(node) = self.nodes.get_mut(index) else { continue };
            let Some(away) = node.away.as_mut().filter(|away| away.next_look <= now) else { continue };
            away.next_look = now.saturating_add(ns(LOOK_EVERY));
            match self.bring_back(index).await {
                Ok(()) => self.end_absence(index),
                Err(HubError::Interrupted) => return Err(HubError::Interrupted),
                Err(_) => {}
            }
        }
        Ok(())
    }

    /// Takes note that a node is not lost any more.
    pub(super) fn end_absence(&mut self, index: usize) {
        let Some(node) = self.nodes.get_mut(index) else { return };
        node.away = None;
        let (id, tick) = (node.contact.id(), self.tick);
        if let Some(absence) = self.absences.iter_mut().rev().find(|absence| absence.node == id) {
            absence.to = Some(tick);
        }
    }

    /// Finds the node, configures and starts it.
    async fn bring_back(&mut self, index: usize) -> Result<(), HubError> {
        let Some(config) = self.config_to_join(index) else { return Ok(()) };
        self.forget_heard(index).await?;
        let patience = self.patience;
        let Some(node) = self.nodes.get_mut(index) else { return Ok(()) };
        node.contact.reopen().await?;
        node.identify(LOOK).await?;
        // It may have been running on, without anybody to listen to it.
        node.contact.write(&serial::encode(&STOP)).await?;
        node.configure(&config, patience.answer).await?;
        node.contact.write(&serial::encode(&START)).await?;
        node.stopped = false;
        node.next_state = config.initial_state.to_vec();
        let deadline = Deadline::after(patience.answer, self.outside.now());
        if node.on_can.is_some() {
            // Stamped tick 0, which nobody could use any more.
            for _ in &config.initial_state {
                self.wait_on_can(index, deadline).await?;
            }
            return Ok(());
        }
        let (mut left, mut faults) = (config.initial_state.len(), Vec::new());
        let pick = |received| {
            match received {
                Received::Message(Message::State { .. }) => left = left.saturating_sub(1),
                // Why it was restarted, for example.
                Received::Message(message @ Message::Fault { .. }) => faults.push(message),
                _ => {}
            }
            (left == 0).then_some(())
        };
        let announced = node.contact.wait_until(deadline, "state", pick).await;
        self.note_warnings(index, &faults);
        announced
    }

    /// Its configuration, with the weighted mean of its neighbours' states as its own; without neighbours,
    /// its last one.
    fn config_to_join(&self, index: usize) -> Option<NodeConfig> {
        let node = self.nodes.get(index)?;
        let mut config = node.config.clone();
        let present = |id: u8| {
            self.nodes.iter().find(|other| other.contact.id() == id && other.is_here() && !other.stopped)
        };
        let neighbours: Vec<_> = config
            .neighbours
            .iter()
            .filter_map(|edge| Some((f64::from(edge.weight), present(edge.id)?)))
            .collect();
        let total: f64 = neighbours.iter().map(|(weight, _)| weight).sum();
        for (component, x) in config.initial_state.iter_mut().enumerate() {
            let state = |node: &Member| node.next_state.get(component).copied().unwrap_or_default();
            let sum: f64 = neighbours.iter().map(|(weight, other)| weight * f64::from(state(other))).sum();
            *x = if total > 0.0 { (sum / total) as f32 } else { state(node) };
        }
        Some(config)
    }
}
