//! A defect puts the output in its safe position, leaves its cause and place for the next start, and resets the node.
//!
//! The emulated board ends its emulator instead, with an exit code, unless it is told to restart as hardware does.
#![allow(unsafe_code)]

use core::cell::Cell;
use core::panic::PanicInfo;
use core::sync::atomic::{AtomicBool, Ordering};

use cortex_m_rt::{ExceptionFrame, exception};
use critical_section::Mutex;
use funnel_protocol::service::ResetCause;

use crate::reset;

/// Exit code of the emulator after a panic: the one that Rust programs have on a host.
pub const PANIC_EXIT_CODE: i32 = 101;
/// Exit code of the emulator after a hard fault.
pub const FAULT_EXIT_CODE: i32 = 102;

/// Set by the first defect: one that happens while it is being reported must not be reported in turn.
static STOPPING: AtomicBool = AtomicBool::new(false);
/// A function that may be registered later.
type Hook = Cell<Option<fn()>>;

/// Puts the output in its safe position.
static SAFE_OUTPUT: Mutex<Hook> = Mutex::new(Cell::new(None));
/// Restarts the emulated board after a defect, as hardware does.
#[cfg(feature = "mps2-an386")]
static RESTART: AtomicBool = AtomicBool::new(false);

/// Registers what puts the output in its safe position after a defect. It runs with interrupts masked while the program may be in
/// any state: it shall write registers and nothing else.
pub fn on_defect(safe_output: fn()) {
    critical_section::with(|section| SAFE_OUTPUT.borrow(section).set(Some(safe_output)));
}

/// From now on a defect restarts the emulated board instead of ending the emulator.
#[cfg(feature = "mps2-an386")]
pub fn restart_after_defects() {
    RESTART.store(true, Ordering::Relaxed);
}

/// The body of a binary's `#[panic_handler]`: safe output, record, message and place to the log, restart.
pub fn report(info: &PanicInfo) -> ! {
    let line = info.location().map_or(0, |location| location.line());
    stop(ResetCause::Panic, line, || defmt::error!("{}", defmt::Display2Format(info)))
}

fn stop(cause: ResetCause, place: u32, log: impl FnOnce()) -> ! {
    cortex_m::interrupt::disable();
    // Nothing interrupts this, and the Cortex-M0+ has no swap.
    if !STOPPING.load(Ordering::Relaxed) {
        STOPPING.store(true, Ordering::Relaxed);
        reset::leave(cause, place);
        if let Some(safe_output) = critical_section::with(|section| SAFE_OUTPUT.borrow(section).get()) {
            safe_output();
        }
        log();
    }
    end(cause)
}

#[cfg(feature = "mps2-an386")]
fn end(cause: ResetCause) -> ! {
    if RESTART.load(Ordering::Relaxed) {
        reset::restart();
    }
    let code = if cause == ResetCause::HardFault { FAULT_EXIT_CODE } else { PANIC_EXIT_CODE };
    semihosting::process::exit(code)
}

#[cfg(not(feature = "mps2-an386"))]
fn end(_cause: ResetCause) -> ! {
    reset::restart()
}

// SAFETY: a fault handler may not assume that the interrupted code left its data in order. It reads the
// stacked frame and writes the log; a log call that was itself interrupted panics as "reentrant", which
// STOPPING turns into an end.
#[exception]
unsafe fn HardFault(frame: &ExceptionFrame) -> ! {
    stop(ResetCause::HardFault, frame.pc(), || {
        defmt::error!("hard fault at pc {=u32:#010x}, lr {=u32:#010x}", frame.pc(), frame.lr())
    })
}
