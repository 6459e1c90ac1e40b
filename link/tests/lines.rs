//! Networks of nodes on lines to each other: what is said once gets everywhere, goes over each line at most
//! once in each direction, and dies.
#![allow(clippy::unwrap_used, clippy::panic, reason = "helpers of tests, which clippy does not know as such")]

use funnelnet_link::{FORGET_MS, Forwarder, HOST_LINE};
use funnelnet_protocol::message::{
    Command, Component, FaultCode, Message, NodeId, Severity, Target, TickStamp,
};
use proptest::prelude::*;
use std::collections::{BTreeMap, BTreeSet, VecDeque};

const PEERS: usize = 4;
/// To the host, and to neighbours.
const LINES: usize = 1 + PEERS;

/// Where a line of a node leads.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
struct End {
    node: usize,
    line: usize,
}

/// Nodes, their lines, and the frames on them. Each line carries frames in order, and how fast is up to the
/// test.
struct Network {
    forwarders: Vec<Forwarder<PEERS>>,
    /// The other end of each line between nodes.
    wires: BTreeMap<End, End>,
    /// Frames on their way to an end.
    on_the_way: BTreeMap<End, VecDeque<Message>>,
    /// Ends whose node takes nothing in and gives nothing out there.
    stuck: BTreeSet<End>,
    /// Frames that have left by an end, in order, also by lines to a host.
    left: Vec<(End, Message)>,
    /// What each node was given, in order.
    given: Vec<Vec<Message>>,
    now: u64,
}

impl Network {
    /// `nodes` nodes with lines between those of `edges`, as far as they have lines.
    fn new(nodes: usize, edges: &[(usize, usize)]) -> Self {
        let mut free = vec![HOST_LINE + 1; nodes];
        let mut wires = BTreeMap::new();
        for &(a, b) in edges {
            if a != b && free[a] < LINES && free[b] < LINES {
                let ends = [a, b].map(|node| End { node, line: free[node] });
                wires.insert(ends[0], ends[1]);
                wires.insert(ends[1], ends[0]);
                free[a] += 1;
                free[b] += 1;
            }
        }
        Self {
            forwarders: (0..nodes).map(|_| Forwarder::new()).collect(),
            wires,
            on_the_way: BTreeMap::new(),
            stuck: BTreeSet::new(),
            left: Vec::new(),
            given: vec![Vec::new(); nodes],
            now: 0,
        }
    }

    fn host_says(&mut self, node: usize, message: Message) {
        self.on_the_way.entry(End { node, line: HOST_LINE }).or_default().push_back(message);
    }

    fn say(&mut self, node: usize, message: Message) {
        // A node says whole ticks, of which a line carries the low 16 bits.
        let message = match message {
            Message::Fault { source, code, severity, arg, tick } => {
                let tick = TickStamp::full(1 << 20 | tick.value());
                Message::Fault { source, code, severity, arg, tick }
            }
            message => message,
        };
        self.forwarders[node].send(&message, self.now);
    }

    /// Everything that can happen next.
    fn moves(&self) -> Vec<Move> {
        let takes = |(&end, frames): (&End, &VecDeque<Message>)| {
            (!frames.is_empty() && !self.stuck.contains(&end)).then_some(Move::Arrive(end))
        };
        let arrivals = self.on_the_way.iter().filter_map(takes);
        let ends = (0..self.forwarders.len()).flat_map(|node| (0..LINES).map(move |line| End { node, line }));
        arrivals.chain(ends.filter(|end| !self.stuck.contains(end)).map(Move::Leave)).collect()
    }

    /// Whether something has happened.
    fn make(&mut self, next: Move) -> bool {
        match next {
            Move::Arrive(end) => {
                let Some(message) = self.on_the_way.get_mut(&end).and_then(VecDeque::pop_front) else {
                    return false;
                };
                if self.forwarders[end.node].hear(end.line, &message, self.now) {
                    self.given[end.node].push(message);
                }
                true
            }
            Move::Leave(end) => {
                let Some(message) = self.forwarders[end.node].take(end.line) else { return false };
                self.left.push((end, message));
                if let Some(&other) = self.wires.get(&end) {
                    self.on_the_way.entry(other).or_default().push_back(message);
                }
                true
            }
        }
    }

