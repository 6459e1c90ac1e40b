//! The sans-IO node: messages and time in, actions out. Firmware, simulator and tests drive this one state machine.
//!
//! Order of a tick `k`: the states `x_j(k)` have been heard; `nu`, funnel and input follow; the state is advanced to
//! `k + 1` and sent at once, so that it has a whole period to reach the neighbours (docs/notes/2026-11-23-first-light.md).

pub mod adopt;
mod plant;

use crate::feeding::Progress;
use crate::neighbour::{EdgeFunnel, Heard, Neighbours, Own, Presence};
use crate::observe::{Event, Observation, Phase};
use crate::params::{OnBreach, Params};
use crate::plant::{Plant, Purpose, Step};
use funnelnet_law::collect::collect;
use funnelnet_law::field::{AffineSines, State, VectorField, compensated_add, midpoint_step};
use funnelnet_law::funnel::Widths;
use funnelnet_law::gain::{Gain, GainFunction};
use funnelnet_law::law::max_gain::{self, Term};
use funnelnet_law::law::node_wise::Memory;
use funnelnet_law::law::{EdgeWise, Law};
use funnelnet_law::math::{Real, larger};
use funnelnet_protocol::config::{EdgeConfig, MAX_COMPONENTS, TickSource};
use funnelnet_protocol::message::{Command, Component, FaultCode, Message, NodeId, Severity, TickStamp};
use funnelnet_protocol::refusal::Refusal;
use funnelnet_protocol::report::{Counters, Report, count};
use heapless::{Deque, Vec};

/// Events that wait for the app at most; more are dropped, oldest first kept.
const EVENT_CAPACITY: usize = 8;
/// Late ticks that a virtual node makes up for at most, however late it comes; it skips those before them.
pub const CATCH_UP_LIMIT: u32 = 4;
/// Ticks that a SYNC may skip before it is taken for a stray one.
const SYNC_AHEAD: u32 = 1000;
/// The same before the first tick of a node that joins late: half of what the 24 bits of a SYNC can tell.
const JOIN_AHEAD: u32 = (1 << 23) - 1;

/// What the app shall do next.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Action {
    /// Put this message on the link.
    Send(Message),
    /// Log or show this event.
    Report(Event),
    /// Put the actuator in its safe position: the node has stopped, whatever the reason.
    Safe,
    /// Measure the plant, and answer by [`Node::measured`] or [`Node::sample_failed`]: a tick waits for it.
    Sample,
    /// Drive the actuator with [`Node::inputs`].
    Actuate,
}

/// A node of the network.
#[derive(Clone, Debug)]
pub struct Node<F = f32, V = AffineSines<F>, G = Gain<F>> {
    params: Params<F, V, G>,
    neighbours: Neighbours<F>,
    phase: Phase,
    /// Tick that is computed next.
    tick: u32,
    /// One per component of the state.
    parts: Vec<Part<F>, MAX_COMPONENTS>,
    observations: Vec<Observation<F>, MAX_COMPONENTS>,
    schedule: Schedule,
    /// Time of the last SYNC that was taken, or of the start, ns.
    synced: u64,
    /// Ticks that this node was moved on over without running them, modulo 2^32.
    skipped: u32,
    /// Tick before whose law the node is given other parameters.
    commit: Option<u32>,
    outgoing: Outgoing,
    /// A virtual node has none.
    plant: Option<Plant<F>>,
    step: Step,
    events: Deque<Event, EVENT_CAPACITY>,
    in_breach: bool,
    /// The last tick of the timer came a whole period late or more.
    late: bool,
    /// What a breach has added to the funnel, state units, at the tick that is computed next.
    reopened: F,
    floored: bool,
    max_ratio: F,
    counters: Counters,
}

/// One component of the state, and what belongs to it.
#[derive(Clone, Copy, Debug, Default)]
struct Part<F> {
    x: F,
    /// What rounding has left behind in `x` (compensated summation).
    carry: F,
    /// Change of `x` over the last tick.
    dx: F,
    /// Diffusive term and its change over the last tick.
    nu: F,
    dnu: F,
    /// Input of this tick, state units / s.
    u: F,
    memory: Memory<F>,
    /// Gain of a lambda-tracker, 1/s.
    k: F,
}

impl<F: Real> Part<F> {
    fn own(&self) -> Own<F> {
        Own { x: self.x, dx: self.dx }
    }

