//! Two recorded runs side by side: where they differ first, how far apart they come, and which figures of
//! their summaries differ.

mod overlay;
mod summaries;
mod table;

pub use overlay::overlay_svg;
pub use summaries::Figure;
pub use table::{Apart, First, Table};

use crate::printable::printable;
use serde::Serialize;
use std::fmt;
use std::path::{Path, PathBuf};

/// Columns and figures that are spelt out; of more, how many.
const SPELT_OUT: usize = 10;

/// Files of a run in its folder.
const TRAJECTORY: &str = "trajectory.csv";
const SUMMARY: &str = "summary.json";

/// One of two recorded runs.
#[derive(Debug)]
pub struct Recorded {
    /// Its trajectory.
    pub table: Table,
    /// Its summary, where there is one.
    summary: Option<serde_json::Value>,
    /// The file that it was read from, and the folder, where it was one.
    files: Vec<PathBuf>,
}

impl Recorded {
    /// Reads what `--out` has left at `path`, or a trajectory alone.
    ///
    /// # Errors
    /// There is none, or it is none, in words.
    pub fn read(path: &Path) -> Result<Self, String> {
        let (table, summary) = match path.is_dir() {
            true => (path.join(TRAJECTORY), Some(path.join(SUMMARY))),
            false => (path.to_owned(), None),
        };
        let summary = summary.filter(|summary| summary.exists());
        let folder = path.is_dir().then(|| path.to_owned());
        let files = std::iter::once(table.clone()).chain(folder).collect();
        let summary = summary.map(|path| json(&path)).transpose()?;
        Ok(Self { table: Table::read(&table)?, summary, files })
    }

    /// The file or folder that it was read from, if `path` is that file, or in that folder, by whatever name.
    #[must_use]
    pub fn is_read_from(&self, path: &Path) -> Option<&Path> {
        let parent =
            path.parent().map(|parent| if parent.as_os_str().is_empty() { Path::new(".") } else { parent });
        let of_path = [Some(path), parent].into_iter().flatten().filter_map(|path| path.canonicalize().ok());
        let of_path: Vec<PathBuf> = of_path.collect();
        let same = |file: &&PathBuf| file.canonicalize().is_ok_and(|file| of_path.contains(&file));
        self.files.iter().find(same).map(PathBuf::as_path)
    }
}

fn json(path: &PathBuf) -> Result<serde_json::Value, String> {
    let name = path.display();
    let text = std::fs::read(path).map_err(|error| format!("{name}: cannot be read: {error}"))?;
    serde_json::from_slice(&text).map_err(|error| format!("{name}: is no summary: {error}"))
}

/// How two recorded runs differ.
#[derive(Clone, Debug, Serialize)]
pub struct Comparison {
    /// Whether nothing differs: neither a value nor a column, a row or a figure.
    pub equal: bool,
    /// Rows that both have.
    pub rows: usize,
    /// Columns that both have.
    pub columns: usize,
    /// Rows of each.
    pub lengths: [usize; 2],
    /// Columns that only one of them has.
    pub only_in: [Vec<String>; 2],
    /// The first value that differs, by row and then by column.
    pub first: Option<First>,
    /// Every column that differs, with how far apart it comes.
    pub apart: Vec<Apart>,
    /// Figures of the summaries that differ, but for times of the machine, commands and versions.
    pub figures: Vec<Figure>,
    /// Whether both have a summary.
    pub summaries: bool,
    /// The one that has a summary, where the other has none: that alone makes them differ.
    pub only_summary: Option<&'static str>,
}

/// Compares two recorded runs: values to the bit, columns by their names.
#[must_use]
pub fn compare(a: &Recorded, b: &Recorded) -> Comparison {
    let columns = a.table.common(&b.table);
    let figures = match (&a.summary, &b.summary) {
        (Some(a), Some(b)) => summaries::differing(a, b),
        _ => Vec::new(),
    };
    let found = table::differences(&a.table, &b.table, &columns);
    let lengths = [a.table.rows(), b.table.rows()];
    let only_in = [a.table.without(&b.table), b.table.without(&a.table)];
    let alike = found.first.is_none() && lengths[0] == lengths[1] && only_in.iter().all(Vec::is_empty);
    Comparison {
        equal: alike && figures.is_empty() && a.summary.is_some() == b.summary.is_some(),
        rows: lengths[0].min(lengths[1]),
        columns: columns.len(),
        lengths,
        only_in,
        first: found.first,
        apart: found.apart,
        figures,
        summaries: a.summary.is_some() && b.summary.is_some(),
        only_summary: match (&a.summary, &b.summary) {
            (Some(_), None) => Some("A"),
            (None, Some(_)) => Some("B"),
            _ => None,
        },
    }
}

