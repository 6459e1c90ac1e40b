//! The world of a bench in virtual time: nodes in memory, and lines on which frames take their time and may
//! come to harm. It does what the conductor asks for, as `sim_host::hub` does on real lines.

use crate::board::{Board, Said};
use funnelnet_link::Frame;
use funnelnet_protocol::NodeConfig;
use sim_host::bus::ideal::{IdealBus, IdealParams};
use sim_host::can::{Heard, PortFrame, Traffic};
use sim_host::conductor::{Action, Conductor, HubError, Patience, Seat, Source, Staged, Step, Task};
use sim_host::configure::{Drive, listeners, node_configs, staged_configs};
use sim_host::engine::{Lies, Scene};
use sim_host::noise::Noise;
use sim_host::scenario::Scenario;
use std::collections::VecDeque;
use std::time::{Duration, SystemTime};

/// Which way a frame goes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Way {
    /// From the host to a node.
    ToNode,
    /// From a node to the host.
    ToHost,
}

/// What may happen to boards and on their lines.
pub trait Fate {
    /// Takes a frame on its way, and gives what arrives of it.
    fn carry(&mut self, node: usize, way: Way, now: u64, frame: Vec<u8>) -> Vec<Vec<u8>>;

    /// What becomes of a board before it hears or says something.
    fn befall(&mut self, node: usize, now: u64) -> Blow;
}

/// What becomes of a board.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Blow {
    /// Nothing.
    None,
    /// It restarts, and is blank.
    Restart,
    /// The same, and its line ends.
    Replug,
}

/// Nothing happens.
pub struct Peace;

impl Fate for Peace {
    fn carry(&mut self, _: usize, _: Way, _: u64, frame: Vec<u8>) -> Vec<Vec<u8>> {
        vec![frame]
    }

    fn befall(&mut self, _: usize, _: u64) -> Blow {
        Blow::None
    }
}

/// Frames on their way, each with the time of its arrival.
type Line<T> = VecDeque<(u64, T)>;

/// A bus, on which every frame comes to everybody.
struct Bus {
    fd: bool,
    /// By index.
    nodes: Vec<usize>,
    to_host: Line<PortFrame>,
}

/// Puts a frame on its way, behind all that arrives until then.
fn put<T>(line: &mut Line<T>, at: u64, frame: T) {
    let place = line.partition_point(|&(before, _)| before <= at);
    line.insert(place, (at, frame));
}

/// Boards, lines and a clock.
pub struct World<F: Fate = Peace> {
    boards: Vec<Board>,
    /// Of lines and buses, in the order in which it comes.
    to_node: Vec<Line<Said>>,
    to_host: Vec<Line<Vec<u8>>>,
    buses: Vec<Bus>,
    /// The line has ended, by node.
    ended: Vec<bool>,
    /// The host has switched the board off, and reads of all lines do not look at this one.
    off: Vec<bool>,
    now: u64,
    /// Time that a frame takes either way, ns.
    travel: u64,
    /// What it takes beside that on a line to a node, ns.
    pub line_delay: u64,
    /// The host can switch the boards off and on.
    pub has_power: bool,
    /// What may happen.
    pub fate: F,
}

impl<F: Fate> World<F> {
    /// So many blank boards; a frame takes `travel` either way, ns.
    pub fn new(nodes: usize, travel: u64, fate: F) -> Self {
        Self {
            boards: (0..nodes).map(|_| Board::new()).collect(),
            to_node: vec![Line::new(); nodes],
            to_host: vec![Line::new(); nodes],
            buses: Vec::new(),
            ended: vec![false; nodes],
            off: vec![false; nodes],
            now: 0,
            travel,
            line_delay: 0,
            has_power: false,
            fate,
        }
    }

    /// With one more bus that these nodes are on, of CAN FD if `fd`.
    #[must_use]
    pub fn with_bus(mut self, nodes: &[usize], fd: bool) -> Self {
        nodes.iter().for_each(|&node| self.boards[node].put_on_can(fd));
        self.buses.push(Bus { fd, nodes: nodes.to_vec(), to_host: Line::new() });
        self
    }

    /// With a clock on each board that is so many parts in a billion too fast, by index.
    #[must_use]
    pub fn with_drifts(mut self, ppb: &[i64]) -> Self {
        self.boards.iter_mut().zip(ppb).for_each(|(board, &ppb)| board.set_drift(ppb));
        self
    }

    /// Time, ns.
    pub fn now(&self) -> u64 {
        self.now
    }

