//! Flash, played by RAM that survives a reset of the emulated board: 2 KiB pages, words of 8 bytes, as the
//! STM32G4 has.
//!
//! RAM begins as zeros, so bits are kept inverted: a new board's flash is erased.

use core::sync::atomic::{AtomicU8, Ordering};

use embedded_storage::nor_flash::{
    ErrorType, NorFlash, NorFlashErrorKind, ReadNorFlash, check_erase, check_read, check_write,
};
use static_cell::StaticCell;

use crate::storage::Medium;
use crate::storage::flash::{Blocking, InFlash};

/// Bytes.
pub const SIZE: usize = 4 * 2048;

#[allow(unsafe_code)] // Any content is a valid one.
#[unsafe(link_section = ".uninit.flash")]
static CELLS: [AtomicU8; SIZE] = [const { AtomicU8::new(0) }; SIZE];

/// The one flash.
pub struct Flash;

/// A configuration in all of it: it stays over a reset, and goes with the emulator.
impl Medium for Flash {
    type Storage = InFlash<Blocking<Self>>;

    async fn open(self, place: &'static StaticCell<Self::Storage>) -> &'static mut Self::Storage {
        let storage = place.init_with(|| InFlash::new(Blocking(self), 0..SIZE as u32));
        storage.open().await;
        storage
    }
}

impl Flash {
    /// Bytes from `offset` on.
    fn cells(offset: u32, length: usize) -> impl Iterator<Item = &'static AtomicU8> {
        CELLS.iter().skip(offset as usize).take(length)
    }
}

impl ErrorType for Flash {
    type Error = NorFlashErrorKind;
}

impl ReadNorFlash for Flash {
    const READ_SIZE: usize = 1;

    fn read(&mut self, offset: u32, bytes: &mut [u8]) -> Result<(), Self::Error> {
        check_read(self, offset, bytes.len())?;
        for (byte, cell) in bytes.iter_mut().zip(Self::cells(offset, SIZE)) {
            *byte = !cell.load(Ordering::Relaxed);
        }
        Ok(())
    }

    fn capacity(&self) -> usize {
        SIZE
    }
}

impl NorFlash for Flash {
    const WRITE_SIZE: usize = 8;
    const ERASE_SIZE: usize = 2048;

    fn erase(&mut self, from: u32, to: u32) -> Result<(), Self::Error> {
        check_erase(self, from, to)?;
        Self::cells(from, (to - from) as usize).for_each(|cell| cell.store(0, Ordering::Relaxed));
        Ok(())
    }

    fn write(&mut self, offset: u32, bytes: &[u8]) -> Result<(), Self::Error> {
        check_write(self, offset, bytes.len())?;
        for (byte, cell) in bytes.iter().zip(Self::cells(offset, SIZE)) {
            cell.store(cell.load(Ordering::Relaxed) | !byte, Ordering::Relaxed);
        }
        Ok(())
    }
}
