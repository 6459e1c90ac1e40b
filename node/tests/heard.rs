//! Limits of what is heard: what a node takes of its neighbours, what it does not, and what it does then.
#![allow(clippy::unwrap_used, clippy::panic, reason = "helpers of tests, which clippy does not know as such")]

use funnelnet_node::neighbour::Presence;
use funnelnet_node::{Action, Event, Node, Params, Phase};
use funnelnet_protocol::config::{
    ConfigError, ConfigField, Coupling, Field, HeardLimits, NodeConfig, Shape, TickSource,
};
use funnelnet_protocol::message::{
    Command, Component, FaultCode, Message, NodeId, Severity, Target, TickStamp,
};
use funnelnet_protocol::refusal::Refusal;
use proptest::prelude::*;

const MS: u64 = 1_000_000;
/// Ticks for which the node extrapolates a silent neighbour.
const PATIENCE: u32 = 3;

/// Node 1 with neighbours 2 and 3, which takes a change of 0.01 per tick.
fn config(heard: HeardLimits) -> NodeConfig {
    NodeConfig::builder(1, MS as u32)
        .state([1.0])
        .state_limit(100.0)
        .funnel(Shape::Constant { width: 10.0 })
        .edge(2, 1.0)
        .edge(3, 1.0)
        .extrapolate_ticks(PATIENCE as u8)
        .heard(heard)
        .build()
        .unwrap()
}

fn guarded(drop_after: u8) -> HeardLimits {
    HeardLimits { limit: 50.0, rate: 10.0, drop_after }
}

/// A node that runs, and what it has reported.
struct World {
    node: Node,
    events: Vec<Event>,
}

impl World {
    fn new(config: &NodeConfig) -> Self {
        let mut node = Node::new(Params::new(config).unwrap(), &config.neighbours);
        let start = Message::Ctrl { target: Target::All, command: Command::Start, arg: 0, at_tick: 0 };
        node.on_message(&start, 0).unwrap();
        let mut world = Self { node, events: Vec::new() };
        world.poll(0);
        world
    }

    fn poll(&mut self, now: u64) {
        let events = &mut self.events;
        while let Some(action) = self.node.poll(now) {
            if let Action::Report(event) = action {
                events.push(event);
            }
        }
    }

    fn hear_of(&mut self, id: u8, component: u8, x: f32) -> Result<(), Refusal> {
        let (source, tick) = (NodeId::new(id).unwrap(), TickStamp::low(self.node.tick(), 8));
        let component = Component::new(component).unwrap();
        self.node.on_message(&Message::State { source, component, tick, x }, 0)
    }

    fn hear(&mut self, id: u8, x: f32) -> Result<(), Refusal> {
        self.hear_of(id, 0, x)
    }

    /// Runs the tick that comes next.
    fn tick(&mut self) {
        self.poll(u64::from(self.node.tick() + 1) * MS);
    }

    /// So many ticks at which 3 says 1, and 2 says this.
    fn ticks(&mut self, count: u32, x: Option<f32>) -> Vec<Result<(), Refusal>> {
        let tick = |_| {
            self.hear(3, 1.0).unwrap();
            let heard = x.map(|x| self.hear(2, x));
            self.tick();
            heard
        };
        (0..count).filter_map(tick).collect()
    }

    fn says_goodbye(&mut self, id: u8) {
        let tick = TickStamp::low(self.node.tick(), 8);
        let (source, code, severity) = (NodeId::new(id).unwrap(), FaultCode::LEAVES, Severity::Stopped);
        self.node.on_message(&Message::Fault { source, code, severity, arg: 0, tick }, 0).unwrap();
    }

    /// It was off, comes back, and says so with the tick before its first state.
    fn starts_anew(&mut self, id: u8) {
        let tick = TickStamp::low(self.node.tick().wrapping_sub(1), 8);
        let (source, code, severity) = (NodeId::new(id).unwrap(), FaultCode::STARTS_ANEW, Severity::Notice);
        self.node.on_message(&Message::Fault { source, code, severity, arg: 0, tick }, 0).unwrap();
    }

    fn presence(&self, id: u8) -> Option<Presence> {
        self.node.neighbour_presence(NodeId::new(id).unwrap())
    }

    fn refused(&self, reason: Refusal) -> u32 {
        self.node.counters().refused(reason)
    }

