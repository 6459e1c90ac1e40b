//! The funnels over the whole run.

use crate::extremes::{larger, smaller};
use crate::scenario::{Funnel, Scenario};

/// Points in time at which funnels are compared.
const SAMPLES: u32 = 1_000;

/// All funnels; nodes with the same funnel share its evaluation.
pub(super) struct Widths {
    kinds: Vec<Funnel<f64>>,
    /// Which kind each node has, by index.
    of_node: Vec<usize>,
    /// Narrowest funnel of each node over the run, by index (state units).
    pub narrowest: Vec<f64>,
    /// Widest funnel of all over the run (state units); infinite where one is infinite at t = 0.
    pub widest: f64,
    /// `r_psi`: the largest `psi_i / min_j psi_j` over the run (Assumption 5 (d)); infinite where only some
    /// funnels close.
    pub spread: f64,
}

impl Widths {
    pub fn of(scenario: &Scenario) -> Self {
        let mut kinds: Vec<Funnel<f64>> = Vec::new();
        let mut of_node = Vec::with_capacity(scenario.nodes.len());
        for node in &scenario.nodes {
            let known = kinds.iter().position(|kind| *kind == node.funnel);
            of_node.push(known.unwrap_or(kinds.len()));
            if known.is_none() {
                kinds.push(node.funnel);
            }
        }
        let mut narrowest = vec![f64::INFINITY; kinds.len()];
        let (mut spread, mut widest) = (1.0f64, 0.0f64);
        for t in instants(scenario.time.end_s())
            .chain(joins(&kinds).into_iter().filter(|t| *t <= scenario.time.end_s()))
        {
            let widths = kinds.iter().map(|kind| kind.width(t));
            let (mut low, mut high) = (f64::INFINITY, 0.0f64);
            for (narrowest, width) in narrowest.iter_mut().zip(widths) {
                *narrowest = smaller(*narrowest, width);
                (low, high) = (smaller(low, width), larger(high, width));
            }
            widest = larger(widest, high);
            // Funnels that are all closed, or some infinite, have no ratio.
            if high > 0.0 && high.is_finite() {
                spread = larger(spread, high / low);
            }
        }
        Self {
            narrowest: of_node.iter().map(|kind| narrowest[*kind]).collect(),
            kinds,
            of_node,
            widest,
            spread,
        }
    }

    /// `psi_i(t)` by index, `t` in s (state units).
    pub fn at(&self, t: f64) -> impl Iterator<Item = f64> {
        let widths: Vec<_> = self.kinds.iter().map(|kind| kind.width(t)).collect();
        self.of_node.iter().map(move |kind| widths[*kind])
    }
}

/// Where schedules join their parts (s), which is where one that widens first is widest.
fn joins(kinds: &[Funnel<f64>]) -> Vec<f64> {
    kinds.iter().filter_map(Funnel::join).collect()
}

/// Points in time from 0 to `end` (s), dense at the start, where funnels move.
pub(super) fn instants(end: f64) -> impl Iterator<Item = f64> {
    (0..=SAMPLES).map(move |k| {
        let part = f64::from(k) / f64::from(SAMPLES);
        end * part * part * part * part
    })
}
