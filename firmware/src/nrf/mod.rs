//! Number, clocks, reset cause, watchdog and serial lines of an nRF52840.

pub mod clock;
pub mod crystals;

use embassy_nrf::buffered_uarte::Error;
use embassy_nrf::config::{Config, HfclkSource, LfclkSource};
use embassy_nrf::nvmc::Nvmc;
use embassy_nrf::peripherals::{NVMC, TIMER2, WDT};
use embassy_nrf::wdt::{self, WatchdogHandle};
use embassy_nrf::{Peri, pac, uarte};
use embedded_io_async::{ErrorType, Read, Write};
use funnelnet_protocol::service::ResetCause;

use crate::app::Chip;
use crate::reset;
use crate::storage::flash::{Blocking, OnFlash};
use crate::watchdog::PERIOD;
use funnelnet_app::watchdog::Watchdog;

/// Counts of the watchdog's clock per second.
const COUNTS_PER_S: u32 = 32_768;

/// The storage of the chip.
pub type Storage = OnFlash<Blocking<Nvmc<'static>>>;

/// What the chip gives its node: number, start, and watchdog; and its clock begins. Called once.
pub fn begin(watchdog: Peri<'static, WDT>, timer: Peri<'static, TIMER2>) -> Chip<Wdt> {
    clock::begin(timer);
    let start = reset::begin(cause());
    Chip { uid: uid(), start, watchdog: Wdt::Idle(watchdog) }
}

/// The end of flash.
pub fn storage(flash: Peri<'static, NVMC>) -> Storage {
    OnFlash::new(Blocking(Nvmc::new(flash)), 0)
}

/// A serial line of 1 Mbit/s.
pub fn line() -> uarte::Config {
    let mut config = uarte::Config::default();
    config.baudrate = uarte::Baudrate::Baud1m;
    config
}

/// The chip's number, from its factory information.
fn uid() -> u64 {
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
fn cause() -> ResetCause {
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

/// Cycles for the longest answer to leave, which may still wait to be sent: 5 ms.
const LAST_WORDS: u32 = 5 * 64_000;

/// A UART, or its half that reads, that restarts the node after an overrun.
///
/// An overrun comes where the core has stood still for longer than half a buffer lasts, as it does while it erases flash and the host talks on. embassy's driver
/// takes two ends of reception for one then, and is deaf from there on; its count of bytes may be wrong, too. The node is not running when it erases.
pub struct OrRestart<U>(pub U);

impl<U: ErrorType> ErrorType for OrRestart<U> {
    type Error = U::Error;
}

impl<U: Read<Error = Error>> Read for OrRestart<U> {
    async fn read(&mut self, bytes: &mut [u8]) -> Result<usize, Error> {
        match self.0.read(bytes).await {
            Err(Error::Overrun) => {
                defmt::warn!("serial line: overrun; restart");
                cortex_m::asm::delay(LAST_WORDS);
                reset::restart()
            }
            read => read,
        }
    }
}

impl<U: Write> Write for OrRestart<U> {
    async fn write(&mut self, bytes: &[u8]) -> Result<usize, U::Error> {
        self.0.write(bytes).await
    }

    async fn flush(&mut self) -> Result<(), U::Error> {
        self.0.flush().await
    }
}
