//! What a folder holds: a run, a sweep, or neither.

use crate::printable::printable;
use crate::run::names;
use std::fs::{self, File, TryLockError};
use std::io::{ErrorKind, Read};
use std::path::{Path, PathBuf};

/// The table of a sweep.
pub(super) const RUNS: &str = "runs.csv";

/// Most bytes of a file that is shown as text: no file of this program has more but a list of events.
const LONGEST: u64 = 4 << 20;

/// What there is to report.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Kind {
    Run,
    Sweep,
}

/// A folder that nobody writes into.
#[derive(Debug)]
pub(super) struct Folder {
    pub(super) path: PathBuf,
    pub(super) kind: Kind,
}

impl Folder {
    /// Looks at what is in the folder `path`.
    ///
    /// # Errors
    /// Neither a run nor a sweep has left anything there, or one is still writing, in words.
    pub(super) fn open(path: &Path) -> Result<Self, String> {
        let name = printable(&path.display().to_string()).into_owned();
        let metadata = fs::metadata(path).map_err(|error| format!("{name}: cannot be read: {error}"))?;
        if !metadata.is_dir() {
            return Err(format!("{name}: is no folder; name the one that --out has filled"));
        }
        if is_taken(&path.join(names::LOCK)) {
            return Err(format!("{name}: a run is writing into this folder; wait for its end"));
        }
        let has = |file: &str| path.join(file).is_file();
        let kind = match () {
            () if has(RUNS) || !shards(path).is_empty() => Kind::Sweep,
            () if has(names::SUMMARY) || has(names::TRAJECTORY) => Kind::Run,
            () if has(names::LOCK) => {
                return Err(format!(
                    "{name}: a run into this folder was killed before it had written anything"
                ));
            }
            () => {
                return Err(format!(
                    "{name}: is no folder of a run or of a sweep: it has neither {}, {} nor {RUNS}",
                    names::SUMMARY,
                    names::TRAJECTORY
                ));
            }
        };
        Ok(Self { path: path.to_owned(), kind })
    }

    /// The whole text of a file, where there is one; what is no UTF-8 in it shows as such.
    ///
    /// # Errors
    /// It is there and cannot be read, in words.
    pub(super) fn text(&self, name: &str) -> Result<Option<String>, String> {
        let Some(mut file) = self.file(name)? else { return Ok(None) };
        let mut bytes = Vec::new();
        file.read_to_end(&mut bytes).map_err(|error| self.failed(name, &error))?;
        Ok(Some(String::from_utf8_lossy(&bytes).into_owned()))
    }

    /// The begin of a file that may be long, and whether that is all of it.
    ///
    /// # Errors
    /// It is there and cannot be read, in words.
    pub(super) fn begin(&self, name: &str) -> Result<Option<(String, bool)>, String> {
        let Some(file) = self.file(name)? else { return Ok(None) };
        let is_whole = file.metadata().is_ok_and(|metadata| metadata.len() <= LONGEST);
        let mut bytes = Vec::new();
        file.take(LONGEST).read_to_end(&mut bytes).map_err(|error| self.failed(name, &error))?;
        Ok(Some((String::from_utf8_lossy(&bytes).into_owned(), is_whole)))
    }

    /// A file, where there is one.
    ///
    /// # Errors
    /// It is there and cannot be opened, or something else has its name, in words.
    pub(super) fn file(&self, name: &str) -> Result<Option<File>, String> {
        let path = self.path.join(name);
        match fs::metadata(&path) {
            Err(error) if error.kind() == ErrorKind::NotFound => return Ok(None),
            Err(error) => return Err(self.failed(name, &error)),
            Ok(metadata) if !metadata.is_file() => {
                return Err(format!(
                    "{}: is no file; a report would leave out what it should have",
                    self.place(name)
                ));
            }
            Ok(_) => {}
        }
        File::open(path).map(Some).map_err(|error| self.failed(name, &error))
    }

    fn failed(&self, name: &str, error: &std::io::Error) -> String {
        format!("{}: cannot be read: {error}", self.place(name))
    }

    /// A file of it, as a message names it.
    pub(super) fn place(&self, name: &str) -> String {
        printable(&self.path.join(name).display().to_string()).into_owned()
    }

