//! The app of a node with everything around it played here. Nothing in it knows the time by itself, so a second is over at once.
#![allow(clippy::unwrap_used, clippy::panic, reason = "helpers of tests, which clippy does not know as such")]

mod bench;

use bench::{Bus, Line, MS, Said, Time, config, start};
use embassy_futures::join::join;
use embassy_futures::poll_once;
use embedded_io_async::{ErrorType, Read, Write};
use funnelnet_app::link::can::{CanNode, Controller, Exchange, FrameOf};
use funnelnet_app::link::serial::Serial;
use funnelnet_app::link::{Health, Input, Link};
use funnelnet_app::storage::{Absent, Storage};
use funnelnet_app::watchdog::{self, Watchdog};
use funnelnet_app::{App, Log, Platform};
use funnelnet_law::PreparedField;
use funnelnet_law::field::State;
use funnelnet_link::{BusState, Change, Classic, Fd, Filter, Filters, Format};
use funnelnet_node::watchdog::FEED_EVERY_NS;
use funnelnet_node::{Configured, Event, InputRange, Model, PlantSetup, Session, Task};
use funnelnet_plant::{Failure, Plant, Virtual};
use funnelnet_protocol::NodeConfig;
use funnelnet_protocol::config::{ConfigError, TimeRules};
use funnelnet_protocol::message::{
    Command, Component, FaultCode, Message, NodeId, Severity, Target, TickStamp,
};
use funnelnet_protocol::report::{Losses, Telemetry};
use funnelnet_protocol::serial;
use funnelnet_protocol::service::{Identity, Reply, Request, StoreError};
use std::cell::{Cell, RefCell};
use std::convert::Infallible;
use std::future::pending;
use std::pin::pin;
use std::sync::atomic::{AtomicU32, Ordering};

/// What a log has been told, in short.
#[derive(Default)]
struct Words(RefCell<Vec<String>>);

impl Words {
    fn push(&self, word: impl Into<String>) {
        self.0.borrow_mut().push(word.into());
    }

    fn has(&self, word: &str) -> bool {
        self.0.borrow().iter().any(|each| each == word)
    }
}

impl Log for &Words {
    fn ready(&mut self) {
        self.push("ready");
    }

    fn restored(&mut self, id: u8) {
        self.push(format!("restored {id}"));
    }

    fn unusable(&mut self, why: ConfigError) {
        self.push(format!("unusable: {why}"));
    }

    fn event(&mut self, event: &Event) {
        self.push(event.to_string());
    }

    fn link(&mut self, change: Change, _: Health) {
        self.push(format!("{change:?}"));
    }

    fn not_measured(&mut self, why: Failure) {
        self.push(format!("not measured: {why}"));
    }

    fn not_driven(&mut self, why: Failure) {
        self.push(format!("not driven: {why}"));
    }
}

fn session<M: Model>(model: M) -> Session<M> {
    Session::with_model(Identity { wire_version: 1, uid: 7, ..Identity::default() }, model)
}

/// A virtual node, for ever.
async fn node(time: &Time, mut link: impl Link, mut storage: impl Storage, log: &Words) {
    let platform = Platform { watchdog: watchdog::Absent, clock: time, log };
    App::new(&mut session(Configured), &mut link, &mut storage, Virtual, platform).run().await
}

fn said(replies: impl IntoIterator<Item = Reply>) -> Vec<Said> {
    replies.into_iter().map(Said::Reply).collect()
}

fn stop() -> Message {
    Message::Ctrl { target: Target::All, command: Command::Stop, arg: 0, at_tick: 0 }
}

#[test]
fn a_host_gets_its_answers_in_order() {
    let (time, log) = (Time::default(), Words::default());
    let line = Line::new(&time);
    let mut node = pin!(node(&time, Serial::new(&line), Absent, &log));
    for request in [Request::Hello, Request::Configure(config(1)), Request::Store] {
        line.ask(&request);
    }
    time.run(node.as_mut(), MS);
    let identity = Identity { wire_version: 1, uid: 7, ..Identity::default() };
    let answers =
        [Reply::Identity(identity), Reply::Configured(Ok(())), Reply::Stored(Err(StoreError::Absent))];
    assert_eq!(line.heard(), said(answers));
    assert!(log.has("ready"));
}

