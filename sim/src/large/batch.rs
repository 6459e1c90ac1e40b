//! Nodes of one kind with nothing out of the ordinary, in loops that a compiler makes of instructions for several nodes at once. Each node
//! has the operations of `Block::tick_one_by_one` in their order, so the same bits.
#![allow(clippy::neg_cmp_op_on_partial_ord, reason = "what is not a number is outside")]

use super::block::{Moving, Seen, Sums};
use super::columns::{Columns, Own};
use super::kinds::{Kind, Shared};
use funnelnet_law::field::{Scalar, Stride};
use funnelnet_law::funnel::Widths;
use funnelnet_law::gain::GainFunction;
use funnelnet_law::law::node_wise::Memory;

/// Nodes of a batch.
pub(super) const TOGETHER: usize = 64;

/// Numbers of the nodes of a batch, one by one.
type Lanes = [f32; TOGETHER];

/// A batch, before its tick and after it.
pub(super) struct Batch {
    pub x: Lanes,
    carry: Lanes,
    slope: Lanes,
    offset: Lanes,
    nu: Lanes,
    dnu: Lanes,
    largest: Lanes,
    /// What the law remembers.
    last: Lanes,
    before: Lanes,
    last_dnu: Lanes,
    /// Inputs, and states and what rounding leaves behind in them after the tick.
    pub u: Lanes,
    next_x: Lanes,
    next_carry: Lanes,
}

/// The kind of nodes of one kind, all with neighbours, whose fields are affine and whose inputs have no limits but the law's.
pub(super) fn kind<'k, G>(
    own: &[Own; TOGETHER],
    columns: &Columns,
    kinds: &'k [Kind<G>],
    shared: &Shared,
) -> Option<&'k Kind<G>> {
    let [one, ..] = own;
    if !shared.is_coupled || shared.accepts_f32 || !columns.phasor_starts.is_empty() {
        return None;
    }
    let are_alike = own.iter().all(|own| own.kind == one.kind && own.edges > 0);
    let kind = kinds.get(one.kind as usize).filter(|_| are_alike)?;
    (kind.limits.is_none() && kind.expression.is_none()).then_some(kind)
}

impl Default for Batch {
    fn default() -> Self {
        let none = [0.0; TOGETHER];
        Self {
            x: none,
            carry: none,
            slope: none,
            offset: none,
            nu: none,
            dnu: none,
            largest: none,
            last: none,
            before: none,
            last_dnu: none,
            u: none,
            next_x: none,
            next_carry: none,
        }
    }
}

impl Batch {
    /// Takes nodes. Whether their laws have all of their memory.
    pub fn take(
        &mut self,
        nodes: &[Moving; TOGETHER],
        me: &[Seen; TOGETHER],
        own: &[Own; TOGETHER],
        sums: &[Sums; TOGETHER],
    ) -> bool {
        let mut is_settled = true;
        for i in 0..TOGETHER {
            let memory = nodes[i].memory.as_settled();
            is_settled &= memory.is_some();
            let [last, before, dnu] = memory.unwrap_or_default();
            (self.last[i], self.before[i], self.last_dnu[i]) = (last, before, dnu);
            (self.x[i], self.carry[i]) = (me[i].x, nodes[i].carry);
            (self.slope[i], self.offset[i]) = (own[i].slope, own[i].offset);
            (self.nu[i], self.dnu[i], self.largest[i]) = (sums[i].nu, sums[i].dnu, sums[i].largest);
        }
        is_settled
    }

    /// Computes a tick. Whether no funnel is at its floor, and no input and no state beyond its limit.
    pub fn tick<G: GainFunction<f32>>(
        &mut self,
        kind: &Kind<G>,
        shared: &Shared,
        (k, widths): (u32, Widths<f32>),
    ) -> bool {
        let mut is_usual = true;
        for i in 0..TOGETHER {
            is_usual &= widths.clears(kind.floor.width(self.largest[i], self.last[i].abs()));
        }
        let psi = shared.guard.of(k, widths);
        for i in 0..TOGETHER {
            let mut memory = Memory::settled(self.last[i], self.before[i], self.last_dnu[i]);
            self.u[i] = kind.law.step(&mut memory, self.nu[i], self.dnu[i], psi).u;
        }
        let (stride, from) = (Stride { tick: shared.tick, half: 1 }, u64::from(k) << 1);
        for i in 0..TOGETHER {
            let field = Scalar { slope: self.slope[i], offset: self.offset[i], phasors: &[] };
            (self.next_x[i], self.next_carry[i]) =
                stride.midpoint(&field, from, (self.x[i], self.carry[i]), self.u[i]);
        }
        for i in 0..TOGETHER {
            // What is not a number is not within.
            is_usual &= self.u[i].abs() <= shared.input_limit && self.next_x[i].abs() <= shared.state_limit;
        }
        is_usual
    }

    /// Puts the nodes as they are after the tick in their places.
    pub fn put(&self, nodes: &mut [Moving; TOGETHER], next: &mut [Seen; TOGETHER]) {
        for i in 0..TOGETHER {
            let memory = Memory::settled(self.u[i], self.last[i], self.dnu[i]);
            nodes[i] = Moving { carry: self.next_carry[i], memory };
            next[i] = Seen { x: self.next_x[i], dx: self.next_x[i] - self.x[i] };
        }
    }
}

/// Values that are compared at once.
const WIDE: usize = 8;

/// The lowest of `values` and `low`.
pub(super) fn lowest(low: f32, values: &Lanes) -> f32 {
    extreme(low, values, |value, low| value < low)
}

/// The highest of `values` and `high`.
pub(super) fn highest(high: f32, values: &Lanes) -> f32 {
    extreme(high, values, |value, high| value > high)
}

fn extreme(start: f32, values: &Lanes, is_beyond: impl Fn(f32, f32) -> bool) -> f32 {
    let mut lanes = [start; WIDE];
    let (chunks, _) = values.as_chunks::<WIDE>();
    for chunk in chunks {
        for i in 0..WIDE {
            lanes[i] = if is_beyond(chunk[i], lanes[i]) { chunk[i] } else { lanes[i] };
        }
    }
    lanes.into_iter().fold(start, |best, value| if is_beyond(value, best) { value } else { best })
}
