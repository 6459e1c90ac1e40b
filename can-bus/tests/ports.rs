//! The node's own CAN port above this bus: what a simulator does, with the port that the firmware runs.
#![allow(clippy::unwrap_used, clippy::panic, reason = "helpers of tests, which clippy does not know as such")]

mod support;

use funnelnet_can_bus::{
    BitErrors, BitRate, Bus, Event, Filter, Frame, Hit, Id, Mode, Noise, Order, Queue, Quiet, SeenBy, Timing,
    What,
};
use funnelnet_link::{BusState, CanPort, Change, Classic, Fd, Format, Frame as _, Heard, Request};
use funnelnet_protocol::message::{Component, Message, NodeId, TickStamp};
use support::Random;

const MS: u64 = 1_000_000;

/// How frames of a format are on the bus.
trait OnBus: Format {
    fn on_bus(id: Id, data: &[u8]) -> Frame;
}

impl OnBus for Classic {
    fn on_bus(id: Id, data: &[u8]) -> Frame {
        Frame::data(id, data).unwrap()
    }
}

impl OnBus for Fd {
    fn on_bus(id: Id, data: &[u8]) -> Frame {
        Frame::fd(id, data, true).unwrap()
    }
}

/// A node's port with its driver, on a controller of the bus.
struct Station<F: Format> {
    port: CanPort<F>,
    queue: Queue,
    controller: usize,
    heard: Vec<(u64, Message)>,
    changes: Vec<(u64, Change)>,
}

impl<F: OnBus> Station<F> {
    fn on<N: Noise>(bus: &mut Bus<N>, filter: Filter) -> Self {
        let controller = bus.add(Order::Priority, filter);
        Self {
            port: CanPort::new(),
            queue: Queue::default(),
            controller,
            heard: Vec::new(),
            changes: Vec::new(),
        }
    }

    fn request<N: Noise>(&self, bus: &mut Bus<N>, request: Option<Request>) {
        match request {
            Some(Request::Cancel) => bus.cancel(self.controller),
            Some(Request::Restart) => bus.restart(self.controller),
            None => {}
        }
    }

    fn say<N: Noise>(&mut self, bus: &mut Bus<N>, message: &Message) {
        let request = self.port.send(message);
        self.request(bus, request);
    }

    /// What a driver does now: frames to the controller and from it, and a look at its state when one is due.
    fn serve<N: Noise>(&mut self, bus: &mut Bus<N>) {
        let now = bus.now();
        if now >= self.port.look_at() {
            let state = match bus.mode(self.controller) {
                Mode::Active => BusState::Active,
                Mode::Passive => BusState::Passive,
                Mode::Off => BusState::Off,
            };
            let request = self.port.on_state(state, now);
            self.request(bus, request);
        }
        while let Some(frame) = bus.receive(self.controller) {
            self.queue.put(frame);
        }
        self.hear(now);
        while let Some(frame) = self.port.next_frame().filter(|_| bus.free_buffers(self.controller) > 0) {
            assert!(bus.send(self.controller, F::on_bus(Id::Base(frame.id()), frame.data())));
            self.port.on_taken();
        }
    }

    fn hear(&mut self, now: u64) {
        self.listen(now);
        while let Some(frame) = self.queue.take() {
            let Id::Base(id) = frame.id() else { continue };
            self.port.on_frame(id, frame.bytes());
            self.listen(now);
        }
    }

    fn listen(&mut self, now: u64) {
        while let Some(heard) = self.port.hear() {
            match heard {
                Heard::Message(message) => self.heard.push((now, message.unwrap())),
                Heard::Change(change) => self.changes.push((now, change)),
            }
        }
    }
}

fn state(of: usize, component: u8, tick: u32) -> Message {
    let (source, component) = (NodeId::new(of as u8 + 1).unwrap(), Component::new(component).unwrap());
    Message::State { source, component, tick: TickStamp::full(tick), x: of as f32 + tick as f32 / 16.0 }
}

/// Source and value of a state.
fn value(message: &Message) -> (u8, f32) {
    match message {
        Message::State { source, x, .. } => (source.get(), *x),
        other => panic!("{other:?}"),
    }
}

