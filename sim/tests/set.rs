//! Configurations that nodes adopt while they run, by events of kind `set`.
#![allow(clippy::unwrap_used, clippy::panic, reason = "helpers of tests, which clippy does not know as such")]

use funnelnet_law::math;
use funnelnet_node::{Event, Observation, Output, Session, Task};
use funnelnet_protocol::NodeConfig;
use funnelnet_protocol::message::{Command, Message, Target};
use funnelnet_protocol::refusal::Refusal;
use funnelnet_protocol::serial::{Frame, MAX_BODY};
use funnelnet_protocol::service::{Body as _, Identity, Request};
use funnelnet_sim::configure::{listeners, node_configs, staged_configs};
use funnelnet_sim::loopback::{LOOPBACK, can_bus, engine, engine_on};
use funnelnet_sim::{Scenario, Simulation, Verdict};
use std::path::Path;

/// A ring of five that differ, for 2 s: inside a funnel of 0.2 from 1 s on.
const RING: &str = r#"version = 1
graph = { kind = "ring", nodes = 5 }
coupling.kind = "node-wise"
coupling.gain = { kind = "reciprocal", scale = 1.0 }
coupling.funnel = { kind = "exponential", start = 10.0, end = 0.2, rate = 4.0 }
agent.dynamics = { kind = "affine", slope = -1.0, offset = 1.0 }
"#;
const TIME: &str = "time = { tick = \"1ms\", duration = \"2s\" }\n";
const DRIVEN: &str =
    "[[node]]\nid = 3\nstate = 0.5\ndynamics = { sines = [{ amplitude = 2.0, frequency = 3.0 }] }\n";

/// The narrower funnel of most tests.
const NARROW: &str = "at = '1.2s', kind = 'set', key = 'coupling.funnel.end', value = 0.05";

fn read(events: &[&str], rest: &str) -> Scenario {
    let events: Vec<_> = events.iter().map(|event| format!("{{ {event} }}")).collect();
    let time = if rest.contains("time =") { "" } else { TIME };
    let text = format!("{RING}{time}event = [{}]\n{rest}\n{DRIVEN}", events.join(", "));
    Scenario::parse(&text, Path::new("ring.toml"), &[]).unwrap_or_else(|errors| panic!("{errors}"))
}

/// What all nodes saw at each tick, what they reported, and the verdict.
struct Played {
    seen: Vec<Vec<Observation<f32>>>,
    adopted: Vec<(usize, u32)>,
    verdict: Verdict,
}

fn played(scenario: &Scenario) -> Played {
    let mut simulation = Simulation::new(scenario).unwrap();
    let mut seen = Vec::new();
    while simulation.step().is_some() {
        seen.push((1..=5).map(|id| simulation.node(id)[0]).collect());
    }
    let adopted = simulation.events().iter().filter_map(|said| match said.event {
        Event::Adopted { tick } => Some((said.node, tick)),
        _ => None,
    });
    Played { adopted: adopted.collect(), verdict: simulation.verdict(), seen }
}

/// `end + (start - end) e^(-rate t)`.
fn width(start: f64, end: f64, rate: f64, k: usize) -> f64 {
    end + (start - end) * math::exp(-rate * k as f64 * 1e-3)
}

fn is_near(a: f32, b: f64) -> bool {
    (f64::from(a) - b).abs() < 1e-5 * b
}

#[test]
fn all_nodes_adopt_at_the_tick_and_nothing_changes_before() {
    let now = played(&read(&[NARROW], ""));
    let later = played(&read(&[&NARROW.replace("1.2s", "1.9s")], ""));
    assert_eq!(now.adopted, [0, 1, 2, 3, 4].map(|node| (node, 1200)));
    assert_eq!(now.seen[..1200], later.seen[..1200]);
    for k in [1199, 1200, 1999] {
        let end = if k < 1200 { 0.2 } else { 0.05 };
        assert!(now.seen[k].iter().all(|seen| is_near(seen.psi, width(10.0, end, 4.0, k))), "{k}");
    }
    assert_ne!(now.seen[1201], later.seen[1201]);
}

