//! Serial lines, from node to node or to a hub, with the forwarder of each node at their ends: what the firmware runs between its node and its
//! UARTs.
//!
//! A byte takes ten bits: start, eight data bits, stop. A frame is taken by the receiver's driver when its last byte has come. A line takes the
//! next frame from its sender when it is free, so that of what waits only the latest goes.

use super::links::{Links, Payload, flip_bit};
use super::loss::Loser;
use super::{Medium, Traffic};
use crate::random::{self, Purpose};
use crate::scenario::{BusSpec, LinkSpec, Wiring};
use funnelnet_can_bus::{BitErrors, Hit, Noise};
use funnelnet_link::forwarder::{Forwarder, HOST_LINE, MAX_PEERS};
use funnelnet_protocol::message::Message;
use funnelnet_protocol::refusal::Refusal;
use funnelnet_protocol::serial::{self, Deframer, Frame, MAX_REAL_TIME_FRAME};
use rand_pcg::rand_core::Rng as _;
use std::collections::{BTreeMap, BTreeSet};

/// Lines of a node to neighbours at most.
pub const MOST_LINES: usize = MAX_PEERS;
/// Bits of a byte with its start and its stop.
const BITS: u64 = 10;
const NS_PER_S: u64 = 1_000_000_000;
const NS_PER_MS: u64 = 1_000_000;

type Bytes = heapless::Vec<u8, MAX_REAL_TIME_FRAME>;

/// A bit that is wrong fails the check of the frame at its receiver.
impl Payload for Bytes {
    fn flip(&mut self, choose: impl FnOnce(usize) -> usize) {
        let at = choose(8 * self.len());
        flip_bit(self, at);
    }
}

/// A frame on a line, and the index of the node that said it first.
struct Sending {
    source: usize,
    bytes: Bytes,
}

/// One end of a line.
#[derive(Clone, Copy, PartialEq, Eq)]
enum End {
    /// A node, and the number of the line there.
    Node(usize, usize),
    /// The hub, and the node that the line leads to.
    Hub(usize),
}

/// One direction of a line.
struct Line {
    from: End,
    to: End,
    sending: Option<Sending>,
    /// Time for which it has been busy at the end of what it sends, and that end, ns.
    busy_ns: u64,
    busy_until: u64,
    /// Components of a state that wait for it, by bit.
    states: u8,
    /// The next disturbed bit, counted while the line is busy.
    hit: Option<Hit>,
    errors: Box<dyn Noise>,
    deframer: Deframer<MAX_REAL_TIME_FRAME>,
    /// What the driver of the receiver holds while the node computes.
    held: Vec<u8>,
}

/// Something that happens at a time.
#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
enum What {
    /// The last byte of a frame has come on this line.
    Ends(usize),
    /// This node has computed.
    Wakes(usize),
}

/// Serial lines between nodes.
pub struct UartBus {
    spec: BusSpec,
    lines: Vec<Line>,
    /// Lines that leave each node, by index.
    leaving: Vec<Vec<usize>>,
    /// The line on which a node hears another, by sender and receiver. At a hub it is the same for all senders.
    arriving: BTreeMap<(usize, usize), usize>,
    listeners: Vec<Vec<usize>>,
    forwarders: Vec<Box<Forwarder<MOST_LINES>>>,
    /// What waits at the hub for each node, with who said it.
    at_hub: Vec<Vec<(usize, Message)>>,
    losers: Vec<Loser>,
    busy_until: Vec<u64>,
    links: Option<Links<Bytes>>,
    events: BTreeSet<(u64, What)>,
    traffic: Traffic,
    now: u64,
}

type Receive<'r> = &'r mut dyn FnMut(usize, Result<Message, Refusal>);

