//! Sim-host: runs a Funnelnet scenario.

pub mod reference;
