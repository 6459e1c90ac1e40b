//! The sans-IO node: messages and time in, actions out. Firmware, simulator and tests drive this one state machine.
//!
//! Order of a tick `k`: the states `x_j(k)` have been heard; `nu`, funnel and input follow; the state is advanced to
//! `k + 1` and sent at once, so that it has a whole period to reach the neighbours (docs/notes/2026-11-23-first-light.md).

use crate::field::{AffineSines, VectorField, midpoint_step};
use crate::funnel::Widths;
use crate::gain::{BuiltinGain, Gain};
use crate::law::node_wise::Memory;
use crate::math::Real;
use crate::neighbour::{Heard, Own, Sums};
use crate::observe::{Event, Observation, Phase};
use crate::params::Params;
use funnel_protocol::config::TickSource;
use funnel_protocol::message::{Command, Component, FaultCode, Message, NodeId, Severity, TickStamp};
use funnel_protocol::refusal::Refusal;
use funnel_protocol::report::{Counters, Report, count};
use heapless::Deque;

/// Events that wait for the app at most; more are dropped, oldest first kept.
const EVENT_CAPACITY: usize = 8;
/// Late ticks that one call of [`Node::poll`] makes up for at most.
pub const CATCH_UP_LIMIT: u32 = 4;
/// Ticks that a SYNC may skip before it is taken for a stray one.
const SYNC_AHEAD: u32 = 1000;

/// What the app shall do next.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Action {
    /// Put this message on the link.
    Send(Message),
    /// Log or show this event.
    Report(Event),
}

/// A node of the network.
#[derive(Clone, Debug)]
pub struct Node<F = f32, V = AffineSines<F>, G = BuiltinGain<F>> {
    params: Params<F, V, G>,
    phase: Phase,
    /// Tick that is computed next.
    tick: u32,
    x: F,
    /// What rounding has left behind in `x` (compensated summation).
    carry: F,
    /// Change of `x` over the last tick.
    dx: F,
    memory: Memory<F>,
    schedule: Schedule,
    /// Latest value wins: a state that was not fetched before the next one is replaced.
    outgoing: Option<Message>,
    events: Deque<Event, EVENT_CAPACITY>,
    observation: Observation<F>,
    in_breach: bool,
    floored: bool,
    max_ratio: F,
    counters: Counters,
}

/// When the next tick is due.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Schedule {
    /// Not before a SYNC or a start.
    Wait,
    /// Now: a SYNC has come.
    Now,
    /// At this time, ns.
    At(u64),
}

impl<F: Real, V: VectorField<F>, G: Gain<F>> Node<F, V, G> {
    /// A node in phase `Ready`.
    pub fn new(params: Params<F, V, G>) -> Self {
        Self {
            phase: Phase::Ready,
            tick: 0,
            x: params.initial_state,
            carry: F::ZERO,
            dx: F::ZERO,
            memory: Memory::default(),
            schedule: Schedule::Wait,
            outgoing: None,
            events: Deque::new(),
            observation: Observation { x: params.initial_state, ..Observation::default() },
            in_breach: false,
            floored: false,
            max_ratio: F::ZERO,
            counters: Counters::default(),
            params,
        }
    }

    /// Own id.
    pub fn id(&self) -> NodeId {
        self.params.id
    }

    /// Phase.
    pub fn phase(&self) -> Phase {
        self.phase
    }

    /// State at the tick that is computed next, state units.
    pub fn state(&self) -> F {
        self.x
    }

    /// Tick that is computed next.
    pub fn tick(&self) -> u32 {
        self.tick
    }

    /// What the law did at the last tick.
    pub fn observation(&self) -> &Observation<F> {
        &self.observation
    }

    /// Counters.
    pub fn counters(&self) -> &Counters {
        &self.counters
    }

    /// The closing report.
    pub fn report(&self) -> Report {
        Report { max_ratio: self.max_ratio.to_f32(), counters: self.counters.clone() }
    }

    /// Counts a frame that the link could not decode.
    pub fn refuse(&mut self, reason: Refusal) {
        self.counters.refuse(reason);
    }

    /// When [`Node::poll`] has something to do next, ns on the caller's clock; `None`: not before a message.
    pub fn poll_at(&self) -> Option<u64> {
        if self.outgoing.is_some() || !self.events.is_empty() {
            return Some(0);
        }
        match self.schedule {
            Schedule::Wait => None,
            Schedule::Now => Some(0),
            Schedule::At(time) => Some(time),
        }
    }

