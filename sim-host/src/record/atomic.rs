//! Files that appear whole or not at all.

use super::{rights, temporary};
use crate::printable::printable;
use std::fs::{self, File, OpenOptions};
use std::io::{self, BufWriter, Write};
use std::path::{Path, PathBuf};

/// A file could not be written. Nothing half-written is left behind.
#[derive(Debug, thiserror::Error)]
#[error("cannot write {}: {reason}", printable(&path.display().to_string()))]
pub struct RecordError {
    /// The file that was to be.
    pub path: PathBuf,
    /// What the system said.
    #[source]
    pub reason: io::Error,
}

/// A buffered file under a temporary name beside `path`. [`commit`](Self::commit) gives it its name;
/// dropping it before that removes it. A file that had the name before stays until then, and leaves its rights to the new one; of a
/// symbolic link the target is replaced, and the link stays. A device or a pipe (`/dev/null`, `/dev/stdout`) is written to as it is: a
/// file must not take its place. `-` is standard output.
#[derive(Debug)]
pub struct AtomicFile {
    path: PathBuf,
    sink: Sink,
    settled: bool,
}

#[derive(Debug)]
enum Sink {
    /// The file is renamed from its temporary name to that of the target.
    File {
        file: BufWriter<File>,
        temporary: PathBuf,
        target: PathBuf,
    },
    /// A device, a pipe, or an open file by its number.
    AsItIs(BufWriter<File>),
    StandardOutput(Vec<u8>),
    /// Committed.
    Done,
}

impl AtomicFile {
    /// Opens the temporary file; the folder must exist.
    ///
    /// # Errors
    /// [`RecordError`], naming `path`.
    pub fn create(path: impl Into<PathBuf>) -> Result<Self, RecordError> {
        let path = path.into();
        match Self::open(&path) {
            Ok(sink) => Ok(Self { path, sink, settled: false }),
            Err(reason) => Err(RecordError { path, reason }),
        }
    }

    fn open(path: &Path) -> io::Result<Sink> {
        if is_standard_output(path) {
            return Ok(Sink::StandardOutput(Vec::new()));
        }
        if path.is_dir() {
            return Err(io::ErrorKind::IsADirectory.into());
        }
        if is_device(path) {
            // To the end of what is there, where it is a file that somebody else has opened.
            return Ok(Sink::AsItIs(BufWriter::new(OpenOptions::new().append(true).open(path)?)));
        }
        let target = follow(path)?;
        let temporary = temporary::beside(&target).ok_or(io::ErrorKind::InvalidInput)?;
        let file = OpenOptions::new().write(true).create_new(true).open(&temporary)?;
        let sink = Sink::File { file: BufWriter::new(file), temporary, target };
        let mut opened = Self { path: path.to_owned(), sink, settled: false };
        opened.take_rights()?;
        Ok(std::mem::replace(&mut opened.sink, Sink::Done))
    }

    /// Gives the new file the rights of the one that it is to replace.
    fn take_rights(&mut self) -> io::Result<()> {
        let Sink::File { file, target, .. } = &self.sink else { return Ok(()) };
        // Says that the file's process lives, for who looks for what killed ones have left. Not every file system has locks.
        let _ = file.get_ref().try_lock();
        match rights::of(target) {
            Some(rights) => file.get_ref().set_permissions(rights),
            None => Ok(()),
        }
    }

    /// The name that the file will have.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// Whether writing twice would write two texts: it is no file that is replaced.
    #[must_use]
    pub fn is_stream(&self) -> bool {
        !matches!(self.sink, Sink::File { .. })
    }

    /// Writes by `write`, with errors that name the file.
    ///
    /// # Errors
    /// [`RecordError`], for example on a full disk.
    pub fn write(&mut self, write: impl FnOnce(&mut dyn Write) -> io::Result<()>) -> Result<(), RecordError> {
        self.settled = false;
        let result = match &mut self.sink {
            Sink::File { file, .. } | Sink::AsItIs(file) => write(file),
            Sink::StandardOutput(text) => write(text),
            Sink::Done => Ok(()),
        };
        result.map_err(|reason| self.failed(reason))
    }

    /// Brings everything to the disk, under the temporary name: nothing but a new name is missing then.
    ///
    /// # Errors
    /// [`RecordError`], for example on a full disk.
    pub fn settle(&mut self) -> Result<(), RecordError> {
        let settled = match &mut self.sink {
            _ if self.settled => Ok(()),
            Sink::File { file, .. } => file.flush().and_then(|()| file.get_ref().sync_all()),
            Sink::AsItIs(_) | Sink::StandardOutput(_) | Sink::Done => Ok(()),
        };
        self.settled = settled.is_ok();
        settled.map_err(|reason| self.failed(reason))
    }

    /// Flushes to the disk and renames.
    ///
    /// # Errors
    /// [`RecordError`]; the temporary file is gone then.
    pub fn commit(mut self) -> Result<(), RecordError> {
        self.settle()?;
        let named = match &mut self.sink {
            Sink::File { temporary, target, .. } => fs::rename(temporary, target),
            Sink::AsItIs(file) => reader_may_leave(file.flush()),
            Sink::StandardOutput(text) => {
                let mut out = io::stdout().lock();
                reader_may_leave(out.write_all(text).and_then(|()| out.flush()))
            }
            Sink::Done => Ok(()),
        };
        match named {
            Ok(()) => {
                self.sink = Sink::Done;
                Ok(())
            }
            Err(reason) => Err(self.failed(reason)),
        }
    }

    fn failed(&self, reason: io::Error) -> RecordError {
        RecordError { path: self.path.clone(), reason }
    }
}

