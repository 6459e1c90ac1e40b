//! Where there is no SocketCAN, whose library reads logs.

use super::Entry;
use crate::run::RunError;
use std::path::Path;

/// A log that cannot be read.
pub enum LogReader {}

impl LogReader {
    /// Fails.
    ///
    /// # Errors
    /// Always.
    pub fn open(_: &Path) -> Result<Self, RunError> {
        Err(RunError::bad_input("logs are read by the library of SocketCAN, which only Linux has"))
    }

    /// There is none.
    ///
    /// # Errors
    /// None.
    pub fn next(&mut self) -> Result<Option<Entry>, RunError> {
        match *self {}
    }

    /// There is none.
    pub fn cut(&self) -> Option<usize> {
        match *self {}
    }
}
