//! A closed loop in unknowns of its own, as the solver sees it.

use super::error::ReferenceError;
use super::options::ReferenceOptions;

/// Everything that a row needs, one entry per node and component.
#[derive(Default, Clone)]
pub(super) struct Seen {
    /// `x_i`, in state units.
    pub(super) x: Vec<f64>,
    /// `nu_i`, in state units.
    pub(super) nu: Vec<f64>,
    /// `psi_i`, in state units.
    pub(super) psi: Vec<f64>,
    /// `nu_i / psi_i`.
    pub(super) ratio: Vec<f64>,
    /// `u_i`, in state units per second.
    pub(super) u: Vec<f64>,
    /// `sum nu / sum psi`; 0 where the unknowns cannot have another.
    pub(super) sigma: f64,
}

/// The closed loop in some unknowns `y`.
pub(super) trait Unknowns {
    /// Number of unknowns.
    fn size(&self) -> usize;

    /// Entries of a row.
    fn entries(&self) -> usize;

    /// Where integration begins (s), and the unknowns there, with all states moved by `shift` (state units).
    ///
    /// # Errors
    /// [`ReferenceError::OutsideAtStart`] for the node that is farthest outside.
    fn start(&self, shift: f64) -> Result<(f64, Vec<f64>), ReferenceError>;

    /// What there is at a time (s) before that.
    fn before_start(&self, t: f64, shift: f64) -> Seen;

    /// `out = y'` at `(t, y)`.
    fn derivative(&self, t: f64, y: &[f64], out: &mut [f64]);

    /// `out = (dy'/dy) v` at `(t, y)`.
    fn derivative_times(&self, t: f64, y: &[f64], v: &[f64], out: &mut [f64]);

    /// Everything at `(t, y)`.
    fn seen(&self, t: f64, y: &[f64]) -> Seen;

    /// Why this is no solution, where it is none.
    fn refuses(&self, seen: &Seen) -> Option<String>;

    /// The relative tolerance, and the absolute ones per unknown.
    fn tolerances(&self, options: &ReferenceOptions, t: f64, y: &[f64]) -> (f64, Vec<f64>);

    /// The widest funnel that tolerances depend on (state units).
    fn widest(&self, t: f64) -> f64;

    /// The next time after `t` at which a funnel has a kink (s).
    fn next_kink(&self, t: f64) -> Option<f64>;
}
