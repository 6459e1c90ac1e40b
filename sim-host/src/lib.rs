//! Sim-host: runs a Funnelnet scenario.