    /// Replaces the prediction by the measurement `x` of the same tick.
    fn correct(&mut self, x: F) {
        self.dx += x - self.x;
        (self.x, self.carry) = (x, F::ZERO);
    }
}

/// What waits for the link. Latest value wins: states that were not fetched before the next tick are replaced.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
struct Outgoing {
    fault: Option<Message>,
    /// Components to send, by bit.
    states: u8,
    /// Edges that are still to be announced.
    edges_left: u8,
    /// Whether the next of them may be announced at this tick.
    announce: bool,
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

impl<F: Real, V: VectorField<F>, G: GainFunction<F>> Node<F, V, G> {
    /// A node in phase `Ready`; `edges` are those that `params` were validated with.
    pub fn new(params: Params<F, V, G>, edges: &[EdgeConfig]) -> Self {
        let mut node = Self::alone(params);
        node.meet(edges);
        node
    }

    /// A node without its edges, still to be given by [`Node::meet`].
    // Into its callers, so that it is made where it stays: of an empty table nothing is written then, let alone moved.
    #[inline(always)]
    pub(crate) fn alone(params: Params<F, V, G>) -> Self {
        // A tracker starts from the slope of its linear gain.
        let k = params.law.gain.apply(F::ONE);
        let states = params.initial_state.iter();
        Self {
            phase: Phase::Ready,
            tick: 0,
            parts: collect(states.clone().map(|&x| Part { x, k, ..Part::default() })),
            observations: collect(states.map(|&x| Observation { x, ..Observation::default() })),
            schedule: Schedule::Wait,
            synced: 0,
            skipped: 0,
            commit: None,
            outgoing: Outgoing::default(),
            neighbours: Neighbours::new(params.initial_state.len() as u8),
            plant: params.plant.clone().map(Plant::new),
            step: Step::Idle,
            events: Deque::new(),
            in_breach: false,
            late: false,
            reopened: F::ZERO,
            floored: false,
            max_ratio: F::ZERO,
            counters: Counters::default(),
            params,
        }
    }

    /// Makes its table of these edges. What it has heard of neighbours that stay it still knows.
    pub(crate) fn meet(&mut self, edges: &[EdgeConfig]) {
        self.neighbours.set(edges, self.params.extrapolate_ticks);
        self.outgoing.edges_left = self.neighbours.count() as u8;
    }

    /// Own id.
    pub fn id(&self) -> NodeId {
        self.params.id
    }

    /// Phase.
    pub fn phase(&self) -> Phase {
        self.phase
    }

    /// Number of components of the state.
    pub fn components(&self) -> usize {
        self.parts.len()
    }

    /// State at the tick that is computed next, state units, component by component.
    pub fn state(&self) -> impl Iterator<Item = F> {
        self.parts.iter().map(|part| part.x)
    }

    /// Tick that is computed next.
    pub fn tick(&self) -> u32 {
        self.tick
    }

    /// What the law did at the last tick, component by component.
    pub fn observations(&self) -> &[Observation<F>] {
        &self.observations
    }

    /// What it knows of its neighbour `id`, by the first component of that one's state; `None` for a stranger.
    pub fn neighbour_presence(&self, id: NodeId) -> Option<Presence> {
        self.neighbours.presence(id)
    }

    /// Whether its neighbour `id` was ever heard, in any component; `None` for a stranger.
    pub fn neighbour_was_heard(&self, id: NodeId) -> Option<bool> {
        self.neighbours.was_heard(id)
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
        if self.has_outgoing() || !self.events.is_empty() {
            return Some(0);
        }
        match self.step {
            Step::Idle if self.commit_is_due() => return Some(0),
            Step::Idle => {}
            Step::Await(_) | Step::Commit => return self.held_until(),
            Step::Ask(_) | Step::Tell | Step::Stop => return Some(0),
        }
        match self.schedule {
            Schedule::Wait => self.held_until(),
            Schedule::Now => Some(0),
            Schedule::At(time) => Some(time),
        }
    }

