//! The runs of a process on its cores.

use super::failed;
use super::one::{self, Ended};
use super::plan::Plan;
use super::progress::{Load, Progress};
use super::table::{Row, Table};
use super::verdict::{Tally, Verdict};
use super::{Quoting, Request};
use crate::interrupt::Interrupt;
use crate::run::RunError;
use crate::scenario::AnyScenario;
use std::collections::BTreeMap;
use std::path::Path;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::mpsc::{RecvTimeoutError, channel};
use std::sync::{Mutex, PoisonError};
use std::thread;
use std::time::Duration;

/// Messages about runs that are refused before any is run.
const MOST_TOLD: usize = 10;

/// How much work a run is, in node-steps.
fn work_of(scenario: &AnyScenario) -> u64 {
    scenario.node_steps().max(1)
}

/// How many runs go on at once, and on how many threads each: a network without a bus is large, and is run by itself on all of them. No
/// figure depends on that.
fn shared_out(plan: &Plan, jobs: usize) -> (usize, usize) {
    match plan.base() {
        Some(AnyScenario::Large(_)) => (1, jobs),
        _ => (jobs, 1),
    }
}

/// Reads the scenario of every run, and gives how much work they are. Stops where the user wants to.
///
/// # Errors
/// The reader refuses one, and none may be refused.
pub fn read_all(plan: &Plan, runs: &[u64], request: &Request) -> Result<Load, RunError> {
    let (next, refused, work) = (AtomicUsize::new(0), Mutex::new(BTreeMap::new()), Mutex::new(0_u64));
    let read = || {
        let mut sum = 0_u64;
        while let Some(&number) = runs.get(next.fetch_add(1, Ordering::Relaxed)) {
            if request.interrupt.is_set() {
                break;
            }
            match plan.scenario(&plan.run(number)) {
                Ok(scenario) => sum = sum.saturating_add(work_of(&scenario)),
                Err(errors) => {
                    let mut refused = refused.lock().unwrap_or_else(PoisonError::into_inner);
                    refused.insert(number, errors.to_string());
                }
            }
        }
        let mut work = work.lock().unwrap_or_else(PoisonError::into_inner);
        *work = work.saturating_add(sum);
    };
    let (readers, _) = shared_out(plan, request.jobs);
    thread::scope(|scope| (0..readers).for_each(|_| drop(scope.spawn(read))));
    let refused = refused.into_inner().unwrap_or_else(PoisonError::into_inner);
    if !refused.is_empty() && !request.may_refuse {
        return Err(told(&refused, runs.len()));
    }
    let work = work.into_inner().unwrap_or_else(PoisonError::into_inner);
    Ok(Load { runs: runs.len() as u64, work })
}

/// Each message once: repetitions of a point have the same one.
fn told(refused: &BTreeMap<u64, String>, runs: usize) -> RunError {
    let mut messages: Vec<&str> = Vec::new();
    for message in refused.values() {
        if !messages.contains(&message.as_str()) {
            messages.push(message);
        }
        if messages.len() > MOST_TOLD {
            break;
        }
    }
    let more = if messages.len() > MOST_TOLD { "\nand more" } else { "" };
    let shown = messages.iter().take(MOST_TOLD).copied().collect::<Vec<_>>().join("\n");
    let count = refused.len();
    let hint = if count < runs { "; --allow-refused runs the others" } else { "" };
    RunError::bad_input(format!("{shown}{more}\nnothing was run: {count} of {runs} runs are refused{hint}"))
}

/// Does the runs, and puts each into the table as it ends.
///
/// # Errors
/// A file cannot be written. What the user stops is no error.
pub fn run_all(
    plan: &Plan,
    runs: &[u64],
    table: &mut Table,
    (load, tally): (Load, Tally),
    request: &Request,
) -> Result<Tally, RunError> {
    let mut progress = Progress::new(load, tally, request.is_quiet);
    let next = AtomicUsize::new(0);
    let (runs_at_once, threads) = shared_out(plan, request.jobs);
    // Set by the user, or here where nothing can be written any more.
    let stop = &request.interrupt;
    let (sender, receiver) = channel::<Ended>();
    let written = thread::scope(|scope| {
        for _ in 0..runs_at_once {
            let (sender, next) = (sender.clone(), &next);
            scope.spawn(move || work(plan, runs, next, (stop, threads), &sender));
        }
        drop(sender);
        loop {
            progress.show();
            let first = match receiver.recv_timeout(Duration::from_millis(500)) {
                Ok(first) => first,
                Err(RecvTimeoutError::Timeout) => continue,
                Err(RecvTimeoutError::Disconnected) => return Ok(()),
            };
            let ended: Vec<_> = [first].into_iter().chain(receiver.try_iter()).collect();
            let kept = keep(plan, ended, table, &mut progress, request);
            if kept.is_err() {
                stop.set();
                return kept;
            }
        }
    });
    written.map(|()| progress.tally())
}

fn work(
    plan: &Plan,
    runs: &[u64],
    next: &AtomicUsize,
    (stop, threads): (&Interrupt, usize),
    sender: &std::sync::mpsc::Sender<Ended>,
) {
    while !stop.is_set() {
        let Some(&number) = runs.get(next.fetch_add(1, Ordering::Relaxed)) else { return };
        let Some(ended) = one::run(plan, number, stop, threads) else { return };
        // Nobody listens where nothing can be written any more.
        if sender.send(ended).is_err() {
            return;
        }
    }
}

/// Rows of runs that have ended, at once; of those that do not pass the scenario first.
fn keep(
    plan: &Plan,
    ended: Vec<Ended>,
    table: &mut Table,
    progress: &mut Progress,
    request: &Request,
) -> Result<(), RunError> {
    for ended in ended.iter().filter(|ended| ended.verdict != Verdict::Passed) {
        let scenario = failed::leave(&request.out, ended)?;
        progress.tell(&failure(plan, ended, scenario.as_deref(), request));
    }
    let rows: Vec<Row> = ended.iter().map(|ended| ended.row.clone()).collect();
    table.append(&rows)?;
    for ended in &ended {
        progress.done(ended.scenario.as_ref().map_or(0, work_of), ended.verdict);
    }
    Ok(())
}

/// What there is to say of a run that does not pass.
fn failure(plan: &Plan, ended: &Ended, scenario: Option<&Path>, request: &Request) -> String {
    let Quoting { program, quote } = &request.quoting;
    let path = failed::scenario_path(&request.out, ended.run.number);
    let command = quote(&plan.command(program, &ended.run, &path));
    let (number, verdict, why) = (ended.run.number, ended.verdict.name(), &ended.why);
    let left = scenario.map_or(String::new(), |path| format!("; its scenario: {}", path.display()));
    format!("run {number} {verdict}: {why}\n  repeat with: {command}{left}")
}
