//! A CAN bus, bit for bit, with the port of each node above it: what the firmware runs between its node and its controller.
//!
//! A node whose port has gone off the bus is told so, and stops, as the app has it. What is not here yet: drivers take no time.

use super::Medium;
use super::ideal::Traffic;
use super::watch::Watch;
use funnelnet_can_bus::{Bus, Event, Filter, Frame, Id, Mode, Noise, Order, Queue, Timing, What};
use funnelnet_link::{BusState, CanPort, Change, Classic, Heard, Request};
use funnelnet_protocol::can::CanFrame;
use funnelnet_protocol::message::NodeId;
use funnelnet_protocol::{Message, Refusal, can};
use std::collections::VecDeque;

/// Where in a bit a controller reads its level, per mille of it: what CiA recommends.
pub const SAMPLE_PER_MILLE: u32 = 875;

/// Bits of an identifier that say whose frame it is (protocol/README.md).
const NODE_BITS: u16 = 0x7F;

/// A node's port with its driver.
struct Station {
    port: CanPort<Classic>,
    queue: Queue,
}

/// Classic CAN with one controller for each node.
pub struct CanBus<N> {
    bus: Bus<N>,
    stations: Vec<Station>,
    /// Nodes whose controllers have received something or have a free buffer, in order, and when that was (ns).
    due: VecDeque<(u64, usize)>,
    /// When the ports look at their controllers next, ns: all at the same time.
    look_at: u64,
    traffic: Traffic,
    /// Nodes whose ports have gone off the bus, and how often so far, to be told.
    off: Vec<(usize, u16)>,
    watch: Option<Watch>,
}

impl<N: Noise> CanBus<N> {
    /// A bus for the nodes `ids`, of which `listeners[i]` keep the frames of node `i`, by index.
    pub fn new(timing: Timing, noise: N, ids: &[NodeId], listeners: &[Vec<usize>]) -> Self {
        let mut bus = Bus::new(timing, noise);
        bus.report_losses(false);
        let filter = |of: usize| {
            let heard = ids.iter().zip(listeners).filter(|(_, listeners)| listeners.contains(&of));
            // Frames to all carry no node.
            heard.fold(Filter::nothing().and_base(0, NODE_BITS), |filter, (id, _)| {
                filter.and_base(u16::from(id.get()), NODE_BITS)
            })
        };
        for index in 0..ids.len() {
            bus.add(Order::Priority, filter(index));
        }
        let station = |_: &NodeId| Station { port: CanPort::new(), queue: Queue::default() };
        let stations = ids.iter().map(station).collect();
        Self {
            bus,
            stations,
            due: VecDeque::new(),
            look_at: 0,
            traffic: Traffic::default(),
            off: Vec::new(),
            watch: None,
        }
    }

    /// The bus itself.
    pub fn bus(&self) -> &Bus<N> {
        &self.bus
    }

    fn advance(&mut self, to: u64) {
        let (due, traffic, watch) = (&mut self.due, &mut self.traffic, &mut self.watch);
        self.bus.advance(to, &mut |event: Event| {
            if let Some(watch) = watch {
                watch.take(event);
            }
            match event.what {
                What::Sent { .. } => {
                    traffic.sent += 1;
                    due.push_back((event.at, event.node));
                }
                What::Received { lost, .. } => {
                    traffic.lost += u64::from(lost);
                    due.push_back((event.at, event.node));
                }
                What::LostArbitration { .. } | What::Error { .. } | What::Overload | What::Mode { .. } => {}
            }
        });
    }

    fn request(&mut self, index: usize, request: Option<Request>) {
        match request {
            Some(Request::Cancel) => self.bus.cancel(index),
            Some(Request::Restart) => self.bus.restart(index),
            None => {}
        }
    }

