//! Vector states: how many components there are, and the numbers and arrays that fill them.
//!
//! The longest array of the file says how many; a number stands for all components.

use funnelnet_protocol::config::MAX_COMPONENTS;

use super::diagnostic::{Diagnostic, Problem};
use super::reader::{Range, number};
use super::tree::{Item, Value};

/// The number of components, and the array that says so.
#[derive(Clone, Debug)]
pub(super) struct Components {
    pub count: usize,
    /// The key of the array; empty where there is none.
    said_by: String,
}

impl Components {
    /// What the longest array in `tables` says: `[agent]` and every `[[node]]`.
    pub fn of<'a>(tables: impl Iterator<Item = &'a Item>) -> Self {
        let mut found = Self { count: 1, said_by: String::new() };
        for table in tables {
            found.look_at(table.get("state"));
            let Some(dynamics) = table.get("dynamics") else { continue };
            found.look_at(dynamics.get("f"));
            found.look_at(dynamics.get("slope"));
            found.look_at(dynamics.get("offset"));
            let sines = match dynamics.get("sines") {
                Some(Item { value: Value::Array(sines), .. }) => sines.as_slice(),
                _ => &[],
            };
            for sine in sines {
                found.look_at(sine.get("amplitude"));
                found.look_at(sine.get("phase"));
            }
        }
        found
    }

    /// One longer than a state may be is a mistake of its own, which no other array is blamed for.
    fn look_at(&mut self, item: Option<&Item>) {
        let Some(Item { value: Value::Array(items), path, .. }) = item else { return };
        if items.len() > self.count && items.len() <= MAX_COMPONENTS {
            (self.count, self.said_by) = (items.len(), path.clone());
        }
    }

    /// One number per component: a number for all of them, or an array.
    ///
    /// # Errors
    /// What was found, and what is allowed.
    pub fn numbers(&self, item: &Item, range: Range) -> Result<Vec<f64>, Box<Diagnostic>> {
        match &item.value {
            Value::Array(items) if items.len() == self.count => {
                items.iter().map(|item| number(item, range)).collect()
            }
            Value::Array(items) => Err(self.other_length(item, items.len(), "numbers")),
            Value::Integer(_) | Value::Float(_) => Ok(vec![number(item, range)?; self.count]),
            _ => Err(range.mismatch(item, " or an array of such numbers")),
        }
    }

    /// One text per component: a string of a scalar state, or an array.
    ///
    /// # Errors
    /// What was found, and what is allowed.
    pub fn texts<'i>(&self, item: &'i Item) -> Result<Vec<(&'i Item, &'i str)>, Box<Diagnostic>> {
        let text = |item: &'i Item| {
            let wrong =
                || item.diagnostic(Problem::Value, "must be an expression in quotes, as \"-x + sin(t)\"");
            item.text().map(|text| (item, text)).ok_or_else(wrong)
        };
        match &item.value {
            Value::Array(items) if items.len() == self.count => items.iter().map(text).collect(),
            Value::Array(items) => Err(self.other_length(item, items.len(), "expressions")),
            _ if self.count == 1 => Ok(vec![text(item)?]),
            _ => {
                let allowed = format!(
                    "must be an array of {} expressions, one per component, since {} has as many",
                    self.count, self.said_by
                );
                Err(item.diagnostic(Problem::Value, allowed))
            }
        }
    }

    /// A number, or a square matrix as an array of rows; row by row.
    ///
    /// # Errors
    /// What was found, and what is allowed.
    pub fn matrix(&self, item: &Item, range: Range) -> Result<Vec<f64>, Box<Diagnostic>> {
        let rows = match &item.value {
            Value::Array(rows) if rows.len() == self.count => rows,
            Value::Array(rows) => return Err(self.other_length(item, rows.len(), "rows")),
            Value::Integer(_) | Value::Float(_) => return Ok(vec![number(item, range)?]),
            _ => return Err(range.mismatch(item, " or a matrix of such numbers, an array of rows")),
        };
        let mut entries = Vec::new();
        for row in rows {
            let Value::Array(_) = row.value else {
                return Err(
                    row.diagnostic(Problem::Value, "must be a row of the matrix, an array of numbers")
                );
            };
            entries.extend(self.numbers(row, range)?);
        }
        Ok(entries)
    }

    fn other_length(&self, item: &Item, found: usize, what: &str) -> Box<Diagnostic> {
        if found == 0 || found > MAX_COMPONENTS {
            let allowed =
                format!("must have 1 to {MAX_COMPONENTS} {what}, one per component; here are {found}");
            return item.diagnostic(Problem::Value, allowed);
        }
        let allowed = format!(
            "must have {} {what}, one per component, since {} has as many; here are {found}",
            self.count, self.said_by
        );
        item.diagnostic(Problem::Value, allowed)
    }
}
