//! A clock that counts microseconds: TIMER 2, at 1 MHz from the crystal of 32 MHz.
//!
//! embassy's clock counts 32,768 Hz, 30.5 us a count: alone it spreads the ticks of a node by that. It still wakes the core; the last counts before a tick
//! are waited for awake.

use core::cell::Cell;

use critical_section::Mutex;
use embassy_futures::yield_now;
use embassy_nrf::pac::TIMER2;
use embassy_nrf::pac::timer::vals::{Bitmode, Mode};
use embassy_nrf::{Peri, peripherals};
use embassy_time::{Duration, Instant, Timer};
use funnelnet_app::Clock;

/// 16 MHz / 2^4.
const PRESCALER: u8 = 4;
/// embassy's clock cannot be told to wake sooner than that: RTC of nRF52, with its reserve, and the count that may pass while it is told.
const SHORTEST_SLEEP: u32 = 4;
/// A count less for so many: both crystals together are wrong by less than 122 ppm.
const COUNTS_OF_DOUBT: u32 = 8_192;
/// Longest sleep, us. It is woken for the watchdog long before, and 512 times that is a number of 32 bits.
const LONGEST_SLEEP: u32 = 8_000_000;
/// What is waited for without a look at the lines, us.
const AT_ONCE: u64 = 8;

/// Time since the start, us, when it was last asked for.
static LAST: Mutex<Cell<u64>> = Mutex::new(Cell::new(0));

/// Starts the timer. Nothing else may use it.
pub fn begin(_timer: Peri<'static, peripherals::TIMER2>) {
    TIMER2.mode().write(|w| w.set_mode(Mode::Timer));
    TIMER2.bitmode().write(|w| w.set_bitmode(Bitmode::_32bit));
    TIMER2.prescaler().write(|w| w.set_prescaler(PRESCALER));
    TIMER2.tasks_clear().write_value(1);
    TIMER2.tasks_start().write_value(1);
}

/// The timer has 32 bits, 71 minutes; the app asks ten times a second.
fn micros() -> u64 {
    critical_section::with(|cs| {
        let last = LAST.borrow(cs);
        TIMER2.tasks_capture(0).write_value(1);
        let passed = TIMER2.cc(0).read().wrapping_sub(last.get() as u32);
        last.set(last.get() + u64::from(passed));
        last.get()
    })
}

/// The clock of TIMER 2.
#[derive(Clone, Copy)]
pub struct Micros;

impl Clock for Micros {
    fn now(self) -> u64 {
        micros() * 1000
    }

    async fn wait_until(self, at: u64) {
        let due = at.div_ceil(1000);
        let wait = u32::try_from(due.saturating_sub(micros())).unwrap_or(u32::MAX).min(LONGEST_SLEEP);
        // Whole counts, from the beginning of the present one: not too many.
        let counts = wait * 512 / 15_625;
        let counts = counts - counts / COUNTS_OF_DOUBT;
        if counts >= SHORTEST_SLEEP {
            Timer::at(Instant::now() + Duration::from_ticks(counts.into())).await;
        }
        if wait == LONGEST_SLEEP {
            return;
        }
        while micros() + AT_ONCE < due {
            yield_now().await;
        }
        while micros() < due {}
    }
}
