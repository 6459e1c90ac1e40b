//! Flash that cannot be changed while it is looked at: a map repairs what it reads. One type for both uses,
//! since every other one is some 10 KiB of map more in the image.

use embedded_storage_async::nor_flash::{
    ErrorType, NorFlash, NorFlashError, NorFlashErrorKind, ReadNorFlash,
};

/// Passes reads on, and changes where they are allowed.
pub struct Guard<'a, S> {
    pub flash: &'a mut S,
    pub may_change: bool,
    /// A hash of all that was read so far.
    pub seen: &'a mut u32,
}

impl<S: ErrorType> Guard<'_, S> {
    fn changed(&mut self) -> Result<&mut S, GuardError<S::Error>> {
        if self.may_change { Ok(self.flash) } else { Err(GuardError::Refused) }
    }
}

/// The driver's error, or the refusal of a change.
#[derive(Debug)]
pub enum GuardError<E> {
    Refused,
    Flash(E),
}

impl<E: NorFlashError> NorFlashError for GuardError<E> {
    fn kind(&self) -> NorFlashErrorKind {
        match self {
            Self::Refused => NorFlashErrorKind::Other,
            Self::Flash(error) => error.kind(),
        }
    }
}

impl<S: ErrorType> ErrorType for Guard<'_, S> {
    type Error = GuardError<S::Error>;
}

impl<S: ReadNorFlash> ReadNorFlash for Guard<'_, S> {
    const READ_SIZE: usize = S::READ_SIZE;

    async fn read(&mut self, offset: u32, bytes: &mut [u8]) -> Result<(), Self::Error> {
        self.flash.read(offset, bytes).await.map_err(GuardError::Flash)?;
        // FNV-1a: not against malice, but against cells.
        let hash = |hash: u32, &byte: &u8| (hash ^ u32::from(byte)).wrapping_mul(0x0100_0193);
        *self.seen = bytes.iter().fold(*self.seen, hash);
        Ok(())
    }

    fn capacity(&self) -> usize {
        self.flash.capacity()
    }
}

impl<S: NorFlash> NorFlash for Guard<'_, S> {
    const WRITE_SIZE: usize = S::WRITE_SIZE;
    const ERASE_SIZE: usize = S::ERASE_SIZE;

    async fn erase(&mut self, from: u32, to: u32) -> Result<(), Self::Error> {
        self.changed()?.erase(from, to).await.map_err(GuardError::Flash)
    }

    async fn write(&mut self, offset: u32, bytes: &[u8]) -> Result<(), Self::Error> {
        self.changed()?.write(offset, bytes).await.map_err(GuardError::Flash)
    }
}
