//! Why a run did not come to an end, and how the program ends for it.

use crate::exit::Exit;
use crate::hub::HubError;
use crate::record::RecordError;
use funnel_protocol::service::StageError;
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

    /// A defect of the program.
    pub fn defect(message: impl fmt::Display) -> Self {
        Self { message: message.to_string(), exit: Exit::Defect }
    }

    /// With one more line.
    pub fn and(self, line: impl fmt::Display) -> Self {
        Self { message: format!("{}\n{line}", self.message), ..self }
    }

    /// What nodes have done, in the words of the error.
    pub fn of_nodes(error: HubError) -> Self {
        Self { message: error.to_string(), exit: exit(&error) }
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

impl From<HubError> for RunError {
    fn from(error: HubError) -> Self {
        match error {
            HubError::Interrupted => Self::interrupted(),
            error => Self::of_nodes(error),
        }
    }
}

/// How the program ends for an error of the nodes.
fn exit(error: &HubError) -> Exit {
    match error {
        HubError::WithWords { cause, .. } => exit(cause),
        HubError::Refused { .. } | HubError::NotStaged { reason: StageError::Config(_), .. } => {
            Exit::BadInput
        }
        HubError::OutOfStep { .. } | HubError::Leapt { .. } => Exit::Defect,
        HubError::Interrupted => Exit::Interrupted,
        HubError::NoQemu { .. }
        | HubError::NoImage { .. }
        | HubError::NoAnswer { .. }
        | HubError::Died { .. }
        | HubError::Lost { .. }
        | HubError::Silent { .. }
        | HubError::RanApart { .. }
        | HubError::Port { .. }
        | HubError::Can { .. }
        | HubError::NoCan { .. }
        | HubError::NotStaged { .. }
        | HubError::NotCommitted { .. }
        | HubError::NotErased { .. }
        | HubError::Checksum { .. }
        | HubError::Uid { .. }
        | HubError::WireVersion { .. }
        | HubError::Io { .. } => Exit::NoHardware,
    }
}
