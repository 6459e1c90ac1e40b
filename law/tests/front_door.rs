//! The first program in the README of the repository is the one in the README of the crate, which runs as a
//! doctest.
#![allow(clippy::unwrap_used, reason = "helpers of tests, which clippy does not know as such")]

use std::path::Path;

/// The first block of Rust, without its fences.
fn first_program(readme: &str) -> &str {
    let start = readme.find("```rust\n").unwrap() + "```rust\n".len();
    let length = readme[start..].find("```\n").unwrap();
    &readme[start..start + length]
}

#[test]
fn both_readmes_show_the_same_first_program_of_at_most_ten_lines() {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR"));
    let own = std::fs::read_to_string(folder.join("README.md")).unwrap();
    let program = first_program(&own);
    assert!(program.lines().count() <= 10, "{program}");
    // Outside the repository there is only one README.
    if let Ok(top) = std::fs::read_to_string(folder.join("../README.md")) {
        assert_eq!(first_program(&top), program);
    }
}
