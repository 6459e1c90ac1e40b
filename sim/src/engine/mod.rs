//! The loopback engine: f32 nodes, a bus, and integer time. Every state travels as the bytes of a CAN frame.
//!
//! At equal times nodes tick before frames are delivered, so that the order of ids has no influence.

pub(crate) mod clock;
mod clocks;
mod commits;
mod devices;
mod field;
mod heard;
mod lies;
mod malfunctions;
mod own_field;
mod plants;
mod scene;
mod world;

pub use clocks::{Clocks, Skew, silences};
pub use commits::{Commits, TOLD_AHEAD};
pub use field::{Outside, SimField, SimNode, params, params_as};
pub use lies::Lies;
pub use own_field::{COAST_TICKS, setup as setup_of_own_field};
pub use plants::{Driven, Plants};
pub use scene::Scene;
pub use world::World;

use crate::bus::ideal::IdealBus;
use crate::bus::{Medium, Power, Traffic};
use crate::noise::Noise;
use crate::presence::Presence;
use crate::scenario::{Change, Scenario};
use devices::Devices;
use funnelnet_law::field::VectorField;
use funnelnet_node::{Action, Event, Node, Observation, Phase};
use funnelnet_protocol::can::CanFrame;
use funnelnet_protocol::message::{Command, FaultCode, JOIN, Message, Target, TickStamp};
use funnelnet_protocol::refusal::Refusal;
use funnelnet_protocol::report::Report;
use malfunctions::Malfunctions;
use std::collections::VecDeque;

/// An event of a node, with the node's index and the engine's time (ns).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct NodeEvent {
    /// Time since the start, ns.
    pub at: u64,
    /// Index of the node.
    pub node: usize,
    /// The event.
    pub event: Event,
}

/// A node that waits for a message.
const NEVER: u64 = u64::MAX;

/// What is seen of a node that is off. Not a number, so that nothing is judged by it unnoticed.
pub const NOTHING: Observation<f32> =
    Observation { tick: u32::MAX, x: f32::NAN, nu: f32::NAN, psi: f32::NAN, ratio: f32::NAN, u: f32::NAN };

/// Nodes on a bus, an ideal one if no other is said.
pub struct Engine<M = IdealBus<CanFrame>, V = SimField> {
    nodes: Vec<Node<f32, V>>,
    bus: M,
    noise: Noise,
    /// Where nodes say what is not so.
    lies: Option<Box<Lies>>,
    /// Time from the tick of each node to its frames, ns; none where they go at once.
    compute: Vec<u64>,
    /// What the node that is polled has said and still computes.
    said: Vec<Message>,
    /// What nodes still compute, in the order of time.
    later: VecDeque<Later>,
    devices: Devices<V>,
    /// Where nodes adopt other configurations.
    commits: Option<Box<Commits<V>>>,
    /// Where events happen.
    world: Option<World<V>>,
    /// Where nodes have clocks of their own.
    clocks: Option<Box<Clocks>>,
    /// Time at which each node wants to be polled, ns; `NEVER` if not. A scan of at most 127 entries beats a heap (measured).
    wakes: Vec<u64>,
    /// Node by node, and the components of each in order.
    observations: Vec<Observation<f32>>,
    events: Vec<NodeEvent>,
}

/// Messages that a node will have computed at some time (ns).
struct Later {
    at: u64,
    node: usize,
    messages: Vec<Message>,
}

impl<M: Medium, V: VectorField<f32> + Clone> Engine<M, V> {
    /// Nodes that are ready to start, all with as many components; `bus` must know as many nodes.
    pub fn new(nodes: Vec<Node<f32, V>>, bus: M) -> Self {
        let observations = nodes.iter().flat_map(|node| node.observations().iter().copied()).collect();
        let noise = Noise::default();
        let wakes = vec![NEVER; nodes.len()];
        Self {
            nodes,
            bus,
            noise,
            lies: None,
            compute: Vec::new(),
            said: Vec::new(),
            later: VecDeque::new(),
            devices: Devices::default(),
            commits: None,
            world: None,
            clocks: None,
            wakes,
            observations,
            events: Vec::new(),
        }
    }

