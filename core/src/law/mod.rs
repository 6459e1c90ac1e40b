//! Coupling laws.

pub mod node_wise;
