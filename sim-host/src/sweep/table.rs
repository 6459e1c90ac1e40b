//! The table of runs: rows appended as runs end, and in order at the end. Whatever happens to the process, what is there can be read.

use super::columns::Columns;
use crate::printable::printable;
use crate::record::{AtomicFile, RecordError};
use crate::run::RunError;
use std::collections::BTreeMap;
use std::fs::{self, File, OpenOptions};
use std::io::{self, Write};
use std::path::{Path, PathBuf};

/// One run as a row.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Row {
    /// Its number, from 1.
    pub number: u64,
    /// By column; none where there is no value.
    pub cells: BTreeMap<String, String>,
}

impl Row {
    /// A cell; empty where there is no value.
    #[must_use]
    pub fn cell(&self, name: &str) -> &str {
        self.cells.get(name).map_or("", String::as_str)
    }
}

/// A table in a file.
#[derive(Debug)]
pub struct Table {
    path: PathBuf,
    columns: Columns,
    /// The file, and how much of it is whole rows; `None` where there are no rows yet.
    open: Option<(File, u64)>,
    /// Number of the last row; `None` where they are not in order.
    last: Option<u64>,
}

impl Table {
    /// The table at `path`, with the rows that it has. The rest of a row whose end is missing goes.
    ///
    /// # Errors
    /// It cannot be read, or is no table of this sweep.
    pub fn open(path: &Path, parameters: &[String]) -> Result<(Self, Vec<Row>), RunError> {
        let mut columns = Columns::new(parameters);
        let (rows, whole) = read(path, &mut columns)?;
        let mut table = Self { path: path.to_owned(), columns, open: None, last: Some(0) };
        if whole > 0 {
            let file = table.append_to(Some(whole)).map_err(|reason| table.failed(reason))?;
            table.open = Some((file, whole));
        }
        rows.iter().for_each(|row| table.count(row));
        Ok((table, rows))
    }

    /// The names of the columns.
    #[must_use]
    pub fn columns(&self) -> Vec<String> {
        self.columns.names()
    }

    /// Adds rows, and brings them to the disk.
    ///
    /// # Errors
    /// [`RecordError`], for example on a full disk; the rows before are whole.
    pub fn append(&mut self, rows: &[Row]) -> Result<(), RecordError> {
        let grew = self.columns.add(rows.iter().flat_map(|row| row.cells.keys()));
        if grew || self.open.is_none() {
            let mut all = read(&self.path, &mut self.columns).map_err(|error| self.unreadable(&error))?.0;
            all.extend(rows.iter().cloned());
            self.replace(&all)?;
        } else {
            self.append_text(&text(&self.columns.names(), rows, false))?;
        }
        rows.iter().for_each(|row| self.count(row));
        Ok(())
    }

    /// Puts the rows in order.
    ///
    /// # Errors
    /// [`RecordError`]; the rows stay as they are.
    pub fn finish(&mut self) -> Result<(), RecordError> {
        if self.last.is_some() {
            return Ok(());
        }
        let mut rows = read(&self.path, &mut self.columns).map_err(|error| self.unreadable(&error))?.0;
        rows.sort_by_key(|row| row.number);
        self.replace(&rows)
    }

    fn count(&mut self, row: &Row) {
        self.last = self.last.filter(|last| *last < row.number).map(|_| row.number);
    }

    fn replace(&mut self, rows: &[Row]) -> Result<(), RecordError> {
        let text = text(&self.columns.names(), rows, true);
        let mut file = AtomicFile::create(&self.path)?;
        file.write(|out| out.write_all(&text))?;
        file.commit()?;
        let file = self.append_to(None).map_err(|reason| self.failed(reason))?;
        self.open = Some((file, text.len() as u64));
        Ok(())
    }

    fn append_text(&mut self, text: &[u8]) -> Result<(), RecordError> {
        let Some((file, whole)) = &mut self.open else { return Ok(()) };
        match file.write_all(text).and_then(|()| file.sync_data()) {
            Ok(()) => {
                *whole += text.len() as u64;
                Ok(())
            }
            Err(reason) => {
                // What was begun goes; where that fails, too, it goes when it is read.
                let _ = file.set_len(*whole);
                Err(RecordError { path: self.path.clone(), reason })
            }
        }
    }

    fn append_to(&self, whole: Option<u64>) -> io::Result<File> {
        let file = OpenOptions::new().append(true).open(&self.path)?;
        whole.map_or(Ok(()), |whole| file.set_len(whole))?;
        Ok(file)
    }

    fn failed(&self, reason: io::Error) -> RecordError {
        RecordError { path: self.path.clone(), reason }
    }

    fn unreadable(&self, error: &RunError) -> RecordError {
        self.failed(io::Error::other(error.message.clone()))
    }
}

/// The text of a table.
///
/// # Errors
/// [`RecordError`], naming the file.
pub fn write(path: &Path, columns: &Columns, rows: &[Row]) -> Result<(), RecordError> {
    let text = text(&columns.names(), rows, true);
    let mut file = AtomicFile::create(path)?;
    file.write(|out| out.write_all(&text))?;
    file.commit()
}

fn text(names: &[String], rows: &[Row], has_header: bool) -> Vec<u8> {
    let mut writer = csv::Writer::from_writer(Vec::new());
    // Writing to memory does not fail, and rows are as long as the header.
    if has_header {
        let _ = writer.write_record(names);
    }
    for row in rows {
        let _ = writer.write_record(names.iter().map(|name| row.cell(name)));
    }
    writer.into_inner().unwrap_or_default()
}

