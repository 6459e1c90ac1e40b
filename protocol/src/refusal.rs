//! Why a frame was refused. Every reason has a counter of its own, and a refused frame changes nothing else.

use core::fmt;

use serde::{Deserialize, Serialize};

macro_rules! refusals {
    ($($(#[$doc:meta])* $name:ident = $text:literal,)*) => {
        /// Reason for refusing a frame.
        #[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
        #[cfg_attr(feature = "defmt", derive(defmt::Format))]
        #[repr(u8)]
        #[non_exhaustive]
        pub enum Refusal { $($(#[$doc])* $name,)* }

        impl Refusal {
            /// Every reason, in the order of their counters.
            pub const ALL: &'static [Self] = &[$(Self::$name,)*];
            /// Number of reasons.
            pub const COUNT: usize = Self::ALL.len();

            /// Short name, as in `summary.json`.
            pub const fn name(self) -> &'static str {
                match self { $(Self::$name => $text,)* }
            }
        }
    };
}

refusals! {
    /// Wrong number of bytes for its kind.
    Length = "length",
    /// No such kind of frame.
    Kind = "kind",
    /// A field has a value that this version does not define.
    Value = "value",
    /// Serial: not COBS.
    Cobs = "cobs",
    /// Serial: longer than the longest frame; dropped up to the next zero.
    Overflow = "overflow",
    /// Serial: checksum.
    Crc = "crc",
    /// A number is NaN or infinite.
    NotFinite = "not_finite",
    /// The state is beyond the configured limit.
    OutOfRange = "out_of_range",
    /// The frame carries the receiver's own id.
    OwnId = "own_id",
    /// The source is not a neighbour.
    UnknownSource = "unknown_source",
    /// The tick is outside the receiver's window.
    TickWindow = "tick_window",
    /// A newer state of this neighbour is already known.
    Stale = "stale",
    /// This tick of this neighbour is already known.
    Duplicate = "duplicate",
    /// Not in this phase (for example a state before the node is configured).
    Phase = "phase",
    /// The state has changed faster than the configured limit since the last one that was taken.
    TooFast = "too_fast",
    /// The edge is barred: too many values in a row could not be taken.
    Barred = "barred",
}

impl fmt::Display for Refusal {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "refused: {}", self.name())
    }
}

impl core::error::Error for Refusal {}