    /// What it has said of neighbour 2 since it was asked last.
    fn told(&mut self) -> Vec<Event> {
        let of_two = |event: &Event| match *event {
            Event::NeighbourFound(id) | Event::NeighbourLost(id) | Event::Barred(id) => id.get() == 2,
            Event::TooFast { node, .. } | Event::TooFar { node, .. } => node.get() == 2,
            _ => false,
        };
        std::mem::take(&mut self.events).into_iter().filter(of_two).collect()
    }
}

fn two() -> NodeId {
    NodeId::new(2).unwrap()
}

/// Off for one tick, of the three for which it is extrapolated.
#[test]
fn who_starts_anew_within_what_is_extrapolated_may_be_anywhere_if_it_says_so() {
    for says_so in [true, false] {
        let mut world = World::new(&config(guarded(3)));
        assert_eq!(world.ticks(10, Some(1.0)), [Ok(()); 10]);
        world.ticks(1, None);
        if says_so {
            world.starts_anew(2);
        }
        let expected = if says_so { Ok(()) } else { Err(Refusal::TooFast) };
        assert_eq!(world.hear(2, 40.0), expected);
        world.tick();
        world.ticks(10, Some(40.0));
        assert_eq!(world.node.neighbour_is_barred(two()), Some(!says_so));
        // Nothing is dropped, and nothing to be told.
        let told = world.told();
        assert_eq!(told == [Event::NeighbourFound(two())], says_so, "{told:?}");
    }
    // Also where it was barred for what it said before.
    let mut world = World::new(&config(guarded(3)));
    world.ticks(10, Some(1.0));
    world.ticks(5, Some(40.0));
    assert_eq!(world.node.neighbour_is_barred(two()), Some(true));
    world.starts_anew(2);
    assert_eq!(world.hear(2, 30.0), Ok(()));
}

/// One that stops where a single neighbour is lost. A lost one is one that is silent for too long, whatever it has said.
#[test]
fn who_starts_anew_is_not_lost_and_its_first_state_may_be_late_or_get_lost() {
    let world = || {
        let mut world = World::new(&NodeConfig { lost_neighbours: 1, ..config(guarded(3)) });
        world.ticks(10, Some(1.0));
        world.ticks(1, None);
        world.starts_anew(2);
        world
    };
    for late in 0..=PATIENCE {
        let mut world = world();
        world.ticks(late, None);
        assert_eq!((world.presence(2), world.node.phase()), (Some(Presence::Known), Phase::Running));
        assert_eq!(world.ticks(5, Some(40.0)), [Ok(()); 5], "{late}");
        assert_eq!(world.node.counters().neighbours_lost, 0);
        // From then on it is held against what it says.
        assert_eq!(world.ticks(1, Some(41.0)), [Err(Refusal::TooFast)]);
    }
    // It counts as silent from its word on, and no second one makes that longer.
    let mut world = world();
    for _ in 0..PATIENCE {
        world.ticks(1, None);
        world.starts_anew(2);
    }
    world.ticks(1, None);
    assert_eq!(world.node.phase(), Phase::Faulted(FaultCode::NEIGHBOURS_LOST));
}

/// Its first state begins a new motion: what is between it and the last value is no slope.
#[test]
fn the_first_state_of_who_starts_anew_has_no_slope_also_where_it_is_near() {
    let mut world = World::new(&config(guarded(3)));
    world.ticks(10, Some(1.0));
    world.ticks(1, None);
    world.starts_anew(2);
    assert_eq!(world.ticks(1, Some(1.009)), [Ok(())]);
    world.ticks(1, None);
    let seen = world.node.observations()[0];
    assert!((seen.nu - (2.009 - 2.0 * seen.x)).abs() < 1e-5, "{seen:?}");
}

/// Nothing is held against who says that it starts anew, then what no node may say, and is lost for that.
#[test]
fn who_starts_anew_out_of_range_may_be_anywhere_once_it_is_lost() {
    let mut world = World::new(&config(guarded(9)));
    world.ticks(10, Some(1.0));
    world.starts_anew(2);
    assert_eq!(world.ticks(PATIENCE + 1, Some(70.0))[0], Err(Refusal::OutOfRange));
    assert_eq!(world.presence(2), Some(Presence::Lost));
    assert_eq!(world.ticks(1, Some(40.0)), [Ok(())]);
}

