//! What tests run with.

use super::{Fidelity, RunOptions, Verbosity};
use crate::interrupt::Interrupt;
use crate::record::BusLogs;

/// A run that writes nothing and says nothing.
pub(crate) fn options(on: Fidelity) -> RunOptions {
    RunOptions {
        on,
        out: None,
        every_ticks: None,
        json: None,
        junit: None,
        image: std::path::PathBuf::new(),
        bench: None,
        bus_logs: BusLogs::default(),
        mcap: false,
        verbosity: Verbosity::Quiet,
        interrupt: Interrupt::default(),
        repeat: String::new(),
    }
}
