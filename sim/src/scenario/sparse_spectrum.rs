//! The second eigenvalue of the Laplacian of a large graph, by restarted Lanczos iterations on the sparse matrix.
#![allow(clippy::neg_cmp_op_on_partial_ord, reason = "what is not a number is outside")]

use super::Graph;
use crate::random::mix;
use faer::dyn_stack::{MemBuffer, MemStack, StackReq};
use faer::matrix_free::LinOp;
use faer::matrix_free::eigen::{
    PartialEigenParams, partial_self_adjoint_eigen, partial_self_adjoint_eigen_scratch,
};
use faer::{Col, Mat, MatMut, MatRef, Par};

/// Dimensions of the space of the iteration, between restarts and at most; restarts.
const DIMENSIONS: (usize, usize) = (24, 64);
const RESTARTS: usize = 24;
/// Size of the residual at which an iteration stops: of the first try, and where that is too coarse for
/// the value that was found, as a share of it.
const TOLERANCE: f64 = 1e-7;
const SHARE: f64 = 5e-7;

/// An eigenvalue, and how far from it the true one is at most.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Estimate {
    /// The value that was found. It is not below the true one but for rounding: a Rayleigh quotient.
    pub value: f64,
    /// Bound of its error, if no eigenvalue has escaped both searches: the residual. The whole value where the second search ended
    /// at nothing.
    pub error: f64,
}

impl Estimate {
    /// The bound over the value.
    #[must_use]
    pub fn relative(&self) -> f64 {
        self.error / self.value
    }
}

impl Graph {
    /// The second eigenvalue of the Laplacian, from vectors that are all orthogonal to the first one. `None` where the
    /// iteration finds nothing.
    ///
    /// The residual bounds the distance to some eigenvalue. That it is the second one is not proven: two searches say so, the
    /// second from another random vector with the vector of the first projected out, and the lower value counts. An
    /// eigenvector escapes only where both start vectors have next to nothing of it. Where eigenvalues are close together
    /// beside the largest (a path, a ring), an iteration does not resolve them, and ends at nothing or at a wide bound. On one
    /// thread, so that the bits do not depend on cores.
    #[must_use]
    pub fn sparse_lambda2(&self) -> Option<Estimate> {
        // The iteration needs more nodes than it has dimensions.
        if self.nodes <= DIMENSIONS.1 + 2 {
            let error = || f64::EPSILON * self.lambda_max() * self.nodes as f64;
            return (self.nodes > 1).then(|| Estimate { value: self.lambda2(), error: error() });
        }
        let mut reflected = Reflected::of(self);
        let first = reflected.search_closely(0)?;
        let Pair { value, residual, .. } = first;
        reflected.known = Some(first.vector);
        Some(match reflected.search_closely(1) {
            None => Estimate { value, error: value },
            Some(second) => {
                let lowest = value.min(second.value);
                let bound = (value - residual).min(second.value - second.residual);
                Estimate { value: lowest, error: lowest - bound }
            }
        })
    }
}

/// An eigenvalue that was found.
struct Pair {
    value: f64,
    /// Size of its residual.
    residual: f64,
    /// Of length 1, and orthogonal to the constant one.
    vector: Vec<f64>,
}

/// `top - L` for vectors orthogonal to the constant one, with `top` at or above all eigenvalues of `L`: what is lowest
/// there is largest here.
#[derive(Debug)]
struct Reflected {
    top: f64,
    degrees: Vec<f64>,
    starts: Vec<usize>,
    neighbours: Vec<(u32, f64)>,
    /// A vector of length 1 that is projected out.
    known: Option<Vec<f64>>,
}

impl Reflected {
    fn of(graph: &Graph) -> Self {
        let mut counts = vec![0usize; graph.nodes + 1];
        for edge in &graph.edges {
            counts[edge.a + 1] += 1;
            counts[edge.b + 1] += 1;
        }
        for at in 0..graph.nodes {
            counts[at + 1] += counts[at];
        }
        let (starts, mut next) = (counts.clone(), counts);
        let mut neighbours = vec![(0, 0.0); 2 * graph.edges.len()];
        for edge in &graph.edges {
            for (from, to) in [(edge.a, edge.b), (edge.b, edge.a)] {
                neighbours[next[from]] = (to as u32, edge.weight);
                next[from] += 1;
            }
        }
        let degrees = graph.degrees();
        // Gershgorin, sharper: the largest sum of two neighbouring degrees (Anderson and Morley, 1985).
        let sums = graph.edges.iter().map(|edge| degrees[edge.a] + degrees[edge.b]);
        let top = crate::extremes::largest(0.0, sums);
        Self { top, degrees, starts, neighbours, known: None }
    }

