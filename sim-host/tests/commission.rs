//! `sim-host bench --commission` and `--erase`, on nodes in processes that keep their configuration in files,
//! and on played ones that fail.
#![allow(clippy::unwrap_used, clippy::panic, reason = "helpers of tests, which clippy does not know as such")]

mod boards;
mod keepers;

use boards::{Bench, Board, Ended, SCENARIO, end, entry, wait};
use funnelnet_protocol::config::NodeConfig;
use keepers::{Flaw, Keeper, attached, config, words};
use sim_host::hub::{Attached, Commissioned, Commissioning, Failed, HubError, Patience};
use sim_host::interrupt::Interrupt;
use std::fs;
use std::process::Command;
use std::time::Duration;

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

/// Node `id` is a board without a storage from now on.
fn without_storage(bench: &Bench, id: u8) {
    let text = fs::read_to_string(bench.path("bench.toml")).unwrap();
    let storage = format!("storage = \"{}\"\n", bench.path(&format!("flash{id}")).display());
    fs::write(bench.path("bench.toml"), text.replace(&storage, "")).unwrap();
}

fn store(bench: &Bench, arguments: &[&str]) -> Ended {
    end(bench.spawn_commission(arguments))
}

fn erase(bench: &Bench) -> Ended {
    end(bench.spawn_erase())
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
    let first = told(&store(&bench, &[]));
    assert_eq!(first.len(), 3);
    for ((was, is), id) in first.iter().zip(1..) {
        assert_eq!(was, "blank");
        assert!(is.starts_with(&format!("is id {id} with configuration ")), "{is}");
    }
    // New processes: what they say they were is what their files have kept.
    let second = told(&store(&bench, &["--set", "coupling.funnel.end=1.5"]));
    for ((before, after), (_, kept)) in second.iter().zip(&first) {
        assert_eq!(format!("is {before}"), *kept);
        assert_ne!(after, kept, "another funnel, another checksum");
    }
    // A run on them is the same run: its configuration is volatile, and theirs stays.
    let run = bench.run(&[]);
    assert!(run.out.contains("bit for bit as loopback"), "{}{}", run.out, run.err);
    let third = told(&store(&bench, &[]));
    assert!(third.iter().zip(&second).all(|((was, _), (_, is))| format!("is {was}") == *is), "{third:?}");
    let erased = told(&erase(&bench));
    assert!(erased.iter().all(|(_, after)| after == "will be blank at its next start"), "{erased:?}");
    let fourth = told(&store(&bench, &[]));
    assert!(fourth.iter().all(|(was, _)| was == "blank"), "{fourth:?}");
}

/// What one keeps ends with it, which is when this program ends.
#[test]
fn an_emulator_is_not_commissioned() {
    let bench = Bench::new(SCENARIO, &["host = true", "emulator = true", "host = true"].map(str::to_owned));
    store(&bench, &[]).failed(2, &["node 2 is an emulator, which keeps nothing once this program has ended"]);
}

#[test]
fn where_one_cannot_store_none_is_changed() {
    let bench = three_with_storages();
    let text = fs::read_to_string(bench.path("bench.toml")).unwrap();
    without_storage(&bench, 3);
    let ended = store(&bench, &[]);
    let words = [
        "node 3 has not staged its configuration: the board has no storage",
        "nothing was committed: every node has what it had",
    ];
    ended.failed(3, &words);
    fs::write(bench.path("bench.toml"), text).unwrap();
    let after = told(&store(&bench, &[]));
    assert!(after.iter().all(|(was, _)| was == "blank"), "{after:?}");
}

#[test]
fn a_node_that_is_not_there_changes_none() {
    let bench = three_with_storages();
    let text = fs::read_to_string(bench.path("bench.toml")).unwrap();
    let path = bench.path("flash2");
    let entry = format!("host = true\nstorage = \"{}\"\n", path.display());
    fs::write(bench.path("bench.toml"), text.replace(&entry, "serial = \"/dev/no-such-port\"\n")).unwrap();
    store(&bench, &[]).failed(3, &["/dev/no-such-port does not exist", "nothing was committed"]);
}

#[test]
fn an_erase_names_those_that_were_erased() {
    let bench = three_with_storages();
    told(&store(&bench, &[]));
    without_storage(&bench, 2);
    let ended = erase(&bench);
    ended.failed(
        3,
        &["node 2 has not erased what it stores: the board has no storage", "erased: 1; unchanged: 2, 3; "],
    );
}

