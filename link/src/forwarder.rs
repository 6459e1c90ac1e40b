//! A node with several serial lines: one to a host, the others each to a neighbour. What it says goes where,
//! and what it passes on (protocol/README.md, "Nodes on lines to each other").
//!
//! It passes on commands, SYNC and faults, each once. So on any graph of lines a frame goes over each line at
//! most once in each direction, and dies.

use crate::flood_filter::{FloodFilter, Lines, Put};
use crate::line_queue::LineQueue;
use crate::sync_filter::SyncFilter;
use funnelnet_protocol::message::{Command, Message, TickStamp};

/// The line to the host, by index.
pub const HOST_LINE: usize = 0;
/// Most lines of a node to neighbours.
pub const MAX_PEERS: usize = Lines::BITS as usize - 1;
/// Commands within [`FORGET_MS`](crate::FORGET_MS) that are passed on at most.
pub const COMMANDS: usize = 16;
/// Faults within [`FORGET_MS`](crate::FORGET_MS) that are passed on at most: all nodes have one at once where
/// a host dies.
pub const FAULTS: usize = 128;

/// The lines of one node: [`HOST_LINE`] leads to the host, 1 to `PEERS` each to a neighbour. Sans-IO: what a
/// line has received goes in by [`Forwarder::hear`], and what it is to send comes out of [`Forwarder::take`].
#[derive(Debug)]
pub struct Forwarder<const PEERS: usize> {
    commands: FloodFilter<COMMANDS>,
    faults: FloodFilter<FAULTS>,
    sync: SyncFilter,
    for_host: LineQueue,
    for_peers: [LineQueue; PEERS],
    dropped: u32,
}

impl<const PEERS: usize> Default for Forwarder<PEERS> {
    fn default() -> Self {
        Self::new()
    }
}

impl<const PEERS: usize> Forwarder<PEERS> {
    const ALL: Lines = {
        assert!(PEERS <= MAX_PEERS);
        Lines::MAX >> (MAX_PEERS - PEERS)
    };
    const PEERS: Lines = Self::ALL & !bit(HOST_LINE);

    /// Nothing waits, nothing was heard.
    pub const fn new() -> Self {
        Self {
            commands: FloodFilter::new(),
            faults: FloodFilter::new(),
            sync: SyncFilter::NONE,
            for_host: LineQueue::new(),
            for_peers: [const { LineQueue::new() }; PEERS],
            dropped: 0,
        }
    }

    /// Takes what the node itself says at `now` (ms): it goes on all lines.
    pub fn send(&mut self, message: &Message, now: u64) {
        match as_on_the_wire(message) {
            // Remembered, so that it is known when it comes back on a ring.
            fault @ Message::Fault { .. } => drop(self.faults.put_own(fault, Self::ALL, now)),
            message => self.put_latest(&message, Self::ALL),
        }
    }

    /// Takes what `line` has received at `now` (ms), and lets it wait for the lines that it goes on to.
    /// Whether it is for the node: a copy of what has come before is not.
    pub fn hear(&mut self, line: usize, message: &Message, now: u64) -> bool {
        let others = Self::ALL & !bit(line);
        match *message {
            // Each edge of the graph has its own line.
            Message::State { .. } | Message::Edge { .. } => true,
            Message::Ctrl { arg, command, .. } => {
                // Without a number it is for this node alone, whoever else it may name.
                let put = match arg {
                    0 => Put::New,
                    _ => self.commands.put(*message, others & Self::PEERS, now),
                };
                if command == Command::Start && put != Put::Copy {
                    self.begin_anew();
                }
                self.is_new(put)
            }
            Message::Sync { previous_tick, .. } => {
                let is_new = self.sync.take(previous_tick, now);
                if is_new {
                    self.put_latest(message, others & Self::PEERS);
                }
                is_new
            }
            Message::Fault { .. } => {
                let put = self.faults.put(*message, others, now);
                self.is_new(put)
            }
        }
    }

    /// The frame that `line` sends next: commands before faults before the rest.
    pub fn take(&mut self, line: usize) -> Option<Message> {
        let urgent = self.commands.take(bit(line)).or_else(|| self.faults.take(bit(line)));
        urgent.or_else(|| self.latest().nth(line)?.take())
    }

    /// Frames so far that should have gone on and for which there was no room, saturating.
    pub fn dropped(&self) -> u32 {
        self.dropped
    }

    /// After a start the ticks begin anew. A SYNC of before that came after it would move the node to its
    /// tick.
    fn begin_anew(&mut self) {
        self.sync = SyncFilter::NONE;
        self.latest().for_each(LineQueue::drop_sync);
    }

    fn put_latest(&mut self, message: &Message, lines: Lines) {
        let lost =
            self.latest().enumerate().map(|(line, latest)| lines & bit(line) != 0 && !latest.put(*message));
        let lost = lost.filter(|&lost| lost).count() as u32;
        self.dropped = self.dropped.saturating_add(lost);
    }

    /// Line by line.
    fn latest(&mut self) -> impl Iterator<Item = &mut LineQueue> {
        core::iter::once(&mut self.for_host).chain(&mut self.for_peers)
    }

    /// The node itself takes also what it cannot remember: a stop always stops.
    fn is_new(&mut self, put: Put) -> bool {
        if put == Put::NoRoom {
            self.dropped = self.dropped.saturating_add(1);
        }
        put != Put::Copy
    }
}

const fn bit(line: usize) -> Lines {
    if line <= MAX_PEERS { 1 << line } else { 0 }
}

/// A fault with as much of its tick as a serial line carries, so that it equals its copies.
fn as_on_the_wire(message: &Message) -> Message {
    let mut message = *message;
    if let Message::Fault { tick, .. } = &mut message {
        *tick = TickStamp::low(tick.value(), 16);
    }
    message
}
