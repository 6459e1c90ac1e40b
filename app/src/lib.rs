//! The async app of a node, the same on every board and on a computer.
//!
//! [`App`] moves frames, time, samples and inputs between a [`Session`](funnelnet_node::Session), which
//! decides, and what a platform has: a [`Link`], a [`Storage`](storage::Storage), a
//! [`Plant`](funnelnet_plant::Plant), a [`Watchdog`](watchdog::Watchdog), a [`Clock`] and a [`Log`]. Links
//! over any UART and any CAN controller are in [`link`]. Nothing here allocates, panics, or knows the time by
//! itself.
#![no_std]
#![forbid(unsafe_code)]

mod app;
mod clock;
pub mod link;
mod log;
pub mod storage;
pub mod watchdog;

pub use app::{App, Platform, SessionOf};
pub use clock::Clock;
pub use link::Link;
pub use log::Log;