/// An event between two ticks comes before the later one, as every event does.
#[test]
fn the_first_tick_is_the_one_at_or_after_the_time() {
    for (at, tick) in [("1.2s", 1200), ("1199.001ms", 1200), ("1ms", 1), ("2s", 2000)] {
        let scenario = read(&[&NARROW.replace("1.2s", at)], "");
        assert_eq!(played(&scenario).adopted, [0, 1, 2, 3, 4].map(|node| (node, tick)), "{at}");
    }
}

/// The firmware's session with a storage that keeps what is staged.
struct Board {
    session: Session,
    staged: Option<NodeConfig>,
}

impl Board {
    fn new(now: &NodeConfig, next: &NodeConfig) -> Self {
        let mut board = Self { session: Session::new(Identity::default()), staged: None };
        board.ask(&Request::Configure(now.clone()));
        board.ask(&Request::Stage(next.clone()));
        assert!(board.staged.is_some());
        board
    }

    fn ask(&mut self, request: &Request) {
        let mut body = [0; MAX_BODY];
        let length = request.encode(&mut body).unwrap();
        let frame = Frame::Service { kind: request.kind(), source: 0, body: &body[..length] };
        self.session.on_frame(Ok(frame), 0);
        self.poll(0);
    }

    fn tell(&mut self, message: Message, now: u64) -> Vec<Message> {
        self.session.on_frame(Ok(Frame::RealTime(message)), now);
        self.poll(now)
    }

    /// Does what is due, and gives what is sent.
    fn poll(&mut self, now: u64) -> Vec<Message> {
        let mut sent = Vec::new();
        while let Some(output) = self.session.poll(now) {
            match output {
                Output::Send(message) => sent.push(message),
                Output::StorageRequest => {
                    match self.session.task().unwrap() {
                        Task::Stage(config) => self.staged = Some(config.clone()),
                        Task::Commit(room) => *room = self.staged.take(),
                        Task::Store(_) | Task::Erase | Task::Key(..) => panic!(),
                    }
                    self.session.performed(Ok(1));
                }
                _ => {}
            }
        }
        sent
    }
}

/// Runs the firmware's sessions on a bus without delay, with a commit on the wire, in place of the simulator's nodes.
fn on_boards(scenario: &Scenario, at: u16) -> Vec<Vec<Observation<f32>>> {
    const TICK: u64 = 1_000_000;
    let (now, next) =
        (node_configs(scenario, LOOPBACK).unwrap(), staged_configs(scenario, LOOPBACK).unwrap());
    let mut boards: Vec<_> =
        now.iter().zip(&next.unwrap()).map(|(now, next)| Board::new(now, next)).collect();
    let listeners = listeners(scenario);
    let deliver = |boards: &mut Vec<Board>, sent: Vec<Vec<Message>>, time: u64| {
        for (from, messages) in sent.into_iter().enumerate() {
            for message in messages {
                for &to in &listeners[from] {
                    assert!(boards[to].tell(message, time).is_empty());
                }
            }
        }
    };
    let to_all = |command, at_tick| Message::Ctrl { target: Target::All, command, arg: 0, at_tick };
    let sent = boards.iter_mut().map(|board| board.tell(to_all(Command::Start, 0), 0)).collect();
    deliver(&mut boards, sent, 0);
    let mut seen = Vec::new();
    for k in 0..=scenario.time.ticks {
        if k + 5 == u64::from(at) {
            boards.iter_mut().for_each(|board| drop(board.tell(to_all(Command::Commit, at), k * TICK)));
        }
        let time = (k + 1) * TICK;
        let sent = boards.iter_mut().map(|board| board.poll(time)).collect();
        seen.push(boards.iter().map(|board| board.session.node().unwrap().observations()[0]).collect());
        deliver(&mut boards, sent, time);
    }
    seen
}