    /// Takes a message that arrived at `now` (ns).
    ///
    /// # Errors
    /// The reason for refusing it, counted; a refused message changes nothing else. A state that carries the node's own
    /// id is refused and stops the node: two nodes with one id would each falsify the other's edges.
    // Into its one caller, so that a decoded message never goes through memory: 136 of 1,508 instructions per node-tick (`./ci.sh cost`).
    #[inline(always)]
    pub fn on_message(&mut self, message: &Message, now: u64) -> Result<(), Refusal> {
        let outcome = match *message {
            Message::State { source, component, tick, x } => {
                self.on_state(source, component, tick, F::from_f32(x))
            }
            Message::Sync { previous_tick, .. } => self.on_sync(previous_tick, now),
            Message::Ctrl { target, command, at_tick, .. } if target.includes(self.params.id) => {
                self.on_command(command, at_tick, now)
            }
            Message::Ctrl { .. } => Ok(()),
            Message::Fault { source, .. } => self.on_fault(source),
            Message::Edge { source, neighbour, weight } => self.on_edge(source, neighbour, weight),
        };
        match outcome {
            Ok(()) => count(&mut self.counters.accepted),
            Err(reason) => self.counters.refuse(reason),
        }
        outcome
    }

    /// Does what is due at `now` (ns) and gives the next action; call it until it gives `None`.
    ///
    /// Bounded: at most [`CATCH_UP_LIMIT`] ticks at one `now`, in however many calls. Of the ticks that came late so many are made up
    /// for, with a plant none, and those before them are skipped; all are counted. Of their states only the latest is worth sending. What
    /// concerns the actuator comes first.
    pub fn poll(&mut self, now: u64) -> Option<Action> {
        self.run_due_ticks(now);
        self.check_holdover(now);
        if let Some(action) = self.demand() {
            return Some(action);
        }
        if let Some(event) = self.events.pop_front() {
            return Some(Action::Report(event));
        }
        let message = self.next_message()?;
        count(&mut self.counters.sent);
        Some(Action::Send(message))
    }

    /// Ticks, or asks for the sample that a tick needs.
    fn run_due_ticks(&mut self, now: u64) {
        for _ in 0..CATCH_UP_LIMIT {
            if self.step != Step::Idle || self.commit_is_due() || !self.tick_is_due(now) {
                return;
            }
            match self.plant {
                Some(_) => self.step = Step::Ask(Purpose::Tick),
                None => self.run_tick(),
            }
        }
    }

    /// What it has done and waits for, for its watchdog.
    pub fn progress(&self) -> Progress {
        let next = match self.schedule {
            Schedule::At(next) => Some(next),
            Schedule::Wait | Schedule::Now => None,
        };
        let samples = matches!(self.step, Step::Ask(_) | Step::Await(_));
        Progress {
            completed: self.tick.wrapping_sub(self.skipped),
            is_due: samples || self.schedule == Schedule::Now,
            next,
        }
    }

    /// When a running node that ticks by SYNC stops unless another one comes, ns.
    fn held_until(&self) -> Option<u64> {
        let holdover = self.params.holdover_ns.filter(|_| self.phase == Phase::Running)?;
        Some(self.synced.saturating_add(holdover))
    }

    /// Stops a node whose time master is gone.
    fn check_holdover(&mut self, now: u64) {
        if self.held_until().is_some_and(|until| now >= until) {
            let silent_ms = now.saturating_sub(self.synced) / 1_000_000;
            self.fail(FaultCode::HOLDOVER, u16::try_from(silent_ms).unwrap_or(u16::MAX));
        }
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
        if !x.is_finite() {
            return Err(Refusal::NotFinite);
        }
        if x.abs() > self.params.state_limit {
            return Err(Refusal::OutOfRange);
        }
        let (heard, late) = self.neighbours.hear(source, component, tick, self.tick, x)?;
        // Once per neighbour, whatever its number of components.
        if heard == Heard::First && component == Component::FIRST {
            self.report_event(Event::NeighbourFound(source));
        }
        if late > 0 {
            count(&mut self.counters.late);
        }
        Ok(())
    }

