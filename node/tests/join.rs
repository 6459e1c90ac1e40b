//! Nodes that come to a network that runs, and nodes whose neighbours all fall silent (law.md 9).
#![allow(clippy::unwrap_used, clippy::panic)]

use funnelnet_node::{Action, Event, InputRange, Node, Params, PlantSetup};
use funnelnet_protocol::config::{EdgeConfig, Field, HeardLimits, NodeConfig, Shape, TickSource, Tuning};
use funnelnet_protocol::message::{
    Command, Component, FaultCode, JOIN, Message, NodeId, Severity, Target, TickStamp,
};

const MS: u32 = 1_000_000;
/// Tick at which the newcomer comes.
const FIRST: u32 = 5_000;

/// Node 1 between two others, far from them.
fn config() -> NodeConfig {
    NodeConfig::builder(1, MS)
        .tick_source(TickSource::Sync)
        .state([50.0])
        .field(Field::scalar(0.0, 0.0, []))
        .funnel(Shape::Constant { width: 1.0 })
        .edges([EdgeConfig::new(2, 1.0), EdgeConfig::new(3, 3.0)])
        .extrapolate_ticks(4)
        .build()
        .unwrap()
}

fn node(config: &NodeConfig) -> Node {
    Node::new(Params::new(config).unwrap(), &config.neighbours)
}

fn start(at_tick: u16) -> Message {
    Message::Ctrl { target: Target::All, command: Command::Start, arg: 0, at_tick }
}

fn state(source: u8, tick: u32, x: f32) -> Message {
    let source = NodeId::new(source).unwrap();
    Message::State { source, component: Component::FIRST, tick: TickStamp::low(tick, 8), x }
}

/// Marks `tick`; samples are answered by `x`. Gives all that the node does.
fn tick(node: &mut Node, tick: u32, x: f32) -> Vec<Action> {
    let previous_tick = TickStamp::low(tick.wrapping_sub(1), 24);
    node.on_message(&Message::Sync { source: None, previous_tick, phase_us: 0 }, 0).unwrap();
    drain(node, x)
}

fn drain(node: &mut Node, x: f32) -> Vec<Action> {
    let mut done = Vec::new();
    while let Some(action) = node.poll(0) {
        if action == Action::Sample {
            node.measured(&[x]);
        }
        done.push(action);
    }
    done
}

fn states(actions: &[Action]) -> Vec<f32> {
    let state = |action: &Action| match action {
        Action::Send(Message::State { x, .. }) => Some(*x),
        _ => None,
    };
    actions.iter().filter_map(state).collect()
}

/// Before its first SYNC a node does not know the tick, and refuses states.
fn hear(node: &mut Node, source: u8, k: u32, x: f32) {
    let _ = node.on_message(&state(source, k, x), 0);
}

fn hear_both(node: &mut Node, k: u32) {
    hear(node, 2, k, 2.0);
    hear(node, 3, k, -2.0);
}

#[test]
fn a_node_that_integrates_says_nothing_before_it_has_the_mean_of_its_neighbours() {
    let mut node = node(&config());
    node.on_message(&start(JOIN), 0).unwrap();
    assert_eq!(states(&drain(&mut node, 0.0)), [], "told that it joins, it does not announce its state");
    let done = tick(&mut node, FIRST, 0.0);
    assert!(done.contains(&Action::Report(Event::Listens { tick: FIRST })), "{done:?}");
    assert_eq!((states(&done), node.state().next()), (vec![], Some(50.0)));
    // One neighbour of two is not enough.
    node.on_message(&state(2, FIRST + 1, 2.0), 0).unwrap();
    assert_eq!(states(&tick(&mut node, FIRST + 1, 0.0)), []);
    hear_near(&mut node, FIRST + 2);
    let done = tick(&mut node, FIRST + 2, 0.0);
    assert!(done.contains(&Action::Report(Event::Joins { tick: FIRST + 2 })), "{done:?}");
    // (1 * -0.625 + 3 * -1.125) / 4, with no input.
    assert_eq!((states(&done), node.observations()[0].u), (vec![-1.0], 0.0));
    assert_eq!(node.counters().breaches, 0, "far away as it was, it was never outside");
}

