//! A CAN bus, classic or FD, bit for bit, with the port of each node above it: what the firmware runs between its node and its controller.
//!
//! A node whose port has gone off the bus is told so, and stops, as the app has it. A driver takes no time; its queue waits while the node
//! computes.

use super::links::{self, Links, Payload};
use super::loss::Loser;
use super::watch::Watch;
use super::{Medium, Stamp, Traffic};
use crate::random::{self, Purpose};
use crate::scenario::{LinkSpec, Loss};
use funnelnet_can_bus::{
    Bus, Event, Filter, Frame, Hit, Id, Mode, Noise, Order, Queue, SeenBy, Strike, Timing, What,
};
use funnelnet_link::{BusState, CanPort, Change, Classic, Fd, Format, Heard, Request};
use funnelnet_protocol::message::{Component, NodeId};
use funnelnet_protocol::{Message, Refusal, can, can_fd};
use rand_pcg::Pcg64;
use rand_pcg::rand_core::Rng as _;
use std::collections::{BTreeSet, VecDeque};

/// Bits of an identifier that say whose frame it is (protocol/README.md).
const NODE_BITS: u16 = 0x7F;
/// The identifier of a SYNC, without that of its master.
const SYNC: u16 = (can::function::SYNC as u16) << 7;
/// Identifiers of nodes.
const IDS: usize = NODE_BITS as usize + 1;

/// A format with its frames as they are on the wire.
pub trait OnWire: Format {
    /// A frame of a node, which has an 11-bit identifier and a length that the format has.
    fn on_wire(frame: &Self::Frame) -> Option<Frame>;

    /// The identifier of the frame that begins with a message; none where it is one of the others of a frame.
    fn id_of(message: &Message) -> Option<Id>;
}

impl OnWire for Classic {
    fn on_wire(frame: &Self::Frame) -> Option<Frame> {
        Frame::data(Id::Base(frame.id()), frame.data()).ok()
    }

    fn id_of(message: &Message) -> Option<Id> {
        Some(Id::Base(can::encode(message).id()))
    }
}

/// All frames switch to the faster rate, as those of the boards do.
impl OnWire for Fd {
    fn on_wire(frame: &Self::Frame) -> Option<Frame> {
        Frame::fd(Id::Base(frame.id()), frame.data(), true).ok()
    }

    fn id_of(message: &Message) -> Option<Id> {
        match message {
            Message::State { component, .. } if *component != Component::FIRST => None,
            _ => Some(Id::Base(can_fd::encode(message).id())),
        }
    }
}

/// Who sees all that happens on the bus, in order: frames with their start and end, lost arbitrations, errors.
pub type Tap = Box<dyn FnMut(&Event)>;

/// A node's port with its driver.
struct Station<F: Format> {
    port: CanPort<F>,
    queue: Queue,
    loser: Loser,
    /// The node computes until then, ns.
    busy_until: u64,
}

/// What a driver has to do.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Work {
    /// The controller, or its queue, has frames.
    Unload,
    /// The controller has a free buffer.
    Load,
}

/// CAN with one controller for each node.
pub struct CanBus<N, F: Format = Classic> {
    bus: Bus<N>,
    stations: Vec<Station<F>>,
    /// What drivers are to do, in order: when it came to that (ns), for which node.
    due: VecDeque<(u64, usize, Work)>,
    /// When nodes have computed whose queues hold something, ns.
    waking: BTreeSet<(u64, usize)>,
    /// When the ports look at their controllers next, ns: all at the same time.
    look_at: u64,
    links: Option<Links<Frame>>,
    /// The node of each identifier, by index; none for one that is of no node.
    nodes: [Option<u8>; IDS],
    traffic: Traffic,
    /// Where nodes keep time: stamps of SYNC that nobody has taken yet.
    stamps: Option<Vec<Stamp>>,
    /// Nodes whose ports have gone off the bus, and how often so far, to be told.
    off: Vec<(usize, u16)>,
    tap: Option<Tap>,
    watch: Option<Watch>,
}

impl<N: Noise> CanBus<N> {
    /// Classic CAN for the nodes `ids`, of which `listeners[i]` keep the frames of node `i`, by index.
    pub fn new(timing: Timing, noise: N, ids: &[NodeId], listeners: &[Vec<usize>]) -> Self {
        Self::with_format(timing, noise, ids, listeners)
    }
}

