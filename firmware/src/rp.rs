//! Reset cause and watchdog of an RP2040.

use embassy_rp::{Peri, pac, peripherals::WATCHDOG, watchdog};
use funnel_protocol::service::ResetCause;

use crate::watchdog::{PERIOD, Watchdog};

/// What the chip says of the last reset. Data sheet, WATCHDOG.REASON and CHIP_RESET. The flag of power-on stays through later resets of the core
/// alone and stands for brown-out, too: it tells nothing.
pub fn cause() -> ResetCause {
    let reason = pac::WATCHDOG.reason().read();
    match () {
        () if reason.timer() => ResetCause::Watchdog,
        () if reason.force() => ResetCause::Software,
        () if pac::VREG_AND_CHIP_RESET.chip_reset().read().had_run() => ResetCause::Pin,
        () => ResetCause::Unknown,
    }
}

/// The chip's watchdog.
pub struct Timer(watchdog::Watchdog);

impl Timer {
    /// Not started yet.
    pub fn new(watchdog: Peri<'static, WATCHDOG>) -> Self {
        Self(watchdog::Watchdog::new(watchdog))
    }
}

impl Watchdog for Timer {
    fn start(&mut self) {
        self.0.start(PERIOD);
    }

    fn feed(&mut self) {
        self.0.feed(PERIOD);
    }
}
