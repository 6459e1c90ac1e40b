//! The book's figures and its table of scenarios, drawn and computed anew from `scenarios/`.
//!
//! Usage: `gallery [--check]`, from the root of the repository. Writes `docs/book/src/figures/NAME.svg` and
//! the table between the markers in `docs/book/src/scenarios/README.md`; with `--check` it only compares the
//! table, and fails where it differs.
#![allow(clippy::expect_used, clippy::panic)]

use sim_host::interrupt::Interrupt;
use sim_host::number_format::significant;
use sim_host::plot::states_svg;
use sim_host::record::Summary;
use sim_host::run::{Fidelity, Outcome, RunOptions, Verbosity, simulate, trace};
use sim_host::scenario::{Scenario, Window};
use std::num::NonZero;
use std::path::{Path, PathBuf};
use std::process::ExitCode;
use std::sync::atomic::{AtomicUsize, Ordering};

/// Points of a curve in a figure: enough for a page, small enough for a repository.
const POINTS: u64 = 400;
/// The largest error to the reference that a row may have without a word on it (state units).
const NEAR: f64 = 5e-3;
/// What may be the start of a run, s: where inputs are far larger than later, and a state moves farther
/// within a tick than a continuous one does.
const STARTS: [f64; 4] = [0.1, 0.3, 1.0, 3.0];
/// The page with the table.
const PAGE: &str = "docs/book/src/scenarios/README.md";
const BEGIN: &str = "<!-- gallery: begin -->\n";
const END: &str = "<!-- gallery: end -->\n";

fn main() -> ExitCode {
    let check = std::env::args().any(|argument| argument == "--check");
    let scenarios: Vec<_> =
        files().iter().map(|path| Scenario::load(path, &[]).expect("a valid scenario")).collect();
    let mut table = String::from(
        "| scenario | largest \\|nu\\|/psi | final spread | to xi at the end | reference error |\n|---|---:|---:|---:|---:|\n",
    );
    table += &rows(&scenarios, !check).concat();
    let page =
        std::fs::read_to_string(PAGE).expect("the book's page of scenarios, from the root of the repository");
    let (before, rest) = page.split_once(BEGIN).expect("the marker where the table begins");
    let (found, after) = rest.split_once(END).expect("the marker where the table ends");
    if !check {
        std::fs::write(PAGE, [before, BEGIN, &table, END, after].concat()).expect("the page can be written");
    } else if found != table {
        eprintln!("the table of {PAGE} is not what its scenarios give now: ./ci.sh gallery\n{table}");
        return ExitCode::FAILURE;
    }
    ExitCode::SUCCESS
}

/// The rows of the table, in order; scenarios are run side by side, on as many threads as there are cores.
fn rows(scenarios: &[Scenario], draws: bool) -> Vec<String> {
    let next = AtomicUsize::new(0);
    let work = || {
        let at = || Some(next.fetch_add(1, Ordering::Relaxed)).filter(|at| *at < scenarios.len());
        std::iter::from_fn(at).map(|at| (at, shown(&scenarios[at], draws))).collect::<Vec<_>>()
    };
    let threads = std::thread::available_parallelism().map_or(1, NonZero::get);
    let mut rows: Vec<(usize, String)> = std::thread::scope(|scope| {
        let workers: Vec<_> = (0..threads).map(|_| scope.spawn(work)).collect();
        workers.into_iter().flat_map(|worker| worker.join().expect("rows")).collect()
    });
    rows.sort();
    rows.into_iter().map(|(_, row)| row).collect()
}

/// The row of a scenario, and its figure where it is drawn.
fn shown(scenario: &Scenario, draws: bool) -> String {
    let (outcome, judged, missing) = run(scenario);
    if draws {
        draw(scenario, &outcome);
    }
    row(scenario, &outcome.judge(&judged, Fidelity::Loopback), missing)
}

/// Every scenario file, by name.
fn files() -> Vec<PathBuf> {
    let entries = std::fs::read_dir("scenarios").expect("scenarios/, from the root of the repository");
    let mut files: Vec<_> = entries.filter_map(|entry| entry.ok().map(|entry| entry.path())).collect();
    files.retain(|path| path.extension().is_some_and(|extension| extension == "toml"));
    files.sort();
    files
}