impl<N: Noise> CanBus<N, Fd> {
    /// CAN FD for them.
    pub fn new_fd(timing: Timing, noise: N, ids: &[NodeId], listeners: &[Vec<usize>]) -> Self {
        Self::with_format(timing, noise, ids, listeners)
    }
}

impl<N: Noise, F: OnWire> CanBus<N, F> {
    pub(crate) fn with_format(timing: Timing, noise: N, ids: &[NodeId], listeners: &[Vec<usize>]) -> Self {
        Self::with_masters(timing, noise, (ids, listeners), &[])
    }

    /// The same, where all keep the SYNC of time masters, too, and stamp them.
    pub(crate) fn with_masters(
        timing: Timing,
        noise: N,
        (ids, listeners): (&[NodeId], &[Vec<usize>]),
        masters: &[NodeId],
    ) -> Self {
        let mut bus = Bus::new(timing, noise);
        bus.report_losses(false);
        let filter = |of: usize| {
            let heard = ids.iter().zip(listeners).filter(|(_, listeners)| listeners.contains(&of));
            // Frames to all carry no node.
            let filter = heard.fold(Filter::nothing().and_base(0, NODE_BITS), |filter, (id, _)| {
                filter.and_base(u16::from(id.get()), NODE_BITS)
            });
            masters.iter().fold(filter, |filter, id| filter.and(Id::Base(SYNC | u16::from(id.get()))))
        };
        let mut nodes = [None; IDS];
        for (index, id) in ids.iter().enumerate() {
            bus.add(Order::Priority, filter(index));
            if let Some(node) = nodes.get_mut(usize::from(id.get())) {
                *node = u8::try_from(index).ok();
            }
        }
        let station = |index: usize| Station {
            port: CanPort::new(),
            queue: Queue::default(),
            loser: Loser::new(Loss::NONE, random::stream(0, Purpose::Loss, index as u64)),
            busy_until: 0,
        };
        Self {
            bus,
            stations: (0..ids.len()).map(station).collect(),
            due: VecDeque::new(),
            waking: BTreeSet::new(),
            look_at: 0,
            links: None,
            nodes,
            traffic: Traffic::default(),
            stamps: (!masters.is_empty()).then(Vec::new),
            off: Vec::new(),
            tap: None,
            watch: None,
        }
    }

    /// With frames that are acknowledged and that a receiver loses, by random streams of `seed`.
    pub fn with_loss(mut self, seed: u64, loss: Loss) -> Self {
        for (index, station) in self.stations.iter_mut().enumerate() {
            station.loser = Loser::new(loss, random::stream(seed, Purpose::Loss, index as u64));
        }
        self
    }

    /// With links behind it, whose random streams are of `seed`. What they do comes after the receiver's controller; bits that they disturb
    /// make error frames, and are those of [`LinkNoise`].
    pub fn with_links(self, seed: u64, links: &[LinkSpec]) -> Self {
        let on_wire = |link: &LinkSpec| LinkSpec {
            settings: crate::scenario::LinkSettings { corrupt: 0.0, ..link.settings },
            ..*link
        };
        let links: Vec<LinkSpec> = links.iter().map(on_wire).collect();
        Self { links: Links::of(seed, &links), ..self }
    }

    /// With somebody who sees all that happens on it.
    pub fn with_tap(mut self, tap: Tap) -> Self {
        self.bus.report_losses(true);
        Self { tap: Some(tap), ..self }
    }

    /// The bus itself.
    pub fn bus(&self) -> &Bus<N> {
        &self.bus
    }

    fn advance(&mut self, to: u64) {
        let (due, traffic, tap, watch) = (&mut self.due, &mut self.traffic, &mut self.tap, &mut self.watch);
        let (stamps, bit_ns) = (&mut self.stamps, self.bus.timing().nominal().bit_ns());
        self.bus.advance(to, &mut |event: Event| {
            match event.what {
                What::Sent { ref frame, .. } => {
                    traffic.sent += 1;
                    if let Some(stamps) = stamps.as_mut().filter(|_| is_sync(frame.id())) {
                        // Receivers take a frame a bit before its sender is done with it.
                        let at = event.at.saturating_sub(bit_ns);
                        stamps.push(Stamp { node: event.node, at, own: true });
                    }
                    due.push_back((event.at, event.node, Work::Load));
                }
                What::Received { lost, .. } => {
                    traffic.no_room += u64::from(lost);
                    due.push_back((event.at, event.node, Work::Unload));
                }
                What::LostArbitration { .. } | What::Error { .. } | What::Overload | What::Mode { .. } => {}
            }
            if let Some(watch) = watch {
                watch.take(event);
            }
            if let Some(tap) = tap {
                tap(&event);
            }
        });
    }

