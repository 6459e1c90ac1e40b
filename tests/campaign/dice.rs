//! What draws numbers of a world.

use rand_pcg::Pcg64;
use sim_host::random::{self, Purpose};

/// What draws numbers.
pub(super) struct Dice(Pcg64);

impl Dice {
    /// Those of a number.
    pub(super) fn of(number: u64) -> Self {
        Self(random::stream(number, Purpose::Graph, 0))
    }

    pub(super) fn below(&mut self, n: usize) -> usize {
        random::below(&mut self.0, n)
    }

    pub(super) fn between(&mut self, low: f64, high: f64) -> f64 {
        // Three digits, so that a text says it all.
        ((low + (high - low) * random::uniform(&mut self.0)) * 1e3).round() / 1e3
    }

    pub(super) fn is(&mut self, probability: f64) -> bool {
        random::uniform(&mut self.0) < probability
    }

    pub(super) fn one<'a>(&mut self, list: &[&'a str]) -> &'a str {
        list[self.below(list.len())]
    }

    /// The id of a node.
    pub(super) fn id(&mut self, nodes: usize) -> usize {
        1 + self.below(nodes)
    }
}
