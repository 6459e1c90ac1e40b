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
    /// The terminal went away (128 + SIGHUP, as shells have it).
    HungUp = 129,
    /// The user stopped the program (128 + SIGINT; SIGTERM means the same).
    Interrupted = 130,
}

impl Exit {
    /// The worse of two ends: 4, 2, 3, a signal, 1, 0.
    #[must_use]
    pub fn worst(self, other: Self) -> Self {
        if other.badness() > self.badness() { other } else { self }
    }

    fn badness(self) -> u8 {
        match self {
            Self::Success => 0,
            Self::ExpectationFailed => 1,
            Self::HungUp | Self::Interrupted => 2,
            Self::NoHardware => 3,
            Self::BadInput => 4,
            Self::Defect => 5,
        }
    }

    /// What a JUnit file calls a run that ended so.
    #[must_use]
    pub fn kind(self) -> &'static str {
        match self {
            Self::Success => "success",
            Self::ExpectationFailed => "failed",
            Self::BadInput => "refused",
            Self::NoHardware => "no-hardware",
            Self::Defect => "defect",
            Self::HungUp | Self::Interrupted => "interrupted",
        }
    }
}

impl From<Exit> for ExitCode {
    fn from(exit: Exit) -> Self {
        Self::from(exit as u8)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_worst_wins() {
        let order = [
            Exit::Defect,
            Exit::BadInput,
            Exit::NoHardware,
            Exit::Interrupted,
            Exit::ExpectationFailed,
            Exit::Success,
        ];
        for (n, &worse) in order.iter().enumerate() {
            for &better in &order[n..] {
                assert_eq!((worse.worst(better), better.worst(worse)), (worse, worse));
            }
        }
    }
}
