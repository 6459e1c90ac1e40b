//! A run on a bench beside the same run in loopback, tick by tick.

use crate::engine::Engine;
use crate::extremes::larger;
use funnel_core::Observation;

/// How a node's run differs from loopback.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Difference {
    /// First tick at which a bit of state, diffusive term, funnel or input differs.
    pub first: Option<u64>,
    /// Largest distance of the states, state units; not a number where one is not.
    pub largest: f64,
}

impl Difference {
    /// Takes a state of the bench and the one of loopback.
    fn note(&mut self, bench: f64, loopback: f64) {
        self.largest = larger(self.largest, (bench - loopback).abs());
    }
}

/// Runs loopback along, so that nothing has to be kept.
pub struct Comparison {
    engine: Engine,
    differences: Vec<Difference>,
}

impl Comparison {
    /// Beside `engine`, which is not started yet.
    pub fn new(mut engine: Engine) -> Self {
        engine.start();
        let differences = vec![Difference::default(); engine.nodes().len()];
        Self { engine, differences }
    }

    /// Takes what the bench's nodes saw at tick `k`, by index and then by component.
    pub fn tick(&mut self, k: u64, seen: &[Observation<f32>]) {
        // Once all nodes have stopped by themselves, what they saw last stays.
        let _ = self.engine.advance();
        let components = seen.len().checked_div(self.differences.len()).unwrap_or(0).max(1);
        let here = seen.chunks(components).zip(self.engine.observations().chunks(components));
        for (difference, (bench, loopback)) in self.differences.iter_mut().zip(here) {
            for (a, b) in bench.iter().zip(loopback) {
                difference.note(f64::from(a.x), f64::from(b.x));
            }
            if bench.iter().map(bits).ne(loopback.iter().map(bits)) {
                difference.first.get_or_insert(k);
            }
        }
    }

    /// By index.
    pub fn differences(&self) -> &[Difference] {
        &self.differences
    }
}

fn bits(seen: &Observation<f32>) -> [u32; 4] {
    [seen.x, seen.nu, seen.psi, seen.u].map(f32::to_bits)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_state_that_is_not_a_number_is_the_farthest_of_all() {
        let mut difference = Difference::default();
        for (bench, loopback) in [(1.0, 2.5), (f64::NAN, 1.0), (3.0, 1.0)] {
            difference.note(bench, loopback);
        }
        assert!(difference.largest.is_nan());
    }
}
