#![doc = include_str!("../README.md")]
#![forbid(unsafe_code)]

pub mod bus;
pub mod central;
#[cfg(feature = "check")]
pub mod check;
pub mod configure;
pub mod emergent;
pub mod engine;
pub mod extremes;
pub mod judge;
#[cfg(feature = "large")]
pub mod large;
pub mod loopback;
pub mod noise;
pub mod number;
pub mod number_format;
pub mod presence;
pub mod printable;
pub mod random;
#[cfg(feature = "reference")]
pub mod reference;
pub mod sampled;
pub mod scenario;
pub mod simulation;
pub mod trace_hash;

pub use scenario::Scenario;
pub use simulation::{Simulation, Verdict};