    /// Lets nodes compute for `compute` (ns, by index) before they send.
    pub fn with_compute(self, compute: Vec<u64>) -> Self {
        let takes_time = compute.iter().any(|&ns| ns > 0);
        Self { compute: if takes_time { compute } else { Vec::new() }, ..self }
    }

    /// Adds noise to the states that nodes send.
    pub fn with_noise(self, noise: Noise) -> Self {
        Self { noise, ..self }
    }

    /// Lets nodes say what is not so.
    pub fn with_lies(self, lies: Option<Box<Lies>>) -> Self {
        Self { lies, ..self }
    }

    /// Lets nodes measure and drive these plants.
    pub fn with_plants(mut self, plants: Plants) -> Self {
        for (index, plant) in plants.0.into_iter().enumerate() {
            if let Some(plant) = plant {
                self.devices.give(index, plant);
            }
        }
        self
    }

    /// Lets sensors and actuators fail as the events of a scenario say. A node that is named there has its field for a plant, unless
    /// [`Self::with_plants`] gives it another one.
    pub fn with_malfunctions(mut self, scenario: &Scenario) -> Self {
        for (index, node) in self.nodes.iter().enumerate().filter(|&(index, _)| scenario.has_plant(index)) {
            let malfunctions = Malfunctions::of(scenario, index);
            self.devices.give_field(index, node, scenario.time.tick_s(), malfunctions);
        }
        self
    }

    /// Stages other configurations in nodes.
    pub fn with_commits(self, commits: Option<Commits<V>>) -> Self {
        Self { commits: commits.map(Box::new), ..self }
    }

    /// Adds the events of a world.
    pub fn with_world(mut self, world: World<V>) -> Self {
        self.bus.set_listeners(world.scene.listeners());
        self.world = Some(world);
        let absent: Vec<usize> = (0..self.nodes.len()).filter(|&index| !self.is_on(index)).collect();
        for index in absent {
            self.forget(index);
            self.bus.switch(0, index, Power::Off);
        }
        self
    }

    /// Starts all nodes that are on at time 0.
    pub fn start(&mut self) {
        self.happen(0);
        for index in 0..self.nodes.len() {
            if self.is_on(index) && self.nodes.get(index).map(Node::phase) == Some(Phase::Ready) {
                self.command(index, Command::Start, 0);
            }
        }
    }

    /// Runs until all nodes that are due at the next tick instant have ticked, and gives what they saw, by index and
    /// then by component. `None` when nothing is left to do, which is never where events may happen.
    ///
    /// A node that has stopped keeps its last observation.
    pub fn advance(&mut self) -> Option<&[Observation<f32>]> {
        if self.clocks.is_some() {
            return self.advance_by_clocks();
        }
        let next = self.world.as_mut().map(World::next_tick);
        let now = match next {
            Some((tick, now)) => {
                self.happen(now);
                self.deliver_before(now);
                self.synchronise(tick, now);
                now
            }
            None => {
                let now = self.wakes.iter().copied().min().filter(|&at| at != NEVER)?;
                self.deliver_before(now);
                now
            }
        };
        for index in 0..self.nodes.len() {
            if self.wakes.get(index) == Some(&now) {
                self.poll(index, now);
            }
        }
        if !self.devices.is_empty() {
            self.look_at_stopped(next.map(|(tick, _)| tick));
        }
        Some(&self.observations)
    }

