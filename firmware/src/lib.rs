//! The node on a microcontroller.
//!
//! The core decides and the protocol encodes; what is here only moves bytes and time. One async [`app`] is
//! generic over its link; a board adds its peripherals ([`mps2`] is the emulated one) and a binary of under
//! 100 lines.
//!
//! `unsafe` is allowed in four files, each for one reason: `mps2/register.rs` (device registers),
//! `mps2/interrupt.rs` (vector table), `executor.rs` (polling) and `panic.rs` (the fault handler).
#![no_std]

pub mod app;
pub mod executor;
pub mod mps2;
pub mod panic;
pub mod ring;
pub mod selftest;

defmt::timestamp!("{=u64:us}", embassy_time::Instant::now().as_micros());