    fn request(&mut self, index: usize, request: Option<Request>) {
        match request {
            Some(Request::Cancel) => {
                let before = self.bus.free_buffers(index);
                self.bus.cancel(index);
                self.traffic.replaced += (self.bus.free_buffers(index) - before) as u64;
            }
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
            if let Some(frame) = F::on_wire(frame) {
                let _loaded = self.bus.send(index, frame);
            }
            station.port.on_taken();
        }
    }

    /// Takes what the controller has received at `now` (ns), and tells what the port hears of it once the node does not compute.
    fn unload(&mut self, now: u64, index: usize, receive: &mut impl FnMut(usize, Result<Message, Refusal>)) {
        let Some(Station { port, queue, loser, busy_until }) = self.stations.get_mut(index) else { return };
        let computes = *busy_until > now;
        while let Some(frame) = self.bus.receive(index) {
            if loser.loses() {
                self.traffic.lost += 1;
                continue;
            }
            let (is_sync, lost) = (is_sync(frame.id()), queue.lost());
            match &mut self.links {
                None if queue.is_empty() && !computes => hand(port, &frame, index, &mut self.off, receive),
                None => queue.put(frame),
                Some(links) => {
                    let from = sender(&self.nodes, frame.id()).unwrap_or(index);
                    links.pass(now, (from, index), &frame, &mut self.traffic, |frame| queue.put(*frame));
                }
            }
            if let Some(stamps) = self.stamps.as_mut().filter(|_| is_sync && queue.lost() == lost) {
                stamps.push(Stamp { node: index, at: now, own: false });
            }
        }
        if computes {
            self.waking.insert((*busy_until, index));
            return;
        }
        while let Some(frame) = queue.take() {
            hand(port, &frame, index, &mut self.off, receive);
        }
    }

    /// When something happens next that is not due yet, ns.
    fn next_time(&self) -> u64 {
        let bus = self.bus.next_at().unwrap_or(u64::MAX).min(self.look_at);
        let waking = self.waking.first().map_or(u64::MAX, |&(at, _)| at);
        let late = self.links.as_ref().and_then(Links::next_at).unwrap_or(u64::MAX);
        bus.min(waking).min(late)
    }

    /// Lets all happen that happens next, so that it is due.
    fn pass(&mut self, receive: &mut impl FnMut(usize, Result<Message, Refusal>)) {
        let now = self.next_time();
        self.advance(now);
        if now >= self.look_at {
            self.look(now, receive);
        }
        while let Some(&(_, index)) = self.waking.first().filter(|&&(at, _)| at <= now) {
            self.waking.pop_first();
            self.due.push_back((now, index, Work::Unload));
        }
        let Some(links) = &mut self.links else { return };
        while links.next_at().is_some_and(|at| at <= now) {
            let Some((_, _, to, frame)) = links.take_late() else { return };
            if let Some(station) = self.stations.get_mut(to) {
                station.queue.put(frame);
                self.due.push_back((now, to, Work::Unload));
            }
        }
    }
}

/// Whether a frame is a SYNC of a node.
fn is_sync(id: Id) -> bool {
    matches!(id, Id::Base(id) if id & !NODE_BITS == SYNC && id & NODE_BITS != 0)
}

/// The index of the node that a frame is of.
fn sender(nodes: &[Option<u8>; IDS], id: Id) -> Option<usize> {
    let Id::Base(id) = id else { return None };
    nodes.get(usize::from(id & NODE_BITS)).copied().flatten().map(usize::from)
}

/// Bits that links disturb are bits on the wire.
impl Payload for Frame {
    fn flip(&mut self, _: impl FnOnce(usize) -> usize) {}
}

