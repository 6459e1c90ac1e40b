//! Nodes that tick by SYNC, which this program says once all are through with the tick before.

use super::deadline::{Deadline, ns};
use super::on_can::{FrameBytes, is_fault};
use super::shadow::Shadow;
use super::task::Action;
use super::{Conductor, HubError, Received, START, Stamps, measure, observation};
use crate::presence::Presence;
use funnelnet_protocol::message::{Message, TickStamp};
use funnelnet_protocol::report::Telemetry;
use funnelnet_protocol::serial;
use funnelnet_protocol::service::Reply;
use std::time::Duration;

impl Conductor {
    pub(super) async fn announce(&mut self) -> Result<(), HubError> {
        self.begin = self.outside.now();
        self.begin_events().await?;
        // Who has come before the start was started so.
        let starts: Vec<bool> =
            (0..self.nodes.len()).map(|index| self.is_on(index) && !self.has_come(index)).collect();
        self.say_on_can(&START).await?;
        for (node, _) in
            self.nodes.iter_mut().zip(&starts).filter(|(node, starts)| **starts && node.on_can.is_none())
        {
            node.contact.write(&serial::encode(&START)).await?;
        }
        for (index, _) in starts.iter().enumerate().filter(|(_, starts)| **starts) {
            self.take_announcement(index).await?;
        }
        Ok(())
    }

    pub(super) async fn run_tick(&mut self) -> Result<(), HubError> {
        // As in loopback, nothing is delivered any more once all nodes have stopped by themselves, but where
        // events may happen.
        if self.scene.is_some() || self.nodes.iter().any(|node| !node.stopped) {
            self.look_for_lost().await?;
            let now = (u64::from(self.tick) + 1) * self.tick_ns;
            self.happen(now).await?;
            self.note_presence();
            self.deliver_before(now).await?;
            self.settle().await?;
            self.say_on_can(&self.sync()).await?;
            for index in 0..self.nodes.len() {
                if let Err(error) = self.send_sync(index).await {
                    self.lose(index, error).await?;
                }
            }
            for index in 0..self.nodes.len() {
                if let Err(error) = self.take_tick(index, now).await {
                    self.lose(index, error).await?;
                }
            }
            self.commit().await?;
        } else {
            self.note_presence();
        }
        // Those of this tick.
        self.collect_doubts();
        self.tick += 1;
        Ok(())
    }

    /// Leaves states their time on lines from node to node. What this program relays goes out before, too: a
    /// SYNC that one node passes on to another must not overtake it.
    async fn settle(&mut self) -> Result<(), HubError> {
        let Some(settle) = self.settle else { return Ok(()) };
        for index in 0..self.nodes.len() {
            let Some(node) = self.nodes.get_mut(index).filter(|node| node.is_here()) else { continue };
            if let Err(error) = node.contact.flush().await {
                self.lose(index, error).await?;
            }
        }
        let until = self.outside.now().saturating_add(ns(settle));
        self.outside.act(Action::Wait { until }).await
    }

    /// What makes the nodes tick.
    fn sync(&self) -> Message {
        let previous_tick = TickStamp::full(self.tick.wrapping_sub(1));
        Message::Sync { source: None, previous_tick, phase_us: 0 }
    }

    /// Writes what is queued for a node, and a SYNC if it runs and is on no CAN.
    async fn send_sync(&mut self, index: usize) -> Result<(), HubError> {
        let since_start = self.since_start();
        let sync = self.sync();
        let encoded = serial::encode(&sync);
        let (Some(node), Some(stamps)) = (self.nodes.get_mut(index), self.stamps.get_mut(index)) else {
            return Ok(());
        };
        *stamps = Stamps::default();
        if !node.is_here() {
            return Ok(());
        }
        if !node.stopped {
            if node.on_can.is_none() {
                node.contact.queue(&encoded);
            }
            if let Some(shadow) = &mut node.shadow {
                shadow.take(&sync);
            }
            stamps.sync = Some(since_start);
        }
        node.contact.flush().await
    }

    /// Hands over the frames that arrive before `now`, those among them that are said until then.
    pub(super) async fn deliver_before(&mut self, now: u64) -> Result<(), HubError> {
        loop {
            // What is said at a time goes before what arrives then.
            let until = self.next_later().map_or(now, |at| at.min(now));
            self.hand_over_before(until).await?;
            if until == now {
                return Ok(());
            }
            self.say_later();
        }
    }

    async fn hand_over_before(&mut self, now: u64) -> Result<(), HubError> {
        while self.bus.next_arrival().is_some_and(|at| at < now) {
            // Several receivers on a bus are one.
            let mut for_can: Vec<(usize, FrameBytes)> = Vec::new();
            let (nodes, hearing, tick) = (&mut self.nodes, &mut self.hearing, self.tick);
            self.bus.deliver(|receiver, frame| {
                let Some(node) = nodes.get_mut(receiver).filter(|node| node.is_here()) else { return };
                hearing.hand(frame.from, receiver, frame.is_state, tick);
                if let Some(shadow) = &mut node.shadow {
                    shadow.hear(&frame.bytes);
                }
                match node.on_can {
                    None => node.contact.queue(&frame.bytes),
                    Some(bus) if for_can.iter().any(|&(other, _)| other == bus) => {}
                    Some(bus) => for_can.push((bus, frame.bytes.clone())),
                }
            });
            for (bus, frame) in &for_can {
                self.relay_to_can(*bus, frame).await?;
            }
        }
        Ok(())
    }

