//! The node as a state machine: start, ticks, neighbours that fall silent, strangers, a twin, bad numbers.
#![allow(clippy::unwrap_used, clippy::panic)]

use funnelnet_node::neighbour::Presence;
use funnelnet_node::{Action, Event, Node, Observation, Params, Phase};
use funnelnet_protocol::config::{
    Breach, ConfigError, ConfigField, EdgeConfig, Field, Funnel, Gain, NodeConfig, Shape, TickSource, scalar,
};
use funnelnet_protocol::message::{
    Command, Component, FaultCode, Message, NodeId, Severity, Target, TickStamp,
};
use funnelnet_protocol::refusal::Refusal;

const MS: u64 = 1_000_000;

fn config() -> NodeConfig {
    NodeConfig::builder(1, MS as u32)
        .state([1.0])
        .state_limit(1e6)
        .funnel(Shape::Constant { width: 10.0 })
        .edges([edge(2)])
        .extrapolate_ticks(3)
        .build()
        .unwrap()
}

fn edge(id: u8) -> EdgeConfig {
    EdgeConfig { id, weight: 1.0, edges: 1 }
}

fn seen(node: &Node) -> &Observation<f32> {
    &node.observations()[0]
}

fn node(config: &NodeConfig) -> Node {
    Node::new(Params::new(config).unwrap(), &config.neighbours)
}

fn state(source: u8, tick: u32, x: f32) -> Message {
    let source = NodeId::new(source).unwrap();
    Message::State { source, component: Component::FIRST, tick: TickStamp::low(tick, 8), x }
}

fn start() -> Message {
    Message::Ctrl { target: Target::All, command: Command::Start, arg: 0, at_tick: 0 }
}

fn stop() -> Message {
    Message::Ctrl { target: Target::All, command: Command::Stop, arg: 0, at_tick: 0 }
}

fn sync(previous: u32) -> Message {
    Message::Sync { source: None, previous_tick: TickStamp::low(previous, 24), phase_us: 0 }
}

fn actions(node: &mut Node, now: u64) -> Vec<Action> {
    core::iter::from_fn(|| node.poll(now)).collect()
}

/// What goes to the link, but for the weights that are announced in the first ticks.
fn sent(actions: &[Action]) -> Vec<Message> {
    let message = |action: &Action| match action {
        Action::Send(Message::Edge { .. }) => None,
        Action::Send(message) => Some(*message),
        Action::Report(_) | Action::Safe | Action::Sample | Action::Actuate => None,
    };
    actions.iter().filter_map(message).collect()
}

fn started(config: &NodeConfig) -> Node {
    let mut node = node(config);
    node.on_message(&start(), 0).unwrap();
    actions(&mut node, 0);
    node
}

#[test]
fn it_announces_its_initial_state_and_then_ticks_by_its_timer() {
    let mut node = node(&config());
    assert_eq!(node.poll_at(), None);
    node.on_message(&start(), 5 * MS).unwrap();
    let first = actions(&mut node, 5 * MS);
    assert_eq!(first[0], Action::Report(Event::Started));
    assert!(matches!(sent(&first)[..], [Message::State { x: 1.0, .. }]));
    assert_eq!(node.poll_at(), Some(6 * MS));
    assert_eq!(actions(&mut node, 6 * MS - 1), []);
    node.on_message(&state(2, 0, 2.0), 6 * MS - 1).unwrap();
    let ticked = actions(&mut node, 6 * MS);
    let [Message::State { tick, x, .. }] = sent(&ticked)[..] else { panic!("{ticked:?}") };
    assert_eq!(tick.value(), 1);
    // The paper's law at the first tick: u = s / (1 - s) at s = 0.1, and x moves by T u.
    let u = 0.1 / 0.9;
    assert!((seen(&node).u - u).abs() < 1e-4 * u, "{}", seen(&node).u);
    assert!((x - 1.0 - 1e-3 * u).abs() < 2e-7);
    assert_eq!(node.poll_at(), Some(7 * MS));
}

