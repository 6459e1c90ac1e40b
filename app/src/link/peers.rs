//! A serial line to a host, with both planes, and serial lines to neighbours, one each (protocol/README.md,
//! "Nodes on lines to each other").

use core::future::pending;
use core::ops::Range;
use core::sync::atomic::{AtomicU32, Ordering};

use embassy_futures::poll_once;
use embassy_futures::select::{select, select_array};
use embedded_io_async::{Read, Write};
use funnelnet_link::{Forwarder, HOST_LINE};
use funnelnet_protocol::message::Message;
use funnelnet_protocol::refusal::Refusal;
use funnelnet_protocol::report::Losses;
use funnelnet_protocol::serial::{self, Frame, MAX_FRAME, MAX_REAL_TIME_FRAME};
use funnelnet_protocol::service::Reply;
use static_cell::StaticCell;

use super::receiving::Receiving;
use super::serial::{MAX_REPLY, encode_reply};
use super::{Health, Input, Link};
use crate::clock::Clock;

/// A line to a neighbour, which carries the real-time plane alone.
type PeerLine<R, W> = Line<R, W, MAX_REAL_TIME_FRAME, MAX_REAL_TIME_FRAME>;

/// A node with a line to a host and `PEERS` lines to neighbours, on UARTs whose `read` and `write` lose
/// nothing when they are dropped.
///
/// A frame of the real-time plane waits for each line by itself, so that none holds up another. A reply waits
/// for the host's line alone.
pub struct Peers<HR, HW, R, W, const PEERS: usize> {
    host: Line<HR, HW, MAX_FRAME, MAX_REPLY>,
    peers: [PeerLine<R, W>; PEERS],
    forwarder: &'static mut Forwarder<PEERS>,
    errors: Option<&'static AtomicU32>,
}

impl<HR: Read, HW: Write, R: Read, W: Write, const PEERS: usize> Peers<HR, HW, R, W, PEERS> {
    /// A node on these UARTs: of each the half that writes and the half that reads. It is large, as
    /// `forwarder` is, and made in `place`.
    ///
    /// # Panics
    /// `place` is taken.
    // Not into its caller, whose frame would keep up to 3.4 KiB for moving lines as long as the node runs.
    #[inline(never)]
    pub fn make(
        place: &'static StaticCell<Self>,
        host: (HW, HR),
        peers: [(W, R); PEERS],
        forwarder: &'static mut Forwarder<PEERS>,
    ) -> &'static mut Self {
        place.init_with(|| Self {
            host: Line::new(host),
            peers: peers.map(Line::new),
            forwarder,
            errors: None,
        })
    }

    /// Counts errors that the drivers of all lines count, and of which no read fails.
    pub fn count_errors(&mut self, errors: &'static AtomicU32) {
        self.errors = Some(errors);
    }

    /// Gives every line as much as it has room for.
    fn write(&mut self) {
        let Self { host, peers, forwarder, .. } = self;
        host.writing.write_from(HOST_LINE, forwarder);
        for (peer, line) in peers.iter_mut().zip(HOST_LINE + 1..) {
            peer.writing.write_from(line, forwarder);
        }
    }

    /// Takes what has come on every line, so that none that never falls silent keeps the others out.
    fn read(&mut self, clock: impl Clock) {
        let _ = poll_once(self.host.reading.read(clock));
        for peer in &mut self.peers {
            let _ = poll_once(peer.reading.read(clock));
        }
    }

    fn has_bytes(&self) -> bool {
        let peers = self.peers.iter().any(|peer| peer.reading.receiving.has_bytes());
        peers || self.host.reading.receiving.has_bytes()
    }

    /// The next thing that neighbours have said. Before the host: a state goes before the SYNC that came
    /// after it.
    fn next_of_peers(&mut self, now: u64) -> Option<Result<Message, Refusal>> {
        let Self { peers, forwarder, .. } = self;
        for (peer, line) in peers.iter_mut().zip(HOST_LINE + 1..) {
            while let Some(frame) = peer.reading.receiving.next() {
                match frame {
                    Ok(Frame::RealTime(message)) if !hear(forwarder, line, &message, now) => {}
                    Ok(Frame::RealTime(message)) => return Some(Ok(message)),
                    Ok(Frame::Service { .. }) => return Some(Err(Refusal::Kind)),
                    Err(reason) => return Some(Err(reason)),
                }
            }
        }
        None
    }

    /// The same for the host. After a copy there is none, and the next wait is none either.
    fn next_of_host(&mut self, now: u64) -> Option<Result<Frame<'_>, Refusal>> {
        let Self { host, forwarder, .. } = self;
        let frame = host.reading.receiving.next()?;
        match frame {
            Ok(Frame::RealTime(message)) if !hear(forwarder, HOST_LINE, &message, now) => None,
            frame => Some(frame),
        }
    }
}

impl<HR: Read, HW: Write, R: Read, W: Write, const PEERS: usize> Link for Peers<HR, HW, R, W, PEERS> {
    async fn wait(&mut self, clock: impl Clock) {
        self.write();
        if !self.has_bytes() {
            let peers = select_array(self.peers.each_mut().map(|peer| peer.work(clock)));
            select(self.host.work(clock), peers).await;
        }
        self.read(clock);
    }

