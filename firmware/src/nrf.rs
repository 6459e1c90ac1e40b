//! Number, clocks, reset cause and watchdog of an nRF52840.

use embassy_nrf::config::{Config, HfclkSource, LfclkSource};
use embassy_nrf::wdt::{self, WatchdogHandle};
use embassy_nrf::{Peri, pac, peripherals::WDT};
use funnelnet_protocol::service::ResetCause;

use crate::watchdog::PERIOD;
use funnelnet_app::watchdog::Watchdog;

/// Counts of the watchdog's clock per second.
const COUNTS_PER_S: u32 = 32_768;

/// The chip's number, from its factory information.
pub fn uid() -> u64 {
    let [low, high] = [0, 1].map(|half| u64::from(pac::FICR.deviceid(half).read()));
    low | high << 32
}

/// Both clocks from the board's crystals: ticks of nodes that run by their own timers drift apart as their clocks do.
pub fn clocks() -> Config {
    let mut config = Config::default();
    config.hfclk_source = HfclkSource::ExternalXtal;
    config.lfclk_source = LfclkSource::ExternalXtal;
    config
}

/// What the chip says of the last reset; asked once, since the answer is cleared. Product specification, POWER.RESETREAS.
pub fn cause() -> ResetCause {
    let flags = pac::POWER.resetreas().read();
    // Cleared by writing ones.
    pac::POWER.resetreas().write_value(flags);
    match () {
        () if flags.dog() => ResetCause::Watchdog,
        () if flags.lockup() => ResetCause::HardFault,
        () if flags.sreq() => ResetCause::Software,
        () if flags.resetpin() => ResetCause::Pin,
        // Power-on or brown-out; the record in RAM tells the two apart.
        () if flags.0 == 0 => ResetCause::BrownOut,
        () => ResetCause::Unknown,
    }
}

/// The chip's watchdog. Once started it cannot be stopped.
pub enum Wdt {
    /// Not started yet.
    Idle(Peri<'static, WDT>),
    /// Counting.
    Running(WatchdogHandle),
    /// It counts since another start, with other settings.
    Foreign,
}

impl Watchdog for Wdt {
    fn start(&mut self) {
        let Self::Idle(wdt) = core::mem::replace(self, Self::Foreign) else { return };
        let mut config = wdt::Config::default();
        config.timeout_ticks = COUNTS_PER_S * PERIOD.as_secs() as u32;
        match wdt::Watchdog::try_new(wdt, config) {
            Ok((_, [handle])) => *self = Self::Running(handle),
            Err(_) => defmt::error!("the watchdog runs already, with other settings"),
        }
    }

    fn feed(&mut self) {
        if let Self::Running(handle) = self {
            handle.pet();
        }
    }
}
