//! A lock file in a folder of outputs. The lock goes with the process, however that ends.

use std::fs::{self, File, OpenOptions, TryLockError};
use std::io::{self, Read, Write};
use std::os::unix::fs::MetadataExt;
use std::path::{Path, PathBuf};

/// Who may have it at the same time.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Access {
    /// One process.
    Alone,
    /// Any number of processes that all want it so.
    Shared,
}

/// Why there is no lock.
#[derive(Debug)]
pub enum LockError {
    /// Another process has it: its number, where it has said so.
    Taken(Option<u32>),
    /// The file cannot be made.
    Failed(io::Error),
}

/// A file that is locked. It is removed at the end, by whoever has it last.
#[derive(Debug)]
pub struct Lock {
    path: PathBuf,
    file: File,
}

impl Lock {
    /// Makes the file where it is missing, and locks it.
    ///
    /// # Errors
    /// See [`LockError`].
    pub fn take(path: &Path, access: Access) -> Result<Self, LockError> {
        loop {
            let file = open(path).map_err(LockError::Failed)?;
            let locked = match access {
                Access::Alone => file.try_lock(),
                Access::Shared => file.try_lock_shared(),
            };
            if let Err(TryLockError::WouldBlock) = locked {
                return Err(LockError::Taken(holder(file)));
            }
            // Where the file system has no locks there is nobody to tell apart.
            // Who has just ended may have removed the file that was opened here.
            if is_current(&file, path) {
                let lock = Self { path: path.to_owned(), file };
                lock.sign();
                return Ok(lock);
            }
        }
    }

    /// The file.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// Says who has it. Where the disk is full the lock holds without it.
    fn sign(&self) {
        let _ = self.file.set_len(0).and_then(|()| write!(&self.file, "{}", std::process::id()));
    }
}

impl Drop for Lock {
    fn drop(&mut self) {
        // Before it is given up; nobody is left to tell if it stays. Those that share it go on with the file.
        if !matches!(self.file.try_lock(), Err(TryLockError::WouldBlock)) {
            let _ = fs::remove_file(&self.path);
        }
    }
}

fn open(path: &Path) -> io::Result<File> {
    let name = path.file_name().unwrap_or_default().to_string_lossy();
    match fs::symlink_metadata(path) {
        Ok(metadata) if !metadata.is_file() => {
            Err(io::Error::new(io::ErrorKind::AlreadyExists, format!("{name} in it is no file")))
        }
        _ => OpenOptions::new().read(true).write(true).create(true).truncate(false).open(path),
    }
}

fn is_current(file: &File, path: &Path) -> bool {
    let number = |metadata: io::Result<fs::Metadata>| metadata.ok().map(|it| (it.dev(), it.ino()));
    number(file.metadata()) == number(fs::symlink_metadata(path))
}

fn holder(file: File) -> Option<u32> {
    let mut holder = String::new();
    let _ = file.take(20).read_to_string(&mut holder);
    holder.parse().ok()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn those_that_share_it_keep_out_one_that_wants_it_alone_and_the_last_removes_it() {
        let root = tempfile::tempdir().unwrap();
        let path = root.path().join("lock");
        let taken = |access| matches!(Lock::take(&path, access), Err(LockError::Taken(Some(_))));
        let first = Lock::take(&path, Access::Shared).unwrap();
        let second = Lock::take(&path, Access::Shared).unwrap();
        assert!(taken(Access::Alone));
        drop(first);
        assert!(path.exists() && taken(Access::Alone));
        drop(second);
        assert!(!path.exists());
        let alone = Lock::take(&path, Access::Alone).unwrap();
        assert!(taken(Access::Shared) && taken(Access::Alone));
        drop(alone);
        assert!(!path.exists());
    }
}
