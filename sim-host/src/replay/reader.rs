//! Reads a log as `candump -L` writes it, line by line (Linux).

use super::Entry;
use crate::can::record;
use crate::printable::printable;
use crate::run::RunError;
use socketcan::CanAnyFrame;
use socketcan::dump::{CanDumpRecord, ParseError, Reader};
use std::cell::Cell;
use std::fs::File;
use std::io::{self, BufReader, Read};
use std::path::{Path, PathBuf};
use std::rc::Rc;

/// A log that is being read.
pub struct LogReader {
    path: PathBuf,
    reader: Reader<BufReader<Watched>>,
    /// The last byte that was read.
    last: Rc<Cell<u8>>,
    /// A line that is read, and not given yet: nobody knows whether it is whole.
    held: Option<Result<CanDumpRecord, ParseError>>,
    /// Number of the line that was given last.
    line: usize,
    cut: Option<usize>,
}

impl LogReader {
    /// Opens a log.
    ///
    /// # Errors
    /// It cannot be read.
    pub fn open(path: &Path) -> Result<Self, RunError> {
        let file = File::open(path).map_err(|error| unreadable(path, &error))?;
        let last = Rc::new(Cell::new(b'\n'));
        let mut reader = Reader::from_reader(Watched { file, last: Rc::clone(&last) });
        let held = reader.next();
        Ok(Self { path: path.to_owned(), reader, last, held, line: 0, cut: None })
    }

    /// The next frame or error; none at the end.
    ///
    /// # Errors
    /// It cannot be read, or a line is none that `candump -L` writes.
    pub fn next(&mut self) -> Result<Option<Entry>, RunError> {
        let Some(held) = self.held.take() else { return Ok(None) };
        self.held = self.reader.next();
        self.line += 1;
        // A line without an end was still being written.
        if self.held.is_none() && self.last.get() != b'\n' {
            self.cut = Some(self.line);
            return Ok(None);
        }
        match held {
            Ok(read) => Ok(Some(self.entry(read))),
            Err(ParseError::Io(error)) => Err(unreadable(&self.path, &error)),
            Err(error) => Err(RunError::bad_input(format!(
                "{}:{}: not a line of candump -L: {error}",
                shown(&self.path),
                self.line
            ))),
        }
    }

    /// Number of the last line, where that has no end: the log was cut off in it.
    pub fn cut(&self) -> Option<usize> {
        self.cut
    }

    fn entry(&self, read: CanDumpRecord) -> Entry {
        let fd = match &read.frame {
            CanAnyFrame::Fd(frame) => Some(frame.flags().bits()),
            _ => None,
        };
        let record = record(&read.frame, fd).at(read.t_us.saturating_mul(1000));
        Entry { line: self.line, interface: read.device, record }
    }
}

fn unreadable(path: &Path, error: &io::Error) -> RunError {
    RunError::bad_input(format!("{}: {error}", shown(path)))
}

fn shown(path: &Path) -> String {
    printable(&path.display().to_string()).into_owned()
}

/// A file that remembers the last byte that was read of it.
struct Watched {
    file: File,
    last: Rc<Cell<u8>>,
}

impl Read for Watched {
    fn read(&mut self, buffer: &mut [u8]) -> io::Result<usize> {
        let count = self.file.read(buffer)?;
        if let Some(&last) = buffer.get(..count).and_then(<[u8]>::last) {
            self.last.set(last);
        }
        Ok(count)
    }
}
