//! One tick `k` of a node: the states `x_j(k)` have been heard; `nu`, funnel and input follow; the state is
//! advanced to `k + 1` and sent at once, so that it has a whole period to reach the neighbours
//! (docs/notes/2026-11-23-first-light.md).

use super::Node;
use super::part::{Part, vector_step};
use crate::neighbour::EdgeFunnel;
use crate::observe::{Event, Observation};
use crate::params::{OnBreach, Params};
use funnelnet_law::collect::collect;
use funnelnet_law::field::{State, VectorField};
use funnelnet_law::funnel::Widths;
use funnelnet_law::gain::GainFunction;
use funnelnet_law::law::max_gain::{self, Term};
use funnelnet_law::law::{EdgeWise, Law};
use funnelnet_law::math::{Real, larger};
use funnelnet_law::start::{PARTS, Pace};
use funnelnet_protocol::config::MAX_COMPONENTS;
use funnelnet_protocol::message::{FaultCode, NodeId};
use funnelnet_protocol::report::count;
use heapless::Vec;

/// What is left of the input of a node without edges from tick to tick: exp(-1/300).
const HELD: f32 = 0.996_672_2;

impl<F: Real, V: VectorField<F>, G: GainFunction<F>> Node<F, V, G> {
    /// Runs the tick that comes next.
    pub(super) fn run_tick(&mut self) {
        let k = self.clock.tick;
        if !self.params.start.is_none() {
            self.keep_pace(k);
        }
        let (largest, input, mut nu) = self.listen(k);
        let is_new = self.newcomer.is_some();
        if is_new && self.waits(k, &mut nu) {
            return self.let_pass(k);
        }
        let mut psi = self.widths(k, self.params.floor.width(largest, input));
        if is_new {
            psi = self.private(k, nu, psi);
        }
        let alone = self.neighbours.is_alone();
        if let (Law::EdgeWise(law), false) = (self.params.coupling, alone) {
            self.edge_inputs(k, &law);
            nu = self.parts.iter().fold(F::ZERO, |most, part| larger(most, part.nu.abs()));
        }
        let ratio = nu / psi.now;
        let breach = self.judge(k, ratio);
        // What is seen is the funnel that was left, and what the law uses the one that a breach has made of
        // it.
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
        match alone {
            true => self.hold_inputs(),
            false => self.compute_inputs(self.params.guard.of(k, psi)),
        }
        // Written so that NaN is outside.
        let limit = self.params.input_limit;
        if !self.parts.iter().all(|part| part.u.abs() <= limit) {
            if !self.parts.iter().all(|part| part.u.is_finite()) {
                return self.refuse_input(k, left);
            }
            self.limit_inputs();
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

    /// Goes on at the pace of tick `k`. Where a tick gets longer, what has changed in the last one would have
    /// changed eight times as much; the last input stays (law.md 7).
    #[cold]
    fn keep_pace(&mut self, k: u32) {
        let pace = self.params.start.pace(k);
        if pace == self.pace {
            return;
        }
        if self.pace == Pace::Slow {
            let times = F::from_u32(PARTS);
            self.parts.iter_mut().for_each(|part| part.dx = part.dx * times);
            self.neighbours.stretch(k, times);
        }
        self.disturb();
        self.params.keep_pace(pace);
        self.pace = pace;
    }

    /// Lets tick `k` pass without an input.
    #[cold]
    fn let_pass(&mut self, k: u32) {
        for part in &mut self.parts {
            (part.u, part.nu, part.dnu) = (F::ZERO, F::ZERO, F::ZERO);
        }
        if self.plant.is_some() {
            self.saturate();
        }
        let psi = self.params.widths(k).now;
        self.observe(k, psi);
        self.advance(k);
    }

    /// Number of neighbours that are lost, where that stops the node.
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
        self.clock.tick = k.wrapping_add(1);
        count(&mut self.counters.ticks);
        self.fail(code, arg);
    }

    /// Measures the diffusive terms of all components at tick `k`; gives the largest `|x|` among the
    /// neighbours and the node itself, the largest `|u|` of the last tick, and the largest `|nu|`.
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

    /// Finds the input of every component for edge-wise coupling, and as its diffusive term that of the edge
    /// where it is largest.
    fn edge_inputs(&mut self, k: u32, law: &EdgeWise<F>) {
        let widths = self.params.guard.of(k, self.params.widths(k));
        let psi = EdgeFunnel { widths, floor: law.floor };
        for (component, part) in self.parts.iter_mut().enumerate() {
            let law = (law, &self.params.law.gain);
            let inputs = self.neighbours.edge_inputs(k, component as u8, part.own(), law, psi);
            (part.nu, part.u) = (inputs.nu, inputs.u);
        }
    }

    /// Finds the input of every component (docs/notes/2026-11-23-whole-paper.md).
    fn compute_inputs(&mut self, psi: Widths<F>) {
        let law = &self.params.law;
        match self.params.coupling {
            Law::NodeWise => {
                for part in &mut self.parts {
                    part.u = law.step(&mut part.memory, part.nu, part.dnu, psi).u;
                }
            }
            Law::MaxGain => {
                let term =
                    |part: &Part<F>| Term { nu: part.nu, dnu: part.dnu, u: part.u, memory: part.memory };
                let mut terms: Vec<_, MAX_COMPONENTS> = collect(self.parts.iter().map(term));
                max_gain::step(law, &mut terms, psi);
                for (part, term) in self.parts.iter_mut().zip(&terms) {
                    (part.u, part.memory) = (term.u, term.memory);
                }
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

    /// Keeps the inputs of a node whose edges are all gone, and lets them decay: the others go on with theirs
    /// (law.md 9).
    #[cold]
    fn hold_inputs(&mut self) {
        let decay = F::from_f32(HELD);
        for part in &mut self.parts {
            part.u = part.u * decay;
            part.memory.feed_back(part.u);
        }
    }

    /// Bounds the inputs, and has the law go on from the bounded ones: the best way back that was found from
    /// far away (law.md 9).
    #[cold]
    fn limit_inputs(&mut self) {
        let limit = self.params.input_limit;
        for (component, part) in self.parts.iter_mut().enumerate() {
            if part.u.abs() > limit {
                let bounded = limit.copysign(part.u);
                self.neighbours.feed_back(component as u8, bounded / part.u);
                part.memory.feed_back(bounded);
                part.u = bounded;
            }
        }
        count(&mut self.counters.limited);
    }

    /// Takes note of a tick that does not follow from those before it: `g` is 0 at this tick and the next one
    /// (law.md 3).
    #[cold]
    pub(super) fn disturb(&mut self) {
        for (component, part) in self.parts.iter_mut().enumerate() {
            part.memory.disturb();
            if let Law::EdgeWise(_) = self.params.coupling {
                self.neighbours.disturb(component as u8);
            }
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
        let (stride, mut from) = self.params.steps(k);
        let Params { field, round, .. } = &self.params;
        let step = stride.half << 1;
        let end = from + step * u64::from(*round);
        match self.parts.as_mut_slice() {
            [part] => {
                while from < end {
                    stride.midpoint_step(field, from, &mut part.x, &mut part.carry, part.u);
                    from += step;
                }
            }
            parts => {
                while from < end {
                    vector_step(field, stride, from, parts);
                    from += step;
                }
            }
        }
        // Of `x` as neighbours see it: their `dnu` and this node's then add up to zero.
        self.parts.iter_mut().zip(&before).for_each(|(part, &before)| part.dx = part.x - before);
        self.clock.tick = k.wrapping_add(1);
        count(&mut self.counters.ticks);
        let limit = self.params.state_limit;
        if self.parts.iter().all(|part| part.x.abs() <= limit) {
            if self.newcomer.is_none() {
                self.outbox.send_state(self.parts.len());
                self.outbox.send_edge();
            }
        } else {
            self.refuse_states(&before);
        }
    }

    /// Stops since a state is beyond its limit, or is no finite number any more, which only the own field can
    /// have made of it.
    #[cold]
    fn refuse_states(&mut self, before: &State<F>) {
        let component = self.parts.iter().position(|part| !part.x.is_finite());
        self.parts.iter_mut().zip(before).for_each(|(part, &before)| part.x = before);
        match component {
            Some(component) => {
                count(&mut self.counters.field_not_finite);
                self.fail(FaultCode::FIELD, component as u16);
            }
            None => self.fault(FaultCode::STATE_LIMIT),
        }
    }

    #[cold]
    #[inline(never)]
    fn note_neighbours(
        &mut self,
        component: usize,
        extrapolated: u32,
        lost_count: u32,
        lost: Option<NodeId>,
    ) {
        // One component's edge alone is enough: they are few, and rarely lost one by one.
        self.disturb();
        self.counters.extrapolated = self.counters.extrapolated.saturating_add(extrapolated);
        self.counters.neighbours_lost = self.counters.neighbours_lost.saturating_add(lost_count);
        // Once per neighbour, whatever its number of components.
        if let Some(id) = lost.filter(|_| component == 0) {
            self.outbox.report(Event::NeighbourLost(id));
        }
    }
}