/// What it said before may come after its word, which is then of before.
#[test]
fn a_state_of_before_is_not_the_first_one_of_who_starts_anew() {
    let mut world = World::new(&config(guarded(3)));
    world.ticks(10, Some(1.0));
    world.ticks(2, None);
    world.starts_anew(2);
    let tick = TickStamp::low(world.node.tick() - 1, 8);
    let old = Message::State { source: two(), component: Component::FIRST, tick, x: 1.0 };
    assert!(world.node.on_message(&old, 0).is_err());
    // Nor is one that no node may say.
    assert_eq!(world.ticks(1, Some(70.0)), [Err(Refusal::OutOfRange)]);
    assert_eq!(world.ticks(2, Some(40.0)), [Ok(()); 2]);
    // A word that comes once more, and late, changes nothing.
    world.ticks(2, Some(40.0));
    let (code, severity, tick) =
        (FaultCode::STARTS_ANEW, Severity::Notice, TickStamp::low(world.node.tick() - 4, 8));
    world.node.on_message(&Message::Fault { source: two(), code, severity, arg: 0, tick }, 0).unwrap();
    assert_eq!(world.ticks(1, Some(1.0)), [Err(Refusal::TooFast)]);
}

/// It lied until it was lost, and would be held against what it said before that.
#[test]
fn a_lost_neighbour_that_says_goodbye_or_starts_anew_may_be_anywhere() {
    for (says_goodbye, starts_anew) in [(true, false), (false, true), (false, false)] {
        let mut world = World::new(&config(guarded(200)));
        world.ticks(10, Some(1.0));
        world.ticks(PATIENCE + 3, Some(30.0));
        assert_eq!(world.presence(2), Some(Presence::Lost));
        if says_goodbye {
            world.says_goodbye(2);
        }
        if starts_anew {
            world.starts_anew(2);
        }
        world.ticks(1, None);
        assert_eq!(world.ticks(1, Some(10.0)) == [Ok(())], says_goodbye || starts_anew);
    }
}

#[test]
fn a_jump_is_not_taken_but_extrapolated_counted_and_told_once() {
    let mut world = World::new(&config(guarded(0)));
    assert_eq!(world.ticks(10, Some(1.0)), [Ok(()); 10]);
    assert_eq!(world.told(), [Event::NeighbourFound(two())]);
    assert_eq!(world.ticks(2, Some(5.0)), [Err(Refusal::TooFast); 2]);
    assert_eq!(world.told(), [Event::TooFast { node: two(), change: 4.0 }]);
    assert_eq!((world.refused(Refusal::TooFast), world.node.counters().extrapolated), (2, 2));
    assert_eq!(world.presence(2), Some(Presence::Known));
    // As if it had been silent.
    assert!(world.node.observations()[0].nu.abs() < 1e-6);
    // 0.01 per tick since the last one that was taken, three ticks ago.
    assert_eq!(world.ticks(1, Some(1.0301)), [Err(Refusal::TooFast)]);
    assert_eq!(world.ticks(1, Some(1.0399)), [Ok(())]);
    assert_eq!((world.told(), world.node.counters().kept.edges), (vec![], 0));
}

#[test]
fn what_stays_away_is_believed_once_a_neighbour_could_have_come_there() {
    let mut world = World::new(&config(guarded(0)));
    world.ticks(10, Some(1.0));
    // 0.5 away: 50 ticks. Its edge is dropped meanwhile, as that of a silent one.
    let heard = world.ticks(50, Some(1.4999));
    assert_eq!(heard[..49], [Err(Refusal::TooFast); 49]);
    assert_eq!(heard[49], Ok(()));
    let first = Event::NeighbourFound(two());
    let change = 1.4999 - 1.0;
    assert_eq!(
        world.told(),
        [first, Event::TooFast { node: two(), change }, Event::NeighbourLost(two()), first]
    );
}

#[test]
fn who_was_silent_and_comes_back_may_be_anywhere() {
    let mut world = World::new(&config(guarded(5)));
    world.ticks(10, Some(1.0));
    world.ticks(2, None);
    assert_eq!(world.ticks(1, Some(7.0)), [Err(Refusal::TooFast)], "it is still waited for");
    // Once it is lost, for it may have started anew. What it said between counts for less than its silence.
    world.ticks(PATIENCE, None);
    assert_eq!(world.presence(2), Some(Presence::Lost));
    assert_eq!(world.ticks(2, Some(40.0)), [Ok(()); 2]);
}

