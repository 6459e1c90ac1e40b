//! Table of neighbours, as a node knows them: value, increment, age, of every component of their states by
//! itself, since each comes, is lost and expires by itself.
//!
//! A neighbour that is not heard in time is extrapolated by its last increment, for a bounded number of
//! ticks, and then its edge is dropped until it is heard again (law.md 4: holding instead costs up to thirty
//! times the error).
//!
//! A value that says too much, or has changed too fast, is not taken: for that tick its neighbour is silent.
//! An edge of which too many values in a row were not taken is *barred*. It stays so until its neighbour starts
//! anew: until it says so, says that it has stopped, or has been silent for longer than it would be extrapolated.

use funnelnet_law::floor::Floor;
use funnelnet_law::funnel::Widths;
use funnelnet_law::gain::GainFunction;
use funnelnet_law::law::edge_wise::{EdgeTerm, EdgeWise};
use funnelnet_law::law::node_wise::Memory;
use funnelnet_law::math::{Real, larger};
use funnelnet_protocol::config::{EdgeConfig, MAX_NEIGHBOURS};
use funnelnet_protocol::message::{Component, NodeId};
use funnelnet_protocol::{Refusal, TickStamp};
use heapless::Vec;

/// Ticks that a received one may lie back.
pub const WINDOW_BACK: u32 = 8;
/// Ticks that a received one may lie ahead.
pub const WINDOW_AHEAD: u32 = 2;

/// Ticks that received ones may lie apart.
const SPAN: i32 = (WINDOW_BACK + WINDOW_AHEAD) as i32;

/// One component of one edge, as one end sees it.
#[derive(Clone, Copy, Debug)]
struct Edge<F> {
    id: u8,
    component: u8,
    weight: F,
    /// `alpha_ij (n_i + n_j)`, for edge-wise coupling.
    stiffness: F,
    /// Value at `tick`, state units.
    value: F,
    /// Change of the value per tick, state units.
    increment: F,
    /// Of `value`; of one that was never heard, the tick before the first at which it should have been.
    tick: u32,
    hearing: Hearing,
    /// Values in a row that were not taken.
    doubts: u8,
    /// Memory of edge-wise coupling.
    memory: Memory<F>,
}

/// Presence of a neighbour, as a node knows it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Presence {
    /// Not heard yet, and not waited for too long.
    Unheard,
    /// Heard, and not expired since.
    Known,
    /// Silent for too long: since it was heard last, or since it should have been heard first.
    Lost,
}

/// Hearing of a component of an edge. The last two have a value, by which a tick tells them from the others at once.
#[derive(Clone, Copy, Debug, PartialEq, PartialOrd)]
enum Hearing {
    /// Nothing: there was no tick yet.
    New,
    /// Never heard since the first tick.
    Waiting,
    /// Heard once, and silent for too long.
    Lost,
    /// Never heard, for too long.
    Missed,
    /// Too many values in a row were not taken. `tick` is that of the last one.
    Barred,
    /// Its value means something.
    Known,
    /// The same, and the neighbour has said that it starts anew: the value that comes next may be anywhere.
    Anew,
}

impl<F: Real> Edge<F> {
    fn presence(&self) -> Presence {
        match self.hearing {
            Hearing::New | Hearing::Waiting => Presence::Unheard,
            Hearing::Known | Hearing::Anew => Presence::Known,
            Hearing::Lost | Hearing::Missed | Hearing::Barred => Presence::Lost,
        }
    }

    #[inline]
    fn is_known(&self) -> bool {
        self.hearing >= Hearing::Known
    }

