//! Removal of files of an earlier run, whose rights their successors are to have.

use super::atomic::{RecordError, follow, is_device, is_standard_output};
use std::collections::BTreeMap;
use std::fs::{self, Permissions};
use std::io;
use std::path::{Path, PathBuf};
use std::sync::{Mutex, PoisonError};

/// Rights of the files that this process has removed, by the name of the file itself.
static REMOVED: Mutex<BTreeMap<PathBuf, Permissions>> = Mutex::new(BTreeMap::new());

/// Removes a file of an earlier run, and remembers its rights for the one that takes its place. Of a symbolic
/// link the target goes. A folder, a device or a pipe stays, and what is not there is no failure.
///
/// # Errors
/// [`RecordError`]: it is there and stays.
pub fn remove_earlier(path: &Path) -> Result<(), RecordError> {
    if is_standard_output(path) || is_device(path) {
        return Ok(());
    }
    let failed = |reason| RecordError { path: path.to_owned(), reason };
    let target = follow(path).map_err(failed)?;
    match fs::symlink_metadata(&target) {
        Ok(metadata) if metadata.is_file() => {
            fs::remove_file(&target).map_err(failed)?;
            REMOVED.lock().unwrap_or_else(PoisonError::into_inner).insert(target, metadata.permissions());
            Ok(())
        }
        Err(reason) if !is_absent(&reason) => Err(failed(reason)),
        _ => Ok(()),
    }
}

fn is_absent(reason: &io::Error) -> bool {
    matches!(reason.kind(), io::ErrorKind::NotFound | io::ErrorKind::NotADirectory)
}

/// The rights of the file at `target`, or of the one that was removed there.
pub(super) fn of(target: &Path) -> Option<Permissions> {
    match fs::symlink_metadata(target) {
        Ok(metadata) => metadata.is_file().then(|| metadata.permissions()),
        Err(_) => REMOVED.lock().unwrap_or_else(PoisonError::into_inner).get(target).cloned(),
    }
}

#[cfg(test)]
mod tests {
    use super::super::atomic::tests::Folder;
    use super::super::write_atomic;
    use super::*;

    #[test]
    #[cfg(unix)]
    fn a_file_that_was_removed_at_the_start_leaves_its_rights() {
        use std::os::unix::fs::{PermissionsExt, symlink};
        let folder = Folder::new("removed");
        let at = |name: &str| folder.0.join(name);
        fs::write(at("target"), "old").unwrap();
        fs::set_permissions(at("target"), Permissions::from_mode(0o640)).unwrap();
        symlink("target", at("link")).unwrap();
        remove_earlier(&at("link")).unwrap();
        assert!(!at("target").exists() && fs::symlink_metadata(at("link")).unwrap().is_symlink());
        write_atomic(at("link"), b"new").unwrap();
        assert_eq!(fs::metadata(at("target")).unwrap().permissions().mode() & 0o7777, 0o640);
        fs::create_dir(at("folder")).unwrap();
        for name in ["folder", "none", "target/none"] {
            remove_earlier(&at(name)).unwrap();
        }
        assert!(at("folder").is_dir());
    }
}
