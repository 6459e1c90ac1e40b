//! The service plane on serial links: identity, configuration, telemetry, report. Postcard bodies.

use crate::config::{ConfigError, NodeConfig};
use crate::refusal::Refusal;
use crate::report::{Report, Telemetry};
use serde::{Deserialize, Serialize};

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
}

/// Who a node is.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Identity {
    /// [`crate::WIRE_VERSION`] of the node.
    pub wire_version: u8,
    /// Firmware version: major, minor, patch.
    pub firmware: [u8; 3],
    /// Configured id, 0 while blank.
    pub id: u8,
    /// The chip's unique number, 0 where it has none.
    pub uid: u64,
}

/// One frame of the service plane.
#[derive(Clone, Debug, PartialEq)]
#[allow(clippy::large_enum_variant)] // no allocator to box a configuration with
pub enum Service {
    /// Who is there?
    Hello,
    /// I am.
    Identity(Identity),
    /// Be this.
    Configure(NodeConfig),
    /// I am, or I refuse.
    Configured(Result<(), ConfigError>),
    /// What the law did.
    Telemetry(Telemetry),
    /// Report!
    ReportRequest,
    /// Counters.
    Report(Report),
}

impl Service {
    /// Kind of the frame.
    pub fn kind(&self) -> u8 {
        match self {
            Self::Hello => kind::HELLO,
            Self::Identity(_) => kind::IDENTITY,
            Self::Configure(_) => kind::CONFIGURE,
            Self::Configured(_) => kind::CONFIGURED,
            Self::Telemetry(_) => kind::TELEMETRY,
            Self::ReportRequest => kind::REPORT_REQUEST,
            Self::Report(_) => kind::REPORT,
        }
    }

    /// Writes the body to the front of `body`; the number of bytes, or `None` where it does not fit.
    pub fn encode_body(&self, body: &mut [u8]) -> Option<usize> {
        let written = match self {
            Self::Hello | Self::ReportRequest => return Some(0),
            Self::Identity(value) => postcard::to_slice(value, body),
            Self::Configure(value) => postcard::to_slice(value, body),
            Self::Configured(value) => postcard::to_slice(value, body),
            Self::Telemetry(value) => postcard::to_slice(value, body),
            Self::Report(value) => postcard::to_slice(value, body),
        };
        written.ok().map(|bytes| bytes.len())
    }

    /// Reads a body of `kind`.
    ///
    /// # Errors
    /// `Kind` for an unknown kind, `Length` for trailing bytes, `Value` for anything else that is not such a body.
    pub fn decode(kind: u8, body: &[u8]) -> Result<Self, Refusal> {
        match kind {
            kind::HELLO => empty(body).map(|()| Self::Hello),
            kind::IDENTITY => whole(body).map(Self::Identity),
            kind::CONFIGURE => whole(body).map(Self::Configure),
            kind::CONFIGURED => whole(body).map(Self::Configured),
            kind::TELEMETRY => whole(body).map(Self::Telemetry),
            kind::REPORT_REQUEST => empty(body).map(|()| Self::ReportRequest),
            kind::REPORT => whole(body).map(Self::Report),
            _ => Err(Refusal::Kind),
        }
    }
}

fn empty(body: &[u8]) -> Result<(), Refusal> {
    if body.is_empty() { Ok(()) } else { Err(Refusal::Length) }
}

/// `postcard::from_bytes` ignores trailing bytes; a frame may have none.
fn whole<'a, T: Deserialize<'a>>(body: &'a [u8]) -> Result<T, Refusal> {
    let (value, rest) = postcard::take_from_bytes(body).map_err(|_| Refusal::Value)?;
    if rest.is_empty() { Ok(value) } else { Err(Refusal::Length) }
}