/// The rows at `path`, and how many bytes they and the header are; none where there is no file. `columns` makes room for theirs.
///
/// # Errors
/// It cannot be read, or is no table of these columns.
pub fn read(path: &Path, columns: &mut Columns) -> Result<(Vec<Row>, u64), RunError> {
    let wrong = |why: String| {
        let path = printable(&path.display().to_string()).into_owned();
        RunError::bad_input(format!("{path} {why}"))
    };
    match fs::metadata(path) {
        Err(error) if error.kind() == io::ErrorKind::NotFound => return Ok((Vec::new(), 0)),
        Ok(metadata) if !metadata.is_file() => return Err(wrong("is no file".to_owned())),
        _ => {}
    }
    let bytes = fs::read(path).map_err(|error| wrong(format!("cannot be read: {error}")))?;
    // A row without its end was being written when the process ended.
    let whole = bytes.iter().rposition(|byte| *byte == b'\n').map_or(0, |at| at + 1);
    let whole_bytes = bytes.get(..whole).unwrap_or_default();
    if whole == 0 {
        return Ok((Vec::new(), 0));
    }
    let mut reader = csv::Reader::from_reader(whole_bytes);
    let malformed = |error: csv::Error| wrong(format!("is no table of a sweep: {error}"));
    let header: Vec<String> = reader.headers().map_err(malformed)?.iter().map(str::to_owned).collect();
    if !columns.takes(&header) {
        return Err(wrong("is no table of this sweep: it has other columns".to_owned()));
    }
    let mut rows = Vec::new();
    for record in reader.records() {
        let record = record.map_err(malformed)?;
        let cells = header.iter().zip(record.iter()).filter(|(_, text)| !text.is_empty());
        let cells: BTreeMap<_, _> = cells.map(|(name, text)| (name.clone(), text.to_owned())).collect();
        let number = cells.get("run").and_then(|number| number.parse().ok());
        let line = record.position().map_or(0, csv::Position::line);
        let number = number
            .ok_or_else(|| wrong(format!("is no table of a sweep: line {line} has no number of a run")))?;
        rows.push(Row { number, cells });
    }
    Ok((rows, whole as u64))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn row(number: u64, more: &[(&str, &str)]) -> Row {
        let number_cell = [("run".to_owned(), number.to_string())];
        let cells = more.iter().map(|(name, text)| ((*name).to_owned(), (*text).to_owned()));
        Row { number, cells: number_cell.into_iter().chain(cells).collect() }
    }

    #[test]
    fn rows_are_appended_and_put_in_order_and_new_figures_get_a_column() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("runs.csv");
        let (mut table, rows) = Table::open(&path, &["a".to_owned()]).unwrap();
        assert!(rows.is_empty() && !path.exists());
        table.append(&[row(2, &[("a", "x,\"y\""), ("ticks", "7"), ("verdict", "passed")])]).unwrap();
        table.append(&[row(1, &[("ticks", "8")])]).unwrap();
        table.append(&[row(3, &[("nodes", "4")])]).unwrap();
        let expected = "run,a,repetition,seed,nodes,ticks,verdict,why,wall_s,cpu_s\n\
            2,\"x,\"\"y\"\"\",,,,7,passed,,,\n1,,,,,8,,,,\n3,,,,4,,,,,\n";
        assert_eq!(fs::read_to_string(&path).unwrap(), expected);
        table.finish().unwrap();
        let (_, rows) = Table::open(&path, &["a".to_owned()]).unwrap();
        assert_eq!(rows.iter().map(|row| row.number).collect::<Vec<_>>(), [1, 2, 3]);
        assert_eq!(rows[1].cell("a"), "x,\"y\"");
    }

    #[test]
    fn a_row_without_its_end_goes_wherever_it_was_cut() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("runs.csv");
        let (mut table, _) = Table::open(&path, &[]).unwrap();
        table.append(&[row(1, &[("why", "a, b")]), row(2, &[("why", "\"c\"")])]).unwrap();
        let whole = fs::read(&path).unwrap();
        let ends: Vec<_> =
            whole.iter().enumerate().filter(|(_, byte)| **byte == b'\n').map(|(at, _)| at + 1).collect();
        for cut in 0..=whole.len() {
            fs::write(&path, &whole[..cut]).unwrap();
            let rows = Table::open(&path, &[]).unwrap().1;
            let expected = ends.iter().filter(|end| **end <= cut).count().saturating_sub(1);
            assert_eq!(rows.len(), expected, "{cut}");
            // And what comes next stands in a line of its own.
            let (mut table, _) = Table::open(&path, &[]).unwrap();
            table.append(&[row(9, &[("why", "d")])]).unwrap();
            assert_eq!(Table::open(&path, &[]).unwrap().1.len(), expected + 1, "{cut}");
        }
    }

    #[test]
    fn what_is_no_table_of_the_sweep_is_refused() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("runs.csv");
        let refused = |text: &str| {
            fs::write(&path, text).unwrap();
            Table::open(&path, &[]).unwrap_err().message
        };
        assert!(refused("run,b,repetition,seed,verdict,why,wall_s,cpu_s\n").contains("other columns"));
        assert!(
            refused("run,repetition,seed,verdict,why,wall_s,cpu_s\n1,2\n").contains("is no table of a sweep")
        );
        assert!(
            refused("run,repetition,seed,verdict,why,wall_s,cpu_s\nx,,,,,,\n")
                .contains("line 2 has no number")
        );
        fs::remove_file(&path).unwrap();
        fs::create_dir(&path).unwrap();
        assert!(Table::open(&path, &[]).unwrap_err().message.ends_with("is no file"));
    }
}
