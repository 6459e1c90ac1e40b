//! Reset cause and independent watchdog (IWDG, on its own RC oscillator) of an STM32, and with them what it gives its node.

use embassy_stm32::Peri;
use embassy_stm32::pac;
use embassy_stm32::pac::RCC;
use embassy_stm32::pac::iwdg::vals::Key;
use embassy_stm32::peripherals::IWDG;
use embassy_stm32::wdg::IndependentWatchdog;
use funnelnet_protocol::service::ResetCause;

use super::uid;
use crate::app::Chip;
use crate::reset;
use crate::watchdog::PERIOD;
use funnelnet_app::watchdog::Watchdog;

/// Starts the watchdog with the period that it has after a reset, 0.5 s. Call it first of all: `embassy_stm32::init` waits for a crystal without
/// limit, and a node whose clock is missing shall go on trying.
pub fn watch_the_start() {
    pac::IWDG.kr().write(|kr| kr.set_key(Key::START));
}

/// What the chip gives its node: number, start, and watchdog. Called once.
pub fn begin(iwdg: Peri<'static, IWDG>) -> Chip<Iwdg> {
    let start = reset::begin(cause());
    Chip { uid: uid(), start, watchdog: Iwdg::new(iwdg) }
}

/// What the chip says of the last reset; asked once, since the answer is cleared. Reference manuals, RCC_CSR.
fn cause() -> ResetCause {
    let flags = RCC.csr().read();
    RCC.csr().modify(|csr| csr.set_rmvf(true));
    // Every reset pulls the reset line, so that the flag of the pin comes last.
    #[cfg(feature = "_g4")]
    let (watchdog, power_on, pin) = (flags.iwdgrstf() || flags.wwdgrstf(), false, flags.pinrstf());
    #[cfg(feature = "_f4")]
    let (watchdog, power_on, pin) = (flags.wdgrstf() || flags.wwdgrstf(), flags.porrstf(), flags.padrstf());
    match () {
        () if watchdog => ResetCause::Watchdog,
        () if flags.sftrstf() => ResetCause::Software,
        () if power_on => ResetCause::PowerOn,
        // On the G4 also after power-on; the record in RAM tells the two apart.
        () if flags.borrstf() => ResetCause::BrownOut,
        () if pin => ResetCause::Pin,
        () => ResetCause::Unknown,
    }
}

/// The chip's watchdog, which [`watch_the_start`] has started. It cannot be stopped.
pub struct Iwdg(IndependentWatchdog<'static, IWDG>);

impl Iwdg {
    /// With its period. It begins with the next feeding, so that is here.
    fn new(iwdg: Peri<'static, IWDG>) -> Self {
        let mut watchdog = IndependentWatchdog::new(iwdg, PERIOD.as_micros() as u32);
        watchdog.pet();
        Self(watchdog)
    }
}

impl Watchdog for Iwdg {
    fn start(&mut self) {
        self.0.unleash();
    }

    fn feed(&mut self) {
        self.0.pet();
    }
}