/// For libraries that write.
impl Write for AtomicFile {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        self.write(|out| out.write_all(bytes)).map_err(|error| error.reason)?;
        Ok(bytes.len())
    }

    fn flush(&mut self) -> io::Result<()> {
        Ok(())
    }
}

/// A reader that went away (`| head`) has had enough, and is no failure.
fn reader_may_leave(written: io::Result<()>) -> io::Result<()> {
    match written {
        Err(error) if error.kind() == io::ErrorKind::BrokenPipe => Ok(()),
        other => other,
    }
}

impl Drop for AtomicFile {
    fn drop(&mut self) {
        match std::mem::replace(&mut self.sink, Sink::Done) {
            Sink::File { file, temporary, .. } => {
                // Not flushed: the content is being thrown away, and on a full disk flushing fails again.
                drop(file.into_parts());
                // Nobody is left to tell if this fails too.
                let _ = fs::remove_file(temporary);
            }
            Sink::AsItIs(file) => drop(file.into_parts()),
            Sink::StandardOutput(_) | Sink::Done => {}
        }
    }
}

/// Whether a path means standard output.
#[must_use]
pub fn is_standard_output(path: &Path) -> bool {
    path == Path::new("-") || path == Path::new("/dev/stdout")
}

/// Whether `path` is something other than a file or a folder, or a name that the system gives to an open file.
pub(super) fn is_device(path: &Path) -> bool {
    let system = path.starts_with("/dev") || path.starts_with("/proc");
    let special = fs::metadata(path).is_ok_and(|metadata| !metadata.is_file() && !metadata.is_dir());
    special || (system && fs::symlink_metadata(path).is_ok_and(|metadata| metadata.is_symlink()))
}

/// The most symbolic links on a path, as Linux has it.
const MOST_LINKS: usize = 40;

/// The file that a path means: where it is a symbolic link, its target, whether or not that is there.
///
/// # Errors
/// A link cannot be read, or the links go round.
pub(crate) fn follow(path: &Path) -> io::Result<PathBuf> {
    let mut target = path.to_owned();
    for _ in 0..MOST_LINKS {
        match fs::symlink_metadata(&target) {
            Ok(metadata) if metadata.is_symlink() => {
                let next = fs::read_link(&target)?;
                // A relative target counts from the folder of its link; an absolute one replaces it.
                target.pop();
                target.push(next);
            }
            _ => return Ok(target),
        }
    }
    Err(io::Error::new(io::ErrorKind::InvalidInput, "its symbolic links go round"))
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

/// Writes `content` to `path`, whole or not at all, where there is no file yet. Of several processes that do so at once one succeeds.
///
/// # Errors
/// [`RecordError`], naming `path`; of kind [`io::ErrorKind::AlreadyExists`] where there is one.
pub fn place_new(path: &Path, content: &[u8]) -> Result<(), RecordError> {
    let failed = |reason| RecordError { path: path.to_owned(), reason };
    let temporary = temporary::beside(path).ok_or_else(|| failed(io::ErrorKind::InvalidInput.into()))?;
    let write = |path: &Path| {
        let mut file = OpenOptions::new().write(true).create_new(true).open(path)?;
        file.write_all(content).and_then(|()| file.sync_all())
    };
    let placed = write(&temporary).and_then(|()| match fs::hard_link(&temporary, path) {
        // Not every file system has hard links.
        Err(error) if error.kind() != io::ErrorKind::AlreadyExists => write(path),
        linked => linked,
    });
    let _ = fs::remove_file(&temporary);
    placed.map_err(failed)
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

        pub(crate) fn names(&self) -> Vec<String> {
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
    fn a_new_file_is_placed_once() {
        let folder = Folder::new("placed");
        let path = folder.0.join("sweep.json");
        place_new(&path, b"first").unwrap();
        assert_eq!(place_new(&path, b"second").unwrap_err().reason.kind(), io::ErrorKind::AlreadyExists);
        assert_eq!((fs::read(&path).unwrap().as_slice(), folder.names().len()), (&b"first"[..], 1));
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

    #[test]
    #[cfg(unix)]
    fn rights_are_kept_and_links_are_written_through() {
        use std::os::unix::fs::{PermissionsExt, symlink};
        let folder = Folder::new("rights");
        let at = |name: &str| folder.0.join(name);
        fs::create_dir(at("deep")).unwrap();
        fs::write(at("deep/target"), "old").unwrap();
        fs::set_permissions(at("deep/target"), fs::Permissions::from_mode(0o604)).unwrap();
        symlink("deep/target", at("link")).unwrap();
        symlink("link", at("link-to-link")).unwrap();
        symlink("deep/none-yet", at("dangling")).unwrap();
        fs::hard_link(at("deep/target"), at("kept")).unwrap();
        write_atomic(at("link-to-link"), b"new").unwrap();
        assert_eq!(fs::read(at("deep/target")).unwrap(), b"new");
        assert_eq!(fs::metadata(at("deep/target")).unwrap().permissions().mode() & 0o7777, 0o604);
        assert!(fs::symlink_metadata(at("link-to-link")).unwrap().is_symlink());
        assert!(fs::symlink_metadata(at("link")).unwrap().is_symlink());
        // Replaced whole, so that another name of the old file still has the old text.
        assert_eq!(fs::read(at("kept")).unwrap(), b"old");
        write_atomic(at("dangling"), b"new").unwrap();
        assert_eq!(fs::read(at("deep/none-yet")).unwrap(), b"new");
        assert!(fs::symlink_metadata(at("dangling")).unwrap().is_symlink());
        symlink("round", at("round")).unwrap();
        assert!(write_atomic(at("round"), b"").unwrap_err().to_string().ends_with("go round"));
    }
}