/// States that a node says which ticks each millisecond, and is told to stop so many ns before the fifth tick.
fn states_until_stopped(before: u64) -> usize {
    let (time, log) = (Time::default(), Words::default());
    let line = Line::new(&time);
    let mut node = pin!(node(&time, Serial::new(&line), Absent, &log));
    line.ask(&Request::Configure(config(1)));
    line.tell(&start());
    time.run(node.as_mut(), 5 * MS - before);
    line.tell(&stop());
    time.run(node.as_mut(), 10 * MS);
    line.heard().iter().filter(|said| matches!(said, Said::Message(Message::State { .. }))).count()
}

#[test]
fn a_frame_that_comes_just_before_a_tick_waits_for_it() {
    // The one that is announced, and those of ticks.
    assert_eq!(states_until_stopped(200_000), 1 + 4);
    assert_eq!(states_until_stopped(10_000), 1 + 5);
}

/// A UART whose driver gives what has come in two parts, since its buffer ends between them.
struct InParts<'a>([&'a [u8]; 2]);

impl ErrorType for InParts<'_> {
    type Error = Infallible;
}

impl Read for InParts<'_> {
    async fn read(&mut self, bytes: &mut [u8]) -> Result<usize, Infallible> {
        let part = self.0.iter_mut().find(|part| !part.is_empty());
        let Some(part) = part else { return pending().await };
        Ok(std::io::Read::read(part, bytes).unwrap())
    }
}

impl Write for InParts<'_> {
    async fn write(&mut self, bytes: &[u8]) -> Result<usize, Infallible> {
        Ok(bytes.len())
    }

    async fn flush(&mut self) -> Result<(), Infallible> {
        Ok(())
    }
}

#[test]
fn frames_on_both_sides_of_the_end_of_a_drivers_buffer_come_in_one_turn() {
    let time = Time::default();
    let bytes = [start(), stop()].map(|message| serial::encode(&message).to_vec()).concat();
    for end in 0..bytes.len() {
        let (before, behind) = bytes.split_at(end);
        let mut link = Serial::new(InParts([before, behind]));
        assert!(poll_once(link.wait(&time)).is_ready());
        let mut frames = 0;
        while let Some(input) = link.next(0) {
            assert!(matches!(input, Input::Frame(Ok(_))));
            frames += 1;
        }
        assert_eq!(frames, 2, "{end} bytes in front of the end");
    }
}

#[test]
fn frames_that_a_driver_had_no_room_for_are_told_apart_from_errors_of_the_line() {
    static ERRORS: AtomicU32 = AtomicU32::new(2);
    static UNSAID: AtomicU32 = AtomicU32::new(0);
    let losses = |link: Serial<InParts<'_>>| link.health().losses;
    let line = || Serial::new(InParts([&[], &[]]));
    assert_eq!(losses(line()), Losses::default());
    UNSAID.store(3, Ordering::Relaxed);
    assert_eq!(losses(line().with_unsaid(&UNSAID)), Losses { unsaid: 3, ..Losses::default() });
    let both = line().with_errors(&ERRORS).with_unsaid(&UNSAID);
    assert_eq!(losses(both), Losses { line_errors: 2, unsaid: 3, ..Losses::default() });
}

/// Two nodes on a bus until `off` (ms), when the second one's controller goes off the bus, and 900 ms more.
fn on_a_bus<F: Format>(off: u64) -> ([Vec<Said>; 2], Vec<u16>, [Words; 2]) {
    let (time, words) = (Time::default(), [Words::default(), Words::default()]);
    let (lines, bus) = ([Line::new(&time), Line::new(&time)], Bus::<2>::new(&time));
    let link = |index: usize| CanNode::new(bus.tap::<F>(index), Serial::new(&lines[index]));
    let [first, second] = [0, 1].map(|index| node(&time, link(index), Absent, &words[index]));
    let mut nodes = pin!(join(first, second));
    for (line, id) in lines.iter().zip(1..) {
        line.ask(&Request::Configure(config(id)));
    }
    lines[0].tell(&start());
    // Each hears the other between two of its own ticks.
    time.run(nodes.as_mut(), 2 * MS / 5);
    lines[1].tell(&start());
    time.run(nodes.as_mut(), off * MS);
    for line in &lines {
        assert_eq!(line.heard(), said([Reply::Configured(Ok(()))]));
    }
    let [first, second] = lines.each_ref().map(|line| line.report(nodes.as_mut()).counters);
    assert_eq!((first.ticks, second.ticks), (off as u32, off as u32 - 1));
    assert_eq!((first.extrapolated, second.extrapolated), (0, 0), "they hear each other");
    bus.off[1].set(true);
    time.run(nodes.as_mut(), (off + 900) * MS);
    let sent = bus.sent.take();
    let words = words.each_ref().map(|words| Words(RefCell::new(words.0.take())));
    (lines.each_ref().map(Line::heard), sent, words)
}

