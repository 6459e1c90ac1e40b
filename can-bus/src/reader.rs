//! A frame as a receiver reads it: stuff bits out, fields, checksum; to the first bit that cannot be.

use crate::crc::{Crc, LONGEST_CRC_17};
use crate::frame::{Frame, Id, LONGEST_FD, length_of};
use crate::length::END;
use crate::wire::{DOMINANT, Field, RECESSIVE, RUN, stuff_count};

/// A kind of error on the bus.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum ErrorKind {
    /// A sender has read another level than it has sent.
    Bit,
    /// Six equal bits where bits are stuffed.
    Stuff,
    /// A bit that has one level only had the other.
    Form,
    /// The checksum does not fit.
    Checksum,
    /// Nobody has acknowledged.
    Acknowledgement,
}

/// What a bit leads to.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Read {
    /// More bits to come.
    More,
    /// An error in it.
    Error(ErrorKind),
    /// The frame is valid for a receiver: the last bit but one of the end of frame.
    Accepted,
    /// The frame has ended.
    Ended,
    /// The last bit of the frame is dominant, which asks for time.
    Overload,
}

/// Where the next bit belongs.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Part {
    Header,
    Data,
    ClassicChecksum,
    FdChecksum,
    Delimiter,
    Slot,
    SlotDelimiter,
    End,
}

#[derive(Clone, Debug)]
pub(crate) struct Reader {
    part: Part,
    /// Bits of this part so far, without stuff bits.
    count: u32,
    run: u32,
    last: bool,
    /// Dynamic stuff bits.
    stuffed: u32,
    header: u64,
    extended: bool,
    fd: bool,
    length: usize,
    data: [u8; LONGEST_FD],
    /// What was read of stuff count and checksum.
    checksum: u32,
    classic_crc: Crc,
    short_crc: Crc,
    long_crc: Crc,
    valid: bool,
}

impl Reader {
    /// A reader of a frame whose start has been seen.
    pub(crate) fn new() -> Self {
        let mut reader = Self {
            part: Part::Header,
            count: 0,
            run: 0,
            last: RECESSIVE,
            stuffed: 0,
            header: 0,
            extended: false,
            fd: false,
            length: 0,
            data: [0; LONGEST_FD],
            checksum: 0,
            classic_crc: Crc::of_classic(),
            short_crc: Crc::of_short_fd(),
            long_crc: Crc::of_long_fd(),
            valid: false,
        };
        let _start = reader.push(DOMINANT);
        reader
    }

    /// Whether the next bit is the slot, and the frame so far is to be acknowledged.
    pub(crate) fn acknowledges(&self) -> bool {
        self.part == Part::Slot && self.valid
    }

    /// Where the next bit belongs.
    pub(crate) fn field(&self) -> Field {
        match self.part {
            Part::Header if self.count == 0 => Field::Start,
            Part::Header if self.count <= if self.extended { 32 } else { 12 } => Field::Arbitration,
            Part::Header => Field::Control,
            Part::Data => Field::Data,
            Part::ClassicChecksum | Part::FdChecksum => Field::Checksum,
            Part::Delimiter => Field::ChecksumDelimiter,
            Part::Slot => Field::Acknowledgement,
            Part::SlotDelimiter => Field::AcknowledgementDelimiter,
            Part::End => Field::End,
        }
    }

    pub(crate) fn push(&mut self, bit: bool) -> Read {
        match self.part {
            Part::Header | Part::Data | Part::ClassicChecksum => self.stuffed_bit(bit),
            Part::FdChecksum => self.fd_checksum_bit(bit),
            Part::Delimiter if bit == DOMINANT => Read::Error(ErrorKind::Form),
            Part::Delimiter => self.go(Part::Slot),
            Part::Slot => self.go(Part::SlotDelimiter),
            Part::SlotDelimiter if bit == DOMINANT => Read::Error(ErrorKind::Form),
            Part::SlotDelimiter if !self.valid => Read::Error(ErrorKind::Checksum),
            Part::SlotDelimiter => self.go(Part::End),
            Part::End => self.end_bit(bit),
        }
    }

