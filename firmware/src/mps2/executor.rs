//! A thread-mode executor that sleeps by `WFI`.
//!
//! embassy's own sleeps by `WFE`, which QEMU executes as a no-operation: an idle node would keep a core of
//! the host busy and starve the others (five nodes on two cores: 11 exchanges of 12 bytes per second instead
//! of 405).
#![allow(unsafe_code)]

use core::sync::atomic::{AtomicBool, Ordering};

use embassy_executor::{Spawner, raw};

/// A task was woken since the last round of polling.
static WOKEN: AtomicBool = AtomicBool::new(false);

/// Called by embassy whenever a task is woken, from tasks and from interrupts.
#[unsafe(export_name = "__pender")]
fn pender(_context: *mut ()) {
    WOKEN.store(true, Ordering::Release);
}

/// Runs tasks in thread mode, and sleeps when there is nothing to do.
pub struct Executor {
    inner: raw::Executor,
}

impl Default for Executor {
    fn default() -> Self {
        Self::new()
    }
}

impl Executor {
    /// An executor without tasks.
    pub fn new() -> Self {
        Self { inner: raw::Executor::new(core::ptr::null_mut()) }
    }

    /// Calls `init` to spawn the first tasks, then runs for ever.
    pub fn run(&'static mut self, init: impl FnOnce(Spawner)) -> ! {
        let executor: &'static raw::Executor = &self.inner;
        init(executor.spawner());
        loop {
            WOKEN.store(false, Ordering::Relaxed);
            // SAFETY: the only call of `poll` on this executor, which is mutably borrowed for ever; it cannot
            // be reentrant because the pender only sets a flag.
            unsafe { executor.poll() };
            sleep_unless(&WOKEN);
        }
    }
}

/// A wake between the test and the sleep is not lost: with interrupts masked, `WFI` still returns when one is
/// pending, and its handler runs as soon as they are unmasked.
fn sleep_unless(woken: &AtomicBool) {
    cortex_m::interrupt::free(|_| {
        if !woken.load(Ordering::Acquire) {
            cortex_m::asm::dsb();
            cortex_m::asm::wfi();
        }
    });
}
