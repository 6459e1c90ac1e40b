//! Peripherals of the ARM MPS2 board with the AN386 image, as QEMU emulates it (`-M mps2-an386`): a
//! Cortex-M4F with CMSDK timers and UARTs, all clocked at [`CLOCK_HZ`].

pub mod executor;
pub mod flash;
pub mod interrupt;
mod register;
pub mod time;
pub mod uart;
pub mod watchdog;

use funnelnet_app::watchdog::Absent;
use funnelnet_protocol::service::ResetCause;

use crate::app::Chip;
use crate::reset;

/// Clock of the core and of its peripherals in Hz.
pub const CLOCK_HZ: u32 = 25_000_000;
/// What hardware would run at, bit/s; the emulator doesn't wait for bits.
pub const BIT_RATE: u32 = 1_000_000;

/// What the emulated chip gives its node: no number, no cause of a reset. Starts the clock. Called once.
///
/// Without its watchdog: a busy host may leave an emulator standing for longer than a period, which is no fault of the node.
pub fn start() -> Chip<Absent> {
    let start = reset::begin(ResetCause::Unknown);
    time::start();
    Chip { uid: 0, start, watchdog: Absent }
}
