//! The communication graph: weights, Laplacian and its spectrum (the paper's Assumption 1).

use nalgebra::DMatrix;
use std::cmp::Reverse;
use std::collections::BinaryHeap;

/// An undirected edge between two different nodes.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Edge {
    /// The lower end, a 0-based index.
    pub a: usize,
    /// The upper end, a 0-based index.
    pub b: usize,
    /// `alpha_ab = alpha_ba`, above zero.
    pub weight: f64,
}

/// A weighted undirected graph. Index i stands for the node with id i + 1.
#[derive(Clone, Debug, PartialEq)]
pub struct Graph {
    /// Number of nodes, N.
    pub nodes: usize,
    /// Each edge once, with a < b, sorted by (a, b).
    pub edges: Vec<Edge>,
}

impl Graph {
    /// The weighted degree `d_i`, the sum of `alpha_ij`.
    #[must_use]
    pub fn degree(&self, index: usize) -> f64 {
        self.neighbours(index).iter().map(|(_, weight)| weight).sum()
    }

    /// The neighbours of a node with their weights, by index.
    #[must_use]
    pub fn neighbours(&self, index: usize) -> Vec<(usize, f64)> {
        let other = |edge: &Edge| match index {
            i if i == edge.a => Some((edge.b, edge.weight)),
            i if i == edge.b => Some((edge.a, edge.weight)),
            _ => None,
        };
        let mut found: Vec<_> = self.edges.iter().filter_map(other).collect();
        found.sort_by_key(|(neighbour, _)| *neighbour);
        found
    }

    /// The Laplacian `L = D - A`, N by N.
    #[must_use]
    pub fn laplacian(&self) -> DMatrix<f64> {
        let mut matrix = DMatrix::zeros(self.nodes, self.nodes);
        for edge in &self.edges {
            matrix[(edge.a, edge.a)] += edge.weight;
            matrix[(edge.b, edge.b)] += edge.weight;
            matrix[(edge.a, edge.b)] -= edge.weight;
            matrix[(edge.b, edge.a)] -= edge.weight;
        }
        matrix
    }

    /// The eigenvalues of the Laplacian, ascending; the first is zero up to rounding.
    #[must_use]
    pub fn spectrum(&self) -> Vec<f64> {
        let mut values: Vec<f64> = self.laplacian().symmetric_eigenvalues().iter().copied().collect();
        values.sort_by(f64::total_cmp);
        values
    }

    /// Algebraic connectivity, the second eigenvalue; 0 for a single node.
    #[must_use]
    pub fn lambda2(&self) -> f64 {
        self.spectrum().get(1).copied().unwrap_or(0.0)
    }

    /// The largest eigenvalue of the Laplacian.
    #[must_use]
    pub fn lambda_max(&self) -> f64 {
        self.spectrum().last().copied().unwrap_or(0.0)
    }

    /// The diffusive terms `nu_i`, the sums of `alpha_ij (x_j - x_i)`, one per node (state units).
    #[must_use]
    pub fn diffusive_terms(&self, states: &[f64]) -> Vec<f64> {
        let mut terms = vec![0.0; self.nodes];
        for edge in &self.edges {
            let flow = edge.weight * (states[edge.b] - states[edge.a]);
            terms[edge.a] += flow;
            terms[edge.b] -= flow;
        }
        terms
    }

    /// The longest of the shortest ways between two nodes, where an edge is `1 / alpha` long; 0 for a single node.
    #[must_use]
    pub fn resistive_diameter(&self) -> f64 {
        (0..self.nodes).map(|from| self.farthest(from)).fold(0.0, f64::max)
    }

    /// Dijkstra's algorithm from one node: the length of the way to the node that is farthest off.
    fn farthest(&self, from: usize) -> f64 {
        let mut settled = vec![false; self.nodes];
        // Lengths are positive, so that their bits are ordered as they are.
        let mut ahead = BinaryHeap::from([Reverse((0.0f64.to_bits(), from))]);
        let mut farthest = 0.0;
        while let Some(Reverse((bits, node))) = ahead.pop() {
            if std::mem::replace(&mut settled[node], true) {
                continue;
            }
            farthest = f64::from_bits(bits);
            for (next, weight) in self.neighbours(node) {
                ahead.push(Reverse(((farthest + 1.0 / weight).to_bits(), next)));
            }
        }
        farthest
    }

