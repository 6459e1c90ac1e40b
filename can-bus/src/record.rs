//! Frames and errors as SocketCAN has them, which is what logs hold: identifier with flags, length, data
//! (linux/can.h, linux/can/error.h).

use crate::counters::{Counters, Mode};
use crate::event::{Event, What};
use crate::frame::{Frame, Id, Kind, LONGEST_FD};
use crate::reader::ErrorKind;
use crate::wire::Field;

/// Flag of a 29-bit identifier.
pub const EXTENDED: u32 = 0x8000_0000;
/// Flag of a remote frame.
pub const REMOTE: u32 = 0x4000_0000;
/// Flag of an error.
pub const ERROR: u32 = 0x2000_0000;

/// Flags of a CAN FD frame.
const SWITCH: u8 = 1;
const PASSIVE: u8 = 2;
const FD: u8 = 4;

/// Bytes of an error.
const ERROR_BYTES: u8 = 8;
/// Classes of an error, in the identifier.
const CONTROLLER: u32 = 0x04;
const PROTOCOL: u32 = 0x08;
const NOT_ACKNOWLEDGED: u32 = 0x20;
const BUS_OFF: u32 = 0x40;
const BUS_ERROR: u32 = 0x80;
const COUNTERS: u32 = 0x200;

/// A frame or an error.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Record {
    /// When, ns.
    pub at: u64,
    /// Identifier with its flags, or the classes of an error.
    pub id: u32,
    /// Flags of a CAN FD frame.
    pub fd: Option<u8>,
    /// Length that the data length code says.
    pub length: u8,
    data: [u8; LONGEST_FD],
}

impl Record {
    /// What SocketCAN has of a frame or an error: identifier with its flags, flags of CAN FD, length, data. A
    /// remote frame has no data; what is longer than a frame is cut.
    pub fn new(at: u64, id: u32, fd: Option<u8>, length: u8, bytes: &[u8]) -> Self {
        let mut data = [0; LONGEST_FD];
        data.iter_mut().zip(bytes).for_each(|(place, &byte)| *place = byte);
        Self { at, id, fd, length: length.min(LONGEST_FD as u8), data }
    }

    /// The frame, and whether its sender is error-passive; none of an error, or of what no controller can
    /// send.
    pub fn frame(&self) -> Option<(Frame, bool)> {
        let raw = self.id & !(EXTENDED | REMOTE | ERROR);
        let id = match self.id & EXTENDED {
            0 => Id::Base(u16::try_from(raw).ok()?),
            _ => Id::Extended(raw),
        };
        let frame = match self.fd {
            _ if self.id & ERROR != 0 => return None,
            Some(flags) => Frame::fd(id, self.bytes(), flags & SWITCH != 0),
            None if self.id & REMOTE != 0 => Frame::remote(id, self.length.into()),
            None => Frame::data(id, self.bytes()),
        };
        Some((frame.ok()?, self.fd.is_some_and(|flags| flags & PASSIVE != 0)))
    }

    /// A frame; `passive` says whether its sender is error-passive, which a CAN FD frame tells.
    pub fn of_frame(at: u64, frame: &Frame, passive: bool) -> Self {
        let id = match frame.id() {
            Id::Base(id) => u32::from(id),
            Id::Extended(id) => id | EXTENDED,
        };
        let (flag, fd) = match frame.kind() {
            Kind::Data => (0, None),
            Kind::Remote => (REMOTE, None),
            Kind::Fd { switch } => {
                (0, Some(FD | if switch { SWITCH } else { 0 } | if passive { PASSIVE } else { 0 }))
            }
        };
        let mut data = [0; LONGEST_FD];
        data[..frame.bytes().len()].copy_from_slice(frame.bytes());
        Self { at, id: id | flag, fd, length: frame.length() as u8, data }
    }

    /// What a log holds of an event: frames that were sent, errors, and changes of how a controller takes
    /// part.
    pub fn of_event(event: &Event) -> Option<Self> {
        let at = event.at;
        match event.what {
            What::Sent { ref frame, passive, .. } => Some(Self::of_frame(at, frame, passive)),
            What::Error { kind, field, sender, counters } => {
                Some(Self::of_error(at, kind, field, sender, counters))
            }
            What::Mode { mode, counters } => Some(Self::of_mode(at, mode, counters)),
            What::Received { .. } | What::LostArbitration { .. } | What::Overload => None,
        }
    }

