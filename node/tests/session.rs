//! A session in memory: identity, configuration and its refusals, telemetry, report.
#![allow(clippy::unwrap_used, clippy::panic)]

use funnelnet_node::{Event, Output, Phase, Session, Task};
use funnelnet_protocol::config::{ConfigError, Field, HeardLimits, NodeConfig, Shape, TickSource};
use funnelnet_protocol::message::{Command, Component, Message, NodeId, Severity, Target, TickStamp};
use funnelnet_protocol::report::Kept;
use funnelnet_protocol::serial::{self, Deframer, Frame};
use funnelnet_protocol::service::{
    Body, Identity, Key, Reply, Request, ResetCause, StageError, StoreError, kind,
};
use funnelnet_protocol::{FaultCode, Refusal, WIRE_VERSION};

const IDENTITY: Identity = Identity {
    wire_version: WIRE_VERSION,
    firmware: [0, 1, 0],
    id: 0,
    uid: 42,
    reset: ResetCause::Pin,
    starts: 7,
    checksum: 0,
    has_key: false,
};

fn config() -> NodeConfig {
    NodeConfig::builder(3, 1_000_000)
        .tick_source(TickSource::Sync)
        .state([1.0])
        .state_limit(1e6)
        .field(Field::scalar(-1.0, 0.0, []))
        .funnel(Shape::Constant { width: 10.0 })
        .edge(2, 1.0)
        .extrapolate_ticks(3)
        .telemetry_every(2)
        .build()
        .unwrap()
}

/// A session whose program has just started.
fn blank() -> Session {
    let mut session = Session::new(IDENTITY);
    assert_eq!(outputs(&mut session), [Output::Safe]);
    session
}

fn ask(session: &mut Session, request: &Request) -> Vec<Output> {
    let mut body = [0; 1024];
    let length = request.encode(&mut body).unwrap();
    let frame = Frame::Service { kind: request.kind(), source: 0, body: &body[..length] };
    session.on_frame(Ok(frame), 0);
    outputs(session)
}

fn tell(session: &mut Session, message: Message) -> Vec<Output> {
    session.on_frame(Ok(Frame::RealTime(message)), 0);
    outputs(session)
}

fn outputs(session: &mut Session) -> Vec<Output> {
    core::iter::from_fn(|| session.poll(0)).collect()
}

fn start() -> Message {
    Message::Ctrl { target: Target::All, command: Command::Start, arg: 0, at_tick: 0 }
}

fn sync(previous: u32) -> Message {
    Message::Sync { source: None, previous_tick: TickStamp::low(previous, 24), phase_us: 0 }
}

#[test]
fn a_blank_node_says_who_it_is_and_counts_what_it_cannot_use() {
    let mut session = blank();
    assert_eq!(ask(&mut session, &Request::Hello), [Output::Reply(Reply::Identity(IDENTITY))]);
    assert_eq!(tell(&mut session, start()), []);
    session.on_frame(Err(Refusal::Crc), 0);
    let [Output::Reply(Reply::Report(report))] = &ask(&mut session, &Request::Report)[..] else { panic!() };
    assert_eq!((report.counters.refused(Refusal::Phase), report.counters.refused(Refusal::Crc)), (1, 1));
}

#[test]
fn a_bad_configuration_is_refused_by_name_and_leaves_the_node_as_it_was() {
    let mut session = blank();
    let mut bad = config();
    bad.funnel.factor = -1.0;
    let answer = ask(&mut session, &Request::Configure(bad));
    assert!(
        matches!(
            answer[..],
            [Output::Reply(Reply::Configured(Err(ConfigError::OutOfRange { found: -1.0, .. })))]
        ),
        "{answer:?}"
    );
    assert!(session.node().is_none());
    let torn = Frame::Service { kind: kind::CONFIGURE, source: 0, body: &[1, 2, 3] };
    session.on_frame(Ok(torn), 0);
    assert_eq!(outputs(&mut session), [Output::Reply(Reply::Configured(Err(ConfigError::Malformed)))]);
}

