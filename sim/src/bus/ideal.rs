//! The ideal bus: no bandwidth, no arbitration; a latency, a jitter, and loss at each receiver.
//!
//! A frame reaches all listeners at the same time, as on a shared wire; each of them loses it independently. Jitter is
//! drawn per frame from the sender's stream, loss per frame and receiver from the receiver's stream.

use super::links::{Links, Payload, flip_bit};
use super::loss::Loser;
use super::{Medium, Traffic};
use crate::random::{self, Purpose};
use crate::scenario::{LinkSpec, Loss, Spell};
use funnelnet_protocol::can::{self, CanFrame};
use funnelnet_protocol::message::Message;
use funnelnet_protocol::refusal::Refusal;
use rand_pcg::Pcg64;
use std::collections::VecDeque;

/// Parameters of the ideal bus.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct IdealParams {
    /// Loss of frames at a receiver.
    pub loss: Loss,
    /// Delay of every frame, ns.
    pub latency_ns: u64,
    /// Largest extra delay, uniformly distributed, ns.
    pub jitter_ns: u64,
}

/// A frame under way.
#[derive(Clone, Debug)]
struct Flight<P> {
    at: u64,
    sender: usize,
    payload: P,
}

/// The ideal bus for frames of type `P`.
#[derive(Clone, Debug)]
pub struct IdealBus<P> {
    params: IdealParams,
    /// Who accepts the frames of each node: its neighbours' acceptance filters.
    listeners: Vec<Vec<usize>>,
    /// By time of arrival, then by order of sending. New frames mostly go to the end, so that no heap is needed.
    flights: VecDeque<Flight<P>>,
    loss: Vec<Loser>,
    jitter: Vec<Pcg64>,
    /// Boxed because nearly no bus has any.
    links: Option<Box<Behind<P>>>,
    traffic: Traffic,
}

/// Links behind the bus, and what they let pass at once.
#[derive(Clone, Debug)]
struct Behind<P> {
    links: Links<P>,
    /// Receivers with their frames, at the time `at` (ns).
    ready: VecDeque<(usize, P)>,
    at: u64,
}

impl<P: Payload> Behind<P> {
    fn next_at(&self) -> Option<u64> {
        if self.ready.is_empty() { self.links.next_at() } else { Some(self.at) }
    }
}

impl<P: Payload> IdealBus<P> {
    /// A bus on which the nodes `listeners[i]` accept the frames of node `i`.
    pub fn new(params: IdealParams, seed: u64, listeners: Vec<Vec<usize>>) -> Self {
        let nodes = 0..listeners.len() as u64;
        let loser = |node| Loser::new(params.loss, random::stream(seed, Purpose::Loss, node));
        Self {
            params,
            flights: VecDeque::with_capacity(2 * listeners.len()),
            loss: nodes.clone().map(loser).collect(),
            jitter: nodes.map(|node| random::stream(seed, Purpose::Jitter, node)).collect(),
            links: None,
            traffic: Traffic::default(),
            listeners,
        }
    }

    /// Adds links behind the bus, and what events do to them, with random streams of `seed`.
    pub fn with_links(self, seed: u64, links: &[LinkSpec], spells: &[Spell]) -> Self {
        let behind = |links| Box::new(Behind { links, ready: VecDeque::new(), at: 0 });
        Self { links: Links::of(seed, links, spells).map(behind), ..self }
    }

    /// Node `sender` puts a frame on the bus at `now` (ns).
    pub fn send(&mut self, now: u64, sender: usize, payload: P) {
        let extra = match (self.params.jitter_ns as usize, self.jitter.get_mut(sender)) {
            (0, _) | (_, None) => 0,
            (bound, Some(stream)) => random::below(stream, bound) as u64,
        };
        let at = now.saturating_add(self.params.latency_ns).saturating_add(extra);
        self.traffic.sent += 1;
        let later = self.flights.iter().rev().take_while(|flight| flight.at > at).count();
        let flight = Flight { at, sender, payload };
        match later {
            // Much cheaper than an insertion at the end.
            0 => self.flights.push_back(flight),
            _ => self.flights.insert(self.flights.len() - later, flight),
        }
    }

    /// Has the nodes `listeners[i]` accept the frames of node `i` from now on, those under way among them.
    pub fn set_listeners(&mut self, listeners: Vec<Vec<usize>>) {
        self.listeners = listeners;
    }

    /// Whether `receiver` accepts the frames of `sender`.
    pub fn carries(&self, sender: usize, receiver: usize) -> bool {
        self.listeners.get(sender).is_some_and(|listeners| listeners.contains(&receiver))
    }

    /// Time at which the next frame arrives, ns.
    pub fn next_arrival(&self) -> Option<u64> {
        let flight = self.flights.front().map(|flight| flight.at);
        match &self.links {
            None => flight,
            Some(links) => flight.into_iter().chain(links.next_at()).min(),
        }
    }

    /// Delivers the next frame: `receive(receiver, frame)` for each listener that does not lose it. Where there are links, each receiver has
    /// a delivery of its own.
    pub fn deliver(&mut self, receive: impl FnMut(usize, &P)) {
        self.deliver_as(|payload| payload, receive);
    }