    /// Whether the edge is given up at tick `k`, where there is no value, or one that is too old. Time counts
    /// from the first tick, since a node may join a network that runs, and get a neighbour while it does.
    #[cold]
    fn gives_up(&mut self, k: u32, extrapolate_ticks: i32) -> bool {
        if self.hearing == Hearing::New {
            (self.hearing, self.tick) = (Hearing::Waiting, k.wrapping_sub(1));
        }
        let is_anew = self.hearing == Hearing::Anew;
        let given_up = match self.hearing {
            Hearing::Known | Hearing::Anew => Hearing::Lost,
            Hearing::Waiting => Hearing::Missed,
            Hearing::New | Hearing::Lost | Hearing::Missed | Hearing::Barred => return false,
        };
        let gives_up = self.age(k) > extrapolate_ticks;
        if gives_up {
            (self.hearing, self.memory) = (given_up, Memory::default());
            // Who was silent may have started anew, and may be anywhere.
            if is_anew || 2 * i32::from(self.doubts) <= self.age(k) {
                self.doubts = 0;
            }
        }
        gives_up
    }

    /// Drops the edge to a neighbour that has stopped, with the state of `tick` as its last one; whether
    /// there was one to drop. Not where it has spoken since: then it is back.
    fn leaves(&mut self, tick: u32) -> bool {
        self.hearing = match self.hearing {
            Hearing::Known | Hearing::Anew if self.tick.wrapping_sub(tick) as i32 <= 0 => Hearing::Lost,
            Hearing::New | Hearing::Waiting => Hearing::Missed,
            Hearing::Lost | Hearing::Missed | Hearing::Barred => {
                self.may_be_another(tick);
                return false;
            }
            Hearing::Known | Hearing::Anew => return false,
        };
        (self.tick, self.memory, self.doubts) = (tick, Memory::default(), 0);
        true
    }

    /// Takes note that a neighbour starts anew, with the state after that of `tick` as its first one. Nothing is
    /// dropped: until that state comes it is extrapolated, as it was. States of up to `tick` are of before.
    fn starts_anew(&mut self, tick: u32, slope_limit: F) {
        match self.hearing {
            // There is nothing that a state would be held against.
            Hearing::New | Hearing::Waiting => {}
            Hearing::Lost | Hearing::Missed | Hearing::Barred => self.may_be_another(tick),
            // Who says so again and again is not extrapolated for ever.
            Hearing::Anew => {}
            // It has spoken since.
            Hearing::Known if (self.tick.wrapping_sub(tick) as i32) > 0 => {}
            Hearing::Known => {
                (self.value, _) = self.at(tick, slope_limit);
                (self.tick, self.hearing, self.doubts) = (tick, Hearing::Anew, 0);
            }
        }
    }

    /// Takes note that a neighbour that is gone may come back as another one. What it has said up to `tick` is of
    /// before.
    fn may_be_another(&mut self, tick: u32) {
        if self.hearing == Hearing::Barred {
            // `tick` may be before that of a state that was not taken, and that was the first one.
            (self.hearing, self.tick) = (Hearing::Lost, tick);
        } else if !self.is_of_before(tick) {
            self.tick = tick;
        }
        self.doubts = 0;
    }

    /// Why a value `x` of `tick` is not the first one of an edge that has none. `patience` is the time for
    /// which a silent neighbour is extrapolated.
    #[cold]
    #[inline(never)]
    fn keeps_out(&mut self, tick: u32, x: F, patience: i32, change_limit: F) -> Option<Refusal> {
        let since = tick.wrapping_sub(self.tick) as i32;
        match self.hearing {
            // A neighbour that has been silent for so long has started anew, as far as anybody can tell.
            Hearing::Barred if (1..=patience.max(1)).contains(&since) => {
                self.tick = tick;
                Some(Refusal::Barred)
            }
            Hearing::Lost if self.doubts != 0 && since > 0 => {
                let change = (x - self.value) / F::from_i32(since);
                (change.abs() > change_limit).then_some(Refusal::TooFast)
            }
            _ => None,
        }
    }

    /// Bars the edge, with the value of `tick` as the last one that was not taken.
    fn bar(&mut self, tick: u32) {
        (self.hearing, self.tick, self.memory) = (Hearing::Barred, tick, Memory::default());
    }

    /// Whether a value of `tick` is one of those that a neighbour has said before it stopped, or started anew, and that
    /// came after that.
    fn is_of_before(&self, tick: u32) -> bool {
        let since = tick.wrapping_sub(self.tick) as i32;
        // Ticks wrap, and it may be gone for longer than half of their range.
        (self.presence() == Presence::Lost || self.hearing == Hearing::Anew) && (-SPAN..=0).contains(&since)
    }