    /// Lets `choices` say what happens next, then everything that is left; fails where that has no end.
    fn run(&mut self, choices: &[usize]) {
        for &choice in choices {
            let moves = self.moves();
            if let Some(&next) = moves.get(choice % moves.len().max(1)) {
                self.make(next);
            }
        }
        for _ in 0..10_000 {
            let moves = self.moves();
            if !moves.into_iter().fold(false, |any, next| self.make(next) | any) {
                return;
            }
        }
        panic!("frames go round for ever");
    }

    /// Nodes that `from` reaches by lines on which both ends take part.
    fn reached(&self, from: usize) -> BTreeSet<usize> {
        let mut reached = BTreeSet::from([from]);
        loop {
            let works = |end: &End| !self.stuck.contains(end);
            let next = self.wires.iter().filter(|(a, b)| works(a) && works(b) && reached.contains(&a.node));
            let more: BTreeSet<_> =
                next.map(|(_, b)| b.node).filter(|node| !reached.contains(node)).collect();
            if more.is_empty() {
                return reached;
            }
            reached.extend(more);
        }
    }

    /// The most often that a frame has left by the same end.
    fn most_often(&self) -> usize {
        let same = |(end, message): &(End, Message)| {
            self.left.iter().filter(|(other, frame)| other == end && frame == message).count()
        };
        self.left.iter().map(same).max().unwrap_or(0)
    }

    /// Those of the frames that a node was given which are among `wanted`, in order.
    fn given_of(&self, node: usize, wanted: &[Message]) -> Vec<Message> {
        self.given[node].iter().copied().filter(|message| wanted.contains(message)).collect()
    }

    fn to_host(&self, node: usize) -> Vec<Message> {
        let host = End { node, line: HOST_LINE };
        self.left.iter().filter(|(end, _)| *end == host).map(|(_, message)| *message).collect()
    }
}

#[derive(Clone, Copy, Debug)]
enum Move {
    Arrive(End),
    Leave(End),
}

fn id(node: usize) -> NodeId {
    NodeId::new(node as u8 + 1).unwrap()
}

fn ctrl(command: Command, arg: u8) -> Message {
    Message::Ctrl { target: Target::All, command, arg, at_tick: 7 }
}

fn sync(previous: u32) -> Message {
    Message::Sync { source: None, previous_tick: TickStamp::low(previous, 24), phase_us: 0 }
}

fn fault(node: usize, tick: u32) -> Message {
    let tick = TickStamp::low(tick, 16);
    Message::Fault { source: id(node), code: FaultCode::HOLDOVER, severity: Severity::Stopped, arg: 9, tick }
}

fn state(node: usize, component: u8, tick: u32) -> Message {
    let component = Component::new(component).unwrap();
    Message::State { source: id(node), component, tick: TickStamp::full(tick), x: tick as f32 }
}

fn ring(nodes: usize) -> Vec<(usize, usize)> {
    (0..nodes).map(|node| (node, (node + 1) % nodes)).collect()
}

/// A graph on up to eight nodes, parallel lines among them, and in which order things happen.
fn graphs() -> impl Strategy<Value = (usize, Vec<(usize, usize)>, Vec<usize>)> {
    (2..9_usize).prop_flat_map(|nodes| {
        let edges = prop::collection::vec((0..nodes, 0..nodes), 0..14);
        (Just(nodes), edges, prop::collection::vec(0..1_000_usize, 0..400))
    })
}

