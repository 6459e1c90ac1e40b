//! `run`: a scenario to its end, as the command does it.

use crate::errors;
use crate::field;
use crate::large;
use crate::rows::Columns;
use crate::scenario::Scenario;
use crate::trouble::Trouble;
use crate::work::watched;
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;
use pyo3::types::PyDict;
use sim_host::record::{BusLogs, Summary};
use sim_host::run::{Claim, Fidelity, RunError, RunOptions, Verbosity, Wanted, every_ticks, execute_with};
use sim_host::scenario::{AnyScenario, Scenario as Wired, TimeSpec, parse_duration};
use std::path::{Path, PathBuf};

/// Runs a scenario: its summary as JSON, and its columns.
#[pyfunction]
#[pyo3(signature = (scenario, on, every, out, fields, progress, nodes, threads, command))]
#[allow(clippy::too_many_arguments, reason = "they are those of Python, by name")]
pub fn run<'py>(
    py: Python<'py>,
    scenario: &Scenario,
    on: &str,
    every: Option<&str>,
    out: Option<PathBuf>,
    fields: &Bound<'py, PyAny>,
    progress: Option<Py<PyAny>>,
    nodes: Option<Vec<usize>>,
    threads: Option<usize>,
    command: String,
) -> PyResult<(String, Bound<'py, PyDict>)> {
    let trouble = Trouble::default();
    let on = fidelity(on)?;
    let every = |time| every.map(|every| ticks(every, time)).transpose().map_err(|e| errors::of_run(py, &e));
    let wired = match &*scenario.inner {
        AnyScenario::Wired(wired) => wired.as_ref(),
        AnyScenario::Large(scenario) => {
            if on != Fidelity::Loopback || fields.len()? > 0 {
                return Err(PyValueError::new_err(
                    "bus.model = \"none\": such a run takes neither on = \"reference\" nor fields",
                ));
            }
            let options = options(on, out, every(&scenario.time)?, &trouble, &command);
            let nodes = nodes.unwrap_or_default();
            let asked = large::Asked { nodes, threads, options, command, progress };
            return large::run(py, scenario, asked, &trouble);
        }
    };
    if nodes.is_some() || threads.is_some() {
        return Err(PyValueError::new_err(
            "nodes and threads are for runs with bus.model = \"none\"; others have columns of every node, and one thread",
        ));
    }
    let every = every(&wired.time)?;
    let callables = field::callables(fields, wired, &trouble)?;
    let mut columns = Columns::default();
    let (reached, end) = (columns.reached.clone(), wired.time.end_s());
    let look = move |py: Python<'_>| match &progress {
        Some(progress) => progress.call1(py, (reached.get(), end)).map(drop),
        None => Ok(()),
    };
    let options = options(on, out, every, &trouble, &command);
    let work = || {
        // A copy alone gets the host's fields: the scenario may be run again without them.
        let hosted = callables.put_into(wired);
        trouble.arm();
        executed(hosted.as_ref().unwrap_or(wired), &options, &command, &mut columns)
    };
    let summary = watched(py, &trouble, look, work)?.map_err(|error| errors::of_run(py, &error))?;
    Ok((summary.to_json(), columns.into_dict(py, wired.nodes.len(), wired.components())?))
}

/// What a run from Python writes beside its result: its folder, where one is asked for.
pub(crate) fn wanted<'a>(scenario: &'a Path, options: &'a RunOptions, command: &'a str) -> Wanted<'a> {
    Wanted { scenario, sets: &[], bench: None, out: options.out.as_deref(), json: None, junit: None, command }
}

fn executed(
    scenario: &Wired,
    options: &RunOptions,
    command: &str,
    columns: &mut Columns,
) -> Result<Summary, RunError> {
    let claim = Claim::take(&wanted(&scenario.path, options, command))?;
    claim
        .guard(|claim| execute_with(claim, scenario, options, columns, &mut |_| ()))
        .map(|(summary, _)| summary)
}

fn fidelity(on: &str) -> PyResult<Fidelity> {
    match on {
        "loopback" => Ok(Fidelity::Loopback),
        "reference" => Ok(Fidelity::Reference),
        _ => Err(PyValueError::new_err(format!(
            "on = {on:?}: must be \"loopback\" or \"reference\"; emulated and real nodes are run by the command sim-host"
        ))),
    }
}

fn ticks(every: &str, time: &TimeSpec) -> Result<u64, RunError> {
    let ns = parse_duration(every).map_err(|why| RunError::bad_input(format!("every = {every:?}: {why}")))?;
    every_ticks(ns, time)
}

fn options(
    on: Fidelity,
    out: Option<PathBuf>,
    every_ticks: Option<u64>,
    trouble: &Trouble,
    command: &str,
) -> RunOptions {
    RunOptions {
        on,
        out,
        every_ticks,
        json: None,
        junit: None,
        image: Path::new("").to_owned(),
        bench: None,
        bus_logs: BusLogs { log: true, capture: false },
        mcap: false,
        verbosity: Verbosity::Quiet,
        interrupt: trouble.interrupt().clone(),
        repeat: command.to_owned(),
    }
}
