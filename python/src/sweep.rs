//! `sweep`: a scenario over values and seeds, as the command does it.

use crate::errors;
use crate::scenario::Scenario;
use crate::trouble::Trouble;
use crate::work::watched;
use pyo3::prelude::*;
use sim_host::run::RunError;
use sim_host::sweep::{Axis, Design, Method, Plan, Quoting, Range, Request, execute};
use std::num::NonZero;
use std::path::PathBuf;

/// What is drawn, if anything: method, points and seed of the drawing.
type Drawing = Option<(String, u64, u64)>;

/// Sweeps a scenario into `out`, and gives the table and the exit code of the command.
#[pyfunction]
#[pyo3(signature = (scenario, grid, ranges, drawing, seeds, independent, out, resume, jobs, allow_refused, command))]
#[allow(clippy::too_many_arguments, reason = "they are those of Python, by name")]
pub fn sweep(
    py: Python<'_>,
    scenario: &Scenario,
    grid: Vec<String>,
    ranges: Vec<String>,
    drawing: Drawing,
    seeds: u64,
    independent: bool,
    out: PathBuf,
    resume: bool,
    jobs: Option<usize>,
    allow_refused: bool,
    command: String,
) -> PyResult<(PathBuf, u8)> {
    let trouble = Trouble::default();
    let design =
        design(&grid, &ranges, drawing).map_err(|why| errors::of_run(py, &RunError::bad_input(why)))?;
    let is_seed = |set: &&sim_host::scenario::Override| set.key() == "seed";
    let seed = scenario.settings.iter().rev().find(is_seed).map(|set| set.setting());
    let seed = seed.and_then(|setting| setting.trim_start_matches("seed=").parse().ok());
    let plan = Plan {
        source: scenario.source.clone(),
        named: scenario.source.path.clone(),
        settings: scenario.settings.iter().filter(|set| !is_seed(set)).cloned().collect(),
        design,
        seed: seed.unwrap_or_else(|| scenario.source.seed()),
        seeds,
        is_independent: independent,
    };
    let cores = || std::thread::available_parallelism().map_or(1, NonZero::get);
    let request = Request {
        out,
        inputs: vec![scenario.source.path.clone()],
        shard: None,
        resumes: resume,
        jobs: jobs.unwrap_or_else(cores).max(1),
        may_refuse: allow_refused,
        parquet: false,
        is_quiet: true,
        interrupt: trouble.interrupt().clone(),
        command,
        quoting: Quoting { program: "sim-host".to_owned(), quote: quoted },
    };
    let done = watched(py, &trouble, |_| Ok(()), || execute(&plan, &request))?;
    let done = done.map_err(|error| errors::of_run(py, &error))?;
    Ok((done.table, done.exit as u8))
}

fn design(grid: &[String], ranges: &[String], drawing: Drawing) -> Result<Design, String> {
    let grid = grid.iter().map(|text| Axis::parse(text).map_err(|why| format!("grid {text}: {why}")));
    let grid = grid.collect::<Result<Vec<_>, _>>()?;
    let Some((method, points, seed)) = drawing else {
        return Ok(Design::of_grid(grid));
    };
    let ranges = ranges.iter().map(|text| Range::parse(text).map_err(|why| format!("ranges {text}: {why}")));
    let kind = if method == "sobol" { Method::Sobol } else { Method::Lhs };
    Design::drawn(kind, points, seed, ranges.collect::<Result<_, _>>()?, grid)
        .map_err(|why| format!("{method} {why}"))
}

/// Words as a command for a shell.
fn quoted(words: &[String]) -> String {
    let quote = |word: &String| {
        let is_plain = |c: char| c.is_ascii_alphanumeric() || "-_./=:,@%+".contains(c);
        let is_bare = !word.is_empty() && word.chars().all(is_plain);
        if is_bare { word.clone() } else { format!("'{}'", word.replace('\'', "'\\''")) }
    };
    words.iter().map(quote).collect::<Vec<_>>().join(" ")
}
