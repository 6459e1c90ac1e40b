//! The bus: controllers on one wire, in discrete time.
//!
//! A frame that nothing disturbs is one step from its start to its end. Everything else (errors, collisions, passive senders, a lone node) goes bit
//! by bit, by the same rules; [`Bus::bit_by_bit`] makes all of it go so, and a test holds both ways against each other.

mod harm;

use crate::controller::{Controller, Order, Pending, TRANSMIT_BUFFERS};
use crate::counters::{Counters, Mode};
use crate::event::{Event, What};
use crate::filter::Filter;
use crate::frame::{Frame, Id, LARGEST_BASE};
use crate::length::{ACKNOWLEDGEMENT, END, INTERMISSION, Length};
use crate::noise::{Hit, Noise, Quiet, SeenBy, Strike};
use crate::participant::{Happening, Participant};
use crate::rate::Timing;
use crate::wire::{DOMINANT, Pace, RECESSIVE};
use std::collections::{BTreeMap, VecDeque};
use std::ops::Range;

/// No time.
const NEVER: u64 = u64::MAX;
/// The number of a controller that is alone on its wire.
const LONE: usize = 0;

/// A controller has received a frame that its filter keeps.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Arrival {
    /// When, ns.
    pub at: u64,
    /// The controller.
    pub node: usize,
    /// Its FIFO had no room: the frame is lost.
    pub lost: bool,
}

/// A CAN bus and the controllers on it, which are numbered from 0 on in the order in which they were added.
#[derive(Debug)]
pub struct Bus<N> {
    timing: Timing,
    noise: N,
    hit: Option<Hit>,
    /// The hit that a strike has come before.
    behind: Option<Option<Hit>>,
    nodes: Vec<Node>,
    phase: Phase,
    /// When something happens next, ns, unless a controller recovers on an idle bus; [`NEVER`], if nothing does.
    next: u64,
    now: u64,
    busy_ns: u64,
    bit_by_bit: bool,
    report_losses: bool,
    report_receptions: bool,
    /// Receptions of undisturbed frames that were not reported, in order.
    arrivals: Vec<Arrival>,
    /// What an arbitration between controllers that are on the bus would come to: priorities of their next frames, with the controllers.
    /// The one that wins is the last.
    waiting: VecDeque<(u32, usize)>,
    /// A frame came, or was cancelled, between a start of frame and its sample point: what waits is not what takes part.
    late: bool,
    /// A controller may recover from bus-off.
    recovering: bool,
    /// A controller may have a receive error counter above zero.
    heard_errors: bool,
    /// Times at which the wire is dominant whatever is sent, ns: those that are not over, in order.
    shorts: VecDeque<Range<u64>>,
    /// Controllers whose connector is off, each on a wire of its own.
    lone: BTreeMap<usize, Box<Bus<Quiet>>>,
    routes: Routes,
}

#[derive(Debug)]
struct Node {
    controller: Controller,
    participant: Participant,
    attempt: Option<Attempt>,
    /// Its entry in what waits.
    waits: Option<u32>,
    /// How it takes part, as last reported: as it does now, but within a bit.
    mode: Mode,
    /// When its recovery from bus-off was begun, ns.
    restarted: u64,
    power: Power,
}

/// Power of a controller.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Power {
    On,
    /// It has its power again, and waits for a bus that is idle.
    Starting,
    Off,
}

/// A frame on the way.
#[derive(Clone, Copy, Debug)]
struct Attempt {
    /// Its transmit buffer.
    buffer: usize,
    /// Its start of frame, ns.
    started: u64,
    /// Its sender was error-passive then.
    passive: bool,
}

#[derive(Clone, Copy, Debug)]
enum Phase {
    /// Recessive from here on.
    Idle { since: u64 },
    /// A frame starts.
    Start { at: u64 },
    /// A frame that nothing disturbs.
    Clean(Clean),
    /// One bit after the other; the next one.
    Bits { at: u64, pace: Pace },
}

