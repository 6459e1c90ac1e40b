#![doc = include_str!("../README.md")]
#![forbid(unsafe_code)]

pub mod bus;
pub mod candump;
#[cfg(feature = "pcapng")]
pub mod capture;
pub mod controller;
pub mod counters;
mod crc;
pub mod driver;
pub mod event;
pub mod filter;
pub mod frame;
pub mod length;
pub mod noise;
mod participant;
pub mod rate;
mod reader;
pub mod record;
pub mod response;
mod stuff;
pub mod table;
pub mod wire;

pub use bus::{Arrival, Bus};
pub use candump::Line;
#[cfg(feature = "pcapng")]
pub use capture::Capture;
pub use controller::{Order, TRANSMIT_BUFFERS};
pub use counters::{Counters, Mode};
pub use driver::Queue;
pub use event::{Event, What};
pub use filter::Filter;
pub use frame::{Frame, FrameError, Id, Kind};
pub use length::Length;
pub use noise::{BitErrors, Hit, Noise, Quiet, SeenBy, Strike};
pub use rate::{BitRate, RateError, Timing};
pub use reader::ErrorKind;
pub use record::Record;
pub use response::Stream;
pub use table::Table;
pub use wire::{Field, Wire};