    /// The same, read once for all. One place calls `receive`, so that it can be inlined there (`./ci.sh cost`).
    #[inline(always)]
    fn deliver_as<T>(&mut self, read: impl FnOnce(P) -> T, mut receive: impl FnMut(usize, &T)) {
        let by_link;
        let (payload, listeners): (P, &[usize]) = if self.links.is_some() {
            let Some((receiver, payload)) = self.next_by_links() else { return };
            by_link = [receiver];
            (payload, &by_link)
        } else {
            let Some(flight) = self.flights.pop_front() else { return };
            (flight.payload, self.listeners.get(flight.sender).map_or(&[], Vec::as_slice))
        };
        let heard = read(payload);
        // What comes by links was not lost.
        let may_be_lost = self.links.is_none() && !self.params.loss.is_none();
        for &listener in listeners {
            if may_be_lost && self.loss.get_mut(listener).is_some_and(Loser::loses) {
                self.traffic.lost += 1;
            } else {
                receive(listener, &heard);
            }
        }
    }

    /// What links let pass next; none where the next frame is lost or late.
    #[cold]
    fn next_by_links(&mut self) -> Option<(usize, P)> {
        let Behind { links, ready, at } = self.links.as_deref_mut()?;
        if let Some(next) = ready.pop_front() {
            return Some(next);
        }
        let flight = self.flights.front().map_or(u64::MAX, |flight| flight.at);
        // What was sent before goes first.
        if links.next_at().is_some_and(|at| at <= flight) {
            let (_, from, to, payload) = links.take_late()?;
            let hears = self.listeners.get(from).is_some_and(|list| list.contains(&to));
            return hears.then_some((to, payload));
        }
        let Flight { at: now, sender, payload } = self.flights.pop_front()?;
        *at = now;
        for &listener in self.listeners.get(sender).into_iter().flatten() {
            if self.loss.get_mut(listener).is_some_and(Loser::loses) {
                self.traffic.lost += 1;
            } else {
                let pass = |payload: &P| ready.push_back((listener, payload.clone()));
                links.pass(now, (sender, listener), &payload, &mut self.traffic, pass);
            }
        }
        ready.pop_front()
    }

    /// Frame counts so far.
    pub fn traffic(&self) -> Traffic {
        self.traffic
    }
}

/// There is no checksum on the ideal bus: a bit that is wrong is a wrong value, or a frame that is refused.
impl Payload for CanFrame {
    fn flip(&mut self, choose: impl FnOnce(usize) -> usize) {
        let mut data = [0; can::MAX_DATA];
        let length = self.data().len();
        data.iter_mut().zip(self.data()).for_each(|(to, from)| *to = *from);
        flip_bit(&mut data, choose(8 * length));
        *self = data.get(..length).and_then(|data| Self::new(self.id(), data)).unwrap_or(*self);
    }
}

impl Medium for IdealBus<CanFrame> {
    #[inline]
    fn send(&mut self, now: u64, sender: usize, message: &Message) {
        self.send(now, sender, can::encode(message));
    }

    fn next_arrival(&self) -> Option<u64> {
        self.next_arrival()
    }

    #[inline(always)]
    fn deliver(&mut self, mut receive: impl FnMut(usize, Result<Message, Refusal>)) {
        self.deliver_as(
            |frame| can::decode(frame.id(), frame.data()),
            |receiver, heard| receive(receiver, *heard),
        );
    }

    fn set_listeners(&mut self, listeners: Vec<Vec<usize>>) {
        self.set_listeners(listeners);
    }

    fn traffic(&self) -> Traffic {
        self.traffic()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn bus(params: IdealParams) -> IdealBus<u32> {
        IdealBus::new(params, 7, vec![vec![1, 2], vec![0], vec![0]])
    }

    #[test]
    fn frames_arrive_in_order_of_time_then_of_sending() {
        let mut bus = bus(IdealParams { latency_ns: 10, ..IdealParams::default() });
        bus.send(5, 0, 100);
        bus.send(5, 1, 101);
        bus.send(4, 2, 102);
        let mut got = Vec::new();
        while let Some(at) = bus.next_arrival() {
            bus.deliver(|receiver, &frame| got.push((at, receiver, frame)));
        }
        assert_eq!(got, [(14, 0, 102), (15, 1, 100), (15, 2, 100), (15, 0, 101)]);
    }

    #[test]
    fn loss_is_independent_at_each_receiver_and_as_frequent_as_said() {
        let mut bus = bus(IdealParams { loss: Loss::independent(0.1), ..IdealParams::default() });
        let mut heard = [0u32; 3];
        let (mut both, sends) = (0, 20_000);
        for frame in 0..sends {
            bus.send(0, 0, frame);
            let before = heard;
            bus.deliver(|receiver, _| heard[receiver] += 1);
            both += u32::from(heard[1] > before[1] && heard[2] > before[2]);
        }
        let share = |count: u32| f64::from(count) / f64::from(sends);
        assert!((share(heard[1]) - 0.9).abs() < 0.01 && (share(heard[2]) - 0.9).abs() < 0.01, "{heard:?}");
        assert!((share(both) - 0.81).abs() < 0.015, "{both}");
        assert_eq!(bus.traffic().lost, u64::from(2 * sends - heard[1] - heard[2]));
    }

    #[test]
    fn jitter_stays_within_its_bound_and_is_used() {
        let mut bus = bus(IdealParams { jitter_ns: 50, ..IdealParams::default() });
        let mut seen = std::collections::BTreeSet::new();
        for frame in 0..1000 {
            bus.send(1000, 0, frame);
            seen.insert(bus.next_arrival().unwrap());
            bus.deliver(|_, _| {});
        }
        assert!(*seen.first().unwrap() >= 1000 && *seen.last().unwrap() < 1050 && seen.len() > 40);
    }
}