/// A frame that nothing disturbs.
#[derive(Clone, Copy, Debug)]
struct Clean {
    node: usize,
    /// Its end: that of the intermission, ns.
    free: u64,
    stage: Stage,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Stage {
    Receive,
    Sent,
    Free,
}

impl<N: Noise> Bus<N> {
    /// A bus without controllers, idle at time 0.
    pub fn new(timing: Timing, mut noise: N) -> Self {
        let hit = noise.next();
        let phase = Phase::Idle { since: 0 };
        Self {
            timing,
            noise,
            hit,
            behind: None,
            nodes: Vec::new(),
            phase,
            next: NEVER,
            now: 0,
            busy_ns: 0,
            bit_by_bit: false,
            report_losses: true,
            report_receptions: true,
            arrivals: Vec::new(),
            waiting: VecDeque::new(),
            late: false,
            recovering: false,
            heard_errors: false,
            shorts: VecDeque::new(),
            lone: BTreeMap::new(),
            routes: Routes::default(),
        }
    }

    /// Lets undisturbed frames go bit by bit too: slower, with the same result.
    pub fn bit_by_bit(&mut self, on: bool) {
        self.bit_by_bit = on;
    }

    /// Whether lost arbitrations of undisturbed frames are reported, which they are at first. Where many controllers send at once, that is most of
    /// the events.
    pub fn report_losses(&mut self, on: bool) {
        self.report_losses = on;
    }

    /// Whether receptions of undisturbed frames are events, which they are at first. Where they are not, they are
    /// [arrivals](Self::drain_arrivals), which cost less.
    pub fn report_receptions(&mut self, on: bool) {
        self.report_receptions = on;
    }

    /// Receptions that were no events, in order, since the last call.
    pub fn drain_arrivals(&mut self) -> impl Iterator<Item = Arrival> {
        self.arrivals.drain(..)
    }

    /// Adds a controller, error-active, before time passes; its number.
    pub fn add(&mut self, order: Order, filter: Filter) -> usize {
        let controller = Controller::new(order, filter);
        self.routes = Routes::default();
        self.nodes.push(Node {
            controller,
            participant: Participant::new(),
            attempt: None,
            waits: None,
            mode: Mode::Active,
            restarted: 0,
            power: Power::On,
        });
        self.nodes.len() - 1
    }

    /// Time up to which it has gone, ns.
    pub fn now(&self) -> u64 {
        self.now
    }

    /// Time for which the bus was busy so far, from each start of frame to the end of the intermission, ns. A frame that is on the way counts in
    /// full, or bit by bit.
    pub fn busy_ns(&self) -> u64 {
        self.busy_ns
    }

    /// The same up to `at` (ns, not before [now](Self::now), and before anything else happens): what is on the way counts as far as it has come.
    pub fn busy_before(&self, at: u64) -> u64 {
        match self.phase {
            Phase::Clean(Clean { free, .. }) => self.busy_ns - free.saturating_sub(at),
            _ => self.busy_ns,
        }
    }

    /// Bit rates.
    pub fn timing(&self) -> Timing {
        self.timing
    }

    /// Gives a frame to a controller, now; whether it had a free transmit buffer. One without power has none.
    ///
    /// # Panics
    ///
    /// There is no such controller. The same holds for all that take a `node`.
    #[must_use]
    pub fn send(&mut self, node: usize, frame: Frame) -> bool {
        if let Some(lone) = self.lone.get_mut(&node) {
            return lone.send(LONE, frame);
        }
        let sender = &mut self.nodes[node];
        if sender.power == Power::Off || !sender.controller.load(&frame, self.now) {
            return false;
        }
        if sender.mode != Mode::Off {
            // What waits already is older.
            let waits = match sender.waits {
                Some(before) if sender.controller.is_by_priority() => before.min(frame.priority()),
                Some(before) => before,
                None => frame.priority(),
            };
            self.set_waiting(node, Some(waits));
        }
        match self.phase {
            Phase::Idle { since } if self.nodes[node].participant.may_begin() => {
                self.settle_idle();
                self.go(Phase::Start { at: since.max(self.now) });
            }
            Phase::Start { at } if at < self.now => self.late = true,
            _ => {}
        }
        true
    }

    /// Free transmit buffers of a controller.
    pub fn free_buffers(&self, node: usize) -> usize {
        self.seat(node).controller.free_buffers()
    }