    /// In sync mode each SYNC marks one tick: the one after `previous`. A repeated SYNC is a duplicate; a later one means
    /// that ticks were missed: the node follows the master's count and says how many.
    fn on_sync(&mut self, previous: TickStamp, now: u64) -> Result<(), Refusal> {
        if self.params.tick_source != TickSource::Sync {
            return Ok(());
        }
        if self.phase != Phase::Running {
            return Err(Refusal::Phase);
        }
        // A tick that has not been run yet is overtaken; one that waits for its sample gives that to the new one.
        let waits = self.tick_waits_for_sample();
        let overtakes = waits || self.schedule == Schedule::Now;
        let due = self.tick.wrapping_add(u32::from(overtakes));
        let ahead = if self.counters.ticks == 0 { JOIN_AHEAD } else { SYNC_AHEAD };
        let last = previous.rebuild(due.wrapping_sub(1), 0, ahead).ok_or(Refusal::TickWindow)?;
        let marked = last.wrapping_add(1);
        if overtakes || marked != self.tick {
            let missed = marked.wrapping_sub(self.tick);
            count(&mut self.counters.sync_gaps);
            self.report_event(Event::SyncGap { missed });
            self.skip(missed);
        }
        if !waits {
            self.schedule = Schedule::Now;
        }
        self.synced = now;
        Ok(())
    }

    fn on_command(&mut self, command: Command, at_tick: u16, now: u64) -> Result<(), Refusal> {
        match (command, self.phase) {
            (Command::Start, Phase::Ready) => {
                self.phase = Phase::Running;
                self.synced = now;
                self.announce();
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
            // A commit needs a storage, and comes by `commit_at` from whoever has one.
            _ => Err(Refusal::Phase),
        }
    }

    /// A FAULT goes from line to line, so one with the node's own id may be its own, come back: no sign of a twin, which sends states, too.
    fn on_fault(&mut self, source: NodeId) -> Result<(), Refusal> {
        if source == self.params.id { Err(Refusal::OwnId) } else { Ok(()) }
    }

    /// Compares an announced weight with the node's own (paper, Assumption 1). The law goes on; people must act.
    fn on_edge(&mut self, source: NodeId, neighbour: NodeId, weight: f32) -> Result<(), Refusal> {
        // As for a FAULT: a host that hands it on to everybody hands it back.
        if source == self.params.id {
            return Err(Refusal::OwnId);
        }
        if neighbour != self.params.id {
            return Ok(());
        }
        let own = self.neighbours.weight(source).map_or(0.0, F::to_f32);
        if own != weight {
            count(&mut self.counters.weights_differ);
            self.report_event(Event::WeightsDiffer { node: source, own, theirs: weight });
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
                let late = now >= next;
                self.schedule = Schedule::At(next);
                let due = !late || self.came_late(now, due);
                self.late = late;
                due
            }
            Schedule::At(_) => false,
        }
    }

    /// Counts a tick due at `due` (ns) that comes when the next one is due already, and moves on over those that can be run no more.
    /// Whether one is due then: not where that leads over the tick of a commit, which comes first.
    #[cold]
    fn came_late(&mut self, now: u64, due: u64) -> bool {
        count(&mut self.counters.overruns);
        if !self.late {
            self.report_event(Event::Overrun { tick: self.tick });
        }
        let missed = self.beyond_making_up(now, due);
        self.skip(missed);
        let is_due = !self.commit_is_due();
        self.schedule = Schedule::At(due + (u64::from(missed) + u64::from(is_due)) * self.params.tick_ns);
        is_due
    }

    /// Ticks, from the one due at `due` (ns) on, that are not run any more at `now` (ns): those whose time is over. A plant cannot be measured
    /// in the past. A virtual node makes up for the last few: for all of a long sleep it would be away from its link and its watchdog, and
    /// meanwhile too far behind its neighbours to hear them.
    fn beyond_making_up(&self, now: u64, due: u64) -> u32 {
        let late_by = now.saturating_sub(due);
        let over =
            late_by.checked_div(self.params.tick_ns).map_or(0, |n| u32::try_from(n).unwrap_or(u32::MAX));
        let made_up = if self.plant.is_some() { 0 } else { CATCH_UP_LIMIT - 1 };
        over.saturating_sub(made_up)
    }

    /// Moves on over ticks that this node never runs.
    fn skip(&mut self, ticks: u32) {
        self.tick = self.tick.wrapping_add(ticks);
        self.skipped = self.skipped.wrapping_add(ticks);
        self.counters.skipped = self.counters.skipped.saturating_add(ticks);
    }

