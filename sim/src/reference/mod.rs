//! The continuous-time closed loop in `f64`, as exact as a stiff adaptive solver makes it: what every other
//! fidelity is measured against.
//!
//! diffsol's BDF integrates. For the node-wise law of scalar states the coordinates (`coordinates.rs`) are
//! chosen so that a state outside the funnel cannot be written down; every other coupling is solved in its
//! states (`states.rs`). The system is dense: time grows as `N^3`, memory as `N^2`.

mod coordinates;
#[cfg(test)]
mod coupled_tests;
mod error;
mod estimate;
pub mod examples;
mod integrate;
mod lu;
mod network;
mod options;
mod problem;
mod solution;
mod states;
#[cfg(test)]
mod tests;
mod unknowns;

use std::ops::ControlFlow;

pub use error::ReferenceError;
pub use estimate::{ErrorEstimate, solve_coupled, solve_estimated};
pub use options::ReferenceOptions;
pub use problem::{CoupledProblem, ReferenceProblem};
pub use solution::ReferenceSolution;

/// Solves `problem` from `t = 0` and returns the states at `times` (seconds, ascending, at least 0).
///
/// # Errors
/// A problem that is malformed or starts outside its funnel is refused; a run that cannot be resolved to the
/// end is [`ReferenceError::Unresolved`], which carries the rows up to there.
pub fn solve(
    problem: &ReferenceProblem,
    times: &[f64],
    options: &ReferenceOptions,
) -> Result<ReferenceSolution, ReferenceError> {
    solve_with(problem, times, options, &mut |_| ControlFlow::Continue(()))
}

/// Like [`solve`], and calls `on_step` with the time in seconds after each accepted step, for progress bars
/// and for giving up.
///
/// # Errors
/// Those of [`solve`], and [`ReferenceError::Cancelled`] if `on_step` breaks.
pub fn solve_with(
    problem: &ReferenceProblem,
    times: &[f64],
    options: &ReferenceOptions,
    on_step: &mut dyn FnMut(f64) -> ControlFlow<()>,
) -> Result<ReferenceSolution, ReferenceError> {
    problem.validate()?;
    check(times, options)?;
    start_from(&coordinates::System::new(problem), times, options, 0.0, on_step)
}

fn check(times: &[f64], options: &ReferenceOptions) -> Result<(), ReferenceError> {
    check_times(times)?;
    if !(1e-12..=1e-2).contains(&options.tolerance) {
        return Err(ReferenceError::Tolerance(options.tolerance));
    }
    Ok(())
}

/// Solves a problem that was checked, with all states moved by `shift` at the start (state units), which
/// moves no diffusive term.
fn start_from(
    system: &dyn unknowns::Unknowns,
    times: &[f64],
    options: &ReferenceOptions,
    shift: f64,
    on_step: &mut dyn FnMut(f64) -> ControlFlow<()>,
) -> Result<ReferenceSolution, ReferenceError> {
    // Threads would cost more than they gain at these sizes, and make the last bits depend on their number.
    faer::set_global_parallelism(faer::Par::Seq);
    let (t, y) = system.start(shift)?;
    let solution = ReferenceSolution::new(system.entries());
    let end = times.last().copied().unwrap_or(0.0);
    integrate::Run { system, options, ahead: times, end, solution, t, y, shift }.finish(on_step)
}

fn check_times(times: &[f64]) -> Result<(), ReferenceError> {
    let mut earlier = 0.0;
    for (index, &at) in times.iter().enumerate() {
        if !at.is_finite() || at < earlier {
            return Err(ReferenceError::Times { index, at });
        }
        earlier = at;
    }
    Ok(())
}