proptest! {
    #[test]
    fn commands_from_any_hosts_reach_all_once_in_order_and_die(
        (nodes, edges, choices) in graphs(),
        hosts in prop::collection::btree_set(0..8_usize, 1..4),
    ) {
        let mut network = Network::new(nodes, &edges);
        let commands = [
            ctrl(Command::Start, 1),
            ctrl(Command::Stop, 2),
            ctrl(Command::Commit, 3),
            // The same once more, which is another one by its number.
            ctrl(Command::Start, 4),
        ];
        let hosts: BTreeSet<_> = hosts.into_iter().map(|host| host % nodes).collect();
        for &host in &hosts {
            commands.iter().for_each(|&command| network.host_says(host, command));
        }
        network.run(&choices);
        let reached: BTreeSet<_> = hosts.iter().flat_map(|&host| network.reached(host)).collect();
        for node in 0..nodes {
            let expected: &[Message] = if reached.contains(&node) { &commands } else { &[] };
            prop_assert_eq!(&network.given[node], expected);
            // They came from hosts, who need not hear them.
            prop_assert!(network.to_host(node).is_empty());
        }
        prop_assert!(network.most_often() <= 1, "{:?}", network.left);
    }

    #[test]
    fn sync_goes_over_each_line_at_most_once_and_the_last_one_reaches_all(
        (nodes, edges, choices) in graphs(),
        ticks in prop::collection::vec(1..3_u32, 1..8),
        hosts in prop::collection::btree_set(0..8_usize, 1..4),
    ) {
        let mut network = Network::new(nodes, &edges);
        let hosts: BTreeSet<_> = hosts.into_iter().map(|host| host % nodes).collect();
        let mut tick = u32::MAX - 1;
        for &step in &ticks {
            tick = tick.wrapping_add(step);
            hosts.iter().for_each(|&host| network.host_says(host, sync(tick)));
        }
        network.run(&choices);
        prop_assert!((0..nodes).all(|node| network.to_host(node).is_empty()));
        for &node in hosts.iter().flat_map(|&host| network.reached(host)).collect::<BTreeSet<_>>().iter() {
            prop_assert_eq!(network.given[node].last(), Some(&sync(tick)));
            // None twice, none after a later one.
            let past = |message: &Message| match message {
                Message::Sync { previous_tick, .. } => tick.wrapping_sub(previous_tick.value()) & 0xFF_FFFF,
                _ => unreachable!(),
            };
            let order: Vec<_> = network.given[node].iter().map(past).collect();
            prop_assert!(order.windows(2).all(|two| two[0] > two[1]), "{:?}", order);
        }
        prop_assert!(network.most_often() <= 1, "{:?}", network.left);
    }

    #[test]
    fn faults_of_all_nodes_reach_every_node_and_every_host(
        (nodes, edges, choices) in graphs(),
        twice in prop::collection::btree_set(0..8_usize, 0..8),
    ) {
        let mut network = Network::new(nodes, &edges);
        for node in 0..nodes {
            network.say(node, fault(node, 70_000));
            if twice.contains(&node) {
                // A restarted node has an older tick.
                network.say(node, fault(node, 3));
            }
        }
        network.run(&choices);
        for node in 0..nodes {
            let reached = network.reached(node);
            let of = |&other: &usize| [Some(fault(other, 70_000)), twice.contains(&other).then(|| fault(other, 3))];
            let known: Vec<_> = reached.iter().flat_map(of).flatten().collect();
            let foreign: Vec<_> = reached.iter().filter(|&&other| other != node).flat_map(of).flatten().collect();
            let mut given = network.given[node].clone();
            let mut told = network.to_host(node);
            given.sort_by_key(|message| format!("{message:?}"));
            told.sort_by_key(|message| format!("{message:?}"));
            let sorted = |mut messages: Vec<Message>| {
                messages.sort_by_key(|message| format!("{message:?}"));
                messages
            };
            prop_assert_eq!(given, sorted(foreign));
            prop_assert_eq!(told, sorted(known));
        }
        prop_assert!(network.most_often() <= 1, "{:?}", network.left);
    }

    /// Whatever lines are stuck, what the others carry is what they would carry without those.
    #[test]
    fn a_stuck_line_holds_up_no_other((nodes, edges, choices) in graphs(), stuck in prop::collection::vec((0..8_usize, 1..LINES), 1..4)) {
        let mut network = Network::new(nodes, &edges);
        network.stuck = stuck.into_iter().map(|(node, line)| End { node: node % nodes, line }).collect();
        let others: Vec<_> = network.stuck.iter().filter_map(|end| network.wires.get(end).copied()).collect();
        network.stuck.extend(others);
        for tick in 0..100 {
            network.host_says(0, sync(tick));
            (0..nodes).for_each(|node| network.say(node, state(node, 0, tick)));
        }
        let stop = ctrl(Command::Stop, 1);
        network.host_says(0, stop);
        network.run(&choices);
        for node in network.reached(0) {
            prop_assert_eq!(network.given_of(node, &[stop, sync(99)]).len(), 2);
        }
        for (end, other) in network.wires.clone() {
            if !network.stuck.contains(&end) {
                prop_assert!(network.given[other.node].contains(&state(end.node, 0, 99)));
            }
        }
    }
}

