//! What a link decides without hardware: which CAN frame is sent next ([`tx_queue`]), what the controller's
//! error state leads to ([`bus`]), what frames hold in either format ([`format`](mod@format)); these three
//! make a node's CAN port ([`port`]). And what a node with several serial lines passes on ([`forwarder`]).
//! Sans-IO: readings and time in, decisions out; the firmware wraps drivers around it.
#![no_std]
#![forbid(unsafe_code)]

pub mod bus;
pub mod filter;
mod flood_filter;
pub mod format;
pub mod forwarder;
mod line_queue;
pub mod port;
mod sync_filter;
pub mod tx_queue;

pub use bus::{Bus, BusState, Change, Step};
pub use filter::{Filter, Filters};
pub use format::{Classic, Fd, Format, Frame};
pub use forwarder::{Forwarder, HOST_LINE};
pub use port::{CanPort, Heard, Request};
pub use sync_filter::FORGET_MS;
pub use tx_queue::{Put, TxQueue};
