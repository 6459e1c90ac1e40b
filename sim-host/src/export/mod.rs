//! What other tools read of a scenario: its frames as DBC, its graph as GraphML.

mod dbc;
mod graphml;

pub use dbc::{NoFrames, dbc};
pub use graphml::graphml;
