//! What happens on a bus, for logs and tables.

use crate::counters::{Counters, Mode};
use crate::frame::{Frame, Id};
use crate::reader::ErrorKind;
use crate::wire::Field;

/// Something that happened at a controller. Times are those of sample points.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Event {
    /// When, ns.
    pub at: u64,
    /// The controller.
    pub node: usize,
    /// What.
    pub what: What,
}

/// What happened.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum What {
    /// It has sent a frame, and another has acknowledged.
    Sent {
        /// The frame.
        frame: Frame,
        /// Whether its sender was error-passive at the start, which a CAN FD frame tells.
        passive: bool,
        /// When the frame came into its transmit buffer, ns.
        ready: u64,
        /// When the start of this attempt was, ns.
        started: u64,
        /// Attempts before that ended in an error.
        errors: u32,
    },
    /// It has received a frame that its filter keeps.
    Received {
        /// Identifier.
        id: Id,
        /// Its FIFO had no room: the frame is lost.
        lost: bool,
    },
    /// It has lost the arbitration.
    LostArbitration {
        /// Identifier of its frame.
        id: Id,
        /// Identifier of the frame that went on, where one did.
        to: Option<Id>,
    },
    /// It has seen an error, and marks it.
    Error {
        /// Kind of error.
        kind: ErrorKind,
        /// Where in the frame.
        field: Field,
        /// Whether it was sending.
        sender: bool,
        /// Error counters after it.
        counters: Counters,
    },
    /// It has seen an overload, and marks it.
    Overload,
    /// It takes part in another way than before.
    Mode {
        /// How now.
        mode: Mode,
        /// Error counters.
        counters: Counters,
    },
}
