//! A neighbour that says that it has stopped is known to be gone, and is not extrapolated.
#![allow(clippy::unwrap_used)]

use funnelnet_node::neighbour::Presence;
use funnelnet_node::{Action, Event, Node, Params, Phase};
use funnelnet_protocol::NodeConfig;
use funnelnet_protocol::config::{EdgeConfig, Shape};
use funnelnet_protocol::message::{
    Command, Component, FaultCode, Message, NodeId, Severity, Target, TickStamp,
};
use funnelnet_protocol::refusal::Refusal;

const MS: u64 = 1_000_000;

fn id(id: u8) -> NodeId {
    NodeId::new(id).unwrap()
}

fn edge(id: u8) -> EdgeConfig {
    EdgeConfig { id, weight: 1.0, edges: 1 }
}

/// Node 1, which hears 2 and 3.
fn node() -> Node {
    let config = NodeConfig::builder(1, MS as u32)
        .state([0.0])
        .state_limit(1e6)
        .funnel(Shape::Constant { width: 10.0 })
        .edges([edge(2), edge(3)])
        .extrapolate_ticks(30)
        .build()
        .unwrap();
    let mut node = Node::new(Params::new(&config).unwrap(), &config.neighbours);
    node.on_message(&ctrl(Target::All, Command::Start), 0).unwrap();
    actions(&mut node, 0);
    node
}

fn ctrl(target: Target, command: Command) -> Message {
    Message::Ctrl { target, command, arg: 0, at_tick: 0 }
}

fn state(source: u8, tick: u32, x: f32) -> Message {
    Message::State { source: id(source), component: Component::FIRST, tick: TickStamp::low(tick, 8), x }
}

/// As CAN carries it, with eight bits of the tick.
fn fault(source: u8, severity: Severity, tick: u32) -> Message {
    let tick = TickStamp::low(tick, 8);
    Message::Fault { source: id(source), code: FaultCode::LEAVES, severity, arg: 0, tick }
}

fn actions(node: &mut Node, now: u64) -> Vec<Action> {
    core::iter::from_fn(|| node.poll(now)).collect()
}

/// Runs tick `k`, for which both neighbours are heard where they say something.
fn tick(node: &mut Node, k: u32, says: impl IntoIterator<Item = Message>) -> Vec<Action> {
    for message in says {
        node.on_message(&message, u64::from(k) * MS).unwrap();
    }
    actions(node, u64::from(k + 1) * MS)
}

fn both(k: u32) -> [Message; 2] {
    [state(2, k, 2.0), state(3, k, 1.0)]
}

fn nu(node: &Node) -> f32 {
    let seen = &node.observations()[0];
    seen.nu + 2.0 * seen.x
}

fn lost() -> Action {
    Action::Report(Event::NeighbourLost(id(2)))
}

#[test]
fn a_neighbour_that_says_it_has_stopped_is_dropped_at_once() {
    let mut node = node();
    tick(&mut node, 0, both(0));
    tick(&mut node, 1, both(1));
    assert!((nu(&node) - 3.0).abs() < 1e-6);
    node.on_message(&fault(2, Severity::Stopped, 1), 2 * MS).unwrap();
    let said = tick(&mut node, 2, [state(3, 2, 1.0)]);
    assert!(said.contains(&lost()), "{said:?}");
    let seen = node.observations()[0];
    assert!((seen.nu + seen.x - 1.0).abs() < 1e-6, "{seen:?}");
    let counters = node.counters();
    assert_eq!((counters.neighbours_lost, counters.extrapolated), (1, 0));
    assert_eq!(node.neighbour_presence(id(2)), Some(Presence::Lost));
    // Once.
    node.on_message(&fault(2, Severity::Stopped, 1), 3 * MS).unwrap();
    assert!(!tick(&mut node, 3, [state(3, 3, 1.0)]).contains(&lost()));
    assert_eq!(node.counters().neighbours_lost, 1);
}

/// On CAN a FAULT goes before a state that waits.
#[test]
fn what_it_has_said_before_counts_no_more_and_what_it_says_when_it_is_back_does() {
    let mut node = node();
    tick(&mut node, 0, both(0));
    node.on_message(&fault(2, Severity::Stopped, 1), MS).unwrap();
    assert_eq!(node.on_message(&state(2, 1, 2.0), MS), Err(Refusal::Stale));
    tick(&mut node, 1, [state(3, 1, 1.0)]);
    let said = tick(&mut node, 2, [state(2, 2, 5.0), state(3, 2, 1.0)]);
    assert!(said.contains(&Action::Report(Event::NeighbourFound(id(2)))), "{said:?}");
    assert!((nu(&node) - 6.0).abs() < 1e-6);
    // A goodbye that was on its way for longer than that drops nobody.
    node.on_message(&fault(2, Severity::Stopped, 1), 3 * MS).unwrap();
    tick(&mut node, 3, both(3));
    assert_eq!(node.counters().neighbours_lost, 1);
    assert_eq!(node.neighbour_presence(id(2)), Some(Presence::Known));
}

#[test]
fn a_warning_a_stranger_and_a_goodbye_of_another_time_drop_nobody() {
    let mut node = node();
    tick(&mut node, 0, both(0));
    for fault in [
        fault(2, Severity::Warning, 1),
        fault(2, Severity::Notice, 1),
        fault(4, Severity::Stopped, 1),
        // Farther from its own tick than any state that it would take.
        fault(2, Severity::Stopped, 100),
    ] {
        node.on_message(&fault, MS).unwrap();
    }
    tick(&mut node, 1, both(1));
    assert_eq!((node.counters().neighbours_lost, node.phase()), (0, Phase::Running));
}

#[test]
fn without_its_last_neighbour_it_holds_its_input() {
    let mut node = node();
    tick(&mut node, 0, both(0));
    tick(&mut node, 1, both(1));
    let u = node.observations()[0].u;
    for neighbour in [2, 3] {
        node.on_message(&fault(neighbour, Severity::Stopped, 2), 2 * MS).unwrap();
    }
    tick(&mut node, 2, []);
    let held = node.observations()[0].u;
    assert!(u > 0.1 && held < u && held > 0.99 * u, "{u} {held}");
}

/// Where all stop, nobody needs to know.
#[test]
fn a_node_that_is_told_to_stop_alone_says_goodbye() {
    let said = |target: Target, runs: bool| {
        let mut node = node();
        if runs {
            tick(&mut node, 0, both(0));
        }
        node.on_message(&ctrl(target, Command::Stop), MS).unwrap();
        assert_eq!(node.phase(), Phase::Stopped);
        actions(&mut node, 2 * MS)
            .into_iter()
            .filter(|action| matches!(action, Action::Send(_)))
            .collect::<Vec<_>>()
    };
    let goodbye = |tick: u32| {
        let tick = TickStamp::full(tick);
        let (code, severity) = (FaultCode::LEAVES, Severity::Stopped);
        vec![Action::Send(Message::Fault { source: id(1), code, severity, arg: 0, tick })]
    };
    assert_eq!(said(Target::Node(id(1)), true), goodbye(1));
    assert_eq!(said(Target::Node(id(1)), false), goodbye(0));
    assert_eq!(said(Target::All, true), []);
    let mut other = node();
    other.on_message(&ctrl(Target::Node(id(2)), Command::Stop), MS).unwrap();
    assert_eq!(other.phase(), Phase::Running);
}
