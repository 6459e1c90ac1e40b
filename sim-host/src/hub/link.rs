//! One node's serial line, from the port to what the node has said.

use super::HubError;
use crate::conductor::{Line, Received};
use crate::interrupt::Interrupt;
use funnelnet_protocol::Refusal;
use funnelnet_protocol::serial::{self, HOST, MAX_FRAME, MAX_RAW};
use funnelnet_protocol::service::Request;
use serialport::TTYPort;
use std::io::{self, ErrorKind, Read, Write};
use std::os::unix::net::UnixStream;
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
    line: Line,
    place: String,
    stream: Box<dyn Stream>,
    interrupt: Interrupt,
    /// Bytes that wait for [`Link::flush`]: all frames of a tick go out in one write.
    queued: Vec<u8>,
    write_limit: Duration,
}

impl Link {
    /// The link of node `id`, which messages call `place`: `the emulator`, for example.
    pub fn new(id: u8, place: String, stream: Box<dyn Stream>, interrupt: Interrupt) -> Self {
        Self { line: Line::new(id), place, stream, interrupt, queued: Vec::new(), write_limit: WRITE }
    }

    /// From now on the node has its id: what another one says of itself is not taken from its line.
    pub fn expect_its_own(&mut self) {
        self.line.expect_its_own();
    }

    /// What the node has said whole and cannot mean, since the last call: what it did, and the value.
    pub fn take_doubts(&mut self) -> Vec<(&'static str, String)> {
        self.line.take_doubts()
    }

    /// The node's id.
    pub fn id(&self) -> u8 {
        self.line.id()
    }

    /// What the node is reached by.
    pub fn place(&self) -> &str {
        &self.place
    }

    /// Frames from the node that could not be read so far, and why the last of them.
    pub fn refused(&self) -> (u64, Option<Refusal>) {
        self.line.refused()
    }

    /// What its line sounds like, where that is not a node.
    pub fn sound(&self) -> Option<String> {
        self.line.sound()
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
        self.line.replace();
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
            self.check_interrupt()?;
            let chunk = rest.get(..CHUNK).unwrap_or(rest);
            match self.stream.write(chunk) {
                Ok(0) => return Err(self.died("its serial line takes no bytes")),
                Ok(length) => rest = rest.get(length..).unwrap_or(&[]),
                Err(error) if !is_pause(error.kind()) => return Err(self.died(&error.to_string())),
                Err(_) if begin.elapsed() > self.write_limit => {
                    return Err(HubError::NoAnswer {
                        node: self.line.id(),
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
        self.wait_until(Instant::now() + limit, limit, awaited, &mut pick)
    }

    /// The same until `end`, of which an error says that it was `limit` from the begin.
    ///
    /// # Errors
    /// As [`Link::wait_for`].
    pub fn wait_until<T>(
        &mut self,
        end: Instant,
        limit: Duration,
        awaited: &'static str,
        mut pick: impl FnMut(Received) -> Option<T>,
    ) -> Result<T, HubError> {
        loop {
            if let Some(picked) = self.line.pop_picked(&mut pick) {
                return Ok(picked);
            }
            self.check_interrupt()?;
            if Instant::now() > end {
                return Err(HubError::NoAnswer { node: self.line.id(), awaited, waited: limit });
            }
            self.read()?;
        }
    }

    /// Takes what the node has said, waiting for a slice at most, and gives the first thing that `pick` picks; all of it stays.
    ///
    /// # Errors
    /// The node is gone, or an interrupt.
    pub fn look<T>(&mut self, pick: impl Fn(&Received) -> Option<T>) -> Result<Option<T>, HubError> {
        self.check_interrupt()?;
        self.read()?;
        Ok(self.line.peek(pick))
    }

    /// A second handle of its line, for a thread that reads.
    ///
    /// # Errors
    /// The operating system's.
    pub fn reader(&self) -> Result<Box<dyn Read + Send>, HubError> {
        self.stream.reader().map_err(HubError::io("share the line of a node"))
    }

    /// The oldest thing that the node has said and nobody has taken.
    pub fn next_received(&mut self) -> Option<Received> {
        self.line.pop()
    }

    /// Fails once the user wants to stop.
    ///
    /// # Errors
    /// An interrupt.
    pub fn check_interrupt(&self) -> Result<(), HubError> {
        if self.interrupt.is_set() { Err(HubError::Interrupted) } else { Ok(()) }
    }

    fn read(&mut self) -> Result<(), HubError> {
        let mut bytes = [0; 1024];
        let read = self.stream.read(&mut bytes);
        self.take(read.map(|length| bytes.get(..length).unwrap_or(&bytes)))
    }

    /// Takes what a read of its line gave.
    ///
    /// # Errors
    /// The node is gone.
    pub fn take(&mut self, read: io::Result<&[u8]>) -> Result<(), HubError> {
        let bytes = match read {
            Ok([]) => return Err(self.died("its serial line was closed")),
            Ok(bytes) => bytes,
            Err(error) if is_pause(error.kind()) => return Ok(()),
            Err(error) => return Err(self.died(&error.to_string())),
        };
        self.line.on_bytes(bytes);
        Ok(())
    }

    fn died(&self, detail: &str) -> HubError {
        HubError::Died { node: self.line.id(), place: self.place.clone(), detail: detail.to_owned() }
    }
}

/// Nothing came or went within a [`SLICE`]; try again.
pub(super) fn is_pause(kind: ErrorKind) -> bool {
    matches!(kind, ErrorKind::WouldBlock | ErrorKind::TimedOut | ErrorKind::Interrupted)
}