#[test]
fn nodes_on_a_bus_tick_by_their_timers_and_stop_where_it_is_lost() {
    fn check<F: Format>() {
        let ([first, second], sent, [of_first, of_second]) = on_a_bus::<F>(50);
        let fault = |said: &Said| match said {
            Said::Message(Message::Fault { source, code, severity: Severity::Stopped, arg, .. }) => {
                (source.get(), *code, *arg)
            }
            other => panic!("{other:?}"),
        };
        assert_eq!(second.iter().map(fault).collect::<Vec<_>>(), [(2, FaultCode::BUS_OFF, 1)]);
        assert_eq!(first, []);
        assert!(of_second.has("Off { count: 1, wait_ms: 100 }") && of_second.has("Back"));
        // The fault comes on the bus when its node is back there, and nothing else of it does.
        let lost = sent.iter().rposition(|id| id & 0x7F == 2).unwrap();
        assert_eq!(sent.iter().filter(|&&id| id == sent[lost]).count(), 1);
        assert!(!of_first.has("Back"));
    }
    check::<Classic>();
    check::<Fd>();
}

#[test]
fn a_service_line_that_takes_nothing_delays_no_tick_and_answers_come_before_telemetry() {
    let (time, log) = (Time::default(), Words::default());
    let (line, bus) = (Line::new(&time), Bus::<2>::new(&time));
    let mut node = pin!(node(&time, CanNode::new(bus.tap::<Classic>(0), Serial::new(&line)), Absent, &log));
    line.ask(&Request::Configure(NodeConfig { telemetry_every: 1, ..config(1) }));
    line.tell(&start());
    time.run(node.as_mut(), 10 * MS);
    assert!(line.heard().len() > 9, "with room it is all said");
    // In the middle of a frame.
    line.has_room_for(3);
    time.run(node.as_mut(), 100 * MS);
    line.ask(&Request::Report);
    time.run(node.as_mut(), 110 * MS);
    let ticks = bus.sent.take().iter().filter(|&&id| id == 3 << 7 | 1).count();
    assert_eq!(ticks, 111, "a state at the start and after each tick");
    line.has_room_for(usize::MAX);
    time.run(node.as_mut(), 111 * MS);
    let heard = line.heard();
    let [Said::Reply(Reply::Telemetry(first)), Said::Reply(Reply::Report(report)), ..] = &heard[..] else {
        panic!("{heard:?}")
    };
    assert_eq!((first.tick, report.counters.overruns), (10, 0));
    assert_eq!(
        report.counters.link.unsaid,
        report.counters.ticks - 11,
        "all telemetry after that of tick 10"
    );
}

#[test]
fn a_state_is_on_its_way_before_received_frames_and_telemetry_have_their_turn() {
    fn first_of<F: Format>() -> Vec<u16> {
        let time = Time::default();
        let (line, bus) = (Line::new(&time), Bus::<2>::new(&time));
        let mut link = CanNode::new(bus.tap::<F>(0), Serial::new(&line));
        let state = |id: u8, tick| Message::State {
            source: NodeId::new(id).unwrap(),
            component: Component::FIRST,
            tick: TickStamp::full(tick),
            x: 0.0,
        };
        let mut other = CanNode::new(bus.tap::<F>(1), Serial::new(&line));
        for tick in 0..2 {
            assert!(poll_once(other.send(&state(2, tick), 0)).is_ready());
            assert!(other.next(0).is_none());
        }
        assert!(poll_once(link.wait(&time)).is_ready());
        assert!(poll_once(link.send(&state(1, 0), 0)).is_ready());
        assert!(matches!(link.next(0), Some(Input::Frame(Ok(_)))), "the first of two");
        assert!(poll_once(link.send(&state(1, 1), 0)).is_ready());
        let telemetry = Telemetry { tick: 0, component: 0, nu: 0.0, psi: 1.0, u: 0.0 };
        assert!(poll_once(link.reply(&Reply::Telemetry(telemetry), 1)).is_ready());
        bus.sent.take()
    }
    assert_eq!(first_of::<Classic>(), [2, 2, 1, 1].map(|id| 3 << 7 | id));
    assert_eq!(first_of::<Fd>().len(), 4);
}

