//! A block of nodes: it reads the states of this tick, and writes its own of the next. The steps are those of
//! `funnelnet-node`, in the same order (node/src/node/tick.rs).
#![allow(clippy::neg_cmp_op_on_partial_ord, reason = "what is not a number is outside")]

use super::batch::{self, Batch, TOGETHER};
use super::columns::{Columns, Own};
use super::findings::{Findings, Halt};
use super::kinds::{Kind, Shared, Width};
use crate::extremes::larger;
use crate::trace_hash::TraceHash;
use funnelnet_law::field::{Scalar, Stride};
use funnelnet_law::gain::GainFunction;
use funnelnet_law::law::node_wise::Memory;
use funnelnet_law::math;
use funnelnet_node::Observation;

/// Nodes of a block, whatever the number of threads: no figure depends on that.
pub(super) const BLOCK: usize = 4096;

/// What others see of a node: its state and the last change of it, state units.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Seen {
    /// State.
    pub x: f32,
    /// Its change over the last tick.
    pub dx: f32,
}

/// What a node keeps for itself.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Moving {
    /// What rounding has left behind in the state.
    pub carry: f32,
    pub memory: Memory<f32>,
}

/// A tick, as all blocks see it.
pub(super) struct Instant<'a> {
    pub k: u32,
    /// By place of the funnel.
    pub widths: &'a [Width],
}

/// Nodes with indices that follow each other.
#[derive(Clone, Debug)]
pub(super) struct Block {
    first: usize,
    nodes: Vec<Moving>,
    /// Indices of nodes that are watched, ascending, and what was seen of them at the last tick.
    watched: Vec<usize>,
    pub seen: Vec<Observation<f32>>,
    pub findings: Findings,
    pub hash: TraceHash,
    /// Below this share of its funnel a term cannot be the largest so far; a little less than that.
    bar: f64,
    believed_bar: f32,
}

/// Sums over the edges of a node.
#[derive(Clone, Copy, Default)]
pub(super) struct Sums {
    pub nu: f32,
    pub dnu: f32,
    pub largest: f32,
    /// The same as `nu`, in f64.
    pub truth: f64,
}

/// What all blocks read.
pub(super) type Parts<'a, G> = (&'a Columns, &'a [Kind<G>], &'a Shared);

/// What a bar is below the largest ratio, for the rounding of the products that are compared with it.
const BELOW: f64 = 1.0 - 1e-12;
const BELOW_F32: f32 = 1.0 - 1e-5;

impl Block {
    pub fn new(first: usize, nodes: usize, watched: &[usize]) -> Self {
        let watched: Vec<_> =
            watched.iter().copied().filter(|index| (first..first + nodes).contains(index)).collect();
        Self {
            first,
            nodes: vec![Moving::default(); nodes],
            seen: vec![Observation::default(); watched.len()],
            watched,
            findings: Findings::default(),
            hash: TraceHash::new(),
            bar: 0.0,
            believed_bar: 0.0,
        }
    }

    /// The inputs that are held over the last tick, state units / s, by index.
    pub fn inputs(&self) -> impl Iterator<Item = f32> {
        self.nodes.iter().map(|node| node.memory.last_input().unwrap_or(0.0))
    }

    /// The share of its funnel that the true term of each node with a neighbour takes at the last tick, as it is judged.
    pub fn ratios<G>(
        &self,
        (columns, kinds, shared): Parts<'_, G>,
        now: &[Seen],
        widths: &[Width],
    ) -> Vec<f32> {
        let ratio = |(index, input): (usize, f32)| {
            let own = &columns.own[index];
            let (sums, kind) = (sums(columns, own, now[index], now), &kinds[own.kind as usize]);
            let drawn = widths.get(kind.funnel)?.judged;
            let psi = judged_width(shared, kind, drawn, sums.largest, input);
            (own.edges > 0).then(|| judged_ratio(sums.truth.abs(), psi) as f32)
        };
        (self.first..).zip(self.inputs()).filter_map(ratio).collect()
    }

