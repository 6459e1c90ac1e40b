//! A command as it was typed, so that a shell reads it as the same words.

use crate::printable::is_unprintable;
use std::ffi::{OsStr, OsString};
use std::fmt::Write as _;
use std::os::unix::ffi::OsStrExt;

/// The command as typed, quoted for a POSIX shell.
pub(super) fn command(arguments: &[OsString]) -> String {
    arguments.iter().map(|word| quote(word)).collect::<Vec<_>>().join(" ")
}

/// Words as a command.
pub(super) fn quoted(words: &[String]) -> String {
    words.iter().map(|word| quote(OsStr::new(word))).collect::<Vec<_>>().join(" ")
}

/// The same with the seed made explicit.
pub(super) fn repeat(arguments: &[OsString], seed: u64) -> String {
    let has_seed = |word: &OsString| word == "--seed" || word.as_bytes().starts_with(b"--seed=");
    let command = command(arguments);
    if arguments.iter().any(has_seed) { command } else { format!("{command} --seed {seed}") }
}

fn quote(word: &OsStr) -> String {
    let plain = |c: char| c.is_ascii_alphanumeric() || "-_./=:,+@%".contains(c);
    match word.to_str() {
        Some(text) if !text.is_empty() && text.chars().all(plain) => text.to_owned(),
        Some(text) if !text.contains(is_unprintable) => format!("'{}'", text.replace('\'', r"'\''")),
        _ => in_octal(word.as_bytes()),
    }
}

/// `$'...'`, for what is not text, or would steer the terminal that shows it.
fn in_octal(bytes: &[u8]) -> String {
    let mut quoted = "$'".to_owned();
    for &byte in bytes {
        match byte {
            b'\'' | b'\\' => quoted.extend(['\\', char::from(byte)]),
            b' '..=b'~' => quoted.push(char::from(byte)),
            // Writing to a string does not fail.
            _ => drop(write!(quoted, "\\{byte:03o}")),
        }
    }
    quoted + "'"
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_repeating_command_has_the_seed_once_and_is_quoted() {
        let words = |list: &[&str]| list.iter().map(OsString::from).collect::<Vec<_>>();
        let command = repeat(&words(&["sim-host", "run", "my file.toml", "--set", "title=\"it's\""]), 3);
        assert_eq!(command, r#"sim-host run 'my file.toml' --set 'title="it'\''s"' --seed 3"#);
        assert_eq!(
            repeat(&words(&["sim-host", "run", "a.toml", "--seed=9"]), 9),
            "sim-host run a.toml --seed=9"
        );
    }

    #[test]
    fn what_steers_a_terminal_and_what_is_no_text_is_written_in_octal() {
        assert_eq!(quote(OsStr::new("a\u{1b}[2J'ψ")), r"$'a\033[2J\'\317\210'");
        assert_eq!(quote(OsStr::from_bytes(b"\xff")), r"$'\377'");
        assert_eq!(quote(OsStr::new("")), "''");
    }
}
