#![doc = include_str!("../README.md")]
#![forbid(unsafe_code)]

mod crc;
pub mod frame;
pub mod length;
pub mod rate;
mod stuff;
pub mod wire;

pub use frame::{Frame, FrameError, Id, Kind};
pub use length::Length;
pub use rate::{BitRate, RateError, Timing};
pub use wire::Wire;
