//! What a link decides without hardware: which CAN frame is sent next ([`mailbox`]), what the controller's error state
//! leads to ([`bus`]), what frames hold in either format ([`format`](mod@format)); these three make a node's CAN port ([`port`]). And what a
//! node with several serial lines passes on ([`junction`]). Sans-IO: readings and time in, decisions out; the firmware wraps drivers around it.
#![no_std]
#![forbid(unsafe_code)]

pub mod bus;
pub mod filter;
mod flood;
pub mod format;
pub mod junction;
mod latest;
pub mod mailbox;
mod newest;
pub mod port;

pub use bus::{Bus, BusState, Change, Step};
pub use filter::{Filter, Filters};
pub use format::{Classic, Fd, Format, Frame};
pub use junction::{HOST_LINE, Junction};
pub use mailbox::{Mailbox, Put};
pub use newest::FORGET_MS;
pub use port::{CanPort, Heard, Request};
