//! How the program ends.

use std::process::ExitCode;

/// The exit codes, fixed from the first release (`sim-host --help` lists them).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(u8)]
pub enum Exit {
    /// Everything was done, and all expectations hold.
    Success = 0,
    /// The run went through, and an expectation failed.
    ExpectationFailed = 1,
    /// Bad usage or configuration.
    BadInput = 2,
    /// No such hardware or emulator.
    NoHardware = 3,
    /// A defect of the program.
    Defect = 4,
    /// The user stopped the program (128 + SIGINT, as shells have it).
    Interrupted = 130,
}

impl From<Exit> for ExitCode {
    fn from(exit: Exit) -> Self {
        Self::from(exit as u8)
    }
}
