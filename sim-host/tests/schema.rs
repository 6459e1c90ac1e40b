//! The committed schema of the scenario file is the one that the program prints.
#![allow(clippy::unwrap_used, clippy::panic, reason = "a test that cannot go on has failed")]

use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;

fn repository() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("..")
}

fn printed() -> String {
    let output = Command::new(env!("CARGO_BIN_EXE_sim-host")).arg("schema").output().unwrap();
    assert!(output.status.success());
    String::from_utf8(output.stdout).unwrap()
}

#[test]
fn the_committed_schema_is_the_printed_one() {
    let path = repository().join("docs/scenario.schema.json");
    let printed = printed();
    if std::env::var_os("UPDATE_SNAPSHOTS").is_some() {
        fs::write(&path, &printed).unwrap();
    }
    assert!(
        fs::read_to_string(&path).unwrap_or_default() == printed,
        "docs/scenario.schema.json is not what `sim-host schema` prints. If the change is meant: UPDATE_SNAPSHOTS=1 cargo test \
         --package sim-host --test schema"
    );
}