impl UartBus {
    /// Lines for nodes of which `listeners[i]` hear node `i`, by index: one for each edge, or one for each node to a hub. Their random streams
    /// are of `seed`.
    pub fn new(spec: &BusSpec, listeners: Vec<Vec<usize>>, seed: u64, links: &[LinkSpec]) -> Self {
        let nodes = listeners.len();
        let loser = |node| Loser::new(spec.loss, random::stream(seed, Purpose::Loss, node as u64));
        let mut bus = Self {
            spec: *spec,
            lines: Vec::new(),
            leaving: vec![Vec::new(); nodes],
            arriving: BTreeMap::new(),
            forwarders: (0..nodes).map(|_| Box::default()).collect(),
            at_hub: vec![Vec::new(); nodes],
            losers: (0..nodes).map(loser).collect(),
            busy_until: vec![0; nodes],
            links: Links::of(seed, links, &[]),
            events: BTreeSet::new(),
            traffic: Traffic::default(),
            now: 0,
            listeners,
        };
        match spec.wiring {
            Wiring::Lines => bus.wire_edges(seed),
            Wiring::Hub => bus.wire_hub(seed),
        }
        bus
    }

    fn wire_edges(&mut self, seed: u64) {
        let listeners = self.listeners.clone();
        // The lines of a node are numbered by its neighbours, from one on.
        let number = |node: usize, other: usize| {
            let list = listeners.get(node).map_or(&[][..], Vec::as_slice);
            list.iter().position(|&each| each == other).map_or(HOST_LINE, |at| at + 1)
        };
        for (from, list) in listeners.iter().enumerate() {
            for &to in list {
                let line = (End::Node(from, number(from, to)), End::Node(to, number(to, from)));
                let at = self.lay(line, seed);
                self.arriving.insert((from, to), at);
            }
        }
    }

    fn wire_hub(&mut self, seed: u64) {
        for node in 0..self.listeners.len() {
            let (here, hub) = (End::Node(node, HOST_LINE), End::Hub(node));
            self.lay((here, hub), seed);
            let down = self.lay((hub, here), seed);
            let heard = self.listeners.iter().enumerate().filter(|(_, list)| list.contains(&node));
            self.arriving.extend(heard.map(|(from, _)| ((from, node), down)));
        }
    }

    /// Lays one direction of a line; its index.
    fn lay(&mut self, (from, to): (End, End), seed: u64) -> usize {
        let at = self.lines.len();
        let mut stream = random::stream(seed, Purpose::LineBits, at as u64);
        let errors = BitErrors::on_the_bus(self.spec.bit_errors, move || stream.next_u64());
        let mut errors: Box<dyn Noise> = match errors {
            Ok(errors) => Box::new(errors),
            // The reader refuses so many.
            Err(_) => Box::new(funnelnet_can_bus::Quiet),
        };
        let hit = errors.next();
        let (deframer, held) = (Deframer::new(), Vec::new());
        self.lines.push(Line {
            from,
            to,
            sending: None,
            busy_ns: 0,
            busy_until: 0,
            states: 0,
            hit,
            errors,
            deframer,
            held,
        });
        if let End::Node(node, _) = from
            && let Some(leaving) = self.leaving.get_mut(node)
        {
            leaving.push(at);
        }
        at
    }

    /// Gives every line of a node that is free its next frame.
    fn start_all(&mut self, node: usize, now: u64) {
        for at in 0..self.leaving.get(node).map_or(0, Vec::len) {
            if let Some(&line) = self.leaving.get(node).and_then(|lines| lines.get(at)) {
                self.start(line, now);
            }
        }
    }

    /// Gives a line its next frame, if it is free and something waits.
    fn start(&mut self, index: usize, now: u64) {
        let Some(line) = self.lines.get_mut(index).filter(|line| line.sending.is_none()) else { return };
        let next = match line.from {
            End::Node(node, number) => {
                let message = self.forwarders.get_mut(node).and_then(|forwarder| forwarder.take(number));
                message.map(|message| (node, message))
            }
            End::Hub(node) => {
                self.at_hub.get_mut(node).filter(|queue| !queue.is_empty()).map(|queue| queue.remove(0))
            }
        };
        let Some((source, message)) = next else { return };
        if let Message::State { component, .. } = message {
            line.states &= !(1 << component.get());
        }
        let bytes = serial::encode(&message);
        let takes = (bytes.len() as u64 * BITS * NS_PER_S).div_ceil(self.spec.bitrate.into());
        (line.busy_ns, line.busy_until) = (line.busy_ns + takes, now + takes);
        line.sending = Some(Sending { source, bytes });
        self.traffic.sent += 1;
        self.events.insert((now + takes, What::Ends(index)));
    }