    /// Drops the frames that wait in a controller. One that is being sent is not, but it is not tried again.
    pub fn cancel(&mut self, node: usize) {
        if let Some(lone) = self.lone.get_mut(&node) {
            return lone.cancel(LONE);
        }
        let starting = match self.phase {
            Phase::Start { at } if at <= self.now => Some(at),
            _ => None,
        };
        let Node { controller, participant, attempt, .. } = &mut self.nodes[node];
        let begun = starting.filter(|_| participant.may_begin()).and_then(|at| controller.next(at));
        controller.cancel(attempt.map(|attempt| attempt.buffer).or(begun));
        self.late |= starting.is_some();
        self.note_waiting(node);
    }

    /// Begins the recovery of a controller that is off the bus: it takes part again after 128 times 11 recessive bits. One without
    /// power stays off.
    pub fn restart(&mut self, node: usize) {
        if let Some(lone) = self.lone.get_mut(&node) {
            return lone.restart(LONE);
        }
        self.settle_idle();
        let node = &mut self.nodes[node];
        if node.power != Power::Off && node.participant.restart() {
            node.restarted = self.now;
            self.recovering = true;
        }
    }

    /// Takes the power of a controller, at once. What waits in it is dropped, and a frame that it is sending breaks off: the others see an error
    /// in it.
    pub fn switch_off(&mut self, node: usize) {
        if let Some(lone) = self.lone.get_mut(&node) {
            return lone.switch_off(LONE);
        }
        self.before_one_goes();
        self.nodes[node].lose_power();
        self.note_waiting(node);
    }

    /// Gives a controller its power again: its error counters are zero, and it takes part after eleven recessive bits.
    pub fn switch_on(&mut self, node: usize) {
        if let Some(lone) = self.lone.get_mut(&node) {
            return lone.switch_on(LONE);
        }
        self.settle_idle();
        let now = self.now;
        let node = &mut self.nodes[node];
        match node.power {
            Power::On | Power::Starting => {}
            Power::Off => {
                node.participant.switch_on();
                (node.power, node.restarted) = (Power::Starting, now);
                self.recovering = true;
            }
        }
    }

    /// Whether a controller has no power, or has just got it and takes no part yet.
    pub fn is_absent(&self, node: usize) -> bool {
        matches!(self.seat(node).power, Power::Off | Power::Starting)
    }

    /// The oldest frame in the receive FIFO of a controller, which has room for another one then.
    pub fn receive(&mut self, node: usize) -> Option<Frame> {
        self.receive_ref(node).copied()
    }

    /// The same where it is.
    pub fn receive_ref(&mut self, node: usize) -> Option<&Frame> {
        match self.lone.get_mut(&node) {
            None => self.nodes[node].controller.receive(),
            Some(lone) => lone.receive_ref(LONE),
        }
    }

    /// Frames for which the receive FIFO of a controller had no room.
    pub fn overflows(&self, node: usize) -> u64 {
        self.seat(node).controller.overflows()
    }

    /// How a controller takes part.
    pub fn mode(&self, node: usize) -> Mode {
        self.seat(node).participant.mode()
    }

    /// Error counters of a controller.
    pub fn counters(&self, node: usize) -> Counters {
        self.seat(node).participant.counters
    }

    /// A controller, on whatever wire it is.
    fn seat(&self, node: usize) -> &Node {
        self.lone.get(&node).and_then(|lone| lone.nodes.first()).unwrap_or(&self.nodes[node])
    }

    /// When something happens next, ns; never, if no frame waits, nobody recovers, and no short circuit comes. What happens to those whose
    /// connector is off is told to nobody.
    #[inline]
    pub fn next_at(&self) -> Option<u64> {
        let next = if self.recovering { self.next_recovery() } else { self.next };
        (next != NEVER).then_some(next)
    }

    /// The same where a controller may recover.
    #[cold]
    fn next_recovery(&self) -> u64 {
        let Phase::Idle { since } = self.phase else { return self.next };
        let (nominal, sample) = (self.timing.nominal().bit_ns(), self.timing.nominal().sample_ns());
        let bits = self.nodes.iter().filter_map(|node| node.participant.bits_to_recovery()).min();
        bits.map_or(self.next, |bits| self.next.min(since + (bits - 1) * nominal + sample))
    }

