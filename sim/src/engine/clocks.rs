//! An engine whose nodes have clocks of their own, and the time that they keep by SYNC (docs/notes/2026-11-28-clocks.md).
//!
//! A node is handed the time of its [`Keeper`] in place of the engine's. What is seen at a tick of the network is what all nodes are at the same instant.

use super::clock::Clock;
use super::{Engine, NEVER, NodeEvent, receive};
use crate::bus::{Medium, Stamp};
use crate::scenario::{ClockSpec, Detail, EventKind, EventSpec, Scenario, SyncSpec, Targets};
use funnelnet_can_bus::table::Latencies;
use funnelnet_law::field::VectorField;
use funnelnet_node::time::{Change, Keeper, Masters, Output, Role, Rules};
use funnelnet_node::{Node, Observation, Phase};
use funnelnet_protocol::message::{FaultCode, Message, NodeId, TickStamp};
use std::collections::VecDeque;

/// The clocks of all nodes, and what came of them.
pub struct Clocks {
    nodes: Vec<NodeClock>,
    tick_ns: u64,
    /// Tick of the network that comes next.
    tick: u64,
    /// Whether nodes keep time by SYNC.
    syncs: bool,
    /// The counters of bits of a controller, by which it stamps frames, ns.
    stamp_ns: u64,
    /// Index of the node whose time is that of the network: the last one to lead.
    leader: usize,
    /// Its clock and its keeper as it went off: they tell the time until another one leads.
    gone: Option<(Clock, Keeper)>,
    /// Difference between the fastest and the slowest running node, at each tick.
    skews: Latencies,
    /// SYNC that were sent, and how often a node became time master.
    sent: u64,
    masters: u64,
}

/// The clock of one.
struct NodeClock {
    clock: Clock,
    keeper: Keeper,
    /// Stamps of SYNC that it has not been told of yet.
    stamps: VecDeque<u64>,
    /// Engine time of its last tick and of the next one, ns.
    ticked_at: Option<u64>,
    ticks_at: u64,
    /// From and to when its SYNC do not go out (engine time, ns).
    mute: Vec<(u64, u64)>,
    /// The tick of the network that comes next on a node that has come during the run: it ticks by the SYNC that its own
    /// keeper makes of network time. None for one that ticks by its timer.
    comes: Option<u64>,
    /// Whether a node that has come has been told the time since.
    has_followed: bool,
}

/// What came of the clocks of a run.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Skew {
    /// What 99 of 100 ticks do not exceed, ns; none where there were none.
    pub p99_ns: Option<u64>,
    /// The largest, ns.
    pub worst_ns: u64,
    /// SYNC that were sent.
    pub syncs: u64,
    /// How often a node became time master.
    pub masters: u64,
}

impl Clocks {
    /// Those of a scenario; none where its nodes share one clock that is right.
    #[must_use]
    pub fn of(scenario: &Scenario) -> Option<Self> {
        if scenario.clocks.is_empty() {
            return None;
        }
        let sync = scenario.sync.as_ref();
        let tick_ns = scenario.time.tick_ns;
        let masters = sync.map_or(&[][..], |sync| &sync.masters).iter().copied().filter_map(id_of);
        let masters = masters.fold(Masters::default(), Masters::and);
        let node = |(index, spec): (usize, &ClockSpec)| {
            let rules = Rules {
                id: id_of(u16::try_from(index + 1).ok()?)?,
                masters,
                period_ns: sync.map_or(tick_ns, |sync| sync.period_ns),
                tick_ns,
                holdover_ns: sync.and(scenario.safety.holdover_ns),
                // Its controller stamps it.
                jitter_ns: 0,
            };
            let mut keeper = Keeper::new(rules);
            let spec = with_events(spec, scenario, index);
            // Tick 0 is a tick after the start.
            let later = |changes: &[(u64, i64)]| {
                changes.iter().map(|&(at, change)| (at.saturating_add(tick_ns), change)).collect()
            };
            let (jumps, drifts) = (later(&spec.jumps), later(&spec.drifts));
            let mute = silences(scenario, index);
            let clock = Clock::new(&ClockSpec { jumps, drifts, ..spec.clone() }, scenario.seed, index);
            // A node that is ahead by `offset` is where the others are only then. Network time begins a tick before tick 0.
            let ahead = tick_ns.saturating_add_signed(spec.offset_ns);
            keeper.start(0, ahead, tick_ns.saturating_mul(2), false);
            Some(NodeClock {
                clock,
                keeper,
                stamps: VecDeque::new(),
                ticked_at: None,
                ticks_at: NEVER,
                mute,
                comes: None,
                has_followed: false,
            })
        };
        let nodes: Option<Vec<NodeClock>> = scenario.clocks.iter().enumerate().map(node).collect();
        let leader =
            sync.and_then(|sync: &SyncSpec| sync.masters.iter().min()).map_or(0, |&id| usize::from(id) - 1);
        Some(Self {
            nodes: nodes?,
            tick_ns,
            tick: 0,
            syncs: sync.is_some(),
            stamp_ns: (1_000_000_000 / u64::from(scenario.bus.bitrate.max(1))).max(1),
            leader,
            gone: None,
            skews: Latencies::default(),
            sent: 0,
            masters: 0,
        })
    }