    /// Runs a tick of all nodes.
    pub fn tick<G: GainFunction<f32>>(
        &mut self,
        parts: Parts<'_, G>,
        now: &[Seen],
        next: &mut [Seen],
        at: &Instant<'_>,
    ) {
        self.findings.last = (f32::INFINITY, f32::NEG_INFINITY);
        let nodes = self.nodes.len();
        let (mut ahead, mut batch) = ([Sums::default(); TOGETHER], Batch::default());
        for (offset, next) in (0..nodes).step_by(TOGETHER).zip(next.chunks_mut(TOGETHER)) {
            let (first, last) = (self.first + offset, self.first + offset + next.len());
            // States of neighbours are all over the memory, and the processor fetches many at once where nothing waits for one.
            let some = parts.0.own[first..last].iter().zip(&now[first..last]);
            ahead.iter_mut().zip(some).for_each(|(slot, (own, &me))| *slot = sums(parts.0, own, me, now));
            if !self.tick_at_once(offset, parts, (&mut batch, &ahead, now), next, at) {
                self.tick_one_by_one(offset, parts, (&ahead, now), next, at);
            }
        }
        self.findings.judged += nodes as u64;
    }

    /// Runs a tick of the nodes from `offset` on with nothing out of the ordinary, all at once. Where something of
    /// them is, nothing has happened.
    fn tick_at_once<G: GainFunction<f32>>(
        &mut self,
        offset: usize,
        parts: Parts<'_, G>,
        (batch, ahead, now): (&mut Batch, &[Sums; TOGETHER], &[Seen]),
        next: &mut [Seen],
        at: &Instant<'_>,
    ) -> bool {
        let (columns, kinds, shared) = parts;
        let first = self.first + offset;
        let range = first..first + TOGETHER;
        let is_watched = self.watched.iter().any(|index| range.contains(index));
        let (Ok(next), Some(own), Some(me), Some(nodes)) = (
            <&mut [Seen; TOGETHER]>::try_from(next),
            columns.own.get(range.clone()).and_then(|own| own.try_into().ok()),
            now.get(range).and_then(|now| now.try_into().ok()),
            self.nodes.get_mut(offset..).and_then(|nodes| nodes.first_chunk_mut()),
        ) else {
            return false;
        };
        let Some(kind) = batch::kind(own, columns, kinds, shared).filter(|_| !is_watched) else {
            return false;
        };
        let Width { widths, judged } = at.widths[kind.funnel];
        if !batch.take(nodes, me, own, ahead) || !batch.tick(kind, shared, (at.k, widths)) {
            return false;
        }
        batch.put(nodes, next);
        me.iter().for_each(|seen| self.hash.push(seen.x));
        let (low, high) = self.findings.last;
        self.findings.last = (batch::lowest(low, &batch.x), batch::highest(high, &batch.x));
        self.findings.max_input = batch::highest(self.findings.max_input, &batch.u.map(f32::abs));
        let believed_bar = self.believed_bar * widths.now;
        if !ahead.iter().all(|sums| sums.nu.abs() < believed_bar) {
            for sums in ahead {
                let size = sums.nu.abs();
                if !(size < self.believed_bar * widths.now) {
                    believe(&mut self.findings, &mut self.believed_bar, size / widths.now);
                }
            }
        }
        let bar = self.bar * judged;
        if !ahead.iter().all(|sums| sums.truth.abs() < bar) {
            for (index, sums) in (first..).zip(ahead) {
                if !(sums.truth.abs() < self.bar * judged) {
                    judge(&mut self.findings, &mut self.bar, (sums.truth.abs(), judged), (at.k, index));
                }
            }
        }
        true
    }

