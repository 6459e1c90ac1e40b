//! Files that appear whole or not at all.

use std::ffi::OsString;
use std::fs::{self, File, OpenOptions};
use std::io::{self, BufWriter, Write};
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicU64, Ordering};

/// A file could not be written. Nothing half-written is left behind.
#[derive(Debug, thiserror::Error)]
#[error("cannot write {}: {reason}", path.display())]
pub struct RecordError {
    /// The file that was to be.
    pub path: PathBuf,
    /// What the system said.
    #[source]
    pub reason: io::Error,
}

/// Distinguishes the temporary files of one process.
static COUNT: AtomicU64 = AtomicU64::new(0);

/// A buffered file under a temporary name beside `path`. [`commit`](Self::commit) gives it its name;
/// dropping it before that removes it. A file that had the name before stays until then. A device or a pipe (`/dev/null`,
/// `/dev/stdout`) is written to as it is: a file must not take its place.
#[derive(Debug)]
pub struct AtomicFile {
    path: PathBuf,
    /// `None` for a device.
    temporary: Option<PathBuf>,
    file: Option<BufWriter<File>>,
}

impl AtomicFile {
    /// Opens the temporary file; the folder must exist.
    ///
    /// # Errors
    /// [`RecordError`], naming `path`.
    pub fn create(path: impl Into<PathBuf>) -> Result<Self, RecordError> {
        let path = path.into();
        match Self::open(&path) {
            Ok((temporary, file)) => Ok(Self { path, temporary, file: Some(BufWriter::new(file)) }),
            Err(reason) => Err(RecordError { path, reason }),
        }
    }

    fn open(path: &Path) -> io::Result<(Option<PathBuf>, File)> {
        if path.is_dir() {
            return Err(io::ErrorKind::IsADirectory.into());
        }
        if is_device(path) {
            return Ok((None, OpenOptions::new().write(true).open(path)?));
        }
        let name = path.file_name().ok_or(io::ErrorKind::InvalidInput)?;
        let mut hidden = OsString::from(".");
        hidden.push(name);
        hidden.push(format!(".{}-{}.tmp", std::process::id(), COUNT.fetch_add(1, Ordering::Relaxed)));
        let temporary = path.with_file_name(hidden);
        let file = OpenOptions::new().write(true).create_new(true).open(&temporary)?;
        Ok((Some(temporary), file))
    }

    /// The name that the file will have.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// Writes by `write`, with errors that name the file.
    ///
    /// # Errors
    /// [`RecordError`], for example on a full disk.
    pub fn write(&mut self, write: impl FnOnce(&mut dyn Write) -> io::Result<()>) -> Result<(), RecordError> {
        let result = match &mut self.file {
            Some(file) => write(file),
            None => Ok(()),
        };
        result.map_err(|reason| self.failed(reason))
    }

    /// Flushes to the disk and renames.
    ///
    /// # Errors
    /// [`RecordError`]; the temporary file is gone then.
    pub fn commit(mut self) -> Result<(), RecordError> {
        let result = self.settle();
        match result {
            Ok(()) => Ok(()),
            Err(reason) => Err(self.failed(reason)),
        }
    }

    fn settle(&mut self) -> io::Result<()> {
        if let Some(mut file) = self.file.take() {
            let settled = file.flush().and_then(|()| match &self.temporary {
                Some(temporary) => file.get_ref().sync_all().and_then(|()| fs::rename(temporary, &self.path)),
                None => Ok(()),
            });
            if settled.is_err() {
                self.file = Some(file);
            }
            settled?;
        }
        Ok(())
    }

    fn failed(&self, reason: io::Error) -> RecordError {
        RecordError { path: self.path.clone(), reason }
    }
}

impl Drop for AtomicFile {
    fn drop(&mut self) {
        if let Some(file) = self.file.take() {
            // Not flushed: the content is being thrown away, and on a full disk flushing fails again.
            drop(file.into_parts());
            // Nobody is left to tell if this fails too.
            let _ = self.temporary.as_ref().map(fs::remove_file);
        }
    }
}

/// Whether `path` is something other than a file or a folder, or a name that the system gives to an open file.
fn is_device(path: &Path) -> bool {
    let system = path.starts_with("/dev") || path.starts_with("/proc");
    let special = fs::metadata(path).is_ok_and(|metadata| !metadata.is_file() && !metadata.is_dir());
    special || (system && fs::symlink_metadata(path).is_ok_and(|metadata| metadata.is_symlink()))
}

/// Writes `content` to `path`, whole or not at all.
///
/// # Errors
/// [`RecordError`], naming `path` and the reason.
pub fn write_atomic(path: impl Into<PathBuf>, content: &[u8]) -> Result<(), RecordError> {
    let mut file = AtomicFile::create(path)?;
    file.write(|f| f.write_all(content))?;
    file.commit()
}

#[cfg(test)]
pub(super) mod tests {
    use super::*;

    /// A fresh folder, removed at the end of the test.
    pub(crate) struct Folder(pub(crate) PathBuf);

    impl Folder {
        pub(crate) fn new(name: &str) -> Self {
            let path = std::env::temp_dir().join(format!("sim-host-{name}-{}", std::process::id()));
            fs::create_dir_all(&path).unwrap();
            Self(path)
        }

        fn names(&self) -> Vec<String> {
            let name = |e: io::Result<fs::DirEntry>| e.unwrap().file_name().into_string().unwrap();
            fs::read_dir(&self.0).unwrap().map(name).collect()
        }
    }

    impl Drop for Folder {
        fn drop(&mut self) {
            fs::remove_dir_all(&self.0).unwrap();
        }
    }

    #[test]
    fn a_committed_file_replaces_and_an_abandoned_one_leaves_nothing() {
        let folder = Folder::new("atomic");
        let path = folder.0.join("a.csv");
        write_atomic(&path, b"old").unwrap();
        let mut abandoned = AtomicFile::create(&path).unwrap();
        abandoned.write(|f| f.write_all(b"half")).unwrap();
        drop(abandoned);
        assert_eq!(fs::read(&path).unwrap(), b"old");
        write_atomic(&path, b"new").unwrap();
        assert_eq!(fs::read(&path).unwrap(), b"new");
        assert_eq!(folder.names(), ["a.csv"]);
    }

    #[test]
    fn errors_name_the_file_and_the_reason() {
        let folder = Folder::new("missing");
        let error = write_atomic(folder.0.join("no/such/summary.json"), b"").unwrap_err();
        let text = error.to_string();
        assert!(text.contains("no/such/summary.json: No such file"), "{text}");
        let error = write_atomic(folder.0.clone(), b"").unwrap_err();
        assert!(error.to_string().ends_with("is a directory"), "{error}");
    }

    #[test]
    fn a_failed_write_leaves_nothing() {
        let folder = Folder::new("full");
        let mut file = AtomicFile::create(folder.0.join("a")).unwrap();
        let full = |f: &mut dyn Write| {
            f.write_all(b"half")?;
            f.flush()?;
            Err(io::ErrorKind::StorageFull.into())
        };
        let error = file.write(full).unwrap_err();
        assert!(error.to_string().ends_with("a: no storage space"), "{error}");
        drop(file);
        assert!(folder.names().is_empty());
    }
}
