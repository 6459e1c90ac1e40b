//! Nodes that tick by their own clock: this program carries their frames as they come, keeps what they say,
//! and watches them (docs/notes/2026-11-24-real-nodes.md).
//!
//! Nothing here waits for one node. A row is closed when all have told their tick.

use super::deadline::ns;
use super::own_presence::Passing;
use super::own_sync::Medium;
use super::recording::{Leap, Recording};
use super::task::{Reading, Source};
use super::watch::{Failing, Watch};
use super::{Conductor, HubError, OTHER_COMPONENT, OTHER_TICK, Received, START, STOP, measure};
use funnelnet_protocol::message::{Component, Message, Severity, TickStamp};
use funnelnet_protocol::report::Telemetry;
use funnelnet_protocol::serial;
use funnelnet_protocol::service::Reply;
use std::time::Duration;

/// How long nothing may come before this program looks around.
const LOOK_AROUND: Duration = Duration::from_millis(50);

/// What belongs to a run of nodes with clocks of their own.
pub(super) struct OwnClock {
    pub(super) recording: Recording,
    pub(super) watch: Watch,
    start_spread: Duration,
    /// Where nodes keep time by SYNC.
    pub(super) medium: Option<Medium>,
    /// Nodes that events take off and bring back, by index.
    pub(super) passing: Vec<Option<Passing>>,
}

impl OwnClock {
    /// First tick of which a node may still tell something.
    pub(super) fn telling(&self, node: usize) -> u32 {
        self.recording.telling(node)
    }
}

impl Conductor {
    /// With nodes that tick by their own clock.
    #[must_use]
    pub fn with_own_clock(self) -> Self {
        let hears = |listener: usize, source: usize| {
            let id = self.nodes.get(source).map(|node| node.config.id);
            let listener = self.nodes.get(listener);
            listener.is_some_and(|node| node.config.neighbours.iter().any(|edge| Some(edge.id) == id))
        };
        let count = self.nodes.len();
        let listeners = |source: usize| (0..count).filter(|&listener| hears(listener, source)).collect();
        let watch = Watch::new(self.tick_ns, (0..count).map(listeners));
        let components = self.nodes.first().map_or(0, |node| node.next_state.len());
        let mut recording = Recording::new(count, components);
        let on_can = self.nodes.iter().enumerate().filter(|(_, node)| node.on_can.is_some());
        on_can.for_each(|(index, _)| recording.set_apart(index));
        let (start_spread, passing) = (Duration::ZERO, vec![None; count]);
        let own = OwnClock { recording, watch, start_spread, medium: None, passing };
        Self { own: Some(own), ..self }
    }

    /// Time from the first start that was written to the last; zero where the nodes have no clocks of their
    /// own.
    pub fn start_spread(&self) -> Duration {
        self.own.as_ref().map_or(Duration::ZERO, |own| own.start_spread)
    }

    /// Ticks of a node of which a part was lost, by index.
    pub fn missed(&self, node: usize) -> u64 {
        self.own.as_ref().map_or(0, |own| own.recording.missed(node))
    }

    /// Ticks that a node on CAN has run and that have no bus time, by index: their outcome had not been read from
    /// the bus when their row was closed.
    pub fn without_bus_time(&self, node: usize) -> u64 {
        self.own.as_ref().map_or(0, |own| own.recording.without_bus_time(node))
    }

    /// Whether nodes tick by their own clock.
    pub fn has_own_clock(&self) -> bool {
        self.own.is_some()
    }

    /// Starts all nodes, as close together as their lines and buses allow.
    pub(super) async fn start_clocks(&mut self) -> Result<(), HubError> {
        let start = serial::encode(&START);
        self.begin = self.outside.now();
        self.begin_events().await?;
        // Who is absent at first is off, and one that has come before the start is on its way.
        for node in self.nodes.iter_mut().filter(|node| node.on_can.is_none() && node.is_here()) {
            node.contact.write(&start).await?;
        }
        self.say_on_can(&START).await?;
        let start_spread = self.since_start();
        if let Some(own) = &mut self.own {
            own.start_spread = start_spread;
        }
        Ok(())
    }

    /// Carries frames until the next row is closed.
    pub(super) async fn carry_a_tick(&mut self) -> Result<(), HubError> {
        while !self.close_row() {
            let reading = self.outside.read_any(self.look_around()).await?;
            if let Some(reading) = reading {
                self.take_reading(reading).await?;
            }
            self.go_on_passing().await?;
            self.forward().await?;
            self.commit_by_own_count().await?;
            self.watch()?;
        }
        Ok(())
    }

    /// Tells the nodes on CAN to stop, where they tick by their own clock: nodes that hear each other need no
    /// line for going on.
    pub(super) async fn stop_on_can(&mut self) -> Result<(), HubError> {
        if self.own.is_some() { self.say_on_can(&STOP).await } else { Ok(()) }
    }