struct Network<F: Format, N> {
    bus: Bus<N>,
    stations: Vec<Station<F>>,
    events: Vec<Event>,
}

impl<F: OnBus, N: Noise> Network<F, N> {
    fn new(nodes: usize, timing: Timing, noise: N) -> Self {
        let mut bus = Bus::new(timing, noise);
        let stations = (0..nodes).map(|_| Station::on(&mut bus, Filter::everything())).collect();
        Self { bus, stations, events: Vec::new() }
    }

    /// Lets time pass; drivers are served whenever something has happened on the bus, and every millisecond.
    fn run(&mut self, until: u64) {
        while self.bus.now() < until {
            let millisecond = (self.bus.now() / MS + 1) * MS;
            let next = self.bus.next_at().unwrap_or(u64::MAX).min(millisecond).min(until);
            let events = &mut self.events;
            let before = events.len();
            self.bus.advance(next, &mut |event| events.push(event));
            if events.len() > before || next == millisecond {
                self.stations.iter_mut().for_each(|station| station.serve(&mut self.bus));
            }
        }
    }

    /// All nodes say their states, every millisecond.
    fn ticks(&mut self, from: u32, to: u32, components: u8) {
        for tick in from..to {
            self.run(u64::from(tick) * MS);
            for (node, station) in self.stations.iter_mut().enumerate() {
                for component in 0..components {
                    station.say(&mut self.bus, &state(node, component, tick));
                }
                let request = station.port.flush();
                station.request(&mut self.bus, request);
                station.serve(&mut self.bus);
            }
        }
    }

    fn errors(&self) -> usize {
        self.events.iter().filter(|event| matches!(event.what, What::Error { sender: true, .. })).count()
    }
}

fn classic(rate: u32) -> Timing {
    Timing::classic(BitRate::new(rate, 875).unwrap())
}

/// Values of `of` as node `at` heard them, without repetitions: a frame that is disturbed in its last bit
/// comes twice.
fn values<F: Format>(at: &Station<F>, of: usize) -> Vec<f32> {
    let values = at.heard.iter().map(|(_, message)| value(message));
    let mut values: Vec<f32> =
        values.filter(|(source, _)| usize::from(*source) == of + 1).map(|(_, x)| x).collect();
    values.dedup();
    values
}

fn said(of: usize, from: u32, to: u32) -> Vec<f32> {
    (from..to).map(|tick| of as f32 + tick as f32 / 16.0).collect()
}

fn every_node_hears_every_tick<F: OnBus>(timing: Timing, noise: impl Noise) -> usize {
    let mut network = Network::<F, _>::new(5, timing, noise);
    network.ticks(1, 200, 1);
    network.run(210 * MS);
    for at in 0..5 {
        for of in (0..5).filter(|&of| of != at) {
            assert_eq!(values(&network.stations[at], of), said(of, 1, 200), "{of} at {at}");
        }
        assert_eq!(values(&network.stations[at], at), []);
    }
    network.errors()
}

#[test]
fn five_ports_hear_each_other_in_every_tick() {
    let fd = |rate, sample| BitRate::new(rate, sample).unwrap();
    assert_eq!(every_node_hears_every_tick::<Classic>(classic(1_000_000), Quiet), 0);
    let timing = Timing::fd(fd(1_000_000, 800), fd(5_000_000, 750)).unwrap();
    assert_eq!(every_node_hears_every_tick::<Fd>(timing, Quiet), 0);
}

/// Disturbed bits are sent again: nothing is lost, and it takes less than a tick here.
#[test]
fn bit_errors_lose_nothing() {
    let mut random = Random(3);
    let noise = BitErrors::on_the_bus(100_000, move || random.next()).unwrap();
    let errors = every_node_hears_every_tick::<Classic>(classic(1_000_000), noise);
    // 995 frames of some 115 bits: 11 errors are expected.
    assert!((3..30).contains(&errors), "{errors}");
}

