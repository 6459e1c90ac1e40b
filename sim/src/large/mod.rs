//! Networks of up to a million nodes without a bus: the f32 law of the node, on all cores
//! (docs/notes/2026-11-29-large.md).
//!
//! ```
//! use funnelnet_sim::large::Network;
//! use funnelnet_sim::scenario::{AnyScenario, Source};
//! let text = r#"
//!     version = 1
//!     time = { tick = "1ms", duration = "1s" }
//!     graph = { kind = "torus", nodes = 2500, columns = 50 }
//!     coupling = { kind = "node-wise", gain = { kind = "reciprocal" }, funnel = { kind = "constant", width = 20.0 } }
//!     agent.dynamics = { kind = "affine", slope = -1.0 }
//!     agent.random = { state = { uniform = [-2, 2] }, offset = { normal = [0, 1] } }
//!     bus.model = "none"
//! "#;
//! let source = Source { text: text.to_owned(), path: "torus.toml".into() };
//! let Ok(AnyScenario::Large(scenario)) = source.any_scenario(&[]) else { panic!("it is a large one") };
//! let mut network = Network::new(&scenario, 2).unwrap();
//! while network.step().is_some() {}
//! let findings = network.findings();
//! assert!(findings.max_ratio < 1.0 && findings.breaches == 0);
//! ```

mod batch;
mod block;
mod columns;
mod findings;
mod kinds;
mod network;
mod row;
#[cfg(test)]
mod tests;

pub use block::Seen;
pub use findings::{Findings, Halt};
pub use network::{Network, NotHeld};
pub use row::{QUANTILES, Row};

/// What such a run leaves out, for who reads its output.
pub const LEFT_OUT: [&str; 4] = [
    "wire, bytes and everything that happens to frames: nothing is lost, late or disturbed",
    "what nodes do when a neighbour stops: a run ends where a node would stop",
    "the emergent and the blended dynamics, and the continuous-time reference",
    "columns per node, but for those of --nodes",
];