/// Over the bytes of a line. Its report can still be asked for.
#[test]
fn a_twin_on_its_line_stops_it_and_is_counted_and_told() {
    let mut session = blank();
    ask(&mut session, &Request::Configure(config()));
    tell(&mut session, start());
    let twin = Message::State {
        source: NodeId::new(3).unwrap(),
        component: Component::FIRST,
        tick: TickStamp::low(0, 16),
        x: 2.0,
    };
    let mut deframer: Deframer = Deframer::new();
    for &byte in &serial::encode(&twin) {
        if let Some(frame) = deframer.push(byte) {
            session.on_frame(frame, 0);
        }
    }
    let told = outputs(&mut session);
    let fault = |output: &Output| {
        matches!(
            output,
            Output::Send(Message::Fault { code: FaultCode::DUPLICATE_ID, severity: Severity::Stopped, .. })
        )
    };
    assert!(told.iter().any(fault), "{told:?}");
    assert!(told.contains(&Output::Report(Event::Fault(FaultCode::DUPLICATE_ID))), "{told:?}");
    let [Output::Reply(Reply::Report(report))] = &ask(&mut session, &Request::Report)[..] else { panic!() };
    assert_eq!(report.counters.refused(Refusal::OwnId), 1);
}

/// What it has kept away is in its report, and limits reach it by CONFIGURE.
#[test]
fn it_reports_what_limits_of_what_is_heard_have_kept_away() {
    let mut session = blank();
    let heard = HeardLimits { limit: 50.0, rate: 10.0, drop_after: 2 };
    ask(&mut session, &Request::Configure(NodeConfig { heard, ..config() }));
    tell(&mut session, start());
    for (k, x) in [(0, 1.0), (1, 5.0), (2, 60.0), (3, 1.0)] {
        let (source, tick) = (NodeId::new(2).unwrap(), TickStamp::low(k, 16));
        tell(&mut session, Message::State { source, component: Component::FIRST, tick, x });
        tell(&mut session, sync(k.wrapping_sub(1)));
    }
    let [Output::Reply(Reply::Report(report))] = &ask(&mut session, &Request::Report)[..] else { panic!() };
    assert_eq!(report.counters.kept, Kept { too_fast: 1, barred: 1, edges: 1 });
    assert_eq!(report.counters.refused(Refusal::OutOfRange), 1);
}

#[test]
fn it_runs_by_sync_with_telemetry_and_reports() {
    let mut session = blank();
    assert_eq!(ask(&mut session, &Request::Configure(config())), [Output::Reply(Reply::Configured(Ok(())))]);
    let started = tell(&mut session, start());
    assert!(started.iter().any(|o| matches!(o, Output::Send(Message::State { x: 1.0, .. }))), "{started:?}");
    let refused = ask(&mut session, &Request::Configure(config()));
    assert_eq!(refused, [Output::Reply(Reply::Configured(Err(ConfigError::Running)))]);
    let ticks: Vec<_> = (0..4).map(|k: u32| tell(&mut session, sync(k.wrapping_sub(1)))).collect();
    // Nobody has said anything to it.
    let lost = |outputs: &Vec<Output>| matches!(outputs[0], Output::Report(Event::NeighbourLost(_)));
    assert_eq!(ticks.iter().position(lost), Some(3));
    for (k, outputs) in ticks.iter().enumerate() {
        let sends = |output: &Output| matches!(output, Output::Send(Message::State { .. }));
        assert!(outputs.iter().any(sends), "{outputs:?}");
        let telemetry =
            outputs.iter().any(|o| matches!(o, Output::Reply(Reply::Telemetry(t)) if t.tick == k as u32));
        assert_eq!(telemetry, k % 2 == 0, "every second tick: {outputs:?}");
    }
    let [Output::Reply(Reply::Report(report))] = &ask(&mut session, &Request::Report)[..] else { panic!() };
    // Five states and the weight of the one edge.
    assert_eq!((report.counters.ticks, report.counters.sent), (4, 6));
}

#[test]
fn a_platform_fault_stops_the_node_says_so_once_and_leaves_it_configurable() {
    let mut session = blank();
    session.fail(FaultCode::BUS_OFF, 1);
    assert_eq!(outputs(&mut session), [], "a blank node has nothing to stop");
    ask(&mut session, &Request::Configure(config()));
    tell(&mut session, start());
    session.fail(FaultCode::BUS_OFF, 3);
    session.fail(FaultCode::BUS_OFF, 4);
    let said = outputs(&mut session);
    let faults = said.iter().filter(|o| matches!(o, Output::Send(Message::Fault { arg: 3, .. }))).count();
    let sent = said.iter().filter(|o| matches!(o, Output::Send(_))).count();
    assert_eq!((faults, sent), (1, 1), "{said:?}");
    assert_eq!(tell(&mut session, sync(u32::MAX)), [], "no tick");
    assert_eq!(ask(&mut session, &Request::Configure(config())), [Output::Reply(Reply::Configured(Ok(())))]);
}

