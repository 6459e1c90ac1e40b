//! Trajectories as they are recorded: a column of numbers for each name.

use crate::number_format::significant;
use crate::printable::printable;
use serde::Serialize;
use std::fmt;
use std::path::Path;

/// The column of times, s.
const TIME: &str = "t";

/// A recorded trajectory.
#[derive(Debug)]
pub struct Table {
    names: Vec<String>,
    /// By column.
    values: Vec<Vec<f64>>,
}

impl Table {
    /// Reads a CSV file.
    ///
    /// # Errors
    /// It cannot be read, or is none, with the line.
    pub fn read(path: &Path) -> Result<Self, String> {
        let name = path.display().to_string();
        let text =
            std::fs::read_to_string(path).map_err(|error| format!("{name}: cannot be read: {error}"))?;
        Self::parse(&text, &name)
    }

    /// Reads the text of a CSV file that messages call `name`.
    ///
    /// # Errors
    /// A line has another number of fields than the first one, or a field is no number.
    pub fn parse(text: &str, name: &str) -> Result<Self, String> {
        let mut lines = text.lines().enumerate();
        let head = lines.next().map_or("", |(_, head)| head);
        let names: Vec<String> = head.split(',').map(str::to_owned).collect();
        if names.iter().all(|name| name.is_empty() || name.parse::<f64>().is_ok()) {
            return Err(format!("{name}:1: is no trajectory: the first line must name the columns"));
        }
        if let Some(twice) =
            names.iter().enumerate().find_map(|(n, name)| names[..n].contains(name).then_some(name))
        {
            return Err(format!("{name}:1: is no trajectory: two columns are called '{twice}'"));
        }
        let mut values = vec![Vec::new(); names.len()];
        for (number, line) in lines {
            let fields: Vec<&str> = line.split(',').collect();
            if fields.len() != names.len() {
                return Err(format!(
                    "{name}:{}: has {} fields, and not {}",
                    number + 1,
                    fields.len(),
                    names.len()
                ));
            }
            for ((column, field), title) in values.iter_mut().zip(fields).zip(&names) {
                let value = if field.is_empty() { Ok(f64::NAN) } else { field.parse() };
                column.push(
                    value.map_err(|_| format!("{name}:{}: {title} = {field}: is no number", number + 1))?,
                );
            }
        }
        let table = Self { names, values };
        if table.rows() == 0 || table.names.iter().all(|name| name == TIME) {
            return Err(format!("{name}: is no trajectory: it has no values to compare"));
        }
        Ok(table)
    }

    /// Number of rows.
    #[must_use]
    pub fn rows(&self) -> usize {
        self.values.first().map_or(0, Vec::len)
    }

    /// Times of the rows, s; empty where there are none.
    #[must_use]
    pub fn times(&self) -> &[f64] {
        self.column(TIME).unwrap_or_default()
    }

    /// The column `name`.
    #[must_use]
    pub fn column(&self, name: &str) -> Option<&[f64]> {
        let index = self.names.iter().position(|known| known == name)?;
        self.values.get(index).map(Vec::as_slice)
    }

    /// The names of its columns, in their order.
    #[must_use]
    pub fn names(&self) -> &[String] {
        &self.names
    }

    /// Names of columns that the other one has as well, in its order.
    pub(super) fn common(&self, other: &Self) -> Vec<String> {
        self.names.iter().filter(|name| other.names.contains(name)).cloned().collect()
    }

    /// Names of columns that the other one does not have.
    pub(super) fn without(&self, other: &Self) -> Vec<String> {
        self.names.iter().filter(|name| !other.names.contains(name)).cloned().collect()
    }
}

/// The first value that differs.
#[derive(Clone, Debug, Serialize)]
pub struct First {
    /// Its row, from 0: the tick of a run that was recorded with every tick.
    pub row: usize,
    /// Its time, s, where there is a column of them.
    pub t: Option<f64>,
    /// Its column.
    pub column: String,
    /// Value in A.
    pub a: f64,
    /// Value in B.
    pub b: f64,
}

impl fmt::Display for First {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { row, t, column, a, b } = self;
        let column = printable(column);
        match t {
            Some(t) => write!(f, "t = {t} s (row {row}): {column} = {a} in A, {b} in B"),
            None => write!(f, "row {row}: {column} = {a} in A, {b} in B"),
        }
    }
}

/// A column that differs.
#[derive(Clone, Debug, Serialize)]
pub struct Apart {
    /// Its name.
    pub column: String,
    /// Rows in which it differs.
    pub rows: usize,
    /// The largest distance, where both are known.
    pub distance: Option<f64>,
    /// When that is, s.
    pub t: Option<f64>,
}

impl fmt::Display for Apart {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let column = printable(&self.column);
        match (self.distance, self.t) {
            (Some(0.0), _) => write!(f, "{column}: zeros of different signs, in {} rows", self.rows),
            (Some(distance), Some(t)) => {
                write!(f, "{column}: {} at t = {t} s, in {} rows", significant(distance, 4), self.rows)
            }
            (Some(distance), None) => {
                write!(f, "{column}: {}, in {} rows", significant(distance, 4), self.rows)
            }
            (None, _) => write!(f, "{column}: known in one of them only, in {} rows", self.rows),
        }
    }
}

/// Differences of two tables.
pub(super) struct Differences {
    pub first: Option<First>,
    pub apart: Vec<Apart>,
}

/// Compares `columns` of both, as many rows as both have.
pub(super) fn differences(a: &Table, b: &Table, columns: &[String]) -> Differences {
    let times = a.times();
    let (mut first, mut apart): (Option<First>, Vec<Apart>) = (None, Vec::new());
    for name in columns {
        let (Some(left), Some(right)) = (a.column(name), b.column(name)) else { continue };
        let mut found = Apart { column: name.clone(), rows: 0, distance: None, t: None };
        for (row, (&a, &b)) in left.iter().zip(right).enumerate() {
            if same(a, b) {
                continue;
            }
            let t = times.get(row).copied();
            found.rows += 1;
            let distance = (a - b).abs();
            if !distance.is_nan() && found.distance.is_none_or(|most| distance > most) {
                (found.distance, found.t) = (Some(distance), t);
            }
            if first.as_ref().is_none_or(|first| row < first.row) {
                first = Some(First { row, t, column: name.clone(), a, b });
            }
        }
        if found.rows > 0 {
            apart.push(found);
        }
    }
    // Farthest first; what only one of them knows before all.
    let rank = |apart: &Apart| apart.distance.unwrap_or(f64::INFINITY);
    apart.sort_by(|a, b| rank(b).total_cmp(&rank(a)));
    Differences { first, apart }
}

/// Whether two numbers are the same to the bit; what is not known is so in both.
fn same(a: f64, b: f64) -> bool {
    a.to_bits() == b.to_bits() || (a.is_nan() && b.is_nan())
}
