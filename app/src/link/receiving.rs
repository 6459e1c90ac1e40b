//! From the bytes of a serial line to frames.

use core::ops::Range;
use core::task::Poll;

use embassy_futures::poll_once;
use embedded_io_async::Read;
use funnelnet_protocol::refusal::Refusal;
use funnelnet_protocol::serial::{Deframer, Frame};

use crate::clock::Clock;

/// Pause after a failed read, ns: one that fails at once, again and again, must leave time for the ticks.
const PAUSE_NS: u64 = 1_000_000;

/// Takes frames of up to `LONGEST` bytes from a UART whose `read` loses nothing when it is dropped.
pub struct Receiving<const LONGEST: usize> {
    deframer: Deframer<LONGEST>,
    bytes: [u8; 64],
    /// Bytes of `bytes` that are not deframed yet.
    waiting: Range<usize>,
    /// Whether the deframer holds the beginning of a frame.
    inside: bool,
    failures: u32,
}

impl<const LONGEST: usize> Receiving<LONGEST> {
    /// Nothing has come yet.
    pub const fn new() -> Self {
        Self { deframer: Deframer::new(), bytes: [0; 64], waiting: 0..0, inside: false, failures: 0 }
    }

    /// Whether bytes wait for [`Receiving::next`].
    pub fn has_bytes(&self) -> bool {
        !self.waiting.is_empty()
    }

    /// Waits for bytes, unless some wait already.
    pub async fn wait(&mut self, uart: &mut impl Read, clock: impl Clock) {
        if self.has_bytes() {
            return;
        }
        match uart.read(&mut self.bytes).await {
            Ok(count) => self.waiting = 0..count + self.read_rest(uart, count),
            Err(_) => {
                self.failures = self.failures.saturating_add(1);
                clock.wait_until(clock.now() + PAUSE_NS).await;
            }
        }
    }

    /// Reads what else is there behind the first `count` bytes; gives how many. A driver with a ring gives what is in front of its end first, and a
    /// frame behind that would be late by a turn of the app: 1.6 % of a period of 1 ms on an RP2040.
    fn read_rest(&mut self, uart: &mut impl Read, count: usize) -> usize {
        let Some(free) = self.bytes.get_mut(count..).filter(|free| !free.is_empty()) else { return 0 };
        match poll_once(uart.read(free)) {
            Poll::Ready(Ok(more)) => more,
            Poll::Ready(Err(_)) => {
                self.failures = self.failures.saturating_add(1);
                0
            }
            Poll::Pending => 0,
        }
    }

    /// The next frame of the bytes that wait, or the reason for refusing one.
    pub fn next(&mut self) -> Option<Result<Frame<'_>, Refusal>> {
        while let Some(byte) = self.byte() {
            // Zeros between frames are idle.
            if byte == 0 && self.inside {
                self.inside = false;
                return self.deframer.push(byte);
            }
            if byte != 0 {
                self.inside = true;
                let _ = self.deframer.push(byte);
            }
        }
        None
    }

    /// Reads that failed.
    pub fn failures(&self) -> u32 {
        self.failures
    }

    fn byte(&mut self) -> Option<u8> {
        self.bytes.get(self.waiting.next()?).copied()
    }
}
