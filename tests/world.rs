//! The world of a bench in virtual time: nodes in memory, and lines on which frames take their time and may come to harm. It does what the
//! conductor asks for, as `sim_host::hub` does on real lines.

use crate::board::Board;
use sim_host::bus::ideal::{IdealBus, IdealParams};
use sim_host::conductor::{Action, Conductor, HubError, Patience, Seat, Source, Step, Task};
use sim_host::configure::{Drive, listeners, node_configs};
use sim_host::noise::Noise;
use sim_host::scenario::Scenario;
use std::collections::VecDeque;

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

/// Bytes on their way, each with the time of its arrival.
type Line = VecDeque<(u64, Vec<u8>)>;

/// Boards, lines and a clock.
pub struct World<F: Fate = Peace> {
    boards: Vec<Board>,
    to_node: Vec<Line>,
    to_host: Vec<Line>,
    /// The line has ended, by node.
    ended: Vec<bool>,
    now: u64,
    /// Time that a frame takes either way, ns.
    travel: u64,
    /// What may happen.
    pub fate: F,
}

impl<F: Fate> World<F> {
    /// So many blank boards; a frame takes `travel` either way, ns.
    pub fn new(nodes: usize, travel: u64, fate: F) -> Self {
        let lines = || vec![Line::new(); nodes];
        let boards = (0..nodes).map(|_| Board::new()).collect();
        Self { boards, to_node: lines(), to_host: lines(), ended: vec![false; nodes], now: 0, travel, fate }
    }

    /// Time, ns.
    pub fn now(&self) -> u64 {
        self.now
    }

    /// The boards, by index.
    pub fn boards(&self) -> &[Board] {
        &self.boards
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
            Action::Say { .. } => panic!("there is no CAN here"),
        }
    }

    fn write(&mut self, node: usize, bytes: &[u8]) -> Result<(), HubError> {
        if self.ended[node] {
            return Err(died(node));
        }
        for frame in bytes.split_inclusive(|&byte| byte == 0) {
            self.send(node, Way::ToNode, self.now, frame.to_vec());
        }
        Ok(())
    }

    /// Puts a frame on a line at `at`.
    fn send(&mut self, node: usize, way: Way, at: u64, frame: Vec<u8>) {
        let line = match way {
            Way::ToNode => &mut self.to_node[node],
            Way::ToHost => &mut self.to_host[node],
        };
        line.extend(self.fate.carry(node, way, at, frame).into_iter().map(|frame| (at + self.travel, frame)));
    }

    fn read<T>(&mut self, from: Source, until: u64, task: &mut Task<'_, T>) -> Result<(), HubError> {
        loop {
            for node in 0..self.boards.len() {
                let wanted = from == Source::All || from == Source::Line(node);
                if wanted && self.to_host[node].front().is_some_and(|&(at, _)| at <= self.now) {
                    let (at, bytes) = self.to_host[node].pop_front().unwrap();
                    task.on_bytes(node, &bytes, at);
                    return Ok(());
                }
                if wanted && self.ended[node] {
                    return Err(died(node));
                }
            }
            if !self.go_on(until) {
                return Ok(());
            }
        }
    }

    /// Goes on to what happens next, or to `until`; whether something happened.
    fn go_on(&mut self, until: u64) -> bool {
        let next = (0..self.boards.len()).filter_map(|node| Some((self.next_of(node)?, node))).min();
        match next.filter(|&(at, _)| at < until) {
            Some((at, node)) => {
                self.now = self.now.max(at);
                self.happen(node);
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
        let read = self.to_host[node].front().map(|&(at, _)| at).filter(|&at| at > self.now);
        [heard, polled, read].into_iter().flatten().min()
    }

    fn happen(&mut self, node: usize) {
        match self.fate.befall(node, self.now) {
            Blow::None => {}
            blow => self.strike(node, blow),
        }
        let said = match self.to_node[node].front() {
            Some(&(at, _)) if at <= self.now => {
                let (_, bytes) = self.to_node[node].pop_front().unwrap();
                self.boards[node].hear(&bytes, self.now)
            }
            _ => self.boards[node].poll(self.now),
        };
        for frame in said {
            self.send(node, Way::ToHost, self.now, frame);
        }
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
    let configs = node_configs(scenario, drive).unwrap();
    let seat = |id| Seat { id, place: "the board".to_owned(), uid: None };
    let seats = configs.iter().map(|config| seat(config.id)).collect();
    let spec = &scenario.bus;
    let params = IdealParams { loss: spec.loss, latency_ns: spec.latency_ns, jitter_ns: spec.jitter_ns };
    let bus = IdealBus::new(params, scenario.seed, listeners(scenario));
    Conductor::new(seats, &configs, bus, patience).with_noise(Noise::of(scenario))
}