    /// Runs a tick of the nodes from `offset` on, one after the other.
    fn tick_one_by_one<G: GainFunction<f32>>(
        &mut self,
        offset: usize,
        (columns, kinds, shared): Parts<'_, G>,
        (ahead, now): (&[Sums; TOGETHER], &[Seen]),
        next: &mut [Seen],
        at: &Instant<'_>,
    ) {
        let mut hash = self.hash;
        let (mut low, mut high) = self.findings.last;
        let stride = Stride { tick: shared.tick, half: 1 };
        let from = u64::from(at.k) << 1;
        let first = self.first + offset;
        let mut watched = self.watched.partition_point(|&index| index < first);
        let own = &columns.own[first..first + next.len()];
        for (place, (own, next)) in own.iter().zip(next).enumerate() {
            let index = first + place;
            let me = now[index];
            hash.push(me.x);
            // No state is a NaN: the run would have ended.
            if me.x < low {
                low = me.x;
            }
            if me.x > high {
                high = me.x;
            }
            let sums = ahead[place];
            let kind = &kinds[own.kind as usize];
            let Width { widths, judged } = at.widths[kind.funnel];
            let node = &mut self.nodes[offset + place];
            let before = node.memory.last_input().map_or(0.0, f32::abs);
            let floor = kind.floor.width(sums.largest, before);
            let psi = match widths.clears(floor) {
                true => widths,
                false => {
                    self.findings.floored += 1;
                    widths.floored(floor)
                }
            };
            let size = sums.nu.abs();
            if !(size < self.believed_bar * psi.now) {
                believe(&mut self.findings, &mut self.believed_bar, size / psi.now);
            }
            let mut u = 0.0;
            let seen = |u| {
                let ratio = size / psi.now;
                Observation { tick: at.k, x: me.x, nu: sums.nu, psi: psi.now, ratio, u }
            };
            if shared.is_coupled {
                u = kind.law.step(&mut node.memory, sums.nu, sums.dnu, shared.guard.of(at.k, psi)).u;
                // Written so that NaN is outside.
                if !(u.abs() <= shared.input_limit) {
                    if !u.is_finite() {
                        halt(&mut self.findings, at.k, index, "its input is no finite number");
                        if self.watched.get(watched) == Some(&index) {
                            self.seen[watched] = seen(u);
                            watched += 1;
                        }
                        *next = Seen { x: me.x, dx: 0.0 };
                        continue;
                    }
                    u = shared.input_limit.copysign(u);
                    node.memory.feed_back(u);
                    self.findings.limited += 1;
                }
                if let Some(limits) = kind.limits {
                    let applied = limits.clamp(u);
                    if applied != u {
                        u = applied;
                        node.memory.feed_back(u);
                        self.findings.saturated += 1;
                    }
                }
                if u.abs() > self.findings.max_input {
                    self.findings.max_input = u.abs();
                }
            }
            let judged = judged_width(shared, kind, judged, sums.largest, u);
            if own.edges == 0 {
                self.findings.uncoupled += 1;
            } else if !(sums.truth.abs() < self.bar * judged) {
                judge(&mut self.findings, &mut self.bar, (sums.truth.abs(), judged), (at.k, index));
            }
            if self.watched.get(watched) == Some(&index) {
                self.seen[watched] = seen(u);
                watched += 1;
            }
            let mut x = me.x;
            match kind.expression {
                None => {
                    let Own { slope, offset, .. } = *own;
                    let field = Scalar { slope, offset, phasors: columns.phasors(index) };
                    stride.midpoint_step(&field, from, &mut x, &mut node.carry, u);
                }
                Some(place) => {
                    stride.midpoint_step(&shared.expressions[place], from, &mut x, &mut node.carry, u);
                }
            }
            // Written so that NaN is outside.
            if !(x.abs() <= shared.state_limit) {
                let why = if x.is_finite() {
                    "its state is beyond its limit"
                } else {
                    "its field is no finite number"
                };
                halt(&mut self.findings, at.k, index, why);
            }
            *next = Seen { x, dx: x - me.x };
        }
        self.hash = hash;
        self.findings.last = (low, high);
    }
}

#[inline]
fn sums(columns: &Columns, own: &Own, me: Seen, now: &[Seen]) -> Sums {
    let mut sums = Sums { nu: 0.0, dnu: 0.0, largest: me.x.abs(), truth: 0.0 };
    let range = own.first as usize..(own.first + own.edges) as usize;
    let neighbours = &columns.neighbours[range.clone()];
    if columns.weights.is_empty() {
        let weight = columns.weight;
        neighbours.iter().for_each(|&other| take(&mut sums, weight, me, now[other as usize]));
    } else {
        let weights = &columns.weights[range];
        neighbours
            .iter()
            .zip(weights)
            .for_each(|(&other, &weight)| take(&mut sums, weight, me, now[other as usize]));
    }
    sums
}

