//! The page "Design your own in five steps": its commands say what it shows.
#![cfg(target_os = "linux")]
#![allow(clippy::unwrap_used, reason = "helpers of tests, which clippy does not know as such")]

use std::path::Path;
use std::process::{Command, Output};

const PAGE: &str = include_str!("../../docs/book/src/design-your-own.md");
/// Where lines were left out, and where the rest of one was.
const SHORTENED: &str = "...";

/// The text of the page's blocks of a kind.
fn blocks(kind: &str) -> impl Iterator<Item = &'static str> {
    let parts = PAGE.split("```").skip(1).step_by(2);
    parts.filter_map(|block| block.split_once('\n')).filter(move |(of, _)| *of == kind).map(|(_, text)| text)
}

/// All that a command of the page says, on both streams, and whether its exit code is 0.
fn said(folder: &Path, command: &str) -> (bool, String) {
    let words = command.strip_prefix("$ sim-host ").unwrap().split_whitespace();
    let words = words.map(|word| word.trim_matches('\''));
    let Output { status, stdout, stderr } =
        Command::new(env!("CARGO_BIN_EXE_sim-host")).current_dir(folder).args(words).output().unwrap();
    (status.success(), String::from_utf8([stdout, stderr].concat()).unwrap())
}

/// The first of the lines that are shown which is not said, in this order.
fn missing<'a>(shown: &[&'a str], said: &str) -> Option<&'a str> {
    let mut lines = said.lines();
    shown.iter().copied().filter(|line| *line != SHORTENED).find(|wanted| {
        let is = |line: &str| match wanted.strip_suffix(SHORTENED) {
            Some(begin) => line.starts_with(begin),
            None => line == *wanted,
        };
        !lines.by_ref().any(is)
    })
}

#[test]
fn every_command_of_the_page_says_what_the_page_shows() {
    let folder = tempfile::tempdir().unwrap();
    let files: Vec<_> = blocks("toml").collect();
    assert_eq!(files.len(), 2);
    for (name, text) in ["drives.toml", "bench.toml"].into_iter().zip(files) {
        std::fs::write(folder.path().join(name), text).unwrap();
    }
    let mut compared = 0;
    for block in blocks("text") {
        let lines: Vec<_> = block.lines().collect();
        let (command, shown) = lines.split_first().unwrap();
        let (succeeds, said) = said(folder.path(), command);
        let fails = block.contains("\nFAIL") || block.contains("starts outside");
        assert_eq!(succeeds, !fails, "{command}\n{said}");
        assert_eq!(missing(shown, &said), None, "{command}\n{said}");
        compared += 1;
    }
    assert_eq!(compared, 11);
}

#[test]
fn a_line_that_is_not_said_or_comes_too_early_is_found() {
    let said = "a\nb 1\nc";
    assert_eq!(missing(&["...", "a", "b ...", "c"], said), None);
    assert_eq!(missing(&["b 2"], said), Some("b 2"));
    assert_eq!(missing(&["c", "a"], said), Some("a"));
}
