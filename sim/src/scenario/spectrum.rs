//! The Laplacian of a graph and its eigenvalues.

use super::Graph;
use faer::dyn_stack::{MemBuffer, MemStack};
use faer::linalg::evd::{self, ComputeEigenvectors};
use faer::{Mat, Par, diag::Diag};

/// Most nodes whose normalised spectrum is computed.
const LARGEST_DENSE: usize = 300;

impl Graph {
    /// The Laplacian `L = D - A`, N by N.
    #[must_use]
    pub fn laplacian(&self) -> Mat<f64> {
        let mut matrix = Mat::zeros(self.nodes, self.nodes);
        for edge in &self.edges {
            matrix[(edge.a, edge.a)] += edge.weight;
            matrix[(edge.b, edge.b)] += edge.weight;
            matrix[(edge.a, edge.b)] -= edge.weight;
            matrix[(edge.b, edge.a)] -= edge.weight;
        }
        matrix
    }

    /// The eigenvalues of the Laplacian, ascending; the first is zero up to rounding, which is some N ulp of
    /// the largest.
    ///
    /// Dense, O(N^3): a small `lambda2` (a path of 1,000 has 1e-5) is where iterations on the sparse matrix
    /// converge badly. On one thread, so that the bits do not depend on the number of cores.
    #[must_use]
    pub fn spectrum(&self) -> Vec<f64> {
        spectrum_of(&self.laplacian())
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

    /// The largest eigenvalue of `D^-1 L`, from 1 to 2, which is what the damping of the law has to be above
    /// (law.md 2); 2, which is above all, for a graph of more than 300 nodes, where it takes long.
    #[must_use]
    pub fn normalised_lambda_max(&self) -> f64 {
        if self.nodes > LARGEST_DENSE {
            return 2.0;
        }
        let largest = self.normalised_spectrum().last().copied().unwrap_or(2.0);
        if largest.is_finite() { largest.clamp(1.0, 2.0) } else { 2.0 }
    }

    /// The second eigenvalue of `D^-1 L`, from 0 to 2; not a number for a single node, and for a graph of
    /// more than 300 nodes.
    #[must_use]
    pub fn normalised_lambda2(&self) -> f64 {
        if self.nodes > LARGEST_DENSE {
            return f64::NAN;
        }
        self.normalised_spectrum().get(1).copied().unwrap_or(f64::NAN)
    }

    /// The eigenvalues of `D^-1 L`, ascending.
    fn normalised_spectrum(&self) -> Vec<f64> {
        let degrees = self.degrees();
        let mut matrix = self.laplacian();
        for (row, a) in degrees.iter().enumerate() {
            for (column, b) in degrees.iter().enumerate() {
                matrix[(row, column)] /= (a * b).sqrt();
            }
        }
        spectrum_of(&matrix)
    }
}

/// Eigenvalues of a symmetric matrix, ascending.
fn spectrum_of(matrix: &Mat<f64>) -> Vec<f64> {
    let size = matrix.nrows();
    let mut values = Diag::zeros(size);
    let scratch =
        evd::self_adjoint_evd_scratch::<f64>(size, ComputeEigenvectors::No, Par::Seq, Default::default());
    let mut memory = MemBuffer::new(scratch);
    let stack = MemStack::new(&mut memory);
    let solved =
        evd::self_adjoint_evd(matrix.as_ref(), values.as_mut(), None, Par::Seq, stack, Default::default());
    let mut values: Vec<f64> = values.column_vector().iter().copied().collect();
    if solved.is_err() {
        values.fill(f64::NAN);
    }
    values.sort_by(f64::total_cmp);
    values
}
