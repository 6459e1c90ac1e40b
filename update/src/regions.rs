//! Where programs are in the flash.

use core::ops::Range;

use crate::WORD;

/// Parts of a flash, in bytes from its beginning, in whole pages.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Regions {
    /// The program that runs.
    pub active: Range<u32>,
    /// The next program, or the one before; a page more than `active`.
    pub spare: Range<u32>,
    /// How far the boot loader is; one page.
    pub state: Range<u32>,
}

impl Regions {
    /// Longest program, bytes.
    pub fn room(&self) -> u32 {
        length(&self.active)
    }

    /// Whether `embassy-boot` can swap programs in here, with pages of so many bytes. It panics where it
    /// cannot.
    pub fn suit(&self, page: u32) -> bool {
        let parts = [&self.active, &self.spare, &self.state];
        let whole = |part: &Range<u32>| part.start.is_multiple_of(page) && part.end.is_multiple_of(page);
        let Some(pages) = self.room().checked_div(page) else { return false };
        let apart = |a: &Range<u32>, b: &Range<u32>| a.end <= b.start || b.end <= a.start;
        pages > 0
            && parts.into_iter().all(|part| part.start < part.end && whole(part))
            && length(&self.spare) >= self.room().saturating_add(page)
            // Magic, validity, and two marks for each page on either way.
            && length(&self.state) / WORD as u32 >= pages.saturating_mul(4).saturating_add(2)
            && apart(&self.active, &self.spare)
            && apart(&self.active, &self.state)
            && apart(&self.spare, &self.state)
    }
}

fn length(part: &Range<u32>) -> u32 {
    part.end.saturating_sub(part.start)
}
