//! The continuous-time reference of a scenario: as a fidelity of its own, and as what other runs are compared with.

use super::error::RunError;
use super::options::{RunOptions, Verbosity};
use super::outcome::{EarlyEnd, Outcome};
use super::rows::Rows;
use crate::emergent::Predictor;
use crate::exit::Exit;
use crate::extremes::{larger, largest};
use crate::judge::{Judge, Moment, ReferenceSummary};
use crate::presence::Presence;
use crate::progress::Progress;
use crate::record::Row;
use crate::reference::{self, CoupledProblem, ReferenceError, ReferenceOptions, ReferenceSolution};
use crate::scenario::Scenario;
use std::ops::ControlFlow;

/// States that a run of the reference is judged at, nodes times instants, at most: 512 MiB of them.
const JUDGED_STATES: u64 = 1 << 24;

/// Runs the reference by itself. It is judged at every tick, or in a long run at every so many, whatever `--every` asks for.
pub fn run(scenario: &Scenario, options: &RunOptions, to: &mut dyn Rows) -> Result<Outcome, RunError> {
    // Between two rounds, too: a solution knows no rounds.
    let (ticks, stride) = (scenario.time.steps(), options.stride(&scenario.time));
    let judged = (ticks * scenario.nodes.len() as u64).div_ceil(JUDGED_STATES).max(1);
    let is_row = |k: u64| k.is_multiple_of(stride) || k == ticks;
    let is_judged = |k: u64| k.is_multiple_of(judged) || k == ticks;
    let wanted: Vec<u64> = (0..=ticks).filter(|&k| is_row(k) || is_judged(k)).collect();
    let solution = match solve(scenario, &problem(scenario)?, options, &wanted) {
        Err(ReferenceError::Cancelled { partial, .. }) if !partial.times.is_empty() => *partial,
        other => other.map_err(explained)?,
    };
    // Before the end where the user has stopped it.
    let end = solution.times.len().checked_sub(1).and_then(|last| wanted.get(last)).copied().unwrap_or(ticks);
    let (mut predictor, mut judge) = (Predictor::new(scenario), Judge::new(scenario));
    let presence = vec![Presence::Ran; scenario.nodes.len()];
    let mut outcome = Outcome::default();
    for (&k, mut row) in wanted.iter().zip(rows(&solution)) {
        if is_judged(k) || k == end {
            let (k, part) = scenario.time.tick_of_step(k);
            judge.tick(&Moment { k, part, x: &row.x, u: &row.u, presence: &presence }, Some(&row.x));
        }
        if is_row(k) || k == end {
            let prediction = predictor.advance(row.t);
            (row.xi, row.blended) = (prediction.xi.clone(), prediction.blended.clone());
            outcome.widest = largest(0.0, row.psi.iter().copied());
            to.take(row)?;
        }
    }
    let findings = judge.finish();
    Ok(Outcome {
        // Of all steps of the solver, which are closer than ticks.
        max_ratio: larger(solution.max_ratio, findings.max_ratio),
        breaches: findings.breaches,
        last: findings.last.clone(),
        findings,
        prediction: predictor.finish(),
        // The reference is its own reference: what it may be off by is in its estimate.
        reference: Some(ReferenceSummary::beside(&solution)),
        ended_early: (end < ticks || options.interrupt.is_set()).then(|| {
            EarlyEnd::after(scenario.time.tick_of_step(end).0 + 1, scenario, RunError::interrupted())
        }),
        ..outcome
    })
}

/// The states at every tick, those between two rounds included, where an expectation asks for them.
///
/// # Errors
/// The scenario has no continuous-time solution that can be resolved, or an interrupt.
pub fn where_expected(
    scenario: &Scenario,
    options: &RunOptions,
) -> Result<Option<ReferenceSolution>, RunError> {
    if !scenario.expect.asks_for_reference() {
        return Ok(None);
    }
    let wanted: Vec<u64> = (0..=scenario.time.steps()).collect();
    solve(scenario, &problem(scenario)?, options, &wanted).map_err(explained).map(Some)
}

/// Where no input reaches its limit the solution is that without limits, which has more digits: it is tried first.
fn solve(
    scenario: &Scenario,
    problem: &CoupledProblem,
    options: &RunOptions,
    steps: &[u64],
) -> Result<ReferenceSolution, ReferenceError> {
    if problem.limits.iter().all(Option::is_none) {
        return solve_as_is(scenario, problem, options, steps);
    }
    let free = CoupledProblem { limits: vec![None; problem.limits.len()], ..problem.clone() };
    match solve_as_is(scenario, &free, options, steps) {
        Ok(solution) if is_within(problem, &solution) => Ok(solution),
        Err(cancelled @ ReferenceError::Cancelled { .. }) => Err(cancelled),
        _ => solve_as_is(scenario, problem, options, steps),
    }
}

