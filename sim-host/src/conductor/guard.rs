//! Reads the sources here, so that nothing of the outside gets in.

use std::fs;
use std::path::{Path, PathBuf};

/// What tells the time, waits, or is a line, a bus, a device or the user.
const OUTSIDE: [&str; 20] = [
    "Instant",
    "SystemTime",
    "elapsed",
    "sleep",
    "thread",
    "spawn",
    "park",
    "recv",
    "recv_timeout",
    "mpsc",
    "Interrupt",
    "interrupt",
    "serialport",
    "socketcan",
    "TTYPort",
    "UnixStream",
    "CanPort",
    "Stream",
    "Device",
    "Outlets",
];

/// Words of a source text that belong outside, up to its tests.
fn outside(text: &str) -> Vec<&'static str> {
    let logic = text.split("#[cfg(test)]\nmod tests {").next().unwrap_or(text);
    // Comments may name what is elsewhere.
    let code = logic.lines().filter(|line| !line.trim_start().starts_with("//"));
    let words: Vec<_> =
        code.flat_map(|line| line.split(|c: char| !c.is_alphanumeric() && c != '_')).collect();
    OUTSIDE.into_iter().filter(|word| words.contains(word)).collect()
}

/// All files of the conductor but this one.
fn files() -> Vec<PathBuf> {
    let (mut files, mut left) =
        (Vec::new(), vec![Path::new(env!("CARGO_MANIFEST_DIR")).join("src/conductor")]);
    while let Some(path) = left.pop() {
        if path.is_dir() {
            left.extend(fs::read_dir(&path).unwrap().map(|entry| entry.unwrap().path()));
        } else if !path.ends_with("guard.rs") {
            files.push(path);
        }
    }
    files
}

#[test]
fn no_file_here_reads_a_clock_waits_or_knows_a_line() {
    for path in files() {
        let found = outside(&fs::read_to_string(&path).unwrap());
        assert!(found.is_empty(), "{}: {found:?}", path.display());
    }
    let moved = [
        "absence.rs",
        "commission.rs",
        "contact.rs",
        "halt.rs",
        "lockstep.rs",
        "on_can.rs",
        "own_clock.rs",
        "task.rs",
        "update.rs",
    ];
    for name in moved {
        assert!(files().iter().any(|path| path.ends_with(name)), "{name} is elsewhere, and nobody reads it");
    }
}

#[test]
fn what_belongs_outside_is_found() {
    assert_eq!(
        outside("let begin = Instant::now(); std::thread::sleep(SLICE)"),
        ["Instant", "sleep", "thread"]
    );
    assert_eq!(outside("/// Beside an Instant.\nfn wait() {}"), [""; 0]);
}