    fn of_error(at: u64, kind: ErrorKind, field: Field, sender: bool, counters: Counters) -> Self {
        let (class, kind) = match kind {
            ErrorKind::Acknowledgement => (NOT_ACKNOWLEDGED, 0),
            ErrorKind::Bit => (PROTOCOL, 0x01),
            ErrorKind::Form => (PROTOCOL, 0x02),
            ErrorKind::Stuff => (PROTOCOL, 0x04),
            // Unspecified, at the checksum.
            ErrorKind::Checksum => (PROTOCOL, 0),
        };
        let field = if kind == 0 && class == PROTOCOL { Field::Checksum } else { field };
        let of_sender = if sender && class == PROTOCOL { 0x80 } else { 0 };
        Self::new_error(at, class | BUS_ERROR, [0, 0, kind | of_sender, location(field)], counters)
    }

    fn of_mode(at: u64, mode: Mode, counters: Counters) -> Self {
        let status = match mode {
            Mode::Off => return Self::new_error(at, BUS_OFF, [0; 4], counters),
            Mode::Active => 0x40,
            Mode::Passive if counters.transmit > 127 => 0x20,
            Mode::Passive => 0x10,
        };
        Self::new_error(at, CONTROLLER, [0, status, 0, 0], counters)
    }

    fn new_error(at: u64, class: u32, bytes: [u8; 4], counters: Counters) -> Self {
        let mut data = [0; LONGEST_FD];
        data[..4].copy_from_slice(&bytes);
        let byte = |counter: u16| u8::try_from(counter).unwrap_or(u8::MAX);
        (data[6], data[7]) = (byte(counters.transmit), byte(counters.receive));
        Self { at, id: ERROR | class | COUNTERS, fd: None, length: ERROR_BYTES, data }
    }

    /// The same at another time, ns.
    #[must_use]
    pub fn at(self, at: u64) -> Self {
        Self { at, ..self }
    }

    /// Data; none of a remote frame.
    pub fn bytes(&self) -> &[u8] {
        if self.is_remote() { &[] } else { &self.data[..usize::from(self.length)] }
    }

    /// Whether it is a remote frame.
    pub fn is_remote(&self) -> bool {
        self.id & (REMOTE | ERROR) == REMOTE
    }

    /// Whether it is an error, or a change of how a controller takes part.
    pub fn is_error(&self) -> bool {
        self.id & ERROR != 0
    }
}

/// Where in the frame, as the kernel numbers it.
fn location(field: Field) -> u8 {
    match field {
        Field::Arbitration | Field::Between => 0,
        Field::Start => 0x03,
        Field::Control => 0x0B,
        Field::Data => 0x0A,
        Field::Checksum => 0x08,
        Field::ChecksumDelimiter => 0x18,
        Field::Acknowledgement => 0x19,
        Field::AcknowledgementDelimiter => 0x1B,
        Field::End => 0x1A,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_frame_comes_back_from_its_record() {
        for (frame, passive) in [
            (Frame::data(Id::Base(0x185), &[1, 2, 3]), false),
            (Frame::data(Id::Extended(0x185), &[]), false),
            (Frame::remote(Id::Base(0x7FF), 4), false),
            (Frame::fd(Id::Extended(0x1FFF_FFFF), &[7; 12], true), true),
            (Frame::fd(Id::Base(1), &[7; 64], false), false),
        ] {
            let frame = frame.unwrap();
            let record = Record::of_frame(5, &frame, passive);
            assert_eq!(record.frame(), Some((frame, passive)));
            assert_eq!(Record::new(5, record.id, record.fd, record.length, record.bytes()), record);
        }
    }

    #[test]
    fn an_error_is_no_frame_and_neither_is_what_cannot_be_sent() {
        let counters = Counters::default();
        let what = What::Mode { mode: Mode::Off, counters };
        let record = Record::of_event(&Event { at: 0, node: 0, what }).unwrap();
        assert!(record.is_error() && record.frame().is_none());
        assert!(Record::new(0, 0x800, None, 0, &[]).frame().is_none());
        assert!(Record::new(0, 1, None, 9, &[0; 9]).frame().is_none());
    }
}