#[test]
fn own_states_and_edges_go_on_all_lines_and_a_neighbours_goes_no_further() {
    let mut network = Network::new(3, &[(0, 1), (1, 2)]);
    let edge = Message::Edge { source: id(0), neighbour: id(1), weight: 2.0 };
    network.say(0, state(0, 0, 5));
    network.say(0, state(0, 1, 5));
    network.say(0, edge);
    network.run(&[]);
    let said = vec![state(0, 0, 5), state(0, 1, 5), edge];
    assert_eq!(network.given[1], said);
    assert_eq!(network.to_host(0), said);
    assert!(network.given[2].is_empty() && network.to_host(1).is_empty());
}

#[test]
fn of_what_waits_the_latest_counts_and_a_state_leaves_before_the_sync_that_came_after_it() {
    let mut forwarder: Forwarder<1> = Forwarder::new();
    for tick in 1..=3 {
        forwarder.send(&state(0, 0, tick), 0);
        forwarder.send(&state(0, 1, tick), 0);
        assert!(forwarder.hear(HOST_LINE, &sync(tick), 0));
    }
    let waiting: Vec<_> = std::iter::from_fn(|| forwarder.take(1)).collect();
    assert_eq!(waiting, [state(0, 0, 3), state(0, 1, 3), sync(3)]);
    // The host is not told what it has said.
    assert_eq!(std::iter::from_fn(|| forwarder.take(HOST_LINE)).count(), 2);
}

#[test]
fn on_a_line_that_is_too_slow_for_both_state_and_sync_take_turns() {
    let mut forwarder: Forwarder<1> = Forwarder::new();
    let sent = (1..=6).filter_map(|tick| {
        assert!(forwarder.hear(HOST_LINE, &sync(tick), 0));
        forwarder.send(&state(0, 0, tick), 0);
        forwarder.take(1)
    });
    let sent: Vec<_> = sent.collect();
    assert_eq!(sent, [sync(1), state(0, 0, 2), sync(3), state(0, 0, 4), sync(5), state(0, 0, 6)]);
}

#[test]
fn what_makes_a_node_speak_leaves_before_what_it_says() {
    for cause in [ctrl(Command::Start, 1), sync(3)] {
        let mut forwarder: Forwarder<1> = Forwarder::new();
        assert!(forwarder.hear(HOST_LINE, &cause, 0));
        forwarder.send(&state(0, 0, 4), 0);
        assert_eq!([forwarder.take(1), forwarder.take(1)], [Some(cause), Some(state(0, 0, 4))]);
    }
}

#[test]
fn a_command_and_a_fault_overtake_values() {
    let mut forwarder: Forwarder<2> = Forwarder::new();
    forwarder.send(&state(0, 0, 1), 0);
    forwarder.send(&fault(0, 1), 0);
    assert!(forwarder.hear(1, &ctrl(Command::Stop, 1), 0));
    let waiting: Vec<_> = std::iter::from_fn(|| forwarder.take(2)).collect();
    assert_eq!(waiting, [ctrl(Command::Stop, 1), fault(0, 1), state(0, 0, 1)]);
    // Nothing goes back to where it came from.
    assert_eq!(forwarder.take(1), Some(fault(0, 1)));
}

