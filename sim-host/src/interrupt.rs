//! The user's wish to stop (Ctrl-C, SIGTERM, SIGHUP), as a flag that long work looks at.

use std::io;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};

use signal_hook::consts::{SIGHUP, SIGINT, SIGTERM};
use signal_hook::flag;

use crate::exit::Exit;

/// A flag that is set once and never cleared, and which signal has set it.
#[derive(Clone, Debug, Default)]
pub struct Interrupt {
    set: Arc<AtomicBool>,
    /// Number of the signal; 0 where none came.
    signal: Arc<AtomicUsize>,
}

impl Interrupt {
    /// A flag that SIGINT, SIGTERM and SIGHUP set. A second signal ends the program at once.
    ///
    /// A SIGHUP that was ignored at the start (`nohup`) stays ignored.
    ///
    /// # Errors
    /// The operating system's.
    pub fn on_signals() -> io::Result<Self> {
        let interrupt = Self::default();
        for (signal, exit) in
            [(SIGINT, Exit::Interrupted), (SIGTERM, Exit::Interrupted), (SIGHUP, Exit::HungUp)]
        {
            if signal == SIGHUP && is_ignored(signal) {
                continue;
            }
            // In this order: the first signal finds the flag down, sets its number, and then the flag.
            let status = i32::from(exit as u8);
            flag::register_conditional_shutdown(signal, status, Arc::clone(&interrupt.set))?;
            flag::register_usize(
                signal,
                Arc::clone(&interrupt.signal),
                usize::try_from(signal).unwrap_or(0),
            )?;
            flag::register(signal, Arc::clone(&interrupt.set))?;
        }
        Ok(interrupt)
    }

    /// Sets it, as a signal would.
    pub fn set(&self) {
        self.set.store(true, Ordering::Relaxed);
    }

    /// Whether the user wants to stop.
    pub fn is_set(&self) -> bool {
        self.set.load(Ordering::Relaxed)
    }

    /// How the program ends for it.
    pub fn exit(&self) -> Exit {
        match i32::try_from(self.signal.load(Ordering::Relaxed)) {
            Ok(SIGHUP) => Exit::HungUp,
            _ => Exit::Interrupted,
        }
    }

    /// What has set it, for a message.
    pub fn by(&self) -> &'static str {
        match i32::try_from(self.signal.load(Ordering::Relaxed)) {
            Ok(SIGINT) => "SIGINT",
            Ok(SIGTERM) => "SIGTERM",
            Ok(SIGHUP) => "SIGHUP",
            _ => "a request",
        }
    }
}

/// Whether this process was started with `signal` ignored. Where the system does not say, it was not.
fn is_ignored(signal: i32) -> bool {
    let status = std::fs::read_to_string("/proc/self/status").unwrap_or_default();
    let mask = status.lines().find_map(|line| line.strip_prefix("SigIgn:"));
    let mask = mask.and_then(|mask| u64::from_str_radix(mask.trim(), 16).ok()).unwrap_or(0);
    mask >> (signal - 1) & 1 == 1
}
