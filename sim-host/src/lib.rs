//! Sim-host: runs a Funnelnet scenario.

pub mod progress;
pub mod record;
pub mod reference;
pub mod report;