#[test]
fn too_many_in_a_row_bar_the_edge_until_its_neighbour_starts_anew() {
    for says_goodbye in [false, true] {
        let mut world = World::new(&config(guarded(5)));
        world.ticks(10, Some(1.0));
        world.told();
        // A row that ends does not count.
        world.ticks(2, Some(5.0));
        world.ticks(1, Some(1.0));
        assert_eq!(world.ticks(5, Some(5.0)), [Err(Refusal::TooFast); 5]);
        assert_eq!(world.node.counters().kept.edges, 1);
        let jump = Event::TooFast { node: two(), change: 4.0 };
        // The edge is extrapolated for three ticks, as that of a silent neighbour.
        let lost = Event::NeighbourLost(two());
        assert_eq!(world.told(), [jump, jump, lost, Event::Barred(two())]);
        // Whatever it says now, and if it says nothing for a while.
        assert_eq!(world.ticks(100, Some(1.0)), [Err(Refusal::Barred); 100]);
        assert_eq!(world.ticks(2, Some(70.0)), [Err(Refusal::OutOfRange); 2]);
        world.ticks(PATIENCE - 1, None);
        assert_eq!(world.ticks(1, Some(1.0)), [Err(Refusal::Barred)]);
        assert_eq!((world.presence(2), world.told()), (Some(Presence::Lost), vec![]));
        assert_eq!(world.node.neighbour_was_heard(two()), Some(true));
        // Its last neighbour alone.
        assert_eq!(world.node.phase(), Phase::Running);
        if says_goodbye {
            world.says_goodbye(2);
            world.ticks(1, None);
        } else {
            world.ticks(PATIENCE, None);
        }
        assert_eq!(world.ticks(2, Some(30.0)), [Ok(()); 2], "{says_goodbye}");
        assert_eq!(world.told(), [Event::NeighbourFound(two())]);
        // And it can be barred again.
        world.ticks(5, Some(5.0));
        assert_eq!(world.node.counters().kept.edges, 2);
    }
}

#[test]
fn a_neighbour_beyond_the_limit_is_not_taken_and_the_own_state_may_be_there() {
    let limits = HeardLimits { limit: 2.0, rate: 0.0, drop_after: 4 };
    let mut world = World::new(&NodeConfig { initial_state: [5.0].into_iter().collect(), ..config(limits) });
    world.ticks(3, Some(1.9));
    assert_eq!(world.ticks(1, Some(2.1)), [Err(Refusal::OutOfRange)]);
    // Not as slow as it likes, without a limit of the rate.
    assert_eq!(world.ticks(1, Some(-2.0)), [Ok(())]);
    world.told();
    assert_eq!(world.ticks(5, Some(-2.1))[..4], [Err(Refusal::OutOfRange); 4]);
    assert_eq!(world.told(), [Event::TooFar { node: two(), x: -2.1 }, Event::Barred(two())]);
    assert_eq!(world.node.phase(), Phase::Running);
    // Without a limit of its own it is that of the state.
    let mut world = World::new(&config(HeardLimits { drop_after: 4, ..HeardLimits::NONE }));
    assert_eq!(world.ticks(1, Some(99.0)), [Ok(())]);
    world.ticks(4, Some(101.0));
    assert_eq!((world.refused(Refusal::OutOfRange), world.node.counters().kept.edges), (4, 1));
}

#[test]
fn a_stranger_and_a_tick_that_is_past_are_no_news() {
    let mut world = World::new(&config(guarded(2)));
    world.ticks(10, Some(1.0));
    let old = TickStamp::low(world.node.tick() - 1, 8);
    for (source, tick) in [(9, TickStamp::low(world.node.tick(), 8)), (2, old)] {
        let source = NodeId::new(source).unwrap();
        for _ in 0..5 {
            let far = Message::State { source, component: Component::FIRST, tick, x: 60.0 };
            assert_eq!(world.node.on_message(&far, 0), Err(Refusal::OutOfRange));
        }
    }
    assert_eq!((world.node.counters().kept.edges, world.presence(2)), (0, Some(Presence::Known)));
    assert_eq!(world.ticks(1, Some(1.0)), [Ok(())]);
}

