//! Sessions that keep one time: nodes with clocks that drift, on a medium that brings every frame late, now more and
//! now less, as a line through a computer does.
#![allow(clippy::unwrap_used, clippy::panic, reason = "helpers of tests, which clippy does not know as such")]

use funnelnet_node::time::Role;
use funnelnet_node::{Event, Output, Phase, Session};
use funnelnet_protocol::config::{ConfigError, ConfigField, Shape, TickSource, TimeRules};
use funnelnet_protocol::message::{Command, FaultCode, JOIN, Message, NodeId, Target};
use funnelnet_protocol::refusal::Refusal;
use funnelnet_protocol::serial::Frame;
use funnelnet_protocol::service::Identity;
use funnelnet_protocol::{NodeConfig, WIRE_VERSION};

const US: u64 = 1_000;
const MS: u64 = 1_000_000;
const S: u64 = 1_000_000_000;
const TICK: u64 = 10 * MS;
const PERIOD: u64 = 100 * MS;
/// Step of the world, ns.
const STEP: u64 = 50 * US;
const HOLDOVER: u64 = S;

fn id(number: u8) -> NodeId {
    NodeId::new(number).unwrap()
}

fn rules(masters: &[u8], jitter_us: u32) -> TimeRules {
    let rules = TimeRules { period_us: (PERIOD / US) as u32, jitter_us, ..TimeRules::NONE };
    masters.iter().fold(rules, |rules, &master| rules.with_master(id(master)))
}

/// Node `number` of `count` that all hear each other.
fn config(number: u8, count: u8, time: TimeRules) -> NodeConfig {
    let others = (1..=count).filter(|&other| other != number);
    let builder = NodeConfig::builder(number, TICK as u32).funnel(Shape::Constant { width: 100.0 });
    others.fold(builder, |builder, other| builder.edge(other, 1.0)).time(time).build().unwrap()
}

/// A node with a clock of its own.
struct Member {
    session: Session,
    /// What its clock shows at time 0, ns.
    offset: u64,
    /// Parts in a billion that it is too fast.
    ppb: i64,
    is_on: bool,
    /// Tick and time of its last state.
    said: (u32, u64),
    events: Vec<Event>,
    faults: Vec<(u64, FaultCode)>,
}

impl Member {
    fn own(&self, t: u64) -> u64 {
        let gained = i128::from(t) * i128::from(self.ppb) / 1_000_000_000;
        u64::try_from(i128::from(self.offset) + i128::from(t) + gained).unwrap()
    }
}

struct World {
    members: Vec<Member>,
    t: u64,
    /// Frames on their way: when they come, to whom, what they say.
    frames: Vec<(u64, usize, Message)>,
    /// The longest that a frame takes beyond the shortest, ns.
    jitter: u64,
    /// From and to when no SYNC reaches anybody.
    deaf: (u64, u64),
    random: u64,
    /// The largest time between the first and the last node that said the same tick, since it was last taken.
    skew: u64,
}

impl World {
    fn new(ppb: &[i64], time: TimeRules, jitter: u64) -> Self {
        Self::held(ppb, time, jitter, 0)
    }

    fn held(ppb: &[i64], time: TimeRules, jitter: u64, holdover_ns: u64) -> Self {
        let count = ppb.len() as u8;
        let member = |(index, &ppb): (usize, &i64)| {
            let number = index as u8 + 1;
            let mut session = Session::new(Identity { wire_version: WIRE_VERSION, ..Identity::default() });
            *session.config_buffer() = Some(NodeConfig { holdover_ns, ..config(number, count, time) });
            session.restore().unwrap();
            let offset = 3 * S * u64::from(number);
            Member { session, offset, ppb, is_on: true, said: (0, 0), events: vec![], faults: vec![] }
        };
        let members = ppb.iter().enumerate().map(member).collect();
        Self { members, t: 0, frames: vec![], jitter, deaf: (0, 0), random: 1, skew: 0 }
    }