    /// `L x`.
    fn laplacian(&self, x: &[f64], out: &mut [f64]) {
        for (i, out) in out.iter_mut().enumerate() {
            let edges = &self.neighbours[self.starts[i]..self.starts[i + 1]];
            let others: f64 = edges.iter().map(|&(j, weight)| weight * x[j as usize]).sum();
            *out = self.degrees[i] * x[i] - others;
        }
    }

    /// The lowest eigenvalue that is not known, to a share of itself where the iteration comes to that.
    fn search_closely(&self, start: u64) -> Option<Pair> {
        let found = self.search(start, TOLERANCE)?;
        let enough = SHARE * found.value;
        match found.residual > enough {
            true => self.search(start, 0.5 * enough).or(Some(found)),
            false => Some(found),
        }
    }

    /// The same with a residual of this size, from a random vector.
    fn search(&self, start: u64, tolerance: f64) -> Option<Pair> {
        // The iteration asks this, too: `Par::Seq` below does not reach its products. Threads cost it twice the processor time,
        // and would make the bits depend on cores.
        faer::set_global_parallelism(Par::Seq);
        let nodes = self.degrees.len();
        let params = PartialEigenParams {
            min_dim: DIMENSIONS.0,
            max_dim: DIMENSIONS.1,
            max_restarts: RESTARTS,
            ..PartialEigenParams::default()
        };
        let random = |i: usize| mix(i as u64 ^ (start << 32)) as f64 / u64::MAX as f64 - 0.5;
        let mut x: Vec<f64> = (0..nodes).map(random).collect();
        self.project(&mut x);
        let (mut vectors, mut values) = (Mat::zeros(nodes, 1), [0.0]);
        let mut memory = MemBuffer::new(partial_self_adjoint_eigen_scratch(self, 1, Par::Seq, params));
        partial_self_adjoint_eigen(
            vectors.as_mut(),
            &mut values,
            self,
            Col::from_fn(nodes, |i| x[i]).as_ref(),
            tolerance,
            Par::Seq,
            MemStack::new(&mut memory),
            params,
        );
        self.pair(vectors.col_as_slice(0).to_vec())
    }

    /// Takes the constant vector and the known one out of a vector.
    fn project(&self, x: &mut [f64]) {
        centre(x);
        if let Some(known) = &self.known {
            let part = dot(known, x);
            x.iter_mut().zip(known).for_each(|(x, known)| *x -= part * known);
        }
    }

    /// Rayleigh quotient of a vector and the size of its residual, both of `L` itself; none for no vector.
    fn pair(&self, mut x: Vec<f64>) -> Option<Pair> {
        self.project(&mut x);
        let size = dot(&x, &x).sqrt();
        if !(size > 0.1) {
            return None;
        }
        x.iter_mut().for_each(|x| *x /= size);
        let mut image = vec![0.0; x.len()];
        self.laplacian(&x, &mut image);
        let value = dot(&x, &image);
        let residual =
            image.iter().zip(&x).map(|(image, x)| (image - value * x) * (image - value * x)).sum::<f64>();
        // What rounding does to sums of so many terms is no eigenvalue either.
        let rounding = f64::EPSILON * self.top * (x.len() as f64).sqrt();
        Some(Pair { value, residual: residual.sqrt() + rounding, vector: x })
    }
}

fn dot(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(a, b)| a * b).sum()
}

fn centre(x: &mut [f64]) {
    let mean = x.iter().sum::<f64>() / x.len() as f64;
    x.iter_mut().for_each(|x| *x -= mean);
}

impl LinOp<f64> for Reflected {
    fn apply_scratch(&self, _: usize, _: Par) -> StackReq {
        StackReq::EMPTY
    }

    fn nrows(&self) -> usize {
        self.degrees.len()
    }

    fn ncols(&self) -> usize {
        self.degrees.len()
    }

