//! Frames as a user gives them to a controller: identifier, kind, length and data.

use std::fmt;

/// Largest 11-bit identifier.
pub const LARGEST_BASE: u16 = 0x7FF;
/// Largest 29-bit identifier.
pub const LARGEST_EXTENDED: u32 = 0x1FFF_FFFF;
/// Longest data field of a classic frame, bytes.
pub const LONGEST_CLASSIC: usize = 8;
/// Longest data field of a CAN FD frame, bytes.
pub const LONGEST_FD: usize = 64;

/// Lengths of a data field, by data length code.
const LENGTHS: [u8; 16] = [0, 1, 2, 3, 4, 5, 6, 7, 8, 12, 16, 20, 24, 32, 48, 64];

/// An identifier.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum Id {
    /// One of 11 bits, 0 to [`LARGEST_BASE`].
    Base(u16),
    /// One of 29 bits, 0 to [`LARGEST_EXTENDED`].
    Extended(u32),
}

impl Id {
    /// The identifier of a frame with this [priority](Frame::priority).
    pub(crate) fn of_priority(priority: u32) -> Self {
        let base = priority >> 21;
        if priority >> 19 & 1 == 0 {
            Self::Base(base as u16)
        } else {
            Self::Extended(base << 18 | priority >> 1 & 0x3_FFFF)
        }
    }
}

impl fmt::Display for Id {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Base(id) => write!(f, "{id:03X}"),
            Self::Extended(id) => write!(f, "{id:08X}"),
        }
    }
}

/// What a frame is.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Kind {
    /// A classic frame with data.
    Data,
    /// A classic frame that asks for data and has none.
    Remote,
    /// A CAN FD frame.
    Fd {
        /// Whether its data go at the faster rate (bit rate switch).
        switch: bool,
    },
}

/// A reason for refusing a frame.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum FrameError {
    /// The identifier has too many bits.
    Id(Id),
    /// A classic frame is too long.
    ClassicLength(usize),
    /// No data length code says this length.
    FdLength(usize),
}

impl fmt::Display for FrameError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match *self {
            Self::Id(Id::Base(id)) => {
                write!(f, "base identifier {id:#X}: not between 0 and {LARGEST_BASE:#X} (11 bits)")
            }
            Self::Id(Id::Extended(id)) => {
                write!(f, "extended identifier {id:#X}: not between 0 and {LARGEST_EXTENDED:#X} (29 bits)")
            }
            Self::ClassicLength(length) => {
                write!(f, "length of a classic frame {length} bytes: not between 0 and {LONGEST_CLASSIC}")
            }
            Self::FdLength(length) => write!(
                f,
                "length of a CAN FD frame {length} bytes: not 0 to 8, 12, 16, 20, 24, 32, 48 or 64, which a data length code can say"
            ),
        }
    }
}

impl std::error::Error for FrameError {}

/// A frame. Identifier and length are within their ranges.
#[derive(Clone, Copy, PartialEq, Eq, Hash)]
pub struct Frame {
    id: Id,
    kind: Kind,
    length: u8,
    /// Zero from `length` on.
    data: [u8; LONGEST_FD],
}

impl Frame {
    /// A frame in a place that none has come to yet.
    pub(crate) const EMPTY: Self =
        Self { id: Id::Base(0), kind: Kind::Data, length: 0, data: [0; LONGEST_FD] };

    /// A classic frame with data.
    ///
    /// # Errors
    ///
    /// The identifier has too many bits, or there are more than 8 bytes.
    pub fn data(id: Id, data: &[u8]) -> Result<Self, FrameError> {
        classic_length(data.len())?;
        Self::new(id, Kind::Data, data)
    }

    /// A classic frame that asks for `length` bytes.
    ///
    /// # Errors
    ///
    /// The identifier has too many bits, or the length is above 8.
    pub fn remote(id: Id, length: usize) -> Result<Self, FrameError> {
        classic_length(length)?;
        let frame = Self::new(id, Kind::Remote, &[])?;
        Ok(Self { length: length as u8, ..frame })
    }

    /// A CAN FD frame; with `switch`, its data go at the faster rate.
    ///
    /// # Errors
    ///
    /// The identifier has too many bits, or no data length code says this length.
    pub fn fd(id: Id, data: &[u8], switch: bool) -> Result<Self, FrameError> {
        if !LENGTHS.iter().any(|&length| usize::from(length) == data.len()) {
            return Err(FrameError::FdLength(data.len()));
        }
        Self::new(id, Kind::Fd { switch }, data)
    }

    fn new(id: Id, kind: Kind, data: &[u8]) -> Result<Self, FrameError> {
        match id {
            Id::Base(raw) if raw > LARGEST_BASE => return Err(FrameError::Id(id)),
            Id::Extended(raw) if raw > LARGEST_EXTENDED => return Err(FrameError::Id(id)),
            _ => {}
        }
        let mut padded = [0; LONGEST_FD];
        padded[..data.len()].copy_from_slice(data);
        Ok(Self { id, kind, length: data.len() as u8, data: padded })
    }