    /// Ticks since `value`; below zero where it came early.
    #[inline]
    fn age(&self, k: u32) -> i32 {
        k.wrapping_sub(self.tick) as i32
    }

    /// The value at tick `k`, and its change per tick: extrapolated by the last one where no value of this
    /// tick has come, and by no more than `slope_limit`.
    #[inline]
    fn at(&self, k: u32, slope_limit: F) -> (F, F) {
        match self.age(k) {
            0 => (self.value, self.increment),
            age => {
                let increment = self.increment.max(-slope_limit).min(slope_limit);
                (self.value + F::from_i32(age) * increment, increment)
            }
        }
    }
}

/// Outcome of edge-wise coupling for one component at one tick.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct EdgeInputs<F> {
    /// The diffusive term of the edge where it is largest, state units.
    pub nu: F,
    /// Sum of the inputs of all edges, state units / s.
    pub u: F,
}

/// Funnel of every edge at one tick. Each is floored by the states at its two ends, by its own input and
/// stiffness, and by nothing else: both ends know these, and their inputs have to cancel.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct EdgeFunnel<F> {
    /// Widths before flooring.
    pub widths: Widths<F>,
    /// Floor of an edge of stiffness 1.
    pub floor: Floor<F>,
}

impl<F: Real> EdgeFunnel<F> {
    #[inline]
    fn of(&self, edge: &EdgeTerm<F>, last: Option<F>, x: F, other: F) -> Widths<F> {
        let input = last.map_or(F::ZERO, F::abs);
        self.widths.floored(self.floor.times(edge.stiffness).width(larger(x.abs(), other.abs()), input))
    }
}

/// The node itself, as it enters the sums.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Own<F> {
    /// State as it was sent, state units. The node knows it better than an f32 does, but must not use that
    /// here: neighbours do not, and the diffusive terms of a network have to add up to zero
    /// (docs/notes/2026-11-23-whole-paper.md).
    pub x: F,
    /// Change of `x` over the last tick, state units.
    pub dx: F,
}

/// Sums over all known neighbours at one tick.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Sums<F> {
    /// `nu = sum_j alpha_j (x_j - x)`, state units.
    pub nu: F,
    /// Change of `nu` over the last tick, from the increments, state units.
    pub dnu: F,
    /// Largest `|x|` among the neighbours and the node itself, state units.
    pub largest: F,
    /// Neighbours that had to be extrapolated, since no value of this tick has come.
    pub extrapolated: u32,
    /// A neighbour that was lost at this tick (the last one, where there were several).
    pub lost: Option<NodeId>,
    /// Number of edges dropped at this tick.
    pub lost_count: u32,
}

/// Outcome of a received state.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Heard {
    /// A newer value of a known neighbour.
    Newer,
    /// The first value, or the first after its edge was dropped.
    First,
    /// The first value of a known neighbour that has started anew.
    Anew,
}

/// Outcome of a state that was not taken for what it says.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Doubt<F> {
    /// It is the first one in a row.
    pub is_first: bool,
    /// What it says beyond the last value that was taken, state units.
    pub change: F,
    /// The edge is barred from now on.
    pub bars: bool,
}

/// Table of neighbours with a fixed capacity.
#[derive(Clone, Debug)]
pub struct Neighbours<F> {
    /// Neighbour by neighbour, and the components of each in order.
    edges: Vec<Edge<F>, MAX_NEIGHBOURS>,
    /// Index of the first component by node id; `NONE` for strangers.
    slot: [u8; 128],
    components: u8,
    extrapolate_ticks: u32,
    /// The largest change of an extrapolated value per tick, state units.
    slope_limit: F,
    /// The largest change per tick of what is heard, state units.
    change_limit: F,
    /// Values in a row, not taken, that bar an edge; 0: none do.
    drop_after: u8,
    /// No edge has a value, though one had.
    alone: bool,
}

const NONE: u8 = u8::MAX;