/// Where neighbours hold what it says against what it said before, they are told that this counts no more.
#[test]
fn a_newcomer_says_that_it_starts_anew_right_before_its_first_state_where_that_is_asked_for() {
    let limited = |heard| NodeConfig { heard, ..config() };
    let (rate, far) = (
        HeardLimits { rate: 5.0, ..HeardLimits::NONE },
        HeardLimits { limit: 9.0, drop_after: 10, ..HeardLimits::NONE },
    );
    for (heard, says) in [(HeardLimits::NONE, false), (rate, true), (far, true)] {
        let mut node = node(&limited(heard));
        node.on_message(&start(JOIN), 0).unwrap();
        tick(&mut node, FIRST, 0.0);
        hear_near(&mut node, FIRST + 1);
        let done = tick(&mut node, FIRST + 1, 0.0);
        let said: Vec<_> = done.iter().filter(|action| matches!(action, Action::Send(_))).collect();
        let anew = Message::Fault {
            source: NodeId::new(1).unwrap(),
            code: FaultCode::STARTS_ANEW,
            severity: Severity::Notice,
            arg: 0,
            tick: TickStamp::full(FIRST + 1),
        };
        let first = state_of(1, FIRST + 2, -1.0);
        assert_eq!(said.first() == Some(&&Action::Send(anew)), says, "{said:?}");
        assert_eq!(said.get(usize::from(says)), Some(&&Action::Send(first)), "{said:?}");
        // Once.
        hear_near(&mut node, FIRST + 2);
        let done = tick(&mut node, FIRST + 2, 0.0);
        assert!(!done.iter().any(|action| matches!(action, Action::Send(Message::Fault { .. }))), "{done:?}");
    }
}

fn state_of(source: u8, tick: u32, x: f32) -> Message {
    let source = NodeId::new(source).unwrap();
    Message::State { source, component: Component::FIRST, tick: TickStamp::full(tick), x }
}

/// Two that are near each other: the terms of their edges to a node between them are 0.375 in funnels of 1.
fn hear_near(node: &mut Node, k: u32) {
    hear(node, 2, k, -0.625);
    hear(node, 3, k, -1.125);
}

/// Two that a node between them would throw out: their terms would be `term` funnels.
fn hear_apart(node: &mut Node, k: u32, term: f32) {
    hear(node, 2, k, term - 1.0);
    hear(node, 3, k, -term / 3.0 - 1.0);
}

/// The tick at which a node that joins speaks, after the first one, whose neighbours are `term` funnels from
/// it up to a tick, and near it from there on.
fn spoke(term: f32, near_from: u32) -> u32 {
    let mut node = node(&config());
    node.on_message(&start(JOIN), 0).unwrap();
    let spoke = (0..1_100).find(|&k| {
        if k < near_from {
            hear_apart(&mut node, FIRST + k, term)
        } else {
            hear_near(&mut node, FIRST + k)
        }
        !states(&tick(&mut node, FIRST + k, 0.0)).is_empty()
    });
    spoke.unwrap()
}

#[test]
fn a_node_that_integrates_waits_for_its_neighbours_to_be_near_each_other_but_not_for_ever() {
    for term in [0.6, 1.9] {
        assert!((200..230).contains(&spoke(term, 200)), "{term} {}", spoke(term, 200));
        // Before its first SYNC it refuses states.
        assert!((500..503).contains(&spoke(term, 2_000)), "{term} {}", spoke(term, 2_000));
    }
}

/// Those that are more than two funnels from it run apart for as long as it waits.
#[test]
fn a_node_that_integrates_does_not_wait_where_only_it_holds_its_neighbours_together() {
    assert!(spoke(2.1, 2_000) < 3, "{}", spoke(2.1, 2_000));
}

#[test]
fn a_neighbour_that_is_never_heard_is_not_waited_for() {
    let mut node = node(&config());
    node.on_message(&start(JOIN), 0).unwrap();
    let spoke = (FIRST..FIRST + 20).find(|&k| {
        hear(&mut node, 2, k, 2.0);
        !states(&tick(&mut node, k, 0.0)).is_empty()
    });
    // The edge to node 3 is given up after four ticks; the mean is then what node 2 has.
    assert_eq!((spoke, node.state().next()), (Some(FIRST + 4), Some(2.0)));
}

#[test]
fn a_node_that_hears_nobody_speaks_in_the_end() {
    let mut node = node(&config());
    node.on_message(&start(JOIN), 0).unwrap();
    let spoke = (FIRST..FIRST + 40).find(|&k| !states(&tick(&mut node, k, 0.0)).is_empty());
    // Three times the four ticks of extrapolation, and it keeps its state.
    assert_eq!((spoke, node.state().next()), (Some(FIRST + 12), Some(50.0)));
}

