//! What a node knows of its neighbours: value, increment, age.
//!
//! A neighbour that is not heard in time is extrapolated by its last increment, for a bounded number of ticks, and then
//! its edge is dropped until it is heard again (LAW.md 4: holding instead costs up to thirty times the error).

use crate::math::Real;
use funnel_protocol::config::MAX_NEIGHBOURS;
use funnel_protocol::message::NodeId;
use funnel_protocol::{Refusal, TickStamp};
use heapless::Vec;

/// How far back a received tick may lie.
pub const WINDOW_BACK: u32 = 8;
/// How far ahead a received tick may lie.
pub const WINDOW_AHEAD: u32 = 2;

/// One edge, as one end sees it.
#[derive(Clone, Copy, Debug)]
struct Edge<F> {
    id: u8,
    weight: F,
    /// Value at `tick`, state units.
    value: F,
    /// Change of the value per tick, state units.
    increment: F,
    tick: u32,
    /// Whether `value` means anything: heard, and not expired since.
    known: bool,
}

/// What enters the sums of the node itself.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Own<F> {
    /// State, state units.
    pub x: F,
    /// What rounding has added to `x`: the node knows its state as `x - carry`, better than an f32 does, and a funnel near
    /// its floor is kept the better for it.
    pub carry: F,
    /// Change of `x` over the last tick, state units.
    pub dx: F,
}

/// Sums over all known neighbours at one tick.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Sums<F> {
    /// `nu = sum_j alpha_j (x_j - x)`, state units.
    pub nu: F,
    /// Its change over the last tick, from the increments, state units.
    pub dnu: F,
    /// Largest `|x|` among the neighbours and the node itself, state units.
    pub largest: F,
    /// Neighbours that had to be extrapolated, since no value of this tick has come.
    pub extrapolated: u32,
    /// A neighbour whose edge was dropped at this tick (the last one, where there were several), and how many.
    pub lost: Option<NodeId>,
    /// How many edges were dropped at this tick.
    pub lost_count: u32,
}

/// What a received state was.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Heard {
    /// A newer value of a known neighbour.
    Newer,
    /// The first value, or the first after its edge was dropped.
    First,
}

/// Table of neighbours with a fixed capacity.
#[derive(Clone, Debug)]
pub struct Neighbours<F> {
    edges: Vec<Edge<F>, MAX_NEIGHBOURS>,
    /// Edge index by node id; `NONE` for strangers.
    slot: [u8; 128],
    extrapolate_ticks: u32,
}

const NONE: u8 = u8::MAX;

impl<F: Real> Neighbours<F> {
    /// No neighbours yet; silent ones will be extrapolated for `extrapolate_ticks` ticks.
    pub fn new(extrapolate_ticks: u32) -> Self {
        Self { edges: Vec::new(), slot: [NONE; 128], extrapolate_ticks }
    }

    /// Adds an edge; `false` where the table is full or the neighbour is there already.
    pub fn add(&mut self, id: NodeId, weight: F) -> bool {
        let next = self.edges.len() as u8;
        let Some(slot) = self.slot.get_mut(usize::from(id.get())) else { return false };
        if *slot != NONE {
            return false;
        }
        let edge = Edge { id: id.get(), weight, value: F::ZERO, increment: F::ZERO, tick: 0, known: false };
        let added = self.edges.push(edge).is_ok();
        if added {
            *slot = next;
        }
        added
    }

    /// Takes a neighbour's state `x` (state units) stamped `tick`; `own` is the tick that the node computes next.
    ///
    /// # Errors
    /// `UnknownSource`, `TickWindow`, `Stale` or `Duplicate`; then nothing has changed.
    #[inline]
    pub fn hear(&mut self, id: NodeId, tick: TickStamp, own: u32, x: F) -> Result<Heard, Refusal> {
        let slot = self.slot.get(usize::from(id.get())).copied().unwrap_or(NONE);
        let edge = self.edges.get_mut(usize::from(slot)).ok_or(Refusal::UnknownSource)?;
        let tick = tick.rebuild(own, WINDOW_BACK, WINDOW_AHEAD).ok_or(Refusal::TickWindow)?;
        if !edge.known {
            // Older than what is extrapolated, it would be dropped again at the next tick.
            let age = own.wrapping_sub(tick) as i32;
            if age > self.extrapolate_ticks as i32 {
                return Err(Refusal::Stale);
            }
            (edge.value, edge.increment, edge.tick, edge.known) = (x, F::ZERO, tick, true);
            return Ok(Heard::First);
        }
        let gap = tick.wrapping_sub(edge.tick) as i32;
        match gap {
            1 => edge.increment = x - edge.value,
            2.. => edge.increment = (x - edge.value) / F::from_i32(gap),
            0 => return Err(Refusal::Duplicate),
            _ => return Err(Refusal::Stale),
        }
        (edge.value, edge.tick) = (x, tick);
        Ok(Heard::Newer)
    }

    /// Sums at tick `k`, for the node's own state.
    #[inline]
    pub fn sums(&mut self, k: u32, own: Own<F>) -> Sums<F> {
        let Own { x, carry, dx } = own;
        let mut sums = Sums { largest: x.abs(), ..Sums::default() };
        for edge in &mut self.edges {
            if !edge.known {
                continue;
            }
            let mut value = edge.value;
            let age = k.wrapping_sub(edge.tick) as i32;
            if age != 0 {
                if age > self.extrapolate_ticks as i32 {
                    edge.known = false;
                    sums.lost = NodeId::new(edge.id);
                    sums.lost_count += 1;
                    continue;
                }
                value += F::from_i32(age) * edge.increment;
                // A value that came early is taken back to `k`, which is not for want of a fresh one.
                sums.extrapolated += u32::from(age > 0);
            }
            sums.nu += edge.weight * ((value - x) + carry);
            sums.dnu += edge.weight * (edge.increment - dx);
            sums.largest = sums.largest.max(value.abs());
        }
        sums
    }
}
