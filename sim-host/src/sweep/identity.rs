//! `sweep.json`: what all runs of a sweep have in common, by which it knows itself again.

use super::draw::Method;
use super::list::List;
use super::plan::Plan;
use super::values::Axis;
use crate::printable::printable;
use crate::record::{RecordError, place_new};
use crate::run::{RunError, SWEEP_FILE};
use serde::{Deserialize, Serialize};
use serde_json::Value;
use std::fs;
use std::io;
use std::path::Path;

/// A sweep.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Identity {
    /// Version of this file.
    pub format: u32,
    /// The title of the scenario.
    pub scenario: String,
    /// FNV-1a (64 bit) of the scenario at the first point, with its inputs, 16 hexadecimal digits.
    pub scenario_hash: String,
    /// The keys that are swept, in the order of the columns.
    pub parameters: Vec<String>,
    /// The axes of the grid, the last one the fastest.
    pub grid: Vec<AxisText>,
    /// The list of points.
    pub list: Option<Listed>,
    /// The ranges that points are drawn from.
    pub ranges: Vec<RangeText>,
    /// How they are drawn.
    pub draw: Option<Draw>,
    /// Number of points.
    pub points: u64,
    /// Seed of the first repetition.
    pub seed: u64,
    /// Repetitions of each point.
    pub seeds: u64,
    /// Whether the seed depends on the point.
    pub independent: bool,
    /// Number of runs: points times repetitions.
    pub runs: u64,
    /// In how many parts; 0 where it is in one, without `--shard`.
    pub shards: u64,
    /// Version of this program.
    pub version: String,
    /// The command that began it.
    pub command: String,
}

/// A key and its values, as written.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct AxisText {
    /// The full key.
    pub key: String,
    /// Its values.
    pub values: Vec<String>,
}

/// A list of points.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Listed {
    /// Number of rows.
    pub rows: u64,
    /// FNV-1a (64 bit) of their values, 16 hexadecimal digits.
    pub hash: String,
}

/// A key and its range, as written.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct RangeText {
    /// The full key.
    pub key: String,
    /// Its range.
    pub range: String,
}

/// A drawing.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Draw {
    /// How.
    pub method: Method,
    /// How many points.
    pub points: u64,
    /// From which seed.
    pub seed: u64,
}

impl Listed {
    /// Of a list that was read.
    #[must_use]
    pub fn of(list: &List) -> Self {
        let values = list.rows.iter().flat_map(|(_, row)| row);
        Self { rows: list.rows.len() as u64, hash: hash(values.map(String::as_str)) }
    }
}

impl Identity {
    /// Of a sweep that is asked for, in so many shards.
    #[must_use]
    pub fn of(plan: &Plan, shards: u64, command: String) -> Self {
        let axis = |axis: &Axis| AxisText { key: axis.key.clone(), values: axis.values.clone() };
        let (draw, ranges) = plan.design.drawing();
        let (scenario, scenario_hash) = match plan.first_readable() {
            Some(first) => {
                let files = first.input_files().iter().map(|file| file.text.as_str());
                let scenario_hash = hash([first.as_run()].into_iter().chain(files));
                (first.title().to_owned(), scenario_hash)
            }
            None => (String::new(), hash([plan.source.text.as_str()])),
        };
        Self {
            format: 1,
            scenario,
            scenario_hash,
            parameters: plan.design.keys(),
            grid: plan.design.grid().iter().map(axis).collect(),
            list: plan.design.listed(),
            ranges,
            draw,
            points: plan.design.points(),
            seed: plan.seed,
            seeds: plan.seeds,
            independent: plan.is_independent,
            runs: plan.runs(),
            shards,
            version: env!("CARGO_PKG_VERSION").to_owned(),
            command,
        }
    }

    /// Reads that of a folder; `None` where there is none.
    ///
    /// # Errors
    /// It cannot be read, or is no such file.
    pub fn read(folder: &Path) -> Result<Option<Self>, RunError> {
        let path = folder.join(SWEEP_FILE);
        let shown = || printable(&path.display().to_string()).into_owned();
        let text = match fs::read_to_string(&path) {
            Ok(text) => text,
            Err(error) if error.kind() == io::ErrorKind::NotFound => return Ok(None),
            Err(error) => return Err(RunError::bad_input(format!("{} cannot be read: {error}", shown()))),
        };
        let parsed = serde_json::from_str(&text);
        parsed.map(Some).map_err(|error| RunError::bad_input(format!("{} is of no sweep: {error}", shown())))
    }

    /// Writes it where there is none, and refuses another one. Processes that do so at once agree on one.
    ///
    /// # Errors
    /// There is another sweep in the folder, or the file cannot be written.
    pub fn settle(&self, folder: &Path) -> Result<(), RunError> {
        if let Some(other) = Self::read(folder)? {
            return self.agrees(&other, folder);
        }
        let path = folder.join(SWEEP_FILE);
        let text = serde_json::to_string_pretty(self).map_err(RunError::defect)? + "\n";
        match place_new(&path, text.as_bytes()) {
            Err(RecordError { reason, .. }) if reason.kind() == io::ErrorKind::AlreadyExists => {
                Self::read(folder)?.map_or(Ok(()), |other| self.agrees(&other, folder))
            }
            placed => Ok(placed?),
        }
    }

    /// Whether the sweep in the folder is this one.
    ///
    /// # Errors
    /// It is another one: in what.
    pub fn agrees(&self, there: &Self, folder: &Path) -> Result<(), RunError> {
        let differences = self.differences(there);
        if differences.is_empty() {
            return Ok(());
        }
        Err(RunError::bad_input(format!(
            "--out {}: has another sweep, by its {}; name another folder",
            printable(&folder.display().to_string()),
            differences.join(", ")
        )))
    }

    /// What tells it from the one that is there, in words.
    fn differences(&self, there: &Self) -> Vec<String> {
        let entries = |identity: &Self| match serde_json::to_value(identity) {
            Ok(Value::Object(entries)) => entries,
            _ => serde_json::Map::new(),
        };
        let (here, there) = (entries(self), entries(there));
        let differs = |(key, value): &(&String, &Value)| *key != "command" && there.get(*key) != Some(*value);
        let told = |(key, value): (&String, &Value)| match (value, there.get(key)) {
            (Value::Number(_) | Value::Bool(_), Some(there)) => {
                format!("{key} ({there} there, {value} here)")
            }
            _ => key.clone(),
        };
        here.iter().filter(differs).map(told).collect()
    }
}

/// FNV-1a (64 bit) over texts, each with its end.
pub fn hash<'t>(texts: impl IntoIterator<Item = &'t str>) -> String {
    format!("{:016x}", hash_of(texts))
}

/// The same as a number.
pub fn hash_of<'t>(texts: impl IntoIterator<Item = &'t str>) -> u64 {
    let bytes = texts.into_iter().flat_map(|text| text.bytes().chain([0xff]));
    bytes.fold(0xcbf2_9ce4_8422_2325, |hash, byte| {
        (hash ^ u64::from(byte)).wrapping_mul(0x0000_0100_0000_01b3)
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn texts_do_not_run_into_each_other() {
        assert_ne!(hash(["ab", "c"]), hash(["a", "bc"]));
        assert_eq!(hash(["ab"]), hash(["ab"]));
    }
}
