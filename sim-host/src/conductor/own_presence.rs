//! Nodes with clocks of their own that events take off and bring back. Nothing here waits: the others tick on, and
//! their frames have to be carried meanwhile.
//!
//! A node that comes is asked who it is, configured, and told to join. Its tick it learns from a time master.

use super::contact::TIMES;
use super::deadline::{Deadline, ns};
use super::events::target;
use super::member::check_identity;
use super::{Conductor, HubError};
use crate::engine::NodeEvent;
use crate::scenario::Change;
use funnelnet_node::Event;
use funnelnet_protocol::message::{Command, FaultCode, JOIN, Message, Severity};
use funnelnet_protocol::serial;
use funnelnet_protocol::service::{Reply, Request};
use std::time::Duration;

/// Periods of SYNC within which a node that has been told to join learns the tick: a new master sends its first one
/// after three, and it takes three SYNC to know two instants.
const PERIODS: u32 = 8;

/// What is awaited of a node that comes or goes.
#[derive(Clone, Copy, Debug)]
pub(super) enum Passing {
    /// It has been told to leave at that time, ns, and says goodbye.
    Leaves(u64, Deadline),
    /// It has been asked who it is; when it is asked again, ns.
    Identity(Deadline, u64),
    /// It has been given its configuration; when it is given it again, ns.
    Configured(Deadline, u64),
    /// It has been told to join.
    Joins(Deadline),
}

impl Conductor {
    /// Makes a change of who is there.
    pub(super) async fn change_own(&mut self, change: Change, at: u64) -> Result<(), HubError> {
        match change {
            Change::Off { node, told } => self.take_off_own(node, told, at).await?,
            Change::On { node } => self.bring_own(node).await?,
            Change::Cut(..) | Change::Mend(..) => {}
        }
        if let Some(scene) = &mut self.scene {
            scene.make(change);
        }
        Ok(())
    }

    async fn take_off_own(&mut self, index: usize, told: bool, at: u64) -> Result<(), HubError> {
        // Before the start nobody is there to be told, and one that waits for its tick has not begun.
        let runs = self.nodes.get(index).is_some_and(|node| node.is_here() && !node.stopped);
        let says_so = told && at > 0 && runs && !self.is_coming(index);
        if !says_so {
            self.take_power(index).await?;
            return self.leave_own(index);
        }
        let deadline = Deadline::after(self.patience.answer, self.outside.now());
        if let Some(node) = self.nodes.get_mut(index) {
            let stop = Message::Ctrl {
                target: target(node.contact.id()),
                command: Command::Stop,
                arg: 0,
                at_tick: 0,
            };
            node.contact.queue(&serial::encode(&stop));
            node.contact.flush().await?;
        }
        self.pass(index, Some(Passing::Leaves(at, deadline)));
        Ok(())
    }

    /// From now on it is not there, and nothing is awaited of it.
    fn leave_own(&mut self, index: usize) -> Result<(), HubError> {
        if let Some(own) = &mut self.own {
            let telling = own.telling(index);
            own.recording.leave(index);
            self.take_as_adopted(index, telling);
        }
        self.pass(index, None);
        self.forget(index);
        Ok(())
    }

    async fn bring_own(&mut self, index: usize) -> Result<(), HubError> {
        if let Some(Passing::Leaves(..)) = self.passing(index) {
            self.leave_own(index)?;
        }
        self.forget_heard_own(index);
        let is_on = self.outside.switch(index, true).await?;
        let Some(node) = self.nodes.get_mut(index) else { return Ok(()) };
        if is_on {
            node.contact.forget();
        }
        node.contact.request(&Request::Hello).await?;
        let now = self.outside.now();
        let again = now.saturating_add(ns(self.patience.answer / TIMES));
        self.pass(index, Some(Passing::Identity(Deadline::after(self.patience.boot, now), again)));
        Ok(())
    }

    /// Takes a goodbye, or the fault by which a node that was told to leave has stopped before it; whether it is one.
    pub(super) fn take_goodbye(&mut self, index: usize, fault: &Message, now: u64) -> Result<bool, HubError> {
        let (Some(Passing::Leaves(at, _)), Message::Fault { code, severity, .. }) =
            (self.passing(index), fault)
        else {
            return Ok(false);
        };
        match *code {
            // It runs on after a warning, and its goodbye is to come.
            _ if *severity != Severity::Stopped => return Ok(false),
            FaultCode::LEAVES => self.events.push(NodeEvent { at, node: index, event: Event::Stopped }),
            _ => self.note_fault(index, fault, now),
        }
        self.put_on_bus(index, *fault, now);
        self.leave_own(index)?;
        Ok(true)
    }

