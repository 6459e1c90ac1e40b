//! Campaigns: networks, laws, buses and schedules of faults by chance, held against what must be so of every run
//! (`cargo run --release -p system-tests --example campaign -- --runs 20000`).
//!
//! A world is a list of lines of a scenario, so that what is found can be made smaller by leaving lines out, and run by anybody.

mod dice;
mod draw;
pub mod kinds;
mod oracle;
mod smaller;

pub use draw::{World, draw};
pub use oracle::{Broken, Seen, look};
pub use smaller::{smaller, smaller_by};