#[test]
fn late_ticks_are_made_up_for_one_by_one_and_counted() {
    let mut node = started(&config());
    let all = actions(&mut node, 4 * MS);
    assert_eq!(node.tick(), 4);
    assert_eq!(node.counters().overruns, 3);
    assert_eq!(sent(&all).len(), 1, "only the latest state is worth sending: {all:?}");
    // Said once, until one has been in time.
    let overruns = |actions: &[Action]| {
        let late = |action: &&Action| matches!(action, Action::Report(Event::Overrun { .. }));
        actions.iter().filter(late).copied().collect::<Vec<_>>()
    };
    assert_eq!(overruns(&all), [Action::Report(Event::Overrun { tick: 0 })]);
    assert_eq!(overruns(&actions(&mut node, 5 * MS)), []);
    assert_eq!(overruns(&actions(&mut node, 7 * MS)), [Action::Report(Event::Overrun { tick: 5 })]);
}

#[test]
fn a_silent_neighbour_is_extrapolated_then_dropped_then_found_again() {
    let mut node = started(&config());
    node.on_message(&state(2, 0, 2.0), 0).unwrap();
    actions(&mut node, MS);
    node.on_message(&state(2, 1, 2.5), MS).unwrap();
    actions(&mut node, 2 * MS);
    actions(&mut node, 3 * MS);
    // Tick 2: 2.5 + 0.5 is expected, less the own state.
    let expected = 3.0 - seen(&node).x;
    assert!((seen(&node).nu - expected).abs() < 1e-6);
    assert_eq!(node.counters().extrapolated, 1);
    actions(&mut node, 4 * MS);
    actions(&mut node, 5 * MS);
    let dropped = actions(&mut node, 6 * MS);
    assert!(dropped.contains(&Action::Report(Event::NeighbourLost(NodeId::new(2).unwrap()))), "{dropped:?}");
    assert_eq!((seen(&node).nu, node.counters().neighbours_lost), (0.0, 1));
    node.on_message(&state(2, 6, 9.0), 6 * MS).unwrap();
    let found = actions(&mut node, 7 * MS);
    assert!(found.contains(&Action::Report(Event::NeighbourFound(NodeId::new(2).unwrap()))));
    assert!(seen(&node).nu > 7.0);
}

#[test]
fn a_state_too_old_to_be_extrapolated_does_not_revive_an_edge() {
    let mut node = started(&NodeConfig { extrapolate_ticks: 1, ..config() });
    for k in 1..=5 {
        actions(&mut node, k * MS);
    }
    assert_eq!(node.on_message(&state(2, 3, 2.0), 5 * MS), Err(Refusal::Stale));
    assert_eq!(actions(&mut node, 6 * MS).len(), 1);
    assert_eq!(node.neighbour_was_heard(NodeId::new(2).unwrap()), Some(false));
    node.on_message(&state(2, 5, 2.0), 6 * MS).unwrap();
}

#[test]
fn a_state_ahead_of_its_tick_is_taken_back_and_is_no_extrapolation() {
    let mut node = started(&config());
    for (tick, x) in [(0, 2.0), (1, 2.5)] {
        node.on_message(&state(2, tick, x), 0).unwrap();
    }
    actions(&mut node, MS);
    assert_eq!((seen(&node).nu, node.counters().extrapolated), (1.0, 0));
}

#[test]
fn a_sync_is_understood_across_the_wrap_of_its_24_bits() {
    let mut node = started(&NodeConfig { tick_source: TickSource::Sync, ..config() });
    // The master's count leaps ahead, a thousand ticks at most at a time: stamps of 24 bits wrap on the way.
    let sync = |previous: u32| Message::Sync {
        source: None,
        previous_tick: TickStamp::low(previous, 24),
        phase_us: 0,
    };
    let mut at = 0u32;
    while at < (1 << 24) + 5000 {
        node.on_message(&sync(at.wrapping_add(999)), 0).unwrap();
        actions(&mut node, 0);
        at += 1000;
        assert_eq!(node.tick(), at + 1);
        node.on_message(&state(2, at, 2.0), 0).unwrap();
    }
    assert_eq!(node.counters().refused(Refusal::TickWindow), 0);
}

#[test]
fn the_smallest_and_the_largest_allowed_values_are_allowed() {
    for scale in [1e-9, 1e9] {
        let mut edge = config();
        edge.gain = Gain::Reciprocal { scale };
        edge.funnel.shape = Shape::Constant { width: scale };
        Params::<f32>::new(&edge).unwrap();
    }
}