#[test]
fn the_simulators_nodes_adopt_it_as_the_firmwares_sessions_do_to_the_bit() {
    for event in [
        NARROW,
        "at = '1.2s', kind = 'set', key = 'coupling.gain', value = { kind = 'logarithmic', scale = 2.0 }",
        "at = '1.2s', kind = 'set', key = 'agent.dynamics.offset', value = 3.0",
        "at = '1.2s', kind = 'set', key = 'coupling.damping', value = 2.6",
        "at = '1.2s', kind = 'set', key = 'agent.limits', value = { low = -0.5, high = 0.5 }",
    ] {
        let scenario = read(&[event], "");
        let (simulated, boards) = (played(&scenario), on_boards(&scenario, 1200));
        assert_eq!(simulated.seen, boards, "{event}");
        let calm = played(&read(&[&NARROW.replace("1.2s", "2s")], ""));
        assert_ne!(simulated.seen[1300], calm.seen[1300], "{event}");
    }
}

#[test]
fn a_funnel_that_becomes_narrower_than_the_network_is_a_breach_until_it_is_inside_again() {
    let event =
        "at = '500ms', kind = 'set', key = 'coupling.funnel', value = { kind = 'constant', width = 0.02 }";
    let found = played(&read(&[event], "")).verdict;
    assert!(!found.holds() && found.findings.breaches > 0, "{found}");
    assert_eq!(found.findings.first_breach.map(|(k, _)| k), Some(500));
    let found = played(&read(&[event], "expect = { recovered_within = \"300ms\" }")).verdict;
    assert!(found.holds(), "{found}");
    let (during, event) = (found.findings.during_events.unwrap(), &found.findings.events[0]);
    assert!(during.breaches > 5 && during.max_ratio > 2.0, "{during:?}");
    assert_eq!((event.during.breaches, event.during.max_ratio), (during.breaches, during.max_ratio));
    let took = event.recovery.after_s().unwrap();
    assert!(took > 0.003 && took < 0.3 && found.findings.recovered_s == Some(took), "{took}");
}

#[test]
fn some_nodes_may_have_another_funnel_and_are_judged_by_it() {
    let scenario = read(&[&format!("{NARROW}, nodes = [2, 4]")], "");
    let Played { seen, adopted, verdict } = played(&scenario);
    assert_eq!(adopted, [(1, 1200), (3, 1200)]);
    let ends = [0.2, 0.05, 0.2, 0.05, 0.2];
    for (seen, end) in seen[1999].iter().zip(ends) {
        assert!(is_near(seen.psi, width(10.0, end, 4.0, 1999)), "{seen:?}");
    }
    assert!(verdict.holds(), "{verdict}");
}

/// The node with the power failure is judged by what was asked for, and named.
#[test]
fn a_node_that_has_lost_its_power_before_the_tick_misses_it_and_is_named() {
    let bounce = "at = '300ms', kind = 'bounce', node = 2, for = '100ms'";
    let scenario = read(&[bounce, NARROW], "expect = { recovered_within = \"300ms\" }");
    let Played { seen, adopted, verdict } = played(&scenario);
    assert_eq!(adopted, [0, 2, 3, 4].map(|node| (node, 1200)));
    let psi = |id: usize| seen[1999][id - 1].psi;
    assert!(is_near(psi(2), width(10.0, 0.2, 4.0, 1999)) && is_near(psi(1), width(10.0, 0.05, 4.0, 1999)));
    let reasons = verdict.reasons().join("; ");
    assert!(reasons.contains("node 2 has missed what is set at 1.2 s"), "{reasons}");
    assert!(reasons.contains("node 2 runs in another funnel than the scenario's"), "{reasons}");
    let mut engine = engine(&scenario).unwrap();
    engine.start();
    for _ in 0..=2000 {
        engine.advance();
    }
    assert_eq!(engine.missed(), [1]);
    assert_eq!(
        engine.nodes().iter().map(|node| node.counters().refused(Refusal::Phase)).collect::<Vec<_>>(),
        [0, 1, 0, 0, 0]
    );
}

#[test]
fn what_was_committed_outlives_a_power_failure_and_who_was_off_at_the_tick_has_the_old_one() {
    for (from, ends) in [("1.3s", [0.05, 0.05]), ("1.1s", [0.05, 0.2])] {
        let bounce = format!("at = '{from}', kind = 'bounce', node = 2, for = '150ms'");
        let Played { seen, verdict, .. } =
            played(&read(&[&bounce, NARROW], "expect = { recovered_within = \"300ms\" }"));
        for (seen, end) in seen[1999].iter().zip(ends) {
            assert!(is_near(seen.psi, width(10.0, end, 4.0, 1999)), "{from} {seen:?}");
        }
        assert_eq!(
            verdict.reasons().iter().any(|why| why.contains("has missed")),
            from == "1.1s",
            "{verdict}"
        );
    }
}

