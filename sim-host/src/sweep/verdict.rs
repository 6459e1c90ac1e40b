//! What became of a run, and of all of them together.

use super::table::Row;
use crate::exit::Exit;
use std::fmt;

/// What became of a run.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Verdict {
    /// All expectations and checks hold.
    Passed,
    /// One does not.
    Failed,
    /// The scenario is none, or cannot be run.
    Refused,
    /// The program has a defect.
    Defect,
}

/// All, in the order in which they are told.
const ALL: [Verdict; 4] = [Verdict::Passed, Verdict::Failed, Verdict::Refused, Verdict::Defect];

impl Verdict {
    /// As the column has it.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Passed => "passed",
            Self::Failed => "failed",
            Self::Refused => "refused",
            Self::Defect => "defect",
        }
    }

    /// That of a row.
    #[must_use]
    pub fn of(row: &Row) -> Option<Self> {
        ALL.into_iter().find(|verdict| verdict.name() == row.cell("verdict"))
    }
}

/// How many runs had which verdict.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Tally([u64; 4]);

impl Tally {
    /// Takes one more.
    pub fn add(&mut self, verdict: Verdict) {
        self.0[verdict as usize] += 1;
    }

    /// How many had this one.
    #[must_use]
    pub fn count(&self, verdict: Verdict) -> u64 {
        self.0[verdict as usize]
    }

    /// How many there are.
    #[must_use]
    pub fn total(&self) -> u64 {
        self.0.iter().sum()
    }

    /// How the program ends for them. `may_refuse`: a run that is refused is none that went wrong.
    #[must_use]
    pub fn exit(&self, may_refuse: bool) -> Exit {
        let is_there = |verdict| self.count(verdict) > 0;
        if is_there(Verdict::Defect) {
            Exit::Defect
        } else if is_there(Verdict::Refused) && !may_refuse {
            Exit::BadInput
        } else if is_there(Verdict::Failed) {
            Exit::ExpectationFailed
        } else {
            Exit::Success
        }
    }
}

impl fmt::Display for Tally {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let there = ALL.into_iter().filter(|verdict| *verdict <= Verdict::Failed || self.count(*verdict) > 0);
        let told: Vec<_> =
            there.map(|verdict| format!("{} {}", self.count(verdict), verdict.name())).collect();
        f.write_str(&told.join(", "))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_worst_verdict_decides() {
        let tally = |verdicts: &[Verdict]| {
            let mut tally = Tally::default();
            verdicts.iter().for_each(|verdict| tally.add(*verdict));
            tally
        };
        use Verdict::{Defect, Failed, Passed, Refused};
        assert_eq!(tally(&[Passed]).exit(false), Exit::Success);
        assert_eq!(tally(&[Passed, Failed]).exit(false), Exit::ExpectationFailed);
        assert_eq!(tally(&[Failed, Refused]).exit(false), Exit::BadInput);
        assert_eq!(tally(&[Failed, Refused]).exit(true), Exit::ExpectationFailed);
        assert_eq!(tally(&[Passed, Refused]).exit(true), Exit::Success);
        assert_eq!(tally(&[Refused, Defect]).exit(true), Exit::Defect);
        assert_eq!(tally(&[Passed, Failed, Refused]).to_string(), "1 passed, 1 failed, 1 refused");
    }
}
