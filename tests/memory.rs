//! A network of [`Session`]s in memory: what the firmware does with its link, without a board. The host's part (bus,
//! SYNC, telemetry) is that of `sim_host::emulator`, bytes and all.

use funnelnet_node::{Output, Session};
use funnelnet_protocol::config::{NodeConfig, TickSource};
use funnelnet_protocol::message::{Command, Message, Target, TickStamp};
use funnelnet_protocol::report::Telemetry;
use funnelnet_protocol::serial::{self, Deframer, HOST, MAX_FRAME, MAX_RAW};
use funnelnet_protocol::service::{Body, Identity, Reply, Request, StoreError};
use funnelnet_protocol::{Refusal, WIRE_VERSION};
use sim_host::bus::ideal::{IdealBus, IdealParams};
use sim_host::configure::{Drive, listeners, node_configs};
use sim_host::noise::Noise;
use sim_host::record::TraceHash;
use sim_host::scenario::Scenario;

/// One end of a serial line: bytes in, session, bytes out.
pub struct Board {
    session: Session,
    deframer: Deframer,
}

impl Board {
    /// A blank node.
    pub fn new() -> Self {
        let identity =
            Identity { wire_version: WIRE_VERSION, firmware: [0; 3], id: 0, uid: 0, ..Identity::default() };
        Self { session: Session::new(identity), deframer: Deframer::new() }
    }

    /// What the node says to these bytes.
    pub fn hear(&mut self, bytes: &[u8]) -> Vec<u8> {
        let mut said = Vec::new();
        for &byte in bytes {
            if let Some(frame) = self.deframer.push(byte) {
                self.session.on_frame(frame, 0);
                self.drain(&mut said);
            }
        }
        said
    }

    /// Frames that the node refused, for any reason.
    pub fn refused(&self) -> u32 {
        let counters = self.session.node().unwrap().counters();
        Refusal::ALL.iter().map(|&reason| counters.refused(reason)).sum()
    }

    fn drain(&mut self, said: &mut Vec<u8>) {
        while let Some(output) = self.session.poll(0) {
            match output {
                Output::Send(message) => said.extend_from_slice(&serial::encode(&message)),
                Output::Reply(reply) => said.extend(service(&reply, self.session.id())),
                // A board without storage.
                Output::StorageRequest => self.session.performed(Err(StoreError::Absent)),
                Output::Report(_) => {}
                Output::Safe | Output::Sample | Output::Actuate => {}
            }
        }
    }
}

impl Default for Board {
    fn default() -> Self {
        Self::new()
    }
}

/// A frame of the service plane.
pub fn service(body: &impl Body, source: u8) -> Vec<u8> {
    let (mut scratch, mut frame) = ([0; MAX_RAW], [0; MAX_FRAME]);
    let length = serial::encode_service(body, source, &mut scratch, &mut frame).unwrap();
    frame[..length].to_vec()
}

/// What a node said, frame by frame.
#[derive(Debug, PartialEq)]
pub enum Said {
    /// Real-time plane.
    Message(Message),
    /// Service plane.
    Reply(Reply),
}

/// Takes the frames out of a node's bytes.
pub fn frames(bytes: &[u8]) -> Vec<Said> {
    let mut deframer: Deframer = Deframer::new();
    let mut said = Vec::new();
    for &byte in bytes {
        match deframer.push(byte) {
            Some(Ok(serial::Frame::RealTime(message))) => said.push(Said::Message(message)),
            Some(Ok(serial::Frame::Service { kind, body, .. })) => {
                said.push(Said::Reply(Reply::decode(kind, body).unwrap()));
            }
            Some(Err(refusal)) => panic!("a node's frame is refused: {refusal:?}"),
            None => {}
        }
    }
    said
}

/// Nodes behind serial lines, and the host between them.
pub struct MemoryNet {
    boards: Vec<Board>,
    bus: IdealBus<Vec<u8>>,
    tick_ns: u64,
    tick: u32,
    /// By node, then by component.
    states: Vec<Vec<f32>>,
    noise: Noise,
    hash: TraceHash,
}

