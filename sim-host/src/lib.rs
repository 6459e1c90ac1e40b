//! Sim-host: runs a Funnelnet scenario at a chosen fidelity.
//!
//! `engine` drives the very same f32 node as the firmware, over a bus model; `reference` solves the continuous-time
//! equations of the paper in f64.
#![forbid(unsafe_code)]

pub use funnelnet_sim::{
    bus, central, check, configure, emergent, engine, extremes, judge, loopback, noise, number,
    number_format, presence, printable, random, reference, sampled, scenario,
};

pub mod bench;
pub mod can;
pub mod cli;
pub mod compare;
pub mod conductor;
pub mod emulator;
pub mod exit;
pub mod export;
pub mod flash_file;
pub mod host_node;
pub mod hub;
pub mod interrupt;
pub mod plot;
pub mod program;
pub mod progress;
pub mod record;
pub mod replay;
pub mod report;
pub mod run;
pub mod sweep;