    fn go(&mut self, phase: Phase) {
        self.phase = phase;
        let sample = self.timing.nominal().sample_ns();
        self.next = match phase {
            // A short circuit is a start of frame for all.
            Phase::Idle { since } => {
                self.shorts.front().map_or(NEVER, |short| short.start.max(since) + sample)
            }
            Phase::Start { at } => at + sample,
            Phase::Clean(Clean { free, stage, .. }) => {
                free - u64::from(stage.bits_to_end()) * self.timing.nominal().bit_ns() + sample
            }
            Phase::Bits { at, pace } => at + self.sample_ns(pace),
        };
    }

    /// Lets time pass to `until` (ns, not before [now](Self::now)). What happens is given to `sink`, in order.
    #[inline]
    pub fn advance(&mut self, until: u64, sink: &mut impl FnMut(Event)) {
        while let Some(at) = self.next_at()
            && at <= until
        {
            self.step(at, sink);
        }
        self.now = self.now.max(until);
        if !self.lone.is_empty() {
            self.advance_lone();
        }
    }

    /// Lets happen what happens next, which is at `at`.
    fn step(&mut self, at: u64, sink: &mut impl FnMut(Event)) {
        self.now = at;
        match self.phase {
            Phase::Idle { since } if self.next <= at => self.be_shorted(since, sink),
            Phase::Idle { .. } => self.recover(sink),
            Phase::Start { at } => self.start(at, sink),
            Phase::Clean(clean) => self.clean(clean, sink),
            Phase::Bits { at, pace } => self.bit(at, pace, sink),
        }
    }

    /// Controllers that recover take the recessive bits of an idle bus until now.
    fn settle_idle(&mut self) {
        let (bit, sample) = (self.timing.nominal().bit_ns(), self.timing.nominal().sample_ns());
        let now = self.now;
        let Phase::Idle { since } = &mut self.phase else { return };
        if now < *since + sample {
            return;
        }
        let bits = (now - *since - sample) / bit + 1;
        *since += bits * bit;
        if self.recovering {
            self.nodes.iter_mut().for_each(|node| node.participant.pass_recessive(bits));
        }
    }

    fn recover(&mut self, sink: &mut impl FnMut(Event)) {
        self.settle_idle();
        self.report_modes(sink);
        self.note_all();
        if let Phase::Idle { since } = self.phase {
            self.begin_or_idle(since);
        }
    }

    /// The bus is recessive, and free from `at` on.
    fn begin_or_idle(&mut self, at: u64) {
        self.go(if self.waiting.is_empty() { Phase::Idle { since: at } } else { Phase::Start { at } });
    }

    /// Notes with what a controller would take part in an arbitration.
    fn note_waiting(&mut self, number: usize) {
        let node = &mut self.nodes[number];
        let next = if node.participant.mode() == Mode::Off { None } else { node.controller.next(self.now) };
        let waits =
            next.and_then(|buffer| node.controller.pending(buffer)).map(|pending| pending.frame.priority());
        self.set_waiting(number, waits);
    }

    /// The same of one that has just sent a frame.
    fn note_after_sent(&mut self, number: usize) {
        let node = &self.nodes[number];
        if node.controller.free_buffers() == TRANSMIT_BUFFERS {
            self.set_waiting(number, None);
        } else {
            self.note_waiting(number);
        }
    }

    /// Notes that a controller would take part with a frame of this priority. Who wins goes most often, and who comes is mostly behind all
    /// others: both ends are looked at first.
    fn set_waiting(&mut self, number: usize, waits: Option<u32>) {
        let before = std::mem::replace(&mut self.nodes[number].waits, waits);
        if before == waits {
            return;
        }
        let place = |waiting: &VecDeque<_>, entry| waiting.partition_point(|&other| other > entry);
        if let Some(before) = before {
            if self.waiting.back() == Some(&(before, number)) {
                self.waiting.pop_back();
            } else {
                let at = place(&self.waiting, (before, number));
                self.waiting.remove(at);
            }
        }
        if let Some(waits) = waits {
            let entry = (waits, number);
            if self.waiting.front().is_none_or(|front| *front < entry) {
                self.waiting.push_front(entry);
            } else {
                let at = place(&self.waiting, entry);
                self.waiting.insert(at, entry);
            }
        }
    }

