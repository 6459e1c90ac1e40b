//! Time that a network shares: the node's own clock on one side, the time of the network on the other
//! (docs/notes/2026-11-28-clocks.md).
//!
//! A [`Node`](crate::Node) with a timer takes whatever time it is handed. Where that is the time of a
//! [`Keeper`], its ticks are those of the network: the keeper hears and sends SYNC, and bends its map from
//! the node's own clock by what they say. The node knows nothing of it.
//!
//! | part | does |
//! |---|---|
//! | [`map`] | turns time of the own clock into that of the network, and back |
//! | [`servo`] | bends the map by what a time master says of its SYNC |
//! | [`keeper`] | who is master, what it sends, who is followed, and for how long nobody may be |
//!
//! Sans-IO: time comes as an argument, always that of the own clock. All arithmetic is of integers, so that
//! equal stamps give equal bits everywhere.

pub mod keeper;
pub mod map;
pub mod servo;

pub(crate) use keeper::holdover;
pub use keeper::{Change, Keeper, Masters, Output, Role, Rules, largest_jitter, shortest_period};