#[test]
fn a_command_without_a_number_is_for_the_node_alone_as_often_as_it_comes() {
    let mut forwarder: Forwarder<2> = Forwarder::new();
    for _ in 0..2 {
        assert!(forwarder.hear(HOST_LINE, &ctrl(Command::Stop, 0), 0));
        assert!(forwarder.hear(1, &ctrl(Command::Stop, 0), 0));
    }
    assert_eq!((0..3).filter_map(|line| forwarder.take(line)).count(), 0);
}

#[test]
fn the_same_command_is_new_again_after_a_while() {
    let mut forwarder: Forwarder<1> = Forwarder::new();
    let start = ctrl(Command::Start, 1);
    assert!(forwarder.hear(HOST_LINE, &start, 0));
    assert!(!forwarder.hear(HOST_LINE, &start, FORGET_MS - 1));
    assert!(forwarder.hear(HOST_LINE, &start, FORGET_MS));
}

#[test]
fn after_a_start_the_ticks_begin_anew_and_no_sync_of_before_follows() {
    for arg in [0, 1] {
        let mut forwarder: Forwarder<2> = Forwarder::new();
        assert!(forwarder.hear(HOST_LINE, &sync(500), 0));
        assert!(!forwarder.hear(HOST_LINE, &sync(u32::MAX), 1));
        assert!(forwarder.hear(HOST_LINE, &ctrl(Command::Start, arg), 1));
        let waiting: Vec<_> = std::iter::from_fn(|| forwarder.take(1)).collect();
        assert!(!waiting.contains(&sync(500)), "{waiting:?}");
        assert!(forwarder.hear(HOST_LINE, &sync(u32::MAX), 1));
        assert_eq!(forwarder.take(1), Some(sync(u32::MAX)));
        // A copy of the start begins nothing.
        let copy = forwarder.hear(2, &ctrl(Command::Start, arg), 2);
        assert_eq!(copy, arg == 0);
        assert_eq!(forwarder.hear(HOST_LINE, &sync(u32::MAX), 2), arg == 0);
    }
}

#[test]
fn the_faults_of_all_nodes_at_once_have_room() {
    let mut network = Network::new(3, &ring(3));
    for other in 0..126 {
        network.host_says(0, fault(other + 1, 8));
    }
    network.say(0, fault(0, 8));
    network.run(&[]);
    assert_eq!(network.given.iter().map(Vec::len).collect::<Vec<_>>(), [126, 127, 127]);
    assert_eq!(network.forwarders.iter().map(Forwarder::dropped).sum::<u32>(), 0);
}

#[test]
fn what_has_no_room_is_counted_the_node_takes_it_and_its_own_fault_has_room() {
    let mut forwarder: Forwarder<1> = Forwarder::new();
    for number in 1..=20 {
        assert!(forwarder.hear(HOST_LINE, &ctrl(Command::Stop, number), 0));
    }
    assert_eq!((std::iter::from_fn(|| forwarder.take(1)).count(), forwarder.dropped()), (16, 4));
    for other in 0..130 {
        assert!(forwarder.hear(1, &fault(1, other), 0));
    }
    assert_eq!(forwarder.dropped(), 6);
    forwarder.send(&fault(0, 0), 0);
    assert!(std::iter::from_fn(|| forwarder.take(1)).any(|message| message == fault(0, 0)));
    // A line that takes nothing keeps no room for ever.
    let mut forwarder: Forwarder<1> = Forwarder::new();
    for number in 1..=40 {
        assert!(forwarder.hear(HOST_LINE, &ctrl(Command::Stop, number), u64::from(number) * FORGET_MS));
    }
    assert_eq!(forwarder.dropped(), 0);
    assert_eq!(forwarder.take(1), Some(ctrl(Command::Stop, 25)));
}
