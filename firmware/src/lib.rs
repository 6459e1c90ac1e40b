//! The node on a microcontroller.
//!
//! The core decides and the protocol encodes; what is here only moves bytes and time. One async [`app`] is generic over its
//! [`link`]; a board adds its peripherals and a binary of under 100 lines in `src/bin`. Exactly one board feature chooses it.
//!
//! `unsafe` is allowed in seven files, each for one reason: `mps2/register.rs` (device registers), `mps2/interrupt.rs` (vector
//! table), `executor.rs` (polling), `panic.rs` (the fault handler),
//! `storage/flash.rs` (addresses from the linker), `stm32/ecc.rs` (the NMI handler) and `mps2/flash.rs` (a section that survives a reset); and in the interrupt bindings that embassy's macro
//! writes into a board's binary.
#![no_std]

pub mod app;
pub mod executor;
pub mod heater;
pub mod link;
#[cfg(feature = "mps2-an386")]
pub mod mps2;
pub mod panic;
#[cfg(feature = "mps2-an386")]
pub mod ring;
pub mod selftest;
#[cfg(feature = "_stm32")]
pub mod stm32;
pub mod storage;

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
