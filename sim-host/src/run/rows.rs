//! Where the rows of a run go, one by one: memory does not grow with its length.

use super::error::RunError;
use crate::record::{OnBus, Row};

/// Takes rows in the order of time.
pub trait Rows {
    /// Takes the next row.
    ///
    /// # Errors
    /// It cannot be written: the run is over then.
    fn take(&mut self, row: Row) -> Result<(), RunError>;

    /// Takes what was on the buses since the last call.
    ///
    /// # Errors
    /// It cannot be written: the run is over then.
    fn hear(&mut self, _heard: &[OnBus]) -> Result<(), RunError> {
        Ok(())
    }
}

/// Keeps them all, for who looks at them afterwards.
impl Rows for Vec<Row> {
    fn take(&mut self, row: Row) -> Result<(), RunError> {
        self.push(row);
        Ok(())
    }
}

/// Takes rows for nothing.
pub(super) struct Nobody;

impl Rows for Nobody {
    fn take(&mut self, _: Row) -> Result<(), RunError> {
        Ok(())
    }
}

/// Gives each row to two.
pub(super) struct Both<'a>(pub &'a mut dyn Rows, pub &'a mut dyn Rows);

impl Rows for Both<'_> {
    fn take(&mut self, row: Row) -> Result<(), RunError> {
        self.0.take(row.clone())?;
        self.1.take(row)
    }

    fn hear(&mut self, heard: &[OnBus]) -> Result<(), RunError> {
        self.0.hear(heard)?;
        self.1.hear(heard)
    }
}
