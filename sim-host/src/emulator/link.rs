//! One node's UART, as a stream of frames.

use super::EmulatorError;
use crate::interrupt::Interrupt;
use funnel_protocol::message::Message;
use funnel_protocol::serial::{self, Deframer, Frame, HOST, MAX_FRAME, MAX_RAW};
use funnel_protocol::service::{Body, Reply, Request};
use std::collections::VecDeque;
use std::io::{ErrorKind, Read, Write};
use std::os::unix::net::UnixStream;
use std::time::{Duration, Instant};

/// How often a blocked read looks at the clock and at the user's wish to stop.
const SLICE: Duration = Duration::from_millis(50);
/// How long a node may leave its serial line unread, once the operating system's buffers are full.
const WRITE: Duration = Duration::from_secs(5);

/// What a node said.
pub enum Received {
    /// Real-time plane.
    Message(Message),
    /// Service plane.
    Reply(Reply),
}

/// A node's UART, seen from the host.
pub struct Link {
    id: u8,
    stream: UnixStream,
    interrupt: Interrupt,
    deframer: Deframer,
    received: VecDeque<Received>,
    /// Bytes that wait for [`Link::flush`]: all frames of a tick go out in one write.
    queued: Vec<u8>,
}

impl Link {
    /// The link of node `id`.
    ///
    /// # Errors
    /// The operating system's.
    pub fn new(id: u8, stream: UnixStream, interrupt: Interrupt) -> Result<Self, EmulatorError> {
        stream.set_read_timeout(Some(SLICE)).map_err(EmulatorError::io("set a read timeout"))?;
        stream.set_write_timeout(Some(WRITE)).map_err(EmulatorError::io("set a write timeout"))?;
        let received = VecDeque::new();
        Ok(Self { id, stream, interrupt, deframer: Deframer::new(), received, queued: Vec::new() })
    }

    /// The node's id.
    pub fn id(&self) -> u8 {
        self.id
    }

    /// Keeps bytes for the next flush.
    pub fn queue(&mut self, bytes: &[u8]) {
        self.queued.extend_from_slice(bytes);
    }

    /// Writes everything that is queued.
    ///
    /// # Errors
    /// The emulator is gone.
    pub fn flush(&mut self) -> Result<(), EmulatorError> {
        let queued = std::mem::take(&mut self.queued);
        self.write(&queued)
    }

    /// Writes bytes at once.
    ///
    /// # Errors
    /// The emulator is gone.
    pub fn write(&mut self, bytes: &[u8]) -> Result<(), EmulatorError> {
        self.stream.write_all(bytes).map_err(|error| match error.kind() {
            ErrorKind::WouldBlock | ErrorKind::TimedOut => EmulatorError::NoAnswer {
                node: self.id,
                awaited: "reading of its serial line",
                waited: WRITE,
            },
            _ => self.died(&error.to_string()),
        })
    }

    /// Sends a request.
    ///
    /// # Errors
    /// The emulator is gone.
    pub fn request(&mut self, request: &Request) -> Result<(), EmulatorError> {
        let (mut scratch, mut frame) = ([0; MAX_RAW], [0; MAX_FRAME]);
        let length = serial::encode_service(request, HOST, &mut scratch, &mut frame).unwrap_or(0);
        self.write(frame.get(..length).unwrap_or(&frame))
    }

    /// Waits until `pick` takes something that the node said; what it does not take is dropped.
    ///
    /// # Errors
    /// Nothing within `limit`, the emulator is gone, or an interrupt.
    pub fn wait_for<T>(
        &mut self,
        limit: Duration,
        awaited: &'static str,
        mut pick: impl FnMut(Received) -> Option<T>,
    ) -> Result<T, EmulatorError> {
        let begin = Instant::now();
        loop {
            while let Some(received) = self.received.pop_front() {
                if let Some(picked) = pick(received) {
                    return Ok(picked);
                }
            }
            if self.interrupt.is_set() {
                return Err(EmulatorError::Interrupted);
            }
            if begin.elapsed() > limit {
                return Err(EmulatorError::NoAnswer { node: self.id, awaited, waited: limit });
            }
            self.read()?;
        }
    }

    fn read(&mut self) -> Result<(), EmulatorError> {
        let mut bytes = [0; 1024];
        let length = match self.stream.read(&mut bytes) {
            Ok(0) => return Err(self.died("its serial line was closed")),
            Ok(length) => length,
            Err(error) if matches!(error.kind(), ErrorKind::WouldBlock | ErrorKind::TimedOut) => {
                return Ok(());
            }
            Err(error) if error.kind() == ErrorKind::Interrupted => return Ok(()),
            Err(error) => return Err(self.died(&error.to_string())),
        };
        for &byte in bytes.iter().take(length) {
            // A frame that cannot be read is as good as none: whoever waits for it runs into the time limit.
            if let Some(Ok(frame)) = self.deframer.push(byte) {
                self.received.extend(received(frame));
            }
        }
        Ok(())
    }

    fn died(&self, detail: &str) -> EmulatorError {
        EmulatorError::Died { node: self.id, detail: detail.to_owned() }
    }
}

fn received(frame: Frame<'_>) -> Option<Received> {
    match frame {
        Frame::RealTime(message) => Some(Received::Message(message)),
        Frame::Service { kind, body, .. } => Reply::decode(kind, body).ok().map(Received::Reply),
    }
}