    /// Identifier.
    pub fn id(&self) -> Id {
        self.id
    }

    /// What it is.
    pub fn kind(&self) -> Kind {
        self.kind
    }

    /// Data field; empty in a remote frame.
    pub fn bytes(&self) -> &[u8] {
        match self.kind {
            Kind::Remote => &[],
            _ => &self.data[..usize::from(self.length)],
        }
    }

    /// The data field of a classic frame as a number, first byte first, and how many bytes it has.
    pub(crate) fn classic_bytes(&self) -> (u64, u32) {
        let bytes = self.bytes().len().min(LONGEST_CLASSIC);
        let mut first = [0; LONGEST_CLASSIC];
        first.copy_from_slice(&self.data[..LONGEST_CLASSIC]);
        let bits = 8 * bytes as u32;
        // What comes after them is cut; a shift by all bits is none.
        (u64::from_be_bytes(first).checked_shr(u64::BITS - bits).unwrap_or(0), bytes as u32)
    }

    /// Number of bytes that its data length code says.
    pub fn length(&self) -> usize {
        usize::from(self.length)
    }

    /// Data length code.
    pub fn dlc(&self) -> u8 {
        match self.length {
            0..=8 => self.length,
            _ => LENGTHS.iter().position(|&length| length == self.length).map_or(0, |code| code as u8),
        }
    }

    /// Whether it is a CAN FD frame.
    pub fn is_fd(&self) -> bool {
        matches!(self.kind, Kind::Fd { .. })
    }

    /// Order of arbitration: of two frames that begin at the same time, the one with the smaller number goes
    /// on. Its bits are those of the arbitration field with the identifier extension bit, in the order in
    /// which they are sent.
    pub fn priority(&self) -> u32 {
        let remote = u32::from(self.kind == Kind::Remote);
        match self.id {
            Id::Base(id) => (u32::from(id) << 21) | (remote << 20),
            // SRR and IDE are recessive.
            Id::Extended(id) => ((id >> 18) << 21) | (0b11 << 19) | ((id & 0x3_FFFF) << 1) | remote,
        }
    }
}

impl fmt::Debug for Frame {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{} {:?} [{}] {:02X?}", self.id, self.kind, self.length, self.bytes())
    }
}

/// Number of bytes that a data length code says; classic frames stop at 8.
pub(crate) fn length_of(dlc: u8, fd: bool) -> usize {
    let length = usize::from(LENGTHS[usize::from(dlc & 15)]);
    if fd { length } else { length.min(LONGEST_CLASSIC) }
}

fn classic_length(length: usize) -> Result<(), FrameError> {
    if length > LONGEST_CLASSIC { Err(FrameError::ClassicLength(length)) } else { Ok(()) }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_out_of_range_is_refused_with_name_value_and_range() {
        let message = |frame: Result<Frame, FrameError>| frame.unwrap_err().to_string();
        assert_eq!(
            message(Frame::data(Id::Base(0x800), &[])),
            "base identifier 0x800: not between 0 and 0x7FF (11 bits)"
        );
        assert_eq!(
            message(Frame::remote(Id::Extended(0x2000_0000), 0)),
            "extended identifier 0x20000000: not between 0 and 0x1FFFFFFF (29 bits)"
        );
        assert_eq!(
            message(Frame::data(Id::Base(1), &[0; 9])),
            "length of a classic frame 9 bytes: not between 0 and 8"
        );
        assert!(
            message(Frame::fd(Id::Base(1), &[0; 9], true))
                .starts_with("length of a CAN FD frame 9 bytes: not")
        );
        assert!(Frame::fd(Id::Base(0x7FF), &[0; 64], true).is_ok());
    }

    /// ISO 11898-1: a base frame wins over an extended one with the same first 11 bits, and data over a
    /// remote frame with the same identifier.
    #[test]
    fn arbitration_is_by_the_bits_as_they_are_sent() {
        let frames = [
            Frame::data(Id::Base(0x123), &[]).unwrap(),
            Frame::remote(Id::Base(0x123), 0).unwrap(),
            Frame::data(Id::Extended(0x123 << 18), &[]).unwrap(),
            Frame::remote(Id::Extended(0x123 << 18), 0).unwrap(),
            Frame::data(Id::Extended((0x123 << 18) + 1), &[]).unwrap(),
            Frame::data(Id::Base(0x124), &[]).unwrap(),
        ];
        assert!(frames.is_sorted_by(|a, b| a.priority() < b.priority()));
        assert!(frames.iter().all(|frame| Id::of_priority(frame.priority()) == frame.id()));
    }
}
