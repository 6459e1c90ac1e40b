//! Both planes on a serial line.

use core::sync::atomic::{AtomicU32, Ordering};

use embedded_io_async::{Read, Write};
use funnelnet_protocol::message::Message;
use funnelnet_protocol::report::Losses;
use funnelnet_protocol::serial::{self, MAX_FRAME};
use funnelnet_protocol::service::{MAX_REPLY_BODY, Reply};

use super::receiving::Receiving;
use super::{Health, Input, Link};
use crate::clock::Clock;

/// Longest reply before COBS: kind, source, body, CRC.
const MAX_RAW: usize = 2 + MAX_REPLY_BODY + 2;
/// Longest reply on the wire: COBS adds one byte in 254, and the final zero.
pub(super) const MAX_REPLY: usize = MAX_RAW + 2;

/// Frames on a UART whose `read` loses nothing when it is dropped.
///
/// A send waits until the driver has room. Latest value wins all the same, since the session makes a frame
/// only when the one before it has been taken.
pub struct Serial<U> {
    pub(super) uart: U,
    receiving: Receiving<MAX_FRAME>,
    failures: u32,
    errors: Option<&'static AtomicU32>,
    unsaid: Option<&'static AtomicU32>,
}

impl<U: Read + Write> Serial<U> {
    /// A link on this UART.
    pub fn new(uart: U) -> Self {
        Self { uart, receiving: Receiving::new(), failures: 0, errors: None, unsaid: None }
    }

    /// The same with the number of errors that its driver counts, and of which no read fails.
    #[must_use]
    pub fn with_errors(self, errors: &'static AtomicU32) -> Self {
        Self { errors: Some(errors), ..self }
    }

    /// The same with the number of frames for which its driver had no room, and of which no write fails.
    #[must_use]
    pub fn with_unsaid(self, unsaid: &'static AtomicU32) -> Self {
        Self { unsaid: Some(unsaid), ..self }
    }

    /// Counts a write that has failed.
    pub(super) fn note_failure(&mut self) {
        self.failures = self.failures.saturating_add(1);
    }

    /// Errors of this line.
    pub(super) fn errors(&self) -> u32 {
        let of_driver = self.errors.map_or(0, |errors| errors.load(Ordering::Relaxed));
        of_driver.saturating_add(self.failures).saturating_add(self.receiving.failures())
    }

    /// What is lost of a frame fails its check at the receiver; here it is only counted.
    async fn write(&mut self, frame: &[u8]) {
        if self.uart.write_all(frame).await.is_err() {
            self.note_failure();
        }
    }
}

/// Puts a reply of the node `source` into `frame`; gives its length.
pub(super) fn encode_reply(reply: &Reply, source: u8, frame: &mut [u8; MAX_REPLY]) -> usize {
    let length = serial::encode_service(reply, source, &mut [0; MAX_RAW], frame);
    #[cfg(feature = "defmt")]
    if length.is_none() {
        defmt::error!("a reply does not fit its frame; not sent");
    }
    length.unwrap_or(0)
}

impl<U: Read + Write> Link for Serial<U> {
    async fn wait(&mut self, clock: impl Clock) {
        self.receiving.wait(&mut self.uart, clock).await;
    }

    fn next(&mut self, _: u64) -> Option<Input<'_>> {
        self.receiving.next().map(Input::Frame)
    }

    async fn send(&mut self, message: &Message, _: u64) {
        self.write(&serial::encode(message)).await;
    }

    async fn reply(&mut self, reply: &Reply, source: u8) {
        let mut frame = [0; MAX_REPLY];
        let length = encode_reply(reply, source, &mut frame);
        self.write(frame.get(..length).unwrap_or(&frame)).await;
    }

    fn health(&self) -> Health {
        let unsaid = self.unsaid.map_or(0, |unsaid| unsaid.load(Ordering::Relaxed));
        let losses = Losses { line_errors: self.errors(), unsaid, ..Losses::default() };
        Health { losses, ..Health::default() }
    }
}
