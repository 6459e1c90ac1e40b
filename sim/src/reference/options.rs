//! How exact a reference run is to be.

/// Settings of [`solve`](super::solve).
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ReferenceOptions {
    /// Error of the states, relative to 1 state unit or to the largest state, whichever is larger. What is
    /// reached is about ten times this at worst (see the tests), since errors are controlled per step.
    /// Between 1e-12 and 1e-2.
    pub tolerance: f64,
    /// Accepted steps after which the run is given up as unresolved.
    pub max_steps: usize,
}

impl Default for ReferenceOptions {
    fn default() -> Self {
        Self { tolerance: 1e-9, max_steps: 10_000_000 }
    }
}
