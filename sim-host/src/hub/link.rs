//! One node's serial line, as a stream of frames.

use super::HubError;
use crate::interrupt::Interrupt;
use funnel_protocol::Refusal;
use funnel_protocol::message::Message;
use funnel_protocol::serial::{self, Deframer, Frame, HOST, MAX_FRAME, MAX_RAW};
use funnel_protocol::service::{Body, Reply, Request};
use std::collections::VecDeque;
use std::io::{ErrorKind, Read, Write};
use std::time::{Duration, Instant};

/// How long a read or a write of a [`Stream`] may block: how often a link looks at the clock and at the user's wish to stop.
pub const SLICE: Duration = Duration::from_millis(50);
/// How long a node may leave its serial line unread, once the operating system's buffers are full.
const WRITE: Duration = Duration::from_secs(5);
/// Bytes of one write: a terminal that says it has room has it for so many, so that no write blocks.
const CHUNK: usize = 256;
/// Ends whatever noise has left in the node's receiver; nodes ignore zeros between frames.
const IDLE: u8 = 0;

/// Bytes to and from a node. A read without bytes, or a write without room, fails with `WouldBlock` or `TimedOut` after [`SLICE`].
pub trait Stream: Read + Write + Send {}

impl<S: Read + Write + Send> Stream for S {}

/// What a node said.
pub enum Received {
    /// Real-time plane.
    Message(Message),
    /// Service plane.
    Reply(Reply),
}

/// A node's serial line, seen from the host.
pub struct Link {
    id: u8,
    place: String,
    stream: Box<dyn Stream>,
    interrupt: Interrupt,
    deframer: Deframer,
    received: VecDeque<Received>,
    /// Bytes that wait for [`Link::flush`]: all frames of a tick go out in one write.
    queued: Vec<u8>,
    write_limit: Duration,
    /// Frames that could not be read, and why the last of them.
    refused: (u64, Option<Refusal>),
}

impl Link {
    /// The link of node `id`, which messages call `place`: `the emulator`, for example.
    pub fn new(id: u8, place: String, stream: Box<dyn Stream>, interrupt: Interrupt) -> Self {
        Self {
            id,
            place,
            stream,
            interrupt,
            deframer: Deframer::new(),
            received: VecDeque::new(),
            queued: Vec::new(),
            write_limit: WRITE,
            refused: (0, None),
        }
    }

    /// The node's id.
    pub fn id(&self) -> u8 {
        self.id
    }

    /// What the node is reached by.
    pub fn place(&self) -> &str {
        &self.place
    }

    /// Frames from the node that could not be read so far, and why the last of them.
    pub fn refused(&self) -> (u64, Option<Refusal>) {
        self.refused
    }

    /// From now on a write takes no longer than `limit`, and the user's wish to stop, which has been heard, ends nothing.
    pub fn hurry(&mut self, limit: Duration) {
        self.interrupt = Interrupt::default();
        self.write_limit = limit;
        self.queued.clear();
    }

    /// Goes on with another stream to the same node, and forgets what the old one has left.
    pub fn replace(&mut self, stream: Box<dyn Stream>) {
        self.stream = stream;
        self.deframer = Deframer::new();
        self.received.clear();
        self.queued.clear();
    }

    /// Keeps bytes for the next flush.
    pub fn queue(&mut self, bytes: &[u8]) {
        self.queued.extend_from_slice(bytes);
    }

    /// Writes everything that is queued.
    ///
    /// # Errors
    /// As [`Link::write`].
    pub fn flush(&mut self) -> Result<(), HubError> {
        let queued = std::mem::take(&mut self.queued);
        if queued.is_empty() { Ok(()) } else { self.write(&queued) }
    }

    /// Writes whole frames at once.
    ///
    /// # Errors
    /// The node is gone, or leaves its line unread, or an interrupt.
    pub fn write(&mut self, frames: &[u8]) -> Result<(), HubError> {
        let begin = Instant::now();
        let bytes = [&[IDLE], frames].concat();
        let mut rest = bytes.as_slice();
        while !rest.is_empty() {
            if self.interrupt.is_set() {
                return Err(HubError::Interrupted);
            }
            let chunk = rest.get(..CHUNK).unwrap_or(rest);
            match self.stream.write(chunk) {
                Ok(0) => return Err(self.died("its serial line takes no bytes")),
                Ok(length) => rest = rest.get(length..).unwrap_or(&[]),
                Err(error) if !is_pause(error.kind()) => return Err(self.died(&error.to_string())),
                Err(_) if begin.elapsed() > self.write_limit => {
                    return Err(HubError::NoAnswer {
                        node: self.id,
                        awaited: "reading of its serial line",
                        waited: self.write_limit,
                    });
                }
                Err(_) => {}
            }
        }
        Ok(())
    }

    /// Sends a request.
    ///
    /// # Errors
    /// As [`Link::write`].
    pub fn request(&mut self, request: &Request) -> Result<(), HubError> {
        let (mut scratch, mut frame) = ([0; MAX_RAW], [0; MAX_FRAME]);
        let length = serial::encode_service(request, HOST, &mut scratch, &mut frame).unwrap_or(0);
        self.write(frame.get(..length).unwrap_or(&frame))
    }

    /// Waits until `pick` takes something that the node said; what it does not take is dropped.
    ///
    /// # Errors
    /// Nothing within `limit`, the node is gone, or an interrupt.
    pub fn wait_for<T>(
        &mut self,
        limit: Duration,
        awaited: &'static str,
        mut pick: impl FnMut(Received) -> Option<T>,
    ) -> Result<T, HubError> {
        let begin = Instant::now();
        loop {
            while let Some(received) = self.received.pop_front() {
                if let Some(picked) = pick(received) {
                    return Ok(picked);
                }
            }
            if self.interrupt.is_set() {
                return Err(HubError::Interrupted);
            }
            if begin.elapsed() > limit {
                return Err(HubError::NoAnswer { node: self.id, awaited, waited: limit });
            }
            self.read()?;
        }
    }

    fn read(&mut self) -> Result<(), HubError> {
        let mut bytes = [0; 1024];
        let length = match self.stream.read(&mut bytes) {
            Ok(0) => return Err(self.died("its serial line was closed")),
            Ok(length) => length,
            Err(error) if is_pause(error.kind()) => return Ok(()),
            Err(error) => return Err(self.died(&error.to_string())),
        };
        for &byte in bytes.iter().take(length) {
            // A frame that cannot be read is as good as none: whoever waits for it runs into the time limit.
            match self.deframer.push(byte).map(|frame| frame.and_then(received)) {
                Some(Ok(received)) => self.received.push_back(received),
                Some(Err(reason)) => self.refused = (self.refused.0.saturating_add(1), Some(reason)),
                None => {}
            }
        }
        Ok(())
    }

    fn died(&self, detail: &str) -> HubError {
        HubError::Died { node: self.id, place: self.place.clone(), detail: detail.to_owned() }
    }
}

/// Nothing came or went within a [`SLICE`]; try again.
fn is_pause(kind: ErrorKind) -> bool {
    matches!(kind, ErrorKind::WouldBlock | ErrorKind::TimedOut | ErrorKind::Interrupted)
}

fn received(frame: Frame<'_>) -> Result<Received, Refusal> {
    match frame {
        Frame::RealTime(message) => Ok(Received::Message(message)),
        Frame::Service { kind, body, .. } => Reply::decode(kind, body).map(Received::Reply),
    }
}