impl<F: Real> Neighbours<F> {
    /// Table without neighbours yet. States have `components` (1 to 8).
    pub fn new(components: u8) -> Self {
        Self {
            edges: Vec::new(),
            slot: [NONE; 128],
            components,
            extrapolate_ticks: 0,
            slope_limit: F::WIDEST,
            change_limit: F::WIDEST,
            drop_after: 0,
            alone: false,
        }
    }

    /// Makes it the table of `edges`, of which no two are of one neighbour. What has been heard of neighbours
    /// that stay, and the last inputs of their edges, stay with them. Silent ones will be extrapolated for
    /// `extrapolate_ticks` ticks, by at most `slope_limit` (state units) per tick. Gives whether the edges
    /// are others now, or have other weights.
    // In place, by swaps: a second table beside this one would be 5.5 KiB of stack.
    pub fn set(&mut self, edges: &[EdgeConfig], extrapolate_ticks: u32, slope_limit: F) -> bool {
        (self.extrapolate_ticks, self.slope_limit) = (extrapolate_ticks, slope_limit);
        let slot = self.slots(edges);
        let mut changed = slot != self.slot;
        let before = core::mem::replace(&mut self.slot, slot);
        self.edges.retain(|edge| slot.get(usize::from(edge.id)).is_some_and(|&slot| slot != NONE));
        for edge in edges {
            if before.get(usize::from(edge.id)) == Some(&NONE) {
                self.push(edge.id);
            }
        }
        (0..self.edges.len()).for_each(|index| self.fill(index));
        for (edge, of_edge) in edges.iter().zip(self.edges.chunks_mut(usize::from(self.components.max(1)))) {
            let stiffness = f64::from(edge.weight) * (edges.len() + usize::from(edge.edges)) as f64;
            let (weight, stiffness) = (F::from_f32(edge.weight), F::from_f64(stiffness));
            for part in of_edge {
                changed |= (part.weight, part.stiffness) != (weight, stiffness);
                (part.weight, part.stiffness) = (weight, stiffness);
            }
        }
        self.alone &= !self.edges.iter().any(Edge::is_known);
        changed
    }

    /// Takes a value only if it has changed by no more than `change_limit` (state units) per tick since the last one
    /// that was taken, and bars an edge after `drop_after` values in a row that were not; 0 never does.
    pub fn doubt_beyond(&mut self, change_limit: F, drop_after: u8) {
        (self.change_limit, self.drop_after) = (change_limit, drop_after);
    }

    /// Whether the node had edges, and all of them are gone.
    #[inline]
    pub fn is_alone(&self) -> bool {
        self.alone
    }

    /// Places of the first component of each edge, by node id.
    fn slots(&self, edges: &[EdgeConfig]) -> [u8; 128] {
        let mut slots = [NONE; 128];
        for (edge, first) in edges.iter().zip((0..NONE).step_by(usize::from(self.components.max(1)))) {
            if let Some(slot) = slots.get_mut(usize::from(edge.id)) {
                *slot = first;
            }
        }
        slots
    }

    /// Appends the components of an edge to `id`, nothing heard yet.
    fn push(&mut self, id: u8) {
        for component in 0..self.components {
            let _ = self.edges.push(Edge {
                id,
                component,
                weight: F::ZERO,
                stiffness: F::ZERO,
                value: F::ZERO,
                increment: F::ZERO,
                tick: 0,
                hearing: Hearing::New,
                doubts: 0,
                memory: Memory::default(),
            });
        }
    }

    /// Brings what belongs to `index` there; what is before it is in its place. Each swap brings one edge to
    /// its own.
    fn fill(&mut self, index: usize) {
        for _ in index..self.edges.len() {
            let Some(edge) = self.edges.get(index) else { return };
            let first = self.slot.get(usize::from(edge.id)).copied().unwrap_or(NONE);
            let target = usize::from(first) + usize::from(edge.component);
            match self.edges.get_mut(index..=target) {
                Some([edge, .., other]) => core::mem::swap(edge, other),
                _ => return,
            }
        }
    }

    /// Number of neighbours.
    pub fn count(&self) -> usize {
        self.edges.len() / usize::from(self.components.max(1))
    }