/// A false value of the same tick, in the neighbour's name, does not take the place of the true one.
#[test]
fn the_true_value_of_a_tick_is_taken_after_a_false_one() {
    let mut world = World::new(&config(guarded(2)));
    for _ in 0..10 {
        let _ = world.hear(2, 5.0);
        assert_eq!(world.ticks(1, Some(1.0)).len(), 1);
    }
    // The first one was taken, since nothing was known, and 1 was a duplicate; then two jumps to 1 barred the edge, were it not for 5.
    assert_eq!(world.presence(2), Some(Presence::Known));
    let mut world = World::new(&config(guarded(2)));
    world.ticks(1, Some(1.0));
    for _ in 0..10 {
        assert_eq!((world.hear(2, 5.0), world.ticks(1, Some(1.0))), (Err(Refusal::TooFast), vec![Ok(())]));
    }
    assert_eq!((world.node.counters().extrapolated, world.node.counters().kept.edges), (0, 0));
}

#[test]
fn one_component_bars_the_whole_neighbour() {
    let config = NodeConfig {
        initial_state: [1.0, 2.0].into_iter().collect(),
        field: Field { offset: [0.0, 0.0].into_iter().collect(), ..Field::scalar(0.0, 0.0, []) },
        coupling: Coupling::ElementWise,
        ..config(guarded(3))
    };
    let mut world = World::new(&config);
    let mut tick = |second: f32| {
        let heard = [world.hear_of(2, 0, 1.0), world.hear_of(2, 1, second)];
        world.tick();
        heard
    };
    assert_eq!(tick(2.0), [Ok(()); 2]);
    for _ in 0..3 {
        assert_eq!(tick(4.0), [Ok(()), Err(Refusal::TooFast)]);
    }
    assert_eq!(tick(2.0), [Err(Refusal::Barred); 2]);
    assert_eq!(world.node.counters().kept.edges, 1);
}

#[test]
fn a_barred_neighbour_is_a_lost_one() {
    let mut world = World::new(&NodeConfig { lost_neighbours: 1, ..config(guarded(2)) });
    world.ticks(5, Some(1.0));
    world.ticks(2, Some(5.0));
    assert_eq!(world.node.phase(), Phase::Faulted(FaultCode::NEIGHBOURS_LOST));
}

#[test]
fn a_commit_leaves_a_barred_edge_barred() {
    let mut config = config(guarded(2));
    config.tick_source = TickSource::Timer;
    let mut world = World::new(&config);
    world.ticks(5, Some(1.0));
    world.ticks(2, Some(5.0));
    world.node.adopt(Params::new(&config).unwrap(), &config.neighbours).unwrap();
    assert_eq!(world.ticks(1, Some(1.0)), [Err(Refusal::Barred)]);
    // Where it is no neighbour for a while, it is a new one.
    let mut without = config.clone();
    without.neighbours.remove(0);
    world.node.adopt(Params::new(&without).unwrap(), &without.neighbours).unwrap();
    world.node.adopt(Params::new(&config).unwrap(), &config.neighbours).unwrap();
    assert_eq!(world.ticks(1, Some(9.0)), [Ok(())]);
}

#[test]
fn limits_out_of_range_are_refused_by_name() {
    let error = |limit, rate| {
        let config = config(HeardLimits { limit, rate, drop_after: 1 });
        match Params::<f32>::new(&config).unwrap_err() {
            ConfigError::OutOfRange { field, .. } => field,
            other => panic!("{other}"),
        }
    };
    for bad in [-1.0, f32::NAN, f32::INFINITY, 1e-30] {
        assert_eq!((error(bad, 1.0), error(1.0, bad)), (ConfigField::HeardLimit, ConfigField::HeardRate));
    }
}

/// Values that a neighbour says at each tick, or its silence; a thousandth of them is near the limits.
fn values() -> impl Strategy<Value = Vec<[Option<f32>; 2]>> {
    let number = prop_oneof![
        any::<u32>().prop_map(f32::from_bits),
        -60.0..60.0f32,
        0.98..1.02f32,
        Just(f32::NAN),
        Just(f32::INFINITY),
    ];
    let value = || prop_oneof![1 => Just(None), 4 => number.clone().prop_map(Some)];
    prop::collection::vec([value(), value()], 1..120)
}