/// A bus that cannot carry what is said: of each identifier the latest state goes, older ones are cancelled,
/// and nobody hears an older one after a newer one.
#[test]
fn on_a_bus_that_is_too_slow_the_latest_states_go() {
    let mut network = Network::<Classic, _>::new(5, classic(125_000), Quiet);
    network.ticks(1, 300, 1);
    network.run(310 * MS);
    let heard: Vec<Vec<f32>> = (0..5).map(|of| values(&network.stations[(of + 1) % 5], of)).collect();
    assert!(heard.iter().all(|values| values.is_sorted()));
    // Five frames of 0.76 ms in each millisecond: the most urgent one goes in each, the next one in every
    // third, and the others once there is silence; each of their controllers holds three.
    assert_eq!(heard[0], said(0, 1, 300));
    assert!((95..110).contains(&heard[1].len()), "{}", heard[1].len());
    assert!(heard[2..].iter().all(|values| values.len() <= 4), "{heard:?}");
    // The last words of all are the latest.
    assert!((1..5).all(|of| values(&network.stations[0], of).last() == said(of, 299, 300).first()));
}

/// Every bit that node 0 sends is disturbed for itself: it goes off the bus, the port waits, restarts it, and
/// is back.
#[test]
fn a_port_goes_off_the_bus_and_comes_back() {
    // Each is in a frame of node 0 or of another; a flipped bit at node 0 as a receiver counts for its other
    // counter.
    let mut left = 40;
    let noise = move || {
        left -= 1;
        (left > 0).then_some(Hit { after: 40, seen_by: SeenBy::One(0) })
    };
    let mut network = Network::<Classic, _>::new(2, classic(500_000), noise);
    network.run(MS);
    let message = state(0, 0, 1);
    network.stations[0].say(&mut network.bus, &message);
    network.stations[0].serve(&mut network.bus);
    network.run(400 * MS);
    let changes: Vec<Change> = network.stations[0].changes.iter().map(|(_, change)| *change).collect();
    assert_eq!(changes.last(), Some(&Change::Back), "{changes:?}");
    assert!(changes.contains(&Change::Off { count: 1, wait_ms: 100 }), "{changes:?}");
    // What it had to say then is old: it is not sent after the recovery.
    assert_eq!(values(&network.stations[1], 0), []);
    network.ticks(401, 410, 1);
    network.run(420 * MS);
    assert_eq!(values(&network.stations[1], 0).last(), said(0, 409, 410).first());
}

/// Two nodes with one identifier: frames at the same time collide, and both controllers count.
#[test]
fn a_duplicate_identity_disturbs_the_bus() {
    let mut network = Network::<Classic, _>::new(3, classic(500_000), Quiet);
    for tick in 1..50 {
        network.run(u64::from(tick) * MS);
        for station in &mut network.stations[..2] {
            let x = station.controller as f32 + 1.0;
            let Message::State { source, component, tick, .. } = state(7, 0, tick) else { panic!() };
            station.say(&mut network.bus, &Message::State { source, component, tick, x });
            station.serve(&mut network.bus);
        }
    }
    assert!(network.errors() > 16, "{}", network.errors());
    assert!(network.events.iter().any(|event| matches!(event.what, What::Mode { mode: Mode::Passive, .. })));
}

/// A node that is served too seldom loses what has no room in the FIFO of its controller, and counts it.
#[test]
fn a_fifo_that_nobody_serves_overflows_and_a_filter_saves_it() {
    let overflows = |filter: Filter| {
        let mut bus = Bus::new(classic(1_000_000), Quiet);
        let mut stations: Vec<Station<Classic>> =
            (0..6).map(|_| Station::on(&mut bus, Filter::everything())).collect();
        let slow = bus.add(Order::Priority, filter);
        for (node, station) in stations.iter_mut().enumerate() {
            station.say(&mut bus, &state(node, 0, 1));
            station.serve(&mut bus);
        }
        bus.advance(2 * MS, &mut |_| ());
        (std::iter::from_fn(|| bus.receive(slow)).count(), bus.overflows(slow))
    };
    assert_eq!(overflows(Filter::everything()), (3, 3));
    // Two neighbours: function 3 and the numbers of the nodes.
    assert_eq!(overflows(Filter::nothing().and(Id::Base(3 << 7 | 2)).and(Id::Base(3 << 7 | 5))), (2, 0));
}
