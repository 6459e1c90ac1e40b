//! `inputs`: values over time from a CSV file, which expressions may name. In simulation and reference only:
//! no node knows them.

use super::diagnostic::Problem;
use super::graph_file::{self, FileGraph};
use super::reader::{Log, Section};
use super::tree::{Item, Table, Value};
use funnelnet_law::program::MAX_INPUTS;
use funnelnet_node::params;
use std::cell::RefCell;
use std::collections::BTreeMap;
use std::fmt::Write as _;
use std::path::{Path, PathBuf};
use std::rc::Rc;
use std::sync::Arc;

/// Time (s) and value.
type Point = (f64, f64);

/// One input: piecewise linear in time.
#[derive(Clone, Debug, PartialEq)]
pub struct Series {
    /// Its name in expressions.
    pub name: String,
    /// Time (s), increasing, and value.
    points: Vec<(f64, f64)>,
}

impl Series {
    /// The piecewise linear function through these points, at least one, by increasing time (s).
    #[must_use]
    pub fn new(name: &str, points: Vec<(f64, f64)>) -> Self {
        Self { name: name.to_owned(), points }
    }

    /// Its value at time `t` (s); the first and the last one stay before and after.
    #[must_use]
    pub fn at(&self, t: f64) -> f64 {
        match self.around(t) {
            (Some((t0, v0)), Some((t1, v1))) => v0 + (v1 - v0) * ((t - t0) / (t1 - t0)),
            (Some((_, value)), None) | (None, Some((_, value))) => value,
            (None, None) => f64::NAN,
        }
    }

    /// Its slope (1/s) at time `t`, to the right where it bends.
    #[must_use]
    pub fn slope(&self, t: f64) -> f64 {
        match self.around(t) {
            (Some((t0, v0)), Some((t1, v1))) => (v1 - v0) / (t1 - t0),
            _ => 0.0,
        }
    }

    /// First and last time, s.
    fn span(&self) -> (f64, f64) {
        let time = |point: Option<&(f64, f64)>| point.map_or(f64::NAN, |point| point.0);
        (time(self.points.first()), time(self.points.last()))
    }

    /// The points before and after `t`.
    fn around(&self, t: f64) -> (Option<Point>, Option<Point>) {
        let after = self.points.partition_point(|point| point.0 <= t);
        (
            after.checked_sub(1).and_then(|before| self.points.get(before)).copied(),
            self.points.get(after).copied(),
        )
    }
}

/// Column of times where `time` is left out.
const TIME: &str = "t";
/// Column of the values in a file that this program writes.
const VALUE: &str = "value";

/// A column of a file that the scenario names, as a file of its own, so that a run can be repeated without
/// the first one.
#[derive(Clone, Debug, PartialEq)]
pub struct InputFile {
    /// Its name in the folder of the scenario as it was run.
    pub name: String,
    /// Its text.
    pub text: String,
}

/// What is read of a column: points, or what is wrong with it.
type Column = Result<Vec<(f64, f64)>, String>;

/// Columns that were read already, by file, time column and column: nodes share them.
#[derive(Default)]
pub(super) struct Files {
    folder: PathBuf,
    columns: RefCell<BTreeMap<[String; 3], Column>>,
    graph: RefCell<Option<Rc<FileGraph>>>,
}

impl Files {
    /// Files named relative to where the scenario is.
    pub fn beside(scenario: &Path) -> Self {
        Self { folder: scenario.parent().unwrap_or(Path::new("")).to_owned(), ..Self::default() }
    }

    fn column(&self, key: &[String; 3]) -> Column {
        let mut columns = self.columns.borrow_mut();
        let read = || read_column(&self.folder.join(&key[0]), &key[1], &key[2]);
        columns.entry(key.clone()).or_insert_with(read).clone()
    }

    /// The graph in a file, of which there is one.
    pub fn graph(&self, name: &str) -> Result<Rc<FileGraph>, String> {
        let graph = Rc::new(graph_file::read(&self.folder.join(name))?);
        *self.graph.borrow_mut() = Some(Rc::clone(&graph));
        Ok(graph)
    }

    /// Each column that was read, and the graph, as a file of its own.
    pub fn copies(&self) -> Vec<InputFile> {
        let graph = self.graph.borrow();
        let graph =
            graph.iter().map(|graph| InputFile { name: graph_file::COPY.to_owned(), text: graph.copy() });
        self.columns_as_files().into_iter().chain(graph).collect()
    }