    /// Takes a message that arrived at `now` (ns).
    ///
    /// # Errors
    /// The reason for refusing it, counted; a refused message changes nothing else. A state that carries the node's own
    /// id is refused and stops the node: two nodes with one id would each falsify the other's edges.
    pub fn on_message(&mut self, message: &Message, now: u64) -> Result<(), Refusal> {
        let outcome = match *message {
            Message::State { source, component, tick, x } => {
                self.on_state(source, component, tick, F::from_f32(x))
            }
            Message::Sync { previous_tick, .. } => self.on_sync(previous_tick),
            Message::Ctrl { target, command, at_tick, .. } if target.includes(self.params.id) => {
                self.on_command(command, at_tick, now)
            }
            Message::Ctrl { .. } => Ok(()),
            Message::Fault { source, .. } => self.on_fault(source),
        };
        match outcome {
            Ok(()) => count(&mut self.counters.accepted),
            Err(reason) => self.counters.refuse(reason),
        }
        outcome
    }

    /// Does what is due at `now` (ns) and gives the next action; call it until it gives `None`.
    ///
    /// Bounded: at most [`CATCH_UP_LIMIT`] ticks per call. Ticks that came late are made up for and counted; of their
    /// states only the latest is worth sending.
    pub fn poll(&mut self, now: u64) -> Option<Action> {
        for _ in 0..CATCH_UP_LIMIT {
            if !self.tick_is_due(now) {
                break;
            }
            self.run_tick();
        }
        if let Some(event) = self.events.pop_front() {
            return Some(Action::Report(event));
        }
        let message = self.outgoing.take()?;
        count(&mut self.counters.sent);
        Some(Action::Send(message))
    }

    fn on_state(
        &mut self,
        source: NodeId,
        component: Component,
        tick: TickStamp,
        x: F,
    ) -> Result<(), Refusal> {
        if source == self.params.id {
            self.fault(FaultCode::DUPLICATE_ID);
            return Err(Refusal::OwnId);
        }
        if component != Component::FIRST {
            return Err(Refusal::Value);
        }
        if !x.is_finite() {
            return Err(Refusal::NotFinite);
        }
        if x.abs() > self.params.state_limit {
            return Err(Refusal::OutOfRange);
        }
        match self.params.neighbours.hear(source, tick, self.tick, x)? {
            Heard::First => self.report_event(Event::NeighbourFound(source)),
            Heard::Newer => {}
        }
        Ok(())
    }

    /// In sync mode each SYNC marks one tick: the one after `previous`. A repeated SYNC is a duplicate; a later one means
    /// that ticks were missed: the node follows the master's count and says how many.
    fn on_sync(&mut self, previous: TickStamp) -> Result<(), Refusal> {
        if self.params.tick_source != TickSource::Sync {
            return Ok(());
        }
        if self.phase != Phase::Running {
            return Err(Refusal::Phase);
        }
        let due = self.tick.wrapping_add(u32::from(self.schedule == Schedule::Now));
        let last = previous.rebuild(due.wrapping_sub(1), 0, SYNC_AHEAD).ok_or(Refusal::TickWindow)?;
        let marked = last.wrapping_add(1);
        if self.schedule == Schedule::Now || marked != self.tick {
            let missed = marked.wrapping_sub(self.tick);
            count(&mut self.counters.sync_gaps);
            self.report_event(Event::SyncGap { missed });
            self.tick = marked;
        }
        self.schedule = Schedule::Now;
        Ok(())
    }

    fn on_command(&mut self, command: Command, at_tick: u16, now: u64) -> Result<(), Refusal> {
        match (command, self.phase) {
            (Command::Start, Phase::Ready) => {
                self.phase = Phase::Running;
                self.outgoing = Some(self.state_message());
                self.schedule = match self.params.tick_source {
                    TickSource::Sync => Schedule::Wait,
                    // One period for the announced initial states to arrive, then tick 0.
                    TickSource::Timer => Schedule::At(now + (u64::from(at_tick) + 1) * self.params.tick_ns),
                };
                self.report_event(Event::Started);
                Ok(())
            }
            (Command::Stop, Phase::Ready | Phase::Running) => {
                self.halt(Phase::Stopped);
                self.report_event(Event::Stopped);
                Ok(())
            }
            _ => Err(Refusal::Phase),
        }
    }

