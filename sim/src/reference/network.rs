//! The weighted Laplacian, and its pseudo-inverse, which turns diffusive terms back into states.

use faer::Mat;
use faer::prelude::Solve;

/// A connected, undirected, weighted graph.
pub(super) struct Network {
    edges: Vec<(usize, usize, f64)>,
    /// `L^+`, dense and symmetric, row-major.
    inverse: Vec<f64>,
    pub(super) degrees: Vec<f64>,
}

impl Network {
    /// `edges` must join all `nodes`, with positive weights.
    pub(super) fn new(nodes: usize, edges: &[(usize, usize, f64)]) -> Self {
        let mut degrees = vec![0.0; nodes];
        for &(i, j, weight) in edges {
            degrees[i] += weight;
            degrees[j] += weight;
        }
        let inverse = pseudo_inverse(nodes, edges, &degrees);
        Self { edges: edges.to_vec(), inverse, degrees }
    }

    pub(super) fn nodes(&self) -> usize {
        self.degrees.len()
    }

    /// `out_i = sum_j alpha_ij (v_j - v_i)`, by differences so that nearly equal entries keep their digits.
    pub(super) fn diffuse(&self, v: &[f64], out: &mut [f64]) {
        out.fill(0.0);
        for &(i, j, weight) in &self.edges {
            let flow = weight * (v[j] - v[i]);
            out[i] += flow;
            out[j] -= flow;
        }
    }

    /// `out = -L^+ nu`: the deviations from the mean that have the diffusive terms `nu`.
    /// Costs one row per non-zero entry of `nu`.
    pub(super) fn deviations(&self, nu: &[f64], out: &mut [f64]) {
        out.fill(0.0);
        for (row, &value) in self.inverse.chunks_exact(self.nodes()).zip(nu) {
            if value != 0.0 {
                out.iter_mut().zip(row).for_each(|(o, &p)| *o -= p * value);
            }
        }
    }

    /// The largest absolute row sum of `L^+`: a deviation is at most this many times the largest `|nu|`.
    pub(super) fn deviation_gain(&self) -> f64 {
        let row_sum = |row: &[f64]| row.iter().map(|p| p.abs()).sum::<f64>();
        crate::extremes::largest(0.0, self.inverse.chunks_exact(self.nodes()).map(row_sum))
    }
}

/// `L^+ = (L + c J)^-1 - J / c` with `J = 1 1^T / N` and `c` the mean degree, which keeps the condition low.
fn pseudo_inverse(nodes: usize, edges: &[(usize, usize, f64)], degrees: &[f64]) -> Vec<f64> {
    let count = nodes as f64;
    let mean_degree = degrees.iter().sum::<f64>() / count;
    let shift = if mean_degree > 0.0 { mean_degree } else { 1.0 };
    let mut matrix =
        Mat::<f64>::from_fn(nodes, nodes, |i, j| shift / count + if i == j { degrees[i] } else { 0.0 });
    for &(i, j, weight) in edges {
        matrix[(i, j)] -= weight;
        matrix[(j, i)] -= weight;
    }
    let inverse = matrix.partial_piv_lu().solve(Mat::<f64>::identity(nodes, nodes));
    let entry = |k: usize| inverse[(k / nodes, k % nodes)] - 1.0 / (count * shift);
    (0..nodes * nodes).map(entry).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn deviations_have_the_diffusive_terms_that_they_came_from() {
        let edges = [(0, 1, 1.0), (1, 2, 100.0), (2, 3, 0.01), (3, 0, 2.0), (0, 2, 0.5)];
        let network = Network::new(4, &edges);
        let nu = [3.0, -1.0, 0.5, -2.5];
        let (mut deviations, mut back) = ([0.0; 4], [0.0; 4]);
        network.deviations(&nu, &mut deviations);
        network.diffuse(&deviations, &mut back);
        assert!(nu.iter().zip(&back).all(|(a, b)| (a - b).abs() < 1e-12), "{back:?}");
        assert!(deviations.iter().sum::<f64>().abs() < 1e-13);
    }
}
