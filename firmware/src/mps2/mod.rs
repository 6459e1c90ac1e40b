//! Peripherals of the ARM MPS2 board with the AN386 image, as QEMU emulates it (`-M mps2-an386`): a
//! Cortex-M4F with CMSDK timers and UARTs, all clocked at [`CLOCK_HZ`].

pub mod flash;
pub mod interrupt;
mod register;
pub mod time;
pub mod uart;
pub mod watchdog;

/// Clock of the core and of its peripherals in Hz.
pub const CLOCK_HZ: u32 = 25_000_000;
