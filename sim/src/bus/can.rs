//! A CAN bus, classic or FD, bit for bit, with the port of each node above it: what the firmware runs between its node and its controller.
//!
//! A node whose port has gone off the bus is told so, and stops, as the app has it. A driver takes no time; its queue waits while the node
//! computes.

use super::harms::{Babble, Harms, Step};
use super::links::{self, Links, Payload};
use super::loss::Loser;
use super::watch::Watch;
use super::{Medium, Power, Stamp, Traffic};
use crate::random::{self, Purpose};
use crate::scenario::{Does, Harm, LinkSpec, Loss, NoisySpell, Spell};
use funnelnet_can_bus::{
    Bus, Event, Filter, Frame, Hit, Id, Mode, Noise, Order, Queue, SeenBy, Strike, TRANSMIT_BUFFERS, Timing,
    What,
};
use funnelnet_link::port::LOOK_EVERY_NS;
use funnelnet_link::{BusState, CanPort, Change, Classic, Fd, Format, Heard, Request};
use funnelnet_protocol::message::{Component, NodeId};
use funnelnet_protocol::{Message, Refusal, can, can_fd};
use rand_pcg::Pcg64;
use rand_pcg::rand_core::Rng as _;
use std::collections::BTreeSet;
use std::ops::Range;

/// Bits of an identifier that say whose frame it is (protocol/README.md).
const NODE_BITS: u16 = 0x7F;
/// The identifier of a SYNC, without that of its master.
const SYNC: u16 = (can::function::SYNC as u16) << 7;
/// Identifiers of nodes.
const IDS: usize = NODE_BITS as usize + 1;

/// A format with its frames as they are on the wire.
pub trait OnWire: Format {
    /// A frame says no more than one thing.
    const SAYS_ONE_THING: bool;

    /// A frame of a node, which has an 11-bit identifier and a length that the format has.
    fn on_wire(frame: &Self::Frame) -> Option<Frame>;

    /// The identifier of the frame that begins with a message; none where it is one of the others of a frame.
    fn id_of(message: &Message) -> Option<Id>;
}

impl OnWire for Classic {
    const SAYS_ONE_THING: bool = true;

    fn on_wire(frame: &Self::Frame) -> Option<Frame> {
        Frame::data(Id::Base(frame.id()), frame.data()).ok()
    }

    fn id_of(message: &Message) -> Option<Id> {
        Some(Id::Base(can::encode(message).id()))
    }
}

/// All frames switch to the faster rate, as those of the boards do.
impl OnWire for Fd {
    const SAYS_ONE_THING: bool = false;

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

/// Tap that sees all that happens on the bus, in order: frames with their start and end, lost arbitrations, errors.
pub type Tap = Box<dyn FnMut(&Event)>;

/// A node's port with its driver.
struct Station<F: Format> {
    port: CanPort<F>,
    queue: Queue,
    loser: Loser,
    /// The node computes until then, ns.
    busy_until: u64,
    power: Power,
    /// Events that keep its connector off.
    cuts: usize,
    babble: Babble,
}

impl<F: Format> Station<F> {
    /// One that has just been switched on, and nothing waits in it.
    fn fresh(&mut self) {
        (self.port, self.busy_until) = (CanPort::new(), 0);
        self.babble.waits(None);
        self.queue.clear();
    }
}

/// What a driver has to do.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Work {
    /// The controller, or its queue, has frames.
    Unload,
    /// The controller has a free buffer.
    Load,
}

/// What drivers are to do, in order: when it came to that (ns), for which node. It is done in one go, so that no ring is needed.
#[derive(Default)]
struct Due {
    entries: Vec<(u64, u32, Work)>,
    done: usize,
}

impl Due {
    fn push(&mut self, at: u64, node: usize, work: Work) {
        self.entries.push((at, node as u32, work));
    }

    fn next(&self) -> Option<(u64, usize, Work)> {
        self.entries.get(self.done).map(|&(at, node, work)| (at, node as usize, work))
    }

    /// The next one is done.
    fn advance(&mut self) {
        self.done += 1;
        if self.done == self.entries.len() {
            self.entries.clear();
            self.done = 0;
        }
    }
}

