//! embassy's clock over a time in which the core has stood still.
//!
//! It counts 2^16 us in TIM2, and an interrupt counts halves of that. A core that stands still for longer, as it does while a sector of its only bank of
//! flash is erased, misses some: each of the two interrupts is remembered once. The core's own counter of cycles goes on meanwhile. All halves have to be made
//! up for: with one missing the time looks right, and alarms come a turn late.

use cortex_m::peripheral::DWT;
use embassy_stm32::pac::TIM2;
use embassy_time::Instant;

/// Of the core (`f4::clocks`). The counter has 32 bits: 26 s.
const CYCLES_PER_US: u32 = 160;
/// Of TIM2: the bit that changes with each half.
const HALF: u32 = 15;

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
    let mut stall = Some(stall);
    loop {
        let tried = critical_section::with(|_| {
            let (begin, cycles) = (Instant::now().as_micros(), DWT::cycle_count());
            // A half that is not counted yet makes this time wrong.
            if remembered() > 0 {
                return None;
            }
            let done = stall.take()?();
            let passed = DWT::cycle_count().wrapping_sub(cycles) / CYCLES_PER_US;
            Some((done, missing(begin, begin + u64::from(passed))))
        });
        if let Some((done, missing)) = tried {
            make_up(missing);
            return done;
        }
    }
}

/// Halves of which the interrupts will count themselves.
fn remembered() -> u64 {
    let status = TIM2.sr().read();
    u64::from(status.uif()) + u64::from(status.ccif(0))
}

/// Halves between two times, us, that nobody will count; the second is now, to some microseconds.
fn missing(begin: u64, about: u64) -> u64 {
    let (counter, remembered) = loop {
        let (counter, remembered) = (TIM2.cnt().read(), remembered());
        if (counter ^ TIM2.cnt().read()) >> HALF == 0 {
            break (counter as u16, remembered);
        }
    };
    // The nearest time at which the timer is where it is.
    let off = counter.wrapping_sub(about as u16).cast_signed();
    let now = about.wrapping_add_signed(off.into());
    ((now >> HALF) - (begin >> HALF)).saturating_sub(remembered)
}

fn make_up(missing: u64) {
    for _ in 0..missing {
        count_half();
    }
    // An alarm that was due meanwhile: the timer has passed it.
    if missing > 0 {
        TIM2.egr().write(|w| w.set_ccg(1, true));
    }
}

/// Half a turn: the interrupt at half of it, by software.
fn count_half() {
    TIM2.egr().write(|w| w.set_ccg(0, true));
    while TIM2.sr().read().ccif(0) {}
}