    fn on_fault(&mut self, source: NodeId) -> Result<(), Refusal> {
        if source == self.params.id {
            self.fault(FaultCode::DUPLICATE_ID);
            return Err(Refusal::OwnId);
        }
        Ok(())
    }

    fn tick_is_due(&mut self, now: u64) -> bool {
        match self.schedule {
            Schedule::Wait => false,
            Schedule::Now => {
                self.schedule = Schedule::Wait;
                true
            }
            Schedule::At(due) if now >= due => {
                let next = due + self.params.tick_ns;
                if now >= next {
                    count(&mut self.counters.overruns);
                }
                self.schedule = Schedule::At(next);
                true
            }
            Schedule::At(_) => false,
        }
    }

    fn run_tick(&mut self) {
        let k = self.tick;
        let own = Own { x: self.x, carry: self.carry, dx: self.dx };
        let sums = self.params.neighbours.sums(k, own);
        self.note_neighbours(&sums);
        let psi = self.floored_widths(k, sums.largest);
        let ratio = sums.nu.abs() / psi.now;
        self.judge(k, ratio);
        let solution = self.params.law.step(&mut self.memory, sums.nu, sums.dnu, psi);
        self.observation =
            Observation { tick: k, x: self.x, nu: sums.nu, psi: psi.now, ratio, u: solution.u };

        let before = self.x;
        midpoint_step(&self.params.field, self.params.tick, k, &mut self.x, &mut self.carry, solution.u);
        // Of `x` as neighbours see it: their `dnu` and this node's then add up to zero, as `nu` must, which the carry
        // would spoil (28 times the emergent error on scenarios/asymptotic-path-11.toml).
        self.dx = self.x - before;
        self.tick = k.wrapping_add(1);
        count(&mut self.counters.ticks);
        if self.x.abs() <= self.params.state_limit {
            self.outgoing = Some(self.state_message());
        } else {
            self.x = before;
            self.fault(FaultCode::STATE_LIMIT);
        }
    }

    /// The funnel at tick `k`, not narrower than what the rounding of `nu` can resolve (LAW.md 4).
    fn floored_widths(&mut self, k: u32, largest: F) -> Widths<F> {
        let psi = self.params.funnel.widths(k);
        let floor = (self.params.floor_per_state * largest).max(F::TINY);
        if psi.ahead > floor {
            return psi;
        }
        count(&mut self.counters.floored);
        if !self.floored {
            self.floored = true;
            self.report_event(Event::FunnelFloored { tick: k, width: floor.to_f32() });
        }
        Widths { now: psi.now.max(floor), ahead: floor }
    }

    /// Counts a breach and says when it begins and ends; the law rides on (LAW.md 5).
    fn judge(&mut self, k: u32, ratio: F) {
        self.max_ratio = self.max_ratio.max(ratio);
        let breach = ratio >= F::ONE;
        if breach {
            count(&mut self.counters.breaches);
        }
        if breach != self.in_breach {
            self.in_breach = breach;
            self.report_event(match breach {
                true => Event::BreachBegan { tick: k, ratio: ratio.to_f32() },
                false => Event::BreachEnded { tick: k },
            });
        }
    }

    fn note_neighbours(&mut self, sums: &Sums<F>) {
        self.counters.extrapolated = self.counters.extrapolated.saturating_add(sums.extrapolated);
        self.counters.neighbours_lost = self.counters.neighbours_lost.saturating_add(sums.lost_count);
        if let Some(id) = sums.lost {
            self.report_event(Event::NeighbourLost(id));
        }
    }

    fn state_message(&self) -> Message {
        Message::State {
            source: self.params.id,
            component: Component::FIRST,
            tick: TickStamp::full(self.tick),
            x: self.x.to_f32(),
        }
    }

    fn halt(&mut self, phase: Phase) {
        self.phase = phase;
        self.schedule = Schedule::Wait;
        self.outgoing = None;
    }

    /// Stops, says so once on the link, and stays silent.
    fn fault(&mut self, code: FaultCode) {
        if matches!(self.phase, Phase::Faulted(_)) {
            return;
        }
        self.halt(Phase::Faulted(code));
        self.outgoing = Some(Message::Fault {
            source: self.params.id,
            code,
            severity: Severity::Stopped,
            arg: u16::from(self.params.id.get()),
            tick: TickStamp::full(self.tick),
        });
        self.report_event(Event::Fault(code));
    }

    fn report_event(&mut self, event: Event) {
        // A full queue keeps the oldest events: they tell the cause.
        let _ = self.events.push_back(event);
    }
}