/// CAN with one controller for each node.
pub struct CanBus<N, F: Format = Classic> {
    bus: Bus<N>,
    stations: Vec<Station<F>>,
    due: Due,
    /// When nodes have computed whose queues hold something, ns.
    waking: BTreeSet<(u64, usize)>,
    /// When the ports look at their controllers next, ns: all at the same time.
    look_at: u64,
    links: Option<Links<Frame>>,
    harms: Harms,
    /// Receivers take all that their controllers keep, and stamp nothing: no losses, no links, no events, no time masters.
    is_plain: bool,
    /// The node of each identifier, by index; none for one that is of no node.
    nodes: [Option<u8>; IDS],
    /// Who accepts the frames of each node, by index, once events may have changed that; the filters of the controllers stay.
    listeners: Option<Vec<Vec<usize>>>,
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
        bus.report_receptions(false);
        let filter = |of: usize| {
            let heard = ids.iter().zip(listeners).filter(|(_, listeners)| listeners.contains(&of));
            // Frames to all carry no node. A node hears who has its id, as the filters of the firmware have it.
            let own = ids.get(of).map_or(0, |id| u16::from(id.get()));
            let filter = Filter::nothing().and_base(0, NODE_BITS).and_base(own, NODE_BITS);
            let filter =
                heard.fold(filter, |filter, (id, _)| filter.and_base(u16::from(id.get()), NODE_BITS));
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
            power: Power::On,
            cuts: 0,
            babble: Babble::default(),
        };
        Self {
            bus,
            stations: (0..ids.len()).map(station).collect(),
            due: Due::default(),
            waking: BTreeSet::new(),
            look_at: 0,
            links: None,
            harms: Harms::default(),
            is_plain: masters.is_empty(),
            nodes,
            listeners: None,
            traffic: Traffic::default(),
            stamps: (!masters.is_empty()).then(Vec::new),
            off: Vec::new(),
            tap: None,
            watch: None,
        }
    }

    /// Lets receivers lose frames that are acknowledged, by random streams of `seed`.
    pub fn with_loss(mut self, seed: u64, loss: Loss) -> Self {
        for (index, station) in self.stations.iter_mut().enumerate() {
            station.loser = Loser::new(loss, random::stream(seed, Purpose::Loss, index as u64));
        }
        self.is_plain &= loss.is_none();
        self
    }

    /// With links behind it and what events do to them; random streams are of `seed`. What they do comes after the receiver's controller; bits that they disturb
    /// make error frames, and are those of [`LinkNoise`].
    pub fn with_links(self, seed: u64, links: &[LinkSpec], spells: &[Spell]) -> Self {
        let on_wire = |link: &LinkSpec| LinkSpec {
            settings: crate::scenario::LinkSettings { corrupt: 0.0, ..link.settings },
            ..*link
        };
        let links: Vec<LinkSpec> = links.iter().map(on_wire).collect();
        let above: Vec<Spell> =
            spells.iter().filter(|spell| !matches!(spell.does, Does::Corrupt(_))).cloned().collect();
        let links = Links::of(seed, &links, &above);
        Self { is_plain: self.is_plain && links.is_none(), links, ..self }
    }

    /// With what events do to the wire and to who is on it.
    pub(crate) fn with_harms(mut self, harms: &[Harm]) -> Self {
        for harm in harms {
            if let Harm::Short(during) = harm {
                self.bus.short(during.clone());
            }
        }
        Self { harms: Harms::of(harms), ..self }
    }

    /// Adds a tap that sees all that happens on the bus.
    pub fn with_tap(mut self, tap: Tap) -> Self {
        self.bus.report_losses(true);
        self.bus.report_receptions(true);
        Self { tap: Some(tap), ..self }
    }

    /// The bus itself.
    pub fn bus(&self) -> &Bus<N> {
        &self.bus
    }

    #[inline]
    fn advance(&mut self, to: u64) {
        while self.bus.next_at().is_some_and(|next| next <= to) {
            self.run(to);
        }
        self.bus.advance(to, &mut |_| ());
    }

    /// Lets happen what happens on the bus up to `to` (ns), or up to the first thing that is due for somebody.
    fn run(&mut self, to: u64) {
        let (due, traffic, tap, watch) = (&mut self.due, &mut self.traffic, &mut self.tap, &mut self.watch);
        let stations = &mut self.stations;
        let (stamps, bit_ns) = (&mut self.stamps, self.bus.timing().nominal().bit_ns());
        let before = due.entries.len();
        while let Some(next) = self.bus.next_at().filter(|&next| next <= to) {
            self.bus.advance(next, &mut |event: Event| {
                match event.what {
                    What::Sent { ref frame, .. } => {
                        traffic.sent += 1;
                        if let Some(stamps) = stamps.as_mut().filter(|_| is_sync(frame)) {
                            // Receivers take a frame a bit before its sender is done with it.
                            let at = event.at.saturating_sub(bit_ns);
                            stamps.push(Stamp { node: event.node, at, own: true });
                        }
                        if let Some(station) = stations.get_mut(event.node) {
                            station.babble.sent(frame.id());
                        }
                        due.push(event.at, event.node, Work::Load);
                    }
                    What::Received { lost, .. } => {
                        traffic.no_room += u64::from(lost);
                        due.push(event.at, event.node, Work::Unload);
                    }
                    What::LostArbitration { .. }
                    | What::Error { .. }
                    | What::Overload
                    | What::Mode { .. } => {}
                }
                if let Some(watch) = watch {
                    watch.take(event);
                }
                if let Some(tap) = tap {
                    tap(&event);
                }
            });
            // At one time there are arrivals or events.
            for arrival in self.bus.drain_arrivals() {
                traffic.no_room += u64::from(arrival.lost);
                due.push(arrival.at, arrival.node, Work::Unload);
            }
            if due.entries.len() > before {
                return;
            }
        }
    }

    #[cold]
    fn request(&mut self, index: usize, request: Request) {
        match request {
            Request::Cancel => {
                let before = self.bus.free_buffers(index);
                self.bus.cancel(index);
                self.traffic.replaced += (self.bus.free_buffers(index) - before) as u64;
                if let Some(station) = self.stations.get_mut(index) {
                    station.babble.waits(None);
                }
            }
            Request::Restart => self.bus.restart(index),
        }
    }

    /// All ports look at their controllers.
    fn look(&mut self, now: u64, receive: &mut impl FnMut(usize, Result<Message, Refusal>)) {
        for index in 0..self.stations.len() {
            if self.bus.is_absent(index) {
                // Its driver has not begun, or there is none.
                self.look_at = self.look_at.max(now + LOOK_EVERY_NS);
                continue;
            }
            let state = match self.bus.mode(index) {
                Mode::Active => BusState::Active,
                Mode::Passive => BusState::Passive,
                Mode::Off => BusState::Off,
            };
            let Some(station) = self.stations.get_mut(index) else { return };
            let request = station.port.on_state(state, now);
            self.look_at = station.port.look_at();
            hear(&mut station.port, index, &mut self.off, receive);
            if let Some(request) = request {
                self.request(index, request);
            }
            self.load(index);
            // A node that goes has had its time.
            self.leave(index, true);
        }
    }

    /// A node goes that has only waited until all is sent, or for so `long` that it may not be.
    fn leave(&mut self, index: usize, long: bool) {
        let Some(station) =
            self.stations.get_mut(index).filter(|station| station.power == Power::OffWhenSent)
        else {
            return;
        };
        let is_sent = station.port.next_frame().is_none() && self.bus.free_buffers(index) == TRANSMIT_BUFFERS;
        if is_sent || long {
            station.power = Power::Off;
            station.fresh();
            self.bus.switch_off(index);
        }
    }

    /// Gives the controller what waits in the port, as far as it has room.
    fn load(&mut self, index: usize) {
        let Some(station) = self.stations.get_mut(index) else { return };
        // Before the port takes the buffer that it leaves.
        if let Some(frame) = station.babble.due() {
            station.babble.waits(self.bus.send(index, frame).then_some(frame.id()));
        }
        while let Some(frame) = station.port.next_frame().filter(|_| self.bus.free_buffers(index) > 0) {
            if let Some(frame) = F::on_wire(frame) {
                let _loaded = self.bus.send(index, frame);
            }
            station.port.on_taken();
        }
    }

    /// Does what events do to a node now.
    #[cold]
    fn harm(&mut self, index: usize, step: Step) {
        let Some(station) = self.stations.get_mut(index) else { return };
        match step {
            Step::Unplug => {
                station.cuts += 1;
                self.bus.unplug(index);
            }
            Step::Plug => {
                station.cuts -= 1;
                if station.cuts == 0 {
                    self.bus.plug(index);
                }
            }
            Step::Babble(event, frame) => {
                station.babble.begin(event, frame);
                self.load(index);
            }
            Step::Quiet(event) => station.babble.end(event),
        }
    }

    /// Takes what the controller has received at `now` (ns), and tells what the port hears of it once the node does not compute.
    fn unload(&mut self, now: u64, index: usize, receive: &mut impl FnMut(usize, Result<Message, Refusal>)) {
        let Some(Station { port, queue, busy_until, .. }) = self.stations.get_mut(index) else { return };
        if !self.is_plain || *busy_until > now || !queue.is_empty() {
            return self.unload_by_queue(now, index, receive);
        }
        while let Some(frame) = self.bus.receive_ref(index) {
            hand(port, frame, index, &mut self.off, receive);
        }
    }

    /// The same where frames may be lost, come late, or have to wait.
    #[cold]
    fn unload_by_queue(
        &mut self,
        now: u64,
        index: usize,
        receive: &mut impl FnMut(usize, Result<Message, Refusal>),
    ) {
        let Some(Station { port, queue, loser, busy_until, .. }) = self.stations.get_mut(index) else {
            return;
        };
        let computes = *busy_until > now;
        while let Some(frame) = self.bus.receive(index) {
            let from = sender(&self.nodes, frame.id()).filter(|&from| from != index);
            // SYNC is for all: no edge carries it, so that no event cuts it.
            let is_sync = is_sync(&frame);
            if !is_sync && is_deaf(&self.listeners, from, index) {
                continue;
            }
            if loser.loses() {
                self.traffic.lost += 1;
                continue;
            }
            let lost = queue.lost();
            // Nor does a link lose it, or hold it back: what is heard goes with the stamps in their order.
            match self.links.as_mut().filter(|_| !is_sync) {
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

    /// When something happens next that is not due yet, ns: on the bus, and elsewhere.
    fn next_times(&self) -> (u64, u64) {
        let waking = self.waking.first().map_or(u64::MAX, |&(at, _)| at);
        let late = self.links.as_ref().and_then(Links::next_at).unwrap_or(u64::MAX);
        (self.bus.next_at().unwrap_or(u64::MAX), self.look_at.min(waking).min(late).min(self.harms.next_at()))
    }

    /// Lets all happen that happens next, at `now` (ns), so that it is due.
    #[cold]
    fn pass(&mut self, now: u64, receive: &mut impl FnMut(usize, Result<Message, Refusal>)) {
        self.advance(now);
        if now >= self.look_at {
            self.look(now, receive);
        }
        while let Some((index, step)) = self.harms.take(now) {
            self.harm(index, step);
        }
        while let Some(&(_, index)) = self.waking.first().filter(|&&(at, _)| at <= now) {
            self.waking.pop_first();
            self.due.push(now, index, Work::Unload);
        }
        let Some(links) = &mut self.links else { return };
        while links.next_at().is_some_and(|at| at <= now) {
            let Some((_, _, to, frame)) = links.take_late() else { return };
            if let Some(station) = self.stations.get_mut(to) {
                station.queue.put(frame);
                self.due.push(now, to, Work::Unload);
            }
        }
    }

    /// Does what is due at `now` (ns). What comes later is delivered later.
    fn work(&mut self, now: u64, receive: &mut impl FnMut(usize, Result<Message, Refusal>)) {
        while let Some((_, index, work)) = self.due.next().filter(|&(at, ..)| at == now) {
            self.due.advance();
            match work {
                Work::Unload => self.unload(now, index, receive),
                Work::Load => {
                    self.load(index);
                    self.leave(index, false);
                }
            }
        }
    }
}

/// Whether a frame is a SYNC of a node. One without data is refused: nobody takes its stamp.
fn is_sync(frame: &Frame) -> bool {
    let is_named = matches!(frame.id(), Id::Base(id) if id & !NODE_BITS == SYNC && id & NODE_BITS != 0);
    is_named && !frame.bytes().is_empty()
}

/// The index of the node that a frame is of.
fn sender(nodes: &[Option<u8>; IDS], id: Id) -> Option<usize> {
    let Id::Base(id) = id else { return None };
    nodes.get(usize::from(id & NODE_BITS)).copied().flatten().map(usize::from)
}

/// Whether events have cut a node off from the sender of a frame.
fn is_deaf(listeners: &Option<Vec<Vec<usize>>>, sender: Option<usize>, index: usize) -> bool {
    let list = listeners.as_ref().zip(sender).and_then(|(listeners, sender)| listeners.get(sender));
    list.is_some_and(|list| !list.contains(&index))
}

/// Bits that links disturb are bits on the wire.
impl Payload for Frame {
    fn flip(&mut self, _: impl FnOnce(usize) -> usize) {}
}

/// Gives a port a frame, and tells what it hears of it.
fn hand<F: OnWire>(
    port: &mut CanPort<F>,
    frame: &Frame,
    index: usize,
    off: &mut Vec<(usize, u16)>,
    receive: &mut impl FnMut(usize, Result<Message, Refusal>),
) {
    if let Id::Base(id) = frame.id() {
        port.on_frame(id, frame.bytes());
        if F::SAYS_ONE_THING {
            // What is told of changes was heard when it was looked at.
            if let Some(heard) = port.hear() {
                tell(heard, index, off, receive);
            }
        } else {
            hear(port, index, off, receive);
        }
    }
}

fn hear<F: Format>(
    port: &mut CanPort<F>,
    index: usize,
    off: &mut Vec<(usize, u16)>,
    receive: &mut impl FnMut(usize, Result<Message, Refusal>),
) {
    while let Some(heard) = port.hear() {
        tell(heard, index, off, receive);
    }
}

#[inline]
fn tell(
    heard: Heard,
    index: usize,
    off: &mut Vec<(usize, u16)>,
    receive: &mut impl FnMut(usize, Result<Message, Refusal>),
) {
    match heard {
        Heard::Message(message) => receive(index, message),
        Heard::Change(Change::Off { count, .. }) => off.push((index, count)),
        Heard::Change(_) => {}
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
        if let Some(request) = request {
            self.traffic.replaced += u64::from(request == Request::Cancel);
            self.request(sender, request);
        }
        self.load(sender);
    }

    fn flush(&mut self, now: u64, sender: usize) {
        self.advance(now);
        let Some(station) = self.stations.get_mut(sender) else { return };
        let request = station.port.flush();
        if let Some(request) = request {
            self.traffic.replaced += u64::from(request == Request::Cancel);
            self.request(sender, request);
        }
        self.load(sender);
    }

    fn computes(&mut self, node: usize, until: u64) {
        if let Some(station) = self.stations.get_mut(node) {
            station.busy_until = until;
        }
    }

    fn next_arrival(&self) -> Option<u64> {
        let (bus, other) = self.next_times();
        Some(self.due.next().map_or(bus.min(other), |(at, ..)| at))
    }

    fn deliver(&mut self, mut receive: impl FnMut(usize, Result<Message, Refusal>)) {
        if self.due.next().is_none() {
            let (bus, other) = self.next_times();
            self.pass(bus.min(other), &mut receive);
        }
        if let Some((now, ..)) = self.due.next() {
            self.work(now, &mut receive);
        }
    }

    fn deliver_before(
        &mut self,
        before: u64,
        mut receive: impl FnMut(u64, usize, Result<Message, Refusal>),
    ) -> Option<u64> {
        while self.due.next().is_none() {
            let (bus, other) = self.next_times();
            let now = bus.min(other);
            if now >= before {
                return None;
            }
            if bus < other {
                self.run(before.min(other) - 1);
            } else {
                self.pass(now, &mut |index, heard| receive(now, index, heard));
                return Some(now);
            }
        }
        let (now, ..) = self.due.next().filter(|&(at, ..)| at < before)?;
        self.work(now, &mut |index, heard| receive(now, index, heard));
        Some(now)
    }

    fn set_listeners(&mut self, listeners: Vec<Vec<usize>>) {
        (self.listeners, self.is_plain) = (Some(listeners), false);
    }

    fn switch(&mut self, now: u64, node: usize, power: Power) {
        self.advance(now);
        let Some(station) = self.stations.get_mut(node) else { return };
        station.power = power;
        match power {
            Power::On => {
                station.fresh();
                self.bus.switch_on(node);
            }
            Power::Off => {
                station.fresh();
                self.bus.switch_off(node);
            }
            Power::OffWhenSent => self.leave(node, false),
        }
    }

    fn has_off(&self) -> bool {
        !self.off.is_empty()
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
        self.bus.report_receptions(true);
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
    /// By sender.
    links: Vec<Vec<Misreader>>,
    /// Where events make the bus noisy.
    spells: Option<NoisySpells>,
}

/// A receiver that reads bits wrong.
struct Misreader {
    to: usize,
    /// For a frame.
    probability: f64,
    stream: Pcg64,
    /// When it does so, ns; always, if none is said.
    during: Option<Range<u64>>,
}

/// Bit errors that come and go: of those of the noisiest spell, as many are real as there are now.
struct NoisySpells {
    /// Bit errors of the bus as a rule, and the most that there are, among a billion.
    calm: u32,
    most: u32,
    spells: Vec<NoisySpell>,
    stream: Pcg64,
}

impl NoisySpells {
    fn rate(&self, at: u64) -> u32 {
        let now = self.spells.iter().filter(|spell| spell.during.contains(&at));
        now.map(|spell| spell.per_billion).fold(self.calm, u32::max)
    }

    fn is_real(&mut self, at: u64) -> bool {
        let share = f64::from(self.rate(at)) / f64::from(self.most.max(1));
        random::uniform(&mut self.stream) < share
    }
}

/// The most bit errors that a bus has at any time, among a billion.
pub fn most_errors(calm: u32, spells: &[NoisySpell]) -> u32 {
    spells.iter().map(|spell| spell.per_billion).fold(calm, u32::max)
}

impl<N: Noise> LinkNoise<N> {
    /// The noise of a bus with so many nodes, and that of the links, by random streams of `seed`.
    pub fn new(bus: N, nodes: usize, seed: u64, specs: &[LinkSpec]) -> Self {
        let mut links: Vec<Vec<Misreader>> = (0..nodes).map(|_| Vec::new()).collect();
        for &LinkSpec { from, to, settings } in specs.iter().filter(|link| link.settings.corrupt > 0.0) {
            let stream = random::stream(seed, Purpose::LinkBits, links::number(from, to));
            if let Some(of) = links.get_mut(from) {
                of.push(Misreader { to, probability: settings.corrupt, stream, during: None });
            }
        }
        Self { bus, links, spells: None }
    }

    /// With what events do: `calm` bit errors among a billion as a rule, of the [most](most_errors) that `bus` makes.
    pub fn with_spells(mut self, seed: u64, spells: &[Spell], calm: u32, noisy: Vec<NoisySpell>) -> Self {
        for spell in spells {
            let Does::Corrupt(probability) = spell.does else { continue };
            let number = links::number(spell.from, spell.to) + ((spell.event as u64) << 14);
            let stream = random::stream(seed, Purpose::EventBits, number);
            if let Some(of) = self.links.get_mut(spell.from) {
                of.push(Misreader { to: spell.to, probability, stream, during: Some(spell.during.clone()) });
            }
        }
        if !noisy.is_empty() {
            let most = most_errors(calm, &noisy);
            let stream = random::stream(seed, Purpose::EventNoise, 0);
            self.spells = Some(NoisySpells { calm, most, spells: noisy, stream });
        }
        self
    }
}

impl<N: Noise> Noise for LinkNoise<N> {
    fn next(&mut self) -> Option<Hit> {
        self.bus.next()
    }

    fn is_real(&mut self, at: u64) -> bool {
        self.spells.as_mut().is_none_or(|spells| spells.is_real(at))
    }

    /// Where several receivers read a bit wrong, the first one breaks the frame for all.
    fn strike(&mut self, at: u64, sender: usize) -> Option<Strike> {
        let mut struck = None;
        for Misreader { to, probability, stream, during } in self.links.get_mut(sender)? {
            if during.as_ref().is_none_or(|during| during.contains(&at))
                && random::happens(stream, *probability)
            {
                let place = (stream.next_u64() >> 32) as u32;
                let strike = Strike { seen_by: SeenBy::One(*to), place };
                let earlier = |before: &Strike| before.place <= place;
                struck = struck.filter(earlier).or(Some(strike));
            }
        }
        struck
    }
}
