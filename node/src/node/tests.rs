//! The drawing of the state machine, beside what a node does.

extern crate std;

use super::adopt::Lasting;
use super::step::Step;
use super::{Node, Schedule};
use crate::Phase;
use crate::params::Params;
use crate::plant::{InputRange, PlantSetup};
use funnelnet_protocol::NodeConfig;
use funnelnet_protocol::config::{Shape, TickSource};
use funnelnet_protocol::message::{Command, Component, FaultCode, Message, NodeId, Target, TickStamp};
use std::borrow::ToOwned;
use std::collections::{BTreeSet, VecDeque};
use std::format;
use std::string::String;
use std::vec::Vec;

const MS: u64 = 1_000_000;
const PARTS: [&str; 3] = ["Phase", "Schedule", "Step"];

/// Part of the machine, from, name, to.
type Arrow = (&'static str, String, String, String);
type Input = (&'static str, fn(&mut Node));

fn command(command: Command) -> Message {
    Message::Ctrl { target: Target::All, command, arg: 0, at_tick: 0 }
}

fn sync(node: &mut Node, skipped: u32) {
    let previous_tick = TickStamp::full(node.tick().wrapping_sub(1).wrapping_add(skipped));
    let _ = node.on_message(&Message::Sync { source: None, previous_tick, phase_us: 0 }, 0);
}

fn hear(node: &mut Node, source: u8, x: f32) {
    let (source, tick) = (NodeId::new(source).unwrap(), TickStamp::low(node.tick(), 8));
    let _ = node.on_message(&Message::State { source, component: Component::FIRST, tick, x }, 0);
}

/// Lets as many ticks become due as are `late`, and one.
fn come_due(node: &mut Node, late: u64) {
    let now = match node.clock.schedule {
        Schedule::At(due) => due + late * MS,
        Schedule::Wait | Schedule::Now => 0,
    };
    node.run_due_ticks(now);
}

fn ask_for_commit(node: &mut Node) {
    let _ = node.commit_at(
        TickStamp::full(node.tick().wrapping_add(1)),
        Lasting::of(&config(node.params.tick_source)),
    );
}

/// Goes on with the node, whatever it has said.
fn ignore<T>(_: T) {}

/// All that can be done to a node. What happens inside of one [`Node::poll`] is done step by step.
const INPUTS: &[Input] = &[
    ("start", |node| ignore(node.on_message(&command(Command::Start), 0))),
    ("stop", |node| ignore(node.on_message(&command(Command::Stop), 0))),
    ("fault", |node| node.fail(FaultCode::BUS_OFF, 0)),
    ("fault", |node| hear(node, 1, 0.0)),
    ("fault", |node| node.check_holdover(u64::MAX)),
    ("hear", |node| hear(node, 2, 0.5)),
    ("hear", |node| hear(node, 2, 900.0)),
    ("SYNC", |node| sync(node, 0)),
    ("SYNC", |node| sync(node, 1)),
    ("SYNC", |node| sync(node, 5)),
    ("due", |node| come_due(node, 0)),
    ("due", |node| come_due(node, 1)),
    ("due", |node| come_due(node, 9)),
    ("told", |node| ignore(node.demand())),
    ("told", |node| ignore(node.take_stop())),
    ("sent", |node| ignore(node.next_outgoing())),
    ("commit_at", ask_for_commit),
    ("commit", |node| ignore(node.take_commit())),
    ("answer", |node| node.measured(&[0.5])),
    ("answer", |node| node.measured(&[999.0])),
    ("answer", Node::sample_failed),
    ("answer", Node::keep_on),
    ("answer", |node| ignore(node.adopt(node.params.clone(), &[]))),
];

fn config(tick_source: TickSource) -> NodeConfig {
    let holdover_ns = if tick_source == TickSource::Sync { 50 * MS } else { 0 };
    NodeConfig::builder(1, MS as u32)
        .tick_source(tick_source)
        .state([1.0])
        .state_limit(950.0)
        .funnel(Shape::Constant { width: 10.0 })
        .edge(2, 1.0)
        .holdover_ns(holdover_ns)
        .build()
        .unwrap()
}

/// Nodes that are ready: virtual and with a plant, by their own timer and by SYNC.
fn nodes() -> Vec<Node> {
    let node = |(tick_source, has_plant): (TickSource, bool)| {
        let config = config(tick_source);
        let plant = PlantSetup::new([InputRange::new(-1.0, 1.0).unwrap()], 2);
        let params = Params::new(&config).unwrap();
        let params = if has_plant { params.with_plant(plant).unwrap() } else { params };
        Node::new(params, &config.neighbours)
    };
    let kinds = [TickSource::Timer, TickSource::Sync]
        .into_iter()
        .flat_map(|source| [(source, false), (source, true)]);
    kinds.map(node).collect()
}

/// Phase, schedule and step, with all that belongs to them.
fn whole(node: &Node) -> [String; 3] {
    [format!("{:?}", node.phase), format!("{:?}", node.clock.schedule), format!("{:?}", node.step)]
}

/// The same as they are drawn: neither the cause of a fault nor the time of a tick.
fn drawn(whole: &[String; 3]) -> [String; 3] {
    let [phase, schedule, step] = whole;
    let short = |text: &str| text.split('(').next().unwrap_or_default().to_owned();
    [short(phase), short(schedule), step.clone()]
}

/// The arrows that one input was.
fn passed(name: &'static str, before: &Node, after: &Node) -> Vec<Arrow> {
    let failed = |node: &Node| matches!(node.phase, Phase::Faulted(_));
    let name = if failed(after) && !failed(before) { "fault" } else { name };
    let (before, after) = (whole(before), whole(after));
    let (from, to) = (drawn(&before), drawn(&after));
    let changed = (0..3).filter(|&part| before[part] != after[part]);
    let arrow = |part: usize| {
        let name = if part > 0 && matches!(name, "stop" | "fault") { "halt" } else { name };
        (PARTS[part], from[part].clone(), name.to_owned(), to[part].clone())
    };
    changed.map(arrow).collect()
}

/// All arrows that there are from `ready` on. Of nodes that are alike one is gone on with.
fn explore(ready: Node, found: &mut BTreeSet<Arrow>) {
    let alike = |node: &Node| {
        let commit = (node.clock.commit.is_some(), node.clock.commit_is_due());
        (drawn(&whole(node)), commit, node.counters.ticks == 0, node.outbox.is_empty())
    };
    let (mut known, mut waiting) = (BTreeSet::from([alike(&ready)]), VecDeque::from([ready]));
    while let Some(node) = waiting.pop_front() {
        let rests = node.clock.schedule == Schedule::Wait && matches!(node.step, Step::Idle | Step::Stop);
        assert!(node.phase == Phase::Running || rests, "{:?}", whole(&node));
        for &(name, input) in INPUTS {
            let mut next = node.clone();
            input(&mut next);
            found.extend(passed(name, &node, &next));
            if known.insert(alike(&next)) {
                waiting.push_back(next);
            }
        }
    }
}

/// The arrows of the drawing: `From --name--> To --name--> To`, below the name of a part.
fn drawing() -> BTreeSet<Arrow> {
    let text = include_str!("mod.rs");
    let lines =
        text.lines().skip_while(|line| *line != "//! ```text").skip(1).take_while(|line| *line != "//! ```");
    let (mut part, mut arrows) = ("", BTreeSet::new());
    for line in lines {
        let mut words: Vec<_> = line.trim_start_matches("//!").split_whitespace().collect();
        if let Some(named) = PARTS.into_iter().find(|part| words.first() == Some(part)) {
            part = named;
            words.remove(0);
        }
        for at in (1..words.len()).step_by(2) {
            let name = words[at].trim_matches(['-', '>']).to_owned();
            arrows.insert((part, words[at - 1].to_owned(), name, words[at + 1].to_owned()));
        }
    }
    arrows
}

#[test]
fn a_node_does_what_is_drawn_and_nothing_else() {
    let mut found = BTreeSet::new();
    nodes().into_iter().for_each(|node| explore(node, &mut found));
    let drawing = drawing();
    let not_drawn: Vec<_> = found.difference(&drawing).collect();
    let never: Vec<_> = drawing.difference(&found).collect();
    assert!(not_drawn.is_empty() && never.is_empty(), "not drawn: {not_drawn:#?}; never: {never:#?}");
    assert!(drawing.len() > 25, "{}", drawing.len());
}