    /// Time of a node that is told something at `now`, ns. At the start it is a tick, so that one may be behind.
    pub(super) fn on_node(&mut self, index: usize, now: u64) -> u64 {
        if now == 0 { self.tick_ns } else { self.of_node(index, now) }
    }

    /// Time that a node is handed: that of the network, or of its own clock where it ticks by SYNC, since network time may
    /// be far from what it was once it is known.
    fn of_node(&mut self, index: usize, now: u64) -> u64 {
        let Some(node) = self.nodes.get_mut(index) else { return 0 };
        let own = node.clock.shows(now);
        if node.comes.is_some() { own } else { node.keeper.network(own) }
    }

    /// A node goes: nobody keeps its time.
    pub(super) fn power_off(&mut self, index: usize) {
        let Some(node) = self.nodes.get_mut(index) else { return };
        if index == self.leader && self.gone.is_none() {
            self.gone = Some((node.clock.clone(), node.keeper.clone()));
        }
        node.keeper.stop();
        node.stamps.clear();
        (node.ticked_at, node.ticks_at) = (None, NEVER);
    }

    /// A node comes, and knows no time but that of its own clock.
    pub(super) fn power_on(&mut self, index: usize, now: u64) {
        let tick_ns = self.tick_ns;
        let Some(node) = self.nodes.get_mut(index) else { return };
        let own = node.clock.shows(now);
        node.keeper.start(own, tick_ns, tick_ns.saturating_mul(2), true);
        (node.comes, node.has_followed) = (Some(0), false);
    }

    /// Lets a node that leads tell the time of the network. One that has come, and leads since it has heard nobody, tells
    /// another one.
    fn note_leader(&mut self, index: usize, now: u64) {
        let Some(node) = self.nodes.get_mut(index) else { return };
        node.has_followed |= node.keeper.role() != Role::Leads && node.keeper.is_in_time();
        let knows = node.comes.is_none() || node.has_followed;
        let leads = node.keeper.role() == Role::Leads && !node.is_mute(now) && knows;
        if leads && (self.leader != index || self.gone.is_some()) {
            (self.leader, self.gone) = (index, None);
        }
    }

    /// The tick that has come for a node that ticks by SYNC; told once.
    fn take_tick(&mut self, index: usize, now: u64) -> Option<u64> {
        let tick_ns = self.tick_ns;
        let node = self.nodes.get_mut(index)?;
        let next = node.comes.filter(|_| node.keeper.is_in_time())?;
        let network = node.keeper.network(node.clock.shows(now));
        let tick = network.checked_sub(tick_ns.saturating_mul(2))? / tick_ns;
        if tick < next {
            return None;
        }
        node.comes = Some(tick + 1);
        Some(tick)
    }

    /// What came of them so far.
    #[must_use]
    pub fn skew(&self) -> Skew {
        let (p99_ns, worst_ns) = (self.skews.percentile(990), self.skews.longest());
        Skew { p99_ns, worst_ns, syncs: self.sent, masters: self.masters }
    }