/// Whether every input is within its limits, as far as rows show it.
fn is_within(problem: &CoupledProblem, solution: &ReferenceSolution) -> bool {
    let n = problem.components.max(1);
    let at = |(at, u): (usize, &f64)| {
        let limits = problem.limits.get(at % solution.nodes.max(1) / n).copied().flatten();
        limits.is_none_or(|(low, high)| (low..=high).contains(u))
    };
    solution.u.iter().enumerate().all(at)
}

fn solve_as_is(
    scenario: &Scenario,
    problem: &CoupledProblem,
    options: &RunOptions,
    steps: &[u64],
) -> Result<ReferenceSolution, ReferenceError> {
    let time_of = |&n: &u64| {
        let (k, part) = scenario.time.tick_of_step(n);
        scenario.time.part_at_s(k, part)
    };
    let times: Vec<f64> = steps.iter().map(time_of).collect();
    let quiet = options.verbosity == Verbosity::Quiet;
    let progress = Progress::new("reference", scenario.time.end_s(), quiet);
    let mut on_step = |t: f64| {
        progress.at(t);
        if options.interrupt.is_set() { ControlFlow::Break(()) } else { ControlFlow::Continue(()) }
    };
    reference::solve_coupled(problem, &times, &ReferenceOptions::default(), &mut on_step)
}

/// How a run ends without a whole solution.
fn explained(error: ReferenceError) -> RunError {
    match error {
        ReferenceError::Cancelled { .. } => RunError::interrupted(),
        ReferenceError::Unresolved { .. } => {
            RunError { message: error.to_string(), exit: Exit::ExpectationFailed }
        }
        _ => RunError::bad_input(error),
    }
}

fn rows(solution: &ReferenceSolution) -> impl Iterator<Item = Row> {
    let table = |values: &[f64], k: usize| values.chunks_exact(solution.nodes).nth(k).unwrap_or(&[]).to_vec();
    let row = move |(k, &t): (usize, &f64)| Row {
        t,
        x: table(&solution.x, k),
        nu: table(&solution.nu, k),
        psi: table(&solution.psi, k),
        u: table(&solution.u, k),
        // Every state is known, and its funnels are the scenario's.
        true_nu: table(&solution.nu, k),
        asked_psi: table(&solution.psi, k),
        xi: Vec::new(),
        blended: Vec::new(),
        lost: 0,
    };
    solution.times.iter().enumerate().map(row)
}

fn problem(scenario: &Scenario) -> Result<CoupledProblem, RunError> {
    if !scenario.stays_whole() {
        return Err(RunError::bad_input(
            "there is no reference for a scenario with an [[event]] that takes nodes or links away: the continuous-time solution is that of all nodes and all links; \
             run it with sim-host run --on loopback, without reference_error among its expectations",
        ));
    }
    if !scenario.is_honest() {
        return Err(RunError::bad_input(
            "there is no reference for a scenario with an [[event]] of kind liar, replayer or impostor: the continuous-time solution is that of nodes \
             that say their own states; run it with sim-host run --on loopback, without reference_error among its expectations",
        ));
    }
    if (0..scenario.nodes.len()).any(|index| scenario.has_plant(index)) {
        return Err(RunError::bad_input(
            "there is no reference for a scenario with an [[event]] of kind sensor or actuator: the continuous-time solution is that of nodes \
             whose sensors and actuators work; run it with sim-host run --on loopback, without reference_error among its expectations",
        ));
    }
    if !scenario.staged.is_empty() {
        return Err(RunError::bad_input(
            "there is no reference for a scenario with an [[event]] of kind set: the continuous-time solution is that of nodes that stay as they are; \
             run it with sim-host run --on loopback, without reference_error among its expectations",
        ));
    }
    Ok(CoupledProblem {
        coupling: scenario.coupling,
        components: scenario.components(),
        x0: scenario.initial_states(),
        edges: scenario.graph.edges.iter().map(|edge| (edge.a, edge.b, edge.weight)).collect(),
        fields: scenario.nodes.iter().map(|node| node.dynamics.clone()).collect(),
        gains: scenario.nodes.iter().map(|node| node.gain.prepared()).collect(),
        funnels: scenario.nodes.iter().map(|node| node.funnel).collect(),
        limits: scenario
            .nodes
            .iter()
            .map(|node| node.limits.map(|limits| (limits.low, limits.high)))
            .collect(),
    })
}