/// A controller that loses what it is told to have lost, and remembers what it listens for.
struct Losing<'a, C> {
    inner: C,
    losses: &'a Cell<Losses>,
    filters: &'a RefCell<Vec<Filter>>,
}

impl<C: Controller> Controller for Losing<'_, C> {
    type Format = C::Format;

    async fn exchange(&mut self, next: Option<&FrameOf<Self>>) -> Exchange {
        self.inner.exchange(next).await
    }

    fn cancel(&mut self) {}

    fn state(&self) -> BusState {
        self.inner.state()
    }

    fn counters(&self) -> (u8, u8) {
        self.inner.counters()
    }

    fn restart(&mut self) {}

    fn losses(&self) -> Losses {
        self.losses.get()
    }

    fn listen(&mut self, filters: Filters<'_>) {
        *self.filters.borrow_mut() = filters.within(28).collect();
    }
}

/// Several may wait for a node that writes its flash.
#[test]
fn each_sync_comes_with_the_stamp_of_its_own_frame() {
    let time = Time::default();
    let (line, bus) = (Line::new(&time), Bus::<2>::new(&time));
    let mut link = CanNode::new(bus.tap::<Classic>(0), Serial::new(&line));
    let mut master = CanNode::new(bus.tap::<Classic>(1), Serial::new(&line));
    bus.begins.borrow_mut().extend([100, 300]);
    let sync =
        |tick| Message::Sync { source: NodeId::new(2), previous_tick: TickStamp::low(tick, 24), phase_us: 0 };
    for tick in 0..3 {
        assert!(poll_once(master.send(&sync(tick), 0)).is_ready());
    }
    for (tick, began) in [(0, Some(100)), (1, Some(300)), (2, None)] {
        assert!(poll_once(link.wait(&time)).is_ready());
        let (heard, at) = match link.next(900) {
            Some(Input::Sync(heard, at)) => (heard, Some(at)),
            Some(Input::Frame(Ok(serial::Frame::RealTime(heard)))) => (heard, None),
            _ => panic!("no SYNC"),
        };
        assert_eq!((heard, at), (sync(tick), began));
        assert!(link.next(900).is_none());
    }
}

#[test]
fn what_a_controller_has_lost_since_the_configuration_is_reported() {
    let (time, log) = (Time::default(), Words::default());
    let (line, bus) = (Line::new(&time), Bus::<2>::new(&time));
    let (losses, filters) = (Cell::default(), RefCell::default());
    let link = Losing { inner: bus.tap::<Classic>(0), losses: &losses, filters: &filters };
    let mut node = pin!(node(&time, CanNode::new(link, Serial::new(&line)), Absent, &log));
    losses.set(Losses { frames: 5, bus_errors: 6, ..Losses::default() });
    time.run(node.as_mut(), MS);
    assert_eq!(*filters.borrow(), [], "a blank node leaves its controller as it is: open");
    assert_eq!(line.report(node.as_mut()).counters.link, losses.get());
    line.ask(&Request::Configure(config(1)));
    time.run(node.as_mut(), 2 * MS);
    assert_eq!(line.heard(), said([Reply::Configured(Ok(()))]));
    assert_eq!(*filters.borrow(), Filters::new(1, &config(1).neighbours).within(28).collect::<Vec<_>>());
    assert_eq!(line.report(node.as_mut()).counters.link, Losses::default());
    losses.set(Losses { frames: 7, bus_errors: 6, ..Losses::default() });
    time.run(node.as_mut(), 3 * MS);
    assert_eq!(line.report(node.as_mut()).counters.link, Losses { frames: 2, ..Losses::default() });
}

/// A controller that stamps a frame so many ns away from when the app reads it.
struct Stamping<'a, C> {
    inner: C,
    time: &'a Time,
    away: i64,
}

