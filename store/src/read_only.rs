//! Flash that cannot be changed: looking at a store must not try to repair it.

use embedded_storage_async::nor_flash::{
    ErrorType, NorFlash, NorFlashError, NorFlashErrorKind, ReadNorFlash,
};

/// Passes reads on and refuses the rest.
pub struct ReadOnly<'a, S>(pub &'a mut S);

/// The driver's error, or the refusal of a change.
#[derive(Debug)]
pub enum ReadError<E> {
    Refused,
    Flash(E),
}

impl<E: NorFlashError> NorFlashError for ReadError<E> {
    fn kind(&self) -> NorFlashErrorKind {
        match self {
            Self::Refused => NorFlashErrorKind::Other,
            Self::Flash(error) => error.kind(),
        }
    }
}

impl<S: ErrorType> ErrorType for ReadOnly<'_, S> {
    type Error = ReadError<S::Error>;
}

impl<S: ReadNorFlash> ReadNorFlash for ReadOnly<'_, S> {
    const READ_SIZE: usize = S::READ_SIZE;

    async fn read(&mut self, offset: u32, bytes: &mut [u8]) -> Result<(), Self::Error> {
        self.0.read(offset, bytes).await.map_err(ReadError::Flash)
    }

    fn capacity(&self) -> usize {
        self.0.capacity()
    }
}

impl<S: NorFlash> NorFlash for ReadOnly<'_, S> {
    const WRITE_SIZE: usize = S::WRITE_SIZE;
    const ERASE_SIZE: usize = S::ERASE_SIZE;

    async fn erase(&mut self, _from: u32, _to: u32) -> Result<(), Self::Error> {
        Err(ReadError::Refused)
    }

    async fn write(&mut self, _offset: u32, _bytes: &[u8]) -> Result<(), Self::Error> {
        Err(ReadError::Refused)
    }
}