#[test]
fn every_bad_state_is_refused_counted_and_changes_nothing() {
    let mut node = started(&config());
    node.on_message(&state(2, 0, 2.0), 0).unwrap();
    let cases = [
        (state(3, 0, 1.0), Refusal::UnknownSource),
        (state(2, 0, 5.0), Refusal::Duplicate),
        (state(2, 100, 5.0), Refusal::TickWindow),
        (state(2, 255, 5.0), Refusal::Stale),
        (state(2, 1, f32::NAN), Refusal::NotFinite),
        (state(2, 1, f32::NEG_INFINITY), Refusal::NotFinite),
        (state(2, 1, 1.1e6), Refusal::OutOfRange),
    ];
    for (message, reason) in cases {
        let before = node.counters().refused(reason);
        assert_eq!(node.on_message(&message, 0), Err(reason), "{message:?}");
        assert_eq!(node.counters().refused(reason), before + 1);
    }
    actions(&mut node, MS);
    assert_eq!(seen(&node).nu, 1.0);
}

#[test]
fn a_twin_silences_the_node() {
    let mut node = started(&config());
    assert_eq!(node.on_message(&state(1, 0, 3.0), 0), Err(Refusal::OwnId));
    assert_eq!(node.phase(), Phase::Faulted(FaultCode::DUPLICATE_ID));
    let last = actions(&mut node, MS);
    assert!(matches!(sent(&last)[..], [Message::Fault { code: FaultCode::DUPLICATE_ID, .. }]), "{last:?}");
    // One that is ready and has said nothing yet hears of its twin as well.
    let mut other = self::node(&config());
    assert_eq!(other.on_message(&state(1, 0, 3.0), 0), Err(Refusal::OwnId));
    assert_eq!(other.phase(), Phase::Faulted(FaultCode::DUPLICATE_ID));
    assert_eq!(actions(&mut node, 100 * MS), []);
    assert_eq!(node.on_message(&start(), 0), Err(Refusal::Phase));
}

#[test]
fn one_tick_per_sync_and_none_twice() {
    let mut node = started(&NodeConfig { tick_source: TickSource::Sync, ..config() });
    let sync = |previous: u32| Message::Sync {
        source: None,
        previous_tick: TickStamp::low(previous, 24),
        phase_us: 0,
    };
    assert_eq!(actions(&mut node, 100 * MS), []);
    node.on_message(&sync(u32::MAX), 0).unwrap();
    assert_eq!(sent(&actions(&mut node, 0)).len(), 1);
    assert_eq!(node.on_message(&sync(u32::MAX), 0), Err(Refusal::TickWindow));
    assert_eq!(actions(&mut node, 0), []);
    node.on_message(&sync(0), 0).unwrap();
    actions(&mut node, 0);
    assert_eq!(node.tick(), 2);
    node.on_message(&sync(3), 0).unwrap();
    assert!(actions(&mut node, 0).contains(&Action::Report(Event::SyncGap { missed: 2 })));
    assert_eq!((node.tick(), node.counters().sync_gaps), (5, 1));
}

#[test]
fn a_node_that_joins_late_takes_the_tick_of_its_first_sync() {
    let mut node = started(&NodeConfig { tick_source: TickSource::Sync, ..config() });
    let sync = |previous: u32| Message::Sync {
        source: None,
        previous_tick: TickStamp::low(previous, 24),
        phase_us: 0,
    };
    actions(&mut node, 0);
    node.on_message(&sync(1_000_000), 0).unwrap();
    actions(&mut node, 0);
    assert_eq!((node.tick(), node.counters().ticks), (1_000_002, 1));
    // From then on it may have missed a thousand, and no more.
    assert_eq!(node.on_message(&sync(1_001_003), 0), Err(Refusal::TickWindow));
    node.on_message(&sync(1_001_001), 0).unwrap();
}

#[test]
fn an_escaping_state_stops_the_node_with_its_last_good_value() {
    let mut unstable = config();
    unstable.field = Field::scalar(1e5, 0.0, []);
    let mut node = started(&unstable);
    for k in 1..100 {
        actions(&mut node, k * MS);
    }
    assert_eq!(node.phase(), Phase::Faulted(FaultCode::STATE_LIMIT));
    assert!(node.state().all(|x| x.abs() <= 1e6));
}

