//! A configuration that takes effect at a tick: staged, committed, adopted by nodes that run
//! (protocol/README.md, "Commit").
#![allow(clippy::unwrap_used, clippy::panic)]

use funnelnet_law::PreparedField;
use funnelnet_node::time::{Keeper, Role};
use funnelnet_node::{Configured, Event, InputRange, Model, Output, Phase, PlantSetup, Session, Task};
use funnelnet_protocol::config::{
    Breach, ConfigError, Coupling, EdgeConfig, Field, Funnel, Gain, NodeConfig, Shape, TickSource, TimeRules,
};
use funnelnet_protocol::message::{Command, JOIN, Message, NodeId, Severity, Target, TickStamp};
use funnelnet_protocol::report::{Counters, Telemetry};
use funnelnet_protocol::serial::Frame;
use funnelnet_protocol::service::{Body, Identity, Key, Reply, Request, StageError, StoreError, kind};
use funnelnet_protocol::{FaultCode, Refusal};

const MS: u64 = 1_000_000;
const KEY: Request = Request::Key(Key([9; 16]));

/// Node `id` of a path of three, with `components` components.
fn config(id: u8, components: usize) -> NodeConfig {
    let neighbours: &[u8] = match id {
        1 => &[2],
        2 => &[1, 3],
        _ => &[2],
    };
    let edges = |id| if id == 2 { 2 } else { 1 };
    let edge = |&id: &u8| EdgeConfig { id, weight: 1.0, edges: edges(id) };
    let state = |component: usize| f32::from(id) * 0.75 - component as f32 * 0.5;
    NodeConfig::builder(id, MS as u32)
        .tick_source(TickSource::Sync)
        .state((0..components).map(state))
        .state_limit(1e6)
        .field(Field {
            slope: [-0.7].into_iter().collect(),
            offset: (0..components).map(|_| f32::from(id)).collect(),
            sines: [].into_iter().collect(),
        })
        .funnel(Shape::Constant { width: 10.0 })
        .edges(neighbours.iter().map(edge))
        .extrapolate_ticks(3)
        .telemetry_every(1)
        .build()
        .unwrap()
}

fn with_width(config: &NodeConfig, width: f32) -> NodeConfig {
    let funnel = Funnel { factor: 1.0, shape: Shape::Constant { width } };
    NodeConfig { funnel, ..config.clone() }
}

/// A session with a storage that has room for what is staged.
struct Board<M: Model = Configured> {
    session: Session<M>,
    staged: Option<NodeConfig>,
    broken: bool,
    measured: f32,
    said: Vec<Output>,
}

impl Board {
    fn blank() -> Self {
        Self::of(Configured)
    }

    fn ready(config: NodeConfig) -> Self {
        let mut board = Self::blank();
        board.ask(&Request::Configure(config));
        board
    }
}

impl<M: Model> Board<M> {
    fn of(model: M) -> Self {
        let session = Session::with_model(Identity { wire_version: 1, ..Identity::default() }, model);
        let mut board = Self { session, staged: None, broken: false, measured: 1.0, said: Vec::new() };
        board.drain(0);
        board.said.clear();
        board
    }

    /// Does what the app does, and gives what was said since the last call.
    fn drain(&mut self, now: u64) -> Vec<Output> {
        while let Some(output) = self.session.poll(now) {
            match output {
                Output::StorageRequest => self.keep(),
                Output::Sample => self.session.measured(&[self.measured]),
                _ => {}
            }
            self.said.push(output);
        }
        std::mem::take(&mut self.said)
    }

    fn keep(&mut self) {
        match self.session.task().unwrap() {
            Task::Stage(config) => self.staged = Some(config.clone()).filter(|_| !self.broken),
            Task::Commit(room) => *room = self.staged.take().filter(|_| !self.broken),
            Task::Store(_) | Task::Erase | Task::Key(..) => {}
        }
        self.session.performed(if self.broken { Err(StoreError::Failed) } else { Ok(2) });
    }

    fn ask(&mut self, request: &Request) -> Vec<Reply> {
        let mut body = [0; funnelnet_protocol::serial::MAX_BODY];
        let length = request.encode(&mut body).unwrap();
        let frame = Frame::Service { kind: request.kind(), source: 0, body: &body[..length] };
        self.session.on_frame(Ok(frame), 0);
        let reply = |output| if let Output::Reply(reply) = output { Some(reply) } else { None };
        self.drain(0).into_iter().filter_map(reply).collect()
    }

    fn tell(&mut self, message: Message) -> Vec<Output> {
        self.session.on_frame(Ok(Frame::RealTime(message)), 0);
        self.drain(0)
    }

    fn identity(&mut self) -> Identity {
        let [Reply::Identity(identity)] = self.ask(&Request::Hello)[..] else { panic!() };
        identity
    }

