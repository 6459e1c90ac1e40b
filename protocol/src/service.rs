//! The service plane on serial links: identity, configuration, telemetry, report. Postcard bodies.

use core::fmt;

use crate::config::{ConfigError, NodeConfig};
use crate::refusal::Refusal;
use crate::report::{Report, Telemetry};
use serde::{Deserialize, Serialize};

/// Longest body of a [`Reply`], bytes: a report whose counters are all at their largest.
pub const MAX_REPLY_BODY: usize = 144;

/// Kinds of serial frame of the service plane.
pub mod kind {
    /// Host asks who is there; empty body.
    pub const HELLO: u8 = 0x40;
    /// Node answers with its identity.
    pub const IDENTITY: u8 = 0x41;
    /// Host sends a configuration.
    pub const CONFIGURE: u8 = 0x42;
    /// Node accepts it or says why not.
    pub const CONFIGURED: u8 = 0x43;
    /// Node reports what the law did at a tick.
    pub const TELEMETRY: u8 = 0x44;
    /// Host asks for the report; empty body.
    pub const REPORT_REQUEST: u8 = 0x45;
    /// Node answers with its counters.
    pub const REPORT: u8 = 0x46;
    /// Host asks the node to keep its configuration; empty body.
    pub const STORE: u8 = 0x47;
    /// Node has, or says why not.
    pub const STORED: u8 = 0x48;
    /// Host asks the node to be blank after its next start; empty body.
    pub const ERASE: u8 = 0x49;
    /// Node will be, or says why not.
    pub const ERASED: u8 = 0x4A;
}

/// Who a node is.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Identity {
    /// [`crate::WIRE_VERSION`] of the node.
    pub wire_version: u8,
    /// Firmware version: major, minor, patch.
    pub firmware: [u8; 3],
    /// Configured id, 0 while blank.
    pub id: u8,
    /// The chip's unique number, 0 where it has none.
    pub uid: u64,
    /// Why it started last.
    pub reset: ResetCause,
    /// How often it has started since power-on, this one included; 0 where it does not know.
    pub starts: u32,
}

/// What made a node start.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum ResetCause {
    /// The node cannot tell.
    #[default]
    Unknown,
    /// Its supply came.
    PowerOn,
    /// Its supply was too low for a moment.
    BrownOut,
    /// Its reset button or line.
    Pin,
    /// Its loop did not come round.
    Watchdog,
    /// A debugger, or its own wish.
    Software,
    /// Its firmware panicked.
    Panic,
    /// Its core took a hard fault.
    HardFault,
}

impl ResetCause {
    /// Whether something went wrong before this start.
    pub fn is_alarming(self) -> bool {
        matches!(self, Self::BrownOut | Self::Watchdog | Self::Panic | Self::HardFault)
    }
}

impl fmt::Display for ResetCause {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Unknown => "unknown",
            Self::PowerOn => "power-on",
            Self::BrownOut => "brown-out",
            Self::Pin => "pin",
            Self::Watchdog => "watchdog",
            Self::Software => "software",
            Self::Panic => "panic",
            Self::HardFault => "hard fault",
        })
    }
}

/// Why a node has not stored its configuration, or erased the stored one.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum StoreError {
    /// The node is running; flash can stall it for longer than a tick.
    Running,
    /// It has no configuration.
    Blank,
    /// The board has no storage.
    Absent,
    /// The flash did not take it. What was stored before is still there.
    Failed,
}

impl fmt::Display for StoreError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Running => "the node is running: stop it before storing",
            Self::Blank => "the node has no configuration to store",
            Self::Absent => "the board has no storage",
            Self::Failed => "the flash did not take it",
        })
    }
}

impl core::error::Error for StoreError {}

/// What a host asks of a node.
#[derive(Clone, Debug, PartialEq)]
#[allow(clippy::large_enum_variant)] // no allocator to box a configuration with
pub enum Request {
    /// Who is there?
    Hello,
    /// Be this.
    Configure(NodeConfig),
    /// Report!
    Report,
    /// Be this after the next start, too.
    Store,
    /// Be blank after the next start.
    Erase,
}