    /// Number of neighbours that have been silent for too long.
    pub fn lost(&self) -> usize {
        let lost = |edge: &&Edge<F>| edge.component == 0 && edge.presence() == Presence::Lost;
        self.edges.iter().filter(lost).count()
    }

    /// Presence of neighbour `id`, by the first component of its state; `None` for a stranger.
    pub fn presence(&self, id: NodeId) -> Option<Presence> {
        self.of(id).first().map(Edge::presence)
    }

    /// Whether the edge to neighbour `id` is barred; `None` for a stranger.
    pub fn is_barred(&self, id: NodeId) -> Option<bool> {
        self.of(id).first().map(|edge| edge.hearing == Hearing::Barred)
    }

    /// Whether any component of neighbour `id` was ever heard, or has been since it became a neighbour;
    /// `None` for a stranger.
    pub fn was_heard(&self, id: NodeId) -> Option<bool> {
        let of_id = self.of(id);
        let heard =
            |edge: &Edge<F>| edge.is_known() || matches!(edge.hearing, Hearing::Lost | Hearing::Barred);
        (!of_id.is_empty()).then(|| of_id.iter().any(heard))
    }

    /// The components of the edge to `id`; none where there is no such edge.
    fn of(&self, id: NodeId) -> &[Edge<F>] {
        let first = usize::from(self.slot.get(usize::from(id.get())).copied().unwrap_or(NONE));
        self.edges.get(first..first + usize::from(self.components)).unwrap_or(&[])
    }

    /// The edge to the `index`-th neighbour: its id and weight.
    pub fn edge(&self, index: usize) -> Option<(NodeId, F)> {
        let edge = self.edges.get(index * usize::from(self.components))?;
        NodeId::new(edge.id).map(|id| (id, edge.weight))
    }

    /// The weight of the edge to `id`, if there is one.
    pub fn weight(&self, id: NodeId) -> Option<F> {
        let slot = self.slot.get(usize::from(id.get())).copied().unwrap_or(NONE);
        self.edges.get(usize::from(slot)).map(|edge| edge.weight)
    }

    /// Takes a component `x` of a neighbour's state (state units) stamped `tick`; `own` is the tick that the
    /// node computes next. Gives, too, by how many ticks it came late: those that it is for have run.
    ///
    /// # Errors
    /// `Value` for a component that the states do not have, `UnknownSource`, `TickWindow`, `Stale`,
    /// `Duplicate`, `TooFast` or `Barred`; then nothing has changed, but that a barred neighbour is not silent.
    #[inline]
    pub fn hear(
        &mut self,
        id: NodeId,
        component: Component,
        tick: TickStamp,
        own: u32,
        x: F,
    ) -> Result<(Heard, i32), Refusal> {
        let slot = self.slot.get(usize::from(id.get())).copied().unwrap_or(NONE);
        if component.get() >= self.components {
            return Err(Refusal::Value);
        }
        let index = usize::from(slot) + usize::from(component.get());
        let edge = self.edges.get_mut(index).ok_or(Refusal::UnknownSource)?;
        let tick = tick.rebuild(own, WINDOW_BACK, WINDOW_AHEAD).ok_or(Refusal::TickWindow)?;
        let age = own.wrapping_sub(tick) as i32;
        if edge.hearing != Hearing::Known {
            // Older than what is extrapolated, it would be dropped again at the next tick.
            let patience = self.extrapolate_ticks as i32;
            if age > patience || edge.is_of_before(tick) {
                return Err(Refusal::Stale);
            }
            let heard = if edge.hearing == Hearing::Anew { Heard::Anew } else { Heard::First };
            if let Some(reason) = edge.keeps_out(tick, x, patience, self.change_limit) {
                return Err(reason);
            }
            (edge.value, edge.increment, edge.tick, edge.hearing) = (x, F::ZERO, tick, Hearing::Known);
            (edge.doubts, self.alone) = (0, false);
            return Ok((heard, age));
        }
        let gap = tick.wrapping_sub(edge.tick) as i32;
        let increment = match gap {
            1 => x - edge.value,
            2.. => (x - edge.value) / F::from_i32(gap),
            0 => return Err(Refusal::Duplicate),
            _ => return Err(Refusal::Stale),
        };
        if increment.abs() > self.change_limit {
            return Err(Refusal::TooFast);
        }
        (edge.value, edge.increment, edge.tick, edge.doubts) = (x, increment, tick, 0);
        Ok((Heard::Newer, age))
    }

