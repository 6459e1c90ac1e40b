//! A part of a flash with words of [`WORD`] bytes, whatever the chip can write at once.
//!
//! `embassy-boot` tells what to do by one word, and counts pages by others. On a chip that writes single bytes
//! a word is a byte. An erase that is cut off sets some bits and not others; then a byte that said "booted"
//! (0xD0) can say "swap" (0xF0), and marks of pages can be set in part. Words of eight bytes, all the same,
//! do not come about so (tests/power_cut.rs has the narrow ones, too).

use embedded_storage::nor_flash as blocking;
use embedded_storage_async::nor_flash::{ErrorType, NorFlash, ReadNorFlash};

/// Bytes.
pub const WORD: usize = 8;

/// A flash whose words are `W` bytes long: a multiple of what the chip writes.
pub struct Wide<F, const W: usize = WORD>(pub F);

impl<F: ErrorType, const W: usize> ErrorType for Wide<F, W> {
    type Error = F::Error;
}

impl<F: blocking::ReadNorFlash, const W: usize> blocking::ReadNorFlash for Wide<F, W> {
    const READ_SIZE: usize = F::READ_SIZE;

    fn read(&mut self, offset: u32, bytes: &mut [u8]) -> Result<(), Self::Error> {
        self.0.read(offset, bytes)
    }

    fn capacity(&self) -> usize {
        self.0.capacity()
    }
}

impl<F: blocking::NorFlash, const W: usize> blocking::NorFlash for Wide<F, W> {
    const WRITE_SIZE: usize = const {
        assert!(W.is_multiple_of(F::WRITE_SIZE) && F::ERASE_SIZE.is_multiple_of(W));
        W
    };
    const ERASE_SIZE: usize = F::ERASE_SIZE;

    fn erase(&mut self, from: u32, to: u32) -> Result<(), Self::Error> {
        self.0.erase(from, to)
    }

    fn write(&mut self, offset: u32, bytes: &[u8]) -> Result<(), Self::Error> {
        self.0.write(offset, bytes)
    }
}

/// A window into a flash that waits, which counts from the window's beginning.
pub(crate) struct Window<'a, S> {
    pub flash: &'a mut S,
    pub start: u32,
    pub length: u32,
}

impl<S: ErrorType> ErrorType for Window<'_, S> {
    type Error = S::Error;
}

impl<S: ReadNorFlash> ReadNorFlash for Window<'_, S> {
    const READ_SIZE: usize = S::READ_SIZE;

    async fn read(&mut self, offset: u32, bytes: &mut [u8]) -> Result<(), Self::Error> {
        self.flash.read(self.start.saturating_add(offset), bytes).await
    }

    fn capacity(&self) -> usize {
        self.length as usize
    }
}

impl<S: NorFlash> NorFlash for Window<'_, S> {
    const WRITE_SIZE: usize = const {
        assert!(WORD.is_multiple_of(S::WRITE_SIZE) && S::ERASE_SIZE.is_multiple_of(WORD));
        WORD
    };
    const ERASE_SIZE: usize = S::ERASE_SIZE;

    async fn erase(&mut self, from: u32, to: u32) -> Result<(), Self::Error> {
        self.flash.erase(self.start.saturating_add(from), self.start.saturating_add(to)).await
    }

    async fn write(&mut self, offset: u32, bytes: &[u8]) -> Result<(), Self::Error> {
        self.flash.write(self.start.saturating_add(offset), bytes).await
    }
}