#[test]
fn a_configured_node_asks_the_app_to_store_and_passes_the_answer_on() {
    let mut session = blank();
    let blank = ask(&mut session, &Request::Store);
    assert_eq!(blank, [Output::Reply(Reply::Stored(Err(StoreError::Blank)))]);
    ask(&mut session, &Request::Configure(config()));
    assert_eq!(ask(&mut session, &Request::Store), [Output::StorageRequest]);
    assert_eq!(session.task(), Some(Task::Store(&config())));
    assert_eq!(session.poll_at(), None, "it waits for the app");
    session.performed(Ok(7));
    assert_eq!(session.task(), None);
    assert_eq!(outputs(&mut session), [Output::Reply(Reply::Stored(Ok(7)))]);
    assert_eq!(ask(&mut session, &Request::Erase), [Output::StorageRequest]);
    assert_eq!(session.task(), Some(Task::Erase));
    session.performed(Err(StoreError::Failed));
    assert_eq!(outputs(&mut session), [Output::Reply(Reply::Erased(Err(StoreError::Failed)))]);
    assert_eq!(session.id(), 3, "until its next start it stays as it is");
}

#[test]
fn what_is_stored_is_the_last_configuration_that_was_accepted() {
    let mut session = blank();
    ask(&mut session, &Request::Configure(config()));
    let bad = NodeConfig { tick_ns: 0, ..config() };
    ask(&mut session, &Request::Configure(bad));
    assert_eq!(session.config(), Some(&config()));
    let other = NodeConfig { id: 5, ..config() };
    ask(&mut session, &Request::Configure(other.clone()));
    assert_eq!(session.config(), Some(&other));
}

#[test]
fn a_running_node_neither_stores_nor_erases() {
    let mut session = blank();
    ask(&mut session, &Request::Configure(config()));
    tell(&mut session, start());
    let answer = ask(&mut session, &Request::Store);
    assert_eq!(answer, [Output::Reply(Reply::Stored(Err(StoreError::Running)))]);
    let answer = ask(&mut session, &Request::Erase);
    assert_eq!(answer, [Output::Reply(Reply::Erased(Err(StoreError::Running)))]);
}

#[test]
fn a_restored_node_is_ready_with_its_id() {
    let mut session = blank();
    assert_eq!(session.restore(), Err(ConfigError::Malformed), "nothing was stored");
    *session.config_buffer() = Some(NodeConfig { tick_ns: 0, ..config() });
    assert!(session.restore().is_err());
    assert_eq!((session.id(), session.config()), (0, None), "blank as before");
    *session.config_buffer() = Some(config());
    session.restore().unwrap();
    let identity = Identity { id: 3, checksum: config().checksum(), ..IDENTITY };
    assert_eq!(ask(&mut session, &Request::Hello), [Output::Reply(Reply::Identity(identity))]);
    let started = tell(&mut session, start());
    assert!(started.iter().any(|o| matches!(o, Output::Send(Message::State { x: 1.0, .. }))), "{started:?}");
}

#[test]
fn why_it_was_restarted_is_said_even_if_it_is_stopped_first() {
    let mut session = Session::new(Identity { reset: ResetCause::Panic, ..IDENTITY });
    *session.config_buffer() = Some(config());
    session.restore().unwrap();
    let stop = Message::Ctrl { target: Target::All, command: Command::Stop, arg: 0, at_tick: 0 };
    let outputs = tell(&mut session, stop);
    let said =
        |output: &&Output| matches!(output, Output::Send(Message::Fault { code: FaultCode::PANIC, .. }));
    assert_eq!(outputs.iter().filter(said).count(), 1, "{outputs:?}");
    assert_eq!(outputs[0], Output::Safe);
}