    /// The time of a node's keeper, ns.
    fn network(&mut self, index: usize, now: u64) -> u64 {
        self.nodes.get_mut(index).map_or(0, |node| node.keeper.network(node.clock.shows(now)))
    }

    /// Engine time at which the network's next tick is, ns; no later than the next change of the clock that tells it.
    fn next_tick(&self) -> (u64, bool) {
        let time = (self.tick + 2).saturating_mul(self.tick_ns);
        if !self.syncs {
            // Without SYNC there is no time of the network but the true one.
            return (time - self.tick_ns, true);
        }
        let of_leader = self.nodes.get(self.leader).map(|node| (&node.clock, &node.keeper));
        let of_gone = self.gone.as_ref().map(|(clock, keeper)| (clock, keeper));
        let Some((clock, keeper)) = of_gone.or(of_leader) else { return (NEVER, true) };
        let own = keeper.own(time);
        let at = clock.when(own);
        let mut clock = clock.clone();
        (at, keeper.network(clock.shows(at)) >= time)
    }
}

/// The clock of a node with what events make of it. What they name in time of the scenario is true time from the start on.
fn with_events(spec: &ClockSpec, scenario: &Scenario, index: usize) -> ClockSpec {
    let mut spec = spec.clone();
    let of_it = |event: &&EventSpec| event.kind == EventKind::Clock && event.targets.nodes().contains(&index);
    for event in scenario.events.iter().filter(of_it) {
        let at = scenario.time.on_clock(event.at_ns);
        let Detail::Clock(change) = event.detail else { continue };
        if change.by_ns != 0 {
            spec.jumps.push((at, change.by_ns));
        }
        spec.drifts.extend(change.drift_ppb.map(|ppb| (at, ppb)));
    }
    spec
}

/// From and to when events keep back the SYNC of a node, by index; engine time, ns.
#[must_use]
pub fn silences(scenario: &Scenario, index: usize) -> Vec<(u64, u64)> {
    let of_it = |event: &&EventSpec| {
        event.kind == EventKind::SyncLoss
            && (event.targets == Targets::Masters || event.targets.nodes().contains(&index))
    };
    let silence = |event: &EventSpec| {
        let from = scenario.time.on_clock(event.at_ns).saturating_add(scenario.time.tick_ns);
        (from, from.saturating_add(event.lasts_ns))
    };
    scenario.events.iter().filter(of_it).map(silence).collect()
}

fn id_of(id: u16) -> Option<NodeId> {
    NodeId::new(u8::try_from(id).ok()?)
}

impl NodeClock {
    /// What a controller's stamp of an instant is.
    fn stamp(&mut self, at: u64, resolution: u64) -> u64 {
        self.clock.shows(at) / resolution * resolution
    }

    fn is_mute(&self, now: u64) -> bool {
        self.mute.iter().any(|&(from, to)| (from..to).contains(&now))
    }
}

/// A SYNC of a time master: receiver, master, what it says.
type Heard = (usize, NodeId, (TickStamp, u16));

impl<M: Medium, V: VectorField<f32> + Clone> Engine<M, V> {
    /// With clocks of their own.
    pub fn with_clocks(self, clocks: Option<Clocks>) -> Self {
        Self { clocks: clocks.map(Box::new), ..self }
    }

    /// What came of the clocks; none where there is but one.
    pub fn skew(&self) -> Option<Skew> {
        self.clocks.as_ref().map(|clocks| clocks.skew())
    }

    /// Runs until the network's next tick, and gives what all nodes are at that instant.
    pub(super) fn advance_by_clocks(&mut self) -> Option<&[Observation<f32>]> {
        let until = loop {
            let (until, is_tick) = self.clocks.as_ref().map(|clocks| clocks.next_tick())?;
            let wake = self.wakes.iter().copied().min().unwrap_or(NEVER);
            let change = self.world.as_ref().and_then(|world| world.scene.next_change()).unwrap_or(NEVER);
            let arrival = self.bus.next_arrival().unwrap_or(NEVER);
            let carried = self.later.front().map_or(arrival, |later| arrival.min(later.at));
            // What happens at the time of a tick happens before it.
            if change != NEVER && change <= wake.min(carried).min(until) {
                self.happen(change);
            } else if until < wake.min(carried) || until == NEVER {
                if is_tick {
                    break until;
                }
                self.clocks.as_mut()?.see_change(until);
            } else if wake <= carried {
                self.wake_all(wake);
            } else {
                self.deliver_before(carried + 1);
            }
        };
        self.look(until);
        Some(&self.observations)
    }

