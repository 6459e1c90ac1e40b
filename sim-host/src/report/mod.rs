//! A report to hand over: one HTML page out of what a run, two runs or a sweep have left, which loads nothing.
//!
//! The same folder gives the same bytes. All that comes from a file is escaped by the template, or rebuilt from what plots are made of
//! (`picture.rs`); the page's own policy keeps a reader from running or loading anything else.

mod bus;
mod comparison;
mod digest;
mod events;
mod figures;
mod folder;
mod nodes;
mod page;
mod picture;
mod pictures;
mod provenance;
mod quantiles;
mod run;
mod sweep;
mod verdict;

use crate::run::names;
use comparison::Pair;
use folder::{Folder, Kind};
use run::Run;
use std::path::Path;
use sweep::Table;

/// What a report is called in the folder that it is of.
pub const FILE: &str = names::REPORT;

/// A report.
#[derive(Clone, Debug)]
pub struct Report {
    /// The page.
    pub html: String,
    /// What it says, in a few words.
    pub told: String,
}

impl Report {
    /// Of what is in a folder, or of two runs side by side. Shards of a sweep are merged first.
    ///
    /// # Errors
    /// There is neither a run nor a sweep, or it cannot be read, in words.
    pub fn of(folder: &Path, other: Option<&Path>) -> Result<Self, String> {
        let first = Folder::open(folder)?;
        let Some(other) = other else {
            return match first.kind {
                Kind::Run => Self::of_run(&Run::read(first)?),
                Kind::Sweep => Self::of_sweep(&first),
            };
        };
        let runs = [first, Folder::open(other)?];
        if let Some(sweep) = runs.iter().find(|folder| folder.kind == Kind::Sweep) {
            return Err(format!("{}: is a sweep; two runs are compared", sweep.place("")));
        }
        let [a, b] = runs;
        let pair = Pair::read([Run::read(a)?, Run::read(b)?])?;
        Ok(Self { html: pair.page()?.html(), told: pair.told().to_owned() })
    }

    fn of_sweep(folder: &Folder) -> Result<Self, String> {
        let table = Table::read(folder)?;
        // A part of a sweep is no sweep: the shards that are missing could not be told from it later.
        if table.merged && table.missing.is_empty() {
            let path = folder.path.join(folder::RUNS);
            crate::record::write_atomic(path, &table.csv()).map_err(|error| error.to_string())?;
        }
        Ok(Self { html: sweep::page(folder, &table)?.html(), told: sweep::told(&table) })
    }

    fn of_run(run: &Run) -> Result<Self, String> {
        Ok(Self { html: run.page()?.html(), told: run.verdict().word().to_lowercase() })
    }
}

/// Whether a file may be replaced by a report: it is one, or there is none.
#[must_use]
pub fn is_replaceable(path: &Path) -> bool {
    use std::io::Read;
    let Ok(file) = std::fs::File::open(path) else { return !path.exists() };
    let mut begin = Vec::new();
    let read = file.take(page::FIRST_LINE.len() as u64).read_to_end(&mut begin);
    read.is_ok() && (begin == page::FIRST_LINE.as_bytes() || begin.is_empty())
}