    /// The boards, by index.
    pub fn boards(&self) -> &[Board] {
        &self.boards
    }

    /// One of them.
    pub fn board_mut(&mut self, node: usize) -> &mut Board {
        &mut self.boards[node]
    }

    /// Does what a task asks for, until it is over.
    pub fn run<T>(&mut self, mut task: Task<'_, T>) -> T {
        loop {
            match task.poll(self.now) {
                Step::Do(action) => {
                    if let Err(error) = self.act(action, &mut task) {
                        task.on_failed(error);
                    }
                }
                Step::Done(outcome) => return outcome,
            }
        }
    }

    fn act<T>(&mut self, action: Action, task: &mut Task<'_, T>) -> Result<(), HubError> {
        match action {
            Action::Write { node, bytes } => self.write(node, &bytes),
            Action::Read { from, until } => self.read(from, until, task),
            Action::Wait { until } => {
                while self.go_on(until) {}
                Ok(())
            }
            Action::Close { node } => {
                self.to_host[node].clear();
                self.ended[node] = true;
                Ok(())
            }
            Action::Reopen { node } => {
                if self.ended[node] {
                    self.ended[node] = false;
                    task.on_reopened(node);
                }
                Ok(())
            }
            Action::Switch { node, on } => {
                if self.has_power {
                    self.boards[node].restart();
                    self.to_node[node].clear();
                    self.to_host[node].clear();
                    (self.ended[node], self.off[node]) = (!on, !on);
                    task.on_switched(node);
                }
                Ok(())
            }
            Action::Say { bus, frames } => {
                frames.into_iter().for_each(|frame| self.broadcast(bus, None, frame));
                Ok(())
            }
        }
    }

    fn write(&mut self, node: usize, bytes: &[u8]) -> Result<(), HubError> {
        if self.ended[node] {
            return Err(died(node));
        }
        for frame in bytes.split_inclusive(|&byte| byte == 0) {
            let arrives = self.fate.carry(node, Way::ToNode, self.now, frame.to_vec()).into_iter();
            let at = self.now + self.travel + self.line_delay;
            arrives.for_each(|frame| put(&mut self.to_node[node], at, Said::Line(frame)));
        }
        Ok(())
    }

    /// Carries what a node has said.
    fn carry(&mut self, node: usize, said: Said) {
        match said {
            Said::Line(frame) => {
                let arrives = self.fate.carry(node, Way::ToHost, self.now, frame).into_iter();
                self.to_host[node].extend(arrives.map(|frame| (self.now + self.travel, frame)));
            }
            Said::Bus(frame) => {
                let bus = self.buses.iter().position(|bus| bus.nodes.contains(&node)).unwrap();
                self.broadcast(bus, Some(node), frame);
            }
        }
    }

    /// Carries a frame from a node, or from the host, to all others on a bus, and to the host, who hears
    /// itself.
    fn broadcast(&mut self, bus: usize, from: Option<usize>, frame: PortFrame) {
        let at = self.now + self.travel;
        let bus = &mut self.buses[bus];
        for &node in bus.nodes.iter().filter(|&&node| Some(node) != from) {
            put(&mut self.to_node[node], at, Said::Bus(frame.clone()));
        }
        bus.to_host.push_back((at, frame));
    }

    fn read<T>(&mut self, from: Source, until: u64, task: &mut Task<'_, T>) -> Result<(), HubError> {
        loop {
            let wanted = |&bus: &usize| from == Source::All || from == Source::Bus(bus);
            if (0..self.buses.len()).filter(wanted).any(|bus| self.listen(bus, task)) {
                return Ok(());
            }
            for node in 0..self.boards.len() {
                let wanted = from == Source::All || from == Source::Line(node);
                if wanted && self.to_host[node].front().is_some_and(|&(at, _)| at <= self.now) {
                    let (at, bytes) = self.to_host[node].pop_front().unwrap();
                    task.on_bytes(node, &bytes, at);
                    return Ok(());
                }
                if wanted && self.ended[node] && !(self.off[node] && from == Source::All) {
                    return Err(died(node));
                }
            }
            if !self.go_on(until) {
                return Ok(());
            }
        }
    }

