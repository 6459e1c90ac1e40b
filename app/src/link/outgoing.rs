//! What a node on CAN has to say on its service line, without ever waiting for that line.

use core::ops::Range;
use core::task::Poll;

use embassy_futures::poll_once;
use embedded_io_async::{Read, Write};
use funnelnet_protocol::service::Reply;

use super::serial::{MAX_REPLY, Serial, encode_reply};

/// A frame that leaves, and one that waits behind it. Drivers have a buffer, too, that holds more.
///
/// Telemetry is said where there is room for it at once; whatever else there is may wait behind it, so that a
/// host that has asked for more telemetry than its line can carry is answered all the same. What then has no
/// room is counted.
pub struct Outgoing {
    frame: [u8; MAX_REPLY],
    /// Bytes of `frame` that are not written yet.
    left: Range<usize>,
    waiting: [u8; MAX_REPLY],
    /// Bytes of `waiting`; 0 where nothing waits.
    waiting_length: usize,
    unsaid: u32,
}

impl Outgoing {
    /// Nothing to say.
    pub const fn new() -> Self {
        Self { frame: [0; MAX_REPLY], left: 0..0, waiting: [0; MAX_REPLY], waiting_length: 0, unsaid: 0 }
    }

    /// Frames for which there was no room, saturating.
    pub fn unsaid(&self) -> u32 {
        self.unsaid
    }

    /// Says a reply of the node `source`.
    pub fn reply(&mut self, reply: &Reply, source: u8, line: &mut Serial<impl Read + Write>) {
        self.write(line);
        let may_wait = !matches!(reply, Reply::Telemetry(_));
        let Some(place) = self.place(may_wait) else { return };
        let length = encode_reply(reply, source, place);
        self.settle(length);
        self.write(line);
    }

    /// Says a frame.
    pub fn say(&mut self, bytes: &[u8], line: &mut Serial<impl Read + Write>) {
        self.write(line);
        let Some(place) = self.place(true) else { return };
        place.iter_mut().zip(bytes).for_each(|(to, from)| *to = *from);
        self.settle(bytes.len().min(MAX_REPLY));
        self.write(line);
    }

    /// Gives the line as much as it has room for.
    pub fn write(&mut self, line: &mut Serial<impl Read + Write>) {
        while let Some(bytes) = self.frame.get(self.left.clone()).filter(|bytes| !bytes.is_empty()) {
            match poll_once(line.uart.write(bytes)) {
                Poll::Pending => return,
                Poll::Ready(Ok(count)) if count > 0 => self.left.start += count,
                // What is lost of a frame fails its check at the receiver.
                Poll::Ready(_) => {
                    line.note_failure();
                    self.left = 0..0;
                }
            }
            if self.left.is_empty() {
                core::mem::swap(&mut self.frame, &mut self.waiting);
                self.left = 0..core::mem::take(&mut self.waiting_length);
            }
        }
    }

    /// Where the next frame goes; `None`, and counted, where there is no room.
    fn place(&mut self, may_wait: bool) -> Option<&mut [u8; MAX_REPLY]> {
        if self.left.is_empty() {
            return Some(&mut self.frame);
        }
        if may_wait && self.waiting_length == 0 {
            return Some(&mut self.waiting);
        }
        self.unsaid = self.unsaid.saturating_add(1);
        None
    }

    /// Takes note of the frame that was put into its [place](Self::place).
    fn settle(&mut self, length: usize) {
        if self.left.is_empty() {
            self.left = 0..length;
        } else {
            self.waiting_length = length;
        }
    }
}