    /// Takes what a node that comes answers.
    pub(super) async fn take_answer(&mut self, index: usize, reply: Reply) -> Result<(), HubError> {
        let now = self.outside.now();
        let again = now.saturating_add(ns(self.patience.answer / TIMES));
        let passing = self.passing(index);
        let answer = self.patience.answer;
        let Some(node) = self.nodes.get_mut(index) else { return Ok(()) };
        match (passing, reply) {
            (Some(Passing::Identity(..)), Reply::Identity(identity)) => {
                node.identity = Some(identity);
                check_identity(&node.contact, &identity, node.uid())?;
                node.contact.request(&Request::Configure(node.config.clone())).await?;
                self.pass(index, Some(Passing::Configured(Deadline::after(answer, now), again)));
                Ok(())
            }
            (Some(Passing::Configured(..)), Reply::Configured(answer)) => {
                let refused = |reason| HubError::Refused { node: node.config.id, reason };
                answer.map_err(|reason| refused(reason).on_reading(&node.config))?;
                self.start_joining(index).await
            }
            _ => Ok(()),
        }
    }

    async fn start_joining(&mut self, index: usize) -> Result<(), HubError> {
        let now = self.outside.now();
        let answer = self.patience.answer;
        let Some(node) = self.nodes.get_mut(index) else { return Ok(()) };
        node.contact.expect_its_own();
        let target = target(node.config.id);
        let start = Message::Ctrl { target, command: Command::Start, arg: 0, at_tick: JOIN };
        node.contact.write(&serial::encode(&start)).await?;
        node.begin_anew();
        let period = Duration::from_micros(node.config.time.period_us.into());
        self.hearing.forget(index);
        if let Some(own) = &mut self.own {
            own.recording.come(index);
        }
        self.pass(index, Some(Passing::Joins(Deadline::after(answer + period * PERIODS, now))));
        Ok(())
    }

    /// Asks again, and gives up, where that is due.
    pub(super) async fn go_on_passing(&mut self) -> Result<(), HubError> {
        let now = self.outside.now();
        for index in 0..self.nodes.len() {
            let Some(passing) = self.passing(index) else { continue };
            let again = now.saturating_add(ns(self.patience.answer / TIMES));
            let Some(node) = self.nodes.get_mut(index) else { continue };
            let (deadline, awaited) = match passing {
                Passing::Leaves(_, deadline) => (deadline, "goodbye"),
                Passing::Identity(deadline, at) => {
                    if now >= at {
                        node.contact.request(&Request::Hello).await?;
                        self.pass(index, Some(Passing::Identity(deadline, again)));
                    }
                    (deadline, "identity")
                }
                Passing::Configured(deadline, at) => {
                    if now >= at {
                        node.contact.request(&Request::Configure(node.config.clone())).await?;
                        self.pass(index, Some(Passing::Configured(deadline, again)));
                    }
                    (deadline, "configured")
                }
                Passing::Joins(_) if !self.is_coming(index) => {
                    self.pass(index, None);
                    continue;
                }
                Passing::Joins(deadline) => (deadline, "tick by the SYNC of a time master"),
            };
            if deadline.is_over(now) {
                let node = self.nodes.get(index).map_or(0, |node| node.contact.id());
                return Err(HubError::NoAnswer { node, awaited, waited: deadline.limit });
            }
        }
        Ok(())
    }

    /// Whether a node has been told to join and has not told of a tick, or of its end, yet.
    pub(super) fn is_coming(&self, index: usize) -> bool {
        let stopped = self.nodes.get(index).is_some_and(|node| node.stopped);
        !stopped && self.own.as_ref().is_some_and(|own| own.recording.is_coming(index))
    }

    fn passing(&self, index: usize) -> Option<Passing> {
        *self.own.as_ref()?.passing.get(index)?
    }

    fn pass(&mut self, index: usize, passing: Option<Passing>) {
        if let Some(slot) = self.own.as_mut().and_then(|own| own.passing.get_mut(index)) {
            *slot = passing;
        }
    }

    /// Forgets what a node has said on CAN before it came.
    fn forget_heard_own(&mut self, index: usize) {
        while self.next_on_its_bus(index).is_some() {}
    }
}