#[test]
fn where_no_node_is_met_nothing_was_erased() {
    let bench = three_with_storages();
    let text = fs::read_to_string(bench.path("bench.toml")).unwrap();
    let entry = format!("host = true\nstorage = \"{}\"\n", bench.path("flash2").display());
    fs::write(bench.path("bench.toml"), text.replace(&entry, "serial = \"/dev/no-such-port\"\n")).unwrap();
    erase(&bench).failed(3, &["/dev/no-such-port does not exist", "nothing was erased"]);
}

#[test]
fn a_storage_that_is_none_ends_the_node_and_is_named() {
    let bench = three_with_storages();
    fs::write(bench.path("flash2"), "a letter").unwrap();
    let ended = store(&bench, &[]);
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
    let child = bench.spawn_commission(&[]);
    // Both others have erased a half of their storage and written to it.
    wait("staged", || [1, 2].iter().all(|node| written(&bench.path(&format!("flash{node}")))));
    std::thread::sleep(std::time::Duration::from_millis(300));
    assert!(Command::new("kill").args(["-INT", &child.id().to_string()]).status().unwrap().success());
    end(child).failed(130, &["interrupted", "nothing was committed"]);
    board.end();
    fs::write(bench.path("bench.toml"), text).unwrap();
    let after = told(&store(&bench, &[]));
    assert!(after.iter().all(|(was, _)| was == "blank"), "{after:?}");
}

fn written(flash: &std::path::Path) -> bool {
    fs::read(flash).is_ok_and(|bytes| bytes.iter().any(|&byte| byte != 0xFF))
}

const PATIENCE: Patience = Patience { boot: Duration::from_secs(10), answer: Duration::from_secs(2) };

/// Commissions the nodes with ids from 1.
fn commission(nodes: Vec<Attached>) -> Result<Vec<Commissioned>, Failed> {
    let configs: Vec<NodeConfig> = nodes.iter().zip(1..).map(|(_, id)| config(id, 10.0)).collect();
    Commissioning::new(nodes, PATIENCE).unwrap().commission(&configs)
}

/// The error where no node has changed.
fn before<T>(outcome: Result<T, Failed>) -> HubError {
    match outcome {
        Err(Failed::Before(error)) => error,
        Err(failed) => panic!("{failed:?}"),
        Ok(_) => panic!("all were done"),
    }
}

/// The error where some may have changed, and ids: of those that have, of those that may have, and of those
/// that have not.
fn after<T>(outcome: Result<T, Failed>) -> (HubError, [Vec<u8>; 3]) {
    match outcome {
        Err(Failed::After(error, known)) => (error, [known.done, known.unsure, known.unchanged]),
        Err(failed) => panic!("{failed:?}"),
        Ok(_) => panic!("all were done"),
    }
}

#[test]
fn a_node_that_runs_is_stopped_first() {
    let (kept, nodes) = attached([Keeper::running(config(1, 20.0))]);
    assert_eq!(commission(nodes).unwrap().len(), 1);
    assert_eq!(words(&kept), ["committed"]);
}

#[test]
fn where_one_stages_something_else_none_is_changed() {
    let (kept, nodes) = attached([Keeper::blank(1, Flaw::Nothing), Keeper::blank(2, Flaw::StagesAnother)]);
    let error = before(commission(nodes));
    assert!(matches!(error, HubError::Checksum { node: 2, .. }), "{error}");
    assert_eq!(words(&kept), ["staged", "staged"]);
}

#[test]
fn the_wish_to_stop_is_heard_until_the_first_commit() {
    let interrupt = Interrupt::default();
    let (kept, nodes) = attached([1, 2].map(|id| {
        let flaw = if id == 2 { Flaw::InterruptedAtStage } else { Flaw::Nothing };
        Keeper::interrupted(id, flaw, &interrupt)
    }));
    let error = before(commission(nodes));
    assert!(matches!(error, HubError::Interrupted), "{error}");
    assert_eq!(words(&kept), ["staged", "staged"]);
}

#[test]
fn the_wish_to_stop_is_not_heard_between_two_commits() {
    let interrupt = Interrupt::default();
    let keeper = |id| Keeper::interrupted(id, Flaw::InterruptedAtCommit, &interrupt);
    let (kept, nodes) = attached([1, 2].map(keeper));
    assert_eq!(commission(nodes).unwrap().len(), 2);
    assert!(interrupt.is_set());
    assert_eq!(words(&kept), ["committed", "committed"]);
}