    /// A frame has come to the end of its line.
    fn end(&mut self, index: usize, now: u64, receive: Receive<'_>) {
        let Some(line) = self.lines.get_mut(index) else { return };
        let Some(Sending { source, bytes }) = line.sending.take() else { return };
        let bytes = line.disturb(&bytes);
        match line.to {
            End::Hub(_) => self.reach_hub(index, &bytes, now),
            End::Node(node, _) => self.reach_node((source, node), index, &bytes, now, receive),
        }
        self.start(index, now);
    }

    /// The hub hands on what it can read.
    fn reach_hub(&mut self, index: usize, bytes: &[u8], now: u64) {
        let Some(line) = self.lines.get_mut(index) else { return };
        let End::Node(source, _) = line.from else { return };
        let messages: Vec<Message> =
            bytes.iter().filter_map(|&byte| line.push(byte)).filter_map(Result::ok).collect();
        for message in messages {
            for to in self.listeners.get(source).cloned().unwrap_or_default() {
                self.wait_at_hub(source, to, message);
                if let Some(&down) = self.arriving.get(&(source, to)) {
                    self.start(down, now);
                }
            }
        }
    }

    /// Of what a node says of one thing only the latest waits.
    fn wait_at_hub(&mut self, source: usize, to: usize, message: Message) {
        let Some(queue) = self.at_hub.get_mut(to) else { return };
        let older = queue.iter_mut().find(|(of, waits)| *of == source && is_of_the_same(waits, &message));
        match older {
            Some(older) => {
                older.1 = message;
                self.traffic.replaced += 1;
            }
            None => queue.push((source, message)),
        }
    }

    fn reach_node(
        &mut self,
        pair: (usize, usize),
        index: usize,
        bytes: &Bytes,
        now: u64,
        receive: Receive<'_>,
    ) {
        if self.losers.get_mut(pair.1).is_some_and(Loser::loses) {
            self.traffic.lost += 1;
            return;
        }
        match &mut self.links {
            None => self.arrive(index, bytes, now, receive),
            Some(links) => {
                let mut heard = Vec::new();
                links.pass(now, pair, bytes, &mut self.traffic, |bytes| heard.push(bytes.clone()));
                heard.iter().for_each(|bytes| self.arrive(index, bytes, now, receive));
            }
        }
    }

    /// The driver of the node at the end of a line has bytes: the node takes them, or they wait as far as there is room.
    fn arrive(&mut self, index: usize, bytes: &[u8], now: u64, receive: Receive<'_>) {
        let Some(line) = self.lines.get_mut(index) else { return };
        let End::Node(node, number) = line.to else { return };
        let busy_until = self.busy_until.get(node).copied().unwrap_or(0);
        if busy_until > now {
            let room = (self.spec.receive_buffer as usize).saturating_sub(line.held.len());
            self.traffic.no_room += u64::from(bytes.len() > room);
            line.held.extend(bytes.iter().take(room));
            self.events.insert((busy_until, What::Wakes(node)));
            return;
        }
        let Some(forwarder) = self.forwarders.get_mut(node) else { return };
        for &byte in bytes {
            match line.push(byte) {
                None => {}
                Some(Ok(message)) if forwarder.hear(number, &message, now / NS_PER_MS) => {
                    receive(node, Ok(message));
                }
                // A copy.
                Some(Ok(_)) => {}
                Some(Err(reason)) => receive(node, Err(reason)),
            }
        }
        self.start_all(node, now);
    }

    /// A node that has computed takes what its drivers hold, line by line.
    fn wake(&mut self, node: usize, now: u64, receive: Receive<'_>) {
        for index in 0..self.lines.len() {
            let ends_here = |line: &&mut Line| matches!(line.to, End::Node(to, _) if to == node);
            let Some(line) = self.lines.get_mut(index).filter(ends_here) else { continue };
            let held = std::mem::take(&mut line.held);
            self.arrive(index, &held, now, receive);
        }
    }
}