    /// All ports look at their controllers.
    fn look(&mut self, now: u64, receive: &mut impl FnMut(usize, Result<Message, Refusal>)) {
        for index in 0..self.stations.len() {
            let state = match self.bus.mode(index) {
                Mode::Active => BusState::Active,
                Mode::Passive => BusState::Passive,
                Mode::Off => BusState::Off,
            };
            let Some(station) = self.stations.get_mut(index) else { return };
            let request = station.port.on_state(state, now);
            self.look_at = station.port.look_at();
            hear(&mut station.port, index, &mut self.off, receive);
            self.request(index, request);
            self.load(index);
        }
    }

    /// Gives the controller what waits in the port, as far as it has room.
    fn load(&mut self, index: usize) {
        let Some(station) = self.stations.get_mut(index) else { return };
        while self.bus.free_buffers(index) > 0 {
            let Some(frame) = station.port.next_frame() else { return };
            // The port's frames have 11-bit identifiers and eight bytes at most.
            if let Ok(frame) = Frame::data(Id::Base(frame.id()), frame.data()) {
                let _loaded = self.bus.send(index, frame);
            }
            station.port.on_taken();
        }
    }

    /// Takes what the controller has received, and tells what the port hears of it.
    fn unload(&mut self, index: usize, receive: &mut impl FnMut(usize, Result<Message, Refusal>)) {
        let Some(Station { port, queue }) = self.stations.get_mut(index) else { return };
        while let Some(frame) = self.bus.receive(index) {
            queue.put(frame);
        }
        hear(port, index, &mut self.off, receive);
        while let Some(frame) = queue.take() {
            if let Id::Base(id) = frame.id() {
                port.on_frame(id, frame.bytes());
            }
            hear(port, index, &mut self.off, receive);
        }
    }
}

fn hear(
    port: &mut CanPort<Classic>,
    index: usize,
    off: &mut Vec<(usize, u16)>,
    receive: &mut impl FnMut(usize, Result<Message, Refusal>),
) {
    while let Some(heard) = port.hear() {
        match heard {
            Heard::Message(message) => receive(index, message),
            Heard::Change(Change::Off { count, .. }) => off.push((index, count)),
            Heard::Change(_) => {}
        }
    }
}

impl<N: Noise> Medium for CanBus<N> {
    fn send(&mut self, now: u64, sender: usize, frame: CanFrame) {
        self.advance(now);
        let (Some(station), Ok(message)) =
            (self.stations.get_mut(sender), can::decode(frame.id(), frame.data()))
        else {
            return;
        };
        if let Some(watch) = &mut self.watch {
            watch.give(Id::Base(frame.id()), now);
        }
        let request = station.port.send(&message);
        self.request(sender, request);
        self.load(sender);
    }

    fn next_arrival(&self) -> Option<u64> {
        let next = self.bus.next_at().unwrap_or(u64::MAX).min(self.look_at);
        Some(self.due.front().map_or(next, |&(at, _)| at))
    }

    fn deliver(&mut self, mut receive: impl FnMut(usize, Result<Message, Refusal>)) {
        if self.due.is_empty() {
            let next = self.bus.next_at().unwrap_or(u64::MAX).min(self.look_at);
            self.advance(next);
            if self.bus.now() >= self.look_at {
                self.look(next, &mut receive);
            }
        }
        // One at a time: the next one may be of another time.
        let Some((_, index)) = self.due.pop_front() else { return };
        self.unload(index, &mut receive);
        self.load(index);
    }

    fn take_off(&mut self) -> Vec<(usize, u16)> {
        std::mem::take(&mut self.off)
    }

    fn traffic(&self) -> Traffic {
        self.traffic
    }

    fn watch(&mut self, zero_ns: u64, log: bool) {
        self.bus.report_losses(true);
        self.watch = Some(Watch::new(zero_ns, log));
    }

    fn watched(&mut self) -> Option<&mut Watch> {
        self.watch.as_mut()
    }

    fn queue_overflows(&self) -> u64 {
        self.stations.iter().map(|station| station.queue.lost()).sum()
    }

    fn busy_ns(&self, now: u64) -> u64 {
        self.bus.busy_before(now)
    }

    fn utilisation(&self) -> f64 {
        self.bus.busy_ns() as f64 / self.bus.now().max(1) as f64
    }
}
