//! The continuous-time reference of a scenario: as a fidelity of its own, and as what other runs are compared with.

use super::error::RunError;
use super::options::{RunOptions, Verbosity};
use super::outcome::Outcome;
use crate::emergent::Predictor;
use crate::exit::Exit;
use crate::extremes::larger;
use crate::progress::Progress;
use crate::record::{ReferenceSummary, Row};
use crate::reference::{self, ReferenceError, ReferenceOptions, ReferenceProblem, ReferenceSolution};
use crate::scenario::{CouplingKind, FunnelSpec, GainSpec, Scenario};
use funnel_core::gain::median;
use std::ops::ControlFlow;

/// Runs the reference by itself.
pub fn run(scenario: &Scenario, options: &RunOptions) -> Result<Outcome, RunError> {
    let (ticks, stride) = (scenario.time.ticks, options.stride(scenario.time.ticks));
    let last = (!ticks.is_multiple_of(stride)).then_some(ticks);
    let wanted: Vec<u64> = (0..=ticks).step_by(stride as usize).chain(last).collect();
    let solution = solve(scenario, options, &wanted)?;
    let mut predictor = Predictor::new(scenario);
    let mut outcome = Outcome { max_ratio: solution.max_ratio, ..Outcome::default() };
    // The reference is its own reference: what it may be off by is in its estimate.
    outcome.reference = Some(ReferenceSummary::beside(&solution));
    for (&k, mut row) in wanted.iter().zip(rows(&solution)) {
        let prediction = predictor.advance(row.t);
        (row.xi, row.blended) = (prediction.xi.clone(), prediction.blended.clone());
        outcome.last.clone_from(&row.x);
        outcome.widest = row.psi.iter().copied().fold(0.0, larger);
        if k.is_multiple_of(stride) {
            outcome.rows.push(row);
        }
    }
    outcome.prediction = predictor.finish();
    Ok(outcome)
}

/// The states at every tick, where an expectation asks for them.
///
/// # Errors
/// The scenario has no continuous-time solution that can be resolved, or an interrupt.
pub fn where_expected(
    scenario: &Scenario,
    options: &RunOptions,
) -> Result<Option<ReferenceSolution>, RunError> {
    if scenario.expect.reference_error.is_none() {
        return Ok(None);
    }
    let wanted: Vec<u64> = (0..=scenario.time.ticks).collect();
    solve(scenario, options, &wanted).map(Some)
}

fn solve(scenario: &Scenario, options: &RunOptions, ticks: &[u64]) -> Result<ReferenceSolution, RunError> {
    let times: Vec<f64> = ticks.iter().map(|&k| k as f64 * scenario.time.tick_s()).collect();
    let quiet = options.verbosity == Verbosity::Quiet;
    let progress = Progress::new("reference", scenario.time.end_s(), quiet);
    let mut on_step = |t: f64| {
        progress.at(t);
        if options.interrupt.is_set() { ControlFlow::Break(()) } else { ControlFlow::Continue(()) }
    };
    let options = ReferenceOptions::default();
    reference::solve_estimated(&problem(scenario)?, &times, &options, &mut on_step).map_err(|error| {
        match error {
            ReferenceError::Cancelled { .. } => RunError::interrupted(),
            ReferenceError::Unresolved { .. } => {
                RunError { message: error.to_string(), exit: Exit::ExpectationFailed }
            }
            _ => RunError::bad_input(error),
        }
    })
}

fn rows(solution: &ReferenceSolution) -> impl Iterator<Item = Row> {
    let table = |values: &[f64], k: usize| values.chunks_exact(solution.nodes).nth(k).unwrap_or(&[]).to_vec();
    let row = move |(k, &t): (usize, &f64)| Row {
        t,
        x: table(&solution.x, k),
        nu: table(&solution.nu, k),
        psi: table(&solution.psi, k),
        u: table(&solution.u, k),
        xi: Vec::new(),
        blended: Vec::new(),
    };
    solution.times.iter().enumerate().map(row)
}

fn problem(scenario: &Scenario) -> Result<ReferenceProblem, RunError> {
    let coupling = scenario.coupling;
    let law = matches!(coupling, CouplingKind::NodeWise | CouplingKind::ElementWise | CouplingKind::MaxGain);
    if scenario.components() > 1 || !law {
        return Err(RunError::bad_input(format!(
            "there is no reference for {} coupling of states with {} components, only for the node-wise law of scalar states; \
             run it with --on loopback, without expect.reference_error",
            coupling.name(),
            scenario.components()
        )));
    }
    let gains: Option<Vec<_>> = scenario.nodes.iter().map(|node| gain(&node.gain)).collect();
    let funnels: Option<Vec<_>> = scenario.nodes.iter().map(|node| funnel(&node.funnel)).collect();
    let (Some(gains), Some(funnels)) = (gains, funnels) else {
        return Err(RunError::bad_input("there is no reference for this kind of gain or funnel yet"));
    };
    let sine = |s: &crate::scenario::Sine| reference::Sine {
        amplitude: s.amplitude,
        frequency: s.frequency,
        phase: s.phase,
    };
    let field = |dynamics: &crate::scenario::Affine| reference::Affine {
        slope: dynamics.slope(),
        offset: dynamics.offset(),
        sines: dynamics.sines.iter().map(sine).collect(),
    };
    Ok(ReferenceProblem {
        x0: scenario.initial_states(),
        edges: scenario.graph.edges.iter().map(|edge| (edge.a, edge.b, edge.weight)).collect(),
        fields: scenario.nodes.iter().map(|node| field(&node.dynamics)).collect(),
        gains,
        funnels,
    })
}

fn gain(spec: &GainSpec) -> Option<reference::Gain> {
    match *spec {
        GainSpec::Reciprocal { scale } => Some(reference::Gain::Reciprocal { scale }),
        GainSpec::Logarithmic { scale } => Some(reference::Gain::Logarithmic { scale }),
        GainSpec::LocallyLinear { bound } => Some(reference::Gain::LocallyLinear { bound }),
        GainSpec::Median { eta, eps } => Some(reference::Gain::Reciprocal { scale: median(eta, eps).scale }),
        GainSpec::Linear { .. } => None,
    }
}

fn funnel(spec: &FunnelSpec) -> Option<reference::Funnel> {
    match *spec {
        FunnelSpec::Exponential { start, end, rate, factor } => {
            Some(reference::Funnel::Exponential { start, end, rate, factor })
        }
        FunnelSpec::Constant { width, factor } => Some(reference::Funnel::Constant { width, factor }),
        FunnelSpec::ReciprocalTime { .. } | FunnelSpec::FiniteTime { .. } | FunnelSpec::Schedule { .. } => {
            None
        }
    }
}