    fn columns_as_files(&self) -> Vec<InputFile> {
        let columns = self.columns.borrow();
        let read = columns.values().filter_map(|column| column.as_ref().ok());
        read.enumerate()
            .map(|(index, points)| {
                let mut text = format!("{TIME},{VALUE}\n");
                for (t, value) in points {
                    // The fewest digits that read as the same number. Writing to a string does not fail.
                    let _ = writeln!(text, "{t:?},{value:?}");
                }
                InputFile { name: copy_name(index), text }
            })
            .collect()
    }

    /// Makes the sections of a scenario name those files.
    pub fn name_copies(&self, root: &mut Table) {
        if let (Some(graph), Some(read)) = (root.get_mut("graph"), self.graph.borrow().as_ref()) {
            let place = graph.place.clone();
            if let Value::Table(table) = &mut graph.value {
                let item = |value, key: &str| Item { value, ..Item::empty_table(&place, key) };
                let value = Value::Text(graph_file::COPY.to_owned());
                table.insert("file".to_owned(), item(value, "file"));
                // The copy has edges alone, by which nobody can tell how many nodes there are where it has none.
                if !read.has_edges() && !table.contains_key("nodes") {
                    let value = Value::Integer(read.nodes.into());
                    table.insert("nodes".to_owned(), item(value, "nodes"));
                }
            }
        }
        for (key, item) in root.iter_mut() {
            match &mut item.value {
                Value::Table(inputs) if key == "inputs" => {
                    inputs.values_mut().for_each(|input| self.name_copy(input));
                }
                Value::Table(section) => self.name_copies(section),
                Value::Array(items) => {
                    for item in items {
                        if let Value::Table(section) = &mut item.value {
                            self.name_copies(section);
                        }
                    }
                }
                _ => {}
            }
        }
    }

    fn name_copy(&self, input: &mut Item) {
        let place = input.place.clone();
        let Value::Table(table) = &mut input.value else { return };
        let text = |key: &str| match table.get(key).map(|item| &item.value) {
            Some(Value::Text(text)) => Some(text.clone()),
            _ => None,
        };
        let (Some(file), Some(column)) = (text("file"), text("column")) else { return };
        let wanted = [file, text("time").unwrap_or_else(|| TIME.to_owned()), column];
        let columns = self.columns.borrow();
        let Some(index) = columns.keys().position(|key| *key == wanted) else { return };
        for (key, value) in
            [("file", copy_name(index)), ("time", TIME.to_owned()), ("column", VALUE.to_owned())]
        {
            let item = Item { value: Value::Text(value), ..Item::empty_table(&place, key) };
            table.insert(key.to_owned(), item);
        }
    }
}

fn copy_name(index: usize) -> String {
    format!("scenario-input-{}.csv", index + 1)
}

/// What `inputs` of a node says.
pub(super) fn read(item: &Item, files: &Files, log: &Log) -> Option<Arc<[Series]>> {
    let Value::Table(table) = &item.value else {
        log.report(item.diagnostic(
            Problem::Value,
            "must be a table, as { load = { file = \"load.csv\", column = \"p_kw\" } }",
        ));
        return None;
    };
    if table.len() > MAX_INPUTS {
        log.report(item.diagnostic(Problem::Value, format!("must have at most {MAX_INPUTS} inputs")));
        return None;
    }
    table.iter().map(|(name, item)| read_one(name, item, files, log)).collect()
}

fn read_one(name: &str, item: &Item, files: &Files, log: &Log) -> Option<Series> {
    let mut section = Section::open(item, log)?;
    let [file, time, column] =
        [("file", None), ("time", Some(TIME)), ("column", None)].map(|(key, default)| {
            let text = section.text(key);
            if text.is_none() && default.is_none() && section.known(key).is_none() {
                section.missing(key, "must be a string");
            }
            text.or(default.map(str::to_owned))
        });
    section.finish();
    if !is_name(name) {
        let allowed =
            "an input is named by a letter and letters, digits or _, and not x, t, pi or as a function";
        log.report(item.key_place.diagnostic(Problem::Whole, &item.path, allowed));
        return None;
    }
    match files.column(&[file?, time?, column?]) {
        Ok(points) => Some(Series::new(name, points)),
        Err(why) => {
            log.report(item.diagnostic(Problem::Value, why));
            None
        }
    }
}

/// Whether an expression can name it.
fn is_name(name: &str) -> bool {
    let is_state = name.strip_prefix('x').is_some_and(|rest| rest.chars().all(|c| c.is_ascii_digit()));
    let letters = name.starts_with(|c: char| c.is_alphabetic())
        && name.chars().all(|c| c.is_alphanumeric() || c == '_');
    letters && !is_state && !["t", "pi"].contains(&name) && !super::expression::is_function(name)
}

