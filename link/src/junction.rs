//! A node with several serial lines: one to a host, the others each to a neighbour. What it says goes where, and what it passes on
//! (protocol/README.md, "Nodes on lines to each other").
//!
//! Commands, SYNC and faults are numbered, and a node passes on only what is newer than what it has passed on. So on any graph of
//! lines a frame goes over each line at most once in each direction, and dies.

use crate::newest::Newest;
use crate::outbox::Outbox;
use funnel_protocol::message::{Command, Message, NodeId, Severity, TickStamp};
use funnel_protocol::refusal::Refusal;

/// The line to the host, by index.
pub const HOST_LINE: usize = 0;
/// Bits of a command's number, and of that of a SYNC.
const COMMAND_BITS: u8 = 8;
const SYNC_BITS: u8 = 24;
/// Bits of what orders the faults of a node: tick 16, severity 2, code 8, argument 16.
const FAULT_BITS: u8 = 42;
const SOURCES: usize = NodeId::MAX as usize;

/// The lines of one node, of which [`HOST_LINE`] leads to the host. Sans-IO: what a line has received goes in by [`Junction::hear`], and
/// what it is to send comes out of [`Junction::take`].
#[derive(Debug)]
pub struct Junction<const LINES: usize> {
    outboxes: [Outbox; LINES],
    command: Newest,
    sync: Newest,
    /// By source.
    faults: [Newest; SOURCES],
}

impl<const LINES: usize> Default for Junction<LINES> {
    fn default() -> Self {
        Self::new()
    }
}

impl<const LINES: usize> Junction<LINES> {
    /// Nothing waits, nothing was heard.
    pub const fn new() -> Self {
        Self {
            outboxes: [const { Outbox::new() }; LINES],
            command: Newest::NONE,
            sync: Newest::NONE,
            faults: [Newest::NONE; SOURCES],
        }
    }

    /// Takes what the node itself says at `now` (ms): it goes on all lines.
    pub fn send(&mut self, message: &Message, now: u64) {
        if let Message::Fault { source, code, severity, arg, tick } = *message {
            // So that it is known when it comes back on a ring.
            let _ = self.fault(source).take(fault_number(code.0, severity, arg, tick), FAULT_BITS, now);
        }
        self.outboxes.iter_mut().for_each(|outbox| outbox.put(*message));
    }

    /// Takes what `line` has received at `now` (ms), and passes it on where it concerns others.
    ///
    /// # Errors
    /// `Duplicate`: it has come before, or what is newer has. It is not for the node then.
    pub fn hear(&mut self, line: usize, message: &Message, now: u64) -> Result<(), Refusal> {
        match *message {
            // Each edge of the graph has its own line.
            Message::State { .. } | Message::Edge { .. } => Ok(()),
            // For this node alone, whoever else it may name.
            Message::Ctrl { arg: 0, .. } => Ok(()),
            Message::Ctrl { arg, command, .. } => {
                is_new(self.command.take(arg.into(), COMMAND_BITS, now))?;
                if command == Command::Start {
                    // Its ticks begin anew.
                    self.sync = Newest::NONE;
                }
                self.pass_to_peers(line, message);
                Ok(())
            }
            Message::Sync { previous_tick, .. } => {
                is_new(self.sync.take(previous_tick.value().into(), SYNC_BITS, now))?;
                self.pass_to_peers(line, message);
                Ok(())
            }
            Message::Fault { source, code, severity, arg, tick } => {
                let number = fault_number(code.0, severity, arg, tick);
                is_new(self.fault(source).take(number, FAULT_BITS, now))?;
                if line != HOST_LINE {
                    self.put(HOST_LINE, message);
                }
                self.pass_to_peers(line, message);
                Ok(())
            }
        }
    }

    /// The frame that `line` sends next.
    pub fn take(&mut self, line: usize) -> Option<Message> {
        self.outboxes.get_mut(line)?.take()
    }

    /// Whether nothing waits for `line`.
    pub fn is_empty(&self, line: usize) -> bool {
        self.outboxes.get(line).is_none_or(Outbox::is_empty)
    }

    /// Frames that had no room in a line's outbox so far, saturating.
    pub fn dropped(&self) -> u32 {
        self.outboxes.iter().fold(0, |sum, outbox| sum.saturating_add(outbox.dropped()))
    }

    /// Commands and SYNC come from the host, who need not hear them.
    fn pass_to_peers(&mut self, from: usize, message: &Message) {
        let peers = self.outboxes.iter_mut().enumerate().skip(HOST_LINE + 1);
        peers.filter(|&(line, _)| line != from).for_each(|(_, outbox)| outbox.put(*message));
    }

    fn put(&mut self, line: usize, message: &Message) {
        if let Some(outbox) = self.outboxes.get_mut(line) {
            outbox.put(*message);
        }
    }

    fn fault(&mut self, source: NodeId) -> &mut Newest {
        // Ids are 1 to SOURCES; `%` spares the compiler a check that cannot fail.
        &mut self.faults[usize::from(source.get()) % SOURCES]
    }
}

/// Orders the faults of a node: by tick, and of one tick a stop is newer than a warning. The number wraps with its tick.
fn fault_number(code: u8, severity: Severity, arg: u16, tick: TickStamp) -> u64 {
    let severity: u64 = match severity {
        Severity::Notice => 0,
        Severity::Warning => 1,
        Severity::Stopped => 2,
    };
    let tick = u64::from(tick.value() & 0xFFFF);
    tick << 26 | severity << 24 | u64::from(code) << 16 | u64::from(arg)
}

fn is_new(is_new: bool) -> Result<(), Refusal> {
    if is_new { Ok(()) } else { Err(Refusal::Duplicate) }
}