proptest! {
    /// What a node sees of its neighbours is bounded whatever they say: by the limit, and by what is extrapolated at the limit of the rate.
    #[test]
    fn whatever_is_heard_the_term_is_bounded(said in values(), drop_after in 0u8..4) {
        let limits = HeardLimits { drop_after, ..guarded(0) };
        let mut world = World::new(&config(limits));
        for [second, third] in said {
            for (id, x) in [(2, second), (3, third)] {
                let _ = x.map(|x| world.hear(id, x));
            }
            world.tick();
            // Who is thrown beyond the limit of its own state stops there.
            let phase = world.node.phase();
            prop_assert!(phase == Phase::Running || phase == Phase::Faulted(FaultCode::STATE_LIMIT));
            let seen = world.node.observations()[0];
            let most = 2.0 * (50.0 + PATIENCE as f32 * 0.01 + seen.x.abs()) * 1.00001;
            prop_assert!(seen.nu.abs() <= most && seen.u.is_finite() && seen.x.abs() <= 100.0, "{seen:?}");
        }
    }

    /// Who moves within the limits is heard as if there were none, to the bit, whatever gets lost.
    #[test]
    fn honest_neighbours_do_not_notice_the_limits(
        steps in prop::collection::vec([-1.0f32..1.0, -1.0..1.0], 1..200),
        lost in prop::collection::vec(0u8..4, 200),
        drop_after in 0u8..4,
    ) {
        let mut worlds = [HeardLimits { drop_after, ..guarded(0) }, HeardLimits::NONE].map(|heard| World::new(&config(heard)));
        let mut x = [1.0f32; 2];
        for (step, lost) in steps.iter().zip(&lost) {
            // Rounding is not to make it more than the limit.
            x = [0, 1].map(|i| x[i] + 0.0099 * step[i]);
            for world in &mut worlds {
                for (i, id) in [2, 3].into_iter().enumerate() {
                    if usize::from(*lost) != i {
                        world.hear(id, x[i]).unwrap();
                    }
                }
                world.tick();
            }
            let [a, b] = [0, 1].map(|i| worlds[i].node.observations()[0]);
            prop_assert!(a == b && a.u.to_bits() == b.u.to_bits());
        }
    }
}

/// Its ticks stand still, and a stamp has eight bits: what comes 250 ticks later looks as if it were of five ticks before.
#[test]
fn a_node_that_has_stopped_judges_nobody() {
    let mut world = World::new(&config(guarded(2)));
    world.ticks(3, Some(1.0));
    let stop = Message::Ctrl { target: Target::All, command: Command::Stop, arg: 0, at_tick: 0 };
    world.node.on_message(&stop, 0).unwrap();
    world.poll(0);
    assert_eq!(world.node.phase(), Phase::Stopped);
    world.told();
    for x in [7.0, 8.0, 9.0, 60.0] {
        assert!(world.hear(2, x).is_err(), "{x}");
    }
    assert!(world.told().is_empty() && world.node.counters().kept.edges == 0);
    assert_eq!(world.node.neighbour_is_barred(NodeId::new(2).unwrap()), Some(false));
}

/// It comes to a network that runs, and nobody tells it the tick for a second: a stamp of eight bits looks like one of its own tick every 256. One state
/// is lost, so that the next one that looks new has changed for 257 ticks, and not for one.
#[test]
fn a_node_that_waits_for_its_tick_judges_nobody() {
    let waits = NodeConfig { tick_source: TickSource::Sync, ..config(guarded(2)) };
    let mut world = World::new(&waits);
    for k in (0..1_024_u32).filter(|&k| k != 2) {
        // Half as fast as is taken.
        let (source, tick, x) = (NodeId::new(2).unwrap(), TickStamp::low(k, 8), k as f32 * 0.005);
        let _ = world.node.on_message(&Message::State { source, component: Component::FIRST, tick, x }, 0);
    }
    assert_eq!(world.node.counters().ticks, 0);
    assert!(world.refused(Refusal::TooFast) > 0, "it would have judged");
    world.poll(0);
    let judges = |event: &Event| matches!(event, Event::TooFast { .. } | Event::Barred(_));
    assert!(!world.told().iter().any(judges) && world.node.counters().kept.edges == 0);
    assert_eq!(world.node.neighbour_is_barred(NodeId::new(2).unwrap()), Some(false));
}
