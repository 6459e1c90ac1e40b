//! The same as `loopback_ticks` on classic CAN with 1 Mbit/s and a tick of 12.5 ms, in which it carries a
//! frame of each node.
//!
//! Usage: `can_ticks [TICKS]`. An example of its own, since what is inlined into one of them changes with the
//! other (`./ci.sh cost`).
#![allow(clippy::expect_used)]

mod ticks;

use funnelnet_can_bus::{BitRate, Quiet, Timing};
use funnelnet_protocol::message::NodeId;
use funnelnet_sim::bus::can::CanBus;

fn main() {
    let ids: Vec<NodeId> = (1..=ticks::NODES as u8).filter_map(NodeId::new).collect();
    let timing = Timing::classic(BitRate::new(1_000_000, 875).expect("a bit rate"));
    ticks::run(12_500_000, CanBus::new(timing, Quiet, &ids, &ticks::listeners()));
}
