//! Temporary names of files that are being written, and what killed runs have left under such names.

use std::ffi::{OsStr, OsString};
use std::fs::{self, OpenOptions};
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicU64, Ordering};

/// Distinguishes the temporary files of one process.
static COUNT: AtomicU64 = AtomicU64::new(0);

/// A new name beside `target`: `.NAME.PID-N.tmp`. `None` where the target has no name.
pub(super) fn beside(target: &Path) -> Option<PathBuf> {
    let mut hidden = OsString::from(".");
    hidden.push(target.file_name()?);
    hidden.push(format!(".{}-{}.tmp", std::process::id(), COUNT.fetch_add(1, Ordering::Relaxed)));
    Some(target.with_file_name(hidden))
}

/// Removes the temporary files of processes that are no more, where `is_ours` knows the name that the file
/// was to have. What cannot be removed stays: it is in nobody's way.
pub fn remove_abandoned(folder: &Path, is_ours: impl Fn(&str) -> bool) {
    for entry in fs::read_dir(folder).into_iter().flatten().flatten() {
        let name = entry.file_name();
        let Some((intended, process)) = parse(&name) else { continue };
        let is_file = entry.file_type().is_ok_and(|kind| kind.is_file());
        if is_file && is_ours(intended) && is_gone(process) && is_unlocked(&entry.path()) {
            let _ = fs::remove_file(entry.path());
        }
    }
}

/// The name that a file was to have, and the process that was writing it.
fn parse(name: &OsStr) -> Option<(&str, u32)> {
    let (intended, unique) = name.to_str()?.strip_prefix('.')?.strip_suffix(".tmp")?.rsplit_once('.')?;
    let (process, count) = unique.split_once('-')?;
    count.parse::<u64>().ok()?;
    Some((intended, process.parse().ok()?))
}

/// Whether the system knows no such process. Where it does not say, the process is taken to live.
fn is_gone(process: u32) -> bool {
    let processes = Path::new("/proc");
    processes.join("self").exists() && !processes.join(process.to_string()).exists()
}

/// A process in another container has a number of its own, and its lock on the file.
fn is_unlocked(path: &Path) -> bool {
    let unlocked = OpenOptions::new().write(true).open(path).map(|file| file.try_lock());
    !matches!(unlocked, Ok(Err(fs::TryLockError::WouldBlock)))
}

#[cfg(test)]
mod tests {
    use super::super::AtomicFile;
    use super::super::atomic::tests::Folder;
    use super::*;

    #[test]
    fn only_files_of_ours_and_of_dead_processes_go() {
        let folder = Folder::new("abandoned");
        // Beyond the largest process number of Linux.
        let kept = [
            format!(".summary.json.{}-7.tmp", std::process::id()),
            ".letter.txt.4999999-0.tmp".to_owned(),
            ".summary.json.4999999.tmp".to_owned(),
            "summary.json.4999999-0.tmp".to_owned(),
        ];
        for name in kept.iter().map(String::as_str).chain([".summary.json.4999999-0.tmp"]) {
            fs::write(folder.0.join(name), "half").unwrap();
        }
        fs::create_dir(folder.0.join(".summary.json.4999999-1.tmp")).unwrap();
        remove_abandoned(&folder.0, |name| name == "summary.json");
        let mut left = folder.names();
        left.sort();
        let mut expected: Vec<_> =
            kept.into_iter().chain([".summary.json.4999999-1.tmp".to_owned()]).collect();
        expected.sort();
        assert_eq!(left, expected);
    }

    #[test]
    fn a_file_that_is_being_written_is_locked() {
        let folder = Folder::new("locked");
        let file = AtomicFile::create(folder.0.join("a")).unwrap();
        let names = folder.names();
        assert!(!is_unlocked(&folder.0.join(&names[0])));
        assert_eq!(parse(OsStr::new(&names[0])).unwrap(), ("a", std::process::id()));
        drop(file);
        assert!(folder.names().is_empty());
    }
}
