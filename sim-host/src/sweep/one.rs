//! One run of a sweep, from its scenario to its row.

use super::figures::figures;
use super::plan::{Plan, Run};
use super::table::Row;
use super::verdict::Verdict;
use crate::exit::Exit;
use crate::interrupt::Interrupt;
use crate::printable::printable;
use crate::record::{BusLogs, Row as Sample, Summary, failures};
use crate::run::{
    Fidelity, LargeOptions, LargeRows, Outcome, Rows, RunError, RunOptions, Verbosity, simulate_into,
    simulate_large,
};
use crate::scenario::AnyScenario;
use funnelnet_sim::large::Network;
use std::any::Any;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::time::Instant;

/// A run that came to an end.
#[derive(Debug)]
pub struct Ended {
    /// Which.
    pub run: Run,
    /// What became of it.
    pub verdict: Verdict,
    /// Why it does not pass, in one line.
    pub why: String,
    /// Its row.
    pub row: Row,
    /// The scenario, where it was read.
    pub scenario: Option<AnyScenario>,
}

/// Does a run; `None` where the user has stopped it. A network without a bus has so many `threads`.
#[must_use]
pub fn run(plan: &Plan, number: u64, interrupt: &Interrupt, threads: usize) -> Option<Ended> {
    let run = plan.run(number);
    let (begin, cpu) = (Instant::now(), thread_cpu_s());
    let mut scenario = None;
    let judged = catch_unwind(AssertUnwindSafe(|| {
        let read = plan.scenario(&run).map_err(RunError::bad_input)?;
        judge(scenario.insert(read), interrupt, threads)
    }));
    let judged = judged.unwrap_or_else(|panic| Err(RunError::defect(words_of(panic.as_ref()))));
    if interrupt.is_set() {
        return None;
    }
    let (verdict, why, mut cells) = match judged {
        Ok(summary) if summary.passes() => (Verdict::Passed, String::new(), figures(&summary)),
        Ok(summary) => (Verdict::Failed, first_failure(&summary), figures(&summary)),
        Err(error) => (verdict_of(&error), without_path(&error, plan), Default::default()),
    };
    let mut cell = |name: &str, text: String| drop(cells.insert(name.to_owned(), text));
    cell("run", run.number.to_string());
    run.point.iter().for_each(|setting| cell(&setting.key, printable(&setting.value).into_owned()));
    cell("repetition", run.repetition.to_string());
    cell("seed", run.seed.to_string());
    cell("verdict", verdict.name().to_owned());
    cell("why", why.clone());
    cell("wall_s", format!("{:.6}", begin.elapsed().as_secs_f64()));
    // That of other threads is not known.
    let is_alone = threads == 1 || !matches!(scenario, Some(AnyScenario::Large(_)));
    if let Some((before, after)) = cpu.zip(thread_cpu_s()).filter(|_| is_alone) {
        cell("cpu_s", format!("{:.6}", after - before));
    }
    cells.retain(|_, text| !text.is_empty());
    Some(Ended { row: Row { number, cells }, run, verdict, why, scenario })
}

/// Figures alone: rows of a trajectory go nowhere.
struct Nowhere;

impl Rows for Nowhere {
    fn take(&mut self, _: Sample) -> Result<(), RunError> {
        Ok(())
    }
}

impl LargeRows for Nowhere {
    fn row(&mut self, _: &Network<'_>, _: u64) -> Result<(), RunError> {
        Ok(())
    }
}

fn judge(scenario: &AnyScenario, interrupt: &Interrupt, threads: usize) -> Result<Summary, RunError> {
    match scenario {
        AnyScenario::Wired(scenario) => {
            let outcome: Outcome = simulate_into(scenario, &options(interrupt), &mut Nowhere)?;
            Ok(outcome.judge(scenario, Fidelity::Loopback))
        }
        AnyScenario::Large(scenario) => {
            let large = LargeOptions { nodes: Vec::new(), threads: Some(threads) };
            // Of the end alone.
            simulate_large(scenario, &large, Some(scenario.time.ticks), interrupt, &mut Nowhere)
        }
    }
}

fn options(interrupt: &Interrupt) -> RunOptions {
    RunOptions {
        on: Fidelity::Loopback,
        out: None,
        every_ticks: None,
        json: None,
        junit: None,
        image: std::path::PathBuf::new(),
        bench: None,
        bus_logs: BusLogs::default(),
        mcap: false,
        verbosity: Verbosity::Quiet,
        interrupt: interrupt.clone(),
        repeat: String::new(),
    }
}

fn first_failure(summary: &Summary) -> String {
    let failures = failures(summary);
    let first = failures.first().map_or("", |failure| failure.trim_start_matches("failed: "));
    let more = failures.len().saturating_sub(1);
    let more = if more > 0 { format!(" (and {more} more)") } else { String::new() };
    format!("{}{more}", printable(first))
}

fn verdict_of(error: &RunError) -> Verdict {
    match error.exit {
        Exit::Defect => Verdict::Defect,
        Exit::ExpectationFailed => Verdict::Failed,
        _ => Verdict::Refused,
    }
}

/// The first line of a message, without where the scenario is: rows are the same in every folder.
fn without_path(error: &RunError, plan: &Plan) -> String {
    let line = error.message.lines().next().unwrap_or_default();
    let path = plan.source.path.display().to_string();
    let line = if path.is_empty() { line.to_owned() } else { line.replace(&*printable(&path), "scenario") };
    printable(&line).into_owned()
}

fn words_of(panic: &(dyn Any + Send)) -> String {
    let text = panic.downcast_ref::<&str>().copied().or(panic.downcast_ref::<String>().map(String::as_str));
    text.unwrap_or("a panic without a message").to_owned()
}

/// Processor time of this thread so far, s; `None` where the system does not say.
#[cfg(target_os = "linux")]
fn thread_cpu_s() -> Option<f64> {
    let time = rustix::time::clock_gettime(rustix::time::ClockId::ThreadCPUTime);
    Some(time.tv_sec as f64 + time.tv_nsec as f64 / 1e9)
}

#[cfg(not(target_os = "linux"))]
fn thread_cpu_s() -> Option<f64> {
    None
}
