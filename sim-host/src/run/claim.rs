//! What a run takes hold of before anything else, so that nobody reads yesterday's results for today's.
//!
//! The JUnit file says from the start that the run has not come to its end, and says otherwise only when it has: whatever happens to
//! the process, a CI server does not see a green file.

use super::error::RunError;
use super::folder::Folder;
use super::names;
use super::places::{Clash, Wanted};
use crate::exit::Exit;
use crate::record::{
    AtomicFile, JunitError, RecordError, junit_error, remove_abandoned, remove_earlier, write_atomic,
};
use std::any::Any;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::{Path, PathBuf};

/// The outputs of one run, cleared of what an earlier one left.
#[derive(Debug)]
pub struct Claim {
    /// Held until the end.
    _folder: Option<Folder>,
    junit: Option<AtomicFile>,
    scenario: String,
    command: String,
}

impl Claim {
    /// Refuses outputs that are inputs or one another, locks the folder, removes earlier outputs, and opens the JUnit file.
    ///
    /// # Errors
    /// Why the run is refused; the JUnit file says so, too.
    pub fn take(wanted: &Wanted<'_>) -> Result<Self, RunError> {
        let clashes = wanted.clashes();
        if !clashes.is_empty() {
            return Err(Self::new(wanted).refuse_clashes(wanted, &clashes));
        }
        let folder = wanted.out.map(Folder::take).transpose();
        let mut claim = Self::new(wanted);
        let opened = wanted.junit.map_or(Ok(()), |path| claim.open_junit(path));
        let removed = wanted.json.map_or(Ok(()), remove_earlier);
        for path in [wanted.json, wanted.junit].into_iter().flatten() {
            remove_abandoned_beside(path);
        }
        let cleared = match &folder {
            Ok(Some(folder)) => folder.has_no_sweep().and_then(|()| folder.clear()),
            _ => Ok(()),
        };
        if let Some(out) = wanted.out.filter(|_| cleared.is_err()) {
            // It may stay green where something else could not be removed. That it cannot be removed itself has been said.
            let _ = remove_earlier(&out.join(names::SUMMARY));
        }
        let ready = folder.and_then(|folder| cleared.and(Ok(folder)));
        let ready = ready.and_then(|folder| opened.and(removed).map(|()| folder).map_err(RunError::from));
        match ready {
            Ok(folder) => Ok(Self { _folder: folder, ..claim }),
            Err(error) => Err(claim.fail(error)),
        }
    }

    fn new(wanted: &Wanted<'_>) -> Self {
        Self {
            _folder: None,
            junit: None,
            scenario: wanted.scenario.display().to_string(),
            command: wanted.command.to_owned(),
        }
    }

    /// Outputs that are no part of a clash say that the run was refused. The others are left as they are: one may be the scenario.
    fn refuse_clashes(mut self, wanted: &Wanted<'_>, clashes: &[Clash]) -> RunError {
        let is_free = |path: &Path| !clashes.iter().any(|clash| clash.outputs.iter().any(|it| it == path));
        let messages: Vec<_> = clashes.iter().map(|clash| clash.message.as_str()).collect();
        let error = RunError::bad_input(messages.join("\n"));
        if let Some(json) = wanted.json.filter(|path| is_free(path)) {
            let _ = remove_earlier(json);
        }
        if let Some(junit) = wanted.junit.filter(|path| is_free(path)) {
            let _ = self.open_junit(junit);
        }
        self.fail(error)
    }

    fn open_junit(&mut self, path: &Path) -> Result<(), RecordError> {
        let file = AtomicFile::create(path)?;
        if !file.is_stream() {
            let message = "the run has not come to its end: it is still going on, or was killed";
            write_atomic(path, self.error_text(message, Exit::Interrupted).as_bytes())?;
        }
        self.junit = Some(file);
        Ok(())
    }

    /// The JUnit file, for the verdicts; nobody else writes it then.
    pub(super) fn take_junit(&mut self) -> Option<AtomicFile> {
        self.junit.take()
    }

    /// The command that was typed.
    pub(super) fn command(&self) -> &str {
        &self.command
    }

    /// Does the work of a run. Where that fails, or panics, the JUnit file says so.
    ///
    /// # Errors
    /// Those of `work`; a panic is a defect.
    pub fn guard<T>(mut self, work: impl FnOnce(&mut Self) -> Result<T, RunError>) -> Result<T, RunError> {
        let done = catch_unwind(AssertUnwindSafe(|| work(&mut self)));
        let done = done.unwrap_or_else(|panic| Err(RunError::defect(defect(panic.as_ref()))));
        done.map_err(|error| self.fail(error))
    }

    /// Writes `error` into the JUnit file, where that is still to be written.
    fn fail(&mut self, error: RunError) -> RunError {
        let text = self.error_text(&error.message, error.exit);
        let written = self.junit.take().map_or(Ok(()), |file| commit(file, &text));
        match written {
            Ok(()) => error,
            Err(unwritten) => error.and(unwritten),
        }
    }

    fn error_text(&self, message: &str, exit: Exit) -> String {
        junit_error(&JunitError { scenario: &self.scenario, message, exit, command: &self.command })
    }
}

/// Writes a text and gives the file its name.
pub(super) fn commit(mut file: AtomicFile, text: &str) -> Result<(), RecordError> {
    file.write(|out| out.write_all(text.as_bytes()))?;
    file.commit()
}

fn remove_abandoned_beside(path: &Path) {
    let target = crate::record::follow(path).unwrap_or_else(|_| path.to_owned());
    let Some(name) = target.file_name() else { return };
    let folder = target.parent().filter(|folder| !folder.as_os_str().is_empty()).unwrap_or(Path::new("."));
    remove_abandoned(&PathBuf::from(folder), |intended| name == intended);
}

fn defect(panic: &(dyn Any + Send)) -> String {
    let text = panic.downcast_ref::<&str>().copied().or(panic.downcast_ref::<String>().map(String::as_str));
    format!(
        "{}\nthis is a defect of sim-host; please report it with the command that you ran",
        text.unwrap_or("a panic without a message")
    )
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::fs;

    fn claim(junit: &Path) -> Claim {
        let scenario = Path::new("a.toml");
        let wanted = Wanted {
            scenario,
            sets: &[],
            bench: None,
            out: None,
            json: None,
            junit: Some(junit),
            command: "sim-host",
        };
        Claim::take(&wanted).unwrap()
    }

    #[test]
    fn a_panic_is_a_defect_and_the_junit_file_says_so() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.xml");
        fs::write(&path, "yesterday's").unwrap();
        let done: Result<(), _> = claim(&path).guard(|_| panic!("nodes are missing"));
        let error = done.unwrap_err();
        assert_eq!(error.exit, Exit::Defect);
        let junit = fs::read_to_string(path).unwrap();
        assert!(junit.contains("nodes are missing") && junit.contains("type=\"defect\""), "{junit}");
        assert!(junit.contains("errors=\"1\""), "{junit}");
    }

    #[test]
    fn the_junit_file_is_not_green_while_the_run_goes_on() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.xml");
        fs::write(&path, "yesterday's").unwrap();
        let claim = claim(&path);
        let junit = fs::read_to_string(&path).unwrap();
        assert!(junit.contains("has not come to its end") && junit.contains("errors=\"1\""), "{junit}");
        drop(claim);
        assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 1);
    }
}
