//! The conductor in virtual time, with lines that say what a test has written down.

use super::*;
use crate::bus::ideal::IdealParams;
use funnelnet_protocol::WIRE_VERSION;
use funnelnet_protocol::config::{ConfigError, Field, HeardLimits, Shape, TickSource, TimeRules};
use funnelnet_protocol::message::{Component, NodeId, TickStamp};
use funnelnet_protocol::serial::{MAX_FRAME, MAX_RAW};
use funnelnet_protocol::service::{Body, Reply};
use std::collections::VecDeque;

const MS: u64 = 1_000_000;
const ANSWER: Duration = Duration::from_millis(500);
const PATIENCE: Patience = Patience { boot: Duration::from_secs(3), answer: ANSWER };

/// Lines, and a clock that goes on as far as a task waits.
#[derive(Default)]
struct Played {
    now: u64,
    /// What comes from the node at index 0, each with its time.
    says: VecDeque<(u64, Vec<u8>)>,
    /// What was written, with time and node.
    written: Vec<(u64, usize)>,
    /// Time that the host takes for each thing that it reads.
    slow: u64,
    /// Nodes whose line takes nothing.
    deaf: Vec<usize>,
}

impl Played {
    fn run<T>(&mut self, mut task: Task<'_, T>) -> T {
        loop {
            match task.poll(self.now) {
                Step::Done(outcome) => return outcome,
                Step::Do(Action::Write { node, .. }) => {
                    self.written.push((self.now, node));
                    if self.deaf.contains(&node) {
                        task.on_failed(died(node));
                    }
                }
                Step::Do(Action::Read { until, from }) => self.read(from, until, &mut task),
                Step::Do(action) => panic!("{action:?}"),
            }
        }
    }

    fn read<T>(&mut self, from: Source, until: u64, task: &mut Task<'_, T>) {
        let heard = matches!(from, Source::Line(0) | Source::All);
        match self.says.pop_front_if(|(at, _)| heard && *at < until) {
            Some((at, bytes)) => {
                self.now = self.now.max(at);
                task.on_bytes(0, &bytes, self.now);
                self.now += self.slow;
            }
            None => self.now = self.now.max(until),
        }
    }

    fn say(&mut self, at: u64, bytes: Vec<u8>) {
        self.says.push_back((at, bytes));
    }
}

fn died(node: usize) -> HubError {
    HubError::Died { node: node as u8 + 1, place: "the line".to_owned(), detail: "it is gone".to_owned() }
}

fn reply(body: &impl Body) -> Vec<u8> {
    let (mut scratch, mut frame) = ([0; MAX_RAW], [0; MAX_FRAME]);
    let length = serial::encode_service(body, 1, &mut scratch, &mut frame).unwrap();
    frame[..length].to_vec()
}

fn identity() -> Vec<u8> {
    reply(&Reply::Identity(Identity { wire_version: WIRE_VERSION, ..Identity::default() }))
}

fn state(tick: u32, x: f32) -> Vec<u8> {
    let source = NodeId::new(1).unwrap();
    let message = Message::State { source, component: Component::FIRST, tick: TickStamp::full(tick), x };
    serial::encode(&message).to_vec()
}

fn config(id: u8) -> NodeConfig {
    let field = Field {
        slope: [-1.0].into_iter().collect(),
        offset: [1.0].into_iter().collect(),
        sines: [].into_iter().collect(),
    };
    let config = NodeConfig::builder(id, 10_000_000).tick_source(TickSource::Sync).state([1.0]);
    config.state_limit(1e6).field(field).funnel(Shape::Constant { width: 10.0 }).build().unwrap()
}

/// Of so many nodes that do not hear each other.
fn conductor(nodes: u8) -> Conductor {
    conductor_of(&(1..=nodes).map(config).collect::<Vec<_>>())
}

fn conductor_of(configs: &[NodeConfig]) -> Conductor {
    let seat = |config: &NodeConfig| Seat { id: config.id, place: "the line".to_owned(), uid: None };
    let bus = IdealBus::new(IdealParams::default(), 1, vec![Vec::new(); configs.len()]);
    Conductor::new(configs.iter().map(seat).collect(), configs, bus, PATIENCE)
}