/// Adds an edge as a node does, and its true term.
#[inline(always)]
fn take(sums: &mut Sums, weight: f64, me: Seen, other: Seen) {
    let told = weight as f32;
    sums.nu += told * (other.x - me.x);
    sums.dnu += told * (other.dx - me.dx);
    let size = other.x.abs();
    if size > sums.largest {
        sums.largest = size;
    }
    sums.truth += weight * (f64::from(other.x) - f64::from(me.x));
}

/// Takes a ratio that a node may call its largest so far.
#[cold]
fn believe(findings: &mut Findings, bar: &mut f32, ratio: f32) {
    // What is not a number is not inside, and stays the largest.
    if !(ratio < 1.0) {
        findings.believed_breaches += 1;
    }
    findings.believed_ratio = math::larger(findings.believed_ratio, ratio);
    *bar = (findings.believed_ratio * BELOW_F32).min(BELOW_F32);
}

/// The funnel that a node is judged by: where the floor of f32 is accepted, not narrower than that.
#[inline(always)]
fn judged_width<G>(shared: &Shared, kind: &Kind<G>, drawn: f64, largest: f32, u: f32) -> f64 {
    match shared.accepts_f32 {
        true => larger(drawn, kind.judged_floor.width(largest.into(), f64::from(u).abs())),
        false => drawn,
    }
}

/// The share of its funnel that a term takes.
fn judged_ratio(nu: f64, psi: f64) -> f64 {
    // Zero in a funnel that has closed is inside it by no more than any other value is.
    if nu == 0.0 && psi == 0.0 { 1.0 } else { nu / psi }
}

/// Takes a true term that may be the largest so far, or outside.
#[cold]
fn judge(findings: &mut Findings, bar: &mut f64, (nu, psi): (f64, f64), (k, index): (u32, usize)) {
    let ratio = judged_ratio(nu, psi);
    if !(ratio < 1.0) {
        findings.breaches += 1;
        findings.first_breach.get_or_insert((k.into(), index));
    }
    findings.max_ratio = larger(findings.max_ratio, ratio);
    *bar = (findings.max_ratio * BELOW).min(BELOW);
}

#[cold]
fn halt(findings: &mut Findings, k: u32, node: usize, why: &'static str) {
    findings.halt.get_or_insert(Halt { tick: k.into(), node, why });
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used, clippy::panic, reason = "a test that cannot go on has failed")]

    use super::super::columns::{Made, make};
    use super::super::kinds::Kinds;
    use super::*;
    use crate::scenario::{AnyScenario, Source};

    /// A node whose input is no number is seen at that tick as well, and so are those after it.
    #[test]
    fn nodes_that_are_watched_are_seen_where_the_run_ends() {
        let text = r#"
            version = 1
            time = { tick = "1ms", duration = "1s" }
            graph = { kind = "path", nodes = 9 }
            coupling = { kind = "linear", gain = { kind = "linear", slope = 1.0 }, funnel = { kind = "constant", width = 9.0 } }
            agent.dynamics = { kind = "affine", slope = -1.0 }
            bus.model = "none"
        "#;
        let source = Source { text: text.to_owned(), path: "path.toml".into() };
        let Ok(AnyScenario::Large(scenario)) = source.any_scenario(&[]) else {
            panic!("{:?}", source.any_scenario(&[]))
        };
        let Made { columns, kinds, funnels, shared } = make(&scenario).unwrap();
        let Kinds::Any(kinds) = kinds else { panic!("{kinds:?}") };
        let widths: Vec<_> = funnels.iter().map(|funnel| funnel.at(7, &scenario)).collect();
        let mut now: Vec<_> = (0..9u8).map(|i| Seen { x: f32::from(i), dx: 0.0 }).collect();
        let mut next = now.clone();
        now[3].dx = f32::NAN;
        now[3].x = f32::NAN;
        let mut block = Block::new(0, 9, &[3, 8]);
        block.tick((&columns, &kinds, &shared), &now, &mut next, &Instant { k: 7, widths: &widths });
        assert_eq!(block.findings.halt.as_ref().map(|halt| (halt.tick, halt.node)), Some((7, 2)));
        let seen: Vec<_> = block.seen.iter().map(|seen| (seen.tick, seen.u.is_nan())).collect();
        assert_eq!(seen, [(7, true), (7, false)]);
        assert_eq!(block.seen[1].x, 8.0);
    }
}
