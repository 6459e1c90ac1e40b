//! A defect is reported in the log and stops the node; under an emulator it also ends the emulator.
//!
//! On hardware the node stands still with interrupts masked until it is reset: its last output stays. It sends no FAULT.
#![allow(unsafe_code)]

use core::panic::PanicInfo;
use core::sync::atomic::{AtomicBool, Ordering};

use cortex_m_rt::{ExceptionFrame, exception};

/// Exit code of the emulator after a panic: the one that Rust programs have on a host.
pub const PANIC_EXIT_CODE: i32 = 101;
/// Exit code of the emulator after a hard fault.
pub const FAULT_EXIT_CODE: i32 = 102;

/// Set by the first defect: one that happens while it is being reported must not be reported in turn.
static STOPPING: AtomicBool = AtomicBool::new(false);

/// The body of a binary's `#[panic_handler]`: logs message and place, then stops.
pub fn report(info: &PanicInfo) -> ! {
    stop(PANIC_EXIT_CODE, || defmt::error!("{}", defmt::Display2Format(info)))
}

fn stop(code: i32, log: impl FnOnce()) -> ! {
    cortex_m::interrupt::disable();
    // Nothing interrupts this, and the Cortex-M0+ has no swap.
    if !STOPPING.load(Ordering::Relaxed) {
        STOPPING.store(true, Ordering::Relaxed);
        log();
    }
    end(code)
}

#[cfg(feature = "mps2-an386")]
fn end(code: i32) -> ! {
    semihosting::process::exit(code)
}

#[cfg(not(feature = "mps2-an386"))]
fn end(_code: i32) -> ! {
    // A debugger reads the log even so; a semihosting call without one would be a hard fault.
    loop {
        cortex_m::asm::nop();
    }
}

// SAFETY: a fault handler may not assume that the interrupted code left its data in order. It reads the
// stacked frame and writes the log; a log call that was itself interrupted panics as "reentrant", which
// STOPPING turns into an exit.
#[exception]
unsafe fn HardFault(frame: &ExceptionFrame) -> ! {
    stop(FAULT_EXIT_CODE, || {
        defmt::error!("hard fault at pc {=u32:#010x}, lr {=u32:#010x}", frame.pc(), frame.lr())
    })
}
