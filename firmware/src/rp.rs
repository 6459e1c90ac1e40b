//! Reset cause, watchdog and flash of a Raspberry Pi Pico.

use embassy_rp::clocks::ClockConfig;
use embassy_rp::config::Config;
use embassy_rp::flash::{self, FLASH_BASE, Flash};
use embassy_rp::peripherals::{FLASH, WATCHDOG};
use embassy_rp::{Peri, pac, uart, watchdog};
use funnelnet_protocol::service::ResetCause;

use crate::app::Chip;
use crate::reset;
use crate::storage::flash::{Blocking, OnFlash};
use crate::watchdog::PERIOD;
use funnelnet_app::watchdog::Watchdog;

/// Of the Pico's external flash, bytes.
pub const FLASH_SIZE: usize = 2 << 20;

/// The Pico's external flash.
pub type PicoFlash = Flash<'static, FLASH, flash::Blocking, FLASH_SIZE>;

/// The storage of the Pico.
pub type Storage = OnFlash<Blocking<PicoFlash>>;

/// What the Pico gives its node: number, start and watchdog; and its storage. Called once, before anything else runs: the flash cannot be executed from while it is
/// asked.
pub fn begin(flash: Peri<'static, FLASH>, watchdog: Peri<'static, WATCHDOG>) -> (Chip<Timer>, Storage) {
    let start = reset::begin(cause());
    let mut flash = PicoFlash::new_blocking(flash);
    let chip = Chip { uid: uid(&mut flash), start, watchdog: Timer::new(watchdog) };
    (chip, OnFlash::new(Blocking(flash), FLASH_BASE as u32))
}

/// Readings of a register to wait for the crystal at most: 20 ms or more with the clock of a start; it takes 1 ms.
const LONGEST_WAIT: u32 = 50_000;
/// Of the crystal at its start, 256 periods of it each: 1 ms at 12 MHz.
const START_UP: u16 = 47;

/// Whether the crystal starts. Before `embassy_rp::init`, which waits for it without limit.
pub fn has_crystal() -> bool {
    use pac::xosc::vals::{CtrlFreqRange, Enable};
    pac::XOSC.startup().write(|reg| reg.set_delay(START_UP));
    pac::XOSC.ctrl().write(|reg| {
        reg.set_freq_range(CtrlFreqRange::_1_15MHZ);
        reg.set_enable(Enable::ENABLE);
    });
    (0..LONGEST_WAIT).any(|_| pac::XOSC.status().read().stable())
}

/// The clock of a Pico; of one without a crystal the ring oscillator, for a look at the rest of it, not for a node.
pub fn clocks(has_crystal: bool) -> Config {
    if has_crystal { Config::default() } else { Config::new(ClockConfig::rosc()) }
}

/// A serial line of 1 Mbit/s.
pub fn line() -> uart::Config {
    let mut config = uart::Config::default();
    config.baudrate = 1_000_000;
    config
}

/// Pulls up a pin that hears a line: one that leads nowhere is silent then. embassy's driver leaves it floating, and what it picks up counts as errors.
pub fn pull_up(pin: usize) {
    pac::PADS_BANK0.gpio(pin).modify(|pad| {
        pad.set_pde(false);
        pad.set_pue(true);
    });
}

/// The pin that hears the host, GP1.
pub const HOST_RX: usize = 1;

/// The flash's number, since the chip has none; 0 where it cannot be read.
fn uid(flash: &mut PicoFlash) -> u64 {
    let mut number = [0; 8];
    flash.blocking_unique_id(&mut number).map_or(0, |()| u64::from_be_bytes(number))
}

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
        // Also while a debugger holds the core: else the output would keep its duty for as long.
        self.0.pause_on_debug(false);
        self.0.start(PERIOD);
    }

    fn feed(&mut self) {
        self.0.feed(PERIOD);
    }
}
