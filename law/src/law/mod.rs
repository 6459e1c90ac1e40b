//! Coupling laws: all of them solve (**) of law.md 3, each for an unknown of its own
//! (docs/notes/2026-11-23-whole-paper.md).

mod constants;
pub mod edge_wise;
pub mod lambda_tracker;
pub mod max_gain;
mod memory;
pub mod node_wise;

pub use edge_wise::EdgeWise;
pub use lambda_tracker::LambdaTracker;

/// Law that turns diffusive terms into inputs, fixed for a run.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Law<F> {
    /// [`node_wise`], component by component.
    NodeWise,
    /// [`max_gain`].
    MaxGain,
    /// [`edge_wise`].
    EdgeWise(EdgeWise<F>),
    /// [`lambda_tracker`].
    LambdaTracker(LambdaTracker<F>),
    /// No input at all.
    None,
}