/// A run beside the reference with what it is judged by, or one without where there is none, and why.
fn run(scenario: &Scenario) -> (Outcome, Scenario, Option<&'static str>) {
    let mut beside = scenario.clone();
    // Any distance, so that it is measured: of the whole run, and after its start.
    beside.expect.reference_error = beside.expect.reference_error.or(Some(f64::INFINITY));
    beside.expect.windows = STARTS.map(|start| after(scenario, start)).to_vec();
    match simulate(&beside, &options(scenario)) {
        Ok(outcome) => (outcome, beside, None),
        Err(error) => {
            eprintln!("{}: {}", name(scenario), error.message);
            let why = if scenario.events.is_empty() { "not resolved" } else { "none with events" };
            (simulate(scenario, &options(scenario)).expect("a run"), scenario.clone(), Some(why))
        }
    }
}

/// The run after `start` (s).
fn after(scenario: &Scenario, start: f64) -> Window {
    let time = &scenario.time;
    Window {
        from_tick: (0..=time.ticks).find(|&k| time.at_s(k) >= start).unwrap_or(time.ticks),
        to_tick: time.ticks,
        funnel_ratio: None,
        spread: None,
        emergent_error: None,
        reference_error: Some(f64::INFINITY),
        max_input: None,
    }
}

/// The error to the reference, and where it comes from where it is large.
fn reference_error(summary: &Summary) -> String {
    let Some(error) = summary.reference.map(|reference| reference.max_error) else { return String::new() };
    let all = digits_of(error, 2);
    if error <= NEAR {
        return all;
    }
    let of_window = |name: &str| name.starts_with("window.") && name.ends_with(".reference_error");
    let later = summary
        .expect
        .iter()
        .filter(|expected| of_window(&expected.name))
        .filter_map(|expected| expected.value);
    let near = STARTS.iter().zip(later).find(|(_, later)| *later <= NEAR);
    let (start, later) = near
        .unwrap_or_else(|| panic!("{}: an error of {all}, and the row does not say why", summary.scenario));
    format!("{all} at the start, {} from {start} s on", digits_of(later, 2))
}

fn options(scenario: &Scenario) -> RunOptions {
    RunOptions {
        on: Fidelity::Loopback,
        out: None,
        every_ticks: Some((scenario.time.ticks / POINTS).max(1)),
        json: None,
        junit: None,
        image: PathBuf::new(),
        bench: None,
        bus_logs: Default::default(),
        mcap: false,
        verbosity: Verbosity::Quiet,
        interrupt: Interrupt::default(),
        repeat: String::new(),
    }
}

fn name(scenario: &Scenario) -> String {
    scenario.path.file_stem().expect("a name").to_string_lossy().into_owned()
}

/// Two digits for what an f64 solver says, which need not be the same to the last bit everywhere.
fn row(scenario: &Scenario, summary: &Summary, missing: Option<&str>) -> String {
    let name = name(scenario);
    let unresolved = summary.reference.filter(|reference| !reference.resolved).map(|_| "not resolved");
    let number = |value: Option<f64>, digits| value.map_or(String::new(), |value| digits_of(value, digits));
    format!(
        "| [{name}]({name}.md) | {} | {} | {} | {} |\n",
        number(summary.funnel.map(|funnel| funnel.max_ratio), 3),
        number(summary.sync.map(|sync| sync.final_spread), 2),
        number(summary.emergent.as_ref().and_then(|emergent| emergent.final_error), 2),
        missing.or(unresolved).map_or_else(|| reference_error(summary), str::to_owned),
    )
}

/// So many significant digits, below 1e-3 too, where [`figure`] gives one less.
fn digits_of(value: f64, digits: usize) -> String {
    significant(value, if value.abs() < 1e-3 { digits + 1 } else { digits })
}

fn draw(scenario: &Scenario, outcome: &Outcome) {
    let folder = Path::new("docs/book/src/figures");
    std::fs::create_dir_all(folder).expect("a folder for the figures");
    let svg = states_svg(&trace(scenario, outcome)).expect("a figure");
    std::fs::write(folder.join(format!("{}.svg", name(scenario))), svg).expect("a figure can be written");
}
