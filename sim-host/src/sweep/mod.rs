//! `sim-host sweep`: a scenario over many values and seeds, on all cores, a row for each run.

mod columns;
mod design;
mod draw;
mod failed;
mod figures;
mod identity;
mod list;
mod merge;
mod one;
#[cfg(feature = "parquet")]
mod parquet_table;
mod plan;
mod progress;
mod range;
mod shard;
mod table;
mod values;
mod verdict;
mod work;

pub use design::{Design, Setting};
pub use draw::Method;
pub use identity::{AxisText, Draw, Identity, Listed, RangeText};
pub use list::List;
pub use merge::{Recorded, TABLE};
pub use plan::{Plan, Run};
pub use range::Range;
pub use shard::Shard;
pub use table::Row;
pub use values::Axis;
pub use verdict::{Tally, Verdict};

use crate::exit::Exit;
use crate::interrupt::Interrupt;
use crate::printable::printable;
use crate::record::{RecordError, remove_abandoned, remove_earlier, write_atomic};
use crate::run::{
    Access, Folder, Lock, LockError, RunError, SCENARIO_FILE, SWEEP_FILE, is_ours, overwritten,
};
use std::collections::BTreeSet;
use std::fmt::Debug;
use std::path::{Path, PathBuf};
use table::Table;

/// What the user asks of a sweep, beside what is to be run.
#[derive(Clone, Debug)]
pub struct Request {
    /// Folder for the table; made where it is missing.
    pub out: PathBuf,
    /// Files that are read, and must not be written, as the user named them.
    pub inputs: Vec<PathBuf>,
    /// The part of this process.
    pub shard: Option<Shard>,
    /// Goes on with what is there.
    pub resumes: bool,
    /// Threads.
    pub jobs: usize,
    /// Writes `runs.parquet`, too, once every run is there; see [`HAS_PARQUET`].
    pub parquet: bool,
    /// A run that is refused is a row, and not the end of the sweep.
    pub may_refuse: bool,
    /// Says nothing but errors.
    pub is_quiet: bool,
    /// Set when the user wants to stop.
    pub interrupt: Interrupt,
    /// The command that was typed.
    pub command: String,
    /// How commands are told.
    pub quoting: Quoting,
}

/// Whether this build can write Parquet.
pub const HAS_PARQUET: bool = cfg!(feature = "parquet");
/// Its name.
const PARQUET: &str = "runs.parquet";

/// How a command is written for a shell.
#[derive(Clone)]
pub struct Quoting {
    /// This program as it was called.
    pub program: String,
    /// Words as a command.
    pub quote: fn(&[String]) -> String,
}

impl Debug for Quoting {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Quoting").field("program", &self.program).finish_non_exhaustive()
    }
}

/// What came of a sweep, or of a shard of it.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Done {
    /// The verdicts of its table.
    pub tally: Tally,
    /// How many runs it has.
    pub runs: u64,
    /// The table.
    pub table: PathBuf,
    /// Whether the tables of all shards were merged.
    pub is_merged: bool,
    /// Whether no run was asked for anything.
    pub expects_nothing: bool,
    /// How the program ends.
    pub exit: Exit,
}

/// Does the runs of `plan` that are not in the folder yet.
///
/// # Errors
/// Why nothing was run, or which file cannot be written.
pub fn execute(plan: &Plan, request: &Request) -> Result<Done, RunError> {
    plan.check().map_err(RunError::bad_input)?;
    let path = request.out.join(request.shard.map_or_else(|| TABLE.to_owned(), Shard::file));
    if let Some(clash) =
        overwritten(&request.out, &[SWEEP_FILE, &name_of(&path), TABLE, PARQUET], &request.inputs)
    {
        return Err(RunError::bad_input(clash));
    }
    let folder = Folder::share(&request.out)?;
    let _lock = lock(request)?;
    let identity = Identity::of(plan, request.shard.map_or(0, |shard| shard.of), request.command.clone());
    let is_new = match Identity::read(&request.out)? {
        Some(there) => identity.agrees(&there, &request.out).map(|()| false)?,
        None => true,
    };
    refuse_earlier(&path, request, is_new)?;
    let (mut table, rows) = Table::open(&path, &identity.parameters)?;
    let mine = |number: u64| request.shard.is_none_or(|shard| shard.has(number));
    let (tally, done) = counted(&rows, plan, &path, mine)?;
    let runs: Vec<u64> = (1..=plan.runs()).filter(|number| mine(*number) && !done.contains(number)).collect();
    let load = work::read_all(plan, &runs, request)?;
    begin(plan, &identity, &folder, request, is_new)?;
    if !runs.is_empty() {
        // Of the same runs or of others: it says less than the table will.
        remove_earlier(&request.out.join(PARQUET))?;
    }
    let tally = if request.interrupt.is_set() {
        tally
    } else {
        work::run_all(plan, &runs, &mut table, (load, tally), request)?
    };
    table.finish()?;
    let wanted = done.len() + runs.len();
    let is_whole = tally.total() == wanted as u64;
    let is_merged = is_whole && request.shard.is_some() && merge(&request.out)?;
    if request.parquet && is_whole && (is_merged || request.shard.is_none()) {
        write_parquet(&request.out)?;
    }
    let verdicts = tally.exit(request.may_refuse);
    Ok(Done {
        tally,
        runs: wanted as u64,
        table: path,
        is_merged,
        expects_nothing: is_whole && !table.columns().iter().any(|name| name.starts_with("expect.")),
        exit: if is_whole { verdicts } else { verdicts.worst(request.interrupt.exit()) },
    })
}