    fn run_tick(&mut self) {
        let k = self.tick;
        let (largest, input, mut nu) = self.listen(k);
        let mut psi = self.widths(k, self.params.floor.width(largest, input));
        if let Law::EdgeWise(law) = self.params.coupling {
            self.edge_inputs(k, &law);
            nu = self.parts.iter().fold(F::ZERO, |most, part| larger(most, part.nu.abs()));
        }
        let ratio = nu / psi.now;
        let breach = self.judge(k, ratio);
        // What is seen is the funnel that was left, and what the law uses the one that a breach has made of it.
        let left = psi.now;
        if let Some(lost) = self.too_many_lost() {
            return self.stop_at(k, left, FaultCode::NEIGHBOURS_LOST, lost);
        }
        if breach {
            if self.params.on_breach == OnBreach::Stop {
                return self.stop_at(k, left, FaultCode::FUNNEL_LEFT, self.id().get().into());
            }
            psi = self.reopen(k, ratio, psi);
        }
        self.compute_inputs(psi);
        if !self.parts.iter().all(|part| part.u.is_finite()) {
            return self.refuse_input(k, left);
        }
        self.saturate();
        self.observe(k, left);
        self.advance(k);
    }

    /// Stops at tick `k` since an input is not a finite number.
    #[cold]
    fn refuse_input(&mut self, k: u32, psi: F) {
        let component = self.parts.iter().position(|part| !part.u.is_finite()).unwrap_or(0);
        self.stop_at(k, psi, FaultCode::INPUT, component as u16);
    }

    /// How many neighbours are lost, where that stops the node.
    fn too_many_lost(&self) -> Option<u16> {
        let limit = usize::from(self.params.lost_neighbours);
        if limit == 0 {
            return None;
        }
        let lost = self.neighbours.lost();
        (lost >= limit).then_some(lost as u16)
    }

    /// Stops at tick `k` by `code`: no input, the state stays.
    fn stop_at(&mut self, k: u32, psi: F, code: FaultCode, arg: u16) {
        self.parts.iter_mut().for_each(|part| part.u = F::ZERO);
        self.observe(k, psi);
        self.tick = k.wrapping_add(1);
        count(&mut self.counters.ticks);
        self.fail(code, arg);
    }

    /// Diffusive terms of all components at tick `k`; gives the largest `|x|` among the neighbours and the node itself, the largest
    /// `|u|` of the last tick, and the largest `|nu|`.
    fn listen(&mut self, k: u32) -> (F, F, F) {
        let (mut largest, mut input, mut nu) = (F::ZERO, F::ZERO, F::ZERO);
        for component in 0..self.parts.len() {
            let Some(part) = self.parts.get_mut(component) else { continue };
            let sums = self.neighbours.sums(k, component as u8, part.own());
            (part.nu, part.dnu) = (sums.nu, sums.dnu);
            (largest, input) = (larger(largest, sums.largest), larger(input, part.u.abs()));
            nu = larger(nu, sums.nu.abs());
            // Rarely anything is to be noted.
            if sums.extrapolated | sums.lost_count != 0 {
                self.note_neighbours(component, sums.extrapolated, sums.lost_count, sums.lost);
            }
        }
        (largest, input, nu)
    }

    /// The funnel at tick `k`, not narrower than what the rounding of `nu` can resolve (LAW.md 4), and what a breach has added to it.
    fn widths(&mut self, k: u32, floor: F) -> Widths<F> {
        let psi = self.floored_widths(k, floor);
        let OnBreach::Reopen { decay, partial_decay, .. } = self.params.on_breach else { return psi };
        let added = self.reopened;
        self.reopened = added * decay;
        Widths { now: psi.now + added, ahead: psi.ahead + added * partial_decay }
    }

    /// After a breach under the policy `reopen`: as much wider as the margin asks for (LAW.md 5). Otherwise the same funnel.
    fn reopen(&mut self, k: u32, ratio: F, psi: Widths<F>) -> Widths<F> {
        let OnBreach::Reopen { margin, decay, partial_decay } = self.params.on_breach else { return psi };
        let added = psi.now * (ratio * margin - F::ONE);
        self.reopened += added * decay;
        count(&mut self.counters.reopened);
        let now = psi.now + added;
        self.report_event(Event::FunnelReopened { tick: k, width: now.to_f32() });
        Widths { now, ahead: psi.ahead + added * partial_decay }
    }

