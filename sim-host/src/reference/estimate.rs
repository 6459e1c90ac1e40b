//! How far a reference solution may be from the exact one.
//!
//! The solver controls the error of each step, and an unstable network multiplies it: by `e^30` in 30 s with a slope of 1/s. So the
//! problem is solved once more, ten times less exactly and from states that are all moved by the tolerance, and the distance of both is
//! the estimate. The move is what the tolerance allows at the start. It makes sure that the two come apart where errors grow, even where
//! the steps happen to make none: both would otherwise stay on an equilibrium that no real network stays on.

use super::error::ReferenceError;
use super::options::ReferenceOptions;
use super::problem::ReferenceProblem;
use super::solution::ReferenceSolution;
use super::{check, start_from};
use crate::extremes::{beyond, larger, largest};
use std::ops::ControlFlow;

/// Share of the largest state up to then that the error may be in a solution that is resolved.
const RESOLVED: f64 = 1e-3;
/// An error that is small whatever the states are, over the tolerance.
const SMALL: f64 = 1e3;
/// The tolerance of the second solution over that of the first.
const LOOSER: f64 = 10.0;
/// The loosest tolerance that the solver takes.
const LOOSEST: f64 = 1e-2;
/// Output times at which the two are compared at most; errors come and go with the solution, which steps resolve.
const COMPARED: usize = 2_000;

/// The distance of two solutions of a problem.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ErrorEstimate {
    /// The largest, state units; infinite where the second solution could not be had to the end.
    pub error: f64,
    /// The largest over the largest state up to then, or over the smallest that the tolerance allows for where states are smaller.
    pub share: f64,
    /// When that was, s.
    pub at: f64,
}

impl ErrorEstimate {
    /// Whether the solution can stand for the exact one.
    #[must_use]
    pub fn resolved(&self) -> bool {
        self.share <= RESOLVED
    }
}

/// Like [`solve_with`](super::solve_with), with an estimate of the error. `on_step` sees the time go from 0 to the end once.
///
/// # Errors
/// Those of [`solve_with`](super::solve_with) for the problem itself.
pub fn solve_estimated(
    problem: &ReferenceProblem,
    times: &[f64],
    options: &ReferenceOptions,
    on_step: &mut dyn FnMut(f64) -> ControlFlow<()>,
) -> Result<ReferenceSolution, ReferenceError> {
    check(problem, times, options)?;
    let end = times.last().copied().unwrap_or(0.0);
    let mut solution = start_from(problem, times, options, 0.0, &mut |t| on_step(0.5 * t))?;
    let stride = times.len().div_ceil(COMPARED).max(1);
    // The last time is among them.
    let first = times.len().saturating_sub(1) % stride;
    let compared: Vec<f64> = times.iter().copied().skip(first).step_by(stride).collect();
    let looser = ReferenceOptions { tolerance: (LOOSER * options.tolerance).min(LOOSEST), ..*options };
    let scale = largest(1.0, problem.x0.iter().map(|x| x.abs()));
    let shift = options.tolerance * scale;
    let other = start_from(problem, &compared, &looser, shift, &mut |t| on_step(0.5 * (end + t)));
    solution.estimate = Some(match other {
        Ok(other) => {
            let rows = solution.x.chunks_exact(solution.nodes).skip(first).step_by(stride);
            let other = compared.iter().zip(other.x.chunks_exact(solution.nodes));
            distance(rows.zip(other).map(|(x, (&t, y))| (t, x, y)), SMALL * options.tolerance / RESOLVED)
        }
        Err(cancelled @ ReferenceError::Cancelled { .. }) => return Err(cancelled),
        Err(ReferenceError::Unresolved { at, .. }) => {
            ErrorEstimate { error: f64::INFINITY, share: f64::INFINITY, at }
        }
        Err(other) => return Err(other),
    });
    Ok(solution)
}

/// The distance of two solutions, given as time and states; no state counts as smaller than `smallest` (state units).
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
    use super::super::{Affine, Funnel, Gain};
    use super::*;
    use funnel_core::math;

    fn estimated(problem: &ReferenceProblem, end: f64) -> (ReferenceSolution, ErrorEstimate) {
        let times: Vec<f64> = (0..=3000).map(|k| end * f64::from(k) / 3000.0).collect();
        let options = ReferenceOptions::default();
        let solution =
            solve_estimated(problem, &times, &options, &mut |_| ControlFlow::Continue(())).unwrap();
        let estimate = solution.estimate.unwrap();
        (solution, estimate)
    }

    /// Three nodes of one unstable field with a sine, all at one state: they stay together, and that state is known in closed form.
    fn unstable(slope: f64, offset: f64, x0: f64) -> ReferenceProblem {
        let field = Affine { slope, offset, sines: Vec::new() };
        ReferenceProblem {
            x0: vec![x0; 3],
            edges: path(3),
            fields: vec![field; 3],
            gains: vec![Gain::Reciprocal { scale: 1.0 }; 3],
            funnels: vec![Funnel::Exponential { start: 40.0, end: 2.0, rate: 1.0, factor: 1.0 }; 3],
        }
    }

    /// The same with a sine that keeps the exact state bounded: `x = a sin(w t) + b cos(w t)`, from `x(0) = b`.
    fn balanced(slope: f64, frequency: f64) -> (ReferenceProblem, impl Fn(f64) -> f64) {
        // x' = slope x + sin(w t) has this bounded solution, and e^(slope t) times any error beside it.
        let size = slope * slope + frequency * frequency;
        let (a, b) = (-slope / size, -frequency / size);
        let mut problem = unstable(slope, 0.0, b);
        let sine = super::super::Sine { amplitude: 1.0, frequency, phase: 0.0 };
        problem.fields.iter_mut().for_each(|field| field.sines.push(sine));
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
        let share = error(&solution, |t| math::exp(t)) / math::exp(30.0);
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
    fn a_distance_that_is_not_a_number_is_not_resolved() {
        let rows = [(0.0, [1.0], [1.0]), (1.0, [f64::NAN], [1.0]), (2.0, [1.0], [1.0])];
        let estimate = distance(rows.iter().map(|(t, a, b)| (*t, &a[..], &b[..])), 1e-3);
        assert!(!estimate.resolved() && estimate.error.is_nan() && estimate.at == 1.0, "{estimate:?}");
    }
}
