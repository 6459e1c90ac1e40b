//! The Funnelnet wire: what nodes say to each other and to a host, as bytes.
//!
//! The normative text is `protocol/README.md`. Decoders are total: any byte string gives a frame or a
//! [`Refusal`], never a panic. Nothing here allocates, reads a clock, or knows the law.
#![no_std]
#![forbid(unsafe_code)]

mod builder;
pub mod can;
pub mod can_fd;
mod checksum;
pub mod config;
mod in_place;
pub mod message;
pub mod refusal;
pub mod report;
pub mod serial;
pub mod service;
#[cfg(feature = "update")]
pub mod update;

pub use builder::NodeBuilder;
pub use config::NodeConfig;
pub use message::{Command, Component, FaultCode, Message, NodeId, Severity, Target, TickStamp};
pub use refusal::Refusal;
pub use service::{Reply, Request};

/// Version of the wire. Nodes report it in [`service::Identity`]; unequal versions do not talk.
pub const WIRE_VERSION: u8 = 3;