    /// Notes what may have changed anywhere.
    fn note_all(&mut self) {
        (0..self.nodes.len()).for_each(|node| self.note_waiting(node));
        self.recovering = self.nodes.iter().any(|node| node.participant.is_recovering());
        self.heard_errors = self.nodes.iter().any(|node| node.participant.counters.receive > 0);
    }

    fn report_modes(&mut self, sink: &mut impl FnMut(Event)) {
        for (at, node) in self.nodes.iter_mut().enumerate() {
            node.report_mode(self.now, at, sink);
        }
    }

    /// The sample point of a start of frame: all that have a frame by now take part in the arbitration.
    fn start(&mut self, at: u64, sink: &mut impl FnMut(Event)) {
        let late = std::mem::take(&mut self.late);
        let mut best = self.waiting.iter().rev();
        let Some(&(priority, node)) = best.next() else {
            self.go(Phase::Idle { since: at });
            return;
        };
        let collides = best.next().is_some_and(|&(next, _)| next == priority);
        if let Some(strike) = self.noise.strike(at, node) {
            self.strike(at, node, strike);
        }
        let clean = if late || collides || self.bit_by_bit { None } else { self.clean_frame(at, node) };
        match clean {
            Some((clean, buffer, length)) => self.begin_clean(at, clean, buffer, length, sink),
            None => self.bit(at, Pace::Nominal, sink),
        }
    }

    /// A bit of the frame that `node` begins is to be disturbed, unless one before it is.
    fn strike(&mut self, at: u64, node: usize, strike: Strike) {
        let sender = &self.nodes[node];
        let Some(pending) = sender.controller.next(at).and_then(|buffer| sender.controller.pending(buffer))
        else {
            return;
        };
        let passive = sender.participant.mode() == Mode::Passive;
        let bits = Length::of(&pending.frame, passive).bits() - ACKNOWLEDGEMENT - END - INTERMISSION;
        let after = (u64::from(bits) * u64::from(strike.place)) >> 32;
        if self.behind.is_some() || self.hit.is_some_and(|hit| hit.after <= after) {
            return;
        }
        let rest = |hit: Hit| Hit { after: hit.after - after - 1, ..hit };
        self.behind = Some(self.hit.map(rest));
        self.hit = Some(Hit { after, seen_by: strike.seen_by });
    }

    /// The frame as one step, if nothing disturbs it: its sender is error-active, another one acknowledges, no bit is hit.
    fn clean_frame(&self, at: u64, node: usize) -> Option<(Clean, usize, Length)> {
        let is_on = |node: &Node| node.mode != Mode::Off;
        let acknowledged =
            self.nodes.iter().enumerate().any(|(number, other)| number != node && is_on(other));
        let sender = &self.nodes[node];
        let buffer = sender.controller.next(at)?;
        let length = Length::of(&sender.controller.pending(buffer)?.frame, false);
        let hit = self.hit.is_some_and(|hit| hit.after < u64::from(length.bits()));
        let clean = Clean { node, free: at + length.ns(self.timing), stage: Stage::Receive };
        let shorted = self.shorts.front().is_some_and(|short| short.start < clean.free);
        (acknowledged && !hit && !shorted && sender.mode == Mode::Active).then_some((clean, buffer, length))
    }

    fn begin_clean(
        &mut self,
        at: u64,
        clean: Clean,
        buffer: usize,
        length: Length,
        sink: &mut impl FnMut(Event),
    ) {
        if let Some(hit) = &mut self.hit {
            hit.after -= u64::from(length.bits());
        }
        self.busy_ns += clean.free - at;
        self.nodes[clean.node].attempt = Some(Attempt { buffer, started: at, passive: false });
        self.go(Phase::Clean(clean));
        if self.report_losses {
            self.report_losers(clean.node, sink);
        }
    }