    fn counters(&mut self) -> Counters {
        let [Reply::Report(report)] = &self.ask(&Request::Report)[..] else { panic!() };
        report.counters.clone()
    }

    fn stage(&mut self, config: &NodeConfig) {
        let answer = self.ask(&Request::Stage(config.clone()));
        assert_eq!(answer, [Reply::Staged(Ok(config.checksum()))]);
    }

    fn phase(&self) -> Phase {
        self.session.node().unwrap().phase()
    }
}

fn ctrl(command: Command, at_tick: u16) -> Message {
    Message::Ctrl { target: Target::All, command, arg: 0, at_tick }
}

fn commit(at: u32) -> Message {
    ctrl(Command::Commit, at as u16)
}

fn sync(tick: u32) -> Message {
    Message::Sync { source: None, previous_tick: TickStamp::low(tick.wrapping_sub(1), 24), phase_us: 0 }
}

fn state(source: u8, tick: u32, x: f32) -> Message {
    Message::State {
        source: NodeId::new(source).unwrap(),
        component: funnelnet_protocol::Component::FIRST,
        tick: TickStamp::full(tick),
        x,
    }
}

fn telemetry(said: &[Output]) -> Vec<Telemetry> {
    let told = |output: &Output| match output {
        Output::Reply(Reply::Telemetry(telemetry)) => Some(*telemetry),
        _ => None,
    };
    said.iter().filter_map(told).collect()
}

/// Three nodes on a path that run by SYNC.
struct Network {
    boards: Vec<Board>,
    tick: u32,
    /// Everything that was sent as a state, in order.
    states: Vec<(u8, u32, u8, u32)>,
    /// Telemetry of the second node.
    told: Vec<Telemetry>,
}

impl Network {
    fn start(now: &[NodeConfig], next: &[NodeConfig]) -> Self {
        let boards = now.iter().zip(next).map(|(now, next)| {
            let mut board = Board::ready(now.clone());
            board.stage(next);
            board
        });
        let mut network = Self { boards: boards.collect(), tick: 0, states: Vec::new(), told: Vec::new() };
        network.tell_all(ctrl(Command::Start, 0));
        network
    }

    fn tell_all(&mut self, message: Message) {
        let said: Vec<_> = self.boards.iter_mut().map(|board| board.tell(message)).collect();
        self.told.extend(telemetry(&said[1]));
        for (from, outputs) in said.iter().enumerate() {
            for output in outputs {
                self.carry(from, output);
            }
        }
    }

    fn carry(&mut self, from: usize, output: &Output) {
        let Output::Send(message) = output else { return };
        if let Message::State { source, component, tick, x } = message {
            self.states.push((source.get(), tick.value(), component.get(), x.to_bits()));
        }
        for (index, board) in self.boards.iter_mut().enumerate() {
            if index != from {
                board.tell(*message);
            }
        }
    }

    fn run(&mut self, ticks: u32) {
        for _ in 0..ticks {
            self.tell_all(sync(self.tick));
            self.tick += 1;
        }
    }
}

#[test]
fn the_same_configuration_again_changes_no_bit() {
    // Near the edge of its funnels, where what it remembers shows.
    let edge_wise =
        |config: NodeConfig| NodeConfig { coupling: Coupling::EdgeWise, ..with_width(&config, 1.0) };
    let tracker = |config: NodeConfig| NodeConfig {
        coupling: Coupling::LambdaTracker { eta: 0.01 },
        gain: Gain::Linear { slope: 2.0 },
        ..config
    };
    let max_gain = |config: NodeConfig| NodeConfig { coupling: Coupling::MaxGain, ..config };
    // Narrow from the start, so that the width that a breach adds is decaying at the commit.
    let reopen = |config: NodeConfig| NodeConfig {
        on_breach: Breach::Reopen { margin: 1.1, rate: 5.0 },
        ..with_width(&config, 0.3)
    };
    let kinds: [(usize, &dyn Fn(NodeConfig) -> NodeConfig); 5] =
        [(1, &|config| config), (2, &edge_wise), (1, &tracker), (3, &max_gain), (1, &reopen)];
    for (kind, (components, change)) in kinds.into_iter().enumerate() {
        let configs: Vec<_> = (1..=3).map(|id| change(config(id, components))).collect();
        let run = |at: Option<u32>| {
            let mut network = Network::start(&configs, &configs);
            network.run(5);
            if let Some(at) = at {
                network.tell_all(commit(at));
            }
            network.run(35);
            (network.states, network.told, network.boards[0].session.node().unwrap().counters().ticks)
        };
        // The one of 5 comes when the states of that tick have been heard, with their changes since the tick
        // before.
        for at in [5, 17] {
            let (with, without) = (run(Some(at)), run(None));
            assert_eq!(with, without, "kind {kind}, at {at}");
            assert!(with.0.len() == 3 * components * 41 && with.2 == 40, "kind {kind}, at {at}");
        }
    }
}

