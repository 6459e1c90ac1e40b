//! Sim-host: runs a Funnelnet scenario.
//!
//! One scenario file, several fidelities: the continuous-time reference, the simulated network, the emulated
//! nodes.

pub mod check;
pub mod cli;
pub mod exit;
pub mod figure;
pub mod run;
pub mod scenario;