impl<C: Controller> Controller for Stamping<'_, C> {
    type Format = C::Format;

    async fn exchange(&mut self, next: Option<&FrameOf<Self>>) -> Exchange {
        match self.inner.exchange(next).await {
            Exchange::Received(Some(frame)) => {
                let began = funnelnet_app::Clock::now(self.time).saturating_add_signed(self.away);
                Exchange::Received(Some(frame.that_began(Some(began))))
            }
            other => other,
        }
    }

    fn offer(&mut self, frame: &FrameOf<Self>) -> bool {
        self.inner.offer(frame)
    }

    fn cancel(&mut self) {}

    fn state(&self) -> BusState {
        self.inner.state()
    }

    fn counters(&self) -> (u8, u8) {
        self.inner.counters()
    }

    fn restart(&mut self) {}
}

/// Who has said the last two states, where the second node follows the first one by these stamps.
fn last_two(away: i64) -> Vec<u16> {
    let (time, words) = (Time::default(), [Words::default(), Words::default()]);
    let (lines, bus) = ([Line::new(&time), Line::new(&time)], Bus::<2>::new(&time));
    let link = |index: usize| {
        let controller = Stamping { inner: bus.tap::<Classic>(index), time: &time, away };
        CanNode::new(controller, Serial::new(&lines[index]))
    };
    let [first, second] = [0, 1].map(|index| node(&time, link(index), Absent, &words[index]));
    let mut nodes = pin!(join(first, second));
    let rules = TimeRules { period_us: 8_000, ..TimeRules::NONE }.with_master(NodeId::new(1).unwrap());
    for (line, id) in lines.iter().zip(1..) {
        line.ask(&Request::Configure(NodeConfig { time: rules, ..config(id) }));
    }
    lines[0].tell(&start());
    time.run(nodes.as_mut(), 2 * MS / 5);
    lines[1].tell(&start());
    time.run(nodes.as_mut(), 101 * MS / 2);
    assert!(words[0].has("is time master") && words[1].has("follows time master 1"), "{:?}", words[1].0);
    let sent = bus.sent.take();
    assert!(sent.iter().any(|id| id >> 7 == 1), "no SYNC on the bus: {sent:?}");
    let states: Vec<_> = sent.iter().filter(|&&id| id >> 7 == 3).map(|id| id & 0x7F).collect();
    states[states.len() - 2..].to_vec()
}

/// Its ticks come by the stamp's mistake before or after those of the master, half a ms before the end here.
#[test]
fn sync_on_a_bus_counts_as_of_the_controllers_stamp() {
    assert_eq!(last_two(-300_000), [2, 1]);
    assert_eq!(last_two(300_000), [1, 2]);
}

#[test]
fn the_same_nodes_say_the_same_in_every_run() {
    assert_eq!(on_a_bus::<Fd>(20).1, on_a_bus::<Fd>(20).1);
}

/// A storage with a configuration in it.
struct Stored(NodeConfig);

impl Storage for Stored {
    async fn load(&mut self, room: &mut Option<NodeConfig>) {
        *room = Some(self.0.clone());
    }

    async fn has_key(&mut self) -> bool {
        false
    }

    async fn perform(&mut self, _: Task<'_>) -> Result<u32, StoreError> {
        Ok(3)
    }
}

#[test]
fn a_node_is_what_its_storage_keeps() {
    let (time, log) = (Time::default(), Words::default());
    let line = Line::new(&time);
    let mut node = pin!(node(&time, Serial::new(&line), Stored(config(2)), &log));
    line.ask(&Request::Store);
    time.run(node.as_mut(), MS);
    assert!(log.has("restored 2"));
    assert_eq!(line.heard(), said([Reply::Stored(Ok(3))]));
    assert_eq!(line.report(node.as_mut()).counters.ticks, 0, "until it is started");
}

#[test]
fn a_stored_configuration_that_cannot_be_used_leaves_the_node_blank() {
    let (time, log) = (Time::default(), Words::default());
    let line = Line::new(&time);
    let broken = NodeConfig { tick_ns: 0, ..config(2) };
    let mut node = pin!(node(&time, Serial::new(&line), Stored(broken), &log));
    line.ask(&Request::Hello);
    time.run(node.as_mut(), MS);
    assert!(log.0.borrow().iter().any(|word| word.starts_with("unusable: ")), "{:?}", log.0);
    assert!(matches!(line.heard()[..], [Said::Reply(Reply::Identity(Identity { id: 0, .. }))]));
}

/// The field of the configuration, and an actuator.
struct Driven;

impl Model for Driven {
    type Field = PreparedField<f32>;

    fn field(&self, config: &NodeConfig, tick: f64) -> Result<Self::Field, ConfigError> {
        Configured.field(config, tick)
    }