    /// Plants go on when their nodes have stopped: to `tick`, or, where nobody counts ticks but the nodes, to the newest of theirs.
    #[cold]
    fn look_at_stopped(&mut self, tick: Option<u64>) {
        // A node that is off has no tick.
        let ticks = self.observations.iter().map(|seen| seen.tick).filter(|&tick| tick != NOTHING.tick);
        let newest = tick.and_then(|tick| u32::try_from(tick).ok()).or(ticks.max()).unwrap_or(0);
        let components = self.nodes.first().map_or(1, Node::components);
        for (index, slots) in self.observations.chunks_mut(components).enumerate() {
            if slots.iter().any(|seen| seen.tick < newest) {
                self.devices.go_on_to(index, newest, slots);
            }
        }
    }

    /// Observations of the nodes at their last tick, by index and then by component.
    pub fn observations(&self) -> &[Observation<f32>] {
        &self.observations
    }

    /// Presence of each node at tick `k`, at which all were due last, by index.
    pub fn presence(&self, k: u64) -> Vec<Presence> {
        if self.clocks.is_some() {
            return self.presence_by_clock();
        }
        let components = self.nodes.first().map_or(1, Node::components);
        let of = |(index, seen): (usize, &[Observation<f32>])| match seen.first() {
            _ if !self.is_on(index) => Presence::Off,
            Some(seen) if u64::from(seen.tick) == k => Presence::Ran,
            // Its state is what it stopped with, or where its plant has gone since.
            _ => Presence::Stopped,
        };
        self.observations.chunks(components).enumerate().map(of).collect()
    }

    /// Whether no event keeps a node off, by index.
    pub fn is_on(&self, index: usize) -> bool {
        self.world.as_ref().is_none_or(|world| world.scene.is_on(index))
    }

    /// Whether two nodes that are on can hear each other: no event has cut their link.
    pub fn are_joined(&self, a: usize, b: usize) -> bool {
        self.world.as_ref().is_none_or(|world| world.scene.are_joined(a, b))
    }

    /// What the nodes report since they were last switched on, by index; `None` for one that is off.
    pub fn reports(&self) -> Vec<Option<Report>> {
        let report = |(index, node): (usize, &Node<f32, V>)| self.is_on(index).then(|| node.report());
        self.nodes.iter().enumerate().map(report).collect()
    }

    /// Indices of nodes that have missed what they should have adopted.
    pub fn missed(&self) -> &[usize] {
        self.commits.as_ref().map_or(&[], |commits| commits.missed())
    }

    /// The nodes, by index.
    pub fn nodes(&self) -> &[Node<f32, V>] {
        &self.nodes
    }

    /// A node, for who plays its host between two ticks.
    pub fn node_mut(&mut self, index: usize) -> Option<&mut Node<f32, V>> {
        self.nodes.get_mut(index)
    }

    /// Events that the nodes reported since the last call.
    pub fn take_events(&mut self) -> Vec<NodeEvent> {
        std::mem::take(&mut self.events)
    }

    /// Part of the time so far for which the bus was busy.
    pub fn utilisation(&self) -> f64 {
        self.bus.utilisation()
    }

    /// Frame counts so far.
    pub fn traffic(&self) -> Traffic {
        self.bus.traffic()
    }

    /// The bus.
    pub fn bus(&self) -> &M {
        &self.bus
    }

    /// The bus, to have it watched.
    pub fn bus_mut(&mut self) -> &mut M {
        &mut self.bus
    }

    /// Does what events do up to `now`, each at its time.
    fn happen(&mut self, now: u64) {
        while let Some(at) =
            self.world.as_ref().and_then(|world| world.scene.next_change()).filter(|&at| at <= now)
        {
            self.deliver_before(at);
            while let Some(change) = self.world.as_mut().and_then(|world| world.scene.take_change(at)) {
                self.change(change, at);
            }
            if let Some(world) = &self.world {
                self.bus.set_listeners(world.scene.listeners());
            }
        }
    }

