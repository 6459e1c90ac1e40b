//! Both planes on a serial line.

use embassy_time::Timer;
use embedded_io_async::{Read, Write};
use funnel_protocol::message::Message;
use funnel_protocol::serial::{self, Deframer};
use funnel_protocol::service::{MAX_REPLY_BODY, Reply};

use super::{Health, Input, Link};

/// Longest reply before COBS: kind, source, body, CRC.
const MAX_RAW: usize = 2 + MAX_REPLY_BODY + 2;
/// Longest reply on the wire: COBS adds one byte in 254, and the final zero.
const MAX_REPLY: usize = MAX_RAW + 2;
/// Pause after a failed read: one that fails at once, again and again, must leave time for the ticks.
const PAUSE_MS: u64 = 1;

/// Frames on a UART whose `read` loses nothing when it is dropped.
///
/// A send waits until the driver has room. Latest value wins all the same, since the session makes a frame only when the one
/// before it has been taken.
pub struct Serial<U> {
    uart: U,
    deframer: Deframer,
    bytes: [u8; 64],
    /// Bytes of `bytes` that are not deframed yet.
    waiting: core::ops::Range<usize>,
    /// Whether the deframer holds the beginning of a frame.
    inside: bool,
    failures: u32,
}

impl<U: Read + Write> Serial<U> {
    /// A link on this UART.
    pub fn new(uart: U) -> Self {
        Self { uart, deframer: Deframer::new(), bytes: [0; 64], waiting: 0..0, inside: false, failures: 0 }
    }

    /// What is lost of a frame fails its check at the receiver; here it is only counted.
    async fn write(&mut self, frame: &[u8]) {
        if self.uart.write_all(frame).await.is_err() {
            self.failures = self.failures.saturating_add(1);
        }
    }

    fn byte(&mut self) -> Option<u8> {
        self.bytes.get(self.waiting.next()?).copied()
    }
}

impl<U: Read + Write> Link for Serial<U> {
    async fn wait(&mut self) {
        if !self.waiting.is_empty() {
            return;
        }
        match self.uart.read(&mut self.bytes).await {
            Ok(count) => self.waiting = 0..count,
            Err(_) => {
                self.failures = self.failures.saturating_add(1);
                Timer::after_millis(PAUSE_MS).await;
            }
        }
    }

    fn next(&mut self) -> Option<Input<'_>> {
        while let Some(byte) = self.byte() {
            // Zeros between frames are idle.
            if byte == 0 && self.inside {
                self.inside = false;
                return self.deframer.push(byte).map(Input::Frame);
            }
            if byte != 0 {
                self.inside = true;
                let _ = self.deframer.push(byte);
            }
        }
        None
    }

    async fn send(&mut self, message: &Message) {
        self.write(&serial::encode(message)).await;
    }

    async fn reply(&mut self, reply: &Reply, source: u8) {
        let (mut scratch, mut frame) = ([0; MAX_RAW], [0; MAX_REPLY]);
        match serial::encode_service(reply, source, &mut scratch, &mut frame) {
            Some(length) => self.write(frame.get(..length).unwrap_or(&frame)).await,
            None => defmt::error!("a reply does not fit its frame; not sent"),
        }
    }

    fn health(&self) -> Health {
        Health { failures: self.failures, ..Health::default() }
    }
}
