//! The book's page of twelve nodes: its files are taken from the page, and its commands are run with processes in place of boards.
#![allow(clippy::unwrap_used, clippy::panic, reason = "helpers of tests, which clippy does not know as such")]

use std::fs;
use std::path::Path;
use std::process::Command;

const NODES: usize = 12;

/// The page, and what is in its blocks of TOML.
fn page() -> (String, Vec<String>) {
    let text =
        fs::read_to_string(Path::new(env!("CARGO_MANIFEST_DIR")).join("../docs/book/src/checklist.md"))
            .unwrap();
    let blocks = text.split("```toml\n").skip(1).map(|rest| rest.split("```").next().unwrap().to_owned());
    let blocks = blocks.collect();
    (text, blocks)
}

/// What a command of the page says, which must succeed. It must stand on the page.
fn says(page: &str, at: &Path, command: &str) -> String {
    assert!(page.contains(&format!("`{command}`")), "{command} is not on the page");
    let arguments = command.strip_prefix("sim-host ").unwrap().split(' ');
    let done = Command::new(env!("CARGO_BIN_EXE_sim-host")).current_dir(at).args(arguments).output().unwrap();
    let said = [done.stdout, done.stderr].map(|bytes| String::from_utf8(bytes).unwrap()).concat();
    assert!(done.status.success(), "{command}: {said}");
    said
}

#[test]
fn twelve_processes_go_through_the_page() {
    let (page, blocks) = page();
    let [scenario, _, of_process] = blocks.as_slice() else { panic!("{} blocks", blocks.len()) };
    let folder = tempfile::tempdir().unwrap();
    let at = folder.path();
    fs::write(at.join("twelve.toml"), scenario).unwrap();
    let (head, first) = of_process.split_once("[[node]]").unwrap();
    let node = |id: usize| {
        format!("[[node]]{first}")
            .replace("= 1\n", &format!("= {id}\n"))
            .replace("flash1", &format!("flash{id}"))
    };
    fs::write(at.join("bench.toml"), head.to_owned() + &(1..=NODES).map(node).collect::<String>()).unwrap();
    let say = |command: &str| says(&page, at, command);

    let checked = say("sim-host check twelve.toml");
    assert!(!checked.contains("FAIL") && !checked.contains("WARN"), "{checked}");
    let passes = |said: &str| said.lines().any(|line| line.trim_start().starts_with("pass "));
    assert!(passes(&say("sim-host run twelve.toml --out out/loopback")));
    let trial = say("sim-host bench twelve.toml --bench bench.toml --set time.duration=2s --out out/trial");
    assert!(trial.contains("bit for bit as loopback") && passes(&trial), "{trial}");

    let commission = "sim-host bench twelve.toml --bench bench.toml --commission";
    let (first, again) = (say(commission), say(commission));
    let told = |said: &str, was: &str| {
        let lines: Vec<_> = said.lines().filter(|line| line.contains(was)).map(str::to_owned).collect();
        assert_eq!(lines.len(), NODES, "{said}");
        lines.into_iter().map(|line| line.rsplit(' ').next().unwrap().to_owned()).collect::<Vec<_>>()
    };
    // Processes that begin anew have what was stored.
    let stored = told(&first, "was blank, is id");
    for (id, checksum) in (1..=NODES).zip(&stored) {
        assert!(again.contains(&format!("was id {id} with configuration {checksum}")), "{again}");
    }

    assert!(passes(&say("sim-host bench twelve.toml --bench bench.toml --out out/accepted")));
    say("sim-host report out/accepted");
    assert!(at.join("out/accepted/report.html").is_file());
}