#[test]
fn a_breach_is_counted_reported_and_survived() {
    let mut node = started(&config());
    node.on_message(&state(2, 0, 25.0), 0).unwrap();
    let events = actions(&mut node, MS);
    assert!(
        events.iter().any(|e| matches!(e, Action::Report(Event::BreachBegan { tick: 0, .. }))),
        "{events:?}"
    );
    assert_eq!(node.counters().breaches, 1);
    assert!(seen(&node).u.is_finite() && node.report().max_ratio > 2.0);
}

#[test]
fn configurations_out_of_range_are_refused_by_name() {
    let refused = |change: fn(&mut NodeConfig)| {
        let mut bad = config();
        change(&mut bad);
        Params::<f32>::new(&bad).unwrap_err()
    };
    let field =
        |error| if let ConfigError::OutOfRange { field, .. } = error { field } else { panic!("{error}") };
    assert_eq!(field(refused(|c| c.id = 0)), ConfigField::Id);
    assert_eq!(field(refused(|c| c.id = 128)), ConfigField::Id);
    assert_eq!(field(refused(|c| c.tick_ns = 0)), ConfigField::Tick);
    assert_eq!(field(refused(|c| c.initial_state = scalar(f32::NAN))), ConfigField::InitialState);
    assert_eq!(field(refused(|c| c.field = Field::scalar(f32::INFINITY, 0.0, []))), ConfigField::Slope);
    assert_eq!(field(refused(|c| c.gain = Gain::Reciprocal { scale: 0.0 })), ConfigField::GainScale);
    assert_eq!(field(refused(|c| c.funnel.factor = -1.0)), ConfigField::FunnelFactor);
    assert_eq!(field(refused(|c| c.neighbours[0].weight = -1.0)), ConfigField::Weight);
    assert_eq!(refused(|c| c.neighbours[0].id = 1), ConfigError::OwnNeighbour { id: 1 });
    let twice = |c: &mut NodeConfig| c.neighbours.push(edge(2)).unwrap();
    let mut bad = config();
    twice(&mut bad);
    assert_eq!(Params::<f32>::new(&bad).unwrap_err(), ConfigError::DuplicateNeighbour { id: 2 });
    let text = refused(|c| c.neighbours[0].weight = -1.0).to_string();
    assert_eq!(text, "graph weight = -1: allowed are 0.000000001 to 1000000");
}

#[test]
fn so_many_neighbours_lost_at_once_stop_it_and_one_that_comes_back_does_not_count() {
    let limited = |lost_neighbours| {
        let neighbours = [edge(2), edge(3), edge(4)].into_iter().collect();
        started(&NodeConfig { lost_neighbours, neighbours, extrapolate_ticks: 1, ..config() })
    };
    // 2 falls silent after tick 0, and 3 after tick 2; each is dropped two ticks later. 4 is heard all the
    // time.
    let play = |node: &mut Node, back: bool| {
        for k in 0..=4 {
            let speak = |id: u8| match id {
                2 => k == 0 || (back && k == 3),
                3 => k <= 2,
                _ => true,
            };
            for id in [2, 3, 4].into_iter().filter(|&id| speak(id)) {
                node.on_message(&state(id, k, 1.0), u64::from(k) * MS).unwrap();
            }
            if k == 4 {
                return actions(node, 5 * MS);
            }
            let before = actions(node, u64::from(k + 1) * MS);
            assert_eq!(node.phase(), Phase::Running, "tick {k}: {before:?}");
        }
        unreachable!()
    };
    let mut node = limited(2);
    let stopped = play(&mut node, false);
    assert_eq!(node.phase(), Phase::Faulted(FaultCode::NEIGHBOURS_LOST));
    let [Message::Fault { code: FaultCode::NEIGHBOURS_LOST, arg: 2, .. }] = sent(&stopped)[..] else {
        panic!("{stopped:?}")
    };
    assert_eq!(stopped[0], Action::Safe);
    assert_eq!((seen(&node).u, seen(&node).tick, node.poll_at()), (0.0, 4, None));

    for (lost_neighbours, back) in [(2, true), (3, false), (0, false)] {
        let mut node = limited(lost_neighbours);
        play(&mut node, back);
        assert_eq!(node.phase(), Phase::Running, "{lost_neighbours} {back}");
    }
}

