//! How far a reference solution may be from the exact one.
//!
//! The solver controls the error of each step, and an unstable network multiplies it: by `e^30` in 30 s with
//! a slope of 1/s. So the problem is solved once more, ten times less exactly and from states that are all
//! moved by the tolerance, and the distance of both is the estimate. The move is what the tolerance allows at
//! the start. It makes sure that the two come apart where errors grow, even where the steps happen to make
//! none: both would otherwise stay on an equilibrium that no real network stays on.

use super::coordinates::System;
use super::error::ReferenceError;
use super::options::ReferenceOptions;
use super::problem::{CoupledProblem, ReferenceProblem};
use super::solution::ReferenceSolution;
use super::states::States;
use super::unknowns::Unknowns;
use super::{check, start_from};
use crate::extremes::{beyond, larger, largest, smaller};
use std::ops::ControlFlow;

/// Share of the largest state up to then that the error may be in a solution that is resolved.
const RESOLVED: f64 = 1e-3;
/// An error that is small whatever the states are, over the tolerance.
const SMALL: f64 = 1e3;
/// The tolerance of the second solution over that of the first.
const LOOSER: f64 = 10.0;
/// The loosest tolerance that the solver takes.
const LOOSEST: f64 = 1e-2;
/// Into so many parts the time is divided by the instants at which the two are compared, whatever the output
/// times are.
const COMPARED: usize = 2_000;

/// The distance of two solutions of a problem.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ErrorEstimate {
    /// The largest, state units; infinite where the second solution could not be had to the end.
    pub error: f64,
    /// The largest over the largest state up to then, or over the smallest that the tolerance allows for
    /// where states are smaller.
    pub share: f64,
    /// Time of the largest distance, s.
    pub at: f64,
}

impl ErrorEstimate {
    /// Whether the solution can stand for the exact one.
    #[must_use]
    pub fn resolved(&self) -> bool {
        self.share <= RESOLVED
    }
}

/// Like [`solve_with`](super::solve_with), with an estimate of the error. `on_step` sees the time go from 0
/// to the end once.
///
/// # Errors
/// Those of [`solve_with`](super::solve_with) for the problem itself.
pub fn solve_estimated(
    problem: &ReferenceProblem,
    times: &[f64],
    options: &ReferenceOptions,
    on_step: &mut dyn FnMut(f64) -> ControlFlow<()>,
) -> Result<ReferenceSolution, ReferenceError> {
    problem.validate()?;
    estimated(&System::new(problem), &problem.x0, times, options, on_step)
}

/// The same for any coupling: in the better unknowns where it has them.
///
/// # Errors
/// Those of [`solve_with`](super::solve_with).
pub fn solve_coupled(
    problem: &CoupledProblem,
    times: &[f64],
    options: &ReferenceOptions,
    on_step: &mut dyn FnMut(f64) -> ControlFlow<()>,
) -> Result<ReferenceSolution, ReferenceError> {
    problem.validate()?;
    match problem.as_scalar() {
        Some(scalar) => solve_estimated(&scalar, times, options, on_step),
        None => estimated(&States::new(problem), &problem.x0, times, options, on_step),
    }
}

fn estimated(
    system: &dyn Unknowns,
    x0: &[f64],
    times: &[f64],
    options: &ReferenceOptions,
    on_step: &mut dyn FnMut(f64) -> ControlFlow<()>,
) -> Result<ReferenceSolution, ReferenceError> {
    check(times, options)?;
    let end = times.last().copied().unwrap_or(0.0);
    let compared: Vec<f64> = (0..=COMPARED).map(|k| end * (k as f64 / COMPARED as f64)).collect();
    let merged = Merged::of(times, &compared);
    let first = start_from(system, &merged.times, options, 0.0, &mut |t| on_step(0.5 * t));
    let (mut solution, x) = match first {
        Ok(both) => merged.split(both),
        Err(ReferenceError::Unresolved { at, psi, ratio, reason, partial }) => {
            let partial = Box::new(merged.split(*partial).0);
            return Err(ReferenceError::Unresolved { at, psi, ratio, reason, partial });
        }
        Err(ReferenceError::Cancelled { at, partial }) => {
            return Err(ReferenceError::Cancelled { at, partial: Box::new(merged.split(*partial).0) });
        }
        Err(other) => return Err(other),
    };
    let looser = ReferenceOptions { tolerance: smaller(LOOSER * options.tolerance, LOOSEST), ..*options };
    let shift = options.tolerance * largest(1.0, x0.iter().map(|x| x.abs()));
    let other = start_from(system, &compared, &looser, shift, &mut |t| on_step(0.5 * (end + t)));
    solution.estimate = Some(match other {
        Ok(other) => {
            let rows = x.chunks_exact(solution.nodes).zip(other.x.chunks_exact(solution.nodes));
            let rows = compared.iter().zip(rows).map(|(&t, (one, other))| (t, one, other));
            distance(rows, SMALL * options.tolerance / RESOLVED)
        }
        Err(ReferenceError::Unresolved { at, .. }) => {
            ErrorEstimate { error: f64::INFINITY, share: f64::INFINITY, at }
        }
        Err(other) => return Err(other),
    });
    Ok(solution)
}

