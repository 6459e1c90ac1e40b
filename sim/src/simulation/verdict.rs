//! What a simulation came to.

use crate::judge::{Findings, Stop};
use std::fmt;

/// What a simulation came to, judged by the true states of all nodes and the scenario's funnels: what nodes believe does not enter.
#[derive(Clone, Debug)]
#[non_exhaustive]
pub struct Verdict {
    /// All that the judge found.
    pub findings: Findings,
    /// Nodes that stopped by themselves, in the order in which they did.
    pub stops: Vec<Stop>,
    /// Ticks that were run, tick 0 among them.
    pub ticks: u64,
    /// Ticks of the scenario, tick 0 among them.
    pub of: u64,
}

impl Verdict {
    /// Whether the guarantee held: all ticks were run, no node stopped by itself, and every diffusive term was known and inside its funnel.
    #[must_use]
    pub fn holds(&self) -> bool {
        self.reasons().is_empty()
    }

    /// Why it did not hold, as sentences; none where it did.
    #[must_use]
    pub fn reasons(&self) -> Vec<String> {
        let findings = &self.findings;
        let mut reasons = Vec::new();
        let mut tell = |is_so: bool, text: String| {
            if is_so {
                reasons.push(text);
            }
        };
        tell(self.ticks < self.of, format!("{} of {} ticks were run", self.ticks, self.of));
        for Stop { id, at_s, why } in &self.stops {
            tell(true, format!("node {id} stopped at {at_s} s: {why}"));
        }
        tell(findings.judged == 0, "no diffusive term was judged".to_owned());
        tell(
            findings.breaches > 0,
            format!("{} node-ticks outside, the largest ratio is {}", findings.breaches, findings.max_ratio),
        );
        tell(findings.unknown > 0, format!("{} node-ticks are not known", findings.unknown));
        tell(findings.uncoupled > 0, format!("{} node-ticks without a neighbour", findings.uncoupled));
        reasons
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