/// One node that has been met, and started where it ticks by SYNC.
fn started() -> (Conductor, Played) {
    let (mut conductor, mut line) = (conductor(1), Played::default());
    line.say(0, [identity(), reply(&Reply::Configured(Ok(()))), state(0, 1.0)].concat());
    line.run(conductor.meet()).unwrap();
    line.run(conductor.start()).unwrap();
    (conductor, line)
}

#[test]
fn who_is_silent_is_asked_again_and_given_up_in_time() {
    let mut line = Played::default();
    let error = line.run(conductor(1).meet()).unwrap_err();
    assert_eq!(error.to_string(), "node 1 did not answer: no identity within 3 s");
    let seconds: Vec<_> = line.written.iter().map(|(at, _)| at / (1000 * MS)).collect();
    assert_eq!((seconds, line.now / MS), (vec![0, 1, 2], 3000));
}

#[test]
fn what_was_read_in_time_is_not_lost_to_a_slow_host() {
    let (mut conductor, mut line) = (conductor(1), Played { slow: 10_000 * MS, ..Played::default() });
    line.say(400 * MS, [identity(), reply(&Reply::Configured(Ok(())))].concat());
    line.run(conductor.meet()).unwrap();
    assert!(line.now > 10_000 * MS, "{}", line.now);
}

#[test]
fn who_says_nothing_of_a_tick_and_who_says_other_things_are_told_apart_in_the_same_time() {
    let (mut conductor, mut line) = started();
    let error = line.run(conductor.advance()).unwrap_err();
    assert_eq!(error.to_string(), "node 1 did not answer: no state within 0.5 s");
    assert_eq!(line.now / MS, 500);
    let (mut conductor, mut line) = started();
    (0..1000).for_each(|n| line.say(10 * n * MS, identity()));
    line.slow = MS;
    let error = line.run(conductor.advance()).unwrap_err();
    assert_eq!(error.to_string(), "node 1 goes on speaking, but said no state of tick 0 within 0.5 s");
    assert_eq!(line.now / MS, 501, "one deadline for all that it says");
}

#[test]
fn time_that_is_over_after_a_message_is_babble_and_before_any_it_is_silence() {
    for (slow, babbles) in [(600 * MS, true), (0, false)] {
        let (mut conductor, mut line) = started();
        line.slow = slow;
        line.say(100 * MS, identity());
        let error = line.run(conductor.advance()).unwrap_err();
        assert_eq!(matches!(error, HubError::Babbles { .. }), babbles, "{error}");
        assert_eq!(matches!(error, HubError::NoAnswer { .. }), !babbles, "{error}");
    }
}

#[test]
fn a_line_that_fails_is_known_before_the_next_one_is_written_to() {
    let (mut conductor, mut lines) = (conductor(3), Played { deaf: vec![1], ..Played::default() });
    let error = lines.run(conductor.start()).unwrap_err();
    assert!(matches!(error, HubError::Died { node: 2, .. }), "{error}");
    assert_eq!(lines.written, [(0, 0), (0, 1)]);
}

#[test]
fn who_does_not_confirm_a_halt_holds_up_the_others_for_a_second() {
    let (mut conductor, mut lines) = (conductor(3), Played { deaf: vec![1], ..Played::default() });
    let report = reply(&Reply::Report(Report::default()));
    lines.say(990 * MS, report);
    let halted = lines.run(conductor.halt());
    assert_eq!((halted.confirmed.as_slice(), halted.silent.as_slice()), ([1].as_slice(), [2, 3].as_slice()));
    assert!(halted.reports[0].is_some() && halted.reports[1].is_none());
    // Each is told, and asked where it hears.
    let nodes: Vec<_> = lines.written.iter().map(|&(_, node)| node).collect();
    assert_eq!(nodes, [0, 0, 1, 2, 2]);
    assert!((1000..1005).contains(&(lines.now / MS)), "{}", lines.now);
}

#[test]
fn a_clock_of_its_own_that_falls_silent_is_named_in_time() {
    let (conductor, mut line) = started();
    let mut conductor = conductor.with_own_clock();
    let begin = line.now;
    line.run(conductor.start()).unwrap();
    let error = line.run(conductor.advance()).unwrap_err();
    assert_eq!(error.to_string(), "node 1 has said nothing for 0.51 s; it has not ticked at all");
    let took = (line.now - begin) / MS;
    assert!((510..=560).contains(&took), "{took}");
}