    /// Edge-wise coupling: the input of every component, and as its diffusive term that of the edge where it is largest.
    fn edge_inputs(&mut self, k: u32, law: &EdgeWise<F>) {
        let psi = EdgeFunnel { widths: self.params.funnel.widths(k), floor: law.floor };
        for (component, part) in self.parts.iter_mut().enumerate() {
            let law = (law, &self.params.law.gain);
            let inputs = self.neighbours.edge_inputs(k, component as u8, part.own(), law, psi);
            (part.nu, part.u) = (inputs.nu, inputs.u);
        }
    }

    /// The input of every component (docs/notes/2026-11-23-whole-paper.md).
    fn compute_inputs(&mut self, psi: Widths<F>) {
        let law = &self.params.law;
        match self.params.coupling {
            Law::NodeWise => {
                for part in &mut self.parts {
                    part.u = law.step(&mut part.memory, part.nu, part.dnu, psi).u;
                }
            }
            Law::MaxGain => {
                let term = |part: &Part<F>| Term { nu: part.nu, dnu: part.dnu, u: part.u };
                let mut terms: Vec<_, MAX_COMPONENTS> = collect(self.parts.iter().map(term));
                max_gain::step(law, &mut terms, self.counters.ticks == 0, psi);
                self.parts.iter_mut().zip(&terms).for_each(|(part, term)| part.u = term.u);
            }
            Law::LambdaTracker(tracker) => {
                for part in &mut self.parts {
                    part.u = tracker.step(law, &mut part.memory, &mut part.k, part.nu, part.dnu);
                }
            }
            // Found already, and zero from the beginning.
            Law::EdgeWise(_) | Law::None => {}
        }
    }

    fn observe(&mut self, k: u32, psi: F) {
        for (seen, part) in self.observations.iter_mut().zip(&self.parts) {
            let ratio = part.nu.abs() / psi;
            *seen = Observation { tick: k, x: part.x, nu: part.nu, psi, ratio, u: part.u };
        }
    }

    /// Advances the state by a tick, unless that leads beyond its limit.
    fn advance(&mut self, k: u32) {
        let before: State<F> = collect(self.parts.iter().map(|part| part.x));
        let Params { field, tick, .. } = &self.params;
        match self.parts.as_mut_slice() {
            [part] => midpoint_step(field, *tick, k, &mut part.x, &mut part.carry, part.u),
            parts => vector_step(field, *tick, k, parts),
        }
        // Of `x` as neighbours see it: their `dnu` and this node's then add up to zero.
        self.parts.iter_mut().zip(&before).for_each(|(part, &before)| part.dx = part.x - before);
        self.tick = k.wrapping_add(1);
        count(&mut self.counters.ticks);
        let limit = self.params.state_limit;
        if self.parts.iter().all(|part| part.x.abs() <= limit) {
            self.outgoing.states = self.all_components();
            self.outgoing.announce = self.outgoing.edges_left != 0;
        } else {
            self.parts.iter_mut().zip(&before).for_each(|(part, &before)| part.x = before);
            self.fault(FaultCode::STATE_LIMIT);
        }
    }

    /// The funnel at tick `k`, not narrower than what the rounding of `nu` can resolve (LAW.md 4).
    fn floored_widths(&mut self, k: u32, floor: F) -> Widths<F> {
        let psi = self.params.funnel.widths(k);
        if psi.clears(floor) {
            return psi;
        }
        count(&mut self.counters.floored);
        if !self.floored {
            self.floored = true;
            self.report_event(Event::FunnelFloored { tick: k, width: floor.to_f32() });
        }
        psi.floored(floor)
    }

    /// Counts a breach and says when it begins and ends; what follows from it is up to the policy (LAW.md 5).
    fn judge(&mut self, k: u32, ratio: F) -> bool {
        // What is not a number is not inside, and stays the largest.
        let inside = ratio < F::ONE;
        let breach = !inside;
        if breach {
            count(&mut self.counters.breaches);
            self.max_ratio = larger(self.max_ratio, ratio);
        } else if ratio > self.max_ratio {
            self.max_ratio = ratio;
        }
        if breach != self.in_breach {
            self.in_breach = breach;
            self.report_event(match breach {
                true => Event::BreachBegan { tick: k, ratio: ratio.to_f32() },
                false => Event::BreachEnded { tick: k },
            });
        }
        breach
    }