    fn draw(&mut self) -> u64 {
        self.random =
            self.random.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        self.random >> 33
    }

    fn tell(&mut self, index: usize, message: Message) {
        let now = self.members[index].own(self.t);
        self.members[index].session.on_frame(Ok(Frame::RealTime(message)), now);
    }

    fn start(&mut self, index: usize, at_tick: u16) {
        self.tell(index, Message::Ctrl { target: Target::All, command: Command::Start, arg: 0, at_tick });
    }

    /// Starts all, a quarter of a millisecond after each other.
    fn start_all(&mut self) {
        for index in 0..self.members.len() {
            self.start(index, 0);
            self.run(self.t + 250 * US);
        }
    }

    fn run(&mut self, until: u64) {
        while self.t < until {
            self.t += STEP;
            self.deliver();
            for index in 0..self.members.len() {
                self.poll(index);
            }
        }
    }

    fn deliver(&mut self) {
        let t = self.t;
        let (due, later) = std::mem::take(&mut self.frames).into_iter().partition(|frame| frame.0 <= t);
        self.frames = later;
        let due: Vec<_> = due;
        for (_, to, message) in due {
            let is_lost = matches!(message, Message::Sync { .. }) && (self.deaf.0..self.deaf.1).contains(&t);
            if self.members[to].is_on && !is_lost {
                self.tell(to, message);
            }
        }
    }

    fn poll(&mut self, index: usize) {
        let t = self.t;
        while self.members[index].is_on {
            let now = self.members[index].own(t);
            let Some(output) = self.members[index].session.poll(now) else { return };
            match output {
                Output::Sync(message) => {
                    self.members[index].session.sync_sent(now);
                    self.broadcast(index, message);
                }
                Output::Send(message) => {
                    self.note(index, &message);
                    self.broadcast(index, message);
                }
                Output::Report(event) => self.members[index].events.push(event),
                _ => {}
            }
        }
    }

    fn note(&mut self, index: usize, message: &Message) {
        let t = self.t;
        match *message {
            Message::State { tick, .. } => {
                self.members[index].said = (tick.value(), t);
                let same = self.members.iter().filter(|member| member.is_on && member.said.0 == tick.value());
                let first = same.map(|member| member.said.1).min().unwrap();
                self.skew = self.skew.max(t - first);
            }
            Message::Fault { code, .. } => self.members[index].faults.push((t, code)),
            _ => {}
        }
    }

    fn broadcast(&mut self, from: usize, message: Message) {
        for to in (0..self.members.len()).filter(|&to| to != from) {
            let at = self.t + 300 * US + self.draw() % self.jitter.max(1);
            self.frames.push((at, to, message));
        }
    }

    fn take_skew(&mut self) -> u64 {
        std::mem::take(&mut self.skew)
    }

    fn role(&self, index: usize) -> Role {
        self.members[index].session.keeper().unwrap().role()
    }
}

/// Clocks that are 280 ppm apart: in a minute 17 ms, more than a tick.
const APART: [i64; 3] = [0, 140_000, -140_000];

#[test]
fn sessions_with_rules_of_time_tick_together_whatever_their_clocks_do() {
    let mut world = World::new(&APART, rules(&[1], 2_000), MS);
    world.start_all();
    // Two stamps of a line, a few ms apart, say nothing of a rate.
    world.run(60 * MS);
    let keeper = world.members[1].session.keeper().unwrap();
    assert_eq!((keeper.is_in_time(), keeper.rate()), (true, 0));
    world.run(20 * S);
    world.take_skew();
    world.run(60 * S);
    // A frame's way, and what is left of its jitter.
    let skew = world.take_skew();
    println!("skew {} us", skew / US);
    assert!(skew < 1_200 * US, "{} us", skew / US);
    let ticks: Vec<_> = world.members.iter().map(|member| member.said.0).collect();
    assert!(ticks.iter().all(|&tick| tick.abs_diff(6_000) <= 2), "{ticks:?}");
    assert_eq!(
        [0, 1, 2].map(|index| world.role(index)),
        [Role::Leads, Role::Follows(id(1)), Role::Follows(id(1))]
    );
    let node = world.members[1].session.node().unwrap();
    assert_eq!((node.counters().extrapolated, node.phase()), (0, Phase::Running));
    assert!(world.members[1].events.contains(&Event::Follows(id(1))));
    assert!(world.members[0].events.contains(&Event::TimeMaster));
}