#[test]
fn a_task_that_is_dropped_leaves_nothing_to_the_next() {
    let mut conductor = conductor(1);
    let mut task = conductor.meet();
    assert!(matches!(task.poll(0), Step::Do(Action::Write { node: 0, .. })));
    task.on_failed(died(0));
    drop(task);
    let mut line = Played::default();
    line.say(0, [identity(), reply(&Reply::Configured(Ok(())))].concat());
    line.run(conductor.meet()).unwrap();
}

#[test]
fn a_request_whose_answer_is_spoilt_is_sent_again() {
    let (mut conductor, mut line) = (conductor(1), Played::default());
    let mut spoilt = reply(&Reply::Configured(Ok(())));
    spoilt[3] ^= 0x40;
    line.say(0, [identity(), spoilt].concat());
    line.say(300 * MS, reply(&Reply::Configured(Ok(()))));
    line.run(conductor.meet()).unwrap();
    let asked: Vec<_> = line.written.iter().map(|(at, _)| at / MS).collect();
    assert_eq!(asked, [0, 0, 166], "who it is, and its configuration twice");
}

#[test]
fn who_never_answers_a_request_is_given_up_in_the_time_for_one_answer() {
    let (mut conductor, mut line) = (conductor(1), Played::default());
    line.say(0, identity());
    let error = line.run(conductor.meet()).unwrap_err();
    assert_eq!(error.to_string(), "node 1 did not answer: no configured within 0.5 s");
    assert_eq!((line.now / MS, line.written.len()), (500, 4));
}

/// It speaks the same version of the wire, and finds 9 bytes too many.
#[test]
fn a_node_that_cannot_read_limits_of_what_is_heard_may_be_too_old() {
    let told = |rate, reason| {
        let heard = HeardLimits { rate, ..HeardLimits::NONE };
        let mut line = Played::default();
        line.say(0, [identity(), reply(&Reply::Configured(Err(reason)))].concat());
        let mut conductor = conductor_of(&[NodeConfig { heard, ..config(1) }]);
        line.run(conductor.meet()).unwrap_err().to_string()
    };
    let found = told(25.0, ConfigError::Malformed);
    assert!(
        found.starts_with("node 1 refused its configuration: the bytes are not a configuration"),
        "{found}"
    );
    assert!(found.contains("\nits firmware may be too old to know safety.heard_limit"), "{found}");
    assert!(!told(0.0, ConfigError::Malformed).contains("firmware"));
    assert!(!told(25.0, ConfigError::Running).contains("firmware"));
}

#[test]
fn so_may_one_that_cannot_read_rules_of_time() {
    let time = TimeRules { period_us: 100_000, ..TimeRules::NONE }.with_master(NodeId::new(1).unwrap());
    let mut line = Played::default();
    line.say(0, [identity(), reply(&Reply::Configured(Err(ConfigError::Malformed)))].concat());
    let mut conductor = conductor_of(&[NodeConfig { time, ..config(1) }]);
    let found = line.run(conductor.meet()).unwrap_err().to_string();
    assert!(found.contains("\nits firmware may be too old to know [sync]: "), "{found}");
}

#[test]
fn frames_that_a_line_doubles_are_named_and_harm_nothing() {
    let telemetry =
        |tick| reply(&Reply::Telemetry(Telemetry { tick, component: 0, nu: 0.5, psi: 10.0, u: 0.0 }));
    let block = |tick| [state(tick + 1, 1.0), telemetry(tick)].concat();
    let each = |tick| [state(tick + 1, 1.0), state(tick + 1, 1.0), telemetry(tick), telemetry(tick)].concat();
    for doubled in [|block: Vec<u8>, _: Vec<u8>| [block.clone(), block].concat(), |_, each| each] {
        let (mut conductor, mut line) = started();
        for tick in 0..3 {
            line.say(line.now, doubled(block(tick), each(tick)));
            line.run(conductor.advance()).unwrap();
            assert_eq!(conductor.presence(), [Presence::Ran]);
            assert_eq!((conductor.observations()[0].tick, conductor.observations()[0].nu), (tick, 0.5));
        }
        let [said] = &conductor.contradictions()[..] else { panic!("{:?}", conductor.contradictions()) };
        assert!(said.starts_with("node 1 has a line that doubles frames: a state at tick 0, "), "{said}");
    }
}
