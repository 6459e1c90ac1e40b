//! What a link decides without hardware: which CAN frame is sent next ([`mailbox`]), and what the controller's error state
//! leads to ([`bus`]), and what frames hold in either format ([`format`](mod@format)). Sans-IO: readings and time in, decisions out; the firmware wraps drivers around it.
#![no_std]
#![forbid(unsafe_code)]

pub mod bus;
pub mod format;
pub mod mailbox;

pub use bus::{Bus, BusState, Change, Step};
pub use format::{Classic, Fd, Format, Frame};
pub use mailbox::{Mailbox, Put};
