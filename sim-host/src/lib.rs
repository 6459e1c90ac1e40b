//! Sim-host: runs a Funnelnet scenario at a chosen fidelity.
//!
//! `engine` drives the very same f32 node as the firmware, over a bus model; `reference` solves the continuous-time
//! equations of the paper in f64.
#![forbid(unsafe_code)]

pub mod bench;
pub mod bus;
pub mod can;
pub mod central;
pub mod check;
pub mod cli;
pub mod compare;
pub mod conductor;
pub mod configure;
pub mod emergent;
pub mod emulator;
pub mod engine;
pub mod exit;
pub mod extremes;
pub mod figure;
pub mod flash_file;
pub mod host_node;
pub mod hub;
pub mod interrupt;
pub mod judge;
pub mod noise;
pub mod presence;
pub mod printable;
pub mod progress;
pub mod random;
pub mod record;
pub mod reference;
pub mod replay;
pub mod report;
pub mod run;
pub mod scenario;
