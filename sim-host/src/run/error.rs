//! Why a run did not come to an end, and how the program ends for it.

use crate::emulator::EmulatorError;
use crate::exit::Exit;
use crate::record::RecordError;
use std::fmt;

/// Why a run did not come to an end.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct RunError {
    /// What happened, and what would mend it.
    pub message: String,
    /// How the program ends for it.
    pub exit: Exit,
}

impl RunError {
    /// The scenario asks for what cannot be run.
    pub fn bad_input(message: impl fmt::Display) -> Self {
        Self { message: message.to_string(), exit: Exit::BadInput }
    }

    /// The user stopped the run.
    pub fn interrupted() -> Self {
        Self { message: "interrupted; no output was written".to_owned(), exit: Exit::Interrupted }
    }
}

impl fmt::Display for RunError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&self.message)
    }
}

impl std::error::Error for RunError {}

impl From<RecordError> for RunError {
    fn from(error: RecordError) -> Self {
        Self::bad_input(error)
    }
}

impl From<EmulatorError> for RunError {
    fn from(error: EmulatorError) -> Self {
        match error {
            EmulatorError::Interrupted => Self::interrupted(),
            error => Self { message: error.to_string(), exit: exit(&error) },
        }
    }
}

/// How the program ends for an error of the emulators.
fn exit(error: &EmulatorError) -> Exit {
    match error {
        EmulatorError::WithWords { cause, .. } => exit(cause),
        EmulatorError::Refused { .. } => Exit::BadInput,
        EmulatorError::OutOfStep { .. } => Exit::Defect,
        EmulatorError::Interrupted => Exit::Interrupted,
        EmulatorError::NoQemu { .. }
        | EmulatorError::NoImage { .. }
        | EmulatorError::NoAnswer { .. }
        | EmulatorError::Died { .. }
        | EmulatorError::WireVersion { .. }
        | EmulatorError::Io { .. } => Exit::NoHardware,
    }
}
