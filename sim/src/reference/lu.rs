//! LU factors with row exchanges only, for diffsol.
//!
//! diffsol's own `FaerLU` exchanges columns too, which costs more than all the rest of a run (60 % of the
//! time at 127 nodes) and buys nothing here: the Newton matrices of steps that converge are well
//! conditioned.

use diffsol_la::error::{LaError, LinearSolverError};
use diffsol_la::{FaerContext, FaerMat, FaerVec, LinearOp, LinearSolver, Matrix, MatrixCommon, Vector};
use faer::linalg::solvers::{PartialPivLu, Solve};

/// See the file's text.
#[derive(Default)]
pub(super) struct RowPivotingLu {
    matrix: Option<FaerMat<f64>>,
    factors: Option<PartialPivLu<f64>>,
}

impl RowPivotingLu {
    fn factors(&self) -> Result<&PartialPivLu<f64>, LaError> {
        self.factors.as_ref().ok_or(LaError::LinearSolverError(LinearSolverError::LuNotInitialized))
    }
}

impl LinearSolver<FaerMat<f64>> for RowPivotingLu {
    fn set_linearisation<C>(&mut self, op: &C)
    where
        C: LinearOp<V = FaerVec<f64>, T = f64, M = FaerMat<f64>, C = FaerContext>,
    {
        let empty = || FaerMat::new_from_sparsity(op.nrows(), op.ncols(), op.sparsity(), *op.context());
        let matrix = self.matrix.get_or_insert_with(empty);
        op.matrix_inplace(matrix);
        self.factors = Some(matrix.inner().partial_piv_lu());
    }

    fn set_sparsity<C>(&mut self, _: &C)
    where
        C: LinearOp<V = FaerVec<f64>, T = f64, M = FaerMat<f64>, C = FaerContext>,
    {
        *self = Self::default();
    }

    fn solve_in_place(&self, x: &mut FaerVec<f64>) -> Result<(), LaError> {
        self.factors()?.solve_in_place(x.inner_mut());
        Ok(())
    }

    fn solve_transpose_in_place(&self, x: &mut FaerVec<f64>) -> Result<(), LaError> {
        self.factors()?.solve_transpose_in_place(x.inner_mut());
        Ok(())
    }
}
