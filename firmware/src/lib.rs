//! The node on a microcontroller.
//!
//! The node decides and the protocol encodes; what is here only moves bytes and time. The async app is `funnelnet_app`, which a computer runs,
//! too; [`app`] puts it on a chip, and a board adds its peripherals and a binary of some 100 lines in `src/bin`. Exactly one board feature chooses it.
//!
//! `unsafe` is allowed in thirteen files, each for one reason: `mps2/register.rs` (device registers), `mps2/interrupt.rs` (vector
//! table), `executor.rs` (polling), `priority.rs` (the NVIC), `panic.rs` (the fault handler),
//! `storage/flash.rs` (addresses from the linker), `stm32/ecc.rs` and `mps2/watchdog.rs` (NMI handlers), `stm32/fdcan.rs`, `stm32/bxcan.rs` and
//! `stm32/line.rs` (interrupt handlers, which are unsafe to call), `reset.rs` and `mps2/flash.rs` (sections that
//! survive a reset); and in the interrupt bindings that embassy's macro writes into a board's binary.
#![no_std]

pub mod app;
pub mod executor;
pub mod heater;
#[cfg(feature = "mps2-an386")]
pub mod mps2;
#[cfg(feature = "nrf52840-dk")]
pub mod nrf;
pub mod panic;
pub mod priority;
pub mod reset;
#[cfg(feature = "mps2-an386")]
pub mod ring;
#[cfg(feature = "rp2040-pico")]
pub mod rp;
pub mod selftest;
#[cfg(feature = "_stm32")]
pub mod stm32;
pub mod storage;
pub mod watchdog;

const _: () = {
    let boards = cfg!(feature = "mps2-an386") as u8
        + cfg!(feature = "nucleo-g474re") as u8
        + cfg!(feature = "nucleo-f446re") as u8
        + cfg!(feature = "nrf52840-dk") as u8
        + cfg!(feature = "rp2040-pico") as u8;
    assert!(
        boards == 1,
        "choose exactly one board feature; other boards than the default: --no-default-features"
    );
};

defmt::timestamp!("{=u64:us}", embassy_time::Instant::now().as_micros());
