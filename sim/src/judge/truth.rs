//! True diffusive terms: of the states at equal true time, over the edges of the scenario, in f64.

use crate::presence::Presence;
use crate::scenario::{Coupling, Scenario};

/// Who is coupled to whom, and how a term is made of it.
pub(super) struct Truth {
    /// Index and weight of the neighbours, by index.
    neighbours: Vec<Vec<(usize, f64)>>,
    components: usize,
    /// Each edge has a term of its own, and that of a node is its largest.
    edge_wise: bool,
}

impl Truth {
    pub(super) fn of(scenario: &Scenario) -> Self {
        let graph = &scenario.graph;
        Self {
            neighbours: (0..scenario.nodes.len()).map(|index| graph.neighbours(index)).collect(),
            components: scenario.components(),
            edge_wise: scenario.coupling == Coupling::EdgeWise,
        }
    }

    /// Index and weight of the neighbours of a node.
    pub(super) fn neighbours(&self, index: usize) -> &[(usize, f64)] {
        self.neighbours.get(index).map_or(&[], Vec::as_slice)
    }

    /// Whether the term of a node is known: its own state is, and those of all its neighbours are. Edges
    /// exist whether or not a frame comes, but for those of a node that an event keeps off.
    pub(super) fn is_known(&self, index: usize, presence: &[Presence]) -> bool {
        let known = |index: usize| presence.get(index).is_some_and(|presence| presence.is_known());
        known(index)
            && self.neighbours(index).iter().all(|&(other, _)| known(other) || is_off(other, presence))
    }

    /// Whether a node has a neighbour that is there. A term of no edges is zero whatever the node does, and
    /// measures nothing.
    pub(super) fn is_coupled(&self, index: usize, presence: &[Presence]) -> bool {
        self.neighbours(index).iter().any(|&(other, _)| !is_off(other, presence))
    }

    /// Writes `sum_j alpha_ij (x_j - x_i)` by index and then by component, state units; with edge-wise
    /// coupling the term of the edge where it is largest. NaN where it is not known, or has no edge.
    pub(super) fn terms(&self, x: &[f64], presence: &[Presence], terms: &mut [f64]) {
        let components = self.components;
        for (at, slot) in terms.iter_mut().enumerate() {
            let (index, component) = (at / components, at % components);
            *slot = match x.get(at) {
                Some(&own) if self.is_known(index, presence) && self.is_coupled(index, presence) => {
                    let other =
                        |other: usize| x.get(other * components + component).copied().unwrap_or(f64::NAN);
                    let there = self.neighbours(index).iter().filter(|&&(j, _)| !is_off(j, presence));
                    let edges = there.map(|&(j, weight)| weight * (other(j) - own));
                    if self.edge_wise { edges.fold(0.0, farther) } else { edges.sum() }
                }
                _ => f64::NAN,
            };
        }
    }
}

fn is_off(index: usize, presence: &[Presence]) -> bool {
    presence.get(index) == Some(&Presence::Off)
}

/// The one of larger size; NaN where one is.
fn farther(a: f64, b: f64) -> f64 {
    if a.is_nan() || a.abs() > b.abs() { a } else { b }
}