    fn plant(&self) -> Option<PlantSetup> {
        Some(PlantSetup::new(InputRange::new(-1.0, 1.0), 2))
    }
}

/// A plant whose sensor is blind and whose actuator is stuck where the test says so.
#[derive(Default)]
struct Rig {
    blind: Cell<bool>,
    stuck: Cell<bool>,
    driven: Cell<u32>,
    safe: Cell<u32>,
}

impl Plant for &Rig {
    type Model = Driven;

    fn model(&self) -> Driven {
        Driven
    }

    fn measure(&mut self) -> Result<State<f32>, Failure> {
        if self.blind.get() { Err(Failure::Source { component: 0 }) } else { Ok([1.0].into_iter().collect()) }
    }

    fn actuate(&mut self, _: &[f32]) -> Result<(), Failure> {
        self.driven.set(self.driven.get() + 1);
        if self.stuck.get() { Err(Failure::Sink { component: 0 }) } else { Ok(()) }
    }

    fn safe(&mut self) -> Result<(), Failure> {
        self.safe.set(self.safe.get() + 1);
        Ok(())
    }
}

/// When a watchdog was fed, ns.
struct Fed<'a>(&'a Time, &'a RefCell<Vec<u64>>);

impl Watchdog for Fed<'_> {
    fn start(&mut self) {
        self.feed();
    }

    fn feed(&mut self) {
        use funnelnet_app::Clock;
        self.1.borrow_mut().push(self.0.now());
    }
}

/// Lets a test do what it likes with a node that has started, at 10 ms.
fn with_a_rig(test: impl FnOnce(&Rig, &dyn Fn(u64), &Line, &Words, &RefCell<Vec<u64>>)) {
    let (time, log, rig, fed) = (Time::default(), Words::default(), Rig::default(), RefCell::default());
    let line = Line::new(&time);
    let mut link = Serial::new(&line);
    let platform = Platform { watchdog: Fed(&time, &fed), clock: &time, log: &log };
    let mut session = session(Driven);
    let node = async { App::new(&mut session, &mut link, &mut Absent, &rig, platform).run().await };
    let node = RefCell::new(Box::pin(node));
    let run = |ms: u64| time.run(node.borrow_mut().as_mut(), ms * MS);
    line.ask(&Request::Configure(config(1)));
    line.tell(&start());
    run(10);
    line.heard();
    test(&rig, &run, &line, &log, &fed);
}

#[test]
fn a_plant_is_driven_at_every_tick_and_made_safe_when_the_node_stops() {
    with_a_rig(|rig, run, line, _, _| {
        assert_eq!((rig.driven.get(), rig.safe.get()), (10, 1), "safe at the start of the program");
        line.tell(&stop());
        run(20);
        assert_eq!((rig.driven.get(), rig.safe.get()), (10, 2));
    });
}

#[test]
fn a_node_that_cannot_drive_its_plant_stops_and_says_so() {
    with_a_rig(|rig, run, line, log, _| {
        rig.stuck.set(true);
        run(20);
        assert_eq!((rig.driven.get(), rig.safe.get()), (11, 2));
        assert!(log.0.borrow().iter().any(|word| word.starts_with("not driven: component 0")), "{:?}", log.0);
        let is_fault =
            |said: &Said| matches!(said, Said::Message(Message::Fault { code: FaultCode::PLANT, .. }));
        assert!(line.heard().iter().any(is_fault));
    });
}

#[test]
fn a_node_without_a_sample_goes_on_for_as_long_as_its_model_allows() {
    with_a_rig(|rig, run, _, log, _| {
        rig.blind.set(true);
        run(20);
        let blind = log.0.borrow().iter().filter(|word| word.starts_with("not measured")).count();
        assert_eq!((blind, rig.safe.get()), (3, 2), "two ticks by its prediction, and no third");
    });
}

#[test]
fn a_watchdog_is_fed_by_ticks_and_by_waiting() {
    with_a_rig(|_, run, line, _, fed| {
        assert!(fed.borrow().len() > 10);
        line.tell(&stop());
        run(11);
        fed.borrow_mut().clear();
        run(5_000);
        let fed = fed.borrow();
        assert!(fed.len() >= 9 && fed.windows(2).all(|pair| pair[1] - pair[0] <= FEED_EVERY_NS), "{fed:?}");
    });
}
