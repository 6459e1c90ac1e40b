//! `sim-host diff`: two recorded runs side by side.
#![allow(clippy::unwrap_used, reason = "helpers of tests, which clippy does not know as such")]

use std::path::Path;
use std::process::{Command, Output};

fn sim_host(arguments: &[&str]) -> (Option<i32>, String, String) {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("..");
    let output = Command::new(env!("CARGO_BIN_EXE_sim-host")).current_dir(root).args(arguments).output();
    let Output { status, stdout, stderr } = output.unwrap();
    (status.code(), String::from_utf8(stdout).unwrap(), String::from_utf8(stderr).unwrap())
}

/// A run of half a second with other settings, recorded in `folder`.
fn recorded(folder: &Path, set: &str) -> String {
    let folder = folder.display().to_string();
    let short =
        ["run", "scenarios/five-agents.toml", "--set", "time.duration=500ms", "--set", set, "--out", &folder];
    let (code, _, err) = sim_host(&short);
    assert_eq!(code, Some(0), "{err}");
    folder
}

#[test]
fn a_repetition_is_equal_and_another_run_says_where_it_leaves_it() {
    let folder = tempfile::tempdir().unwrap();
    let path = |name: &str| folder.path().join(name);
    let once = recorded(&path("once"), "seed=1");
    let again = recorded(&path("again"), "seed=1");
    let (code, out, err) = sim_host(&["diff", &once, &again]);
    assert_eq!((code, err.as_str()), (Some(0), ""));
    assert!(out.starts_with("equal: 501 rows of "), "{out}");
    assert!(out.contains("every figure of the summaries"), "{out}");

    let other = recorded(&path("other"), "node.2.state=1");
    let picture = path("both.svg").display().to_string();
    let (code, out, err) = sim_host(&["diff", &once, &other, "--plot", &picture]);
    assert_eq!((code, err.as_str()), (Some(1), ""));
    assert!(out.starts_with("first       t = 0 s (row 0): x_2 = -2 in A, 1 in B"), "{out}");
    assert!(std::fs::read_to_string(&picture).unwrap().starts_with("<svg"));

    let (code, out, _) = sim_host(&["diff", &once, &other, "--json"]);
    let json: serde_json::Value = serde_json::from_str(&out).unwrap();
    assert_eq!((code, &json["equal"], &json["first"]["column"]), (Some(1), &false.into(), &"x_2".into()));
}

#[test]
fn what_cannot_be_read_is_refused_and_nothing_that_is_compared_is_overwritten() {
    let folder = tempfile::tempdir().unwrap();
    let once = recorded(&folder.path().join("once"), "seed=1");
    let trajectory = format!("{once}/trajectory.csv");
    let before = std::fs::read(&trajectory).unwrap();
    let (code, _, err) = sim_host(&["diff", &once, &once, "--plot", &trajectory]);
    assert_eq!(code, Some(2));
    assert!(err.contains("would overwrite"), "{err}");
    assert_eq!(std::fs::read(&trajectory).unwrap(), before);

    let empty = folder.path().join("empty");
    std::fs::create_dir(&empty).unwrap();
    let (code, out, err) = sim_host(&["diff", &once, &empty.display().to_string()]);
    assert_eq!((code, out.as_str()), (Some(2), ""));
    assert!(err.contains("empty/trajectory.csv: cannot be read"), "{err}");
    let (code, _, err) = sim_host(&["diff", &trajectory, "scenarios/five-agents.toml"]);
    assert_eq!(code, Some(2));
    assert!(err.contains("scenarios/five-agents.toml:"), "{err}");
}

#[test]
fn every_reason_is_said_and_nothing_is_equal_where_nothing_was_compared() {
    let folder = tempfile::tempdir().unwrap();
    let once = recorded(&folder.path().join("once"), "seed=1");
    let trajectory = format!("{once}/trajectory.csv");
    // A trajectory alone beside a whole folder.
    let (code, out, _) = sim_host(&["diff", &trajectory, &once]);
    assert_eq!(code, Some(1));
    assert!(out.contains("summaries   only B has one"), "{out}");
    let (code, out, _) = sim_host(&["diff", &trajectory, &trajectory]);
    assert_eq!((code, out.starts_with("equal: 501 rows")), (Some(0), true), "{out}");

    for (name, text) in [("head", "t,x_1\n"), ("times", "t\n0\n1\n"), ("twice", "t,x_1,x_1\n0,1,2\n")] {
        let path = folder.path().join(name);
        std::fs::write(&path, text).unwrap();
        let path = path.display().to_string();
        let (code, out, err) = sim_host(&["diff", &path, &path]);
        assert_eq!((code, out.as_str()), (Some(2), ""), "{name}: {err}");
        assert!(err.contains("is no trajectory"), "{err}");
    }

    // No picture of a compared run is replaced either.
    let picture = format!("{once}/states.svg");
    let before = std::fs::read(&picture).unwrap();
    let (code, _, err) = sim_host(&["diff", &once, &once, "--plot", &picture]);
    assert_eq!((code, std::fs::read(&picture).unwrap() == before), (Some(2), true), "{err}");
}