    /// The frame that was read.
    pub(crate) fn frame(&self) -> Option<Frame> {
        let (id, remote) = self.identifier();
        let data = &self.data[..self.length];
        let switch = self.header >> 5 & 1 == 1;
        match (self.fd, remote) {
            (true, _) => Frame::fd(id, data, switch),
            (false, true) => Frame::remote(id, length_of(self.code(), false)),
            (false, false) => Frame::data(id, data),
        }
        .ok()
    }

    fn identifier(&self) -> (Id, bool) {
        // Bits after the identifier, the one that asks for data first.
        let after = self.header_length() - if self.extended { 32 } else { 12 };
        let remote = self.header >> (after - 1) & 1 == 1;
        let before = (self.header >> after) as u32;
        if self.extended {
            (Id::Extended((before >> 20 & 0x7FF) << 18 | before & 0x3_FFFF), remote)
        } else {
            (Id::Base((before & 0x7FF) as u16), remote)
        }
    }

    fn code(&self) -> u8 {
        (self.header & 15) as u8
    }

    fn header_length(&self) -> u32 {
        match (self.extended, self.fd) {
            (false, false) => 19,
            (false, true) => 22,
            (true, false) => 39,
            (true, true) => 41,
        }
    }

    fn go(&mut self, part: Part) -> Read {
        (self.part, self.count) = (part, 0);
        Read::More
    }

    fn stuffed_bit(&mut self, bit: bool) -> Read {
        let due = self.run == RUN;
        if due && bit == self.last {
            return Read::Error(ErrorKind::Stuff);
        }
        self.run = if bit == self.last && self.run > 0 { self.run + 1 } else { 1 };
        self.last = bit;
        if due {
            self.stuffed += 1;
            self.cover_stuffed(bit);
            return if self.classic_checksum_is_read() { self.go(Part::Delimiter) } else { Read::More };
        }
        match self.part {
            Part::Header => self.header_bit(bit),
            Part::Data => self.data_bit(bit),
            _ => self.classic_checksum_bit(bit),
        }
    }

    fn cover(&mut self, bit: bool) {
        self.classic_crc.push(bit);
        self.cover_stuffed(bit);
    }

    /// The checksums of CAN FD cover the stuff bits too.
    fn cover_stuffed(&mut self, bit: bool) {
        self.short_crc.push(bit);
        self.long_crc.push(bit);
    }

    fn header_bit(&mut self, bit: bool) -> Read {
        self.cover(bit);
        self.header = self.header << 1 | u64::from(bit);
        self.count += 1;
        // FDF comes after IDE, or after the second part of the identifier and RTR.
        let fdf_at = if self.extended { 34 } else { 15 };
        match self.count {
            14 => self.extended = bit == RECESSIVE,
            at if at == fdf_at => self.fd = bit == RECESSIVE,
            // A reserved bit that asks for a format that nobody here has.
            at if at == fdf_at + 1 && self.fd && bit == RECESSIVE => return Read::Error(ErrorKind::Form),
            at if at == self.header_length() => return self.end_header(),
            _ => {}
        }
        Read::More
    }

    fn end_header(&mut self) -> Read {
        let (_, remote) = self.identifier();
        self.length = if remote && !self.fd { 0 } else { length_of(self.code(), self.fd) };
        if self.length > 0 { self.go(Part::Data) } else { self.begin_checksum() }
    }

    fn data_bit(&mut self, bit: bool) -> Read {
        self.cover(bit);
        let byte = &mut self.data[(self.count / 8) as usize];
        *byte = *byte << 1 | u8::from(bit);
        self.count += 1;
        if self.count as usize == 8 * self.length { self.begin_checksum() } else { Read::More }
    }

    fn begin_checksum(&mut self) -> Read {
        self.go(if self.fd { Part::FdChecksum } else { Part::ClassicChecksum })
    }

    fn classic_checksum_is_read(&self) -> bool {
        self.part == Part::ClassicChecksum && self.count == self.classic_crc.width()
    }

    fn classic_checksum_bit(&mut self, bit: bool) -> Read {
        self.checksum = self.checksum << 1 | u32::from(bit);
        self.count += 1;
        if !self.classic_checksum_is_read() {
            return Read::More;
        }
        self.valid = self.checksum == self.classic_crc.value();
        // A stuff bit can follow the last bit.
        if self.run == RUN { Read::More } else { self.go(Part::Delimiter) }
    }