impl Line {
    /// Bytes as they come: a wrong data bit makes another byte, a wrong start or stop bit makes none.
    fn disturb(&mut self, bytes: &Bytes) -> Bytes {
        let mut come = Bytes::new();
        for &byte in bytes {
            let (mut byte, mut is_framed, mut bit) = (byte, true, 0);
            while let Some(hit) = self.hit.filter(|hit| bit + hit.after < BITS) {
                bit += hit.after;
                match bit {
                    0 | 9 => is_framed = false,
                    data => byte ^= 1 << (data - 1),
                }
                bit += 1;
                self.hit = self.errors.next();
            }
            if let Some(hit) = &mut self.hit {
                hit.after -= BITS - bit;
            }
            if is_framed {
                // As many bytes as before at most.
                let _ = come.push(byte);
            }
        }
        come
    }

    /// Takes a byte; what it completes.
    fn push(&mut self, byte: u8) -> Option<Result<Message, Refusal>> {
        self.deframer.push(byte).map(|frame| match frame {
            Ok(Frame::RealTime(message)) => Ok(message),
            Ok(Frame::Service { .. }) => Err(Refusal::Kind),
            Err(reason) => Err(reason),
        })
    }
}

/// Whether one message is a newer one of what the other says.
fn is_of_the_same(older: &Message, newer: &Message) -> bool {
    match (older, newer) {
        (Message::State { component, .. }, Message::State { component: newer, .. }) => component == newer,
        (Message::Edge { neighbour, .. }, Message::Edge { neighbour: newer, .. }) => neighbour == newer,
        (Message::Fault { .. }, Message::Fault { .. }) => true,
        _ => false,
    }
}

impl Medium for UartBus {
    fn send(&mut self, now: u64, sender: usize, message: &Message) {
        self.now = now;
        if let Message::State { component, .. } = message {
            for &line in self.leaving.get(sender).into_iter().flatten() {
                let Some(line) = self.lines.get_mut(line) else { continue };
                self.traffic.replaced += u64::from(line.states >> component.get() & 1);
                line.states |= 1 << component.get();
            }
        }
        if let Some(forwarder) = self.forwarders.get_mut(sender) {
            forwarder.send(message, now / NS_PER_MS);
        }
        self.start_all(sender, now);
    }

    fn computes(&mut self, node: usize, until: u64) {
        if let Some(busy_until) = self.busy_until.get_mut(node) {
            *busy_until = until;
        }
    }

    fn next_arrival(&self) -> Option<u64> {
        let event = self.events.first().map(|&(at, _)| at);
        let late = self.links.as_ref().and_then(Links::next_at);
        event.into_iter().chain(late).min()
    }

    fn deliver(&mut self, mut receive: impl FnMut(usize, Result<Message, Refusal>)) {
        let Some(now) = self.next_arrival() else { return };
        self.now = now;
        if let Some(links) = self.links.as_mut().filter(|links| links.next_at() == Some(now)) {
            let Some((_, from, to, bytes)) = links.take_late() else { return };
            if let Some(&line) = self.arriving.get(&(from, to)) {
                self.arrive(line, &bytes, now, &mut receive);
            }
            return;
        }
        match self.events.pop_first() {
            Some((_, What::Ends(line))) => self.end(line, now, &mut receive),
            Some((_, What::Wakes(node))) => self.wake(node, now, &mut receive),
            None => {}
        }
    }

    fn traffic(&self) -> Traffic {
        self.traffic
    }

    /// That of the busiest line.
    /// Of the busiest line.
    fn busy_ns(&self, now: u64) -> u64 {
        self.lines.iter().map(|line| line.busy_ns - line.busy_until.saturating_sub(now)).max().unwrap_or(0)
    }

