//! Runs 100 nodes of degree 4 for a number of ticks on the ideal bus: the load behind the loopback figures
//! (`./ci.sh cost`).
//!
//! Usage: `loopback_ticks [TICKS]`; prints node-ticks per second and the final state of node 1.

mod ticks;

use funnelnet_sim::bus::ideal::{IdealBus, IdealParams};

fn main() {
    ticks::run(1_000_000, IdealBus::new(IdealParams::default(), 1, ticks::listeners()));
}
