//! Flash played by a file, with the manners of the real one, so that a node in a process keeps its
//! configuration as a board does.

use embedded_storage_async::nor_flash::{
    ErrorType, NorFlash, NorFlashError, NorFlashErrorKind, ReadNorFlash,
};
use funnelnet_app::storage::Storage;
use funnelnet_node::Task;
use funnelnet_protocol::NodeConfig;
use funnelnet_protocol::service::StoreError;
use funnelnet_store::Store;
use std::fmt::Display;
use std::fs::{File, OpenOptions, TryLockError};
use std::io::{self, Read};
use std::os::unix::fs::FileExt;
use std::path::Path;
use std::pin::pin;
use std::task::{Context, Poll, Waker};

/// Bytes: four pages, two for each half of a store.
const LENGTH: usize = 4 * PAGE;
const PAGE: usize = 4096;
const WORD: usize = 4;

/// The file; another process cannot use it meanwhile.
#[derive(Debug)]
pub struct FlashFile(File);

impl FlashFile {
    /// Opens a file, or makes one that is erased; one whose making was interrupted is completed.
    ///
    /// # Errors
    /// What is wrong with it, for the user.
    pub fn open(path: &Path) -> Result<Self, String> {
        let fail =
            |why: &dyn std::fmt::Display| format!("the storage {} cannot be used: {why}", path.display());
        let opened = OpenOptions::new().read(true).write(true).create(true).truncate(false).open(path);
        let file = opened.map_err(|error| fail(&error))?;
        match file.try_lock() {
            Ok(()) => {}
            Err(TryLockError::WouldBlock) => return Err(fail(&"another node uses it")),
            Err(TryLockError::Error(error)) => return Err(fail(&error)),
        }
        let length = file.metadata().map_err(|error| fail(&error))?.len();
        if length != LENGTH as u64 {
            if !is_unfinished(&file).map_err(|error| fail(&error))? {
                return Err(fail(&format_args!("it has {length} bytes, and a storage has {LENGTH}")));
            }
            file.write_all_at(&[0xFF; LENGTH], 0).map_err(|error| fail(&error))?;
        }
        Ok(Self(file))
    }
}

/// Whether it is shorter than a storage, and erased as far as it goes.
fn is_unfinished(file: &File) -> io::Result<bool> {
    let mut there = Vec::new();
    file.take(LENGTH as u64).read_to_end(&mut there)?;
    Ok(there.len() < LENGTH && there.iter().all(|&byte| byte == 0xFF))
}

/// The operating system's, or an access that a chip would refuse.
#[derive(Debug)]
pub enum FlashError {
    /// Reading or writing the file.
    Io(io::Error),
    /// Where or how long the access was.
    Access(NorFlashErrorKind),
}

impl NorFlashError for FlashError {
    fn kind(&self) -> NorFlashErrorKind {
        match self {
            Self::Io(_) => NorFlashErrorKind::Other,
            Self::Access(kind) => *kind,
        }
    }
}

impl ErrorType for FlashFile {
    type Error = FlashError;
}

impl ReadNorFlash for FlashFile {
    const READ_SIZE: usize = 1;

    async fn read(&mut self, offset: u32, bytes: &mut [u8]) -> Result<(), FlashError> {
        check(offset, bytes.len(), 1)?;
        self.0.read_exact_at(bytes, offset.into()).map_err(FlashError::Io)
    }

    fn capacity(&self) -> usize {
        LENGTH
    }
}

impl NorFlash for FlashFile {
    const WRITE_SIZE: usize = WORD;
    const ERASE_SIZE: usize = PAGE;

    async fn erase(&mut self, from: u32, to: u32) -> Result<(), FlashError> {
        let length = to.saturating_sub(from) as usize;
        check(from, length, PAGE)?;
        let ones = vec![0xFF; length];
        self.0.write_all_at(&ones, from.into()).and_then(|()| self.0.sync_data()).map_err(FlashError::Io)
    }

    /// Clears bits, and sets none.
    async fn write(&mut self, offset: u32, bytes: &[u8]) -> Result<(), FlashError> {
        check(offset, bytes.len(), WORD)?;
        let mut there = vec![0; bytes.len()];
        self.0.read_exact_at(&mut there, offset.into()).map_err(FlashError::Io)?;
        there.iter_mut().zip(bytes).for_each(|(there, byte)| *there &= byte);
        self.0.write_all_at(&there, offset.into()).and_then(|()| self.0.sync_data()).map_err(FlashError::Io)
    }
}