    fn wake_all(&mut self, now: u64) {
        for index in 0..self.nodes.len() {
            if self.wakes.get(index) == Some(&now) {
                self.poll(index, now);
            }
        }
    }

    /// Does what is due for a node and its time.
    #[cold]
    pub(super) fn poll_by_clock(&mut self, index: usize, now: u64) {
        let Some(clocks) = &mut self.clocks else { return };
        let Some(timing) = clocks.nodes.get_mut(index) else { return };
        let Some(node) = self.nodes.get_mut(index) else { return };
        if !matches!(node.phase(), Phase::Running | Phase::Ready) {
            timing.keeper.stop();
        }
        let before = node.tick();
        while let Some(output) = timing.keeper.poll(timing.clock.shows(now)).filter(|_| clocks.syncs) {
            match output {
                Output::Send(_) if timing.is_mute(now) => {}
                Output::Send(message) => {
                    clocks.sent += 1;
                    self.bus.send(now, index, &message);
                    self.bus.flush(now, index);
                }
                Output::Report(change) => {
                    clocks.masters += u64::from(change == Change::Leads);
                    self.events.push(NodeEvent { at: now, node: index, event: change.into() });
                }
                Output::Lost { silent_ms } => node.fail(FaultCode::HOLDOVER, silent_ms),
            }
        }
        // Of two that lead, one that nobody hears does not.
        clocks.note_leader(index, now);
        let of_node = clocks.of_node(index, now);
        if let Some(tick) = clocks.take_tick(index, now) {
            let previous_tick = TickStamp::full((tick as u32).wrapping_sub(1));
            let sync = Message::Sync { source: None, previous_tick, phase_us: 0 };
            receive(&mut self.nodes, index, Ok(sync), of_node);
        }
        self.poll_as(index, now, of_node);
        self.schedule(index, now, before);
    }

    /// Sets when a node is polled next, by its clock.
    fn schedule(&mut self, index: usize, now: u64, before: u32) {
        let Some(clocks) = &mut self.clocks else { return };
        let (Some(timing), Some(wake)) = (clocks.nodes.get_mut(index), self.wakes.get_mut(index)) else {
            return;
        };
        if self.nodes.get(index).is_some_and(|node| node.tick() != before) {
            timing.ticked_at = Some(now);
        }
        let at = |own: u64| if own == NEVER { NEVER } else { timing.clock.when(own).max(now) };
        let ticks_at = match timing.comes {
            Some(_) if !timing.keeper.is_in_time() => NEVER,
            Some(tick) => at(timing.keeper.own(tick.saturating_add(2).saturating_mul(clocks.tick_ns))),
            None if *wake == NEVER => NEVER,
            None => at(timing.keeper.own(*wake)),
        };
        let keeps_at = timing.keeper.poll_at().filter(|_| clocks.syncs).map_or(NEVER, at);
        // A node that ticks by SYNC waits on its own clock for all else.
        let waits_at = if timing.comes.is_some() { at(*wake) } else { NEVER };
        (timing.ticks_at, *wake) = (ticks_at, ticks_at.min(keeps_at).min(waits_at));
    }

