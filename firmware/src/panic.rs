//! A defect puts the output in its safe position, leaves its cause and place for the next start, and resets the node.
//!
//! The emulated board ends its emulator instead, with an exit code, unless it is told to restart as hardware does.
#![allow(unsafe_code)]

use core::arch::naked_asm;
use core::cell::Cell;
use core::panic::PanicInfo;
use core::sync::atomic::{AtomicBool, Ordering};

use critical_section::Mutex;
use funnelnet_protocol::service::ResetCause;

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
#[cfg(feature = "_mps2")]
static RESTART: AtomicBool = AtomicBool::new(false);

/// Registers what puts the output in its safe position after a defect. It runs with interrupts masked while the program may be in
/// any state: it shall write registers and nothing else.
pub fn on_defect(safe_output: fn()) {
    critical_section::with(|section| SAFE_OUTPUT.borrow(section).set(Some(safe_output)));
}

/// From now on a defect restarts the emulated board instead of ending the emulator.
#[cfg(feature = "_mps2")]
pub fn restart_after_defects() {
    RESTART.store(true, Ordering::Relaxed);
}

/// The body of a binary's `#[panic_handler]`: safe output, record, message and place to the log, restart.
pub fn report(info: &PanicInfo) -> ! {
    let line = info.location().map_or(0, |location| location.line());
    stop(ResetCause::Panic, line, || defmt::error!("{}", defmt::Display2Format(info)))
}

/// What the hardware has found wrong with the memory at `address`; may be called by the NMI handler, where a fault would lock the core up.
pub fn memory_error(address: u32) -> ! {
    stop(ResetCause::HardFault, address, || defmt::error!("memory error at {=u32:#010x}", address))
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

#[cfg(feature = "_mps2")]
fn end(cause: ResetCause) -> ! {
    if RESTART.load(Ordering::Relaxed) {
        reset::restart();
    }
    let code = if cause == ResetCause::HardFault { FAULT_EXIT_CODE } else { PANIC_EXIT_CODE };
    semihosting::process::exit(code)
}

#[cfg(not(feature = "_mps2"))]
fn end(_cause: ResetCause) -> ! {
    reset::restart()
}

/// The handler of every fault. It has the whole stack for itself: the one that it comes from may be what has overflowed, then the processor
/// could not save anything on it, and nobody returns to it either way.
///
/// In assembly, since a function may use the stack before its first line. Where the saved registers are on the stack, it passes them on: pc and lr.
// SAFETY: cortex-m-rt's vector table wants exactly this symbol. It takes no argument and never returns.
#[unsafe(naked)]
#[unsafe(no_mangle)]
unsafe extern "C" fn HardFault() -> ! {
    naked_asm!(
        "mrs r3, MSP",
        "ldr r4, =_stack_start",
        "msr MSP, r4",
        "ldr r5, =_stack_end",
        "movs r2, #1",
        "cmp r3, r5",
        "blo 0f",
        "cmp r3, r4",
        "bhs 0f",
        "movs r2, #0",
        "ldr r0, [r3, #24]",
        "ldr r1, [r3, #20]",
        "0:",
        "bl {fault}",
        fault = sym fault,
    )
}

// A fault handler may not assume that the interrupted code left its data in order. It writes the record and the log; a log call that was
// itself interrupted panics as "reentrant", which STOPPING turns into an end.
extern "C" fn fault(pc: u32, lr: u32, overflowed: bool) -> ! {
    if overflowed {
        stop(ResetCause::HardFault, 0, || defmt::error!("hard fault: the stack has overflowed"))
    }
    stop(ResetCause::HardFault, pc, || {
        defmt::error!("hard fault at pc {=u32:#010x}, lr {=u32:#010x}", pc, lr)
    })
}
