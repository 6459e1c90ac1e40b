//! The service plane on serial links: identity, configuration, telemetry, report. Postcard bodies.

use core::fmt;

use crate::can::exactly;
use crate::config::{ConfigError, NodeConfig};
use crate::in_place::Bytes;
use crate::refusal::Refusal;
use crate::report::{Kept, Report, Telemetry};
use serde::{Deserialize, Serialize};

/// Longest body of a [`Reply`], bytes: a report whose counters are all at their largest.
pub const MAX_REPLY_BODY: usize = 202;

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
    /// Host sends a configuration that is to wait beside the present one for a commit.
    pub const STAGE: u8 = 0x4B;
    /// Node has it, or says why not.
    pub const STAGED: u8 = 0x4C;
    /// Host sends the key that the node is to keep.
    pub const KEY: u8 = 0x4D;
    /// Node keeps it, or says why not.
    pub const KEYED: u8 = 0x4E;
}

/// Identity of a node.
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
    /// Number of starts since power-on, this one included; 0 where it is not known.
    pub starts: u32,
    /// [`NodeConfig::checksum`] of the configuration that it has now, 0 while blank.
    pub checksum: u32,
    /// Whether it keeps a key.
    pub has_key: bool,
}

/// A key that a node keeps: it can be set and never read. Nothing uses it yet (protocol/README.md).
#[derive(Clone, Copy, Eq)]
pub struct Key(pub [u8; Key::LENGTH]);

impl Key {
    /// Bytes.
    pub const LENGTH: usize = 16;
}

/// Takes as long for equal keys as for others.
impl PartialEq for Key {
    fn eq(&self, other: &Self) -> bool {
        self.0.iter().zip(&other.0).fold(0, |differ, (a, b)| differ | (a ^ b)) == 0
    }
}

/// Keys do not end up in logs.
impl fmt::Debug for Key {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("Key(..)")
    }
}

/// Cause of a node's start.
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

/// Why a node has not stored, staged or erased a configuration, or not kept a key.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[non_exhaustive]
pub enum StoreError {
    /// The node is running; flash can stall it for longer than a tick.
    Running,
    /// It has no configuration.
    Blank,
    /// The board has no storage.
    Absent,
    /// The flash has failed. The next start finds what was stored before or the new one, whole.
    Failed,
    /// The request before it is not answered yet.
    Busy,
}

impl fmt::Display for StoreError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Running => "the node is running: stop it before storing",
            Self::Blank => "the node has no configuration to store",
            Self::Absent => "the board has no storage",
            Self::Failed => "the flash did not take it",
            Self::Busy => "the node has not answered the request before yet: ask again",
        })
    }
}

impl core::error::Error for StoreError {}

/// Why a node has not staged a configuration. What it had staged before may be lost then.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[non_exhaustive]
pub enum StageError {
    /// It would refuse to be configured so.
    Config(ConfigError),
    /// It could not keep it.
    Store(StoreError),
}

impl fmt::Display for StageError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Config(reason) => reason.fmt(f),
            Self::Store(reason) => reason.fmt(f),
        }
    }
}

impl core::error::Error for StageError {}

/// Request of a host to a node. `C` is a configuration, or the bytes of one that nobody has read.
#[derive(Clone, Debug, PartialEq)]
#[allow(clippy::large_enum_variant)] // no allocator to box a configuration with
pub enum Request<C = NodeConfig> {
    /// Who is there?
    Hello,
    /// Be this.
    Configure(C),
    /// Report!
    Report,
    /// Be this after the next start, too.
    Store,
    /// Be blank after the next start.
    Erase,
    /// Have this ready beside what you are, until a commit.
    Stage(C),
    /// Keep this key.
    Key(Key),
}

/// Reply of a node, or what it tells unasked.
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
    /// I keep it: the epoch, which grows with every store, erase, commit and key.
    Stored(Result<u32, StoreError>),
    /// I will be blank.
    Erased(Result<(), StoreError>),
    /// I have it ready: its [`NodeConfig::checksum`].
    Staged(Result<u32, StageError>),
    /// I keep the key: the epoch.
    Keyed(Result<u32, StoreError>),
    /// What I say to an [`crate::update::Request`].
    #[cfg(feature = "update")]
    Update(crate::update::Reply),
}