#[test]
fn a_load_that_changes_moves_the_network_elsewhere_and_predictions_end() {
    let load = "at = '1s', kind = 'set', key = 'agent.dynamics.offset', value = 3.0";
    let scenario = read(&[load], "");
    assert_eq!(scenario.predicted_to(), Some(1000));
    let Played { seen, verdict, .. } = played(&scenario);
    let mean = |k: usize| seen[k].iter().map(|seen| seen.x).sum::<f32>() / 5.0;
    assert!(mean(1999) > mean(999) + 0.8, "{} {}", mean(999), mean(1999));
    assert!(verdict.holds(), "{verdict}");
    // Equal funnels in place of equal funnels leave the emergent dynamics as they are.
    assert_eq!(read(&[NARROW], "").predicted_to(), None);
    assert_eq!(read(&[&format!("{NARROW}, node = 1")], "").predicted_to(), Some(1200));
}

/// The law that is bounded is that of the load, too.
#[test]
fn a_load_that_is_larger_than_all_before_is_borne() {
    let text = r#"version = 1
time = { tick = "1ms", duration = "2s" }
graph = { kind = "ring", nodes = 5 }
coupling.kind = "node-wise"
coupling.gain = { kind = "reciprocal", scale = 1.0 }
coupling.funnel = { kind = "constant", width = 0.2 }
agent.dynamics = { kind = "affine", offset = 0.0 }
node = [{ id = 1, dynamics = { offset = 0.01 } }]
event = [{ at = "500ms", kind = "set", key = "agent.dynamics.offset", value = 4.0, node = 3 }]
"#;
    let scenario =
        Scenario::parse(text, Path::new("load.toml"), &[]).unwrap_or_else(|errors| panic!("{errors}"));
    let findings = Simulation::new(&scenario).unwrap().run().findings;
    assert!(findings.max_ratio < 0.9, "{}", findings.max_ratio);
}

/// Between two ticks at which something is set funnels differ, though they are alike before and after.
#[test]
fn predictions_end_where_funnels_differ_for_a_while() {
    let of = |at: &str| {
        let first = "at = '500ms', kind = 'set', key = 'coupling.funnel.end', value = 0.1, node = 3";
        let second = format!(
            "at = '{at}', kind = 'set', key = 'coupling.funnel.end', value = 0.1, nodes = [1, 2, 4, 5]"
        );
        read(&[first, &second], "").predicted_to()
    };
    assert_eq!((of("1500ms"), of("500ms")), (Some(500), None));
}

/// `[faults]` may give any node a plant, whatever the seed draws.
#[test]
fn no_field_is_set_where_nodes_may_get_a_plant() {
    let refused = |key: &str, kind: &str| {
        let event = format!("[[event]]\nat = '1s'\nkind = 'set'\n{key}\n");
        let text = format!("{RING}{TIME}[faults]\nrate = 1e-6\nkinds = ['{kind}']\n{event}{DRIVEN}");
        Scenario::parse(&text, Path::new("ring.toml"), &[]).err().map(|errors| errors.to_string())
    };
    let field = "key = 'agent.dynamics.offset'\nvalue = 2.0";
    assert!(
        refused(field, "sensor").is_some_and(|text| text.contains("[faults] of kind sensor or actuator"))
    );
    assert_eq!(refused(field, "bounce"), None);
    assert_eq!(refused("key = 'coupling.funnel.end'\nvalue = 0.1", "sensor"), None);
}

#[test]
fn on_can_and_on_serial_lines_it_is_the_same() {
    let on = |bus: &str| played(&read(&[NARROW], bus));
    for bus in ["bus = { model = 'can', bitrate = 1000000 }", "bus = { model = 'uart', bitrate = 1000000 }"] {
        let Played { adopted, verdict, seen } = on(bus);
        assert_eq!(adopted, [0, 1, 2, 3, 4].map(|node| (node, 1200)), "{bus}");
        assert!(verdict.holds(), "{verdict}");
        assert!(is_near(seen[1999][0].psi, width(10.0, 0.05, 4.0, 1999)));
    }
}