#[test]
fn without_rules_the_same_clocks_run_apart_and_values_go_stale() {
    let mut world = World::new(&APART, TimeRules::NONE, MS);
    world.start_all();
    world.run(60 * S);
    let counters = world.members[1].session.node().unwrap().counters().clone();
    assert!(counters.extrapolated > 100, "{counters:?}");
    assert!(world.members[1].session.keeper().is_none());
}

#[test]
fn stamps_of_controllers_keep_nodes_within_microseconds_of_a_frame() {
    let mut world = World::new(&APART, rules(&[1], 0), 0);
    world.start_all();
    world.run(20 * S);
    world.take_skew();
    world.run(30 * S);
    // The way of a frame, which nobody knows, and a step of this world.
    let skew = world.take_skew();
    assert!(skew <= 300 * US + 3 * STEP, "{} us", skew / US);
}

#[test]
fn one_that_joins_learns_the_tick_from_a_time_master_and_goes_on_with_the_others() {
    let mut world = World::new(&[0, 100_000, -100_000, 130_000], rules(&[1], 2_000), MS);
    world.members[3].is_on = false;
    (0..3).for_each(|index| world.start(index, 0));
    world.run(10 * S);
    world.members[3].is_on = true;
    world.start(3, JOIN);
    world.run(10 * S + 50 * MS);
    let phase = |world: &World| world.members[3].session.node().unwrap().phase();
    assert_eq!((phase(&world), world.members[3].said.0), (Phase::Ready, 0), "it cannot know the tick yet");
    // A second start is one too many.
    world.start(3, 0);
    assert_eq!(world.members[3].session.node().unwrap().counters().refused(Refusal::Phase), 1);
    world.run(10 * S + 400 * MS);
    assert_eq!(phase(&world), Phase::Running);
    world.run(20 * S);
    let [first, .., last] = [0, 1, 2, 3].map(|index| world.members[index].said.0);
    assert!(last.abs_diff(first) <= 1, "{first} {last}");
    let counters = world.members[3].session.node().unwrap().counters();
    assert_eq!((counters.skipped, counters.overruns), (0, 0), "its first tick is that of the network");
    assert!(counters.ticks > 900 && counters.ticks < 1_000, "{counters:?}");
    assert!(
        world.members[3].events.iter().any(|event| matches!(event, Event::Joins { tick } if *tick > 1_000))
    );
}

#[test]
fn the_next_master_follows_one_that_dies_within_three_periods_and_yields_to_it() {
    let mut world = World::new(&APART, rules(&[1, 2], 2_000), MS);
    world.start_all();
    world.run(10 * S);
    world.members[0].is_on = false;
    world.run(10 * S + 3 * PERIOD + 20 * MS);
    assert_eq!((world.role(1), world.role(2)), (Role::Leads, Role::Follows(id(2))));
    world.run(20 * S);
    // It comes back as after power-on.
    *world.members[0].session.config_buffer() = Some(config(1, 3, rules(&[1, 2], 2_000)));
    world.tell(0, Message::Ctrl { target: Target::All, command: Command::Stop, arg: 0, at_tick: 0 });
    world.poll(0);
    world.members[0].session.restore().unwrap();
    world.members[0].is_on = true;
    world.start(0, JOIN);
    world.run(40 * S);
    assert_eq!([0, 1].map(|index| world.role(index)), [Role::Leads, Role::Follows(id(1))]);
    let ticks: Vec<_> = world.members.iter().map(|member| member.said.0).collect();
    assert!(ticks.iter().all(|&tick| tick.abs_diff(ticks[0]) <= 1), "{ticks:?}");
}