    /// Takes note that a value `x` of neighbour `id`, stamped `tick`, was not taken for what it says; `own` is
    /// the tick that the node computes next. `None` where that is no news: of a stranger, of a tick that has
    /// a value, or of one outside the window. Too many in a row bar the edge, all of its components.
    #[cold]
    #[inline(never)]
    pub fn doubt(
        &mut self,
        id: NodeId,
        component: Component,
        tick: TickStamp,
        own: u32,
        x: F,
    ) -> Option<Doubt<F>> {
        let first = usize::from(self.slot.get(usize::from(id.get())).copied().unwrap_or(NONE));
        let of_id = self.edges.get_mut(first..first + usize::from(self.components))?;
        let tick = tick.rebuild(own, WINDOW_BACK, WINDOW_AHEAD)?;
        let edge = of_id.get_mut(usize::from(component.get()))?;
        if edge.tick.wrapping_sub(tick) as i32 >= 0 && edge.hearing != Hearing::New {
            return None;
        }
        if edge.hearing == Hearing::Barred {
            edge.tick = tick;
            return None;
        }
        edge.doubts = edge.doubts.saturating_add(1);
        let (is_first, change) = (edge.doubts == 1, x - edge.value);
        let bars = self.drop_after != 0 && edge.doubts >= self.drop_after;
        if bars {
            of_id.iter_mut().for_each(|edge| edge.bar(tick));
            self.alone = !self.edges.iter().any(Edge::is_known);
        }
        Some(Doubt { is_first, change, bars })
    }

    /// Drops the edge to neighbour `id`, which says that it has stopped and that its last state was that of
    /// `tick`; `own` is the tick that the node computes next. Gives whether there was one to drop.
    #[cold]
    pub fn leaves(&mut self, id: NodeId, tick: TickStamp, own: u32) -> bool {
        let first = usize::from(self.slot.get(usize::from(id.get())).copied().unwrap_or(NONE));
        let of_id = self.edges.get_mut(first..first + usize::from(self.components));
        let Some((edges, tick)) = of_id.zip(tick.rebuild(own, WINDOW_BACK, WINDOW_AHEAD)) else {
            return false;
        };
        let dropped = edges.iter_mut().fold(false, |dropped, edge| edge.leaves(tick) | dropped);
        if dropped {
            self.alone = !self.edges.iter().any(Edge::is_known);
        }
        dropped
    }

    /// Takes note that neighbour `id` starts anew, with the state after that of `tick` as its first one; `own` is the
    /// tick that the node computes next.
    #[cold]
    #[inline(never)]
    pub fn starts_anew(&mut self, id: NodeId, tick: TickStamp, own: u32) {
        let first = usize::from(self.slot.get(usize::from(id.get())).copied().unwrap_or(NONE));
        let of_id = self.edges.get_mut(first..first + usize::from(self.components));
        let Some((edges, tick)) = of_id.zip(tick.rebuild(own, WINDOW_BACK, WINDOW_AHEAD)) else { return };
        let slope_limit = self.slope_limit;
        edges.iter_mut().for_each(|edge| edge.starts_anew(tick, slope_limit));
    }