    fn utilisation(&self) -> f64 {
        let busiest = self.lines.iter().map(|line| line.busy_ns).max().unwrap_or(0);
        busiest as f64 / self.now.max(1) as f64
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scenario::BusModel;
    use funnelnet_protocol::message::{Component, NodeId, TickStamp};

    fn spec(keys: BusSpec) -> BusSpec {
        BusSpec { model: BusModel::Uart, bitrate: 1_000_000, ..keys }
    }

    /// Nodes 0 and 2 hear node 1, and it them.
    fn bus(keys: BusSpec) -> UartBus {
        UartBus::new(&spec(keys), vec![vec![1], vec![0, 2], vec![1]], 3, &[])
    }

    fn state(index: usize, tick: u32) -> Message {
        let source = NodeId::new(index as u8 + 1).unwrap();
        Message::State { source, component: Component::FIRST, tick: TickStamp::full(tick), x: 1.5 }
    }

    /// All that is heard, with its time.
    fn drain(bus: &mut UartBus) -> Vec<(u64, usize, Result<u32, Refusal>)> {
        let mut heard = Vec::new();
        while let Some(at) = bus.next_arrival() {
            bus.deliver(|node, message| {
                let tick = message.map(|message| match message {
                    Message::State { tick, .. } => tick.value(),
                    _ => u32::MAX,
                });
                heard.push((at, node, tick));
            });
        }
        heard
    }

    /// A state has twelve bytes of ten bits.
    #[test]
    fn a_frame_takes_the_time_of_its_bytes_on_every_line_at_once() {
        let mut bus = bus(BusSpec::default());
        bus.send(5_000, 1, &state(1, 7));
        assert_eq!(drain(&mut bus), [(125_000, 0, Ok(7)), (125_000, 2, Ok(7))]);
        let mut slow = UartBus::new(
            &BusSpec { bitrate: 115_200, ..spec(BusSpec::default()) },
            vec![vec![1], vec![0]],
            3,
            &[],
        );
        slow.send(0, 0, &state(0, 7));
        assert_eq!(drain(&mut slow), [(1_041_667, 1, Ok(7))]);
    }

    #[test]
    fn a_hub_takes_a_frame_in_and_sends_it_out_line_by_line() {
        let mut bus = bus(BusSpec { wiring: Wiring::Hub, ..BusSpec::default() });
        bus.send(0, 0, &state(0, 7));
        bus.send(0, 2, &state(2, 7));
        // Both come at 120 us, and node 1 has one line.
        assert_eq!(drain(&mut bus), [(240_000, 1, Ok(7)), (360_000, 1, Ok(7))]);
    }

    #[test]
    fn of_what_a_line_is_too_slow_for_the_latest_goes() {
        let mut bus = bus(BusSpec::default());
        (1..=3).for_each(|tick| bus.send(0, 0, &state(0, tick)));
        assert_eq!(drain(&mut bus), [(120_000, 1, Ok(1)), (240_000, 1, Ok(3))]);
        assert_eq!((bus.traffic().sent, bus.traffic().replaced), (2, 1));
    }

    /// A node that computes has room for so many bytes; what does not fit makes the frames around it unreadable.
    #[test]
    fn a_driver_without_room_loses_bytes() {
        let frames = |receive_buffer| {
            let mut bus = bus(BusSpec { receive_buffer, ..BusSpec::default() });
            bus.computes(1, 1_000_000);
            (0..3).for_each(|tick| {
                bus.send(u64::from(tick) * 200_000, 0, &state(0, tick));
                bus.deliver(|_, _| panic!("it computes"));
            });
            (drain(&mut bus), bus.traffic().no_room)
        };
        let all = [0, 1, 2].map(|tick| (1_000_000, 1, Ok(tick)));
        assert_eq!(frames(36), (all.to_vec(), 0));
        assert_eq!(frames(24), (all[..2].to_vec(), 1));
        assert_eq!(frames(30), (all[..2].to_vec(), 1));
    }

    /// One bit in a hundred: of a frame of 120 bits three in ten have none.
    #[test]
    fn disturbed_bits_make_frames_that_fail_their_check_and_no_wrong_state() {
        let mut bus = bus(BusSpec { bit_errors: 10_000_000, ..BusSpec::default() });
        let (mut good, mut refused) = (0, 0);
        for tick in 0..4_000 {
            bus.send(u64::from(tick) * 200_000, 0, &state(0, tick));
            for (_, _, heard) in drain(&mut bus) {
                match heard {
                    Ok(heard) => {
                        assert_eq!(heard, tick);
                        good += 1;
                    }
                    Err(_) => refused += 1,
                }
            }
        }
        let expected = 4_000.0 * funnelnet_law::math::pow(0.99, 120.0);
        // A frame whose final zero was lost takes the next one with it.
        assert!((0.85 * expected..1.02 * expected).contains(&f64::from(good)), "{good} {expected}");
        assert!(refused > 2_000, "{refused}");
    }
}