#[test]
fn it_switches_before_the_law_of_the_tick_that_was_named() {
    let now: Vec<_> = (1..=3).map(|id| config(id, 1)).collect();
    let double = |config: &NodeConfig| {
        let neighbours = config.neighbours.iter().map(|edge| EdgeConfig { weight: 2.0, ..*edge }).collect();
        NodeConfig { neighbours, ..with_width(config, 20.0) }
    };
    let next: Vec<_> = now.iter().map(double).collect();
    let run = |at: u32| {
        let mut network = Network::start(&now, &next);
        network.run(2);
        network.tell_all(commit(at));
        network.run(10);
        let checksums: Vec<_> = network.boards.iter_mut().map(|board| board.identity().checksum).collect();
        (network.told, checksums, network.states)
    };
    // The first that can be named, and later ones; the last one is not reached.
    for at in [2, 3, 7, 12, 13] {
        let (told, checksums, states) = run(at);
        let (plain, _, plain_states) = run(1000);
        assert_eq!(told.len(), 12);
        for (told, plain) in told.iter().zip(&plain).filter(|(told, _)| told.tick < at) {
            assert_eq!(told, plain, "commit at {at}");
        }
        for (told, plain) in told.iter().zip(&plain).filter(|(told, _)| told.tick == at) {
            // The states up to here are those of before, and the law is the new one.
            assert_eq!((told.psi, told.nu), (20.0, 2.0 * plain.nu), "commit at {at}");
        }
        assert!(told.iter().all(|told| (told.psi == 20.0) == (told.tick >= at)), "commit at {at}");
        let till = |states: &[(u8, u32, u8, u32)]| {
            states.iter().filter(|&&(_, tick, ..)| tick <= at).copied().collect::<Vec<_>>()
        };
        assert_eq!(till(&states), till(&plain_states), "commit at {at}");
        // The last tick that ran was 11, and the configuration of 12 is taken after it.
        let expected = if at <= 12 { &next } else { &now };
        let expected: Vec<_> = expected.iter().map(NodeConfig::checksum).collect();
        assert_eq!(checksums, expected, "commit at {at}");
    }
}

/// The middle of the path after the ticks 0 to 4, which has heard both its neighbours.
fn running(next: &NodeConfig) -> Board {
    let mut board = Board::ready(config(2, 1));
    board.stage(next);
    board.tell(ctrl(Command::Start, 0));
    for tick in 0..5 {
        board.tell(state(1, tick, 1.0));
        board.tell(state(3, tick, 3.0));
        board.tell(sync(tick));
    }
    board
}

#[test]
fn neighbours_that_stay_stay_known_new_ones_are_unheard_and_edges_are_announced_anew() {
    let edge = |id, weight| EdgeConfig { id, weight, edges: 1 };
    let next = NodeConfig { neighbours: [edge(4, 1.0), edge(3, 0.5)].into_iter().collect(), ..config(2, 1) };
    let mut board = running(&next);
    board.tell(commit(5));
    let x = board.session.node().unwrap().state().next().unwrap();
    let said = board.tell(sync(5));
    // Node 3 is extrapolated, without a change; node 4 does not count yet, and node 1 no more.
    assert_eq!(telemetry(&said)[0].nu, 0.5 * (3.0 - x));
    let edges = |said: &[Output]| -> Vec<_> {
        let edge = |output: &Output| match output {
            Output::Send(Message::Edge { neighbour, weight, .. }) => Some((neighbour.get(), *weight)),
            _ => None,
        };
        said.iter().filter_map(edge).collect()
    };
    assert_eq!(edges(&said), [(3, 0.5)]);
    assert_eq!(edges(&board.tell(sync(6))), [(4, 1.0)]);
    assert_eq!(edges(&board.tell(sync(7))), []);
    board.tell(state(1, 8, 1.0));
    assert_eq!(board.counters().refused(Refusal::UnknownSource), 1);
    let found = board.tell(state(4, 8, 1.0));
    assert_eq!(found, [Output::Report(Event::NeighbourFound(NodeId::new(4).unwrap()))]);
}

#[test]
fn what_cannot_change_while_it_runs_is_refused_and_changes_nothing() {
    let own = config(2, 1);
    for next in [
        NodeConfig { id: 4, ..own.clone() },
        NodeConfig { tick_ns: 2 * MS as u32, ..own.clone() },
        NodeConfig { tick_source: TickSource::Timer, ..own.clone() },
        config(2, 2),
    ] {
        let mut board = running(&next);
        assert_eq!(board.tell(commit(6)), []);
        assert_eq!(board.counters().refused(Refusal::Value), 1);
        for tick in 5..8 {
            let said = board.tell(sync(tick));
            assert_eq!(telemetry(&said)[0].psi, 10.0);
        }
        assert_eq!(board.identity().checksum, own.checksum());
        // It was not lost.
        board.tell(ctrl(Command::Stop, 0));
        board.tell(commit(0));
        let expected = Identity { id: next.id, checksum: next.checksum(), ..board.identity() };
        assert_eq!((board.identity(), board.phase()), (expected, Phase::Ready));
    }
}

