//! A new program for a node.
//!
//! The node writes it, block by block, into a part of the flash that nothing runs from ([`Updater`]). At the
//! next start a [boot loader](boot) swaps it with the old one, page by page, by `embassy-boot`. It is on
//! trial then: unless it completes [`TRIAL_TICKS`] ticks, the next start swaps it back. A power cut at any
//! write or erase, on either way, leaves the old program or the new one, whole (tests/power_cut.rs).
#![no_std]
#![forbid(unsafe_code)]

pub mod boot;
mod regions;
mod transfer;
mod updater;
mod wide;

pub use regions::Regions;
pub use transfer::{Step, Transfer};
pub use updater::Updater;
pub use wide::{WORD, Wide};

/// Ticks that a program on trial has to complete until it stays.
pub const TRIAL_TICKS: u32 = 100;
