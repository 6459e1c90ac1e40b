//! The communication graph and its weights (the paper's Assumption 1).

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
    /// The weighted degrees `d_i`, the sums of `alpha_ij`, one per node.
    #[must_use]
    pub fn degrees(&self) -> Vec<f64> {
        let mut degrees = vec![0.0; self.nodes];
        for edge in &self.edges {
            degrees[edge.a] += edge.weight;
            degrees[edge.b] += edge.weight;
        }
        degrees
    }

    /// The neighbours of a node with their weights, by index. Looks at every edge: not for a loop over the
    /// nodes.
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

    /// The diffusive terms `nu_i`, the sums of `alpha_ij (x_j - x_i)`, one per node (state units).
    #[must_use]
    pub fn diffusive_terms(&self, states: &[f64]) -> Vec<f64> {
        self.terms_of(|index| states[index])
    }

    /// The same of states that are somewhere else, by index.
    #[must_use]
    pub fn terms_of(&self, state: impl Fn(usize) -> f64) -> Vec<f64> {
        let mut terms = vec![0.0; self.nodes];
        for edge in &self.edges {
            let flow = edge.weight * (state(edge.b) - state(edge.a));
            terms[edge.a] += flow;
            terms[edge.b] -= flow;
        }
        terms
    }

    /// The longest of the shortest ways between two nodes, where an edge is `1 / alpha` long; 0 for a single
    /// node.
    #[must_use]
    pub fn resistive_diameter(&self) -> f64 {
        crate::extremes::largest(0.0, (0..self.nodes).map(|from| self.farthest(from)))
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
        let mut parent: Vec<usize> = (0..self.nodes).collect();
        for edge in &self.edges {
            let (a, b) = (root(&mut parent, edge.a), root(&mut parent, edge.b));
            // The lowest index names its component, so that components come in the order of it.
            parent[a.max(b)] = a.min(b);
        }
        let mut parts = vec![Vec::new(); self.nodes];
        for index in 0..self.nodes {
            parts[root(&mut parent, index)].push(index);
        }
        parts.retain(|part| !part.is_empty());
        parts
    }
}

/// The root of a node's tree, which is flattened on the way (union-find by path halving).
fn root(parent: &mut [usize], mut index: usize) -> usize {
    while parent[index] != index {
        parent[index] = parent[parent[index]];
        index = parent[index];
    }
    index
}

#[cfg(test)]
mod tests {
    use std::f64::consts::PI;

    use super::super::topology::Topology;
    use super::*;
    use funnelnet_law::math;

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
    fn a_large_path_keeps_six_digits_of_lambda2() {
        let half_step = math::sin(PI / 2000.0);
        let relative = graph(Topology::Path, 1000).lambda2() / (4.0 * half_step * half_step) - 1.0;
        assert!(relative.abs() < 1e-6, "{relative:e}");
    }

    /// Against another library's eigenvalues, and on random graphs, which have no closed form.
    #[test]
    fn spectra_match_an_independent_solver() {
        for (topology, nodes) in [
            (Topology::RandomRegular { degree: 4 }, 150),
            (Topology::ErdosRenyi { probability: 0.1 }, 120),
            (Topology::Ring, 101),
            (Topology::Star, 60),
        ] {
            let mut graph = graph(topology, nodes);
            for (k, edge) in graph.edges.iter_mut().enumerate() {
                edge.weight = math::exp10((k % 7) as f64 / 3.0 - 1.0);
            }
            let laplacian = graph.laplacian();
            let dense = nalgebra::DMatrix::from_fn(nodes, nodes, |i, j| laplacian[(i, j)]);
            let mut expected: Vec<f64> = dense.symmetric_eigenvalues().iter().copied().collect();
            expected.sort_by(f64::total_cmp);
            let (lambda2, lambda_max) = (graph.lambda2(), graph.lambda_max());
            assert!((lambda2 / expected[1] - 1.0).abs() < 1e-9, "{topology:?}: {lambda2}");
            assert!((lambda_max / expected[nodes - 1] - 1.0).abs() < 1e-12, "{topology:?}: {lambda_max}");
        }
    }

    #[test]
    fn diffusive_terms_are_minus_the_laplacian() {
        let graph = Graph {
            nodes: 3,
            edges: vec![Edge { a: 0, b: 1, weight: 2.0 }, Edge { a: 1, b: 2, weight: 0.5 }],
        };
        assert_eq!(graph.diffusive_terms(&[1.0, 2.0, 6.0]), vec![2.0, 0.0, -2.0]);
        assert_eq!(graph.degrees(), [2.0, 2.5, 0.5]);
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