#[test]
fn rules_of_time_cannot_change_while_a_node_runs_and_all_else_can() {
    let config = |width, period_us| {
        let time = TimeRules { period_us, ..TimeRules::NONE }.with_master(NodeId::new(2).unwrap());
        NodeConfig { tick_source: TickSource::Timer, time, ..with_width(&config(2, 1), width) }
    };
    for (period_us, refused) in [(100_000, 0), (50_000, 1)] {
        let mut board = Board::ready(config(10.0, 100_000));
        board.stage(&config(20.0, period_us));
        board.tell(ctrl(Command::Start, 0));
        board.drain(MS);
        board.tell(commit(2));
        assert_eq!(board.counters().refused(Refusal::Value), refused);
        let adopted = board.drain(2 * MS).contains(&Output::Report(Event::Adopted { tick: 2 }));
        assert_eq!(adopted, refused == 0);
        assert_eq!(board.session.keeper().map(Keeper::role), Some(Role::Leads));
    }
}

/// Under the rules of time of another node, which is the only master.
fn follower(width: f32, holdover_ns: u64) -> NodeConfig {
    let time = TimeRules { period_us: 100_000, ..TimeRules::NONE }.with_master(NodeId::new(3).unwrap());
    NodeConfig { tick_source: TickSource::Timer, time, holdover_ns, ..with_width(&config(2, 1), width) }
}

#[test]
fn the_keeper_goes_on_by_the_holdover_of_what_was_committed() {
    for (before, after, lost) in [(0, 50 * MS, true), (50 * MS, 0, false)] {
        let mut board = Board::ready(follower(10.0, before));
        board.stage(&follower(20.0, after));
        board.tell(ctrl(Command::Start, 0));
        board.drain(MS);
        board.tell(commit(2));
        assert!(board.drain(2 * MS).contains(&Output::Report(Event::Adopted { tick: 2 })));
        let is_lost = |output: &Output| {
            matches!(output, Output::Send(Message::Fault { code: FaultCode::HOLDOVER, .. }))
        };
        assert!(!board.drain(45 * MS).iter().any(is_lost));
        assert_eq!(board.drain(60 * MS).iter().any(is_lost), lost, "{before} {after}");
    }
}

#[test]
fn a_node_that_waits_for_its_tick_refuses_a_commit_and_comes() {
    let mut board = Board::ready(follower(10.0, 0));
    board.stage(&follower(20.0, 0));
    board.tell(ctrl(Command::Start, JOIN));
    board.tell(commit(400));
    assert_eq!(board.counters().refused(Refusal::Phase), 1);
    for k in 0..3 {
        let (previous_tick, phase_us) = (TickStamp::low(1_000 + 100 * k, 24), 0);
        let sync = Message::Sync { source: NodeId::new(3), previous_tick, phase_us };
        let at = u64::from(100 * k + 1) * MS;
        board.session.on_sync(&sync, at, at);
        board.drain(at);
    }
    assert_eq!(board.phase(), Phase::Running);
}

#[test]
fn a_tick_that_is_past_or_too_far_ahead_is_refused_and_counted() {
    // Tick 5 comes next.
    for (at, accepted) in [(4, false), (5, true), (6, true), (5 + 32_767, true), (5 + 32_768, false)] {
        let mut board = running(&with_width(&config(2, 1), 20.0));
        board.tell(commit(at));
        assert_eq!(board.counters().refused(Refusal::TickWindow), u32::from(!accepted), "at {at}");
        let psi = telemetry(&board.tell(sync(5)))[0].psi;
        assert_eq!(psi == 20.0, at == 5, "at {at}");
    }
}

#[test]
fn a_later_commit_replaces_an_earlier_one_and_nothing_staged_is_refused() {
    let mut board = running(&with_width(&config(2, 1), 20.0));
    board.tell(commit(6));
    board.tell(commit(8));
    let psi: Vec<_> = (5..10).flat_map(|tick| telemetry(&board.tell(sync(tick)))).map(|t| t.psi).collect();
    assert_eq!(psi, [10.0, 10.0, 10.0, 20.0, 20.0]);
    board.tell(commit(12));
    assert_eq!(board.counters().refused(Refusal::Phase), 1, "it was committed");
}