/// The eight bits of a classic frame take a state of 256 ticks ago for one of now; the sixteen of CAN FD do
/// not.
#[test]
fn a_node_that_was_silent_for_256_ticks_is_not_taken_for_a_fresh_one_by_sixteen_bits() {
    let heard = |bits: u8| {
        let mut node = started(&config());
        (1..=300).for_each(|k| drop(actions(&mut node, k * MS)));
        let (source, old) = (NodeId::new(2).unwrap(), node.tick() - 256);
        let tick = TickStamp::low(old, bits);
        node.on_message(&Message::State { source, component: Component::FIRST, tick, x: 3.0 }, 300 * MS)
    };
    assert_eq!((heard(8), heard(16)), (Ok(()), Err(Refusal::TickWindow)));
}

#[test]
fn without_sync_for_longer_than_its_holdover_it_stops() {
    let held = NodeConfig { tick_source: TickSource::Sync, holdover_ns: 20 * MS, ..config() };
    let mut node = started(&held);
    // From the start on, and then from each SYNC that is taken: a repeated one is none.
    assert_eq!(node.poll_at(), Some(20 * MS));
    node.on_message(&sync(u32::MAX), 15 * MS).unwrap();
    actions(&mut node, 15 * MS);
    assert_eq!(node.poll_at(), Some(35 * MS));
    assert_eq!(node.on_message(&sync(u32::MAX), 30 * MS), Err(Refusal::TickWindow));
    assert_eq!(actions(&mut node, 35 * MS - 1), []);
    let stopped = actions(&mut node, 37 * MS);
    assert_eq!(node.phase(), Phase::Faulted(FaultCode::HOLDOVER));
    let [Message::Fault { code: FaultCode::HOLDOVER, arg: 22, .. }] = sent(&stopped)[..] else {
        panic!("{stopped:?}")
    };
    assert_eq!((stopped[0], node.poll_at()), (Action::Safe, None));
}

#[test]
fn only_a_running_node_that_ticks_by_sync_can_miss_one() {
    let held = NodeConfig { tick_source: TickSource::Sync, holdover_ns: 20 * MS, ..config() };
    let mut ready = node(&held);
    assert_eq!((ready.poll_at(), actions(&mut ready, 100 * MS)), (None, vec![]));
    let mut endless = started(&NodeConfig { holdover_ns: 0, ..held.clone() });
    assert_eq!((endless.poll_at(), actions(&mut endless, u64::MAX)), (None, vec![]));
    let mut stopped = started(&held);
    stopped.on_message(&stop(), MS).unwrap();
    actions(&mut stopped, MS);
    assert_eq!((stopped.poll_at(), actions(&mut stopped, 100 * MS)), (None, vec![]));
    let mut timed = started(&NodeConfig { tick_source: TickSource::Timer, ..held.clone() });
    actions(&mut timed, MS);
    assert_eq!(timed.poll_at(), Some(2 * MS));

    let short = Params::<f32>::new(&NodeConfig { holdover_ns: MS - 1, ..held }).unwrap_err();
    let ConfigError::OutOfRange { field: ConfigField::Holdover, low, .. } = short else { panic!("{short}") };
    assert_eq!(low, MS as f64);
}

#[test]
fn a_fault_is_reported_however_many_events_wait() {
    let others: Vec<u8> = (2..12).collect();
    let neighbours = others.iter().map(|&id| edge(id)).collect();
    let mut node = node(&NodeConfig { neighbours, on_breach: Breach::Stop, ..config() });
    node.on_message(&start(), 0).unwrap();
    others.iter().for_each(|&id| node.on_message(&state(id, 0, 100.0), 0).unwrap());
    let actions = actions(&mut node, MS);
    let fault = Action::Report(Event::Fault(FaultCode::FUNNEL_LEFT));
    assert_eq!(actions.iter().filter(|action| **action == fault).count(), 1, "{actions:?}");
    assert!(actions.contains(&Action::Report(Event::Started)), "the oldest ones stay: {actions:?}");
}