    fn apply(&self, mut out: MatMut<'_, f64>, rhs: MatRef<'_, f64>, _: Par, _: &mut MemStack) {
        for column in 0..rhs.ncols() {
            let mut x: Vec<f64> = rhs.col(column).iter().copied().collect();
            self.project(&mut x);
            let mut image = vec![0.0; x.len()];
            self.laplacian(&x, &mut image);
            image.iter_mut().zip(&x).for_each(|(image, x)| *image = self.top * x - *image);
            self.project(&mut image);
            out.as_mut().col_mut(column).iter_mut().zip(&image).for_each(|(slot, image)| *slot = *image);
        }
    }

    fn conj_apply(&self, out: MatMut<'_, f64>, rhs: MatRef<'_, f64>, par: Par, stack: &mut MemStack) {
        self.apply(out, rhs, par, stack);
    }
}

#[cfg(test)]
mod tests {
    use super::super::graph::Edge;
    use super::super::topology::Topology;
    use super::*;

    fn graph(topology: Topology, nodes: usize) -> Graph {
        let links = topology.links(nodes, 1).unwrap();
        let edge = |(k, &(a, b)): (usize, &(usize, usize))| Edge { a, b, weight: 1.0 + (k % 3) as f64 };
        Graph { nodes, edges: links.iter().enumerate().map(edge).collect() }
    }

    #[test]
    fn it_is_the_dense_one_to_a_millionth_and_the_bound_holds() {
        for (topology, nodes) in [
            (Topology::RandomRegular { degree: 4 }, 700),
            (Topology::ErdosRenyi { probability: 0.02 }, 600),
            (Topology::Star, 300),
            (Topology::Grid { columns: 15 }, 225),
        ] {
            let graph = graph(topology, nodes);
            let (exact, found) = (graph.lambda2(), graph.sparse_lambda2().unwrap());
            let error = (found.value - exact).abs();
            assert!(error <= found.error + 1e-12 * graph.lambda_max(), "{topology:?} {found:?} {exact}");
            assert!(error < 1e-6 * exact, "{topology:?} {found:?} {exact}");
            assert!(found.relative() < 1e-6, "{topology:?} {found:?}");
        }
    }

    /// faer has threads where the reference is built, too.
    #[cfg(feature = "reference")]
    #[test]
    fn a_search_starts_no_threads() {
        faer::set_global_parallelism(Par::rayon(2));
        graph(Topology::RandomRegular { degree: 4 }, 700).sparse_lambda2().unwrap();
        assert_eq!(faer::get_global_parallelism(), Par::Seq);
    }

    /// Clusters joined by single edges: eigenvalues nearly alike, of which one search may end at the wrong one.
    #[test]
    fn clusters_that_are_nearly_alike_are_told_apart() {
        for (clusters, size) in [(3, 300), (3, 500), (4, 300)] {
            let graph = joined(clusters, size);
            let (exact, found) = (graph.lambda2(), graph.sparse_lambda2().unwrap());
            let error = (found.value - exact).abs();
            assert!(error <= found.error + 1e-12 * graph.lambda_max(), "{size} {found:?} {exact}");
            assert!(found.relative() < 1e-6, "{size} {found:?} {exact}");
        }
    }

    /// Random 4-regular clusters in a ring, each joined to the next by one edge.
    fn joined(clusters: usize, size: usize) -> Graph {
        let mut edges = Vec::new();
        for cluster in 0..clusters {
            let links =
                Topology::RandomRegular { degree: 4 }.links(size, cluster as u64 + 1).unwrap_or_default();
            let first = cluster * size;
            edges.extend(links.iter().map(|&(a, b)| Edge { a: first + a, b: first + b, weight: 1.0 }));
            let next = (cluster + 1) % clusters * size + size / 2;
            edges.push(Edge { a: first.min(next), b: first.max(next), weight: 1.0 });
        }
        Graph { nodes: clusters * size, edges }
    }

    /// Where it cannot know it finds nothing, or the bound says so; where it can, it does.
    #[test]
    fn a_long_path_is_not_claimed() {
        let claimed = |topology: Topology, nodes: usize| {
            let graph = graph(topology, nodes);
            let found = graph.sparse_lambda2().filter(|found| found.relative() < 1e-4)?;
            Some((found.value - graph.lambda2()).abs() / graph.lambda2())
        };
        for topology in [Topology::Path, Topology::Ring] {
            assert!(claimed(topology, 40).is_some_and(|error| error < 1e-4), "{topology:?}");
            for nodes in [200, 600, 1_900] {
                assert!(claimed(topology, nodes).is_none_or(|error| error < 1e-4), "{topology:?} {nodes}");
            }
        }
    }
}