#[test]
fn the_tick_is_rebuilt_across_the_range_of_its_bits_and_may_be_skipped_by_sync() {
    let mut board = Board::ready(config(2, 1));
    board.stage(&with_width(&config(2, 1), 20.0));
    board.tell(ctrl(Command::Start, 0));
    // It does not know yet where the network is.
    board.tell(commit(3));
    assert_eq!(board.counters().refused(Refusal::Phase), 1);
    board.tell(sync(65_530));
    board.tell(commit(65_540));
    let mut at = |tick: u32| telemetry(&board.tell(sync(tick)))[0];
    assert_eq!(at(65_531).psi, 10.0);
    // SYNC skips 65,540.
    let told = at(65_543);
    assert_eq!((told.tick, told.psi), (65_543, 20.0));
}

#[test]
fn a_storage_that_fails_at_the_tick_leaves_the_old_configuration_and_says_so() {
    let run = |broken: bool| {
        let mut board = running(&config(2, 1));
        board.tell(commit(6));
        board.broken = broken;
        let said: Vec<_> = (5..10).flat_map(|tick| board.tell(sync(tick))).collect();
        (board, said)
    };
    let ((mut board, said), (_, well)) = (run(true), run(false));
    let fault = |output: &&Output| matches!(output, Output::Send(Message::Fault { .. }));
    let faults: Vec<_> = said.iter().filter(fault).collect();
    let expected = Message::Fault {
        source: NodeId::new(2).unwrap(),
        code: FaultCode::COMMIT,
        severity: Severity::Warning,
        arg: 0,
        tick: TickStamp::full(6),
    };
    assert_eq!(faults, [&Output::Send(expected)]);
    assert_eq!(telemetry(&said), telemetry(&well), "it runs on as it was");
    assert_eq!((board.phase(), board.identity().checksum), (Phase::Running, config(2, 1).checksum()));
    board.broken = false;
    board.tell(commit(20));
    assert_eq!(board.counters().refused(Refusal::Phase), 1, "it has to be staged again");
}

#[test]
fn a_storage_that_fails_at_a_node_that_does_not_run_leaves_it_as_it_was() {
    let mut board = Board::ready(config(2, 1));
    board.stage(&config(3, 1));
    board.broken = true;
    let said = board.tell(commit(0));
    let warned =
        |output: &Output| matches!(output, Output::Send(Message::Fault { code: FaultCode::COMMIT, .. }));
    assert!(said.iter().any(warned), "{said:?}");
    let Identity { id, checksum, .. } = board.identity();
    assert_eq!((id, checksum), (2, config(2, 1).checksum()));
    let failed = board.ask(&Request::Stage(config(3, 1)));
    assert_eq!(failed, [Reply::Staged(Err(StageError::Store(StoreError::Failed)))]);
    board.tell(commit(0));
    assert_eq!(board.counters().refused(Refusal::Phase), 1);
}

#[test]
fn a_storage_that_hands_over_another_configuration_than_was_staged_has_failed() {
    let (next, other) = (with_width(&config(2, 1), 20.0), with_width(&config(2, 1), 30.0));
    let faults = |said: &[Output]| {
        let fault =
            |output: &&Output| matches!(output, Output::Send(Message::Fault { code: FaultCode::COMMIT, .. }));
        said.iter().filter(fault).count()
    };
    let mut board = running(&next);
    board.staged = Some(other.clone());
    let mut said = board.tell(commit(5));
    said.extend(board.tell(sync(5)));
    assert_eq!((faults(&said), telemetry(&said)[0].psi), (1, 10.0));
    assert_eq!(board.identity().checksum, config(2, 1).checksum());

    let mut board = Board::ready(config(2, 1));
    board.stage(&next);
    board.staged = Some(other.clone());
    assert_eq!(faults(&board.tell(commit(0))), 1);
    assert_eq!(board.identity().checksum, config(2, 1).checksum());

    let mut board = Board::blank();
    board.stage(&next);
    board.staged = Some(other);
    board.tell(commit(0));
    assert_eq!((board.identity().id, board.identity().checksum), (0, 0));
}

/// It has no id that a FAULT could carry.
#[test]
fn a_blank_node_counts_a_storage_that_fails() {
    let mut board = Board::blank();
    board.stage(&config(3, 1));
    board.broken = true;
    board.tell(commit(0));
    assert_eq!((board.identity().id, board.counters().refused(Refusal::Phase)), (0, 1));
    board.tell(commit(0));
    assert_eq!(board.counters().refused(Refusal::Phase), 2, "it has to be staged again");
}

/// Two that are lost stop the node, one before the commit and one after it.
#[test]
fn a_neighbour_that_was_lost_before_is_so_after() {
    let careful = NodeConfig { lost_neighbours: 2, ..config(2, 1) };
    let mut board = Board::ready(careful.clone());
    board.stage(&careful);
    board.tell(ctrl(Command::Start, 0));
    board.tell(state(1, 0, 1.0));
    for tick in 0..10 {
        board.tell(state(3, tick, 3.0));
        board.tell(sync(tick));
    }
    board.tell(commit(10));
    assert_eq!((board.counters().neighbours_lost, board.phase()), (1, Phase::Running));
    for tick in 10..20 {
        board.tell(sync(tick));
    }
    assert_eq!(board.phase(), Phase::Faulted(FaultCode::NEIGHBOURS_LOST));
}