    #[cold]
    fn note_neighbours(
        &mut self,
        component: usize,
        extrapolated: u32,
        lost_count: u32,
        lost: Option<NodeId>,
    ) {
        self.counters.extrapolated = self.counters.extrapolated.saturating_add(extrapolated);
        self.counters.neighbours_lost = self.counters.neighbours_lost.saturating_add(lost_count);
        // Once per neighbour, whatever its number of components.
        if let Some(id) = lost.filter(|_| component == 0) {
            self.report_event(Event::NeighbourLost(id));
        }
    }

    fn has_outgoing(&self) -> bool {
        let Outgoing { fault, states, announce, .. } = &self.outgoing;
        *states != 0 || *announce || fault.is_some()
    }

    /// The next message for the link: a fault, then the components of the state, then an edge.
    fn next_message(&mut self) -> Option<Message> {
        let Outgoing { fault, states, announce, .. } = &mut self.outgoing;
        if fault.is_some() {
            return fault.take();
        }
        if *states != 0 {
            let component = states.trailing_zeros() as u8;
            *states &= states.wrapping_sub(1);
            return self.state_message(component);
        }
        if !core::mem::take(announce) {
            return None;
        }
        self.edge_message()
    }

    /// Announces the next edge, last one first.
    fn edge_message(&mut self) -> Option<Message> {
        self.outgoing.edges_left = self.outgoing.edges_left.checked_sub(1)?;
        let (neighbour, weight) = self.neighbours.edge(usize::from(self.outgoing.edges_left))?;
        Some(Message::Edge { source: self.params.id, neighbour, weight: weight.to_f32() })
    }

    fn state_message(&self, component: u8) -> Option<Message> {
        Some(Message::State {
            source: self.params.id,
            component: Component::new(component)?,
            tick: TickStamp::full(self.tick),
            x: self.parts.get(usize::from(component))?.x.to_f32(),
        })
    }

    /// A bit for each component.
    fn all_components(&self) -> u8 {
        (0..self.parts.len()).fold(0, |bits, component| bits | 1 << component)
    }

    fn halt(&mut self, phase: Phase) {
        self.phase = phase;
        self.schedule = Schedule::Wait;
        self.commit = None;
        // A warning that waits is still true: why the node was restarted, for example.
        self.outgoing = Outgoing { fault: self.outgoing.fault, ..Outgoing::default() };
        self.step = Step::Stop;
    }

    #[cold]
    fn fault(&mut self, code: FaultCode) {
        self.fail(code, u16::from(self.params.id.get()));
    }

    /// Tells the link something that does not stop the node; `arg` is the detail of the FAULT.
    pub fn warn(&mut self, code: FaultCode, arg: u16) {
        self.outgoing.fault = Some(self.fault_message(code, Severity::Warning, arg));
    }

    fn fault_message(&self, code: FaultCode, severity: Severity, arg: u16) -> Message {
        Message::Fault { source: self.params.id, code, severity, arg, tick: TickStamp::full(self.tick) }
    }

    /// Stops, says so once on the link, and stays silent until it is configured anew. `arg` is the detail of the FAULT.
    pub fn fail(&mut self, code: FaultCode, arg: u16) {
        if matches!(self.phase, Phase::Faulted(_)) {
            return;
        }
        self.halt(Phase::Faulted(code));
        self.outgoing.fault = Some(self.fault_message(code, Severity::Stopped, arg));
        if self.events.is_full() {
            // Unlike the others, this one happens once and must not be missing.
            let _ = self.events.pop_back();
        }
        self.report_event(Event::Fault(code));
    }

    #[cold]
    fn report_event(&mut self, event: Event) {
        // A full queue keeps the oldest events: they tell the cause.
        let _ = self.events.push_back(event);
    }
}

/// The midpoint step of [`midpoint_step`] for all components at once.
fn vector_step<F: Real, V: VectorField<F>>(field: &V, tick: F, k: u32, parts: &mut [Part<F>]) {
    let half_ticks = u64::from(k) << 1;
    let now: State<F> = collect(parts.iter().map(|part| part.x));
    let to_middle = |(index, part): (usize, &Part<F>)| {
        part.x + tick * F::HALF * (field.component(half_ticks, &now, index) + part.u)
    };
    let middle: State<F> = collect(parts.iter().enumerate().map(to_middle));
    for (index, part) in parts.iter_mut().enumerate() {
        let rate = field.component(half_ticks | 1, &middle, index) + part.u;
        compensated_add(&mut part.x, &mut part.carry, tick * rate);
    }
}