impl Reply {
    /// The refusal of a request of this kind because another one is not answered yet; none for those that
    /// only ask, which are asked again.
    pub fn busy(kind: u8) -> Option<Self> {
        match kind {
            kind::CONFIGURE => Some(Self::Configured(Err(ConfigError::Busy))),
            kind::STORE => Some(Self::Stored(Err(StoreError::Busy))),
            kind::ERASE => Some(Self::Erased(Err(StoreError::Busy))),
            kind::STAGE => Some(Self::Staged(Err(StageError::Store(StoreError::Busy)))),
            kind::KEY => Some(Self::Keyed(Err(StoreError::Busy))),
            _ => None,
        }
    }
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
    /// `Kind` for a kind that is not of this direction, `Length` for trailing bytes, `Value` for anything
    /// else that is not such a body.
    fn decode(kind: u8, body: &[u8]) -> Result<Self, Refusal>;
}

impl<'a> Request<&'a [u8]> {
    /// Reads a body of `kind`, but for a configuration: [`NodeConfig::read`] reads it where it is to stay.
    ///
    /// # Errors
    /// As for [`Body::decode`].
    pub fn split(kind: u8, body: &'a [u8]) -> Result<Self, Refusal> {
        match kind {
            kind::HELLO => empty(body).map(|()| Self::Hello),
            kind::CONFIGURE => Ok(Self::Configure(body)),
            kind::REPORT_REQUEST => empty(body).map(|()| Self::Report),
            kind::STORE => empty(body).map(|()| Self::Store),
            kind::ERASE => empty(body).map(|()| Self::Erase),
            kind::STAGE => Ok(Self::Stage(body)),
            kind::KEY => exactly(body).map(|&bytes| Self::Key(Key(bytes))),
            _ => Err(Refusal::Kind),
        }
    }
}

impl Body for Request {
    fn kind(&self) -> u8 {
        match self {
            Self::Hello => kind::HELLO,
            Self::Configure(_) => kind::CONFIGURE,
            Self::Report => kind::REPORT_REQUEST,
            Self::Store => kind::STORE,
            Self::Erase => kind::ERASE,
            Self::Stage(_) => kind::STAGE,
            Self::Key(_) => kind::KEY,
        }
    }

    fn encode(&self, out: &mut [u8]) -> Option<usize> {
        match self {
            Self::Hello | Self::Report | Self::Store | Self::Erase => Some(0),
            Self::Configure(config) | Self::Stage(config) => write(config, out),
            Self::Key(Key(bytes)) => write(bytes, out),
        }
    }

    fn decode(kind: u8, body: &[u8]) -> Result<Self, Refusal> {
        Ok(match Request::split(kind, body)? {
            Request::Hello => Self::Hello,
            Request::Configure(bytes) => Self::Configure(config(bytes)?),
            Request::Report => Self::Report,
            Request::Store => Self::Store,
            Request::Erase => Self::Erase,
            Request::Stage(bytes) => Self::Stage(config(bytes)?),
            Request::Key(key) => Self::Key(key),
        })
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
            Self::Staged(_) => kind::STAGED,
            Self::Keyed(_) => kind::KEYED,
            #[cfg(feature = "update")]
            Self::Update(_) => crate::update::UPDATED,
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
            Self::Staged(value) => write(value, out),
            Self::Keyed(value) => write(value, out),
            #[cfg(feature = "update")]
            Self::Update(value) => write(value, out),
        }
    }

    fn decode(kind: u8, body: &[u8]) -> Result<Self, Refusal> {
        match kind {
            kind::IDENTITY => whole(body).map(Self::Identity),
            kind::CONFIGURED => whole(body).map(Self::Configured),
            kind::TELEMETRY => whole(body).map(Self::Telemetry),
            kind::REPORT => report(body).map(Self::Report),
            kind::STORED => whole(body).map(Self::Stored),
            kind::ERASED => whole(body).map(Self::Erased),
            kind::STAGED => whole(body).map(Self::Staged),
            kind::KEYED => whole(body).map(Self::Keyed),
            #[cfg(feature = "update")]
            crate::update::UPDATED => whole(body).map(Self::Update),
            _ => Err(Refusal::Kind),
        }
    }
}

fn config(body: &[u8]) -> Result<NodeConfig, Refusal> {
    let mut config = NodeConfig::empty();
    config.read(body).map(|()| config)
}

/// What was kept away is missing where it is nothing; there is no half of it.
fn report(body: &[u8]) -> Result<Report, Refusal> {
    let mut source = postcard::Deserializer::from_flavor(Bytes { bytes: body, zeros: Kept::ZEROS });
    let report = Report::deserialize(&mut source).map_err(|_| Refusal::Value)?;
    let rest = source.finalize().map_err(|_| Refusal::Value)?;
    let zeros = if report.counters.kept.is_nothing() { 0 } else { Kept::ZEROS };
    match rest.bytes {
        [] if rest.zeros == zeros => Ok(report),
        [] => Err(Refusal::Value),
        _ => Err(Refusal::Length),
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
