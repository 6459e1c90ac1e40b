//! Random frames, the same ones for every judge.
#![allow(dead_code, reason = "each test uses a part of it")]

use funnelnet_can_bus::{Frame, Id, Kind};
use std::fmt::Write as _;

/// SplitMix64 (Steele, Lea and Flood, 2014).
pub struct Random(pub u64);

impl Random {
    pub fn next(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9E37_79B9_7F4A_7C15);
        let z = (self.0 ^ (self.0 >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
        let z = (z ^ (z >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
        z ^ (z >> 31)
    }

    pub fn below(&mut self, end: u64) -> u64 {
        self.next() % end
    }

    /// Half of all bytes have one level only, so that runs are long and stuff bits many.
    fn byte(&mut self) -> u8 {
        match self.below(4) {
            0 => 0x00,
            1 => 0xFF,
            _ => self.next() as u8,
        }
    }

    fn id(&mut self) -> Id {
        // Identifiers with long runs of equal bits are frequent too.
        let mask = if self.below(2) == 0 { self.next() } else { u64::MAX };
        if self.below(2) == 0 {
            Id::Base((self.next() & mask & 0x7FF) as u16)
        } else {
            Id::Extended((self.next() & mask & 0x1FFF_FFFF) as u32)
        }
    }

    fn bytes(&mut self, length: usize) -> Vec<u8> {
        (0..length).map(|_| self.byte()).collect()
    }

    pub fn classic(&mut self) -> Frame {
        let (id, length) = (self.id(), self.below(9) as usize);
        if self.below(8) == 0 {
            return Frame::remote(id, length).unwrap();
        }
        Frame::data(id, &self.bytes(length)).unwrap()
    }

    /// Short ones are more frequent.
    pub fn fd(&mut self) -> Frame {
        let codes = if self.below(4) == 0 { 16 } else { 10 };
        let length = [0, 1, 2, 3, 4, 5, 6, 7, 8, 12, 16, 20, 24, 32, 48, 64][self.below(codes) as usize];
        let id = self.id();
        Frame::fd(id, &self.bytes(length), self.below(2) == 0).unwrap()
    }
}

/// A line for a judge: identifier, whether it is extended, remote, FD, switches, is of a passive sender;
/// length; data.
pub fn line(frame: &Frame, passive: bool) -> String {
    let (id, extended) = match frame.id() {
        Id::Base(id) => (u32::from(id), 0),
        Id::Extended(id) => (id, 1),
    };
    let flag = |condition: bool| u8::from(condition);
    let (remote, fd) = (flag(frame.kind() == Kind::Remote), flag(frame.is_fd()));
    let switch = flag(frame.kind() == Kind::Fd { switch: true });
    let mut line = format!("{id:x} {extended} {remote} {fd} {switch} {} {} x", flag(passive), frame.length());
    for byte in frame.bytes() {
        write!(line, "{byte:02x}").unwrap();
    }
    line
}