/// Gives a port a frame, and tells what it hears of it.
fn hand<F: Format>(
    port: &mut CanPort<F>,
    frame: &Frame,
    index: usize,
    off: &mut Vec<(usize, u16)>,
    receive: &mut impl FnMut(usize, Result<Message, Refusal>),
) {
    if let Id::Base(id) = frame.id() {
        port.on_frame(id, frame.bytes());
        hear(port, index, off, receive);
    }
}

fn hear<F: Format>(
    port: &mut CanPort<F>,
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

impl<N: Noise, F: OnWire> Medium for CanBus<N, F> {
    fn send(&mut self, now: u64, sender: usize, message: &Message) {
        self.advance(now);
        let Some(station) = self.stations.get_mut(sender) else { return };
        if let Some(watch) = &mut self.watch
            && let Some(id) = F::id_of(message)
        {
            watch.give(id, now);
        }
        let request = station.port.send(message);
        // Only a frame that has waited for so long that its successor is here asks for that.
        self.traffic.replaced += u64::from(request == Some(Request::Cancel));
        self.request(sender, request);
        self.load(sender);
    }

    fn flush(&mut self, now: u64, sender: usize) {
        self.advance(now);
        let Some(station) = self.stations.get_mut(sender) else { return };
        let request = station.port.flush();
        self.traffic.replaced += u64::from(request == Some(Request::Cancel));
        self.request(sender, request);
        self.load(sender);
    }

    fn computes(&mut self, node: usize, until: u64) {
        if let Some(station) = self.stations.get_mut(node) {
            station.busy_until = until;
        }
    }

    fn next_arrival(&self) -> Option<u64> {
        Some(self.due.front().map_or_else(|| self.next_time(), |&(at, ..)| at))
    }

    fn deliver(&mut self, mut receive: impl FnMut(usize, Result<Message, Refusal>)) {
        if self.due.is_empty() {
            self.pass(&mut receive);
        }
        let Some(&(now, ..)) = self.due.front() else { return };
        // What comes later is delivered later.
        while let Some(&(_, index, work)) = self.due.front().filter(|&&(at, ..)| at == now) {
            self.due.pop_front();
            match work {
                Work::Unload => self.unload(now, index, &mut receive),
                Work::Load => self.load(index),
            }
        }
    }

    fn take_stamps(&mut self) -> Vec<Stamp> {
        self.stamps.as_mut().map(std::mem::take).unwrap_or_default()
    }

    fn take_off(&mut self) -> Vec<(usize, u16)> {
        std::mem::take(&mut self.off)
    }

    fn traffic(&self) -> Traffic {
        let in_queues: u64 = self.stations.iter().map(|station| station.queue.lost()).sum();
        Traffic { no_room: self.traffic.no_room + in_queues, ..self.traffic }
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

/// Disturbed bits of a bus, and those that the receiver of a link reads wrong.
pub struct LinkNoise<N> {
    bus: N,
    /// By sender: the receiver, the probability for a frame, and what decides.
    links: Vec<Vec<(usize, f64, Pcg64)>>,
}

impl<N: Noise> LinkNoise<N> {
    /// The noise of a bus with so many nodes, and that of the links, by random streams of `seed`.
    pub fn new(bus: N, nodes: usize, seed: u64, specs: &[LinkSpec]) -> Self {
        let mut links = vec![Vec::new(); nodes];
        for &LinkSpec { from, to, settings } in specs.iter().filter(|link| link.settings.corrupt > 0.0) {
            let stream = random::stream(seed, Purpose::LinkBits, links::number(from, to));
            if let Some(of) = links.get_mut(from) {
                of.push((to, settings.corrupt, stream));
            }
        }
        Self { bus, links }
    }
}

impl<N: Noise> Noise for LinkNoise<N> {
    fn next(&mut self) -> Option<Hit> {
        self.bus.next()
    }

    /// Where several receivers read a bit wrong, the first one breaks the frame for all.
    fn strike(&mut self, sender: usize) -> Option<Strike> {
        let mut struck = None;
        for (to, probability, stream) in self.links.get_mut(sender)? {
            if random::happens(stream, *probability) {
                let place = (stream.next_u64() >> 32) as u32;
                let strike = Strike { seen_by: SeenBy::One(*to), place };
                let earlier = |before: &Strike| before.place <= place;
                struck = struck.filter(earlier).or(Some(strike));
            }
        }
        struck
    }
}