#[test]
fn after_a_panic_it_says_so_once_it_has_its_id_and_does_not_run_by_itself() {
    for (reset, said) in [
        (ResetCause::Panic, Some(1)),
        (ResetCause::HardFault, Some(2)),
        (ResetCause::Watchdog, None),
        (ResetCause::PowerOn, None),
    ] {
        let mut session = Session::new(Identity { reset, ..IDENTITY });
        assert_eq!(outputs(&mut session), [Output::Safe]);
        *session.config_buffer() = Some(config());
        session.restore().unwrap();
        let restored = outputs(&mut session);
        let fault = |output: &Output| match output {
            Output::Send(Message::Fault { source, code: FaultCode::PANIC, severity, arg, .. }) => {
                Some((source.get(), *severity, *arg))
            }
            _ => None,
        };
        let faults: Vec<_> = restored.iter().filter_map(fault).collect();
        let expected: Vec<_> = said.map(|arg| (3, Severity::Warning, arg)).into_iter().collect();
        assert_eq!(faults, expected, "{reset}: {restored:?}");
        assert_eq!(session.node().unwrap().phase(), Phase::Ready);
        // Once is enough, and it can be started.
        let again = ask(&mut session, &Request::Configure(config()));
        assert_eq!(again, [Output::Reply(Reply::Configured(Ok(())))]);
        tell(&mut session, start());
        assert_eq!(session.node().unwrap().phase(), Phase::Running);
    }
}

fn say(session: &mut Session, request: &Request) {
    let mut body = [0; 1024];
    let length = request.encode(&mut body).unwrap();
    let frame = Frame::Service { kind: request.kind(), source: 0, body: &body[..length] };
    session.on_frame(Ok(frame), 0);
}

/// What the app is given of a request, with the storage doing what it is asked for.
fn kept(session: &mut Session) -> (Option<NodeConfig>, Vec<Reply>) {
    let (mut staged, mut replies) = (None, Vec::new());
    while let Some(output) = session.poll(0) {
        match output {
            Output::StorageRequest => {
                if let Some(Task::Stage(config) | Task::Store(config)) = session.task() {
                    staged = Some(config.clone());
                }
                session.performed(Ok(7));
            }
            Output::Reply(reply) => replies.push(reply),
            _ => {}
        }
    }
    (staged, replies)
}

#[test]
fn a_second_request_is_refused_while_one_is_pending_and_changes_nothing_of_it() {
    let other = NodeConfig { tick_ns: 2_000_000, ..config() };
    let bad = NodeConfig { tick_ns: 1, ..config() };
    let seconds = [
        (Request::Stage(other.clone()), Reply::Staged(Err(StageError::Store(StoreError::Busy)))),
        (Request::Stage(bad), Reply::Staged(Err(StageError::Store(StoreError::Busy)))),
        (Request::Configure(other), Reply::Configured(Err(ConfigError::Busy))),
        (Request::Store, Reply::Stored(Err(StoreError::Busy))),
        (Request::Erase, Reply::Erased(Err(StoreError::Busy))),
        (Request::Key(Key([1; 16])), Reply::Keyed(Err(StoreError::Busy))),
    ];
    for (second, refused) in seconds {
        let mut session = blank();
        ask(&mut session, &Request::Configure(config()));
        say(&mut session, &Request::Stage(config()));
        say(&mut session, &second);
        say(&mut session, &second);
        let (staged, replies) = kept(&mut session);
        assert_eq!(staged, Some(config()), "{second:?}");
        assert_eq!(replies, [Reply::Staged(Ok(config().checksum())), refused], "in order, and once");
        let [Output::Reply(Reply::Report(report))] = &ask(&mut session, &Request::Report)[..] else {
            panic!()
        };
        assert_eq!(report.counters.refused(Refusal::Phase), 2, "each is counted");
        assert_eq!(session.config(), Some(&config()));
    }
}

#[test]
fn who_asks_while_something_is_kept_is_answered_and_no_answer_is_lost() {
    let mut session = blank();
    ask(&mut session, &Request::Configure(config()));
    say(&mut session, &Request::Stage(config()));
    say(&mut session, &Request::Hello);
    // The place of the answer is taken now.
    say(&mut session, &Request::Report);
    let (_, replies) = kept(&mut session);
    assert!(matches!(replies[..], [Reply::Identity(_), Reply::Staged(Ok(_))]), "{replies:?}");
}
