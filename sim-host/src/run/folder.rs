//! The folder of outputs: made, locked against a second run, and cleared of an earlier one.

use super::error::RunError;
use super::lock::{Access, Lock, LockError};
use super::names;
use crate::printable::printable;
use crate::record::{RecordError, remove_abandoned, remove_earlier};
use crate::scenario::FIRST_LINE;
use std::fs::{self, File};
use std::io::Read;
use std::path::{Path, PathBuf};

/// A folder that no other run writes into; several processes of one sweep do. One that was made for it and is empty at the end goes with it.
#[derive(Debug)]
pub struct Folder {
    path: PathBuf,
    /// Given up before the folder goes.
    lock: Option<Lock>,
    /// Folders that were not there before, the deepest first.
    made: Vec<PathBuf>,
}

impl Folder {
    /// Makes the folder where it is missing, and locks it.
    ///
    /// # Errors
    /// It cannot be written, or another run has it.
    pub fn take(path: &Path) -> Result<Self, RunError> {
        Self::open(path, Access::Alone)
    }

    /// The same for one of several processes that write into it together.
    ///
    /// # Errors
    /// It cannot be written, or a run has it for itself.
    pub fn share(path: &Path) -> Result<Self, RunError> {
        Self::open(path, Access::Shared)
    }

    fn open(path: &Path, access: Access) -> Result<Self, RunError> {
        let failed = |reason| RunError::from(RecordError { path: path.to_owned(), reason });
        let mut folder = Self { path: path.to_owned(), lock: None, made: missing(path) };
        fs::create_dir_all(path).map_err(failed)?;
        match Lock::take(&path.join(names::LOCK), access) {
            Ok(lock) => folder.lock = Some(lock),
            Err(LockError::Taken(holder)) => return Err(taken(path, holder)),
            Err(LockError::Failed(reason)) => return Err(failed(reason)),
        }
        Ok(folder)
    }

    /// Refuses a folder with a sweep: that may be days of work.
    ///
    /// # Errors
    /// There is one.
    pub fn has_no_sweep(&self) -> Result<(), RunError> {
        if !self.path.join(names::SWEEP).exists() {
            return Ok(());
        }
        let path = self.path.display().to_string();
        Err(RunError::bad_input(format!(
            "--out {0}: has a sweep, which a run must not remove; name another folder, or remove {0} first",
            printable(&path)
        )))
    }

    /// Removes what an earlier run, of whatever command, has left: files of this program's names only.
    ///
    /// # Errors
    /// A file that cannot be removed; or `scenario.toml` is not of this program.
    pub fn clear(&self) -> Result<(), RunError> {
        let scenario = self.path.join(names::SCENARIO);
        if is_strangers(&scenario) {
            let name = scenario.display().to_string();
            return Err(RunError::bad_input(format!(
                "{} would be replaced by the scenario as it was run, and is not of this program; move it, or name another folder with --out",
                printable(&name)
            )));
        }
        // A page of the user's may have the name of a report.
        let mine = self.path.join(names::REPORT);
        let mine = (!crate::report::is_replaceable(&mine)).then_some(mine);
        let earlier = names::in_folder(&self.path).into_iter();
        let lock = self.lock.as_ref().map(Lock::path);
        let earlier = earlier.filter(|path| Some(path.as_path()) != lock && Some(path) != mine.as_ref());
        for path in earlier {
            remove_earlier(&path)?;
        }
        remove_abandoned(&self.path, names::is_ours);
        Ok(())
    }
}

impl Drop for Folder {
    fn drop(&mut self) {
        self.lock = None;
        // Only what is empty can be removed so; nobody is left to tell if it stays.
        let _ = self.made.iter().try_for_each(fs::remove_dir);
    }
}

/// The folders on the way to `path` that are not there, the deepest first.
fn missing(path: &Path) -> Vec<PathBuf> {
    let is_missing = |path: &&Path| !path.as_os_str().is_empty() && path.symlink_metadata().is_err();
    path.ancestors().take_while(is_missing).map(Path::to_owned).collect()
}

fn taken(path: &Path, holder: Option<u32>) -> RunError {
    let holder = holder.map_or(String::new(), |process| format!(" (process {process})"));
    RunError::bad_input(format!(
        "--out {}: another run{holder} is writing into this folder; wait for it, or name another folder",
        printable(&path.display().to_string())
    ))
}

/// Whether there is such a file and its first line is not the one that this program writes.
fn is_strangers(scenario: &Path) -> bool {
    let first = |file: File| {
        let mut line = Vec::new();
        let _ = file.take(FIRST_LINE.len() as u64).read_to_end(&mut line);
        line == FIRST_LINE.as_bytes()
    };
    fs::metadata(scenario).is_ok_and(|it| it.is_file()) && !File::open(scenario).is_ok_and(first)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_folder_is_had_once_and_free_afterwards() {
        let root = tempfile::tempdir().unwrap();
        let path = root.path().join("out");
        let first = Folder::take(&path).unwrap();
        let message = Folder::take(&path).unwrap_err().message;
        let process = format!("another run (process {}) is writing", std::process::id());
        assert!(message.contains(&process), "{message}");
        drop(first);
        assert!(!path.exists());
        // What a killed run leaves.
        fs::create_dir(&path).unwrap();
        fs::write(path.join(names::LOCK), "1").unwrap();
        drop(Folder::take(&path).unwrap());
        assert!(path.exists() && fs::read_dir(&path).unwrap().next().is_none());
    }

    #[test]
    fn folders_that_were_made_go_if_they_are_empty_and_those_that_were_there_stay() {
        let root = tempfile::tempdir().unwrap();
        let deep = root.path().join("a/b");
        drop(Folder::take(&deep).unwrap());
        assert!(!root.path().join("a").exists());
        let folder = Folder::take(&deep).unwrap();
        fs::write(deep.join("summary.json"), "{}").unwrap();
        drop(folder);
        assert!(deep.join("summary.json").exists());
        let there = root.path().join("there");
        fs::create_dir(&there).unwrap();
        drop(Folder::take(&there).unwrap());
        assert!(there.exists());
    }

    #[test]
    fn only_files_of_this_program_are_cleared() {
        let root = tempfile::tempdir().unwrap();
        let at = |name: &str| root.path().join(name);
        for name in ["summary.json", "bench.csv", "node-3.log", "thesis.tex", "node-x.log"] {
            fs::write(at(name), "").unwrap();
        }
        fs::write(at("scenario.toml"), format!("{FIRST_LINE}\nversion = 1")).unwrap();
        fs::create_dir(at("can.log")).unwrap();
        let folder = Folder::take(root.path()).unwrap();
        folder.clear().unwrap();
        drop(folder);
        let entries = fs::read_dir(root.path()).unwrap();
        let mut left: Vec<_> =
            entries.map(|entry| entry.unwrap().file_name().into_string().unwrap()).collect();
        left.sort();
        assert_eq!(left, ["can.log", "node-x.log", "thesis.tex"]);
    }

    #[test]
    fn a_scenario_of_the_users_is_not_replaced() {
        let root = tempfile::tempdir().unwrap();
        let mine = root.path().join("scenario.toml");
        fs::write(&mine, "version = 1\n").unwrap();
        let folder = Folder::take(root.path()).unwrap();
        assert!(folder.clear().unwrap_err().message.contains("scenario.toml would be replaced"));
        assert_eq!(fs::read_to_string(mine).unwrap(), "version = 1\n");
    }
}
