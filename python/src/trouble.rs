//! The first exception of a callable of the user's, which ends the work.

use pyo3::prelude::*;
use sim_host::interrupt::Interrupt;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, PoisonError};

/// Keeps the first exception, and stops the work. Clones share both.
#[derive(Clone, Default)]
pub struct Trouble {
    first: Arc<Mutex<Option<PyErr>>>,
    is_armed: Arc<AtomicBool>,
    interrupt: Interrupt,
}

impl Trouble {
    /// The flag that stops the work.
    pub fn interrupt(&self) -> &Interrupt {
        &self.interrupt
    }

    /// From now on an exception counts. Before, fields are looked at where no node may ever come to.
    pub fn arm(&self) {
        self.is_armed.store(true, Ordering::Relaxed);
    }

    /// Takes an exception of a field.
    pub fn of_field(&self, error: PyErr) {
        if self.is_armed.load(Ordering::Relaxed) {
            self.put(error);
        }
    }

    /// Takes an exception that ends the work.
    pub fn put(&self, error: PyErr) {
        self.first.lock().unwrap_or_else(PoisonError::into_inner).get_or_insert(error);
        self.interrupt.set();
    }

    /// The first one.
    pub fn take(&self) -> Option<PyErr> {
        self.first.lock().unwrap_or_else(PoisonError::into_inner).take()
    }
}