#[test]
fn a_node_that_stops_before_the_tick_keeps_what_it_had_and_can_still_be_committed() {
    let next = with_width(&config(2, 1), 20.0);
    let mut board = running(&next);
    board.tell(commit(6));
    board.tell(ctrl(Command::Stop, 0));
    assert_eq!(board.identity().checksum, config(2, 1).checksum());
    board.tell(commit(0));
    assert_eq!((board.phase(), board.identity().checksum), (Phase::Ready, next.checksum()));
    // The same where both come at once and the tick is the next one.
    let mut board = running(&next);
    board.session.on_frame(Ok(Frame::RealTime(commit(5))), 0);
    assert_eq!(board.session.poll_at(), Some(0));
    board.tell(ctrl(Command::Stop, 0));
    assert_eq!((board.phase(), board.identity().checksum), (Phase::Stopped, config(2, 1).checksum()));
}

#[test]
fn telemetry_begins_with_the_first_tick_of_the_configuration_that_asks_for_it() {
    let silent = NodeConfig { telemetry_every: 0, ..config(2, 1) };
    let mut board = Board::ready(silent);
    board.stage(&config(2, 1));
    board.tell(ctrl(Command::Start, 0));
    board.tell(sync(0));
    board.tell(commit(2));
    let said: Vec<_> = (1..4).flat_map(|tick| board.tell(sync(tick))).collect();
    assert_eq!(telemetry(&said).iter().map(|told| told.tick).collect::<Vec<_>>(), [2, 3]);
}

#[test]
fn a_blank_node_is_commissioned() {
    let mut board = Board::blank();
    board.tell(commit(0));
    assert_eq!(board.counters().refused(Refusal::Phase), 1);
    board.stage(&config(3, 1));
    assert_eq!((board.identity().id, board.identity().checksum), (0, 0), "nothing has changed");
    let to_another = Message::Ctrl {
        target: Target::Node(NodeId::new(3).unwrap()),
        command: Command::Commit,
        arg: 0,
        at_tick: 0,
    };
    assert_eq!(board.tell(to_another), [], "it has no id yet");
    board.tell(commit(0));
    assert_eq!((board.identity().id, board.identity().checksum), (3, config(3, 1).checksum()));
    assert_eq!(board.phase(), Phase::Ready);
    board.tell(ctrl(Command::Start, 0));
    assert_eq!(board.phase(), Phase::Running);
}

#[test]
fn a_running_node_neither_stages_nor_takes_a_key_and_bad_ones_are_refused_by_name() {
    let mut board = running(&config(2, 1));
    let refused = board.ask(&Request::Stage(config(2, 1)));
    assert_eq!(refused, [Reply::Staged(Err(StageError::Store(StoreError::Running)))]);
    assert_eq!(board.ask(&KEY), [Reply::Keyed(Err(StoreError::Running))]);
    board.tell(ctrl(Command::Stop, 0));
    let bad = NodeConfig { state_limit: -1.0, ..config(2, 1) };
    let refused = board.ask(&Request::Stage(bad));
    assert!(
        matches!(refused[..], [Reply::Staged(Err(StageError::Config(ConfigError::OutOfRange { .. })))]),
        "{refused:?}"
    );
    let torn = Frame::Service { kind: kind::STAGE, source: 0, body: &[1, 2, 3] };
    board.session.on_frame(Ok(torn), 0);
    let malformed = Reply::Staged(Err(StageError::Config(ConfigError::Malformed)));
    assert_eq!(board.drain(0), [Output::Reply(malformed)]);
}

#[test]
fn a_key_is_told_of_and_gone_with_what_is_erased() {
    let mut board = Board::blank();
    assert!(!board.identity().has_key);
    assert_eq!(board.ask(&KEY), [Reply::Keyed(Ok(2))]);
    assert!(board.identity().has_key);
    board.ask(&Request::Configure(config(2, 1)));
    board.ask(&Request::Store);
    assert!(board.identity().has_key);
    board.ask(&Request::Erase);
    assert!(!board.identity().has_key);
}

#[test]
fn store_erase_and_key_forget_what_was_staged() {
    for request in [Request::Store, Request::Erase, KEY] {
        let mut board = Board::ready(config(2, 1));
        board.stage(&config(3, 1));
        board.ask(&request);
        board.tell(commit(0));
        assert_eq!((board.identity().id, board.counters().refused(Refusal::Phase)), (2, 1), "{request:?}");
    }
}

