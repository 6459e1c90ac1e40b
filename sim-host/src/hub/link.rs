//! One node's serial line: bytes out, and bytes in.

use super::HubError;
use crate::interrupt::Interrupt;
use serialport::TTYPort;
use std::io::{self, ErrorKind, Read, Write};
use std::os::unix::net::UnixStream;
use std::time::{Duration, Instant};

/// How long a read or a write of a [`Stream`] may block: how often a link looks at the clock and at the
/// user's wish to stop.
pub const SLICE: Duration = Duration::from_millis(50);
/// How long a node may leave its serial line unread, once the operating system's buffers are full.
const WRITE: Duration = Duration::from_secs(5);
/// Bytes of one write: a terminal that says it has room has it for so many, so that no write blocks.
const CHUNK: usize = 256;
/// Ends whatever noise has left in the node's receiver; nodes ignore zeros between frames.
const IDLE: u8 = 0;

/// Bytes to and from a node. A read without bytes, or a write without room, fails with `WouldBlock` or
/// `TimedOut` after [`SLICE`].
pub trait Stream: Read + Write + Send {
    /// A second handle, for a thread that reads while another one writes.
    ///
    /// # Errors
    /// The operating system's.
    fn reader(&self) -> io::Result<Box<dyn Read + Send>>;
}

impl Stream for UnixStream {
    fn reader(&self) -> io::Result<Box<dyn Read + Send>> {
        Ok(Box::new(self.try_clone()?))
    }
}

impl Stream for TTYPort {
    fn reader(&self) -> io::Result<Box<dyn Read + Send>> {
        Ok(Box::new(self.try_clone_native()?))
    }
}

/// A line that is gone.
impl Stream for io::Empty {
    fn reader(&self) -> io::Result<Box<dyn Read + Send>> {
        Ok(Box::new(io::empty()))
    }
}

/// A node's serial line, seen from the host.
pub struct Link {
    id: u8,
    place: String,
    stream: Box<dyn Stream>,
    interrupt: Interrupt,
    write_limit: Duration,
}

impl Link {
    /// The link of node `id`, which messages call `place`: `the emulator`, for example.
    pub fn new(id: u8, place: String, stream: Box<dyn Stream>, interrupt: Interrupt) -> Self {
        Self { id, place, stream, interrupt, write_limit: WRITE }
    }

    /// The node's id.
    pub fn id(&self) -> u8 {
        self.id
    }

    /// What the node is reached by.
    pub fn place(&self) -> &str {
        &self.place
    }

    /// From now on a write takes no longer than `limit`, and the user's wish to stop, which has been heard,
    /// ends nothing.
    pub fn hurry(&mut self, limit: Duration) {
        self.interrupt = Interrupt::default();
        self.write_limit = limit;
    }

    /// Goes on with another stream to the same node.
    pub fn replace(&mut self, stream: Box<dyn Stream>) {
        self.stream = stream;
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
            self.check_interrupt()?;
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

    /// Reads for a [`SLICE`] at most, and gives the number of bytes that came.
    ///
    /// # Errors
    /// The node is gone, or an interrupt.
    pub fn read(&mut self, bytes: &mut [u8]) -> Result<usize, HubError> {
        self.check_interrupt()?;
        match self.stream.read(bytes) {
            Ok(0) => Err(self.closed()),
            Ok(length) => Ok(length),
            Err(error) if is_pause(error.kind()) => Ok(0),
            Err(error) => Err(self.died(&error.to_string())),
        }
    }

    /// A second handle of its line, for a thread that reads.
    ///
    /// # Errors
    /// The operating system's.
    pub fn reader(&self) -> Result<Box<dyn Read + Send>, HubError> {
        self.stream.reader().map_err(HubError::io("share the line of a node"))
    }

    /// Fails once the user wants to stop.
    ///
    /// # Errors
    /// An interrupt.
    pub fn check_interrupt(&self) -> Result<(), HubError> {
        if self.interrupt.is_set() { Err(HubError::Interrupted) } else { Ok(()) }
    }

    /// That the line has come to its end.
    pub(super) fn closed(&self) -> HubError {
        self.died("its serial line was closed")
    }

    pub(super) fn died(&self, detail: &str) -> HubError {
        HubError::Died { node: self.id, place: self.place.clone(), detail: detail.to_owned() }
    }
}

/// Nothing came or went within a [`SLICE`]; try again.
pub(super) fn is_pause(kind: ErrorKind) -> bool {
    matches!(kind, ErrorKind::WouldBlock | ErrorKind::TimedOut | ErrorKind::Interrupted)
}
