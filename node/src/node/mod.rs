//! The sans-IO node: messages and time in, actions out. Firmware, simulator and tests drive this one state
//! machine.
//!
//! Each file is one part of it: `inbox` takes messages, `clock` knows when a tick is due, `tick` runs one,
//! `funnel` judges it, and `outbox` holds what is to go out. `life` starts, stops and fails it, `step` asks
//! the app, `plant` takes samples and gives inputs, `adopt` takes another configuration, `join` is about a
//! node that comes to a network that runs.
//!
//! # The state machine
//!
//! A node has a phase of its life, a schedule for its next tick, and a step that the app has to do for it
//! before that.
//!
//! ```text
//! Phase     Ready --start--> Running --stop--> Stopped --fault--> Faulted
//!           Ready ---------------------stop--> Stopped
//!           Ready ----------------------------------------fault--> Faulted
//!                            Running ---------------------fault--> Faulted
//!
//! Schedule  Wait --start---> At ---due--> At
//!                            At --halt--> Wait
//!           Wait --SYNC---> Now ---due--> Wait
//!           Wait --answer-> Now --halt--> Wait
//!
//! Step      Idle --start--> Ask(Announce) --told--> Await(Announce) --answer--> Idle
//!           Idle ----due--> Ask(Tick) ------told--> Await(Tick) ------answer--> Tell --told--> Idle
//!                                                   Await(Tick) ------answer--> Idle
//!           Idle -commit--> Commit ------------------------------------answer--> Idle
//!
//!           Idle ------------halt--> Stop
//!           Ask(Announce) ---halt--> Stop
//!           Await(Announce) -halt--> Stop
//!           Ask(Tick) -------halt--> Stop
//!           Await(Tick) -----halt--> Stop
//!           Tell ------------halt--> Stop
//!           Commit ----------halt--> Stop --told--> Idle
//! ```
//!
//! | arrow | meaning |
//! |---|---|
//! | `start`, `stop` | a CTRL of that command comes |
//! | `fault` | the node fails, by itself or by [`Node::fail`] |
//! | `halt` | either of `stop` and `fault` |
//! | `SYNC` | a SYNC marks the next tick, or one after it |
//! | `due` | [`Node::poll`] finds that a tick is due; a virtual node runs it, one with a plant needs a sample first |
//! | `told` | [`Node::poll`] gives [`Action::Sample`], [`Action::Actuate`] or [`Action::Safe`] |
//! | `commit` | [`Node::take_commit`] says that the tick of a commit comes next |
//! | `answer` | [`Node::measured`], [`Node::sample_failed`], [`Node::adopt`] or [`Node::keep_on`] answers what was asked |
//!
//! An answer sets the schedule only where SYNC has moved the node over the tick of a commit while it waited
//! for its sample: the tick waits once more, and the commit comes first. Unless it runs, a node waits for no
//! tick, and its step is `Idle` or `Stop`. A test walks through all that a node can do, and finds these
//! arrows and no others.

pub mod adopt;
mod clock;
mod funnel;
mod inbox;
mod join;
mod life;
mod outbox;
mod part;
mod plant;
mod step;
#[cfg(test)]
mod tests;
mod tick;

pub use clock::CATCH_UP_LIMIT;

use crate::neighbour::{Neighbours, Presence};
use crate::observe::{Event, Observation, Phase};
use crate::params::Params;
use crate::plant::Plant;
use clock::{Clock, Schedule};
use funnel::FunnelRecord;
use funnelnet_law::collect::collect;
use funnelnet_law::field::{PreparedField, VectorField};
use funnelnet_law::gain::{Gain, GainFunction};
use funnelnet_law::math::Real;
use funnelnet_law::start::Pace;
use funnelnet_protocol::config::{EdgeConfig, MAX_COMPONENTS};
use funnelnet_protocol::message::{Message, NodeId};
use funnelnet_protocol::report::{Counters, Report};
use heapless::Vec;
use join::Newcomer;
use outbox::Outbox;
use part::Part;
use step::Step;

/// Action that the app shall take next.
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
pub struct Node<F = f32, V = PreparedField<F>, G = Gain<F>> {
    params: Params<F, V, G>,
    phase: Phase,
    step: Step,
    clock: Clock,
    /// The pace of its last tick.
    pace: Pace,
    /// One per component of the state.
    parts: Vec<Part<F>, MAX_COMPONENTS>,
    observations: Vec<Observation<F>, MAX_COMPONENTS>,
    funnel: FunnelRecord<F>,
    /// A virtual node has none.
    plant: Option<Plant<F>>,
    /// A member of its network is none.
    newcomer: Option<Newcomer<F>>,
    outbox: Outbox,
    counters: Counters,
    neighbours: Neighbours<F>,
}

