//! What a run that does not pass leaves behind: its scenario, complete, in a folder of its own.

use super::one::Ended;
use crate::record::write_atomic;
use crate::run::{RunError, SCENARIO_FILE, is_ours};
use std::fs;
use std::path::{Path, PathBuf};

/// The folder of such folders, in that of the sweep.
const FOLDER: &str = "failed";

/// The file with the scenario of a run.
#[must_use]
pub fn scenario_path(folder: &Path, number: u64) -> PathBuf {
    folder.join(FOLDER).join(format!("run-{number}")).join(SCENARIO_FILE)
}

/// Writes it, with the inputs that it names; nothing where the scenario could not be read.
///
/// # Errors
/// A file cannot be written.
pub fn leave(folder: &Path, ended: &Ended) -> Result<Option<PathBuf>, RunError> {
    let Some(scenario) = &ended.scenario else { return Ok(None) };
    let path = scenario_path(folder, ended.run.number);
    let beside = path.parent().unwrap_or(folder);
    fs::create_dir_all(beside)
        .map_err(|reason| crate::record::RecordError { path: beside.to_owned(), reason })?;
    for input in scenario.input_files() {
        write_atomic(beside.join(&input.name), input.text.as_bytes())?;
    }
    write_atomic(&path, scenario.as_run().as_bytes())?;
    Ok(Some(path))
}

/// Removes what an earlier sweep has left: files of this program only. What cannot be removed is overwritten where it is in the way.
pub fn clear(folder: &Path) {
    let folder = folder.join(FOLDER);
    for run in fs::read_dir(&folder).into_iter().flatten().flatten() {
        let is_run = run.file_name().to_str().is_some_and(|name| name.starts_with("run-"));
        for file in fs::read_dir(run.path()).into_iter().flatten().flatten().filter(|_| is_run) {
            if file.file_name().to_str().is_some_and(is_ours) {
                let _ = fs::remove_file(file.path());
            }
        }
        if is_run {
            let _ = fs::remove_dir(run.path());
        }
    }
    let _ = fs::remove_dir(folder);
}