    fn close_row(&mut self) -> bool {
        let Some(own) = &mut self.own else { return true };
        let closed = own.recording.close(&mut self.observations, &mut self.stamps, &mut self.presence);
        self.tick += u32::from(closed);
        closed
    }

    /// When a frame or an event is due, or it is time to look around, if nothing is read before.
    fn look_around(&self) -> u64 {
        let later = self.outside.now().saturating_add(ns(LOOK_AROUND));
        let due =
            [self.bus.next_arrival(), self.next_later(), self.next_change()].into_iter().flatten().min();
        due.map_or(later, |due| later.min(self.begin.saturating_add(due)))
    }

    async fn take_reading(&mut self, Reading { from, at }: Reading) -> Result<(), HubError> {
        let at = Duration::from_nanos(at.saturating_sub(self.begin));
        match from {
            Source::Line(index) => self.take_from_line(index, at).await,
            Source::Bus(_) | Source::All => self.take_from_buses(at),
        }
    }

    async fn take_from_line(&mut self, index: usize, at: Duration) -> Result<(), HubError> {
        while let Some(received) = self.nodes.get_mut(index).and_then(|node| node.contact.next_received()) {
            let on_can = self.nodes.get(index).is_some_and(|node| node.on_can.is_some());
            match received {
                // A node on CAN says the others there.
                Received::Message(message) if on_can && !matches!(message, Message::Fault { .. }) => {}
                // Of before an event took it off.
                Received::Message(_) if self.is_off(index) => {}
                Received::Reply(Reply::Telemetry(_)) if self.is_off(index) => {}
                Received::Message(message) => self.take_own(index, message, (at, None))?,
                Received::Reply(Reply::Telemetry(told)) => self.record(index, &told, at)?,
                Received::Reply(reply) => self.take_answer(index, reply).await?,
            }
        }
        Ok(())
    }

    fn take_from_buses(&mut self, at: Duration) -> Result<(), HubError> {
        for index in 0..self.nodes.len() {
            while let Some((message, on_bus)) = self.next_on_its_bus(index) {
                // It says a fault on its line, too, and earlier where it is off the bus.
                if !matches!(message, Message::Fault { .. }) && !self.is_off(index) {
                    let on_bus = on_bus.checked_sub(self.begin).map(Duration::from_nanos);
                    self.take_own(index, message, (at, on_bus))?;
                }
            }
        }
        Ok(())
    }

    fn record(&mut self, index: usize, told: &Telemetry, at: Duration) -> Result<(), HubError> {
        let now = self.now_ns();
        let (Some(own), Some(node)) = (&mut self.own, self.nodes.get(index)) else { return Ok(()) };
        // A node whose states do not come has come so far all the same.
        own.watch.heard(index, now);
        own.watch.reached(index, told.tick.saturating_add(1));
        let id = node.contact.id();
        let leapt = |Leap { from, to }| HubError::Leapt { node: id, from, to };
        let before = own.recording.telling(index);
        match measure::refusal(told, node.next_state.len()) {
            None => own.recording.telemetry(index, told, at).map_err(leapt)?,
            Some((what, value)) => {
                self.doubts.note(id, what, told.tick, || value);
                if usize::from(told.component) < node.next_state.len() {
                    own.recording.refuse(index, told).map_err(leapt)?;
                }
            }
        }
        let after = own.recording.telling(index);
        if after != before {
            own.watch.told(index, now);
        }
        Ok(())
    }

    /// Takes a message that a node has sent, read at `at` and perhaps on CAN before, and puts it on the bus
    /// of those who do not hear it themselves.
    fn take_own(
        &mut self,
        index: usize,
        message: Message,
        (at, on_bus): (Duration, Option<Duration>),
    ) -> Result<(), HubError> {
        if on_bus.is_none() {
            self.note_heard(index);
        }
        let now = u64::try_from(at.as_nanos()).unwrap_or(u64::MAX);
        match message {
            Message::State { component, tick, x, .. } => {
                if !self.has_component(index, component) {
                    return Ok(());
                }
                let Some(tick) = self.near(index, tick) else { return Ok(()) };
                self.record_state(index, (tick, component, x), (at, on_bus))?;
            }
            Message::Fault { tick, severity, .. } => {
                if self.take_goodbye(index, &message, now)? {
                    return Ok(());
                }
                self.note_fault(index, &message, now);
                if severity == Severity::Stopped {
                    self.end_recording(index, self.rebuilt(index, tick));
                }
            }
            Message::Edge { neighbour, weight, .. } => self.check_weight(index, neighbour.get(), weight),
            Message::Sync { source: Some(source), .. } => {
                self.carry_sync(index, source, &message, now);
                return Ok(());
            }
            Message::Ctrl { .. } | Message::Sync { .. } => return Ok(()),
        }
        self.put_on_bus(index, message, now);
        Ok(())
    }