#[test]
fn the_wish_to_stop_is_heard_before_the_first_erase_and_not_after_it() {
    let interrupt = Interrupt::default();
    let keeper = |id| Keeper::interrupted(id, Flaw::InterruptedAtCommit, &interrupt);
    let (kept, nodes) = attached([1, 2].map(keeper));
    assert_eq!(Commissioning::new(nodes, PATIENCE).unwrap().erase().unwrap().len(), 2);
    assert!(interrupt.is_set());
    assert_eq!(words(&kept), ["erased", "erased"]);
    let interrupt = Interrupt::default();
    let (kept, nodes) = attached([Keeper::interrupted(1, Flaw::Nothing, &interrupt)]);
    let nodes = Commissioning::new(nodes, PATIENCE).unwrap();
    interrupt.set();
    let error = before(nodes.erase());
    assert!(matches!(error, HubError::Interrupted), "{error}");
    assert_eq!(words(&kept), [""]);
}

#[test]
fn of_a_node_that_dies_at_its_commit_nothing_is_known() {
    let (kept, nodes) = attached([Keeper::blank(1, Flaw::Dies), Keeper::blank(2, Flaw::Nothing)]);
    let (error, ids) = after(commission(nodes));
    assert!(matches!(error, HubError::Died { node: 1, .. }), "{error}");
    assert_eq!(ids, [vec![], vec![1], vec![2]]);
    assert_eq!(words(&kept), ["committed", "staged"]);
}

#[test]
fn those_before_it_are_done_and_those_after_it_are_not() {
    let flaws = [(1, Flaw::Nothing), (2, Flaw::Dies), (3, Flaw::Nothing)];
    let (kept, nodes) = attached(flaws.map(|(id, flaw)| Keeper::blank(id, flaw)));
    let (_, ids) = after(commission(nodes));
    assert_eq!(ids, [vec![1], vec![2], vec![3]]);
    assert_eq!(words(&kept), ["committed", "committed", "staged"]);
}

#[test]
fn of_a_node_that_dies_as_it_is_erased_nothing_is_known() {
    let (kept, nodes) = attached([Keeper::blank(1, Flaw::Dies), Keeper::blank(2, Flaw::Nothing)]);
    let (_, ids) = after(Commissioning::new(nodes, PATIENCE).unwrap().erase());
    assert_eq!(ids, [vec![], vec![1], vec![2]]);
    assert_eq!(words(&kept), ["erased", ""]);
}

#[test]
fn a_node_that_still_says_its_old_checksum_is_unchanged() {
    let other = config(2, 20.0);
    let (kept, nodes) =
        attached([Keeper::blank(1, Flaw::Nothing), Keeper::configured(other.clone(), Flaw::HearsNoCommit)]);
    let (error, ids) = after(commission(nodes));
    assert!(
        matches!(error, HubError::Checksum { node: 2, found, .. } if found == other.checksum()),
        "{error}"
    );
    assert_eq!(ids, [vec![1], vec![], vec![2]]);
    assert_eq!(words(&kept), ["committed", "staged"]);
}

#[test]
fn where_the_first_one_surely_has_what_it_had_all_have() {
    let (kept, nodes) = attached([Keeper::blank(1, Flaw::HearsNoCommit), Keeper::blank(2, Flaw::Nothing)]);
    let error = before(commission(nodes));
    assert!(matches!(error, HubError::Checksum { node: 1, found: 0, .. }), "{error}");
    assert_eq!(words(&kept), ["staged", "staged"]);
    let (kept, nodes) = attached([Keeper::blank(1, Flaw::StorageFails), Keeper::blank(2, Flaw::Nothing)]);
    let error = before(Commissioning::new(nodes, PATIENCE).unwrap().erase());
    assert!(matches!(error, HubError::NotErased { node: 1, .. }), "{error}");
    assert_eq!(words(&kept), ["", ""]);
}

#[test]
fn a_storage_that_fails_at_the_commit_is_told_though_the_checksum_is_right() {
    let (kept, nodes) = attached([Keeper::configured(config(1, 10.0), Flaw::StorageFails)]);
    let (error, ids) = after(commission(nodes));
    assert!(matches!(error, HubError::NotCommitted { node: 1 }), "{error}");
    assert_eq!(ids, [vec![], vec![1], vec![]]);
    assert_eq!(words(&kept), ["staged"]);
}