#[test]
fn what_the_node_has_said_itself_and_a_relay_gives_back_stops_nobody() {
    let mut node = started(&config());
    let own = NodeId::new(1).unwrap();
    for (code, severity) in [(FaultCode::PANIC, Severity::Warning), (FaultCode(99), Severity::Stopped)] {
        let fault = Message::Fault { source: own, code, severity, arg: 1, tick: TickStamp::low(0, 16) };
        assert_eq!(node.on_message(&fault, 0), Err(Refusal::OwnId));
    }
    let edge = Message::Edge { source: own, neighbour: NodeId::new(2).unwrap(), weight: 1.0 };
    assert_eq!(node.on_message(&edge, 0), Err(Refusal::OwnId));
    assert_eq!((node.phase(), node.counters().refused(Refusal::OwnId)), (Phase::Running, 3));
    actions(&mut node, MS);
    assert_eq!(node.counters().ticks, 1);
}

/// The tick at which this node loses a neighbour that says nothing.
fn lost_at(
    node: &mut Node,
    ticks: impl IntoIterator<Item = u32>,
    run: impl Fn(&mut Node, u32) -> Vec<Action>,
) -> u32 {
    let lost = Action::Report(Event::NeighbourLost(NodeId::new(2).unwrap()));
    for k in ticks {
        assert_eq!(node.neighbour_presence(NodeId::new(2).unwrap()), Some(Presence::Unheard), "tick {k}");
        if run(node, k).contains(&lost) {
            return k;
        }
    }
    panic!("never lost")
}

#[test]
fn a_neighbour_that_was_never_heard_is_lost_after_the_same_time() {
    let two = NodeId::new(2).unwrap();
    let by_timer = |node: &mut Node, k: u32| actions(node, u64::from(k + 1) * MS);
    let mut node = started(&config());
    // As one that is heard up to tick 1 is lost at tick 5.
    assert_eq!(lost_at(&mut node, 0.., by_timer), 3);
    assert_eq!(node.counters().neighbours_lost, 1);
    assert_eq!(node.neighbour_presence(two), Some(Presence::Lost));
    assert_eq!(node.neighbour_was_heard(two), Some(false));
    (4..20).for_each(|k| drop(by_timer(&mut node, k)));
    assert_eq!(node.counters().neighbours_lost, 1, "told once");
    node.on_message(&state(2, 20, 1.0), 20 * MS).unwrap();
    let found = actions(&mut node, 21 * MS);
    assert!(found.contains(&Action::Report(Event::NeighbourFound(two))), "{found:?}");
    assert_eq!(
        (node.neighbour_presence(two), node.neighbour_was_heard(two)),
        (Some(Presence::Known), Some(true))
    );
    (21..30).for_each(|k| drop(by_timer(&mut node, k)));
    assert_eq!(
        (node.neighbour_presence(two), node.neighbour_was_heard(two)),
        (Some(Presence::Lost), Some(true))
    );
    assert_eq!(node.neighbour_presence(NodeId::new(9).unwrap()), None, "a stranger");
}

#[test]
fn a_node_that_nobody_talks_to_stops_where_so_many_neighbours_stop_it() {
    let mut node = started(&NodeConfig { lost_neighbours: 1, ..config() });
    (0..4).for_each(|k| drop(actions(&mut node, (k + 1) * MS)));
    assert_eq!(node.phase(), Phase::Faulted(FaultCode::NEIGHBOURS_LOST));
}

#[test]
fn a_node_that_joins_late_waits_for_its_neighbours_from_its_own_first_tick_on() {
    let mut node = started(&NodeConfig { tick_source: TickSource::Sync, ..config() });
    let run = |node: &mut Node, k: u32| {
        node.on_message(&sync(k.wrapping_sub(1)), 0).unwrap();
        actions(node, 0)
    };
    assert_eq!(lost_at(&mut node, 5000.., run), 5003);
}

#[test]
fn after_a_long_sleep_a_bounded_number_of_ticks_runs_at_one_time_and_the_rest_is_skipped_and_counted() {
    let mut node = started(&config());
    // Tick 0 was due at 1 ms, tick 99 is due now.
    let (mut states, now) = (0, 100 * MS);
    for _ in 0..50 {
        states += sent(&actions(&mut node, now)).len();
    }
    let counters = node.counters();
    assert_eq!((counters.ticks, counters.skipped, node.tick()), (4, 96, 100));
    assert_eq!((states, counters.overruns), (1, 3), "the last one is in time");
    assert_eq!(node.poll_at(), Some(101 * MS), "it is in step with its neighbours again");
    assert_eq!(node.progress().completed, 4, "what was skipped feeds no watchdog");
    actions(&mut node, 101 * MS);
    assert_eq!((node.counters().ticks, node.counters().skipped), (5, 96));
}

