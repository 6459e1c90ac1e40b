//! Samples and inputs of a node with a plant.

use super::step::{Purpose, Step};
use super::{Node, Schedule};
use crate::plant::Plant;
use funnelnet_law::field::VectorField;
use funnelnet_law::gain::GainFunction;
use funnelnet_law::math::Real;
use funnelnet_protocol::message::FaultCode;
use funnelnet_protocol::report::count;

impl<F: Real, V: VectorField<F>, G: GainFunction<F>> Node<F, V, G> {
    /// Inputs that the actuator was told last, state units / s, component by component; empty on a virtual
    /// node.
    pub fn inputs(&self) -> &[F] {
        self.plant.as_ref().map_or(&[], Plant::inputs)
    }

    /// Answers [`Action::Sample`](super::Action::Sample) with the state of the plant, state units, component
    /// by component. A state that is not finite, beyond the state limit or of another number of components is
    /// a sample that failed. Not asked for, it is ignored.
    pub fn measured(&mut self, x: &[f32]) {
        let limit = self.params.state_limit;
        // Written so that NaN is outside.
        let sound = x.len() == self.parts.len() && x.iter().all(|&x| F::from_f32(x).abs() <= limit);
        if !sound {
            return self.sample_failed();
        }
        let (Some(plant), Step::Await(purpose)) = (&mut self.plant, self.step) else { return };
        plant.succeed();
        for (part, &x) in self.parts.iter_mut().zip(x) {
            part.correct(F::from_f32(x));
        }
        self.resume(purpose);
    }

    /// Answers [`Action::Sample`](super::Action::Sample) where the sensor has failed: the node goes on with
    /// its prediction, for so many ticks.
    pub fn sample_failed(&mut self) {
        let (Some(plant), Step::Await(purpose)) = (&mut self.plant, self.step) else { return };
        count(&mut self.counters.coasted);
        match plant.miss() {
            Some(missed) => self.fail(FaultCode::PLANT, u16::try_from(missed).unwrap_or(u16::MAX)),
            None => self.resume(purpose),
        }
    }

    /// Takes up what has waited for a sample, with it or without.
    fn resume(&mut self, purpose: Purpose) {
        self.step = Step::Idle;
        match purpose {
            Purpose::Announce => {
                // Before the first tick nothing has changed.
                self.parts.iter_mut().for_each(|part| part.dx = F::ZERO);
                self.outbox.send_state(self.parts.len());
            }
            // SYNC has moved it over the tick of a commit, which comes first.
            Purpose::Tick if self.clock.commit_is_due() => self.clock.schedule = Schedule::Now,
            Purpose::Tick => self.run_tick(),
        }
    }

    /// Has the initial state go out; that of a plant has to be measured first.
    pub(super) fn announce(&mut self) {
        match self.plant {
            Some(_) => self.step = Step::Ask(Purpose::Announce),
            None => self.outbox.send_state(self.parts.len()),
        }
    }

    /// Limits the inputs to what the actuator can do, by the configuration and by the plant. The law goes on
    /// from these and not from what it had asked for: otherwise `b u[k-1]` in (*) would wind up (law.md 6).
    #[inline]
    pub(super) fn saturate(&mut self) {
        if self.params.limits.is_some() || self.plant.is_some() {
            self.apply_limits();
        }
    }

    #[inline(never)]
    fn apply_limits(&mut self) {
        let mut saturated = false;
        for (component, part) in self.parts.iter_mut().enumerate() {
            let possible = self.params.limits.map_or(part.u, |range| range.clamp(part.u));
            let applied = match &mut self.plant {
                Some(plant) => plant.apply(component, possible),
                None => possible,
            };
            if applied != part.u {
                saturated = true;
                self.neighbours.feed_back(component as u8, applied / part.u);
                part.memory.feed_back(applied);
                part.u = applied;
            }
        }
        if self.plant.is_some() {
            self.step = Step::Tell;
        }
        if saturated {
            count(&mut self.counters.saturated);
        }
    }
}
