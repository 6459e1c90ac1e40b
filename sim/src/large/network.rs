//! All nodes, tick by tick, on as many threads as are given.

use super::block::{BLOCK, Block, Instant, Seen};
use super::columns::{Columns, Made, make};
use super::findings::Findings;
use super::kinds::{FunnelPair, Kind, Kinds, Shared, Width};
use super::row::Row;
use crate::loopback::Refused;
use crate::scenario::LargeScenario;
use crate::trace_hash::TraceHash;
use funnelnet_law::gain::GainFunction;
use funnelnet_node::Observation;
use rayon::prelude::*;
use std::fmt;

/// Why there is no network.
#[derive(Debug)]
#[non_exhaustive]
pub enum NotHeld {
    /// A node does not take what the scenario says.
    Refused(Refused),
    /// Threads cannot be had.
    Threads(rayon::ThreadPoolBuildError),
}

impl fmt::Display for NotHeld {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Refused(refused) => refused.fmt(f),
            Self::Threads(error) => write!(f, "no threads: {error}"),
        }
    }
}

impl std::error::Error for NotHeld {}

/// A network without a bus.
pub struct Network<'s> {
    scenario: &'s LargeScenario,
    columns: Columns,
    kinds: Kinds,
    funnels: Vec<FunnelPair>,
    shared: Shared,
    blocks: Vec<Block>,
    /// States of the last tick, and of the one that comes next.
    now: Vec<Seen>,
    next: Vec<Seen>,
    widths: Vec<Width>,
    /// The tick that comes next.
    k: u64,
    max_spread: f64,
    threads: Option<rayon::ThreadPool>,
}

impl<'s> Network<'s> {
    /// The network of a scenario on so many threads, 1 or more. No figure depends on their number.
    ///
    /// # Errors
    /// See [`NotHeld`].
    pub fn new(scenario: &'s LargeScenario, threads: usize) -> Result<Self, NotHeld> {
        Self::watching(scenario, threads, &[])
    }

    /// The same with nodes, by ascending index, of which each tick is seen.
    ///
    /// # Errors
    /// See [`NotHeld`].
    pub fn watching(scenario: &'s LargeScenario, threads: usize, watched: &[usize]) -> Result<Self, NotHeld> {
        let Made { mut columns, kinds, funnels, shared } = make(scenario).map_err(NotHeld::Refused)?;
        let nodes = scenario.nodes();
        let block = |first: usize| Block::new(first, BLOCK.min(nodes - first), watched);
        // One block has nothing to share out.
        let threads = if nodes <= BLOCK { 1 } else { threads };
        let pool = || rayon::ThreadPoolBuilder::new().num_threads(threads).build().map_err(NotHeld::Threads);
        let next: Vec<_> = columns.initial.iter().map(|&x| Seen { x, dx: 0.0 }).collect();
        columns.initial = Vec::new();
        Ok(Self {
            scenario,
            columns,
            kinds,
            funnels,
            shared,
            blocks: (0..nodes).step_by(BLOCK).map(block).collect(),
            now: next.clone(),
            next,
            widths: Vec::new(),
            k: 0,
            max_spread: 0.0,
            threads: if threads > 1 { Some(pool()?) } else { None },
        })
    }

    /// Runs the next tick of all nodes and gives its number, from 0 on; `None` after the last one of the scenario, or
    /// where a node would have stopped.
    pub fn step(&mut self) -> Option<u64> {
        let k = self.k;
        if k > self.scenario.time.ticks || self.has_halted() {
            return None;
        }
        self.k += 1;
        std::mem::swap(&mut self.now, &mut self.next);
        // The reader refuses more ticks than a node counts.
        let at = k as u32;
        self.widths.clear();
        self.widths.extend(self.funnels.iter().map(|funnel| funnel.at(at, self.scenario)));
        let Self { columns, kinds, shared, blocks, now, next, widths, threads, .. } = self;
        let instant = Instant { k: at, widths };
        match kinds {
            Kinds::Reciprocal(kinds) => {
                run(threads.as_ref(), blocks, (columns, kinds, shared), now, next, &instant)
            }
            Kinds::Any(kinds) => run(threads.as_ref(), blocks, (columns, kinds, shared), now, next, &instant),
        }
        let (low, high) = self.extremes();
        self.max_spread = self.max_spread.max(f64::from(high) - f64::from(low));
        Some(k)
    }

    fn has_halted(&self) -> bool {
        self.blocks.iter().any(|block| block.findings.halt.is_some())
    }

    fn extremes(&self) -> (f32, f32) {
        let all = self.blocks.iter().map(|block| block.findings.last);
        all.fold((f32::INFINITY, f32::NEG_INFINITY), |(low, high), last| (low.min(last.0), high.max(last.1)))
    }

    /// States of the last tick, by index.
    #[must_use]
    pub fn states(&self) -> &[Seen] {
        &self.now
    }

    /// What was seen at the last tick of the nodes that are watched, in their order.
    pub fn watched(&self) -> impl Iterator<Item = &Observation<f32>> {
        self.blocks.iter().flat_map(|block| &block.seen)
    }

    /// Quantiles of the last tick, over all nodes; those of ratios over all that have a neighbour.
    #[must_use]
    pub fn row(&self) -> Row {
        let inputs = self.blocks.iter().flat_map(Block::inputs);
        let Self { columns, shared, now, widths, .. } = self;
        let ratios = self.blocks.iter().flat_map(|block| match &self.kinds {
            Kinds::Reciprocal(kinds) => block.ratios((columns, kinds, shared), now, widths),
            Kinds::Any(kinds) => block.ratios((columns, kinds, shared), now, widths),
        });
        Row::of(
            self.scenario.time.at_s(self.k.saturating_sub(1)),
            self.now.iter().map(|seen| seen.x),
            ratios,
            inputs,
        )
    }

    /// Figures of all ticks so far.
    #[must_use]
    pub fn findings(&self) -> Findings {
        let mut all = Findings { last: self.extremes(), max_spread: self.max_spread, ..Findings::default() };
        self.blocks.iter().for_each(|block| all.add(&block.findings));
        all.judged -= all.uncoupled;
        all
    }

    /// Hash of all states so far: FNV-1a by tick and then by id; beyond one block of 4,096 nodes FNV-1a over the
    /// little-endian hashes of the blocks.
    #[must_use]
    pub fn hash(&self) -> TraceHash {
        if let [one] = self.blocks.as_slice() {
            return one.hash;
        }
        let mut hash = TraceHash::new();
        self.blocks.iter().for_each(|block| hash.push_bytes(&block.hash.value().to_le_bytes()));
        hash
    }
}

/// Runs a tick of all blocks, in any order.
fn run<G: GainFunction<f32> + Sync>(
    threads: Option<&rayon::ThreadPool>,
    blocks: &mut [Block],
    parts: (&Columns, &[Kind<G>], &Shared),
    now: &[Seen],
    next: &mut [Seen],
    at: &Instant<'_>,
) {
    match threads {
        None => {
            let pairs = blocks.iter_mut().zip(next.chunks_mut(BLOCK));
            pairs.for_each(|(block, next)| block.tick(parts, now, next, at));
        }
        Some(threads) => threads.install(|| {
            let pairs = blocks.par_iter_mut().zip(next.par_chunks_mut(BLOCK));
            pairs.for_each(|(block, next)| block.tick(parts, now, next, at));
        }),
    }
}
