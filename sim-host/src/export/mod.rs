//! What other tools read of a scenario: its frames as DBC.

mod dbc;

pub use dbc::{NoFrames, dbc};
