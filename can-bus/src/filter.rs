//! Which received frames a controller keeps.

use crate::frame::{Id, LARGEST_BASE};

/// Words of a set of 11-bit identifiers.
const WORDS: usize = (LARGEST_BASE as usize + 1) / 64;

/// An acceptance filter. What it does not keep is acknowledged all the same. How many identifiers and masks
/// the filter banks of a chip hold is not modelled.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Filter {
    base: [u64; WORDS],
    /// Identifier and mask: the bits of the mask must be those of the identifier.
    extended: Vec<(u32, u32)>,
}

impl Filter {
    /// Keeps every frame.
    pub fn everything() -> Self {
        Self { base: [u64::MAX; WORDS], extended: vec![(0, 0)] }
    }

    /// Keeps nothing yet.
    pub fn nothing() -> Self {
        Self { base: [0; WORDS], extended: Vec::new() }
    }

    /// Keeps this identifier too.
    #[must_use]
    pub fn and(self, id: Id) -> Self {
        match id {
            Id::Base(id) => self.and_base(id, LARGEST_BASE),
            Id::Extended(id) => self.and_extended(id, u32::MAX),
        }
    }

    /// Keeps the 11-bit identifiers too that have, in the bits of the mask, those of this one.
    #[must_use]
    pub fn and_base(mut self, id: u16, mask: u16) -> Self {
        for each in (0..=LARGEST_BASE).filter(|each| (each ^ id) & mask == 0) {
            self.base[usize::from(each / 64)] |= 1 << (each % 64);
        }
        self
    }

    /// Keeps the 29-bit identifiers too that have, in the bits of the mask, those of this one.
    #[must_use]
    pub fn and_extended(mut self, id: u32, mask: u32) -> Self {
        self.extended.push((id, mask));
        self
    }

    /// Whether it keeps a frame with this identifier.
    pub fn keeps(&self, id: Id) -> bool {
        match id {
            Id::Base(id) => self.base[usize::from(id / 64) % WORDS] >> (id % 64) & 1 == 1,
            Id::Extended(id) => self.extended.iter().any(|(wanted, mask)| (wanted ^ id) & mask == 0),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn it_keeps_what_it_was_told_and_nothing_else() {
        let filter =
            Filter::nothing().and(Id::Base(0x185)).and_base(0x080, 0x780).and_extended(0x1_0000, 0xFF_0000);
        let base: Vec<u16> = (0..=LARGEST_BASE).filter(|&id| filter.keeps(Id::Base(id))).collect();
        assert_eq!(base, (0x080..0x100).chain([0x185]).collect::<Vec<_>>());
        assert!(filter.keeps(Id::Extended(0x101_1234)) && !filter.keeps(Id::Extended(0x185)));
        assert!(Filter::everything().keeps(Id::Base(0x7FF)) && Filter::everything().keeps(Id::Extended(0)));
    }
}