/// Output times, and those of a comparison among them.
struct Merged {
    times: Vec<f64>,
    /// Whether a time is one of the output times.
    wanted: Vec<bool>,
}

impl Merged {
    fn of(times: &[f64], compared: &[f64]) -> Self {
        let wanted = times.iter().map(|&t| (t, true));
        let mut all: Vec<_> = wanted.chain(compared.iter().map(|&t| (t, false))).collect();
        all.sort_by(|a, b| a.0.total_cmp(&b.0));
        let (times, wanted) = all.into_iter().unzip();
        Self { times, wanted }
    }

    /// The solution at the output times, and the states at the others, row by row.
    fn split(&self, both: ReferenceSolution) -> (ReferenceSolution, Vec<f64>) {
        let rows = |table: &[f64], wanted: bool| -> Vec<f64> {
            let rows = table.chunks_exact(both.nodes).zip(&self.wanted);
            rows.filter(|(_, own)| **own == wanted).flat_map(|(row, _)| row).copied().collect()
        };
        let at = both.times.iter().zip(&self.wanted).filter(|(_, own)| **own);
        let times = at.map(|(t, _)| *t).collect();
        let compared = rows(&both.x, false);
        let (x, nu) = (rows(&both.x, true), rows(&both.nu, true));
        let (psi, u) = (rows(&both.psi, true), rows(&both.u, true));
        (ReferenceSolution { times, x, nu, psi, u, ..both }, compared)
    }
}

/// The distance of two solutions, given as time and states; no state counts as smaller than `smallest` (state
/// units).
fn distance<'a>(rows: impl Iterator<Item = (f64, &'a [f64], &'a [f64])>, smallest: f64) -> ErrorEstimate {
    let mut estimate = ErrorEstimate { error: 0.0, share: 0.0, at: 0.0 };
    let mut scale = smallest;
    for (t, one, other) in rows {
        let apart = largest(0.0, one.iter().zip(other).map(|(a, b)| (a - b).abs()));
        scale = largest(scale, one.iter().map(|x| x.abs()));
        estimate.error = larger(estimate.error, apart);
        if beyond(apart / scale, estimate.share) {
            (estimate.share, estimate.at) = (apart / scale, t);
        }
    }
    estimate
}

#[cfg(test)]
mod tests {
    use super::super::examples::{five_agents, narrow_path, path, ring};
    use super::*;
    use crate::scenario::{Affine, Dynamics};
    use funnelnet_law::Gain;
    use funnelnet_law::funnel::{Funnel, Shape};
    use funnelnet_law::math;

    fn estimated(problem: &ReferenceProblem, end: f64) -> (ReferenceSolution, ErrorEstimate) {
        let times: Vec<f64> = (0..=3000).map(|k| end * f64::from(k) / 3000.0).collect();
        let options = ReferenceOptions::default();
        let solution =
            solve_estimated(problem, &times, &options, &mut |_| ControlFlow::Continue(())).unwrap();
        let estimate = solution.estimate.unwrap();
        (solution, estimate)
    }

    /// Three nodes of one unstable field with a sine, all at one state: they stay together, and that state is
    /// known in closed form.
    fn unstable(slope: f64, offset: f64, x0: f64) -> ReferenceProblem {
        let field = Dynamics::from(Affine::scalar(slope, offset, Vec::new()));
        ReferenceProblem {
            x0: vec![x0; 3],
            edges: path(3),
            fields: vec![field; 3],
            gains: vec![Gain::Reciprocal { scale: 1.0 }; 3],
            funnels: vec![
                Funnel {
                    factor: 1.0,
                    shape: Shape::Exponential { start: 40.0, end: 2.0, rate: 1.0 }
                };
                3
            ],
        }
    }

    /// The same with a sine that keeps the exact state bounded: `x = a sin(w t) + b cos(w t)`, from
    /// `x(0) = b`.
    fn balanced(slope: f64, frequency: f64) -> (ReferenceProblem, impl Fn(f64) -> f64) {
        // x' = slope x + sin(w t) has this bounded solution, and e^(slope t) times any error beside it.
        let size = slope * slope + frequency * frequency;
        let (a, b) = (-slope / size, -frequency / size);
        let mut problem = unstable(slope, 0.0, b);
        let sine = crate::scenario::Sine { component: 0, amplitude: 1.0, frequency, phase: 0.0 };
        for field in &mut problem.fields {
            let Dynamics::Affine(field) = field else { unreachable!() };
            field.sines.push(sine);
        }
        (problem, move |t: f64| a * math::sin(frequency * t) + b * math::cos(frequency * t))
    }

