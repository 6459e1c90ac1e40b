//! A whole tick of a node with four neighbours, from the bytes of their frames to the bytes of its own.

use core::hint::black_box;

use funnelnet_link::{Fd, Format};
use funnelnet_node::{Action, Node, Params};
use funnelnet_protocol::can::{self, CanFrame};
use funnelnet_protocol::can_fd::{self, FdFrame};
use funnelnet_protocol::config::{
    BreachPolicy, CouplingConfig, EdgeConfig, GainConfig, NodeConfig, TickSource, scalar,
};
use funnelnet_protocol::message::{Command, Component, Message, NodeId, Target, TickStamp};
use funnelnet_protocol::serial::{self, Deframer, Frame};
use heapless::Vec;

use crate::law::{self, field};
use crate::meter::{INPUTS, ROUNDS, Table, spread};

/// Most instructions of a whole tick.
const TICK_LIMIT: u32 = 2000;
const NEIGHBOURS: [NodeId; 4] = [node_id(2), node_id(3), node_id(4), node_id(5)];
/// Tick period, ns.
const TICK_NS: u32 = (law::TICK * 1e9) as u32;
type SerialFrame = Vec<u8, { serial::MAX_REAL_TIME_FRAME }>;

/// A node with its link, and the frames that it hears before its next tick.
struct Bench {
    node: Node,
    deframer: Deframer,
    format: Fd,
    now: u64,
    fd: [FdFrame; NEIGHBOURS.len()],
    can: [CanFrame; NEIGHBOURS.len()],
    serial: [SerialFrame; NEIGHBOURS.len()],
}

impl Bench {
    /// A started node that has heard its neighbours once; `f` is affine with so many sines.
    #[allow(clippy::expect_used)] // A fixed configuration.
    fn new(sines: usize) -> Self {
        let config = black_box(config(sines));
        let params = Params::new(&config).expect("the configuration is valid");
        let mut node = Node::new(params, &config.neighbours);
        let start = Message::Ctrl { target: Target::All, command: Command::Start, arg: 0, at_tick: 0 };
        node.on_message(&start, 0).expect("a ready node starts");
        while node.poll(0).is_some() {}
        let none = (can::encode(&start), SerialFrame::new());
        let (can, serial) = (NEIGHBOURS.map(|_| none.0), NEIGHBOURS.map(|_| none.1.clone()));
        let fd = NEIGHBOURS.map(|_| can_fd::encode(&start));
        let mut bench =
            Self { node, deframer: Deframer::new(), format: Fd::default(), now: 0, fd, can, serial };
        // The first tick reports its new neighbours, which later ones do not.
        bench.prepare_can();
        bench.tick_can();
        bench
    }

    /// The neighbours' states at the tick that comes next.
    fn states(&mut self) -> [Message; NEIGHBOURS.len()] {
        self.now += u64::from(TICK_NS);
        let tick = self.node.tick();
        NEIGHBOURS.map(|source| Message::State {
            source,
            component: Component::FIRST,
            tick: TickStamp::full(tick),
            x: f32::from(source.get()) * 0.25 + tick as f32 * 1e-4,
        })
    }

    #[inline(never)]
    fn prepare_can(&mut self) {
        self.can = self.states().map(|state| can::encode(&state));
    }

    #[inline(never)]
    fn prepare_fd(&mut self) {
        self.fd = self.states().map(|state| can_fd::encode(&state));
    }

    #[inline(never)]
    fn prepare_serial(&mut self) {
        self.serial = self.states().map(|state| serial::encode(&state));
    }

    #[inline(never)]
    fn tick_can(&mut self) {
        for frame in black_box(&self.can) {
            match can::decode(frame.id(), frame.data()) {
                Ok(message) => drop(self.node.on_message(&message, self.now)),
                Err(reason) => self.node.refuse(reason),
            }
        }
        while let Some(action) = self.node.poll(self.now) {
            if let Action::Send(message) = action {
                black_box(can::encode(&message));
            }
        }
    }

    /// As a link in this format does it.
    #[inline(never)]
    fn tick_fd(&mut self) {
        for frame in black_box(&self.fd) {
            self.format.receive(frame.id(), frame.data());
            while let Some(heard) = self.format.unpack() {
                match heard {
                    Ok(message) => drop(self.node.on_message(&message, self.now)),
                    Err(reason) => self.node.refuse(reason),
                }
            }
        }
        while let Some(action) = self.node.poll(self.now) {
            if let Action::Send(message) = action {
                black_box(self.format.pack(&message));
            }
        }
        black_box(self.format.flush());
    }

