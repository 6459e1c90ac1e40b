//! A frame as its sender drives it, bit by bit, from the start of frame to its end.

use crate::crc::{Crc, LONGEST_CRC_17};
use crate::frame::{Frame, Id, Kind};
use crate::length::{END, header};

/// A level of the bus; a dominant one of any node wins.
pub const DOMINANT: bool = false;
/// The level of a bus that nobody drives.
pub const RECESSIVE: bool = true;

/// Equal bits after which a bit of the other level is stuffed.
pub(crate) const RUN: u32 = 5;

/// A part of a frame.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Field {
    /// Start of frame.
    Start,
    /// Identifier with the bits that take part in arbitration.
    Arbitration,
    /// From there to the data length code.
    Control,
    /// Data.
    Data,
    /// Stuff count and checksum.
    Checksum,
    /// Delimiter of the checksum.
    ChecksumDelimiter,
    /// Acknowledgement slot.
    Acknowledgement,
    /// Delimiter of the acknowledgement.
    AcknowledgementDelimiter,
    /// End of frame.
    End,
    /// Flag and delimiter of an error or an overload, and what follows them up to the next frame.
    Between,
}

/// How long a bit lasts.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Pace {
    Nominal,
    /// From the nominal to the faster rate at its sample point.
    Up,
    Fast,
    /// Back at its sample point.
    Down,
}

/// One bit of a frame.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Bit {
    pub(crate) level: bool,
    pub(crate) stuffed: bool,
    pub(crate) field: Field,
    pub(crate) pace: Pace,
}

/// The bits of a frame to the end of the end of frame.
#[derive(Clone, Debug)]
pub struct Wire {
    bits: Vec<Bit>,
}

impl Wire {
    /// The bits of a frame. `passive` says whether its sender is error-passive, which a CAN FD frame tells.
    pub fn of(frame: &Frame, passive: bool) -> Self {
        let mut writer = Writer::new(frame);
        writer.header(frame, passive);
        for byte in frame.bytes() {
            (0..8).rev().for_each(|at| writer.push(byte >> at & 1 == 1, Field::Data));
        }
        if frame.is_fd() {
            writer.fd_checksum()
        } else {
            writer.classic_checksum()
        }
        writer.end();
        Self { bits: writer.bits }
    }

    /// Levels, in the order in which they are sent.
    pub fn levels(&self) -> impl Iterator<Item = bool> + '_ {
        self.bits.iter().map(|bit| bit.level)
    }

    /// Number of stuff bits, fixed ones included.
    pub fn stuffed(&self) -> usize {
        self.bits.iter().filter(|bit| bit.stuffed).count()
    }

    pub(crate) fn bit(&self, at: usize) -> Option<Bit> {
        self.bits.get(at).copied()
    }

    pub(crate) fn len(&self) -> usize {
        self.bits.len()
    }
}

struct Writer {
    bits: Vec<Bit>,
    crc: Crc,
    /// CAN FD covers its stuff bits, but the fixed ones, by the checksum.
    fd: bool,
    switch: bool,
    pace: Pace,
    run: u32,
    last: bool,
    /// Dynamic stuff bits.
    stuffed: u32,
    /// A stuff bit is due before the next bit.
    due: bool,
}

impl Writer {
    fn new(frame: &Frame) -> Self {
        let crc = match frame.kind() {
            Kind::Fd { .. } if frame.length() > LONGEST_CRC_17 => Crc::of_long_fd(),
            Kind::Fd { .. } => Crc::of_short_fd(),
            _ => Crc::of_classic(),
        };
        let switch = frame.kind() == Kind::Fd { switch: true };
        let (fd, pace) = (frame.is_fd(), Pace::Nominal);
        Self { bits: Vec::new(), crc, fd, switch, pace, run: 0, last: RECESSIVE, stuffed: 0, due: false }
    }

    fn header(&mut self, frame: &Frame, passive: bool) {
        let (bits, length) = header(frame, passive);
        // The bits that take part in arbitration end with RTR, RRS; IDE takes part where it is recessive.
        let arbitration_end = if matches!(frame.id(), Id::Base(_)) { 12 } else { 32 };
        // The bit before the sender's state and the data length code.
        let switch_at = length - 6;
        for at in 0..length {
            let field = match at {
                0 => Field::Start,
                _ if at <= arbitration_end => Field::Arbitration,
                _ => Field::Control,
            };
            if self.switch && at == switch_at {
                self.pace = Pace::Up;
            }
            self.push(bits >> (length - 1 - at) & 1 == 1, field);
            if self.pace == Pace::Up {
                self.pace = Pace::Fast;
            }
        }
    }

    /// A bit that is stuffed and covered by the checksum.
    fn push(&mut self, level: bool, field: Field) {
        self.stuff(field);
        self.crc.push(level);
        self.count(level);
        self.put(level, false, field);
    }

    /// The stuff bit that is due, if one is.
    fn stuff(&mut self, field: Field) {
        if !std::mem::take(&mut self.due) {
            return;
        }
        let level = !self.last;
        if self.fd {
            self.crc.push(level);
        }
        self.stuffed += 1;
        self.count(level);
        self.put(level, true, field);
    }

    fn count(&mut self, level: bool) {
        self.run = if level == self.last && !self.bits.is_empty() { self.run + 1 } else { 1 };
        self.last = level;
        self.due = self.run == RUN;
    }

    fn put(&mut self, level: bool, stuffed: bool, field: Field) {
        self.bits.push(Bit { level, stuffed, field, pace: self.pace });
    }

    fn classic_checksum(&mut self) {
        let crc = self.crc;
        for at in (0..crc.width()).rev() {
            self.push(crc.value() >> at & 1 == 1, Field::Checksum);
        }
        self.stuff(Field::Checksum);
    }

    /// Stuff count and checksum, with a fixed stuff bit before each four bits. One that is due by the data is
    /// replaced by the first of them.
    fn fd_checksum(&mut self) {
        let count = stuff_count(self.stuffed);
        (0..4).rev().for_each(|at| self.crc.push(count >> at & 1 == 1));
        let (width, value) = (self.crc.width(), self.crc.value());
        let bits = count << width | value;
        for at in 0..4 + width {
            if at % 4 == 0 {
                self.last = !self.last;
                self.put(self.last, true, Field::Checksum);
            }
            self.last = bits >> (3 + width - at) & 1 == 1;
            self.put(self.last, false, Field::Checksum);
        }
    }

    fn end(&mut self) {
        if self.pace == Pace::Fast {
            self.pace = Pace::Down;
        }
        self.put(RECESSIVE, false, Field::ChecksumDelimiter);
        self.pace = Pace::Nominal;
        self.put(RECESSIVE, false, Field::Acknowledgement);
        self.put(RECESSIVE, false, Field::AcknowledgementDelimiter);
        (0..END).for_each(|_| self.put(RECESSIVE, false, Field::End));
    }
}

/// The four bits of the stuff count: the number of dynamic stuff bits modulo 8 in Gray code, and a bit that
/// makes the parity even.
pub(crate) fn stuff_count(stuffed: u32) -> u32 {
    let count = stuffed % 8;
    let gray = count ^ count >> 1;
    gray << 1 | (gray.count_ones() & 1)
}