    /// Makes one change.
    fn change(&mut self, change: Change, now: u64) {
        if let Change::Off { node, told: true } = change {
            self.command(node, Command::Stop, now);
        }
        if let Some(world) = &mut self.world {
            world.scene.make(change);
        }
        match change {
            Change::Off { node, told } => {
                self.forget(node);
                self.bus.switch(now, node, if told { Power::OffWhenSent } else { Power::Off });
            }
            Change::On { node } => {
                self.bus.switch(now, node, Power::On);
                if let Some(clocks) = &mut self.clocks {
                    clocks.power_on(node, now);
                }
                self.command(node, Command::Start, now);
            }
            Change::Cut(..) | Change::Mend(..) => {}
        }
    }

    /// Takes a node's state away: what is left is what it is made of after power-on.
    fn forget(&mut self, index: usize) {
        let fresh = self.world.as_ref().and_then(|world| world.fresh(index));
        let (Some(node), Some(fresh)) = (self.nodes.get_mut(index), fresh) else { return };
        let first = index * fresh.components();
        self.observations.iter_mut().skip(first).take(fresh.components()).for_each(|seen| *seen = NOTHING);
        *node = fresh;
        self.devices.power_off(index);
        if let Some(commits) = &mut self.commits {
            commits.power_off(index);
        }
        if let Some(clocks) = &mut self.clocks {
            clocks.power_off(index);
        }
        self.later.retain(|later| later.node != index);
        if let Some(wake) = self.wakes.get_mut(index) {
            *wake = NEVER;
        }
    }

    /// Gives a command to one node, and does what follows.
    fn command(&mut self, index: usize, command: Command, now: u64) {
        let joins =
            command == Command::Start && self.world.as_ref().is_some_and(|world| world.scene.has_come(index));
        let at_tick = if joins { JOIN } else { 0 };
        let target = if command == Command::Stop { self.target(index) } else { Target::All };
        let message = Message::Ctrl { target, command, arg: 0, at_tick };
        let of_node = self.clocks.as_mut().map_or(now, |clocks| clocks.on_node(index, now));
        receive(&mut self.nodes, index, Ok(message), of_node);
        self.poll(index, now);
    }

    /// That node alone: so it knows that the others go on without it.
    fn target(&self, index: usize) -> Target {
        self.nodes.get(index).map_or(Target::All, |node| Target::Node(node.id()))
    }

    /// Marks `tick` for the nodes that tick by SYNC.
    fn synchronise(&mut self, tick: u64, now: u64) {
        let previous_tick = TickStamp::full((tick as u32).wrapping_sub(1));
        let sync = Message::Sync { source: None, previous_tick, phase_us: 0 };
        for index in 0..self.nodes.len() {
            let by_sync = self.world.as_ref().is_some_and(|world| world.scene.has_come(index));
            if by_sync && self.nodes.get(index).map(Node::phase) == Some(Phase::Running) {
                receive(&mut self.nodes, index, Ok(sync), now);
                if let Some(wake) = self.wakes.get_mut(index) {
                    *wake = now;
                }
            }
        }
    }

    fn deliver_before(&mut self, now: u64) {
        loop {
            // What a node has computed by then goes before what arrives at the same time.
            let until = self.later.front().map_or(now, |later| later.at.min(now));
            let delivered = if self.clocks.is_some() {
                self.deliver_by_clocks(until)
            } else {
                let nodes = &mut self.nodes;
                self.bus.deliver_before(until, |at, receiver, heard| receive(nodes, receiver, heard, at))
            };
            match delivered {
                Some(_) if !self.bus.has_off() => {}
                Some(at) => {
                    for (index, count) in self.bus.take_off() {
                        self.fail(index, count, at);
                    }
                }
                None if until == now => return,
                None => self.send_later(),
            }
        }
    }

    #[cold]
    fn send_later(&mut self) {
        let Some(Later { at, node, messages }) = self.later.pop_front() else { return };
        messages.iter().for_each(|message| self.bus.send(at, node, message));
        self.bus.flush(at, node);
    }

    /// Has a node send at `at` (ns) what it computes until then.
    #[cold]
    fn send_at(&mut self, at: u64, node: usize) {
        let messages = std::mem::take(&mut self.said);
        self.bus.computes(node, at);
        insert(&mut self.later, Later { at, node, messages });
    }

