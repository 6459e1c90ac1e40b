//! What a simulation came to.

use crate::judge::{Check, Findings, Stop};
use std::fmt;

/// Verdict on a simulation, by the judge of the command: by the true states of all nodes and the scenario's
/// funnels, not by what nodes believe.
#[derive(Clone, Debug)]
#[non_exhaustive]
pub struct Verdict {
    /// Figures that the judge found.
    pub findings: Findings,
    /// Checks that every run has to pass: all ticks, no stop but those that the scenario allows, every node
    /// heard, no funnel floored, every figure a number.
    pub checks: Vec<Check>,
    /// Nodes that stopped by themselves, in the order in which they did.
    pub stops: Vec<Stop>,
}

impl Verdict {
    /// Whether the guarantee held: all checks passed, and every diffusive term was known and inside its
    /// funnel, except at ticks at which the scenario's events allow more.
    #[must_use]
    pub fn holds(&self) -> bool {
        self.reasons().is_empty()
    }

    /// Reasons why it did not hold, as sentences; none if it did.
    #[must_use]
    pub fn reasons(&self) -> Vec<String> {
        let Findings { breaches, max_ratio, unknown, .. } = &self.findings;
        let failed = self.checks.iter().filter(|check| !check.pass).map(|check| check.text.clone());
        let outside = (*breaches > 0).then(|| {
            format!("{breaches} node-ticks outside their funnels, the largest ratio is {max_ratio}")
        });
        let unknown = (*unknown > 0).then(|| format!("{unknown} node-ticks are not known"));
        failed.chain(outside).chain(unknown).collect()
    }
}

impl fmt::Display for Verdict {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self.reasons().as_slice() {
            [] => write!(f, "inside the funnels, the largest ratio is {}", self.findings.max_ratio),
            reasons => f.write_str(&reasons.join("; ")),
        }
    }
}
