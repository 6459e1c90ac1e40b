//! The tables of all shards as one.

use super::columns::Columns;
use super::identity::Identity;
use super::shard::Shard;
use super::table::{self, Row};
use crate::printable::printable;
use crate::run::RunError;
use std::path::{Path, PathBuf};

/// The table of a whole sweep.
pub const TABLE: &str = "runs.csv";

/// What a folder has of its sweep.
#[derive(Clone, Debug)]
pub struct Recorded {
    /// The sweep.
    pub identity: Identity,
    columns: Columns,
    /// The rows that there are, by number.
    pub rows: Vec<Row>,
    /// Shards that have not all of their rows.
    pub incomplete: Vec<u64>,
}

impl Recorded {
    /// Reads the sweep in a folder, whole or not, in one process or in shards; `None` where there is no sweep.
    ///
    /// # Errors
    /// A file cannot be read, or is of no sweep.
    pub fn read(folder: &Path) -> Result<Option<Self>, RunError> {
        let Some(identity) = Identity::read(folder)? else { return Ok(None) };
        let mut columns = Columns::new(&identity.parameters);
        let (mut rows, mut incomplete) = (Vec::new(), Vec::new());
        for (index, path, share) in tables(folder, &identity) {
            let (of_shard, _) = table::read(&path, &mut columns)?;
            if (of_shard.len() as u64) < share {
                incomplete.push(index);
            }
            rows.extend(of_shard);
        }
        rows.sort_by_key(|row| row.number);
        if let Some([row, _]) = rows.windows(2).find(|rows| matches!(rows, [a, b] if a.number == b.number)) {
            let folder = printable(&folder.display().to_string()).into_owned();
            return Err(RunError::bad_input(format!("{folder} has run {} twice", row.number)));
        }
        Ok(Some(Self { identity, columns, rows, incomplete }))
    }

    /// The names of the columns.
    #[must_use]
    pub fn columns(&self) -> Vec<String> {
        self.columns.names()
    }

    /// Whether every run is there.
    #[must_use]
    pub fn is_complete(&self) -> bool {
        self.rows.len() as u64 == self.identity.runs
    }

    /// Writes `runs.csv` of shards. That of a sweep in one process is there already.
    ///
    /// # Errors
    /// It cannot be written.
    pub fn merge(&self, folder: &Path) -> Result<(), RunError> {
        match self.identity.shards {
            0 => Ok(()),
            _ => Ok(table::write(&folder.join(TABLE), &self.columns, &self.rows)?),
        }
    }
}

/// Number, file and number of runs of each part; 0 is a sweep in one process.
fn tables(folder: &Path, identity: &Identity) -> Vec<(u64, PathBuf, u64)> {
    match identity.shards {
        0 => vec![(0, folder.join(TABLE), identity.runs)],
        of => {
            let shard = |index| Shard { index, of };
            (1..=of)
                .map(|index| (index, folder.join(shard(index).file()), shard(index).share(identity.runs)))
                .collect()
        }
    }
}