    fn error(solution: &ReferenceSolution, exact: impl Fn(f64) -> f64) -> f64 {
        let rows = solution.times.iter().zip(solution.x.chunks_exact(3));
        rows.map(|(&t, row)| row.iter().map(|x| (x - exact(t)).abs()).fold(0.0, f64::max)).fold(0.0, f64::max)
    }

    #[test]
    fn an_unstable_network_is_not_resolved_and_its_error_is_no_larger_than_estimated() {
        for (slope, resolved) in [(0.1, true), (0.3, true), (1.0, false), (1.5, false)] {
            let (problem, exact) = balanced(slope, 2.0);
            let (solution, estimate) = estimated(&problem, 30.0);
            let error = error(&solution, exact);
            println!("slope {slope}: error {error:e}, {estimate:?}");
            assert_eq!(estimate.resolved(), resolved, "slope {slope}: error {error:e}, {estimate:?}");
            assert!(error <= estimate.error, "slope {slope}: error {error:e}, {estimate:?}");
        }
    }

    #[test]
    fn a_state_that_rests_on_an_unstable_equilibrium_is_not_resolved() {
        // The solver makes no error at all, and stays where a real network leaves.
        let (solution, estimate) = estimated(&unstable(1.0, -0.5, 0.5), 30.0);
        assert!(!estimate.resolved(), "{estimate:?} {}", solution.x[solution.x.len() - 1]);
    }

    #[test]
    fn growth_that_the_states_share_is_resolved() {
        // All digits but nine hold, of a state that grows to 1e13.
        let (solution, estimate) = estimated(&unstable(1.0, 0.0, 1.0), 30.0);
        let share = error(&solution, math::exp) / math::exp(30.0);
        println!("share {share:e}, {estimate:?}");
        assert!(estimate.resolved() && share <= estimate.share, "{share:e} {estimate:?}");
    }

    #[test]
    fn the_examples_are_resolved_to_what_they_were_asked_for() {
        for problem in [five_agents(ring(5), 2.0), five_agents(path(5), 0.02)] {
            let (_, estimate) = estimated(&problem, 20.0);
            assert!(estimate.resolved() && estimate.error < 1e-6, "{estimate:?}");
        }
        let (_, estimate) = estimated(&narrow_path(), 30.0);
        assert!(estimate.resolved(), "{estimate:?}");
    }

    #[test]
    fn neither_the_solution_nor_the_estimate_depends_on_what_else_is_asked_for() {
        let (problem, options) = (five_agents(ring(5), 2.0), ReferenceOptions::default());
        let solve = |times: &[f64]| {
            solve_estimated(&problem, times, &options, &mut |_| ControlFlow::Continue(())).unwrap()
        };
        let (few, many) = (solve(&[0.0, 0.5, 3.0]), solve(&[0.0, 0.1, 0.5, 0.5, 2.9, 3.0]));
        assert_eq!((few.estimate, few.max_ratio, few.steps), (many.estimate, many.max_ratio, many.steps));
        assert_eq!(few.times, [0.0, 0.5, 3.0]);
        for (row, same) in [(0, 0), (1, 2), (1, 3), (2, 5)] {
            assert_eq!(few.row(&few.x, row), many.row(&many.x, same));
            assert_eq!(few.row(&few.u, row), many.row(&many.u, same));
        }
        let alone = super::super::solve(&problem, &few.times, &options).unwrap();
        assert_eq!((&alone.x, &alone.nu, alone.max_ratio), (&few.x, &few.nu, few.max_ratio));
    }

    #[test]
    fn a_run_that_ends_early_has_the_rows_that_were_asked_for() {
        let times: Vec<f64> = (0..=800).map(f64::from).collect();
        let options = ReferenceOptions::default();
        let error = solve_estimated(&narrow_path(), &times, &options, &mut |_| ControlFlow::Continue(()))
            .unwrap_err();
        let ReferenceError::Unresolved { at, partial, .. } = error else { panic!("{error}") };
        assert_eq!((partial.times.len(), partial.x.len()), (at as usize + 1, 11 * (at as usize + 1)));
    }

    #[test]
    fn a_distance_that_is_not_a_number_is_not_resolved() {
        let rows = [(0.0, [1.0], [1.0]), (1.0, [f64::NAN], [1.0]), (2.0, [1.0], [1.0])];
        let estimate = distance(rows.iter().map(|(t, a, b)| (*t, &a[..], &b[..])), 1e-3);
        assert!(!estimate.resolved() && estimate.error.is_nan() && estimate.at == 1.0, "{estimate:?}");
    }
}