impl<F: Real, V: VectorField<F>, G: GainFunction<F>> Node<F, V, G> {
    /// A node in phase `Ready`; `edges` are those that `params` were validated with.
    pub fn new(params: Params<F, V, G>, edges: &[EdgeConfig]) -> Self {
        let mut node = Self::alone(params);
        node.meet(edges);
        node
    }

    /// A node without its edges, still to be given by [`Node::meet`].
    // Inlined because it is made where it stays then: of an empty table nothing is written, let alone moved.
    #[inline(always)]
    pub(crate) fn alone(params: Params<F, V, G>) -> Self {
        // A tracker starts from the slope of its linear gain.
        let k = params.law.gain.apply(F::ONE);
        let states = params.initial_state.iter();
        Self {
            phase: Phase::Ready,
            step: Step::Idle,
            clock: Clock::new(),
            pace: Pace::default(),
            parts: collect(states.clone().map(|&x| Part { x, k, ..Part::default() })),
            observations: collect(states.map(|&x| Observation { x, ..Observation::default() })),
            funnel: FunnelRecord::new(),
            neighbours: Neighbours::new(params.initial_state.len() as u8),
            plant: params.plant.clone().map(Plant::new),
            newcomer: None,
            outbox: Outbox::new(),
            counters: Counters::default(),
            params,
        }
    }

    /// Makes its table of these edges. What it has heard of neighbours that stay it still knows.
    pub(crate) fn meet(&mut self, edges: &[EdgeConfig]) {
        let params = &self.params;
        self.neighbours.doubt_beyond(params.heard.change, params.heard.drop_after);
        if self.neighbours.set(edges, params.extrapolate_ticks, params.slope_limit) {
            self.disturb();
        }
        self.outbox.introduce(self.neighbours.count() as u8);
    }

    /// Id of the node.
    pub fn id(&self) -> NodeId {
        self.params.id
    }

    /// Period of its ticks, ns.
    pub(crate) fn tick_ns(&self) -> u64 {
        self.params.tick_ns
    }

    /// Its own vector field, as it was made for its tick period.
    pub fn field(&self) -> &V {
        &self.params.field
    }

    /// Phase of the node's life.
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
        self.clock.tick
    }

    /// Observations of the last tick, component by component.
    pub fn observations(&self) -> &[Observation<F>] {
        &self.observations
    }

    /// Presence of neighbour `id`, by the first component of its state; `None` for a stranger.
    pub fn neighbour_presence(&self, id: NodeId) -> Option<Presence> {
        self.neighbours.presence(id)
    }

    /// Whether the edge to neighbour `id` is barred, since too much of what it said could not be taken; `None` for a stranger.
    pub fn neighbour_is_barred(&self, id: NodeId) -> Option<bool> {
        self.neighbours.is_barred(id)
    }

    /// Whether neighbour `id` was ever heard, in any component; `None` for a stranger.
    pub fn neighbour_was_heard(&self, id: NodeId) -> Option<bool> {
        self.neighbours.was_heard(id)
    }

    /// Counters.
    pub fn counters(&self) -> &Counters {
        &self.counters
    }

    /// Report of the run so far, as it is sent at its end.
    pub fn report(&self) -> Report {
        Report { max_ratio: self.funnel.max_ratio.to_f32(), counters: self.counters.clone() }
    }

    /// Time at which [`Node::poll`] has something to do next, ns on the caller's clock; `None`: not before a
    /// message.
    pub fn poll_at(&self) -> Option<u64> {
        if !self.outbox.is_empty() {
            return Some(0);
        }
        match self.step {
            Step::Idle if self.clock.commit_is_due() => return Some(0),
            Step::Idle => {}
            Step::Await(_) | Step::Commit => return self.held_until(),
            Step::Ask(_) | Step::Tell | Step::Stop => return Some(0),
        }
        match self.clock.schedule {
            Schedule::Wait => self.held_until(),
            Schedule::Now => Some(0),
            Schedule::At(time) => Some(time),
        }
    }

    /// Does what is due at `now` (ns) and gives the next action; call it until it gives `None`.
    ///
    /// Bounded: at most [`CATCH_UP_LIMIT`] ticks at one `now`, in however many calls. Of the ticks that came
    /// late so many are made up for, with a plant none, and those before them are skipped; all are counted.
    /// Of their states only the latest is worth sending. What concerns the actuator comes first.
    pub fn poll(&mut self, now: u64) -> Option<Action> {
        self.run_due_ticks(now);
        self.check_holdover(now);
        self.demand().or_else(|| self.next_outgoing())
    }
}