    /// The whole tick of a state; takes note of it where that is nowhere near what is awaited.
    fn near(&mut self, index: usize, stamp: TickStamp) -> Option<u32> {
        let tick = self.rebuilt(index, stamp);
        if let (None, Some(own), Some(node)) = (tick, &self.own, self.nodes.get(index)) {
            let telling = own.telling(index);
            let value = || format!("the stamp {} after tick {telling}", stamp.value());
            self.doubts.note(node.contact.id(), OTHER_TICK, telling, value);
        }
        tick
    }

    /// Whether the state of a node has a component; takes note of it where it has not.
    fn has_component(&mut self, index: usize, component: Component) -> bool {
        let Some(node) = self.nodes.get(index) else { return false };
        let has = usize::from(component.get()) < node.next_state.len();
        if !has {
            let value = || format!("state {}", component.get());
            self.doubts.note(node.contact.id(), OTHER_COMPONENT, self.tick, value);
        }
        has
    }

    /// Whether an event keeps a node off.
    fn is_off(&self, index: usize) -> bool {
        self.nodes.get(index).is_some_and(|node| node.off)
    }

    /// The telemetry of a node is what is waited for, so a node on CAN is heard by its line.
    fn note_heard(&mut self, index: usize) {
        let now = self.now_ns();
        if let Some(own) = &mut self.own {
            own.watch.heard(index, now);
        }
    }

    fn record_state(
        &mut self,
        index: usize,
        (tick, component, x): (u32, Component, f32),
        (at, on_bus): (Duration, Option<Duration>),
    ) -> Result<(), HubError> {
        let Some(own) = &mut self.own else { return Ok(()) };
        own.recording.state(index, (tick, component.get(), x), at, on_bus);
        if component == Component::FIRST { self.compare_clocks(index, tick) } else { Ok(()) }
    }

    /// What a node runs ends at `tick`, or, where that is not known, at what it has told.
    fn end_recording(&mut self, index: usize, tick: Option<u32>) {
        if let Some(own) = &mut self.own {
            own.recording.stop(index, tick.unwrap_or_else(|| own.recording.telling(index)));
        }
    }

    /// Takes note of the newest state of a node.
    ///
    /// # Errors
    /// A node that hears it and ticks itself has had to refuse so many in a row that it has dropped the edge.
    fn compare_clocks(&mut self, index: usize, tick: u32) -> Result<(), HubError> {
        let now = self.now_ns();
        let nodes = &self.nodes;
        let patience = nodes.get(index).map_or(0, |node| u32::from(node.config.extrapolate_ticks));
        let Some(OwnClock { watch, medium, .. }) = &mut self.own else { return Ok(()) };
        let runs = |listener: usize| nodes.get(listener).is_some_and(|node| !node.stopped && node.is_here());
        let Some(refuses) = watch.state(index, tick, now, patience, runs) else { return Ok(()) };
        let (odd, even) = watch.odd_and_even(index, refuses);
        let (tick, other_tick) = (watch.newest(odd), watch.newest(even));
        let id = |index: usize| nodes.get(index).map_or(0, |node| node.contact.id());
        let (node, other, has_sync) = (id(odd), id(even), medium.is_some());
        Err(HubError::RanApart { node, tick, other, other_tick, has_sync })
    }

    /// Hands over the frames that are due, after the events that are.
    async fn forward(&mut self) -> Result<(), HubError> {
        let now = self.now_ns();
        self.happen(now).await?;
        self.say_syncs().await?;
        self.deliver_before(now.saturating_add(1)).await?;
        for node in &mut self.nodes {
            node.contact.flush().await?;
        }
        Ok(())
    }

    /// Looks for nodes that have fallen silent.
    fn watch(&mut self) -> Result<(), HubError> {
        let waited = self.patience.answer + Duration::from_nanos(self.tick_ns);
        let now = self.now_ns();
        let Some(own) = &mut self.own else { return Ok(()) };
        for (index, node) in self.nodes.iter().enumerate() {
            let failing = own.watch.failing(index, now, waited).filter(|_| own.recording.awaits(index));
            let Some(failing) = failing else { continue };
            let (id, telling) = (node.contact.id(), own.recording.telling(index));
            if !node.stopped {
                return Err(match failing {
                    Failing::Silent => HubError::Silent { node: id, last: telling.checked_sub(1), waited },
                    Failing::Babbling => {
                        HubError::Babbles { node: id, tick: telling, awaited: "telemetry", waited }
                    }
                });
            }
            // The end of what it had to tell was lost.
            own.recording.stop(index, telling);
        }
        Ok(())
    }
}
