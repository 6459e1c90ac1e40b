//! embassy-time on two CMSDK timers: timer 0 runs for ever and is the clock, timer 1 is the alarm.
//!
//! The clock is 64 bits of microseconds, made from 32 bits at 25 MHz (which wrap after 171 s) by adding up
//! what has passed since the last reading. The alarm is never farther away than `LONGEST_ALARM_US` and reads
//! the clock, so that no wrap is missed.

use core::cell::RefCell;
use core::sync::atomic::{AtomicBool, Ordering};
use core::task::Waker;

use embassy_sync::blocking_mutex::{Mutex, raw::CriticalSectionRawMutex};
use embassy_time_driver::Driver;
use embassy_time_queue_utils::Queue;

use super::CLOCK_HZ;
use super::interrupt::{self, Interrupt};
use super::register::timer;

/// Timer counts per microsecond.
const COUNTS_PER_US: u32 = CLOCK_HZ / embassy_time_driver::TICK_HZ as u32;
/// Farthest alarm; farther ones are set again when this has passed. Well under one wrap of the counter.
const LONGEST_ALARM_US: u64 = 100_000_000;

const ENABLE: u32 = 1 << 0;
const INTERRUPT_ENABLE: u32 = 1 << 3;

/// Raw count at [`CLOCK_HZ`], upwards, wrapping after 171 s: for measuring short intervals.
#[inline(always)]
pub fn counts() -> u32 {
    !timer::<0>().value.read()
}

/// Microseconds since [`start`], extended from the counter.
struct Clock {
    micros: u64,
    /// Value of [`counts`] at the start of the present microsecond.
    counts: u32,
}

impl Clock {
    fn now(&mut self) -> u64 {
        let micros = counts().wrapping_sub(self.counts) / COUNTS_PER_US;
        self.counts = self.counts.wrapping_add(micros * COUNTS_PER_US);
        self.micros += u64::from(micros);
        self.micros
    }
}

struct State {
    clock: Clock,
    queue: Queue,
}

impl State {
    /// Wakes what is due and sets the alarm for what comes next.
    fn arm(&mut self) {
        let now = self.clock.now();
        let wait_us = self.queue.next_expiration(now).saturating_sub(now).min(LONGEST_ALARM_US) as u32;
        // Counted from the start of the present microsecond, of which a part is over.
        let elapsed = counts().wrapping_sub(self.clock.counts);
        set_alarm((wait_us * COUNTS_PER_US).saturating_sub(elapsed).max(1));
    }
}

/// Raises the interrupt once, after so many counts.
fn set_alarm(counts: u32) {
    let alarm = timer::<1>();
    alarm.control.write(0);
    alarm.interrupt.write(1);
    alarm.value.write(counts);
    alarm.control.write(ENABLE | INTERRUPT_ENABLE);
}

struct Mps2Time {
    state: Mutex<CriticalSectionRawMutex, RefCell<State>>,
    started: AtomicBool,
}

impl Mps2Time {
    fn with<R>(&self, f: impl FnOnce(&mut State) -> R) -> R {
        // May panic: not so, since nothing that is called from here comes back to it.
        self.state.lock(|state| f(&mut state.borrow_mut()))
    }
}

impl Driver for Mps2Time {
    fn now(&self) -> u64 {
        if self.started.load(Ordering::Relaxed) { self.with(|state| state.clock.now()) } else { 0 }
    }

    fn schedule_wake(&self, at: u64, waker: &Waker) {
        self.with(|state| {
            if state.queue.schedule_wake(at, waker) {
                state.arm();
            }
        });
    }
}

embassy_time_driver::time_driver_impl!(static DRIVER: Mps2Time = Mps2Time {
    state: Mutex::new(RefCell::new(State { clock: Clock { micros: 0, counts: 0 }, queue: Queue::new() })),
    started: AtomicBool::new(false),
});

/// Starts the clock at 0. Call once, before anything that waits.
pub fn start() {
    let clock = timer::<0>();
    clock.control.write(0);
    clock.reload.write(u32::MAX);
    clock.value.write(u32::MAX);
    clock.control.write(ENABLE);
    timer::<1>().reload.write(0);
    DRIVER.started.store(true, Ordering::Relaxed);
    DRIVER.with(State::arm);
    interrupt::enable(Interrupt::TIMER_1);
}

/// Interrupt handler of timer 1.
pub(super) fn on_alarm() {
    timer::<1>().interrupt.write(1);
    DRIVER.with(State::arm);
}