    /// Takes all that has come from a bus; whether something has.
    fn listen<T>(&mut self, bus: usize, task: &mut Task<'_, T>) -> bool {
        let (now, fd) = (self.now, self.buses[bus].fd);
        let mut some = false;
        while let Some((at, frame)) = self.buses[bus].to_host.pop_front_if(|(at, _)| *at <= now) {
            let (id, data) = (frame.id(), frame.data().to_vec());
            let what = Traffic::Frame { id, data, fd: fd.then_some(4) };
            let heard = Heard { at: SystemTime::UNIX_EPOCH + Duration::from_nanos(at), what };
            task.on_heard(bus, heard, at, now);
            some = true;
        }
        some
    }

    /// Goes on to what happens next, or to `until`; whether something happened.
    fn go_on(&mut self, until: u64) -> bool {
        let on_buses = self.buses.iter().filter_map(|bus| Some((self.later(&bus.to_host)?, None)));
        let at_nodes = (0..self.boards.len()).filter_map(|node| Some((self.next_of(node)?, Some(node))));
        let next = at_nodes.chain(on_buses).min();
        match next.filter(|&(at, _)| at < until) {
            Some((at, node)) => {
                self.now = self.now.max(at);
                node.into_iter().for_each(|node| self.happen(node));
                true
            }
            None => {
                self.now = self.now.max(until);
                false
            }
        }
    }

    /// When something happens next at a node: it hears, it speaks, or the host hears it.
    fn next_of(&self, node: usize) -> Option<u64> {
        let heard = self.to_node[node].front().map(|&(at, _)| at);
        let polled = self.boards[node].poll_at();
        [heard, polled, self.later(&self.to_host[node])].into_iter().flatten().min()
    }

    /// When the next frame comes to the host, if it has not come yet.
    fn later<T>(&self, line: &Line<T>) -> Option<u64> {
        line.front().map(|&(at, _)| at).filter(|&at| at > self.now)
    }

    fn happen(&mut self, node: usize) {
        match self.fate.befall(node, self.now) {
            Blow::None => {}
            blow => self.strike(node, blow),
        }
        let said = match self.to_node[node].front() {
            Some(&(at, _)) if at <= self.now => {
                let (_, heard) = self.to_node[node].pop_front().unwrap();
                match heard {
                    Said::Line(bytes) => self.boards[node].hear(&bytes, self.now),
                    Said::Bus(frame) => self.boards[node].hear_on_can(&frame, self.now),
                }
            }
            _ => self.boards[node].poll(self.now),
        };
        said.into_iter().for_each(|said| self.carry(node, said));
    }

    fn strike(&mut self, node: usize, blow: Blow) {
        self.boards[node].restart();
        self.to_node[node].clear();
        self.ended[node] |= blow == Blow::Replug;
    }
}

fn died(node: usize) -> HubError {
    let id = u8::try_from(node + 1).unwrap();
    HubError::Died { node: id, place: "the board".to_owned(), detail: "its line was closed".to_owned() }
}

/// The conductor of a scenario whose nodes are in a world.
pub fn conductor(scenario: &Scenario, drive: Drive, patience: Patience) -> Conductor {
    let conductor = conductor_of(scenario, &node_configs(scenario, drive).unwrap(), patience);
    conductor.with_staged(staged(scenario, drive))
}

/// The same with these configurations.
pub fn conductor_of(scenario: &Scenario, configs: &[NodeConfig], patience: Patience) -> Conductor {
    let seat = |id| Seat { id, place: "the board".to_owned(), uid: None };
    let seats = configs.iter().map(|config| seat(config.id)).collect();
    let spec = &scenario.bus;
    let params = IdealParams { loss: spec.loss, latency_ns: spec.latency_ns, jitter_ns: spec.jitter_ns };
    let bus = IdealBus::new(params, scenario.seed, listeners(scenario)).with_links(
        scenario.seed,
        &scenario.links,
        &scenario.spells(),
    );
    let course = scenario.course().on_clock(&scenario.time);
    let scene = || Scene::new(&course, scenario.time.tick_ns, listeners(scenario));
    let conductor = Conductor::new(seats, configs, bus, patience).with_noise(Noise::of(scenario));
    conductor.with_events((!scenario.stays_whole()).then(scene), Lies::of(scenario))
}

/// What events stage in the nodes of a scenario, by index.
pub fn staged(scenario: &Scenario, drive: Drive) -> Vec<Option<Staged>> {
    let configs = staged_configs(scenario, drive).unwrap().unwrap_or_default().into_iter();
    let tick = |index: usize| Some(u32::try_from(scenario.staged[index].as_ref()?.tick).unwrap());
    configs.enumerate().map(|(index, config)| Some(Staged { tick: tick(index)?, config })).collect()
}
