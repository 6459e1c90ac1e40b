//! What a node does when its diffusive term leaves the funnel (law.md 5).

use core::fmt;

/// Policy of a node whose diffusive term leaves its funnel (law.md 5).
///
/// Append-only: it travels (funnelnet-protocol), so that nothing is renumbered.
/// Exhaustive on purpose: node and scenario match it, and a new variant shall not compile until both know it.
///
/// ```
/// use funnelnet_law::Breach;
/// let policy = Breach::Reopen { margin: 1.5, rate: 2.0 };
/// assert_eq!(policy.to_string(), "{ kind = \"reopen\", margin = 1.5, rate = 2 }");
/// ```
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub enum Breach<F> {
    /// Goes on with the same law.
    Ride,
    /// Widens its own funnel until the ratio is `1 / margin`, and lets that decay.
    Reopen {
        /// Above 1.
        margin: F,
        /// Decay rate of the added width, 1/s, above zero.
        rate: F,
    },
    /// Stops with a safe output and a fault.
    Stop,
}

impl<F> Breach<F> {
    /// Name of the policy, as in a scenario.
    #[must_use]
    pub fn kind(&self) -> &'static str {
        match self {
            Self::Ride => "ride",
            Self::Reopen { .. } => "reopen",
            Self::Stop => "stop",
        }
    }

    /// The same policy with numbers of another type, each changed by `convert`.
    #[must_use]
    pub fn map<G>(self, convert: impl Fn(F) -> G) -> Breach<G> {
        match self {
            Self::Ride => Breach::Ride,
            Self::Reopen { margin, rate } => Breach::Reopen { margin: convert(margin), rate: convert(rate) },
            Self::Stop => Breach::Stop,
        }
    }
}

/// Writes it as in a scenario: `"ride"`, or `{ kind = "reopen", margin = 1.5, rate = 1 }`.
impl<F: fmt::Display> fmt::Display for Breach<F> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Reopen { margin, rate } => {
                write!(f, "{{ kind = \"reopen\", margin = {margin}, rate = {rate} }}")
            }
            other => write!(f, "\"{}\"", other.kind()),
        }
    }
}