    fn fd_checksum_bit(&mut self, bit: bool) -> Read {
        let fixed = self.count.is_multiple_of(5);
        self.count += 1;
        let last = std::mem::replace(&mut self.last, bit);
        if fixed {
            return if bit == last { Read::Error(ErrorKind::Form) } else { Read::More };
        }
        self.checksum = self.checksum << 1 | u32::from(bit);
        // The stuff count is covered by the checksum.
        if self.count <= 5 {
            self.cover_stuffed(bit);
        }
        let crc = if self.length > LONGEST_CRC_17 { self.long_crc } else { self.short_crc };
        let bits = 4 + crc.width();
        if self.count < bits + bits.div_ceil(4) {
            return Read::More;
        }
        self.valid = self.checksum == stuff_count(self.stuffed) << crc.width() | crc.value();
        self.go(Part::Delimiter)
    }

    fn end_bit(&mut self, bit: bool) -> Read {
        self.count += 1;
        match (self.count, bit) {
            (END, RECESSIVE) => Read::Ended,
            (END, DOMINANT) => Read::Overload,
            (_, DOMINANT) => Read::Error(ErrorKind::Form),
            (at, RECESSIVE) if at == END - 1 => Read::Accepted,
            (_, RECESSIVE) => Read::More,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::wire::Wire;

    /// What a receiver reads of these bits after the start of frame.
    fn read(bits: impl IntoIterator<Item = bool>) -> (Vec<Read>, Reader) {
        let mut reader = Reader::new();
        let seen = bits.into_iter().map(|bit| reader.push(bit)).collect();
        (seen, reader)
    }

    fn frames() -> Vec<Frame> {
        let data: Vec<u8> = (0..64).map(|at: u8| if at.is_multiple_of(3) { 0 } else { at }).collect();
        let ids = [Id::Base(0x185), Id::Base(0), Id::Extended(0x1234_5678), Id::Extended(0)];
        ids.into_iter()
            .flat_map(|id| {
                let classic = (0..=8).flat_map(move |length| {
                    let data = &[0, 0, 0xC0, 0x3F, 0xE8, 0xB7, 0xD7, 0x1D][..length];
                    [Frame::data(id, data), Frame::remote(id, length)]
                });
                let fd = [0, 1, 7, 8, 12, 16, 20, 24, 32, 48, 64]
                    .map(|length| Frame::fd(id, &data[..length], length % 8 == 0));
                classic.chain(fd).map(Result::unwrap).collect::<Vec<_>>()
            })
            .collect()
    }

    #[test]
    fn what_is_written_is_read() {
        for frame in frames() {
            let (seen, reader) = read(Wire::of(&frame, false).levels().skip(1));
            let (ended, before) = seen.split_last().unwrap();
            assert_eq!((*ended, before.last()), (Read::Ended, Some(&Read::Accepted)), "{frame:?}");
            assert!(before.iter().rev().skip(1).all(|read| *read == Read::More));
            assert_eq!(reader.frame(), Some(frame));
        }
    }

    /// CRC-15 finds any single flipped bit; so do stuffing and form. Only three bits do not matter to a
    /// receiver: SRR or a reserved bit that the checksum does not cover, there are none, and the slot; the
    /// last bit of the end asks for time.
    #[test]
    fn every_flipped_bit_is_found_but_the_slot() {
        for frame in frames() {
            let levels: Vec<bool> = Wire::of(&frame, false).levels().collect();
            let slot = levels.len() - 9;
            for flipped in 1..levels.len() {
                let mut bits = levels.clone();
                bits[flipped] = !bits[flipped];
                // Recessive bits follow, for a receiver that thinks that the frame is longer.
                bits.extend([RECESSIVE; 20]);
                let (seen, _) = read(bits.into_iter().skip(1));
                let first = seen.iter().find(|read| **read != Read::More).unwrap();
                let found = matches!(first, Read::Error(_));
                // Accepted, and then an overload.
                let harmless = flipped == slot || flipped == levels.len() - 1;
                assert_ne!(found, harmless, "{frame:?}: bit {flipped}: {first:?}");
            }
        }
    }
}
