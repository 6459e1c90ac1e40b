//! Update in the field: a new program for a node, over the service plane. Off by default (feature `update`).
//!
//! A host begins, sends blocks one after the other, has them checked, and has the node restart into them.
//! Nothing is sent unasked. protocol/README.md, "Update".

use core::fmt;

use crate::refusal::Refusal;
use crate::service::Body;
use crc::{CRC_32_ISO_HDLC, Crc, NoTable};
use heapless::Vec;
use serde::{Deserialize, Serialize};

/// Kind of a serial frame with a [`Request`].
pub const UPDATE: u8 = 0x50;
/// Kind of a serial frame with a [`Reply`].
pub const UPDATED: u8 = 0x51;
/// Most bytes of a block: a page of most flash chips.
pub const MAX_BLOCK: usize = 256;
/// Blocks begin at multiples of this, bytes, and all but the last have multiples of it.
pub const BLOCK_UNIT: u32 = MAX_BLOCK as u32;

/// A table would cost a kilobyte.
static CRC: Crc<u32, NoTable> = Crc::<u32, NoTable>::new(&CRC_32_ISO_HDLC);

/// CRC-32/ISO-HDLC of bytes that come in parts.
pub struct Checksum(crc::Digest<'static, u32, NoTable>);

impl Default for Checksum {
    fn default() -> Self {
        Self::new()
    }
}

impl Checksum {
    /// Of nothing yet.
    pub fn new() -> Self {
        Self(CRC.digest())
    }

    /// Takes the next part.
    pub fn take(&mut self, bytes: &[u8]) {
        self.0.update(bytes);
    }

    /// The checksum of all parts.
    #[must_use]
    pub fn value(self) -> u32 {
        self.0.finalize()
    }

    /// The checksum of these bytes.
    #[must_use]
    pub fn of(bytes: &[u8]) -> u32 {
        CRC.checksum(bytes)
    }
}

/// Number of a board in an [`Image`]: the [`Checksum`] of its name, `rp2040-pico` for example.
#[must_use]
pub fn board_number(name: &str) -> u32 {
    CRC.checksum(name.as_bytes())
}

/// A program that is to be sent.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Image {
    /// [`board_number`] of the board that it is for.
    pub board: u32,
    /// Its length, bytes.
    pub length: u32,
    /// [`Checksum`] of all its bytes.
    pub crc: u32,
}

/// A part of a program.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Block {
    /// Where it begins in the program, bytes; a multiple of [`BLOCK_UNIT`].
    pub offset: u32,
    /// [`Checksum`] of its bytes.
    pub crc: u32,
    /// Its bytes: [`MAX_BLOCK`], or what is left of the program.
    pub bytes: Vec<u8, MAX_BLOCK>,
}

/// Request of a host.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[non_exhaustive]
#[allow(clippy::large_enum_variant, reason = "no allocator to box a block with")]
pub enum Request {
    /// How are you, and what is the checksum of the first so many bytes of the program that you run?
    Status {
        /// Bytes.
        length: u32,
    },
    /// This program is about to come.
    Begin(Image),
    /// A part of it.
    Block(Block),
    /// It is complete: is it what was announced?
    Check,
    /// Restart into it.
    Swap,
    /// Restart. A program on trial goes back to the one before.
    Restart,
}

/// What a node says of its programs.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Status {
    /// [`board_number`] of its board.
    pub board: u32,
    /// Longest program, bytes.
    pub room: u32,
    /// [`Checksum`] of as much of the running program as was asked for, and as there is room for.
    pub crc: u32,
    /// Whether the running program is on trial: it goes back at the next start unless it is confirmed first.
    pub on_trial: bool,
    /// Ticks that it has to complete, and has not completed, until it is confirmed; 0 where it is.
    pub ticks_left: u32,
    /// Bytes of the next program that have come.
    pub received: u32,
    /// Whether these are all, and what was announced.
    pub is_checked: bool,
    /// Blocks that were refused since the start, saturating.
    pub refused: u32,
    /// Blocks that came again since the start, saturating.
    pub repeated: u32,
}

/// Why a node has not done what was asked.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[non_exhaustive]
pub enum UpdateError {
    /// It runs: flash can stall it for longer than a tick.
    Running,
    /// It has no boot loader that could swap programs.
    Absent,
    /// The program is for another board.
    Board {
        /// [`board_number`] of this one.
        own: u32,
    },
    /// The program does not fit, or is empty.
    Length {
        /// Longest, bytes.
        room: u32,
    },
    /// Nothing has begun.
    NotBegun,
    /// The block is not the next one.
    Order {
        /// Where the next one begins.
        next: u32,
    },
    /// The block is too long, or its bytes are not what its checksum says.
    Block,
    /// The program is not complete.
    Incomplete {
        /// Bytes that have come.
        received: u32,
    },
    /// What is in the flash is not what was announced.
    Checksum {
        /// Checksum of what is there.
        found: u32,
    },
    /// Nothing has been checked.
    NotChecked,
    /// The running program is on trial: the one before is where the next one would be written.
    OnTrial,
    /// The flash has failed.
    Flash,
}

impl fmt::Display for UpdateError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Running => f.write_str("the node is running: stop it first"),
            Self::Absent => f.write_str("the node has no boot loader that could swap programs"),
            Self::Board { own } => write!(f, "the program is for another board than this one, {own:08x}"),
            Self::Length { room } => write!(f, "the program has 0 bytes, or more than {room}"),
            Self::NotBegun => f.write_str("no program was announced"),
            Self::Order { next } => write!(f, "the next block begins at byte {next}"),
            Self::Block => f.write_str("the block is not what its checksum says"),
            Self::Incomplete { received } => write!(f, "only {received} bytes have come"),
            Self::Checksum { found } => write!(f, "the flash holds a program with checksum {found:08x}"),
            Self::NotChecked => f.write_str("no program was checked"),
            Self::OnTrial => f.write_str("the program that runs is on trial"),
            Self::Flash => f.write_str("the flash did not take it"),
        }
    }
}

impl core::error::Error for UpdateError {}

/// Reply of a node.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[non_exhaustive]
pub enum Reply {
    /// To `Status`.
    Status(Status),
    /// To `Begin`.
    Begun(Result<(), UpdateError>),
    /// To `Block`: where the next one begins.
    Written(Result<u32, UpdateError>),
    /// To `Check`.
    Checked(Result<(), UpdateError>),
    /// To `Swap` and `Restart`, before it does.
    Restarts(Result<(), UpdateError>),
}

impl Request {
    /// The reply that refuses it, for this reason.
    #[must_use]
    pub fn refused(&self, why: UpdateError) -> Reply {
        match self {
            Self::Status { .. } => Reply::Status(Status::default()),
            Self::Begin(_) => Reply::Begun(Err(why)),
            Self::Block(_) => Reply::Written(Err(why)),
            Self::Check => Reply::Checked(Err(why)),
            Self::Swap | Self::Restart => Reply::Restarts(Err(why)),
        }
    }
}

impl Body for Request {
    fn kind(&self) -> u8 {
        UPDATE
    }

    fn encode(&self, out: &mut [u8]) -> Option<usize> {
        postcard::to_slice(self, out).ok().map(|bytes| bytes.len())
    }

    fn decode(kind: u8, body: &[u8]) -> Result<Self, Refusal> {
        if kind != UPDATE {
            return Err(Refusal::Kind);
        }
        let (request, rest) = postcard::take_from_bytes(body).map_err(|_| Refusal::Value)?;
        if rest.is_empty() { Ok(request) } else { Err(Refusal::Length) }
    }
}