    #[inline(never)]
    fn tick_serial(&mut self) {
        for &byte in black_box(&self.serial).iter().flatten() {
            match self.deframer.push(byte) {
                Some(Ok(Frame::RealTime(message))) => drop(self.node.on_message(&message, self.now)),
                Some(Err(reason)) => self.node.refuse(reason),
                _ => {}
            }
        }
        while let Some(action) = self.node.poll(self.now) {
            if let Action::Send(message) = action {
                black_box(serial::encode(&message));
            }
        }
    }

    /// Every tick heard every neighbour, inside the funnel.
    fn check(&self) {
        let counters = self.node.counters();
        let ticks = 1 + ROUNDS * INPUTS as u32;
        let heard = 1 + ticks * NEIGHBOURS.len() as u32;
        // A state per tick, the initial one, and each edge's weight once.
        let sent = ticks + 1 + NEIGHBOURS.len() as u32;
        assert_eq!((counters.ticks, counters.sent, counters.accepted), (ticks, sent, heard));
        assert_eq!((counters.extrapolated, counters.breaches, counters.overruns), (0, 0, 0));
    }
}

#[allow(clippy::expect_used)] // Fixed numbers.
const fn node_id(id: u8) -> NodeId {
    NodeId::new(id).expect("an id is 1 to 127")
}

fn config(sines: usize) -> NodeConfig {
    NodeConfig {
        id: 1,
        tick_ns: TICK_NS,
        tick_source: TickSource::Timer,
        initial_state: scalar(1.0),
        state_limit: 1e6,
        field: field(sines),
        coupling: CouplingConfig::NodeWise,
        gain: GainConfig::Reciprocal { scale: 1.0 },
        funnel: law::FUNNEL,
        on_breach: BreachPolicy::Ride,
        neighbours: NEIGHBOURS.iter().map(|id| EdgeConfig { id: id.get(), weight: 1.0, edges: 4 }).collect(),
        extrapolate_ticks: 10,
        telemetry_every: 0,
        lost_neighbours: 0,
        holdover_ns: 0,
    }
}

/// Whole ticks over CAN and over the serial link.
pub fn ticks(table: &Table) {
    let by_can = [Bench::prepare_can, Bench::tick_can];
    let by_fd = [Bench::prepare_fd, Bench::tick_fd];
    let by_serial = [Bench::prepare_serial, Bench::tick_serial];
    let what = "4 frames decoded and heard, law, field step, 1 frame encoded";
    for (name, sines, limit, calls) in [
        ("node tick, CAN, affine and 3 sines", 3, Some(TICK_LIMIT), by_can),
        ("node tick, CAN, affine", 0, Some(TICK_LIMIT), by_can),
        ("node tick, CAN FD, affine and 3 sines", 3, None, by_fd),
        ("node tick, serial, affine and 3 sines", 3, None, by_serial),
        ("node tick, serial, affine", 0, None, by_serial),
    ] {
        table.stateful(name, limit, what, || Bench::new(sines), calls).check();
    }
}

/// Coding of one state.
pub fn frames(table: &Table) {
    let states = spread(-40.0, 40.0).map(|x| {
        let (source, component) = (NEIGHBOURS[0], Component::FIRST);
        Message::State { source, component, tick: TickStamp::full(4711), x }
    });
    table.row("CAN encode", "one STATE", &states, |state| can::encode(&state));
    let frames = states.map(|state| can::encode(&state));
    table.row("CAN decode", "one STATE", &frames, |frame| can::decode(frame.id(), frame.data()));
    table.row("serial encode", "one STATE: CRC and COBS", &states, |state| serial::encode(&state));
    let frames = states.map(|state| serial::encode(&state).into_array().unwrap_or_default());
    let mut deframer: Deframer = Deframer::new();
    let what = "one STATE, byte by byte: COBS and CRC";
    table.row("serial decode", what, &frames, |frame: [u8; serial::MAX_REAL_TIME_FRAME]| {
        frame.iter().filter_map(|&byte| deframer.push(byte).map(|frame| frame.is_ok())).last()
    });
}

/// What a commit does several times, within a tick.
pub fn checksum(table: &Table) {
    let configs = core::array::from_fn(|_| ());
    let config = config(3);
    table.row("checksum of a configuration", "4 neighbours, 3 sines: encoded, CRC-32", &configs, |()| {
        black_box(&config).checksum()
    });
}