/// Late ticks are made up for up to the commit, and after it.
#[test]
fn a_node_that_is_late_does_not_run_over_the_tick() {
    let timer = |width| NodeConfig { tick_source: TickSource::Timer, ..with_width(&config(2, 1), width) };
    let mut board = Board::ready(timer(10.0));
    board.stage(&timer(20.0));
    board.tell(ctrl(Command::Start, 0));
    board.drain(MS);
    board.tell(commit(3));
    // Ticks 1 to 5 are due; of those that are made up for together the last one is told.
    let told = telemetry(&board.drain(6 * MS));
    assert_eq!(told.iter().map(|t| (t.tick, t.psi)).collect::<Vec<_>>(), [(2, 10.0), (5, 20.0)]);
}

/// Nobody waits for the next tick's time: what the flash takes comes from the rest of the period.
#[test]
fn the_commit_is_asked_for_right_after_the_tick_before() {
    let timer = |width| NodeConfig { tick_source: TickSource::Timer, ..with_width(&config(2, 1), width) };
    let mut board = Board::ready(timer(10.0));
    board.stage(&timer(20.0));
    board.tell(ctrl(Command::Start, 0));
    board.drain(MS);
    board.tell(commit(2));
    assert_eq!(board.session.poll_at(), Some(2 * MS));
    let said = board.drain(2 * MS);
    let place = |wanted: fn(&Output) -> bool| said.iter().position(wanted).unwrap();
    let committed = place(|output| *output == Output::StorageRequest);
    assert!(place(|output| matches!(output, Output::Send(Message::State { .. }))) < committed, "{said:?}");
    assert!(place(|output| matches!(output, Output::Reply(Reply::Telemetry(_)))) < committed, "{said:?}");
    assert_eq!(said.last(), Some(&Output::Report(Event::Adopted { tick: 2 })));
    assert_eq!(board.session.poll_at(), Some(3 * MS));
}

/// An actuator of -1 to 1, and a model without a field.
struct Driven;

impl Model for Driven {
    type Field = PreparedField<f32>;

    fn field(&self, config: &NodeConfig, tick: f64) -> Result<Self::Field, ConfigError> {
        Configured.field(config, tick)
    }

    fn plant(&self) -> Option<PlantSetup> {
        Some(PlantSetup::new(InputRange::new(-1.0, 1.0), 0))
    }
}

#[test]
fn a_node_with_a_plant_switches_too_and_not_at_a_tick_that_waits_for_its_sample() {
    let mut board = Board::of(Driven);
    board.ask(&Request::Configure(config(2, 1)));
    board.stage(&with_width(&config(2, 1), 20.0));
    board.tell(ctrl(Command::Start, 0));
    board.tell(sync(0));
    // Tick 1 asks for its sample, and has begun.
    board.session.on_frame(Ok(Frame::RealTime(sync(1))), 0);
    assert_eq!(board.session.poll(0), Some(Output::Sample));
    board.session.on_frame(Ok(Frame::RealTime(commit(1))), 0);
    board.session.on_frame(Ok(Frame::RealTime(commit(2))), 0);
    board.session.measured(&[1.5]);
    let said = board.drain(0);
    assert_eq!(telemetry(&said)[0].psi, 10.0);
    assert_eq!(board.counters().refused(Refusal::TickWindow), 1);
    board.measured = 1.25;
    let said = board.tell(sync(2));
    assert_eq!((telemetry(&said)[0].psi, telemetry(&said)[0].tick), (20.0, 2));
    assert!(said.contains(&Output::Sample) && said.contains(&Output::Actuate), "{said:?}");
}

/// A plant cannot be measured for ticks whose time is over, and is moved on over them: to the commit, if that
/// is among them.
#[test]
fn a_late_node_with_a_plant_switches_before_it_runs_a_tick_at_or_after_the_one_that_was_named() {
    let timer = |width| NodeConfig { tick_source: TickSource::Timer, ..with_width(&config(2, 1), width) };
    // Tick 1 is due at 2 ms; at 5.5 ms the time of 1 to 3 is over.
    for (at, psi) in [(2, 20.0), (3, 20.0), (4, 20.0), (5, 10.0)] {
        let mut board = Board::of(Driven);
        board.ask(&Request::Configure(timer(10.0)));
        board.stage(&timer(20.0));
        board.tell(ctrl(Command::Start, 0));
        board.drain(MS);
        board.tell(commit(at));
        let said = board.drain(5 * MS + MS / 2);
        assert_eq!(telemetry(&said).iter().map(|t| (t.tick, t.psi)).collect::<Vec<_>>(), [(4, psi)], "{at}");
        let overruns = |output: &&Output| matches!(output, Output::Report(Event::Overrun { .. }));
        assert_eq!(said.iter().filter(overruns).count(), 1, "{at}: {said:?}");
        let adopted = Output::Report(Event::Adopted { tick: at.max(4) });
        assert!(said.contains(&adopted), "{at}: {said:?}");
        // It is in time again.
        assert_eq!(board.session.poll_at(), Some(6 * MS), "{at}");
        assert_eq!(telemetry(&board.drain(6 * MS))[0].psi, 20.0, "{at}");
        assert_eq!(board.counters().overruns, 1, "{at}");
    }
}