#[test]
fn without_sync_for_longer_than_the_holdover_a_follower_stops_by_fault_7_and_the_master_does_not() {
    let mut world = World::held(&APART, rules(&[1], 2_000), MS, HOLDOVER);
    world.start_all();
    world.deaf = (10 * S, u64::MAX);
    world.run(10 * S + HOLDOVER / 2);
    assert!(world.members.iter().all(|member| member.faults.is_empty()));
    world.run(12 * S);
    for index in [1, 2] {
        let [(at, FaultCode::HOLDOVER)] = world.members[index].faults[..] else { panic!("no FAULT 7") };
        assert!(at.abs_diff(10 * S + HOLDOVER) < 3 * PERIOD, "{at}");
        assert!(world.members[index].events.contains(&Event::NoTimeMaster));
    }
    assert_eq!(world.members[0].session.node().unwrap().phase(), Phase::Running);
}

#[test]
fn rules_that_are_none_are_refused_by_name() {
    let refused = |time: TimeRules, tick_source| {
        let mut session = Session::new(Identity { wire_version: WIRE_VERSION, ..Identity::default() });
        *session.config_buffer() = Some(NodeConfig { tick_source, ..config(2, 3, time) });
        session.restore()
    };
    let field = |time| match refused(time, TickSource::Timer) {
        Err(ConfigError::OutOfRange { field, .. }) => Some(field),
        other => panic!("{other:?}"),
    };
    let good = rules(&[1, 2], 2_000);
    assert_eq!(refused(good, TickSource::Timer), Ok(()));
    assert_eq!(refused(good, TickSource::Sync), Err(ConfigError::TimeOfTicks));
    assert_eq!(refused(TimeRules::NONE, TickSource::Sync), Ok(()));
    assert_eq!(field(TimeRules { masters: [0; 16], ..good }), Some(ConfigField::SyncMasters));
    let mut with_host = good;
    with_host.masters[0] |= 1;
    assert_eq!(field(with_host), Some(ConfigField::SyncMasters));
    assert_eq!(field(TimeRules { period_us: 9_999, ..good }), Some(ConfigField::SyncPeriod));
    assert_eq!(field(TimeRules { period_us: 10_000_001, ..good }), Some(ConfigField::SyncPeriod));
    // A new master's SYNC come each tick of 10 ms, and a quarter of that is the most by which one may be late.
    assert_eq!(refused(TimeRules { jitter_us: 2_500, ..good }, TickSource::Timer), Ok(()));
    assert_eq!(field(TimeRules { jitter_us: 2_501, ..good }), Some(ConfigField::SyncJitter));
    let slow = TimeRules { period_us: 1_000_000, ..good };
    assert_eq!(refused(TimeRules { jitter_us: 30_000, ..slow }, TickSource::Timer), Ok(()));
    assert_eq!(field(TimeRules { jitter_us: 30_001, ..slow }), Some(ConfigField::SyncJitter));
}

#[test]
fn who_has_no_rules_takes_no_time_from_a_master() {
    let mut world = World::new(&[0], TimeRules::NONE, 0);
    world.start_all();
    let before = world.members[0].session.node().unwrap().counters().clone();
    let previous_tick = funnelnet_protocol::message::TickStamp::full(500);
    world.tell(0, Message::Sync { source: Some(id(9)), previous_tick, phase_us: 0 });
    let node = world.members[0].session.node().unwrap();
    assert_eq!(node.counters().accepted, before.accepted + 1);
    world.run(S);
    assert!(world.members[0].said.0.abs_diff(100) <= 1);
}