/// Whole units within the flash.
fn check(offset: u32, length: usize, unit: usize) -> Result<(), FlashError> {
    let start = offset as usize;
    match () {
        () if !start.is_multiple_of(unit) || !length.is_multiple_of(unit) => {
            Err(FlashError::Access(NorFlashErrorKind::NotAligned))
        }
        () if start + length > LENGTH => Err(FlashError::Access(NorFlashErrorKind::OutOfBounds)),
        () => Ok(()),
    }
}

/// What a node keeps in a file.
pub struct FileStorage(Store<FlashFile>);

impl FileStorage {
    /// The storage in the file at `path`, which is made where it is missing.
    ///
    /// # Errors
    /// What is wrong with it, for the user.
    pub fn open(path: &Path) -> Result<Self, String> {
        let store = ready(Store::open(FlashFile::open(path)?, 0..LENGTH as u32));
        store.map(Self).map_err(|error| format!("the storage {}: {error}", path.display()))
    }
}

/// What goes wrong is on standard error.
impl Storage for FileStorage {
    async fn load(&mut self, room: &mut Option<NodeConfig>) {
        *room = None;
        let _ = self.0.load(room).await.inspect_err(complain);
    }

    async fn has_key(&mut self) -> bool {
        matches!(self.0.key().await.inspect_err(complain), Ok(Some(_)))
    }

    async fn perform(&mut self, task: Task<'_>) -> Result<u32, StoreError> {
        self.0.perform(task).await.inspect_err(complain).map_err(|_| StoreError::Failed)
    }
}

fn complain(error: &impl Display) {
    eprintln!("storage: {error}");
}

/// The result of a future that never waits, as those of a file's store.
fn ready<T>(future: impl Future<Output = T>) -> T {
    let mut future = pin!(future);
    loop {
        if let Poll::Ready(value) = future.as_mut().poll(&mut Context::from_waker(Waker::noop())) {
            return value;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn writing_clears_bits_and_erasing_sets_them() {
        let folder = tempfile::tempdir().unwrap();
        let mut flash = FlashFile::open(&folder.path().join("flash")).unwrap();
        let mut bytes = [0; 4];
        for (written, there) in [([0x0F; 4], [0x0F; 4]), ([0xF1; 4], [0x01; 4])] {
            ready(flash.write(8, &written)).unwrap();
            ready(flash.read(8, &mut bytes)).unwrap();
            assert_eq!(bytes, there);
        }
        ready(flash.erase(0, PAGE as u32)).unwrap();
        ready(flash.read(8, &mut bytes)).unwrap();
        assert_eq!(bytes, [0xFF; 4]);
        assert!(ready(flash.write(2, &[0; 4])).is_err(), "not a word");
        assert!(ready(flash.erase(0, 8)).is_err(), "not a page");
        assert!(ready(flash.read(LENGTH as u32, &mut bytes)).is_err(), "beyond its end");
    }

    #[test]
    fn a_file_whose_making_was_interrupted_is_completed() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("flash");
        for length in [0, 1, PAGE, LENGTH - 1, LENGTH] {
            std::fs::write(&path, vec![0xFF; length]).unwrap();
            drop(FlashFile::open(&path).unwrap());
            assert_eq!(std::fs::read(&path).unwrap(), [0xFF; LENGTH], "{length}");
        }
        let mut short = vec![0xFF; PAGE];
        short[8] = 0;
        for other in [short, vec![0xFF; LENGTH + 1]] {
            std::fs::write(&path, &other).unwrap();
            assert!(FlashFile::open(&path).is_err());
            assert_eq!(std::fs::read(&path).unwrap(), other, "it is left alone");
        }
    }

    #[test]
    fn what_is_no_storage_and_what_is_in_use_is_refused() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("flash");
        let _held = FlashFile::open(&path).unwrap();
        assert!(FlashFile::open(&path).unwrap_err().contains("another node uses it"));
        let other = folder.path().join("other");
        std::fs::write(&other, "text").unwrap();
        assert!(FlashFile::open(&other).unwrap_err().contains("it has 4 bytes, and a storage has 16384"));
    }
}