    /// Waits for the initial state of a node, or for the fault that it may say instead, and puts it on the
    /// bus.
    async fn take_announcement(&mut self, index: usize) -> Result<(), HubError> {
        let deadline = Deadline::after(self.patience.answer, self.outside.now());
        if let Some(node) = self.nodes.get_mut(index) {
            node.states = 0;
        }
        while let Some(node) =
            self.nodes.get_mut(index).filter(|node| !node.stopped && !node.has_told_its_state())
        {
            node.contact.check_patience(deadline, 0, "state")?;
            let message = match node.on_can {
                Some(_) => self.wait_on_can(index, deadline).await?.0,
                None => node.contact.wait_until(deadline, "state", announcement).await?,
            };
            self.take_message(index, message, 0);
        }
        Ok(())
    }

    /// Waits for everything that a node says about a tick: its state (of the tick after the one that ran) or
    /// a fault, perhaps an edge, and its telemetry, which ends it.
    async fn take_tick(&mut self, index: usize, now: u64) -> Result<(), HubError> {
        let Some(node) = self.nodes.get_mut(index).filter(|node| !node.stopped && node.is_here()) else {
            return Ok(());
        };
        node.ticked = false;
        (node.states, node.telemetries, node.refused) = (0, 0, false);
        let state = node.shadow.as_ref().map_or_else(|| node.next_state.clone(), Shadow::x);
        let deadline = Deadline::after(self.patience.answer, self.outside.now());
        if node.on_can.is_some() && !node.says_nothing() {
            self.take_states_on_can(index, now, deadline).await?;
        }
        loop {
            let Some(node) = self.nodes.get_mut(index) else { return Ok(()) };
            if node.stopped && !node.ticked {
                self.set_presence(index, Presence::Stopped);
                return Ok(());
            }
            let awaited = if node.ticked { "telemetry" } else { "state" };
            node.contact.check_patience(deadline, self.tick, awaited)?;
            match node.contact.wait_until(deadline, awaited, Some).await? {
                // A fault, which most often has been heard on the bus. A twin's state there may have been
                // taken for the node's.
                Received::Message(message) if node.on_can.is_some() => {
                    if is_fault(&Received::Message(message)).is_some() && !node.stopped {
                        self.take_message(index, message, now);
                    }
                }
                Received::Message(message) => self.take_message(index, message, now),
                Received::Reply(Reply::Telemetry(telemetry)) => {
                    if self.take_telemetry(index, &state, &telemetry)? {
                        self.end_listening(index, now);
                        return Ok(());
                    }
                }
                Received::Reply(_) => {}
            }
        }
    }

    /// Waits for the states of a node on CAN, or for a fault.
    async fn take_states_on_can(
        &mut self,
        index: usize,
        now: u64,
        deadline: Deadline,
    ) -> Result<(), HubError> {
        while let Some(node) =
            self.nodes.get(index).filter(|node| !node.stopped && !node.has_told_its_state())
        {
            node.contact.check_patience(deadline, self.tick, "state on CAN")?;
            let (message, at) = self.wait_on_can(index, deadline).await?;
            self.take_message(index, message, now);
            if let Some(stamps) = self.stamps.get_mut(index) {
                stamps.bus = at.checked_sub(self.begin).map(Duration::from_nanos);
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
        let since_start = self.since_start();
        let Some(node) = self.nodes.get_mut(index) else { return Ok(true) };
        let id = node.contact.id();
        if telemetry.tick != tick {
            return Err(HubError::OutOfStep { node: id, tick, found: telemetry.tick });
        }
        let measured = measure::refusal(telemetry, state.len());
        // Without a state of its own it is known only where it is as it should be.
        let is_known = !node.listens || node.shadow.as_ref().is_some_and(|shadow| shadow.agrees(telemetry));
        // It has to say one once it should have spoken.
        let must_speak = !node.listens || is_known && node.shadow.as_ref().is_some_and(Shadow::speaks);
        if let Some((what, value)) = &measured {
            self.doubts.note(id, what, tick, || value.clone());
            if component >= state.len() {
                return Ok(false);
            }
        }
        // Without its state nobody knows any more what it is.
        let lost = match () {
            () if must_speak && !node.stopped && !node.has_told_its_state() => Some("state"),
            () if component != node.telemetries => Some("telemetry"),
            () => None,
        };
        if let Some(what) = lost {
            return Err(HubError::Lost { node: id, tick, what });
        }
        node.telemetries += 1;
        node.refused |= measured.is_some() || !is_known;
        let (is_last, refused) = (node.telemetries >= state.len(), node.refused);
        if let Some(stamps) = self.stamps.get_mut(index) {
            stamps.telemetry = Some(since_start);
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
}

impl Conductor {
    /// Goes on without what was expected of a newcomer, once it has said a state.
    fn end_listening(&mut self, index: usize, now: u64) {
        if !self.nodes.get(index).is_some_and(|node| node.listens) {
            return;
        }
        // One that is not as expected may have spoken already.
        while let Some((message, _)) = self.next_on_its_bus(index) {
            self.take_message(index, message, now);
        }
        let Some(node) = self.nodes.get_mut(index) else { return };
        if node.has_told_its_state() {
            (node.listens, node.shadow) = (false, None);
        }
    }
}

/// What a node answers to a start.
fn announcement(received: Received) -> Option<Message> {
    match received {
        Received::Message(message @ (Message::State { .. } | Message::Fault { .. })) => Some(message),
        _ => None,
    }
}