    fn report_losers(&self, winner: usize, sink: &mut impl FnMut(Event)) {
        let to = self.nodes[winner].waits.map(Id::of_priority);
        for &(priority, node) in self.waiting.iter().rev().filter(|(_, node)| *node != winner) {
            let what = What::LostArbitration { id: Id::of_priority(priority), to };
            sink(Event { at: self.now, node, what });
        }
    }

    fn clean(&mut self, clean: Clean, sink: &mut impl FnMut(Event)) {
        let at = self.now;
        let node = &mut self.nodes[clean.node];
        match clean.stage {
            Stage::Receive => {
                let frame = node.sent().map(|pending| pending.frame);
                if let Some(frame) = frame {
                    self.receive_clean(clean.node, &frame, sink);
                }
                self.go(Phase::Clean(Clean { stage: Stage::Sent, ..clean }));
            }
            Stage::Sent => {
                node.participant.counters.sent();
                node.report_sent(at, clean.node, sink);
                node.report_mode(at, clean.node, sink);
                self.note_after_sent(clean.node);
                self.go(Phase::Clean(Clean { stage: Stage::Free, ..clean }));
            }
            Stage::Free => {
                if self.recovering {
                    self.recover_after(clean);
                    self.report_modes(sink);
                    self.note_all();
                }
                self.begin_or_idle(clean.free);
            }
        }
    }

    fn receive_clean(&mut self, sender: usize, frame: &Frame, sink: &mut impl FnMut(Event)) {
        if self.heard_errors {
            self.count_received(sender, sink);
        }
        let (at, id) = (self.now, frame.id());
        if let Id::Base(base) = id {
            self.routes.learn(base, &self.nodes);
        }
        let Self { nodes, routes, arrivals, report_receptions, .. } = self;
        let mut take = |(number, node): (usize, &mut Node)| {
            if number == sender || node.mode == Mode::Off {
                return;
            }
            if *report_receptions {
                node.take_received(at, number, frame, sink);
            } else {
                let lost = !node.controller.deliver(frame);
                arrivals.push(Arrival { at, node: number, lost });
            }
        };
        match id {
            Id::Base(base) => {
                routes.of(base).iter().for_each(|&number| take((number, &mut nodes[number])));
            }
            Id::Extended(_) => {
                let keeps = |(_, node): &(usize, &mut Node)| node.controller.filter.keeps(id);
                nodes.iter_mut().enumerate().filter(keeps).for_each(take);
            }
        }
    }

    fn count_received(&mut self, sender: usize, sink: &mut impl FnMut(Event)) {
        self.heard_errors = false;
        for (number, node) in self.nodes.iter_mut().enumerate() {
            if number != sender && node.participant.mode() != Mode::Off {
                node.participant.counters.received();
                node.report_mode(self.now, number, sink);
            }
            self.heard_errors |= node.participant.counters.receive > 0;
        }
    }

    /// Controllers that recover have seen dominant bits, and then the recessive ones of a frame's end, as far as they were there.
    fn recover_after(&mut self, clean: Clean) {
        let (bit, sample) = (self.timing.nominal().bit_ns(), self.timing.nominal().sample_ns());
        for node in self.nodes.iter_mut().filter(|node| node.participant.is_recovering()) {
            let seen =
                (1..=RECESSIVE_END).filter(|back| clean.free - back * bit + sample > node.restarted).count();
            node.participant.pass_dominant();
            node.participant.pass_recessive(seen as u64);
        }
    }

    /// The sample point of a bit that began at `at`.
    fn bit(&mut self, at: u64, pace: Pace, sink: &mut impl FnMut(Event)) {
        let shorted = self.is_shorted(self.now);
        let level = self.level(at) && !shorted;
        let busy = shorted || self.nodes.iter().any(|node| node.participant.is_busy());
        // What is shorted is not disturbed.
        let flipped = if busy && !shorted { self.disturbed() } else { None };
        let mut lost = Vec::new();
        for (number, node) in self.nodes.iter_mut().enumerate() {
            if node.is_yet_to_restart(self.now) {
                continue;
            }
            let wrong = match flipped {
                Some(SeenBy::All) => true,
                Some(SeenBy::One(one)) => one == number,
                None => false,
            };
            let happening = node.participant.sample(level != wrong);
            if happening == Some(Happening::LostArbitration) {
                lost.push(number);
            } else if let Some(happening) = happening {
                node.report(happening, self.now, number, sink);
            }
            node.report_mode(self.now, number, sink);
        }
        self.report_lost(&lost, sink);
        let next = at + self.bit_ns(pace);
        if busy {
            self.busy_ns += next - at;
        }
        if !self.is_shorted(next) && self.nodes.iter().all(|node| node.participant.is_quiet()) {
            self.note_all();
            self.begin_or_idle(next);
        } else {
            self.go(Phase::Bits { at: next, pace: self.pace() });
        }
    }

