//! Another configuration for a node that runs (protocol/README.md, "Commit"). What the law remembers stays,
//! so that it goes on without a jump; the funnel is a function of the tick number and needs nothing.

use super::Node;
use super::step::Step;
use crate::observe::{Event, Phase};
use crate::params::Params;
use funnelnet_law::field::VectorField;
use funnelnet_law::gain::GainFunction;
use funnelnet_law::law::Law;
use funnelnet_law::law::node_wise::Memory;
use funnelnet_law::math::Real;
use funnelnet_law::start::{Pace, SlowStart};
use funnelnet_protocol::NodeConfig;
use funnelnet_protocol::config::{EdgeConfig, TickSource};
use funnelnet_protocol::message::TickStamp;
use funnelnet_protocol::refusal::Refusal;
use funnelnet_protocol::report::count;

/// Ticks that a commit may lie ahead: what its 16 bits can tell from one that is past.
pub const COMMIT_AHEAD: u32 = (1 << 15) - 1;

/// Part of a configuration that cannot change while a node runs.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Lasting {
    id: u8,
    tick_ns: u64,
    round: u8,
    start: SlowStart,
    tick_source: TickSource,
    components: usize,
}

impl Lasting {
    /// Takes it from a configuration.
    pub fn of(config: &NodeConfig) -> Self {
        Self {
            id: config.id,
            tick_ns: config.period_ns(),
            round: config.tuning.ticks_in_round(),
            start: SlowStart::new(config.tuning.slow_start),
            tick_source: config.tick_source,
            components: config.initial_state.len(),
        }
    }
}

impl<F, V, G> Params<F, V, G> {
    fn lasting(&self) -> Lasting {
        Lasting {
            id: self.id.get(),
            tick_ns: self.tick_ns,
            round: self.round,
            start: self.start,
            tick_source: self.tick_source,
            components: self.initial_state.len(),
        }
    }
}

impl<F: Real, V: VectorField<F>, G: GainFunction<F>> Node<F, V, G> {
    /// Lets the node ask by [`Node::take_commit`] for other parameters once tick `at` comes next: its own
    /// next one, or one of the [`COMMIT_AHEAD`] after it. A later call replaces an earlier one. `lasting` is
    /// of the configuration that they will be made of.
    ///
    /// # Errors
    /// Counted, and nothing has changed: `Phase` unless it runs and knows its tick, `Value` where `lasting`
    /// is not its own, `TickWindow`.
    pub fn commit_at(&mut self, at: TickStamp, lasting: Lasting) -> Result<(), Refusal> {
        let tick = self.may_commit(at, lasting).inspect_err(|&reason| self.counters.refuse(reason))?;
        self.clock.commit = Some(tick);
        count(&mut self.counters.accepted);
        Ok(())
    }

    fn may_commit(&self, at: TickStamp, lasting: Lasting) -> Result<u32, Refusal> {
        // Before its first SYNC it may be anywhere.
        let lost = self.params.tick_source == TickSource::Sync && self.counters.ticks == 0;
        if self.phase != Phase::Running || lost {
            return Err(Refusal::Phase);
        }
        if lasting != self.params.lasting() {
            return Err(Refusal::Value);
        }
        // A tick that waits for its sample has begun.
        let next = self.clock.tick.wrapping_add(u32::from(self.tick_waits_for_sample()));
        at.rebuild(next, 0, COMMIT_AHEAD).ok_or(Refusal::TickWindow)
    }

    /// Answers [`Node::take_commit`] with the parameters and the edges to go on with, as for [`Node::new`].
    /// Kept: phase, tick, schedule, state, what the law remembers, counters, and what was heard of neighbours
    /// that stay. The initial state of `params` means nothing here. Once in a run: after a second time a law
    /// or a policy could go on from what it remembered before the first.
    ///
    /// # Errors
    /// `Value`, counted, where id, tick period, ticks in a round, tick source, number of components or
    /// whether there is a plant are not those of the node; it goes on as it was. `Phase`, too, where it does
    /// not run.
    pub fn adopt(&mut self, params: Params<F, V, G>, edges: &[EdgeConfig]) -> Result<(), Refusal> {
        self.keep_on();
        self.may_adopt(&params).inspect_err(|&reason| self.counters.refuse(reason))?;
        if core::mem::discriminant(&params.coupling) != core::mem::discriminant(&self.params.coupling) {
            self.change_coupling(&params);
        }
        self.params.keep_pace(Pace::Usual);
        let damped_alike = params.law.b() == self.params.law.b();
        self.params = params;
        self.params.keep_pace(self.pace);
        self.meet(edges);
        if !damped_alike {
            self.disturb();
        }
        self.outbox.report(Event::Adopted { tick: self.clock.tick });
        Ok(())
    }

    fn may_adopt(&self, params: &Params<F, V, G>) -> Result<(), Refusal> {
        let old = &self.params;
        let alike = params.lasting() == old.lasting() && params.plant.is_some() == old.plant.is_some();
        match self.phase {
            Phase::Running if alike => Ok(()),
            Phase::Running => Err(Refusal::Value),
            _ => Err(Refusal::Phase),
        }
    }

    /// Answers [`Node::take_commit`] where there is nothing to go on with but what the node has.
    pub fn keep_on(&mut self) {
        if self.step == Step::Commit {
            self.step = Step::Idle;
        }
    }

    /// Has the new law go on from the last input, whatever the old one was. A tracker starts from the slope
    /// of its linear gain, as at a start.
    fn change_coupling(&mut self, params: &Params<F, V, G>) {
        let k = params.law.gain.apply(F::ONE);
        let has_input = self.counters.ticks != 0;
        // These two remember the same of each component.
        let of_components = |law: &Law<F>| matches!(law, Law::NodeWise | Law::MaxGain);
        let remembers = of_components(&self.params.coupling) && of_components(&params.coupling);
        for part in &mut self.parts {
            if params.coupling == Law::None {
                part.u = F::ZERO;
            }
            part.k = k;
            if remembers {
                continue;
            }
            part.memory = Memory::default();
            if has_input {
                part.memory.feed_back(part.u);
            }
        }
    }

    /// Whether the tick of [`Node::commit_at`] comes next: it waits then for [`Node::adopt`] or
    /// [`Node::keep_on`]. Told once. To be asked when [`Node::poll`] has given `None`: what the tick before
    /// had to say is said then, and the time that an answer takes is that of the rest of its period.
    #[inline]
    pub fn take_commit(&mut self) -> bool {
        let due = self.step == Step::Idle && self.clock.commit_is_due();
        if due {
            (self.clock.commit, self.step) = (None, Step::Commit);
        }
        due
    }
}
