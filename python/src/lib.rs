//! The native half of the Python package `funnelnet`: the simulator's library, with arrays instead of files.
//!
//! What a user sees is in `package/funnelnet/*.py`; here is what needs Rust. Long work is done in a thread of its own
//! (`work.rs`), without the interpreter's lock.

mod check;
mod errors;
mod field;
mod large;
mod ring;
mod rows;
mod run;
mod scenario;
mod simulation;
mod sweep;
mod trouble;
mod work;

use pyo3::prelude::*;

/// Native half of `funnelnet`.
#[pymodule]
mod _native {
    #[pymodule_export]
    use super::check::check;
    #[pymodule_export]
    use super::run::run;
    #[pymodule_export]
    use super::scenario::Scenario;
    #[pymodule_export]
    use super::simulation::Simulation;
    #[pymodule_export]
    use super::sweep::sweep;
}
