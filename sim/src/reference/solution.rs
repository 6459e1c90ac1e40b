//! What a reference run returns.

use super::estimate::ErrorEstimate;
use super::unknowns::Seen;
use crate::extremes::{beyond, largest};

/// The continuous-time solution at the requested times, row-major: row `k` of a table holds one number per
/// node and belongs to `times[k]`.
///
/// `nu` and `u` are given besides `x` because under a narrow funnel they cannot be computed from `x`: at
/// `psi = 1e-12` and `x = 500` all digits of `nu` cancel.
#[derive(Debug, Clone, PartialEq)]
pub struct ReferenceSolution {
    /// Number of nodes, or of the components of all of them: the length of a row, by node and then by
    /// component.
    pub nodes: usize,
    /// The output times that were reached, in seconds.
    pub times: Vec<f64>,
    /// States `x_i`, in state units.
    pub x: Vec<f64>,
    /// Diffusive terms `nu_i`, in state units.
    pub nu: Vec<f64>,
    /// Funnels `psi_i`, in state units.
    pub psi: Vec<f64>,
    /// Coupling inputs `u_i = mu_i(nu_i / psi_i)`, in state units per second.
    pub u: Vec<f64>,
    /// The largest `|nu_i| / psi_i` over all nodes and accepted steps, and at the last output time. The other
    /// output times have no part in it, so that it does not depend on how many are asked for.
    pub max_ratio: f64,
    /// When that was, in seconds.
    pub max_ratio_at: f64,
    /// The largest `|sum_i nu_i| / sum_i psi_i` at an accepted step. It is 0 in the exact solution and a
    /// measure of the error relative to the funnel that no tolerance on `x` sees.
    pub max_defect: f64,
    /// Accepted steps.
    pub steps: usize,
    /// Estimate of the distance to the exact solution, where that was asked for.
    pub estimate: Option<ErrorEstimate>,
    /// Up to where the solution is resolved, in seconds: the last output time, or less if the run failed.
    pub resolved_until: f64,
}

impl ReferenceSolution {
    pub(super) fn new(nodes: usize) -> Self {
        let empty = Vec::new;
        Self {
            nodes,
            times: empty(),
            x: empty(),
            nu: empty(),
            psi: empty(),
            u: empty(),
            max_ratio: 0.0,
            max_ratio_at: 0.0,
            max_defect: 0.0,
            steps: 0,
            estimate: None,
            resolved_until: 0.0,
        }
    }

    pub(super) fn push_row(&mut self, t: f64, point: Seen) {
        self.times.push(t);
        self.x.extend(point.x);
        self.nu.extend(point.nu);
        self.psi.extend(point.psi);
        self.u.extend(point.u);
    }

    pub(super) fn note_ratio(&mut self, t: f64, ratio: &[f64]) {
        let most = largest(0.0, ratio.iter().map(|s| s.abs()));
        if beyond(most, self.max_ratio) {
            (self.max_ratio, self.max_ratio_at) = (most, t);
        }
    }

    /// Row `k` of a row-major table such as [`x`](Self::x).
    pub fn row<'a>(&self, table: &'a [f64], k: usize) -> &'a [f64] {
        &table[k * self.nodes..(k + 1) * self.nodes]
    }
}