    /// The files of this program in it, by name, with their sizes in bytes; a report is none of its own sources.
    pub(super) fn files(&self) -> Vec<(String, u64)> {
        let entries = fs::read_dir(&self.path).into_iter().flatten().flatten();
        let sized = |entry: fs::DirEntry| {
            let name = entry.file_name().into_string().ok()?;
            let metadata = entry.metadata().ok().filter(fs::Metadata::is_file)?;
            let is_source = names::is_ours(&name) && name != names::LOCK && name != names::REPORT;
            is_source.then_some((name, metadata.len()))
        };
        let mut files: Vec<_> = entries.filter_map(sized).collect();
        files.sort();
        files
    }
}

/// Whether a run holds the lock. One that a killed run has left is held by nobody.
fn is_taken(lock: &Path) -> bool {
    let held = |file: File| matches!(file.try_lock_shared(), Err(TryLockError::WouldBlock));
    lock.is_file() && File::open(lock).is_ok_and(held)
}

/// Numbers of the shards of a sweep, `(i, n)` of each `runs-i-of-n.csv`, ascending.
pub(super) fn shards(path: &Path) -> Vec<(u32, u32)> {
    let entries = fs::read_dir(path).into_iter().flatten().flatten();
    let names = entries.filter_map(|entry| entry.file_name().into_string().ok());
    let mut shards: Vec<_> = names.filter_map(|name| shard(&name)).collect();
    shards.sort_by_key(|&(i, n)| (n, i));
    shards
}

/// The numbers in `runs-i-of-n.csv`.
fn shard(name: &str) -> Option<(u32, u32)> {
    let (i, n) = name.strip_prefix("runs-")?.strip_suffix(".csv")?.split_once("-of-")?;
    let number =
        |text: &str| text.bytes().all(|byte| byte.is_ascii_digit()).then(|| text.parse().ok()).flatten();
    Some((number(i)?, number(n)?))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_folder_is_known_by_its_files() {
        let root = tempfile::tempdir().unwrap();
        let opened = || Folder::open(root.path());
        assert!(opened().unwrap_err().contains("is no folder of a run or of a sweep"));
        fs::write(root.path().join(names::LOCK), "1").unwrap();
        assert!(opened().unwrap_err().contains("was killed"));
        fs::write(root.path().join(names::TRAJECTORY), "").unwrap();
        assert_eq!(opened().unwrap().kind, Kind::Run);
        fs::write(root.path().join("runs-2-of-3.csv"), "").unwrap();
        assert_eq!(opened().unwrap().kind, Kind::Sweep);
        assert!(Folder::open(&root.path().join(names::TRAJECTORY)).unwrap_err().contains("is no folder"));
        assert!(Folder::open(&root.path().join("none")).unwrap_err().contains("cannot be read"));
    }

    #[test]
    fn a_folder_that_has_the_name_of_a_file_is_named() {
        let root = tempfile::tempdir().unwrap();
        fs::write(root.path().join(names::SUMMARY), "{}").unwrap();
        let folder = Folder::open(root.path()).unwrap();
        assert!(folder.file(names::QUANTILES).unwrap().is_none());
        fs::create_dir(root.path().join(names::QUANTILES)).unwrap();
        let why = folder.file(names::QUANTILES).unwrap_err();
        assert!(why.contains("quantiles.csv: is no file"), "{why}");
        assert!(folder.file(names::SUMMARY).unwrap().is_some());
    }

    #[test]
    fn a_run_that_is_still_writing_is_waited_for() {
        let root = tempfile::tempdir().unwrap();
        fs::write(root.path().join(names::SUMMARY), "{}").unwrap();
        let lock = File::create(root.path().join(names::LOCK)).unwrap();
        lock.lock().unwrap();
        assert!(Folder::open(root.path()).unwrap_err().contains("wait for its end"));
        lock.unlock().unwrap();
        assert!(Folder::open(root.path()).is_ok());
    }

    #[test]
    fn shards_are_known_by_their_names() {
        assert_eq!(shard("runs-2-of-10.csv"), Some((2, 10)));
        for name in [
            "runs.csv",
            "runs-2.csv",
            "runs-a-of-b.csv",
            "runs-+1-of-2.csv",
            "runs-1-of-2.csv.bak",
            "runs--of-.csv",
        ] {
            assert_eq!(shard(name), None, "{name}");
        }
    }
}