    /// Stops a node that its bus has lost, as its app does.
    #[cold]
    fn fail(&mut self, index: usize, count: u16, now: u64) {
        if let Some(node) = self.nodes.get_mut(index) {
            node.fail(FaultCode::BUS_OFF, count);
        }
        self.poll(index, now);
    }

    fn poll(&mut self, index: usize, now: u64) {
        if self.clocks.is_some() { self.poll_by_clock(index, now) } else { self.poll_as(index, now, now) }
    }

    /// Does what is due for a node at `now`, which is `of_node` on its own time (ns).
    // Where `Node::poll` is called in one place, it is inlined there (`./ci.sh cost`).
    fn poll_as(&mut self, index: usize, now: u64, of_node: u64) {
        let Some(node) = self.nodes.get_mut(index) else { return };
        let compute = self.compute.get(index).copied().unwrap_or(0);
        let mut says = false;
        let wake = loop {
            let action = node.poll(of_node);
            let is_done = action.is_none();
            match action {
                Some(Action::Send(message)) => {
                    let message =
                        if self.noise.is_none() { message } else { self.noise.disturb(index, message) };
                    let message = match &mut self.lies {
                        None => message,
                        Some(lies) => lie(lies, &mut self.later, (index, now), message),
                    };
                    // A node that stops does not compute any more.
                    if compute == 0 || matches!(message, Message::Fault { .. }) {
                        self.bus.send(now, index, &message);
                        says = true;
                    } else {
                        self.said.push(message);
                    }
                }
                Some(Action::Report(event)) => self.events.push(NodeEvent { at: now, node: index, event }),
                Some(action @ (Action::Safe | Action::Sample | Action::Actuate)) => {
                    self.devices.act(index, now, &action, node);
                }
                None => {}
            }
            let wake = node.poll_at().unwrap_or(NEVER);
            if is_done || wake > of_node {
                let Some(commits) = &mut self.commits else { break wake };
                let (has_asked, fresh) = commits.attend(index, node);
                if let Some((world, fresh)) = self.world.as_mut().zip(fresh) {
                    world.store(index, fresh);
                }
                if !has_asked {
                    break wake;
                }
            }
        };
        let seen = node.observations();
        // All nodes have as many components.
        let first = index * seen.len();
        if let Some(slots) = self.observations.get_mut(first..first + seen.len()) {
            slots.copy_from_slice(seen);
            self.devices.tell(index, slots);
        }
        if let Some(next) = self.wakes.get_mut(index) {
            *next = wake;
        }
        if says {
            self.bus.flush(now, index);
        }
        if !self.said.is_empty() {
            self.send_at(now.saturating_add(compute), index);
        }
    }
}

/// What a node that may lie says in place of a message at its time (ns); what it says beside that goes later.
#[cold]
fn lie(
    lies: &mut Lies,
    later: &mut VecDeque<Later>,
    (index, now): (usize, u64),
    message: Message,
) -> Message {
    let (said, messages) = lies.tell(index, now, message);
    if !messages.is_empty() {
        insert(later, Later { at: now.saturating_add(lies.later_ns()), node: index, messages });
    }
    said
}

/// Keeps the order of time.
fn insert(later: &mut VecDeque<Later>, new: Later) {
    let place = later.partition_point(|before| before.at <= new.at);
    later.insert(place, new);
}

/// Hands a node what its link has heard, or counts that it could not be read.
// Inlined because a decoded message never goes through memory then (`./ci.sh cost`).
#[inline(always)]
fn receive<V: VectorField<f32>>(
    nodes: &mut [Node<f32, V>],
    index: usize,
    heard: Result<Message, Refusal>,
    now: u64,
) {
    let Some(node) = nodes.get_mut(index) else { return };
    match heard {
        // The node counts what it refuses; nothing else is to be done about it here.
        Ok(message) => drop(node.on_message(&message, now)),
        Err(reason) => node.refuse(reason),
    }
}
