//! Nodes whose inboxes and ticks come late, in ways that no log tells, are replayed from the log all the
//! same.
#![allow(clippy::unwrap_used, clippy::panic, reason = "helpers of tests, which clippy does not know as such")]

use super::own_clock::OwnClock;
use super::survey::{Drive, Survey};
use super::twin::Twin;
use super::{Entry, function_of};
use crate::can::AnyFormat;
use crate::random::{Purpose, below, happens, stream};
use crate::scenario::{Override, Scenario};
use funnelnet_can_bus::{Frame, Id, Record};
use funnelnet_link::Frame as _;
use funnelnet_protocol::can::function;
use funnelnet_protocol::message::{Command, Message, Target};
use std::collections::VecDeque;
use std::path::Path;

const TICKS: usize = 400;

/// A node as it was in the world, which the log does not have.
struct Real {
    twin: Twin,
    inbox: VecDeque<Entry>,
    late: u32,
}

/// What the world did.
#[derive(Default)]
struct World {
    log: Vec<Entry>,
    left_waiting: usize,
    latest: u32,
}

fn scenario() -> Scenario {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../scenarios/five-agents.toml");
    let sets = ["time.tick=50ms", "time.duration=20s"].map(|set| Override::parse(set).unwrap());
    Scenario::parse(&std::fs::read_to_string(&path).unwrap(), &path, &sets).unwrap()
}

fn twin(scenario: &Scenario, id: u8) -> Twin {
    let survey = Survey { interface: "can0".to_owned(), fd: false, drive: Drive::OwnClock };
    Twin::new(scenario, id, &survey).unwrap()
}

impl World {
    fn new(seed: u64) -> Self {
        let mut random = stream(seed, Purpose::Noise, 0);
        let scenario = scenario();
        let mut nodes: Vec<Real> =
            (1..=5).map(|id| Real { twin: twin(&scenario, id), inbox: VecDeque::new(), late: 0 }).collect();
        let mut world = Self::default();
        let start = Message::Ctrl { target: Target::All, command: Command::Start, arg: 0, at_tick: 0 };
        for frame in AnyFormat::new(false).pack(&start) {
            world.say(&mut nodes, None, frame.id(), frame.data());
        }
        for _ in 0..TICKS {
            let first = below(&mut random, 5);
            for index in (first..5).chain(0..first) {
                let node = &mut nodes[index];
                // Its system takes its time: it misses this tick, and makes up for it.
                if node.late < 7 && happens(&mut random, if node.late == 0 { 0.02 } else { 0.7 }) {
                    node.late += 1;
                    continue;
                }
                let waiting = node.inbox.len();
                let heard =
                    if happens(&mut random, 0.02) { below(&mut random, waiting + 1) } else { waiting };
                for entry in node.inbox.drain(..heard).collect::<Vec<_>>() {
                    node.twin.hear(&entry, 0);
                }
                world.left_waiting += node.inbox.len();
                world.latest = world.latest.max(node.late);
                let late = std::mem::take(&mut node.late);
                node.twin.step(late);
                let sent: Vec<_> = node.twin.sent.values_mut().flat_map(std::mem::take).collect();
                for sent in sent {
                    world.say(&mut nodes, Some(index), sent.frame.id(), sent.frame.data());
                }
            }
        }
        world
    }

    fn say(&mut self, nodes: &mut [Real], from: Option<usize>, id: u16, bytes: &[u8]) {
        let frame = Frame::data(Id::Base(id), bytes).unwrap();
        let record = Record::of_frame(0, &frame, false);
        let entry = Entry { line: self.log.len() + 1, interface: "can0".to_owned(), record };
        let others = nodes.iter_mut().enumerate().filter(|(index, _)| Some(*index) != from);
        others.for_each(|(_, node)| node.inbox.push_back(entry.clone()));
        self.log.push(entry);
    }

    /// What a replay of node `id` comes to: frames that were found, and states that a newer one replaced.
    ///
    /// # Errors
    /// Frames before the first difference.
    fn replay(&self, id: u8) -> Result<(usize, u32), usize> {
        let mut replay = OwnClock::new(twin(&scenario(), id));
        let (mut found, mut replaced) = (0, 0);
        for entry in &self.log {
            let (raw, bytes) = entry.real_time().unwrap();
            if raw >> 7 == 0 || (raw & 0x7F) as u8 != id {
                replay.hear(entry);
                continue;
            }
            replaced += replay.take(raw, bytes, false).map_err(|_| found)?.1;
            found += 1;
        }
        Ok((found, replaced))
    }

    fn of(&self, id: u8) -> usize {
        let is_own = |entry: &&Entry| {
            let (raw, _) = entry.real_time().unwrap();
            raw >> 7 > 0 && (raw & 0x7F) as u8 == id
        };
        self.log.iter().filter(is_own).count()
    }
}

#[test]
fn frames_that_waited_and_ticks_that_came_late_are_found() {
    for seed in 0..3 {
        let world = World::new(seed);
        assert!(world.left_waiting > 10 && world.latest > 4, "{} {}", world.left_waiting, world.latest);
        for id in 1..=5 {
            let (found, replaced) =
                world.replay(id).unwrap_or_else(|found| panic!("seed {seed} node {id}: {found}"));
            assert_eq!(found, world.of(id));
            assert!(replaced > 0, "seed {seed} node {id}: {replaced}");
        }
    }
}

/// The last bit of the value, and bits of the stamp: a tick that is 2, 8 or 64 ticks away.
#[test]
fn a_bit_that_is_changed_is_found() {
    for (byte, bit) in [(0, 0), (4, 1), (4, 3), (4, 6)] {
        let mut world = World::new(1);
        let state =
            |entry: &Entry| entry.real_time().is_some_and(|(raw, _)| function_of(raw) == function::STATE);
        let states: Vec<usize> = (0..world.log.len()).filter(|&at| state(&world.log[at])).collect();
        let at = states[states.len() / 2];
        let (raw, mut bytes) = world.log[at].real_time().map(|(raw, bytes)| (raw, bytes.to_vec())).unwrap();
        bytes[byte] ^= 1 << bit;
        let (id, frame) = ((raw & 0x7F) as u8, Frame::data(Id::Base(raw), &bytes).unwrap());
        world.log[at].record = Record::of_frame(0, &frame, false);
        let own = |entry: &&Entry| {
            entry.real_time().is_some_and(|(raw, _)| (raw & 0x7F) as u8 == id && raw >> 7 > 0)
        };
        let before = world.log[..at].iter().filter(own).count();
        assert_eq!(world.replay(id), Err(before), "bit {bit} of byte {byte}");
    }
}
