//! A lock-free byte ring between one interrupt handler and one task.

use core::sync::atomic::{AtomicU8, AtomicUsize, Ordering};

/// Holds up to `N` bytes; `N` is a power of two. One side may [`push`](Ring::push), one other may
/// [`pop`](Ring::pop).
///
/// Every cell is an atomic, so that a second producer or consumer would mix up bytes but never memory.
pub struct Ring<const N: usize> {
    cells: [AtomicU8; N],
    /// Bytes pushed since the start, written by the producer only.
    pushed: AtomicUsize,
    /// Bytes popped since the start, written by the consumer only.
    popped: AtomicUsize,
}

/// What became of a pushed byte.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Pushed {
    /// The ring was empty before: the consumer may be waiting.
    First,
    /// There was something in the ring: the consumer has been told.
    More,
    /// The ring was full: the byte is lost.
    Full,
}

impl<const N: usize> Default for Ring<N> {
    fn default() -> Self {
        Self::new()
    }
}

impl<const N: usize> Ring<N> {
    /// An empty ring.
    pub const fn new() -> Self {
        const { assert!(N.is_power_of_two()) };
        Self {
            cells: [const { AtomicU8::new(0) }; N],
            pushed: AtomicUsize::new(0),
            popped: AtomicUsize::new(0),
        }
    }

    /// Appends a byte (producer only).
    pub fn push(&self, byte: u8) -> Pushed {
        let pushed = self.pushed.load(Ordering::Relaxed);
        let held = pushed.wrapping_sub(self.popped.load(Ordering::Acquire));
        if held >= N {
            return Pushed::Full;
        }
        self.cells[pushed % N].store(byte, Ordering::Relaxed);
        self.pushed.store(pushed.wrapping_add(1), Ordering::Release);
        if held == 0 { Pushed::First } else { Pushed::More }
    }

    /// Moves as many bytes as there are, up to the length of `into`, and returns how many (consumer only).
    pub fn pop(&self, into: &mut [u8]) -> usize {
        let popped = self.popped.load(Ordering::Relaxed);
        let count = self.pushed.load(Ordering::Acquire).wrapping_sub(popped).min(into.len());
        for (offset, byte) in into[..count].iter_mut().enumerate() {
            *byte = self.cells[popped.wrapping_add(offset) % N].load(Ordering::Relaxed);
        }
        self.popped.store(popped.wrapping_add(count), Ordering::Release);
        count
    }
}