    /// Sums of one component at tick `k`, for the node's own state.
    #[inline]
    pub fn sums(&mut self, k: u32, component: u8, own: Own<F>) -> Sums<F> {
        let Own { x, dx } = own;
        let (extrapolate_ticks, slope_limit) = (self.extrapolate_ticks as i32, self.slope_limit);
        let mut sums = Sums { largest: x.abs(), ..Sums::default() };
        for edge in &mut self.edges {
            if edge.component != component {
                continue;
            }
            let age = edge.age(k);
            if !edge.is_known() || age > extrapolate_ticks {
                if edge.gives_up(k, extrapolate_ticks) {
                    sums.lost = NodeId::new(edge.id);
                    sums.lost_count += 1;
                }
                continue;
            }
            let (value, increment) = edge.at(k, slope_limit);
            // A value that came early is taken back to `k`, which is not for want of a fresh one.
            sums.extrapolated += u32::from(age > 0);
            sums.nu += edge.weight * (value - x);
            sums.dnu += edge.weight * (increment - dx);
            // `max` would look for NaN as well, at each edge; there is none.
            let size = value.abs();
            if size > sums.largest {
                sums.largest = size;
            }
        }
        if sums.lost_count != 0 {
            self.alone = !self.edges.iter().any(Edge::is_known);
        }
        sums
    }

    /// Takes note that the actuator has done only `share` (0 to 1) of the inputs that the edges have asked
    /// for in one component. Each edge goes on from its part of that.
    pub fn feed_back(&mut self, component: u8, share: F) {
        for edge in self.edges.iter_mut().filter(|edge| edge.component == component) {
            if let Some(u) = edge.memory.last_input() {
                edge.memory.feed_back(u * share);
            }
        }
    }

    /// Numbers of edges, component by component, that have a value, and that are still waited for.
    pub fn known_and_unheard(&self) -> (usize, usize) {
        let count = |presence| self.edges.iter().filter(|edge| edge.presence() == presence).count();
        (count(Presence::Known), count(Presence::Unheard))
    }

    /// Sum of the weights of the edges that have a value in one component.
    pub fn known_degree(&self, component: u8) -> F {
        let known = self.edges.iter().filter(|edge| edge.is_known() && edge.component == component);
        known.fold(F::ZERO, |sum, edge| sum + edge.weight)
    }

    /// The largest `alpha_j |x_j - x|` at tick `k` in one component, for the node's own state `x`; state
    /// units.
    #[cold]
    pub fn largest_term(&self, k: u32, component: u8, x: F) -> F {
        let known = self.edges.iter().filter(|edge| edge.is_known() && edge.component == component);
        known.fold(F::ZERO, |most, edge| {
            let (value, _) = edge.at(k, self.slope_limit);
            larger(most, (edge.weight * (value - x)).abs())
        })
    }

    /// Takes note that from tick `k` on a tick lasts `times` times as long, and scales the increments that
    /// came before it.
    #[cold]
    pub fn stretch(&mut self, k: u32, times: F) {
        for edge in self.edges.iter_mut().filter(|edge| edge.age(k) >= 0) {
            edge.increment = edge.increment * times;
        }
    }

    /// Takes note that something in one component does not follow from what was before (law.md 3).
    pub fn disturb(&mut self, component: u8) {
        let edges = self.edges.iter_mut().filter(|edge| edge.component == component);
        edges.for_each(|edge| edge.memory.disturb());
    }

    /// Inputs of all edges for one component at tick `k`, after [`Self::sums`] has dropped the silent ones.
    pub fn edge_inputs<G: GainFunction<F>>(
        &mut self,
        k: u32,
        component: u8,
        own: Own<F>,
        (law, gain): (&EdgeWise<F>, &G),
        psi: EdgeFunnel<F>,
    ) -> EdgeInputs<F> {
        let mut inputs: EdgeInputs<F> = EdgeInputs::default();
        let slope_limit = self.slope_limit;
        for edge in self.edges.iter_mut().filter(|edge| edge.is_known() && edge.component == component) {
            let (value, increment) = edge.at(k, slope_limit);
            let nu = edge.weight * (value - own.x);
            let dnu = edge.weight * (increment - own.dx);
            let term = EdgeTerm { nu, dnu, stiffness: edge.stiffness };
            let widths = psi.of(&term, edge.memory.last_input(), own.x, value);
            let u = law.step(gain, &mut edge.memory, &term, widths);
            inputs.u += u;
            if nu.abs() > inputs.nu.abs() {
                inputs.nu = nu;
            }
        }
        inputs
    }
}