/// SYNC gives the sample that a tick waits for to a later one. Where that is the commit's or one after it, it
/// is measured once more.
#[test]
fn a_node_with_a_plant_that_sync_moves_over_the_commit_while_it_waits_for_its_sample_switches_first() {
    for (at, psi) in [(2, 20.0), (3, 20.0), (4, 10.0)] {
        let mut board = Board::of(Driven);
        board.ask(&Request::Configure(config(2, 1)));
        board.stage(&with_width(&config(2, 1), 20.0));
        board.tell(ctrl(Command::Start, 0));
        board.tell(sync(0));
        board.session.on_frame(Ok(Frame::RealTime(sync(1))), 0);
        assert_eq!(board.session.poll(0), Some(Output::Sample));
        board.session.on_frame(Ok(Frame::RealTime(commit(at))), 0);
        board.session.on_frame(Ok(Frame::RealTime(sync(3))), 0);
        board.session.measured(&[1.5]);
        let said = board.drain(0);
        assert_eq!(telemetry(&said).iter().map(|t| (t.tick, t.psi)).collect::<Vec<_>>(), [(3, psi)], "{at}");
        assert_eq!(said.contains(&Output::Sample), at < 4, "{at}: {said:?}");
        assert_eq!(telemetry(&board.tell(sync(4)))[0].psi, 20.0, "{at}");
    }
}

/// With a field of its own that changes little, the input of a tick is near the one before, and far from what
/// the law gives without memory.
#[test]
fn whatever_the_coupling_was_the_law_goes_on_from_the_last_input() {
    let max_gain = NodeConfig { coupling: Coupling::MaxGain, ..with_width(&config(2, 1), 3.0) };
    let node_wise = with_width(&config(2, 1), 3.0);
    for (now, next) in [(&max_gain, &node_wise), (&node_wise, &max_gain), (&node_wise, &node_wise)] {
        let mut board = Board::ready(now.clone());
        board.stage(next);
        board.tell(ctrl(Command::Start, 0));
        let mut u = Vec::new();
        for tick in 0..12 {
            board.tell(state(1, tick, 1.0));
            board.tell(state(3, tick, 4.0 + 0.1 * tick as f32));
            u.push(telemetry(&board.tell(sync(tick)))[0].u);
            if tick == 5 {
                board.tell(commit(7));
            }
        }
        // Scalar states make both laws the same one.
        let mut plain = Board::ready(now.clone());
        plain.tell(ctrl(Command::Start, 0));
        for (tick, &u) in u.iter().enumerate() {
            let tick = tick as u32;
            plain.tell(state(1, tick, 1.0));
            plain.tell(state(3, tick, 4.0 + 0.1 * tick as f32));
            let same = telemetry(&plain.tell(sync(tick)))[0].u;
            assert!((u - same).abs() < 1e-5 * same.abs(), "tick {tick}: {u}, not {same}");
        }
    }
}

#[test]
fn a_coupling_that_comes_new_goes_on_from_the_last_input_or_from_none() {
    let tracker = NodeConfig {
        coupling: Coupling::LambdaTracker { eta: 0.01 },
        gain: Gain::Linear { slope: 2.0 },
        ..config(2, 1)
    };
    let alone = NodeConfig { coupling: Coupling::None, ..config(2, 1) };
    for next in [tracker, alone.clone()] {
        let mut board = running(&next);
        board.tell(commit(5));
        let told = telemetry(&board.tell(sync(5)))[0];
        let u = told.u;
        match next.coupling {
            Coupling::None => assert_eq!(u, 0.0),
            // Its k has grown for a tick from the slope of the gain.
            _ => assert!((u / told.nu - 2.0).abs() < 0.05, "{told:?}"),
        }
    }
}

#[test]
fn a_neighbour_that_a_commit_brings_is_waited_for_from_the_commit_on() {
    let edge = |id| EdgeConfig { id, weight: 1.0, edges: 1 };
    let next = NodeConfig { neighbours: [edge(3), edge(4)].into_iter().collect(), ..config(2, 1) };
    let mut board = running(&next);
    let mut lost = Vec::new();
    board.tell(commit(100));
    for tick in 5..120 {
        board.tell(state(1, tick, 1.0));
        board.tell(state(3, tick, 3.0));
        let four = Output::Report(Event::NeighbourLost(NodeId::new(4).unwrap()));
        if board.tell(sync(tick)).contains(&four) {
            lost.push(tick);
        }
    }
    assert_eq!(lost, [100 + u32::from(next.extrapolate_ticks)]);
}
