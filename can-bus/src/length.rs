//! How many bits a frame takes on the bus, and how long.
//!
//! # What the lengths are made of (ISO 11898-1)
//!
//! | bits | classic | CAN FD |
//! |---|---|---|
//! | start of frame to control field | 19, or 39 with a 29-bit identifier | 22, or 41 |
//! | data | 8 each byte | 8 each byte |
//! | stuff count | | 4 |
//! | checksum | 15 | 17; 21 above 16 bytes |
//! | stuff bits | by content, to the end of the checksum | by content, to the end of the data; 6 or 7 fixed ones from there |
//! | delimiter, acknowledgement, delimiter | 3 | 3 |
//! | end of frame, intermission | 7 + 3 | 7 + 3 |

use crate::crc::{LONGEST_CRC_17, crc_15};
use crate::frame::{Frame, Id, Kind};
use crate::rate::Timing;
use crate::stuff::Stuffing;

/// Bits of the end of frame.
pub const END: u32 = 7;
/// Bits between two frames.
pub const INTERMISSION: u32 = 3;
/// Delimiter of the checksum, acknowledgement slot and its delimiter.
pub(crate) const ACKNOWLEDGEMENT: u32 = 3;
/// Stuff count of CAN FD.
const STUFF_COUNT: u32 = 4;
/// In the checksum field of CAN FD a fixed stuff bit comes before each four bits.
const FIXED_EVERY: u32 = 4;

/// Bits of a frame from its start to the end of the intermission.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Length {
    /// Bits at the nominal rate.
    pub nominal: u32,
    /// Bits at the faster rate. The bit that switches to it, and the delimiter that switches back, change
    /// within: together they last as long as one of each, so one counts here and one there.
    pub fast: u32,
    /// Stuff bits among all, fixed ones included.
    pub stuffed: u32,
}

impl Length {
    /// The length of a frame. `passive` says whether its sender is error-passive, which a CAN FD frame tells.
    pub fn of(frame: &Frame, passive: bool) -> Self {
        match frame.kind() {
            Kind::Fd { switch } => fd(frame, switch, passive),
            Kind::Data | Kind::Remote => classic(frame),
        }
    }

    /// All bits.
    pub fn bits(self) -> u32 {
        self.nominal + self.fast
    }

    /// Time on the bus, ns.
    pub fn ns(self, timing: Timing) -> u64 {
        u64::from(self.nominal) * timing.nominal().bit_ns() + u64::from(self.fast) * timing.data().bit_ns()
    }
}

/// Bits before the data field, and their number: the last ones of the value.
pub(crate) fn header(frame: &Frame, passive: bool) -> (u128, u32) {
    let dlc = u64::from(frame.dlc());
    let remote = u64::from(frame.kind() == Kind::Remote);
    // From the bit after the identifier on: RTR or RRS; with a base identifier IDE; FDF; then a reserved bit
    // or the rest of CAN FD's.
    let (tail, length) = match (frame.kind(), frame.id()) {
        (Kind::Fd { switch }, id) => {
            let control = 0b10 << 6 | u64::from(switch) << 5 | u64::from(passive) << 4 | dlc;
            (control, if matches!(id, Id::Base(_)) { 10 } else { 9 })
        }
        (_, Id::Base(_)) => (remote << 6 | dlc, 7),
        (_, Id::Extended(_)) => (remote << 6 | dlc, 7),
    };
    let (start, before) = match frame.id() {
        Id::Base(id) => (u64::from(id), 12),
        Id::Extended(id) => {
            let (base, extension) = (u64::from(id >> 18), u64::from(id & 0x3_FFFF));
            (base << 20 | 0b11 << 18 | extension, 32)
        }
    };
    (u128::from(start << length | tail), before + length)
}

fn classic(frame: &Frame) -> Length {
    let (bits, length) = header(frame, false);
    let (data, bytes) = frame.classic_bytes();
    let covered = bits << (8 * bytes) | u128::from(data);
    let crc = crc_15(covered, length.div_ceil(8) + bytes);
    let mut stuffing = Stuffing::after_start();
    // All but the start of frame.
    let stuffed_over = length - 1 + 8 * bytes + 15;
    stuffing.bits(covered << 15 | u128::from(crc), stuffed_over);
    let stuffed = stuffing.count();
    Length { nominal: 1 + stuffed_over + stuffed + ACKNOWLEDGEMENT + END + INTERMISSION, fast: 0, stuffed }
}

fn fd(frame: &Frame, switch: bool, passive: bool) -> Length {
    let (bits, length) = header(frame, passive);
    // After the bit that switches come the sender's state and the data length code.
    let fast_in_header = 5;
    let mut stuffing = Stuffing::after_start();
    stuffing.bits(bits >> fast_in_header, length - fast_in_header - 1);
    // Nothing is stuffed right after a bit that switches: it is recessive after a dominant one.
    let stuffed_before = stuffing.count();
    stuffing.bits(bits & 0b1_1111, fast_in_header);
    frame.bytes().iter().for_each(|&byte| stuffing.byte(byte));
    let dynamic = stuffing.count_between();
    let checksum = STUFF_COUNT + if frame.length() > LONGEST_CRC_17 { 21 } else { 17 };
    let fixed = checksum.div_ceil(FIXED_EVERY);
    // The delimiter of the checksum, which switches back, counts as fast.
    let fast =
        fast_in_header + 8 * frame.bytes().len() as u32 + dynamic - stuffed_before + checksum + fixed + 1;
    let nominal = length - fast_in_header + stuffed_before + ACKNOWLEDGEMENT - 1 + END + INTERMISSION;
    let stuffed = dynamic + fixed;
    if switch {
        Length { nominal, fast, stuffed }
    } else {
        Length { nominal: nominal + fast, fast: 0, stuffed }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A state of the node's protocol, computed by hand elsewhere.
    #[test]
    fn a_known_frame_has_117_bits_and_6_stuff_bits() {
        let data = [0x00, 0x00, 0xC0, 0x3F, 0xE8, 0xB7, 0xD7, 0x1D];
        let length = Length::of(&Frame::data(Id::Base(0x185), &data).unwrap(), false);
        assert_eq!((length.bits(), length.stuffed, length.fast), (117, 6, 0));
    }

    /// The worst case of Davis et al., Real-Time Systems 35 (2007): a stuff bit after the first five bits and
    /// each four more.
    #[test]
    fn no_frame_is_longer_than_the_worst_case() {
        let longest = |id: Id, bytes: usize| {
            let lengths = (0..=u8::MAX)
                .map(|byte| Length::of(&Frame::data(id, &vec![byte; bytes]).unwrap(), false).bits());
            lengths.max().unwrap() as usize
        };
        for bytes in 0..=8 {
            assert!(longest(Id::Base(0x078), bytes) <= 47 + 8 * bytes + (33 + 8 * bytes) / 4);
            assert!(longest(Id::Extended(0), bytes) <= 67 + 8 * bytes + (53 + 8 * bytes) / 4);
        }
    }

    /// Without a switch all bits are nominal; with one the same bits, or one more where the bit itself makes
    /// a run.
    #[test]
    fn a_switch_moves_bits_to_the_faster_rate() {
        let of = |switch| Length::of(&Frame::fd(Id::Base(0x555), &[0x55; 8], switch).unwrap(), false);
        let (slow, fast) = (of(false), of(true));
        assert_eq!((slow.bits(), slow.fast), (fast.bits(), 0));
        // ESI, DLC, data, stuff count, CRC-17, six fixed stuff bits, delimiter.
        assert_eq!(fast.fast, 5 + 64 + 4 + 17 + 6 + 1);
    }
}
