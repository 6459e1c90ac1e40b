//! Flash with few, large erase pages, each shown as several smaller ones: a store wants two pages for each
//! half, and erases a half as a whole.

use core::fmt;

use embedded_storage_async::nor_flash::{
    ErrorType, NorFlash, NorFlashError, NorFlashErrorKind, ReadNorFlash,
};

/// `S` with every erase page shown as `PARTS` pages. They can be erased together and not alone.
#[derive(Clone, Debug)]
pub struct Split<S, const PARTS: usize>(pub S);

/// The driver's error, or the refusal of an erase.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum SplitError<E> {
    /// The bytes `from..to` are not whole erase pages of the flash.
    NotWhole {
        /// First byte.
        from: u32,
        /// Byte after the last one.
        to: u32,
    },
    /// The flash driver's.
    Flash(E),
}

impl<E: fmt::Debug> fmt::Display for SplitError<E> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::NotWhole { from, to } => write!(f, "{from:#x}..{to:#x} are not whole pages to erase"),
            Self::Flash(error) => write!(f, "{error:?}"),
        }
    }
}

impl<E: fmt::Debug> core::error::Error for SplitError<E> {}

impl<E: NorFlashError> NorFlashError for SplitError<E> {
    fn kind(&self) -> NorFlashErrorKind {
        match self {
            Self::NotWhole { .. } => NorFlashErrorKind::NotAligned,
            Self::Flash(error) => error.kind(),
        }
    }
}

impl<S: ErrorType, const PARTS: usize> ErrorType for Split<S, PARTS> {
    type Error = SplitError<S::Error>;
}

impl<S: ReadNorFlash, const PARTS: usize> ReadNorFlash for Split<S, PARTS> {
    const READ_SIZE: usize = S::READ_SIZE;

    async fn read(&mut self, offset: u32, bytes: &mut [u8]) -> Result<(), Self::Error> {
        self.0.read(offset, bytes).await.map_err(SplitError::Flash)
    }

    fn capacity(&self) -> usize {
        self.0.capacity()
    }
}

impl<S: NorFlash, const PARTS: usize> NorFlash for Split<S, PARTS> {
    const WRITE_SIZE: usize = S::WRITE_SIZE;
    const ERASE_SIZE: usize = S::ERASE_SIZE / PARTS;

    async fn erase(&mut self, from: u32, to: u32) -> Result<(), Self::Error> {
        let whole = S::ERASE_SIZE as u32;
        if !from.is_multiple_of(whole) || !to.is_multiple_of(whole) {
            return Err(SplitError::NotWhole { from, to });
        }
        self.0.erase(from, to).await.map_err(SplitError::Flash)
    }

    async fn write(&mut self, offset: u32, bytes: &[u8]) -> Result<(), Self::Error> {
        self.0.write(offset, bytes).await.map_err(SplitError::Flash)
    }
}