impl MemoryNet {
    /// Configures one node per node of the scenario, and starts them.
    pub fn start(scenario: &Scenario) -> Self {
        let spec = &scenario.bus;
        let params = IdealParams { loss: spec.loss, latency_ns: spec.latency_ns, jitter_ns: spec.jitter_ns };
        let configs = node_configs(
            scenario,
            Drive { tick_source: TickSource::Sync, telemetry_every: 1, is_simulated: false },
        )
        .unwrap();
        let mut net = Self {
            boards: configs.iter().map(configured).collect(),
            bus: IdealBus::new(params, scenario.seed, listeners(scenario)),
            tick_ns: scenario.time.tick_ns,
            tick: 0,
            states: configs.iter().map(|config| config.initial_state.to_vec()).collect(),
            noise: Noise::of(scenario),
            hash: TraceHash::new(),
        };
        let start = Message::Ctrl { target: Target::All, command: Command::Start, arg: 0, at_tick: 0 };
        for index in 0..net.boards.len() {
            let said = net.boards[index].hear(&serial::encode(&start));
            let announced = std::mem::take(&mut net.states[index]);
            net.states[index] = net.relay(index, 0, &frames(&said)).0;
            assert_eq!(net.states[index], announced, "the announced state of node {}", index + 1);
        }
        net
    }

    /// Runs one tick on every node and gives their telemetry, by index and then by component.
    pub fn advance(&mut self) -> Vec<Telemetry> {
        let now = (u64::from(self.tick) + 1) * self.tick_ns;
        let mut lines = vec![Vec::new(); self.boards.len()];
        while self.bus.next_arrival().is_some_and(|at| at < now) {
            self.bus.deliver(|receiver, frame| lines[receiver].extend_from_slice(frame));
        }
        let previous_tick = TickStamp::full(self.tick.wrapping_sub(1));
        let sync = serial::encode(&Message::Sync { source: None, previous_tick, phase_us: 0 });
        let mut seen = Vec::new();
        for (index, mut line) in lines.into_iter().enumerate() {
            self.hash.extend(self.states[index].iter().copied());
            line.extend_from_slice(&sync);
            let said = frames(&self.boards[index].hear(&line));
            let (state, telemetry) = self.relay(index, now, &said);
            let told: Vec<_> =
                telemetry.iter().map(|told| (told.tick, usize::from(told.component))).collect();
            let expected: Vec<_> =
                (0..self.states[index].len()).map(|component| (self.tick, component)).collect();
            assert_eq!(told, expected, "node {} at tick {}: {said:?}", index + 1, self.tick);
            // A node that has stopped says no state.
            if !state.is_empty() {
                self.states[index] = state;
            }
            seen.extend(telemetry);
        }
        self.tick += 1;
        seen
    }

    /// Passes on what a node has said, and gives its state and its telemetry, by component.
    fn relay(&mut self, index: usize, now: u64, said: &[Said]) -> (Vec<f32>, Vec<Telemetry>) {
        let (mut state, mut telemetry) = (Vec::new(), Vec::new());
        for said in said {
            match said {
                Said::Message(message) => {
                    if let Message::State { component, x, .. } = *message {
                        assert_eq!(usize::from(component.get()), state.len(), "node {}", index + 1);
                        state.push(x);
                    }
                    let message = self.noise.disturb(index, *message);
                    self.bus.send(now, index, serial::encode(&message).to_vec());
                }
                Said::Reply(Reply::Telemetry(told)) => telemetry.push(*told),
                Said::Reply(reply) => panic!("node {}: {reply:?}", index + 1),
            }
        }
        (state, telemetry)
    }

    /// The hash of all states so far.
    pub fn hash(&self) -> TraceHash {
        self.hash
    }

    /// The nodes, by index.
    pub fn boards(&self) -> &[Board] {
        &self.boards
    }
}

fn configured(config: &NodeConfig) -> Board {
    let mut board = Board::new();
    let answer = board.hear(&service(&Request::Configure(config.clone()), HOST));
    assert_eq!(frames(&answer), [Said::Reply(Reply::Configured(Ok(())))], "node {}", config.id);
    board
}