/// Merges the shards where all of them are whole.
fn merge(folder: &Path) -> Result<bool, RunError> {
    match Recorded::read(folder)? {
        Some(recorded) if recorded.is_complete() => recorded.merge(folder).map(|()| true),
        _ => Ok(false),
    }
}

#[cfg(feature = "parquet")]
fn write_parquet(folder: &Path) -> Result<(), RunError> {
    match Recorded::read(folder)? {
        Some(recorded) => Ok(parquet_table::write(folder, &recorded)?),
        None => Ok(()),
    }
}

#[cfg(not(feature = "parquet"))]
fn write_parquet(_: &Path) -> Result<(), RunError> {
    Err(RunError::bad_input("this build writes no Parquet"))
}

fn name_of(path: &Path) -> String {
    path.file_name().unwrap_or_default().to_string_lossy().into_owned()
}

/// Keeps a second process out of the same table.
fn lock(request: &Request) -> Result<Lock, RunError> {
    let part = request.shard.map_or(String::new(), |shard| format!("-{}-of-{}", shard.index, shard.of));
    let path = request.out.join(format!(".sim-host-sweep{part}.lock"));
    Lock::take(&path, Access::Alone).map_err(|error| match error {
        LockError::Failed(reason) => RecordError { path, reason }.into(),
        LockError::Taken(holder) => {
            let holder = holder.map_or(String::new(), |process| format!(" (process {process})"));
            let what =
                request.shard.map_or("this sweep".to_owned(), |shard| format!("shard {shard} of this sweep"));
            let out = printable(&request.out.display().to_string()).into_owned();
            RunError::bad_input(format!(
                "--out {out}: another process{holder} is running {what}; wait for it"
            ))
        }
    })
}

/// A table that is there stays, unless it is gone on with.
fn refuse_earlier(path: &Path, request: &Request, is_new: bool) -> Result<(), RunError> {
    let shown = printable(&path.display().to_string()).into_owned();
    match (path.symlink_metadata().is_ok(), is_new) {
        (true, true) => Err(RunError::bad_input(format!(
            "{shown} is there, without the {SWEEP_FILE} of its sweep; move it, or name another folder"
        ))),
        (true, false) if !request.resumes => Err(RunError::bad_input(format!(
            "{shown} has rows of this sweep; --resume goes on with them, or remove it to run them again"
        ))),
        _ => Ok(()),
    }
}

/// The verdicts and numbers of the rows that are there.
fn counted(
    rows: &[Row],
    plan: &Plan,
    path: &Path,
    mine: impl Fn(u64) -> bool,
) -> Result<(Tally, BTreeSet<u64>), RunError> {
    let (mut tally, mut done) = (Tally::default(), BTreeSet::new());
    for row in rows {
        let is_known = (1..=plan.runs()).contains(&row.number) && mine(row.number);
        match Verdict::of(row).filter(|_| is_known && done.insert(row.number)) {
            Some(verdict) => tally.add(verdict),
            None => {
                let (path, number) = (path.display().to_string(), row.number);
                let path = printable(&path);
                return Err(RunError::bad_input(format!(
                    "{path} is no table of this sweep: run {number} is twice in it, or none of its runs"
                )));
            }
        }
    }
    Ok((tally, done))
}

/// Makes the folder that of this sweep: from here on it is no other's.
fn begin(
    plan: &Plan,
    identity: &Identity,
    folder: &Folder,
    request: &Request,
    is_new: bool,
) -> Result<(), RunError> {
    let out = &request.out;
    let is_table = |name: &str| {
        name == SWEEP_FILE
            || (name.starts_with("runs") && (name.ends_with(".csv") || name.ends_with(".parquet")))
    };
    remove_abandoned(out, |name| is_ours(name) || is_table(name));
    if is_new {
        folder.clear()?;
        failed::clear(out);
    }
    identity.settle(out)?;
    if out.join(SCENARIO_FILE).exists() {
        return Ok(());
    }
    let Some(base) = plan.base() else { return Ok(()) };
    for input in base.input_files() {
        write_atomic(out.join(&input.name), input.text.as_bytes())?;
    }
    Ok(write_atomic(out.join(SCENARIO_FILE), base.as_run().as_bytes())?)
}