/// Each by its own count of ticks, which SYNC keeps together.
#[test]
fn nodes_with_clocks_of_their_own_adopt_it_at_their_tick_of_that_number() {
    let rest = "bus = { model = 'can', bitrate = 1000000 }\nclock = { drift_ppm = 50, offset = '200us' }\nsync = { period = '100ms' }";
    let scenario = read(&[NARROW], rest);
    let mut adopted = Played::adopted_on_can(&scenario);
    adopted.sort_unstable();
    assert_eq!(adopted, [0, 1, 2, 3, 4].map(|node| (node, 1200)));
    let verdict = played(&scenario).verdict;
    assert!(verdict.holds(), "{verdict}");
}

impl Played {
    fn adopted_on_can(scenario: &Scenario) -> Vec<(usize, u32)> {
        let mut engine = engine_on(scenario, can_bus::<funnelnet_link::Classic>(scenario).unwrap()).unwrap();
        engine.start();
        let mut adopted = Vec::new();
        for _ in 0..=scenario.time.ticks {
            engine.advance();
            adopted.extend(engine.take_events().into_iter().filter_map(|said| match said.event {
                Event::Adopted { tick } => Some((said.node, tick)),
                _ => None,
            }));
        }
        adopted
    }
}

#[test]
fn rounds_and_a_slow_start_are_kept() {
    let round = "time = { tick = '1ms', round = '4ms', duration = '2s' }";
    assert_eq!(played(&read(&[NARROW], round)).adopted, [0, 1, 2, 3, 4].map(|node| (node, 300)));
    // Of the first 8 ticks of network time each is eight ticks long: 56 more.
    let slow = "time = { tick = '1ms', slow_start = '8ms', duration = '2s' }";
    let Played { adopted, verdict, .. } = played(&read(&[NARROW], slow));
    assert_eq!(adopted, [0, 1, 2, 3, 4].map(|node| (node, 1256)));
    assert!(verdict.holds(), "{verdict}");
}

#[test]
fn check_says_that_it_follows_none_of_it_and_how_to_check_what_is_set() {
    let found = |event: &str| {
        let report = funnelnet_sim::check::check(&read(&[event], ""));
        report.findings.into_iter().find(|finding| finding.name == "events").unwrap()
    };
    let events = found(NARROW);
    assert_eq!(events.status, funnelnet_sim::check::Status::NotChecked);
    assert!(
        events.text.ends_with("set it from the start: --set 'coupling.funnel.end=0.05'"),
        "{}",
        events.text
    );
    assert!(!found(&format!("{NARROW}, node = 2")).text.contains("--set"));
}

/// A shell reads what is printed, and `--set` what the shell gives.
#[test]
fn what_check_prints_sets_all_of_a_long_value() {
    let funnel = "{ kind = 'exponential', start = 1.500000, end = 0.0500000, rate = 4.0000000 }";
    let event = format!("at = '300ms', kind = 'set', key = 'coupling.funnel', value = {funnel}");
    let report = funnelnet_sim::check::check(&read(&[&event], ""));
    let events = report.findings.into_iter().find(|finding| finding.name == "events").unwrap();
    let (_, printed) = events.text.split_once("from the start: ").unwrap();
    let said = std::process::Command::new("sh").args(["-c", &format!("printf '%s\\n' {printed}")]).output();
    let said = String::from_utf8(said.unwrap().stdout).unwrap();
    let [option, set] = said.lines().collect::<Vec<_>>()[..] else { panic!("{said}") };
    assert_eq!(option, "--set");
    let set = funnelnet_sim::scenario::Override::parse(set).unwrap();
    let path = std::path::Path::new("set.toml");
    let from_the_start = Scenario::parse(&read(&[], "").as_run, path, &[set]).unwrap();
    assert_eq!(from_the_start.nodes[0].funnel, read(&[&event], "").staged[0].as_ref().unwrap().node.funnel);
}
