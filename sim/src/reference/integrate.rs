//! Drives diffsol's BDF through the coordinates of [`System`], one stretch of the funnel after the other.

use std::ops::ControlFlow;

use diffsol::error::{DiffsolError, OdeSolverError};
use diffsol::{FaerContext, FaerMat, FaerVec, OdeBuilder, OdeSolverMethod, Vector};

use super::coordinates::LOCAL_SHARE;
use super::error::ReferenceError;
use super::lu::RowPivotingLu;
use super::options::ReferenceOptions;
use super::solution::ReferenceSolution;
use super::unknowns::{Seen, Unknowns};
use crate::extremes::{larger, largest, smallest};

/// A stretch of the run ends when the widest funnel is this many times narrower than at its beginning, as
/// long as the tolerance on the inputs still depends on the width.
const STRETCH: f64 = 10.0;

/// The state of a run between accepted steps.
pub(super) struct Run<'a> {
    pub(super) system: &'a dyn Unknowns,
    pub(super) options: &'a ReferenceOptions,
    /// The output times that are still to come.
    pub(super) ahead: &'a [f64],
    /// The last of them, s.
    pub(super) end: f64,
    pub(super) solution: ReferenceSolution,
    pub(super) t: f64,
    pub(super) y: Vec<f64>,
    /// By how much all states were moved at the start (state units).
    pub(super) shift: f64,
}

/// Why a stretch ended before the run did.
enum Stop {
    Solver(String),
    Cancelled,
}

impl Run<'_> {
    /// Integrates to the last output time.
    pub(super) fn finish(
        mut self,
        on_step: &mut dyn FnMut(f64) -> ControlFlow<()>,
    ) -> Result<ReferenceSolution, ReferenceError> {
        self.write_rows_at_start();
        self.watch(&self.system.seen(self.t, &self.y));
        while !self.ahead.is_empty() {
            match self.stretch(on_step) {
                Ok(()) => {}
                Err(Stop::Cancelled) => return Err(self.cancelled()),
                Err(Stop::Solver(reason)) => return Err(self.unresolved(reason)),
            }
        }
        self.solution.resolved_until = self.solution.times.last().copied().unwrap_or(0.0);
        Ok(self.solution)
    }

    /// Integrates until the funnel is much narrower, or to the end.
    fn stretch(&mut self, on_step: &mut dyn FnMut(f64) -> ControlFlow<()>) -> Result<(), Stop> {
        let system = self.system;
        let (relative, absolute) = system.tolerances(self.options, self.t, &self.y);
        let (t0, y0) = (self.t, self.y.clone());
        let mut problem = OdeBuilder::<FaerMat<f64>>::new()
            .context(FaerContext::default())
            .t0(t0)
            .rtol(relative)
            .atol(absolute)
            .rhs_implicit(
                |y, _, t, out| system.derivative(t, y, out),
                |y, _, t, v, out| system.derivative_times(t, y, v, out),
            )
            .init(|_, _, y| y.copy_from_slice(&y0), system.size())
            .build()
            .map_err(why)?;
        // A start at the very edge of the funnel relaxes within 1e-30 s; `accept` sees steps that lead
        // nowhere.
        problem.ode_options.min_timestep = f64::MIN_POSITIVE;
        problem.ode_options.max_nonlinear_solver_failures = usize::MAX;
        let mut solver = problem.bdf::<RowPivotingLu>().map_err(why)?;
        let narrow =
            if relative < self.options.tolerance * LOCAL_SHARE { system.widest(t0) / STRETCH } else { 0.0 };
        // No step goes across a kink.
        let kink = system.next_kink(t0).filter(|kink| *kink < self.end);
        if let Some(kink) = kink {
            solver.set_stop_time(kink).map_err(why)?;
        }
        let before = |t: f64| kink.is_none_or(|kink| t < kink);
        while !self.ahead.is_empty() && system.widest(self.t) > narrow && before(self.t) {
            solver.step().map_err(why)?;
            self.accept(solver.state().t, solver.state().y.clone_as_vec())?;
            self.write_rows(|t| solver.interpolate(t).map(|y: FaerVec<f64>| y.clone_as_vec()).map_err(why))?;
            if on_step(self.t).is_break() {
                return Err(Stop::Cancelled);
            }
        }
        Ok(())
    }

    /// Takes a step over, unless it is not a solution.
    fn accept(&mut self, t: f64, y: Vec<f64>) -> Result<(), Stop> {
        if t <= self.t {
            return Err(Stop::Solver("the step is too small to advance the time".into()));
        }
        let point = self.system.seen(t, &y);
        if !y.iter().chain(&point.x).all(|v| v.is_finite()) {
            return Err(Stop::Solver("the solution is not finite".into()));
        }
        if let Some(reason) = self.system.refuses(&point) {
            return Err(Stop::Solver(reason));
        }
        (self.t, self.y) = (t, y);
        self.solution.steps += 1;
        self.watch(&point);
        if self.solution.steps >= self.options.max_steps {
            return Err(Stop::Solver(format!("{} steps were not enough", self.options.max_steps)));
        }
        Ok(())
    }

    /// Notes the largest ratio and defect at the present state. The last step may lead beyond the end, where
    /// nobody asks for them.
    fn watch(&mut self, point: &Seen) {
        if self.t <= self.end {
            self.solution.max_defect = larger(self.solution.max_defect, point.sigma.abs());
            self.solution.note_ratio(self.t, &point.ratio);
        }
    }

    fn write_rows_at_start(&mut self) {
        while let Some((&t, rest)) = self.ahead.split_first().filter(|(t, _)| **t <= self.t) {
            let seen = if t < self.t {
                self.system.before_start(t, self.shift)
            } else {
                self.system.seen(t, &self.y)
            };
            self.solution.push_row(t, seen);
            self.ahead = rest;
        }
    }

    fn write_rows(&mut self, interpolate: impl Fn(f64) -> Result<Vec<f64>, Stop>) -> Result<(), Stop> {
        while let Some((&t, rest)) = self.ahead.split_first().filter(|(t, _)| **t <= self.t) {
            let y = interpolate(t)?;
            let seen = self.system.seen(t, &y);
            if rest.is_empty() {
                self.solution.note_ratio(t, &seen.ratio);
            }
            self.solution.push_row(t, seen);
            self.ahead = rest;
        }
        Ok(())
    }

    fn cancelled(mut self) -> ReferenceError {
        self.solution.resolved_until = self.t;
        ReferenceError::Cancelled { at: self.t, partial: Box::new(self.solution) }
    }

    fn unresolved(mut self, reason: String) -> ReferenceError {
        let point = self.system.seen(self.t, &self.y);
        self.solution.resolved_until = self.t;
        ReferenceError::Unresolved {
            at: self.t,
            psi: smallest(f64::INFINITY, point.psi.iter().copied()),
            ratio: largest(0.0, point.ratio.iter().map(|s| s.abs())),
            reason,
            partial: Box::new(self.solution),
        }
    }
}

fn why(error: DiffsolError) -> Stop {
    Stop::Solver(match error {
        DiffsolError::OdeSolverError(OdeSolverError::StepSizeTooSmall { .. }) => {
            "the step size collapsed".into()
        }
        other => other.to_string(),
    })
}