#[test]
fn a_plant_far_away_goes_there_in_a_funnel_of_its_own_within_its_limits_and_speaks_once_it_is_there() {
    let config = config();
    let plant = PlantSetup::new([InputRange::new(-300.0, 300.0).unwrap()], 2);
    let params = Params::<f32>::new(&config).unwrap().with_plant(plant).unwrap();
    let mut node = Node::new(params, &config.neighbours);
    node.on_message(&start(JOIN), 0).unwrap();
    let mut x = 50.0_f32;
    let (mut spoke, mut largest) = (None, 0.0_f32);
    for k in FIRST..FIRST + 4000 {
        hear_both(&mut node, k);
        let done = tick(&mut node, k, x);
        let u = node.inputs()[0];
        largest = largest.max(u.abs());
        x += 1e-3 * u;
        if !states(&done).is_empty() {
            spoke = Some(k - FIRST);
            break;
        }
    }
    // nu = 4 (x + 1) has to be below 1.05 for ten ticks; 51 away at 300 a second it takes a sixth of a second
    // at least.
    let spoke = spoke.unwrap();
    assert!((170..3000).contains(&spoke), "{spoke}");
    assert!((4.0 * (x + 1.0)).abs() < 1.05 && largest <= 300.0, "{x} {largest}");
    assert_eq!(node.counters().breaches, 0);
}

#[test]
fn a_node_from_tick_zero_on_is_no_newcomer() {
    let mut node = node(&config());
    node.on_message(&start(0), 0).unwrap();
    assert_eq!(states(&drain(&mut node, 0.0)), [50.0]);
    let done = tick(&mut node, 0, 0.0);
    assert_eq!(states(&done).len(), 1, "{done:?}");
}

/// A node whose neighbours move, which has an input, and then hears nobody.
#[test]
fn a_node_whose_edges_are_all_gone_holds_its_input_and_lets_it_decay() {
    let mut node = node(&NodeConfig { initial_state: [0.0].into_iter().collect(), ..config() });
    node.on_message(&start(0), 0).unwrap();
    drain(&mut node, 0.0);
    let mut k = 0;
    while k < 100 {
        let x = 0.05 + 0.01 * k as f32;
        node.on_message(&state(2, k, x), 0).unwrap();
        node.on_message(&state(3, k, x), 0).unwrap();
        tick(&mut node, k, 0.0);
        k += 1;
    }
    let before = node.observations()[0].u;
    assert!((8.0..12.0).contains(&before), "the neighbours move by 10 a second: {before}");
    let mut held = Vec::new();
    for k in 100..100 + 305 {
        tick(&mut node, k, 0.0);
        held.push(node.observations()[0].u);
    }
    // Four ticks of extrapolation, and then 1/e in 300 ticks.
    let ratio = held[304] / held[4];
    assert!((0.36..0.38).contains(&ratio) && held[4] > 0.9 * before, "{ratio} {}", held[4]);
}

#[test]
fn an_input_is_bounded_counted_and_fed_back_and_a_slope_is_clipped() {
    let tuning = Tuning { input_limit: 20.0, slope_limit: 5.0, ..Tuning::default() };
    let mut node = node(&NodeConfig { tuning, initial_state: [0.0].into_iter().collect(), ..config() });
    node.on_message(&start(0), 0).unwrap();
    drain(&mut node, 0.0);
    hear_both(&mut node, 0);
    tick(&mut node, 0, 0.0);
    // 2 - 6 = -4 in a funnel of 1 asks for much more.
    assert_eq!((node.observations()[0].u, node.counters().limited), (-20.0, 1));
    // Node 2 jumps by 1 in a tick, which is 1,000 a second, and falls silent: at most 5 a second are
    // believed.
    node.on_message(&state(2, 1, 3.0), 0).unwrap();
    node.on_message(&state(3, 1, -2.0), 0).unwrap();
    tick(&mut node, 1, 0.0);
    node.on_message(&state(3, 2, -2.0), 0).unwrap();
    let x = node.state().next().unwrap();
    tick(&mut node, 2, 0.0);
    let expected = (3.005 - x) + 3.0 * (-2.0 - x);
    assert!((node.observations()[0].nu - expected).abs() < 1e-5, "{} {expected}", node.observations()[0].nu);
}