/// What a node answers, or tells unasked.
#[derive(Clone, Debug, PartialEq)]
pub enum Reply {
    /// I am.
    Identity(Identity),
    /// I am what you configured, or I refuse.
    Configured(Result<(), ConfigError>),
    /// What the law did.
    Telemetry(Telemetry),
    /// Counters.
    Report(Report),
    /// I keep it: the epoch, which grows with every store and erase.
    Stored(Result<u32, StoreError>),
    /// I will be blank.
    Erased(Result<(), StoreError>),
}

/// A body that travels in a service frame.
pub trait Body: Sized {
    /// Kind of the frame.
    fn kind(&self) -> u8;

    /// Writes the body to the front of `out`; the number of bytes, or `None` where it does not fit.
    fn encode(&self, out: &mut [u8]) -> Option<usize>;

    /// Reads a body of `kind`.
    ///
    /// # Errors
    /// `Kind` for a kind that is not of this direction, `Length` for trailing bytes, `Value` for anything else that is
    /// not such a body.
    fn decode(kind: u8, body: &[u8]) -> Result<Self, Refusal>;
}

impl Body for Request {
    fn kind(&self) -> u8 {
        match self {
            Self::Hello => kind::HELLO,
            Self::Configure(_) => kind::CONFIGURE,
            Self::Report => kind::REPORT_REQUEST,
            Self::Store => kind::STORE,
            Self::Erase => kind::ERASE,
        }
    }

    fn encode(&self, out: &mut [u8]) -> Option<usize> {
        match self {
            Self::Hello | Self::Report | Self::Store | Self::Erase => Some(0),
            Self::Configure(config) => write(config, out),
        }
    }

    fn decode(kind: u8, body: &[u8]) -> Result<Self, Refusal> {
        match kind {
            kind::HELLO => empty(body).map(|()| Self::Hello),
            kind::CONFIGURE => whole(body).map(Self::Configure),
            kind::REPORT_REQUEST => empty(body).map(|()| Self::Report),
            kind::STORE => empty(body).map(|()| Self::Store),
            kind::ERASE => empty(body).map(|()| Self::Erase),
            _ => Err(Refusal::Kind),
        }
    }
}

impl Body for Reply {
    fn kind(&self) -> u8 {
        match self {
            Self::Identity(_) => kind::IDENTITY,
            Self::Configured(_) => kind::CONFIGURED,
            Self::Telemetry(_) => kind::TELEMETRY,
            Self::Report(_) => kind::REPORT,
            Self::Stored(_) => kind::STORED,
            Self::Erased(_) => kind::ERASED,
        }
    }

    fn encode(&self, out: &mut [u8]) -> Option<usize> {
        match self {
            Self::Identity(value) => write(value, out),
            Self::Configured(value) => write(value, out),
            Self::Telemetry(value) => write(value, out),
            Self::Report(value) => write(value, out),
            Self::Stored(value) => write(value, out),
            Self::Erased(value) => write(value, out),
        }
    }

    fn decode(kind: u8, body: &[u8]) -> Result<Self, Refusal> {
        match kind {
            kind::IDENTITY => whole(body).map(Self::Identity),
            kind::CONFIGURED => whole(body).map(Self::Configured),
            kind::TELEMETRY => whole(body).map(Self::Telemetry),
            kind::REPORT => whole(body).map(Self::Report),
            kind::STORED => whole(body).map(Self::Stored),
            kind::ERASED => whole(body).map(Self::Erased),
            _ => Err(Refusal::Kind),
        }
    }
}

fn write<T: Serialize>(value: &T, out: &mut [u8]) -> Option<usize> {
    postcard::to_slice(value, out).ok().map(|bytes| bytes.len())
}

fn empty(body: &[u8]) -> Result<(), Refusal> {
    if body.is_empty() { Ok(()) } else { Err(Refusal::Length) }
}

/// `postcard::from_bytes` ignores trailing bytes; a frame may have none.
fn whole<'a, T: Deserialize<'a>>(body: &'a [u8]) -> Result<T, Refusal> {
    let (value, rest) = postcard::take_from_bytes(body).map_err(|_| Refusal::Value)?;
    if rest.is_empty() { Ok(value) } else { Err(Refusal::Length) }
}