fn read_column(path: &Path, time: &str, column: &str) -> Column {
    let shown = path.display();
    let text = super::read_text(path).map_err(|error| error.to_string())?;
    let mut reader =
        csv::ReaderBuilder::new().trim(csv::Trim::All).comment(Some(b'#')).from_reader(text.as_bytes());
    let headers = reader.headers().map_err(|error| format!("{shown}: {error}"))?.clone();
    let find = |name: &str| {
        let known = headers.iter().collect::<Vec<_>>().join(", ");
        let place = super::csv_line::column(&headers, name).map_err(|why| format!("{shown} {why}"))?;
        place.ok_or_else(|| format!("{shown} has no column '{name}'; it has {known}"))
    };
    let (time_at, column_at) = (find(time)?, find(column)?);
    let mut points: Vec<(f64, f64)> = Vec::new();
    for record in reader.records() {
        let record =
            record.map_err(|error| format!("{shown}{}", super::csv_line::malformed(&text, &error)))?;
        let line = super::csv_line::line_of(&text, &record);
        let number = |at: usize| {
            let text = record.get(at).unwrap_or("");
            let number = text.parse::<f64>().ok().filter(|number| number.abs() <= params::LARGEST);
            let largest = params::LARGEST;
            number
                .ok_or_else(|| format!("{shown}, line {line}: '{text}' must be a number within {largest:e}"))
        };
        let point = (number(time_at)?, number(column_at)?);
        if points.last().is_some_and(|before| before.0 >= point.0) {
            return Err(format!("{shown}, line {line}: times must increase, and {} does not", point.0));
        }
        points.push(point);
    }
    if points.is_empty() { Err(format!("{shown} has no rows")) } else { Ok(points) }
}

/// An input must be known for the whole run, which ends at `end` (s): a value that is only held looks like
/// one that was measured.
pub(super) fn cover(inputs: &[Series], end: f64) -> Result<(), String> {
    for series in inputs {
        let (first, last) = series.span();
        if first > 0.0 || last < end {
            return Err(format!(
                "input {} is known from {first} s to {last} s, and the run goes from 0 s to {end} s",
                series.name
            ));
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_series_is_piecewise_linear() {
        let series = Series::new("load", vec![(0.0, 1.0), (2.0, 5.0), (3.0, 5.0)]);
        assert_eq!([0.0, 0.5, 2.0, 2.5, 9.0].map(|t| series.at(t)), [1.0, 2.0, 5.0, 5.0, 5.0]);
        assert_eq!([0.0, 1.0, 2.0, 9.0].map(|t| series.slope(t)), [2.0, 2.0, 0.0, 0.0]);
    }

    #[test]
    fn a_column_is_read_or_said_what_is_wrong_with_it() {
        let folder = tempfile::tempdir().unwrap();
        let read = |text: &str, column: &str| {
            let path = folder.path().join("load.csv");
            std::fs::write(&path, text).unwrap();
            read_column(&path, "t", column).map_err(|error| error.replace(&path.display().to_string(), "F"))
        };
        assert_eq!(read("t, p\n0, 1\n1.5, -2e3\n", "p"), Ok(vec![(0.0, 1.0), (1.5, -2e3)]));
        let wrong = |text, column| read(text, column).unwrap_err();
        assert_eq!(wrong("t,p\n0,1\n", "q"), "F has no column 'q'; it has t, p");
        let twice = "F has the column 'p' more than once; rename all but one";
        assert_eq!(wrong("t,p,q,p\n0,1,2,3\n", "p"), twice);
        // Of what nobody reads there may be any number.
        assert_eq!(read("t,p,q,q\n0,1,2,3\n", "p"), Ok(vec![(0.0, 1.0)]));
        assert_eq!(wrong("t,p\n0,1\n0,2\n", "p"), "F, line 3: times must increase, and 0 does not");
        assert_eq!(wrong("t,p\n0,nan\n", "p"), "F, line 2: 'nan' must be a number within 1e9");
        assert_eq!(wrong("t,p\n", "p"), "F has no rows");
        let unequal = "F, line 2: has 3 fields, and the first line has 2";
        assert_eq!(wrong("t,p\n0,1,2\n", "p"), unequal);
        assert!(read_column(Path::new("no/such.csv"), "t", "p").unwrap_err().contains("no/such.csv"));
    }

    #[test]
    fn an_input_covers_the_run() {
        let series = [Series::new("load", vec![(0.0, 1.0), (2.0, 5.0)])];
        assert_eq!(cover(&series, 2.0), Ok(()));
        assert!(cover(&series, 2.5).unwrap_err().contains("from 0 s to 2 s"));
    }
}