#[test]
fn a_state_that_comes_after_its_tick_has_run_is_counted() {
    let mut node = started(&NodeConfig { extrapolate_ticks: 10, ..config() });
    node.on_message(&state(2, 0, 1.0), 0).unwrap();
    (1..=6).for_each(|k| drop(actions(&mut node, k * MS)));
    assert_eq!((node.tick(), node.counters().late), (6, 0));
    // Four ticks late, then in time, then ahead.
    for (tick, late) in [(2, 1), (6, 1), (7, 1)] {
        node.on_message(&state(2, tick, 1.0), 6 * MS).unwrap();
        assert_eq!(node.counters().late, late, "{tick}");
    }
    assert_eq!(node.on_message(&state(2, 5, 1.0), 6 * MS), Err(Refusal::Stale));
    assert_eq!(node.counters().late, 1, "what is refused is not late");
}

/// A gain whose input is not a number from a tenth of the funnel on.
#[derive(Clone, Copy, Debug)]
struct Broken;

impl funnelnet_law::GainFunction<f32> for Broken {
    fn inverse(&self, u: f32) -> f32 {
        u / (1.0 + u.abs())
    }

    fn inverse_slope(&self, u: f32) -> f32 {
        let rest = 1.0 / (1.0 + u.abs());
        rest * rest
    }

    fn apply(&self, s: f32) -> f32 {
        s / (1.0 - s.abs())
    }

    fn solve(&self, psi: f32, b: f32, r: f32) -> funnelnet_law::gain::Solution<f32> {
        let u = if r.abs() < 0.1 * psi { r / (psi + b) } else { f32::NAN };
        funnelnet_law::gain::Solution { u, s: 0.0 }
    }
}

#[test]
fn an_input_that_is_not_finite_stops_the_node_with_its_state() {
    let field = |tick| funnelnet_node::params::affine_field(&config(), tick);
    let params: Params<f32, _, Broken> = Params::with_field_and_gain(&config(), field, Broken).unwrap();
    let mut node = Node::new(params, &config().neighbours);
    node.on_message(&start(), 0).unwrap();
    while node.poll(0).is_some() {}
    node.on_message(&state(2, 0, 1.5), 0).unwrap();
    while node.poll(MS).is_some() {}
    assert_eq!(node.phase(), Phase::Running);
    let x = node.state().next().unwrap();
    node.on_message(&state(2, 1, 9.0), MS).unwrap();
    let said: Vec<_> = core::iter::from_fn(|| node.poll(2 * MS)).collect();
    assert_eq!(said[0], Action::Safe);
    assert!(said.contains(&Action::Report(Event::Fault(FaultCode::INPUT))), "{said:?}");
    let faults = said
        .iter()
        .filter(|said| matches!(said, Action::Send(Message::Fault { code: FaultCode::INPUT, .. })));
    assert_eq!(faults.count(), 1);
    assert_eq!((node.state().next(), node.observations()[0].u), (Some(x), 0.0));
    assert_eq!(node.phase(), Phase::Faulted(FaultCode::INPUT));
}

#[test]
fn a_funnel_that_opens_from_nearly_nothing_is_floored_at_once_and_no_policy_makes_nonsense_of_it() {
    let shape = Shape::Exponential { start: 1e-6, end: 100.0, rate: 1.0 };
    let funnel = Funnel { factor: 1.0, shape };
    for on_breach in [Breach::Ride, Breach::Reopen { margin: 2.0, rate: 1.0 }] {
        let mut node = started(&NodeConfig { funnel, on_breach, initial_state: scalar(0.0), ..config() });
        for k in 0..20 {
            node.on_message(&state(2, k, 1e-7), 0).unwrap();
            actions(&mut node, u64::from(k + 1) * MS);
            let seen = seen(&node);
            assert!(seen.psi >= 1e-6 && seen.ratio < 1.0, "{k}: {seen:?}");
            assert!(seen.u.is_finite() && seen.x.is_finite(), "{k}: {seen:?}");
        }
        assert_eq!((node.phase(), node.counters().breaches), (Phase::Running, 0), "{on_breach:?}");
    }
}