    fn next(&mut self, now: u64) -> Option<Input<'_>> {
        match self.next_of_peers(now) {
            Some(message) => Some(Input::Frame(message.map(Frame::RealTime))),
            None => self.next_of_host(now).map(Input::Frame),
        }
    }

    async fn send(&mut self, message: &Message, now: u64) {
        self.forwarder.send(message, ms(now));
    }

    async fn reply(&mut self, reply: &Reply, source: u8) {
        // What was said before goes first.
        loop {
            self.write();
            if self.host.writing.is_idle() {
                break;
            }
            let peers = select_array(self.peers.each_mut().map(|peer| peer.writing.write()));
            select(self.host.writing.write(), peers).await;
        }
        let host = &mut self.host.writing;
        host.left = 0..encode_reply(reply, source, &mut host.frame);
        self.write();
    }

    fn health(&self) -> Health {
        let peers = self.peers.iter().map(Line::failures);
        let reported = peers.fold(self.host.failures(), u32::saturating_add);
        let of_drivers = self.errors.map_or(0, |errors| errors.load(Ordering::Relaxed));
        let line_errors = reported.saturating_add(of_drivers);
        Health { losses: Losses { line_errors, ..Losses::default() }, ..Health::default() }
    }
}

/// Buffers of a driver, for a line to a neighbour. A longer one to send would hold values that are not the
/// latest any more; the one to receive is 5 ms at 1 Mbit/s.
pub struct PeerBuffers {
    transmit: [u8; 64],
    receive: [u8; 512],
}

impl PeerBuffers {
    /// Empty ones.
    pub const NEW: Self = Self { transmit: [0; 64], receive: [0; 512] };

    /// The one to send, and the one to receive.
    pub fn halves(&mut self) -> (&mut [u8], &mut [u8]) {
        (&mut self.transmit, &mut self.receive)
    }
}

/// Whether a message of `now` (ns) is for the node. It goes into the log where there was no room to pass it
/// on.
fn hear<const PEERS: usize>(
    forwarder: &mut Forwarder<PEERS>,
    line: usize,
    message: &Message,
    now: u64,
) -> bool {
    #[cfg(feature = "defmt")]
    let before = forwarder.dropped();
    let is_new = forwarder.hear(line, message, ms(now));
    #[cfg(feature = "defmt")]
    if forwarder.dropped() != before {
        defmt::warn!("no room to pass on: {}", message);
    }
    is_new
}

/// A time in ns, in ms.
fn ms(ns: u64) -> u64 {
    ns / 1_000_000
}

/// One UART, with frames of up to `LONGEST` bytes that come and `LONGEST_SENT` that go.
struct Line<R, W, const LONGEST: usize, const LONGEST_SENT: usize> {
    reading: Reading<R, LONGEST>,
    writing: Writing<W, LONGEST_SENT>,
}

struct Reading<R, const LONGEST: usize> {
    reader: R,
    receiving: Receiving<LONGEST>,
}

struct Writing<W, const LONGEST: usize> {
    writer: W,
    frame: [u8; LONGEST],
    /// Bytes of `frame` that are not written yet.
    left: Range<usize>,
    failures: u32,
}

impl<R: Read, W: Write, const LONGEST: usize, const LONGEST_SENT: usize> Line<R, W, LONGEST, LONGEST_SENT> {
    fn new((writer, reader): (W, R)) -> Self {
        Self {
            reading: Reading { reader, receiving: Receiving::new() },
            writing: Writing { writer, frame: [0; LONGEST_SENT], left: 0..0, failures: 0 },
        }
    }

    /// Waits until something has come or was written.
    async fn work(&mut self, clock: impl Clock) {
        select(self.writing.write(), self.reading.read(clock)).await;
    }

    fn failures(&self) -> u32 {
        self.writing.failures.saturating_add(self.reading.receiving.failures())
    }
}

impl<R: Read, const LONGEST: usize> Reading<R, LONGEST> {
    /// Waits for bytes, unless some wait already.
    async fn read(&mut self, clock: impl Clock) {
        self.receiving.wait(&mut self.reader, clock).await;
    }
}

impl<W: Write, const LONGEST: usize> Writing<W, LONGEST> {
    fn is_idle(&self) -> bool {
        self.left.is_empty()
    }

    /// Writes what there is room for: the rest of a frame, then what waits in `forwarder` for the line with
    /// this number.
    fn write_from<const PEERS: usize>(&mut self, line: usize, forwarder: &mut Forwarder<PEERS>) {
        while !self.is_idle() || self.load(forwarder.take(line)) {
            if poll_once(self.write()).is_pending() {
                return;
            }
        }
    }

    /// Whether there is a frame now.
    fn load(&mut self, message: Option<Message>) -> bool {
        if let Some(message) = message {
            let bytes = serial::encode(&message);
            self.frame.iter_mut().zip(&bytes).for_each(|(to, from)| *to = *from);
            self.left = 0..bytes.len();
        }
        !self.is_idle()
    }

    /// Waits until some of the frame is written; for ever where there is none. What is lost of a frame fails
    /// its check at the receiver.
    async fn write(&mut self) {
        let Some(bytes) = self.frame.get(self.left.clone()).filter(|bytes| !bytes.is_empty()) else {
            return pending().await;
        };
        match self.writer.write(bytes).await {
            Ok(count) if count > 0 => self.left.start += count,
            _ => {
                self.failures = self.failures.saturating_add(1);
                self.left = 0..0;
            }
        }
    }
}
