//! Runs a scenario at a fidelity, and judges it.

mod bench;
mod bench_buses;
mod between;
mod claim;
mod collect;
mod commission;
mod drive;
mod error;
mod event_log;
mod fidelity;
mod folder;
mod large;
mod lock;
mod makes;
pub(crate) mod names;
mod network;
mod options;
mod outcome;
mod output;
mod own_clock;
mod places;
mod reference;
mod rows;
#[cfg(test)]
pub(crate) mod testing;
#[cfg(test)]
mod tests;
mod told;
mod update;
mod update_progress;

pub use claim::Claim;
pub use commission::{commission, erase};
pub use error::RunError;
pub use event_log::MoreEvents;
pub(crate) use fidelity::LOCKSTEP;
pub(crate) use folder::Folder;
pub use large::{
    LargeOptions, LargeRows, execute_large_in, execute_large_with, known_nodes, quantile_names,
    simulate_large,
};
pub(crate) use lock::{Access, Lock, LockError};
pub(crate) use names::SCENARIO as SCENARIO_FILE;
pub(crate) use names::{SWEEP as SWEEP_FILE, is_ours};
pub use options::{Fidelity, RunOptions, Verbosity, every_ticks};
pub use outcome::{EarlyEnd, Outcome};
pub use output::trace;
pub(crate) use own_clock::DRIVE as OWN_CLOCK;
pub use places::Wanted;
pub(crate) use places::{files_named_in, is_one_file, overwritten};
pub use rows::Rows;
use rows::{Both, Nobody};
pub use update::{UpdateOutcome, update};
pub use update_progress::UpdateProgress;

use crate::emergent::EmergentTrajectory;
use crate::printable::{printable, printable_lines};
use crate::record::{Summary, junit};
use crate::scenario::{LARGEST_RUN, Scenario};
use funnelnet_node::Event;
use output::Outputs;
use std::io::Write;
use std::time::Instant;

/// Runs `scenario`, writes what `options` ask for, and gives the summary with the judged expectations.
///
/// # Errors
/// See [`RunError`]; outputs appear whole or not at all.
pub fn execute(scenario: &Scenario, options: &RunOptions) -> Result<Summary, RunError> {
    let wanted = Wanted {
        scenario: &scenario.path,
        sets: &[],
        bench: options.bench.as_ref().map(|file| file.path.as_path()),
        out: options.out.as_deref(),
        json: options.json.as_deref(),
        junit: options.junit.as_deref(),
        command: &options.repeat,
    };
    Claim::take(&wanted)?.guard(|claim| execute_in(claim, scenario, options))
}

/// The same with outputs that have been claimed before the scenario was read.
///
/// # Errors
/// See [`RunError`]; outputs appear whole or not at all.
pub fn execute_in(claim: &mut Claim, scenario: &Scenario, options: &RunOptions) -> Result<Summary, RunError> {
    // Before the outputs, which may fail.
    let mut tell = |outcome: &Outcome| tell_events(scenario, outcome, options);
    let (summary, outcome) = execute_with(claim, scenario, options, &mut Nobody, &mut tell)?;
    if let Some(early) = &outcome.ended_early {
        // What the nodes had to say for themselves; the check says the rest.
        let is_written = options.out.is_some() || options.json.is_some() || options.junit.is_some();
        let _ = writeln!(std::io::stderr(), "{}", printable_lines(&early.told(is_written)));
    }
    Ok(summary)
}

/// The same for who takes the rows as well, and says himself what there is to say: `ended` sees the outcome before it is written.
///
/// # Errors
/// See [`RunError`], and those of `also`; outputs appear whole or not at all.
pub fn execute_with(
    claim: &mut Claim,
    scenario: &Scenario,
    options: &RunOptions,
    also: &mut dyn Rows,
    ended: &mut dyn FnMut(&Outcome),
) -> Result<(Summary, Outcome), RunError> {
    let begin = Instant::now();
    fits(scenario)?;
    let mut outputs = Outputs::open(scenario, options)?;
    let outcome = simulate_into(scenario, options, &mut Both(&mut outputs, also))?;
    ended(&outcome);
    let mut summary = outcome.judge(scenario, options.on);
    summary.version = env!("CARGO_PKG_VERSION");
    summary.command = claim.command().to_owned();
    summary.wall_s = begin.elapsed().as_secs_f64();
    outputs.write(scenario, &outcome, &summary)?;
    // Last, so that it is green only where everything else is there.
    claim.take_junit().map_or(Ok(()), |file| claim::commit(file, &junit(&summary, &options.repeat)))?;
    Ok((summary, outcome))
}

/// A node that has stopped by itself leaves figures that look like those of a good run.
fn tell_events(scenario: &Scenario, outcome: &Outcome, options: &RunOptions) {
    let is_told = |event: &Event| match options.verbosity {
        Verbosity::Verbose => true,
        Verbosity::Normal => matches!(event, Event::Fault(_) | Event::Warned(_)),
        Verbosity::Quiet => false,
    };
    let time = &scenario.time;
    let events = outcome.events.iter().filter(|event| is_told(&event.event));
    let more = outcome.more_events.iter().filter(|more| is_told(&more.last.event));
    let told: Vec<_> = events
        .map(|event| told::of_node(event, time))
        .chain(more.map(|more| told::counted(more, time)))
        .collect();
    // Nobody is left to tell where standard error is closed.
    let _ = std::io::stderr().write_all(told::lines(&told).as_bytes());
}

/// Runs `scenario` and gives everything that was seen, all rows among it; writes nothing.
///
/// # Errors
/// See [`RunError`].
pub fn simulate(scenario: &Scenario, options: &RunOptions) -> Result<Outcome, RunError> {
    let mut rows = Vec::new();
    let outcome = simulate_into(scenario, options, &mut rows)?;
    Ok(Outcome { rows, ..outcome })
}

/// The same with rows that go where `rows` says as they come; the outcome has none.
///
/// # Errors
/// See [`RunError`], and those of `rows`.
pub fn simulate_into(
    scenario: &Scenario,
    options: &RunOptions,
    rows: &mut dyn Rows,
) -> Result<Outcome, RunError> {
    fits(scenario)?;
    if scenario.expect.asks_for_emergent() && EmergentTrajectory::new(scenario).is_none() {
        return Err(RunError::bad_input(format!(
            "the emergent dynamics are not known for {} coupling of states with {} components; leave emergent_error out of its expectations",
            scenario.coupling.kind(),
            scenario.components()
        )));
    }
    match options.on {
        Fidelity::Loopback => fidelity::loopback(scenario, options, rows),
        Fidelity::Emulator => fidelity::emulator(scenario, options, rows),
        Fidelity::Bench => bench::run(scenario, options, rows),
        Fidelity::Reference => reference::run(scenario, options, rows),
    }
}

/// Refuses more nodes than have an id on the wire.
fn fits(scenario: &Scenario) -> Result<(), RunError> {
    let nodes = scenario.nodes.len();
    if nodes <= LARGEST_RUN {
        return Ok(());
    }
    Err(RunError::bad_input(format!(
        "{}: graph.nodes = {nodes}: a run takes {LARGEST_RUN} nodes at most, since an id is 7 bits on the wire and 0 means all; \
         `sim-host check` takes this scenario",
        printable(&scenario.path.display().to_string())
    )))
}
