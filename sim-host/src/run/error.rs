//! Why a run did not come to an end, and how the program ends for it.

use crate::exit::Exit;
use crate::hub::HubError;
use crate::loopback::Refused;
use crate::record::RecordError;
use funnelnet_protocol::service::StageError;
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

    /// What nodes have done once the run had begun, and before anything of it was recorded.
    pub fn in_the_run(error: HubError) -> Self {
        let exit = match exit(&error) {
            Exit::NoHardware => Exit::ExpectationFailed,
            exit => exit,
        };
        Self { exit, ..Self::from(error) }
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

impl From<Refused> for RunError {
    fn from(refused: Refused) -> Self {
        Self::bad_input(refused)
    }
}

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
        HubError::OnePort { .. } | HubError::Ambiguous { .. } => Exit::BadInput,
        // What nodes did once the run had begun.
        HubError::OutOfStep { .. }
        | HubError::Leapt { .. }
        | HubError::Lost { .. }
        | HubError::Silent { .. }
        | HubError::Babbles { .. }
        | HubError::RanApart { .. }
        | HubError::NotTaken { .. }
        | HubError::OldProgram { .. }
        | HubError::StaysOnTrial { .. }
        | HubError::StoppedOnTrial { .. }
        | HubError::NotConfirmed { .. } => Exit::ExpectationFailed,
        HubError::Interrupted => Exit::Interrupted,
        HubError::NoQemu { .. }
        | HubError::NoImage { .. }
        | HubError::NoAnswer { .. }
        | HubError::Died { .. }
        | HubError::Port { .. }
        | HubError::Can { .. }
        | HubError::NoCan { .. }
        | HubError::NotStaged { .. }
        | HubError::NotCommitted { .. }
        | HubError::NotErased { .. }
        | HubError::CannotUpdate { .. }
        | HubError::Checksum { .. }
        | HubError::Uid { .. }
        | HubError::WireVersion { .. }
        | HubError::Io { .. } => Exit::NoHardware,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::time::Duration;

    #[test]
    fn what_a_line_did_is_no_defect_of_the_program() {
        let of = |error| RunError::of_nodes(error).exit;
        let waited = Duration::from_secs(1);
        assert_eq!(of(HubError::OutOfStep { node: 2, tick: 5, found: 4 }), Exit::ExpectationFailed);
        assert_eq!(of(HubError::Leapt { node: 2, from: 5, to: 4 }), Exit::ExpectationFailed);
        let babbles = HubError::Babbles { node: 2, tick: 5, awaited: "state", waited };
        assert_eq!(of(babbles.with_words("its log".to_owned())), Exit::ExpectationFailed);
        let twins =
            HubError::Ambiguous { node: 2, number: "0001".into(), ports: vec!["a".into(), "b".into()] };
        assert_eq!(of(twins), Exit::BadInput);
        assert_eq!(of(HubError::OnePort { node: 2, other: 1, port: "a".into() }), Exit::BadInput);
    }

    #[test]
    fn nobody_at_the_start_is_missing_hardware_and_nobody_later_is_a_failure() {
        let gone = || HubError::NoAnswer { node: 2, awaited: "identity", waited: Duration::from_secs(1) };
        assert_eq!(RunError::from(gone()).exit, Exit::NoHardware);
        assert_eq!(RunError::in_the_run(gone()).exit, Exit::ExpectationFailed);
        assert_eq!(RunError::in_the_run(HubError::Interrupted).exit, Exit::Interrupted);
    }
}