    /// The level of a bit that began at `at`, with all that begin to send in it.
    fn level(&mut self, at: u64) -> bool {
        let mut level = RECESSIVE;
        for node in &mut self.nodes {
            if node.participant.may_begin() {
                node.begin(at, at);
            }
            level &= node.participant.drives();
        }
        if level == DOMINANT || self.is_shorted(self.now) {
            for node in self.nodes.iter_mut().filter(|node| node.participant.may_join()) {
                node.begin(at, self.now);
            }
        }
        level
    }

    /// Who reads this bit as its opposite.
    fn disturbed(&mut self) -> Option<SeenBy> {
        let hit = self.hit.as_mut()?;
        if hit.after > 0 {
            hit.after -= 1;
            return None;
        }
        let seen_by = hit.seen_by;
        // A strike has been drawn for the frame that it hits.
        let (next, is_real) = match self.behind.take() {
            Some(behind) => (behind, true),
            None => (self.noise.next(), self.noise.is_real(self.now)),
        };
        self.hit = next;
        is_real.then_some(seen_by)
    }

    fn report_lost(&mut self, lost: &[usize], sink: &mut impl FnMut(Event)) {
        if lost.is_empty() {
            return;
        }
        let sending = |node: &Node| node.participant.is_sending();
        let winners = self
            .nodes
            .iter()
            .filter(|node| sending(node))
            .filter_map(|node| node.sent())
            .map(|sent| sent.frame);
        let to = winners.min_by_key(Frame::priority).map(|frame| frame.id());
        for &node in lost {
            let id = self.nodes[node].sent().map(|pending| pending.frame.id());
            self.nodes[node].failed(false);
            if let Some(id) = id {
                sink(Event { at: self.now, node, what: What::LostArbitration { id, to } });
            }
        }
    }

    /// How long the next bit lasts: as its sender says, but for flags, which have the nominal rate.
    fn pace(&self) -> Pace {
        let participants = || self.nodes.iter().map(|node| &node.participant);
        if participants().any(Participant::marks_error) {
            return Pace::Nominal;
        }
        participants().find_map(Participant::pace).unwrap_or(Pace::Nominal)
    }

    fn sample_ns(&self, pace: Pace) -> u64 {
        match pace {
            Pace::Nominal | Pace::Up => self.timing.nominal().sample_ns(),
            Pace::Fast | Pace::Down => self.timing.data().sample_ns(),
        }
    }

    fn bit_ns(&self, pace: Pace) -> u64 {
        let (nominal, data) = (self.timing.nominal(), self.timing.data());
        match pace {
            Pace::Nominal => nominal.bit_ns(),
            Pace::Fast => data.bit_ns(),
            Pace::Up => nominal.sample_ns() + data.bit_ns() - data.sample_ns(),
            Pace::Down => data.sample_ns() + nominal.bit_ns() - nominal.sample_ns(),
        }
    }
}

/// Who keeps the frames of an 11-bit identifier, as far as that was asked. Filters do not change.
#[derive(Debug, Default)]
struct Routes {
    base: Vec<Option<Vec<usize>>>,
}

impl Routes {
    /// Finds out which controllers keep an identifier, unless that is known.
    fn learn(&mut self, id: u16, nodes: &[Node]) {
        if self.base.get(usize::from(id)).is_none_or(Option::is_none) {
            self.ask(id, nodes);
        }
    }

    #[cold]
    fn ask(&mut self, id: u16, nodes: &[Node]) {
        let at = usize::from(id);
        if self.base.len() <= at {
            self.base.resize(usize::from(LARGEST_BASE) + 1, None);
        }
        if self.base[at].is_none() {
            let keeps = |number: &usize| nodes[*number].controller.filter.keeps(Id::Base(id));
            self.base[at] = Some((0..nodes.len()).filter(keeps).collect());
        }
    }

