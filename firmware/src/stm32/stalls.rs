//! embassy's clock over a time in which the core has stood still.
//!
//! It counts 2^16 us in TIM2, and an interrupt counts halves of that. A core that stands still for longer, as it does while a sector of its only bank of
//! flash is erased, misses some, and time is behind by a multiple of 65,536 us from there on. The core's own counter of cycles goes on meanwhile.

use cortex_m::peripheral::DWT;
use embassy_stm32::pac::TIM2;
use embassy_time::{Duration, Instant};

/// Of the core (`f4::clocks`). The counter has 32 bits: 26 s.
const CYCLES_PER_US: u32 = 160;
/// Half of what TIM2 counts.
const HALF_TURN: Duration = Duration::from_micros(1 << 15);

/// Starts the counter of cycles. Called once.
pub fn begin() {
    // Nobody else takes the core's own peripherals.
    if let Some(mut core) = cortex_m::Peripherals::take() {
        core.DCB.enable_trace();
        core.DWT.enable_cycle_counter();
    }
}

/// Does something for which the core may stand still, with interrupts enabled before and after it; embassy's time is right then.
pub fn over<R>(stall: impl FnOnce() -> R) -> R {
    let (begin, cycles) = critical_section::with(|_| (Instant::now(), DWT::cycle_count()));
    let done = stall();
    let passed = DWT::cycle_count().wrapping_sub(cycles) / CYCLES_PER_US;
    catch_up(begin + Duration::from_micros(passed.into()));
    done
}

/// Turns that are missing.
fn catch_up(to: Instant) {
    let mut is_behind = false;
    // What is less than half a turn is the time that this takes.
    while Instant::now() + HALF_TURN < to {
        is_behind = true;
        count_half();
        count_half();
    }
    // An alarm that was due meanwhile: the timer has passed it.
    if is_behind {
        TIM2.egr().write(|w| w.set_ccg(1, true));
    }
}

/// Half a turn: the interrupt at half of it, by software.
fn count_half() {
    TIM2.egr().write(|w| w.set_ccg(0, true));
    while TIM2.sr().read().ccif(0) {}
}
