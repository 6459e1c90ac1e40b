//! The CMSDK APB watchdog: its first timeout is an NMI, which leaves the cause for the next start; its second
//! one resets.

use cortex_m_rt::exception;
use funnelnet_protocol::service::ResetCause;

use super::CLOCK_HZ;
use super::register::{self, Register};
use crate::reset;
use crate::watchdog::PERIOD;
use funnelnet_app::watchdog::Watchdog;

/// CMSDK APB watchdog, as far as it is used.
#[repr(C)]
pub(super) struct Registers {
    /// Counts from here, down to 0.
    load: Register,
    value: Register,
    /// Bit 0: count, and interrupt at 0; bit 1: reset at the next 0.
    control: Register,
    /// A write clears the interrupt and loads the counter.
    clear: Register,
}

/// Half of the period each: until the interrupt, and until the reset.
const COUNTS: u32 = CLOCK_HZ / 2 * PERIOD.as_secs() as u32;

/// The board's watchdog.
pub struct Apb;

impl Watchdog for Apb {
    fn start(&mut self) {
        let watchdog = register::watchdog();
        watchdog.load.write(COUNTS);
        watchdog.control.write(0b11);
    }

    fn feed(&mut self) {
        register::watchdog().clear.write(1);
    }
}

#[allow(unsafe_code)]
// SAFETY: it only writes the record, whose words are atomic, and never returns.
#[exception]
unsafe fn NonMaskableInt() -> ! {
    reset::leave(ResetCause::Watchdog, 0);
    // The counter runs on to its reset.
    loop {
        cortex_m::asm::nop();
    }
}