    /// Those that keep it.
    fn of(&self, id: u16) -> &[usize] {
        self.base.get(usize::from(id)).and_then(Option::as_deref).unwrap_or_default()
    }
}

/// Recessive bits after an acknowledgement: its delimiter, the end of frame, the intermission.
const RECESSIVE_END: u64 = 1 + (END + INTERMISSION) as u64;

impl Stage {
    /// Bits from the beginning of the one in which it is to the end of the intermission.
    fn bits_to_end(self) -> u32 {
        match self {
            // The last bit but one of the end of frame, the last one, and the last of the intermission.
            Self::Receive => INTERMISSION + 2,
            Self::Sent => INTERMISSION + 1,
            Self::Free => 1,
        }
    }
}

impl Node {
    /// The frame that it is sending.
    fn sent(&self) -> Option<&Pending> {
        self.attempt.and_then(|attempt| self.controller.pending(attempt.buffer))
    }

    /// Begins to send a frame that came until `by`, if there is one, in the bit that began at `at`.
    fn begin(&mut self, at: u64, by: u64) {
        let Some(buffer) = self.controller.next(by) else { return };
        if let Some(pending) = self.controller.pending(buffer) {
            let passive = self.participant.mode() == Mode::Passive;
            self.participant.begin(&pending.frame, passive);
            self.attempt = Some(Attempt { buffer, started: at, passive });
        }
    }

    /// Whether it begins to recover later than now, which is while the begin of a frame is gone through once more.
    fn is_yet_to_restart(&self, now: u64) -> bool {
        self.restarted > now && self.participant.is_recovering()
    }

    fn lose_power(&mut self) {
        self.controller.clear();
        self.participant.switch_off();
        (self.attempt, self.mode, self.power) = (None, Mode::Off, Power::Off);
    }

    /// The attempt that was on the way, if one was, has not succeeded.
    fn failed(&mut self, error: bool) {
        if let Some(attempt) = self.attempt.take() {
            self.controller.failed(attempt.buffer, error);
        }
    }

    fn report(&mut self, happening: Happening, at: u64, node: usize, sink: &mut impl FnMut(Event)) {
        match happening {
            Happening::Received(frame) => self.report_received(at, node, &frame, sink),
            Happening::Sent => self.report_sent(at, node, sink),
            Happening::Overload => sink(Event { at, node, what: What::Overload }),
            Happening::LostArbitration => self.failed(false),
            Happening::Error { kind, field, sender } => {
                self.failed(true);
                let counters = self.participant.counters;
                sink(Event { at, node, what: What::Error { kind, field, sender, counters } });
            }
        }
    }

    fn report_received(&mut self, at: u64, node: usize, frame: &Frame, sink: &mut impl FnMut(Event)) {
        if self.controller.filter.keeps(frame.id()) {
            self.take_received(at, node, frame, sink);
        }
    }

    /// Takes a frame that its filter keeps.
    fn take_received(&mut self, at: u64, node: usize, frame: &Frame, sink: &mut impl FnMut(Event)) {
        let lost = !self.controller.deliver(frame);
        sink(Event { at, node, what: What::Received { id: frame.id(), lost } });
    }

    fn report_sent(&mut self, at: u64, node: usize, sink: &mut impl FnMut(Event)) {
        let Some(Attempt { buffer, started, passive }) = self.attempt.take() else { return };
        if let Some(&Pending { frame, ready, errors, .. }) = self.controller.pending(buffer) {
            self.controller.remove(buffer);
            sink(Event { at, node, what: What::Sent { frame, passive, ready, started, errors } });
        }
    }

    fn report_mode(&mut self, at: u64, node: usize, sink: &mut impl FnMut(Event)) {
        let mode = self.participant.mode();
        if std::mem::replace(&mut self.mode, mode) != mode {
            if self.power == Power::Starting {
                // That is no recovery.
                self.power = Power::On;
                return;
            }
            sink(Event { at, node, what: What::Mode { mode, counters: self.participant.counters } });
        }
    }
}