    /// Lets the bus deliver what comes next before `before` (ns), and gives its time; SYNC of time masters go to the keepers, with the stamps
    /// of their controllers.
    #[cold]
    pub(super) fn deliver_by_clocks(&mut self, before: u64) -> Option<u64> {
        let at = self.bus.next_arrival().filter(|&at| at < before)?;
        let (nodes, mut heard) = (&mut self.nodes, Vec::<Heard>::new());
        self.bus.deliver(|receiver, message| match message {
            Ok(Message::Sync { source: Some(source), previous_tick, phase_us }) => {
                heard.push((receiver, source, (previous_tick, phase_us)));
            }
            message => receive(nodes, receiver, message, at),
        });
        let clocks = self.clocks.as_mut()?;
        let resolution = clocks.stamp_ns;
        for Stamp { node, at, own } in self.bus.take_stamps() {
            let Some(timing) = clocks.nodes.get_mut(node) else { continue };
            let stamp = timing.stamp(at, resolution);
            if own { timing.keeper.on_sent(stamp) } else { timing.stamps.push_back(stamp) }
        }
        for (index, source, said) in heard {
            self.keep(index, source, said, at);
        }
        Some(at)
    }

    /// Gives a SYNC to a keeper. A node counts it as any other frame.
    fn keep(&mut self, index: usize, source: NodeId, said: (TickStamp, u16), now: u64) {
        let Some(clocks) = &mut self.clocks else { return };
        let (Some(timing), Some(node)) = (clocks.nodes.get_mut(index), self.nodes.get_mut(index)) else {
            return;
        };
        let own = timing.clock.shows(now);
        let stamp = timing.stamps.pop_front().unwrap_or(own);
        if let Err(reason) = timing.keeper.on_sync(source, said, stamp, own) {
            node.refuse(reason);
        }
        self.poll(index, now);
    }

    /// Sees what all running nodes are at `at`: between two ticks a state goes straight from one to the next.
    fn look(&mut self, at: u64) {
        let Some(clocks) = &mut self.clocks else { return };
        clocks.tick += 1;
        let (mut first, mut last) = (u64::MAX, 0);
        let mut slots = self.observations.iter_mut();
        for (index, node) in self.nodes.iter().enumerate() {
            let slots = slots.by_ref().take(node.components());
            if node.phase() != Phase::Running {
                slots.for_each(drop);
                continue;
            }
            // Who has just come knows no time yet.
            if clocks.is_in_time(index) {
                let network = clocks.network(index, at);
                (first, last) = (first.min(network), last.max(network));
            }
            let part = clocks.nodes.get(index).and_then(|timing| timing.part(at));
            for ((slot, seen), next) in slots.zip(node.observations()).zip(node.state()) {
                slot.x = part.map_or(seen.x, |part| between(seen.x, next, part));
            }
        }
        if first <= last {
            clocks.skews.add(last - first);
        }
    }

    /// Presence of each node now, by index.
    pub(super) fn presence_by_clock(&self) -> Vec<crate::presence::Presence> {
        use crate::presence::Presence;
        let of = |(index, node): (usize, &Node<f32, V>)| match node.phase() {
            _ if !self.is_on(index) => Presence::Off,
            Phase::Running => Presence::Ran,
            _ => Presence::Stopped,
        };
        self.nodes.iter().enumerate().map(of).collect()
    }
}

impl Clocks {
    /// Whether a node knows the network's time, as far as any node does.
    fn is_in_time(&self, index: usize) -> bool {
        self.nodes.get(index).is_some_and(|node| node.comes.is_none() || node.keeper.is_in_time())
    }

    /// Lets the clock that tells the network's time change.
    fn see_change(&mut self, at: u64) {
        let of_leader = self.nodes.get_mut(self.leader).map(|node| &mut node.clock);
        if let Some(clock) = self.gone.as_mut().map(|(clock, _)| clock).or(of_leader) {
            clock.advance_to(at);
        }
    }
}

impl NodeClock {
    /// Part of the way from its last tick to the next one, 0 to 1; none before its first one.
    fn part(&self, at: u64) -> Option<f64> {
        let (from, to) = (self.ticked_at?, self.ticks_at);
        let passed = at.saturating_sub(from);
        Some(if passed == 0 || to <= from { 0.0 } else { (passed as f64 / (to - from) as f64).min(1.0) })
    }
}

fn between(from: f32, to: f32, part: f64) -> f32 {
    if part == 0.0 {
        return from;
    }
    (f64::from(from) + (f64::from(to) - f64::from(from)) * part) as f32
}