    /// The connected components as sorted lists of indices; one for a connected graph.
    #[must_use]
    pub fn components(&self) -> Vec<Vec<usize>> {
        let mut label: Vec<usize> = (0..self.nodes).collect();
        for edge in &self.edges {
            let (keep, drop) = (label[edge.a].min(label[edge.b]), label[edge.a].max(label[edge.b]));
            label.iter_mut().filter(|l| **l == drop).for_each(|l| *l = keep);
        }
        let members = |root| (0..self.nodes).filter(|i| label[*i] == root).collect::<Vec<_>>();
        (0..self.nodes).map(members).filter(|part| !part.is_empty()).collect()
    }
}

#[cfg(test)]
mod tests {
    use std::f64::consts::PI;

    use super::super::topology::Topology;
    use super::*;
    use funnel_core::math;

    fn graph(topology: Topology, nodes: usize) -> Graph {
        let links = topology.links(nodes, 1).unwrap();
        Graph { nodes, edges: links.iter().map(|&(a, b)| Edge { a, b, weight: 1.0 }).collect() }
    }

    #[test]
    fn spectra_match_the_closed_forms() {
        let near = |a: f64, b: f64| assert!((a - b).abs() < 1e-10, "{a} is not {b}");
        for n in [3usize, 5, 12] {
            let nf = n as f64;
            near(graph(Topology::Ring, n).lambda2(), 2.0 - 2.0 * math::cos(2.0 * PI / nf));
            near(graph(Topology::Path, n).lambda2(), 2.0 - 2.0 * math::cos(PI / nf));
            near(graph(Topology::Path, n).lambda_max(), 2.0 + 2.0 * math::cos(PI / nf));
            near(graph(Topology::Star, n).lambda2(), 1.0);
            near(graph(Topology::Star, n).lambda_max(), nf);
            near(graph(Topology::Complete, n).lambda2(), nf);
        }
        assert_eq!(graph(Topology::Ring, 1).lambda2(), 0.0);
    }

    #[test]
    fn diffusive_terms_are_minus_the_laplacian() {
        let graph = Graph {
            nodes: 3,
            edges: vec![Edge { a: 0, b: 1, weight: 2.0 }, Edge { a: 1, b: 2, weight: 0.5 }],
        };
        assert_eq!(graph.diffusive_terms(&[1.0, 2.0, 6.0]), vec![2.0, 0.0, -2.0]);
        assert_eq!(graph.degree(1), 2.5);
        assert_eq!(graph.neighbours(1), vec![(0, 2.0), (2, 0.5)]);
    }

    #[test]
    fn the_resistive_diameter_goes_the_shortest_way() {
        let edge = |a, b, weight| Edge { a, b, weight };
        // 0 to 2 directly is 10 long, over 1 it is 2.5; 3 hangs on 2.
        let edges = vec![edge(0, 1, 2.0), edge(0, 2, 0.1), edge(1, 2, 0.5), edge(2, 3, 4.0)];
        assert_eq!(Graph { nodes: 4, edges }.resistive_diameter(), 2.75);
        assert_eq!(graph(Topology::Ring, 6).resistive_diameter(), 3.0);
        assert_eq!(graph(Topology::Path, 1).resistive_diameter(), 0.0);
    }

    #[test]
    fn components_are_named_in_order() {
        let edge = |a, b| Edge { a, b, weight: 1.0 };
        let graph = Graph { nodes: 6, edges: vec![edge(0, 3), edge(1, 4), edge(3, 5)] };
        assert_eq!(graph.components(), vec![vec![0, 3, 5], vec![1, 4], vec![2]]);
    }
}
