//! The three checksums of ISO 11898-1: CRC-15 of classic frames, CRC-17 and CRC-21 of CAN FD.

const POLYNOMIAL_15: u16 = 0x4599;
const MASK_15: u16 = 0x7FFF;

/// Bytes of what is given as a number.
const BYTES: usize = 16;

/// CRC-15 of one byte.
const TABLE_15: [u16; 256] = {
    let mut table = [0; 256];
    let mut byte = 0;
    while byte < 256 {
        let mut bit = 0;
        while bit < 8 {
            table[byte] = step_15(table[byte], byte >> (7 - bit) & 1 == 1);
            bit += 1;
        }
        byte += 1;
    }
    table
};

const fn step_15(crc: u16, bit: bool) -> u16 {
    let shifted = (crc << 1) & MASK_15;
    if (crc >> 14 & 1 == 1) == bit { shifted } else { shifted ^ POLYNOMIAL_15 }
}

/// CRC-15 of `bytes` bytes, the last ones of `bits`. It begins with zero, so zeros before the first one
/// change nothing.
pub(crate) fn crc_15(bits: u128, bytes: u32) -> u16 {
    bits.to_be_bytes()[BYTES - bytes as usize..]
        .iter()
        .fold(0, |crc, byte| (crc << 8) & MASK_15 ^ TABLE_15[usize::from((crc >> 7) as u8 ^ byte)])
}

/// A checksum that takes one bit after the other.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Crc {
    polynomial: u32,
    width: u32,
    value: u32,
}

impl Crc {
    /// CRC-15.
    pub(crate) const fn of_classic() -> Self {
        Self { polynomial: POLYNOMIAL_15 as u32, width: 15, value: 0 }
    }

    /// CRC-17, for CAN FD up to 16 bytes. CAN FD begins with a one in the first place, or leading zeros would
    /// not be covered.
    pub(crate) const fn of_short_fd() -> Self {
        Self { polynomial: 0x1_685B, width: 17, value: 1 << 16 }
    }

    /// CRC-21, for CAN FD above 16 bytes.
    pub(crate) const fn of_long_fd() -> Self {
        Self { polynomial: 0x10_2899, width: 21, value: 1 << 20 }
    }

    pub(crate) fn push(&mut self, bit: bool) {
        let top = self.value >> (self.width - 1) & 1 == 1;
        self.value = (self.value << 1) & ((1 << self.width) - 1);
        if top != bit {
            self.value ^= self.polynomial;
        }
    }

    pub(crate) fn value(self) -> u32 {
        self.value
    }

    pub(crate) fn width(self) -> u32 {
        self.width
    }
}

/// Number of data bytes up to which CAN FD has CRC-17.
pub(crate) const LONGEST_CRC_17: usize = 16;

#[cfg(test)]
mod tests {
    use super::*;

    fn of(mut crc: Crc, bytes: &[u8]) -> u32 {
        for byte in bytes {
            (0..8).rev().for_each(|at| crc.push(byte >> at & 1 == 1));
        }
        crc.value()
    }

    /// Check values of the catalogue of parametrised CRC algorithms (CRC-15/CAN, CRC-17/CAN-FD, CRC-21/CAN-FD
    /// begin with zero there).
    #[test]
    fn the_digits_give_the_values_of_the_catalogue() {
        let digits = b"123456789";
        let from_zero = |crc: Crc| of(Crc { value: 0, ..crc }, digits);
        assert_eq!(from_zero(Crc::of_classic()), 0x059E);
        assert_eq!(from_zero(Crc::of_short_fd()), 0x0_4F03);
        assert_eq!(from_zero(Crc::of_long_fd()), 0x0E_D841);
        let all = digits.iter().fold(0, |all, &byte| all << 8 | u128::from(byte));
        assert_eq!(crc_15(all, 9), 0x059E);
        assert_eq!(crc_15(all, 12), 0x059E);
    }
}
