//! Why a reference run could not be had.

use super::solution::ReferenceSolution;

/// Why there is no (whole) reference solution. Nodes count from 0, times in seconds.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum ReferenceError {
    /// A vector of the problem has the wrong length.
    #[error("{what} has {found} entries where {expected} are needed, one per node")]
    Shape {
        /// Which vector.
        what: &'static str,
        /// Its length.
        found: usize,
        /// The number of nodes.
        expected: usize,
    },
    /// A number of the problem is out of its range.
    #[error("{what} of node index {node} is {value}, which is not allowed")]
    Value {
        /// Which number.
        what: &'static str,
        /// Whose.
        node: usize,
        /// What was found.
        value: f64,
    },
    /// The graph falls apart, so no funnel holds the parts together.
    #[error("the graph is not connected: no path joins node index 0 and node index {node}")]
    Disconnected {
        /// A node out of reach of node 0.
        node: usize,
    },
    /// The output times are not ascending, finite and at least 0.
    #[error("output time {at} s (number {index}) is not finite, negative, or before the one ahead of it")]
    Times {
        /// Position in the list.
        index: usize,
        /// The offending time.
        at: f64,
    },
    /// The tolerance is out of range.
    #[error("tolerance {0} is not between 1e-12 and 1e-2")]
    Tolerance(f64),
    /// A node starts on or outside its funnel, where the law is not defined.
    #[error("node index {node} starts outside its funnel: |nu| = {nu} is {ratio} times psi(0) = {psi}")]
    OutsideAtStart {
        /// Which node.
        node: usize,
        /// `|nu|` at `t = 0`, in state units.
        nu: f64,
        /// `psi` at `t = 0`, in state units.
        psi: f64,
        /// `|nu| / psi`.
        ratio: f64,
    },
    /// The solver could not go on. What it has up to there is in `partial`.
    #[error(
        "the reference cannot be resolved beyond t = {at} s, where the narrowest funnel is {psi:e} wide \
         and the largest |nu| / psi is {ratio}: {reason}"
    )]
    Unresolved {
        /// The last time that is resolved.
        at: f64,
        /// The smallest `psi` there, in state units.
        psi: f64,
        /// The largest `|nu| / psi` there.
        ratio: f64,
        /// What stopped it.
        reason: String,
        /// The rows up to `at`.
        partial: Box<ReferenceSolution>,
    },
    /// The caller's progress function asked to stop.
    #[error("stopped on request at t = {at} s")]
    Cancelled {
        /// Where.
        at: f64,
        /// The rows up to `at`.
        partial: Box<ReferenceSolution>,
    },
}
