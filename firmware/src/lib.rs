//! The node on a microcontroller.
//!
//! The node decides and the protocol encodes; what is here only moves bytes and time. The async app is `funnelnet_app`, which a computer runs,
//! too; [`app`] puts it on a chip, [`board`] has the one `main` of all boards, and a board is a binary in `src/bin` that hands over its peripherals. Exactly one board feature
//! chooses it (`build.rs`); what chips of a family share hangs on the feature of the family (`_g4`).
//!
//! `unsafe` is allowed in fifteen files, each for one reason: `mps2/register.rs` (device registers), `mps2/interrupt.rs` (vector
//! table), `mps2/executor.rs` (polling), `priority.rs` (the NVIC), `panic.rs` (the fault handler),
//! `storage/flash.rs` and `storage/programs.rs` (addresses from the linker), `bin/rp2040_pico_boot.rs` (the start of another program), `stm32/ecc.rs` and `mps2/watchdog.rs` (NMI handlers), `stm32/fdcan.rs`, `stm32/bxcan.rs` and
//! `stm32/line.rs` (interrupt handlers, which are unsafe to call), `reset.rs` and `mps2/flash.rs` (sections that
//! survive a reset); and in the interrupt bindings that embassy's macro writes into a board's binary.
#![no_std]

pub mod app;
pub mod board;
#[cfg(feature = "_hardware")]
pub mod board_check;
pub mod clock;
pub mod executor;
pub mod heater;
#[cfg(feature = "_mps2")]
pub mod mps2;
#[cfg(feature = "_nrf52840")]
pub mod nrf;
pub mod panic;
pub mod priority;
pub mod reset;
#[cfg(feature = "_mps2")]
pub mod ring;
#[cfg(feature = "_rp2040")]
pub mod rp;
pub mod selftest;
#[cfg(feature = "_stm32")]
pub mod stm32;
pub mod storage;
#[cfg(feature = "usb")]
pub mod usb;
pub mod watchdog;

defmt::timestamp!("{=u64:us}", embassy_time::Instant::now().as_micros());
