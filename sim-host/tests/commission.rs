//! `sim-host bench --commission` and `--erase`, on nodes in processes that keep their configuration in files.
#![allow(clippy::unwrap_used, clippy::panic, reason = "helpers of tests, which clippy does not know as such")]

mod boards;

use boards::{Bench, Board, Ended, SCENARIO, end, entry, wait};
use std::fs;
use std::process::{Command, Stdio};

/// Three processes with storages of their own in the folder of the bench.
fn three_with_storages() -> Bench {
    let bench = Bench::new(SCENARIO, &[1, 2, 3].map(|_| "host = true".to_owned()));
    for node in 1..=3 {
        let storage = bench.path(&format!("flash{node}"));
        let text = fs::read_to_string(bench.path("bench.toml")).unwrap();
        let entry = format!("id = {node}\nhost = true\n");
        let text = text.replace(&entry, &format!("{entry}storage = \"{}\"\n", storage.display()));
        fs::write(bench.path("bench.toml"), text).unwrap();
    }
    bench
}

fn erase(bench: &Bench) -> Ended {
    let mut command = Command::new(env!("CARGO_BIN_EXE_sim-host"));
    command.args(["bench", "--erase", "--bench"]).arg(bench.path("bench.toml"));
    end(command.stdin(Stdio::null()).stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().unwrap())
}

/// What the lines of a commissioning say that nodes were and are.
fn told(ended: &Ended) -> Vec<(String, String)> {
    assert_eq!(ended.code, Some(0), "{}", ended.err);
    let part = |line: &str| {
        let (was, is) = line.split_once(": was ").unwrap().1.split_once(", ").unwrap();
        (was.to_owned(), is.to_owned())
    };
    ended.out.lines().map(part).collect()
}

#[test]
fn what_nodes_are_given_survives_their_restart() {
    let bench = three_with_storages();
    let first = told(&bench.run(&["--commission"]));
    assert_eq!(first.len(), 3);
    for ((was, is), id) in first.iter().zip(1..) {
        assert_eq!(was, "blank");
        assert!(is.starts_with(&format!("is id {id} with configuration ")), "{is}");
    }
    // New processes: what they say they were is what their files have kept.
    let second = told(&bench.run(&["--commission", "--set", "coupling.funnel.end=1.5"]));
    for ((before, after), (_, kept)) in second.iter().zip(&first) {
        assert_eq!(format!("is {before}"), *kept);
        assert_ne!(after, kept, "another funnel, another checksum");
    }
    // A run on them is the same run: its configuration is volatile, and theirs stays.
    let run = bench.run(&[]);
    assert!(run.out.contains("bit for bit as loopback"), "{}{}", run.out, run.err);
    let third = told(&bench.run(&["--commission"]));
    assert!(third.iter().zip(&second).all(|((was, _), (_, is))| format!("is {was}") == *is), "{third:?}");
    let erased = told(&erase(&bench));
    assert!(erased.iter().all(|(_, after)| after == "will be blank at its next start"), "{erased:?}");
    let fourth = told(&bench.run(&["--commission"]));
    assert!(fourth.iter().all(|(was, _)| was == "blank"), "{fourth:?}");
}

#[test]
fn where_one_cannot_store_none_is_changed() {
    let bench = three_with_storages();
    let text = fs::read_to_string(bench.path("bench.toml")).unwrap();
    let path = bench.path("flash3");
    let without = text.replace(&format!("storage = \"{}\"\n", path.display()), "");
    fs::write(bench.path("bench.toml"), &without).unwrap();
    let ended = bench.run(&["--commission"]);
    let words = [
        "node 3 has not staged its configuration: the board has no storage",
        "nothing was committed: every node has what it had",
    ];
    ended.failed(3, &words);
    fs::write(bench.path("bench.toml"), text).unwrap();
    let after = told(&bench.run(&["--commission"]));
    assert!(after.iter().all(|(was, _)| was == "blank"), "{after:?}");
}

#[test]
fn a_node_that_is_not_there_changes_none() {
    let bench = three_with_storages();
    let text = fs::read_to_string(bench.path("bench.toml")).unwrap();
    let path = bench.path("flash2");
    let entry = format!("host = true\nstorage = \"{}\"\n", path.display());
    fs::write(bench.path("bench.toml"), text.replace(&entry, "serial = \"/dev/no-such-port\"\n")).unwrap();
    bench.run(&["--commission"]).failed(3, &["/dev/no-such-port does not exist", "nothing was committed"]);
}

#[test]
fn a_storage_that_is_none_ends_the_node_and_is_named() {
    let bench = three_with_storages();
    fs::write(bench.path("flash2"), "a letter").unwrap();
    let ended = bench.run(&["--commission"]);
    ended.failed(3, &["node 2", "it has 8 bytes, and a storage has 16384", "nothing was committed"]);
}

#[test]
fn ctrl_c_before_the_commit_changes_none() {
    // A played board has no answer to STAGE, so the program waits for it.
    let board = Board::good(3);
    let bench = three_with_storages().with("answer_within = \"60s\"");
    let text = fs::read_to_string(bench.path("bench.toml")).unwrap().replace("answer_within = \"1s\"\n", "");
    let storage = bench.path("flash3");
    let played = format!("host = true\nstorage = \"{}\"\n", storage.display());
    fs::write(bench.path("bench.toml"), text.replace(&played, &format!("{}\n", entry(&board.path)))).unwrap();
    let child = bench.spawn(&["--commission"]);
    // Both others have erased a half of their storage and written to it.
    wait("staged", || [1, 2].iter().all(|node| written(&bench.path(&format!("flash{node}")))));
    std::thread::sleep(std::time::Duration::from_millis(300));
    assert!(Command::new("kill").args(["-INT", &child.id().to_string()]).status().unwrap().success());
    end(child).failed(130, &["interrupted", "nothing was committed"]);
    board.end();
    fs::write(bench.path("bench.toml"), text).unwrap();
    let after = told(&bench.run(&["--commission"]));
    assert!(after.iter().all(|(was, _)| was == "blank"), "{after:?}");
}

fn written(flash: &std::path::Path) -> bool {
    fs::read(flash).is_ok_and(|bytes| bytes.iter().any(|&byte| byte != 0xFF))
}