impl fmt::Display for Comparison {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        if self.equal {
            let figures = if self.summaries { ", and every figure of the summaries" } else { "" };
            return write!(f, "equal: {} rows of {} columns{figures}", self.rows, self.columns);
        }
        self.trajectories(f)?;
        let more = |f: &mut fmt::Formatter<'_>, all: usize| match all.saturating_sub(SPELT_OUT) {
            0 => Ok(()),
            more => write!(f, "\n            and {more} more"),
        };
        if !self.apart.is_empty() {
            write!(
                f,
                "\napart       {} of {} columns; the largest distance of each:",
                self.apart.len(),
                self.columns
            )?;
            self.apart.iter().take(SPELT_OUT).try_for_each(|apart| write!(f, "\n            {apart}"))?;
            more(f, self.apart.len())?;
        }
        if !self.figures.is_empty() {
            write!(f, "\nsummaries   {} figures differ:", self.figures.len())?;
            self.figures.iter().take(SPELT_OUT).try_for_each(|figure| write!(f, "\n            {figure}"))?;
            more(f, self.figures.len())?;
        }
        match self.only_summary {
            Some(name) => write!(f, "\nsummaries   only {name} has one")?,
            None if !self.summaries => f.write_str("\nsummaries   not compared: neither has one")?,
            None => {}
        }
        Ok(())
    }
}

impl Comparison {
    fn trajectories(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match &self.first {
            Some(first) => write!(f, "first       {first}")?,
            None => write!(f, "first       none in {} rows of {} columns", self.rows, self.columns)?,
        }
        let [a, b] = self.lengths;
        if a != b {
            write!(f, "\nrows        {a} in A, {b} in B")?;
        }
        for (name, columns) in ["A", "B"].iter().zip(&self.only_in) {
            if !columns.is_empty() {
                write!(f, "\ncolumns     only in {name}: {}", printable(&columns.join(", ")))?;
            }
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn recorded(text: &str, summary: Option<serde_json::Value>) -> Recorded {
        Recorded { table: Table::parse(text, "here").unwrap(), summary, files: Vec::new() }
    }

    #[test]
    fn the_first_difference_is_the_earliest_row_and_then_the_leftmost_column() {
        let a = recorded("t,x_1,x_2\n0,1,2\n0.1,1.5,2\n0.2,3,nan\n", None);
        let b = recorded("t,x_1,x_2\n0,1,2\n0.1,1.5,2.25\n0.2,4,nan\n", None);
        let found = compare(&a, &b);
        let first = found.first.clone().unwrap();
        assert_eq!((first.row, first.column.as_str()), (1, "x_2"));
        assert_eq!((first.t, first.a, first.b), (Some(0.1), 2.0, 2.25));
        assert_eq!(found.apart.len(), 2);
        assert!(!found.equal);
        assert!(
            found.to_string().starts_with("first       t = 0.1 s (row 1): x_2 = 2 in A, 2.25 in B"),
            "{found}"
        );
    }

    #[test]
    fn what_is_written_differently_and_is_the_same_number_is_equal() {
        let a = recorded("t,x\n0,1.0\n1,nan\n", None);
        let b = recorded("t,x\n0,1\n1,NaN\n", None);
        assert!(compare(&a, &b).equal);
        // A zero of another sign is another number, and so is one that only one of the two knows.
        let signed = compare(&recorded("t,x\n0,0\n", None), &recorded("t,x\n0,-0\n", None));
        assert!(!signed.equal);
        let known = compare(&recorded("t,x\n0,1\n", None), &recorded("t,x\n0,nan\n", None));
        assert!(!known.equal);
        assert_eq!(known.apart.len(), 1);
        assert!(known.to_string().contains("x: known in one of them only"), "{known}");
    }

    #[test]
    fn rows_and_columns_that_only_one_has_make_them_differ() {
        let a = recorded("t,x\n0,1\n1,2\n", None);
        let shorter = compare(&a, &recorded("t,x\n0,1\n", None));
        assert!(!shorter.equal && shorter.to_string().contains("2 in A, 1 in B"), "{shorter}");
        let wider = compare(&a, &recorded("t,x,y\n0,1,1\n1,2,2\n", None));
        assert!(!wider.equal && wider.to_string().contains("only in B: y"), "{wider}");
        // Columns are compared by name, wherever they stand.
        assert!(compare(&recorded("t,x,y\n0,1,2\n", None), &recorded("t,y,x\n0,2,1\n", None)).equal);
    }

    #[test]
    fn figures_that_depend_on_the_machine_do_not_count() {
        let summary = |ratio: f64, wall: f64| {
            Some(
                serde_json::json!({ "funnel": { "max_ratio": ratio }, "wall_s": wall, "command": format!("run {wall}") }),
            )
        };
        let a = recorded("t,x\n0,1\n", summary(0.5, 1.0));
        assert!(compare(&a, &recorded("t,x\n0,1\n", summary(0.5, 2.0))).equal);
        let other = compare(&a, &recorded("t,x\n0,1\n", summary(0.75, 1.0)));
        assert!(
            !other.equal && other.to_string().contains("funnel.max_ratio: 0.5 in A, 0.75 in B"),
            "{other}"
        );
        assert!(!compare(&a, &recorded("t,x\n0,1\n", None)).equal, "a summary that is missing");
    }
}
