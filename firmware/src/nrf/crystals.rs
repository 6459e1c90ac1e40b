//! Whether both crystals of the board start. `embassy_nrf::init` waits for them without limit.

use embassy_nrf::config::{Config, HfclkSource, LfclkSource};
use embassy_nrf::pac::CLOCK;
use embassy_nrf::pac::clock::vals::Lfclksrc;

/// Looks at a crystal at most: 1 s for all of them, four times what the slow one takes (product specification, LFXO).
const LOOKS: u32 = 1_000;
/// Cycles from one look to the next, 1 ms.
const CYCLES: u32 = 64_000;

/// Which crystals have started.
#[derive(Clone, Copy)]
pub struct Crystals {
    /// That of 32 MHz, for the core and the serial lines.
    pub fast: bool,
    /// That of 32,768 Hz, for what wakes the core and for the watchdog.
    pub slow: bool,
}

/// Starts both, and looks; those that start stay on. Before `embassy_nrf::init`.
pub fn look() -> Crystals {
    CLOCK.events_hfclkstarted().write_value(0);
    CLOCK.tasks_hfclkstart().write_value(1);
    CLOCK.events_lfclkstarted().write_value(0);
    CLOCK.lfclksrc().write(|reg| reg.set_src(Lfclksrc::Xtal));
    CLOCK.tasks_lfclkstart().write_value(1);
    let fast = comes(|| CLOCK.events_hfclkstarted().read() != 0);
    let slow = comes(|| CLOCK.events_lfclkstarted().read() != 0);
    // Its source cannot be chosen while it runs, and it can be stopped only once it does: by the chip's own oscillator, until the crystal comes
    // (nRF52840 product specification, CLOCK).
    if !slow && comes(|| CLOCK.lfclkstat().read().state()) {
        CLOCK.tasks_lfclkstop().write_value(1);
    }
    Crystals { fast, slow }
}

/// The clocks of a node; in place of a crystal that is missing the chip's own oscillator, for a look at the rest of the board, not for a node.
pub fn clocks(Crystals { fast, slow }: Crystals) -> Config {
    let mut config = super::clocks();
    if !fast {
        config.hfclk_source = HfclkSource::Internal;
    }
    if !slow {
        config.lfclk_source = LfclkSource::InternalRC;
    }
    config
}

fn comes(event: impl Fn() -> bool) -> bool {
    (0..LOOKS).any(|_| {
        let has_come = event();
        if !has_come {
            cortex_m::asm::delay(CYCLES);
        }
        has_come
    })
}
