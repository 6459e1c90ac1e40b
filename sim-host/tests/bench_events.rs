//! Events on benches: played boards behind pseudo-terminals, and nodes in processes of their own.
#![allow(clippy::unwrap_used, clippy::panic, reason = "helpers of tests, which clippy does not know as such")]

mod boards;

use boards::{Bench, Board, SCENARIO, children, end, entry, loopback_hash, three, wait};
use funnelnet_node::Phase;
use serde_json::{Value, json};
use std::fs;
use std::time::Duration;

const HOST: &str = "host = true";
const CUT_AND_MENDED: &str = "[[event]]\nat = \"50ms\"\nkind = \"partition\"\nlink = [1, 2]\n[[event]]\nat = \"90ms\"\nkind = \"repair\"\n";

/// Three nodes on a path with these events, on boards or in processes.
fn bench_with(events: &str, entries: &[String]) -> Bench {
    Bench::new(&format!("{SCENARIO}recovered_within = \"60ms\"\n{events}"), entries)
}

fn entries(boards: &[Board; 3]) -> Vec<String> {
    boards.iter().map(|board| entry(&board.path)).collect()
}

fn three_processes() -> Vec<String> {
    vec![HOST.to_owned(); 3]
}

fn event(at: &str, kind: &str, rest: &str) -> String {
    format!("[[event]]\nat = \"{at}\"\nkind = \"{kind}\"\n{rest}\n")
}

/// The run passes with the bits of loopback with the same events.
fn assert_bits_of_loopback(bench: &Bench, events: &[&str]) -> Value {
    let ended = bench.run(&["--junit", bench.path("junit.xml").to_str().unwrap()]);
    assert_eq!(ended.code, Some(0), "{}", ended.err);
    assert!(ended.out.contains("bit for bit as loopback") && !ended.err.contains("skipped"), "{}", ended.err);
    let summary = bench.summary();
    assert_eq!(summary["trace_hash"], loopback_hash(&bench.path("scenario.toml")));
    assert_eq!(summary["bench"]["skipped"], json!([]));
    let told: Vec<_> = summary["events"].as_array().unwrap().iter().map(|event| &event["event"]).collect();
    assert_eq!(told, events);
    let lines = fs::read_to_string(bench.path("out/events.txt")).unwrap();
    let junit = fs::read_to_string(bench.path("junit.xml")).unwrap();
    for (n, event) in (1..).zip(events) {
        assert!(lines.contains(&format!("event {event}")), "{lines}");
        assert!(junit.contains(&format!("event-{n}")), "{junit}");
    }
    summary
}

#[test]
fn links_that_the_host_relays_are_cut_and_mended() {
    let boards = three();
    let bench = bench_with(CUT_AND_MENDED, &entries(&boards));
    let summary = assert_bits_of_loopback(&bench, &["partition link 1, 2", "repair all links"]);
    assert!(summary["funnel"]["during_events"]["node_ticks"].as_u64().unwrap() > 100, "{summary}");
    assert_eq!(summary["expect"][1]["name"], "recovered_within");
    assert_eq!(boards.map(Board::end), [Some(Phase::Stopped); 3]);
}

/// This program does not have the power of a board: it tells it to stop without a word, and configures it anew.
#[test]
fn boards_go_and_come() {
    let boards = three();
    let events = event("40ms", "bounce", "node = 1\nfor = \"20ms\"")
        + &event("70ms", "leave", "node = 3")
        + &event("100ms", "join", "node = 3")
        + &event("110ms", "burst", "node = 2\nloss = 0.5\nfor = \"20ms\"")
        + &event("140ms", "crash", "node = 3");
    let bench = bench_with(&events, &entries(&boards));
    let names = [
        "bounce node 1 for 20ms",
        "leave node 3",
        "join node 3",
        "burst node 2 loses 0.5 for 20ms",
        "crash node 3",
    ];
    let summary = assert_bits_of_loopback(&bench, &names);
    assert_eq!((&summary["stopped"], &summary["bench"]["unrecorded"]), (&json!([]), &json!(0)));
    let told = fs::read_to_string(bench.path("out/events.txt")).unwrap();
    assert!(told.contains("0.070000 s, node 3 stopped by command"), "{told}");
    assert_eq!(boards.map(Board::end), [Some(Phase::Stopped); 3]);
}

#[test]
fn a_process_that_is_bounced_is_another_one_then() {
    let bench = bench_with(&event("50ms", "bounce", "node = 2\nfor = \"20ms\""), &three_processes());
    assert_bits_of_loopback(&bench, &["bounce node 2 for 20ms"]);
    // Late enough to be seen.
    let late = format!("{SCENARIO}{}", event("10s", "bounce", "node = 2\nfor = \"20ms\""));
    let late = late.replace("duration = \"200ms\"", "duration = \"120s\"");
    let long = Bench::new(&late, &three_processes());
    let child = long.spawn(&[]);
    let second = || children(child.id()).iter().copied().collect::<std::collections::BTreeSet<_>>();
    wait("three processes", || second().len() == 3);
    let before = second();
    wait("another process", || second().len() == 3 && second() != before);
    assert_eq!(before.difference(&second()).count(), 1);
    assert!(
        std::process::Command::new("kill")
            .args(["-INT", &child.id().to_string()])
            .status()
            .unwrap()
            .success()
    );
    assert_eq!(end(child).code, Some(130));
}

/// A board that says no goodbye: the run ends, and says who it was.
#[test]
fn a_node_that_does_not_confirm_that_it_leaves_is_named() {
    let mute = Board::lying(2, |said| match said {
        boards::Says::Message(funnelnet_protocol::message::Message::Fault { .. }) => Vec::new(),
        said => vec![said],
    });
    let boards = [Board::good(1), mute, Board::good(3)];
    let leaves = event("50ms", "leave", "node = 2");
    let ended = bench_with(&leaves, &entries(&boards)).run(&[]);
    ended.fell_short(&["node 2 did not answer: no goodbye within 1 s"]);
    // From then on it is the event that keeps it off.
    let bench = bench_with(&leaves, &entries(&boards)).with("on_loss = \"go-on\"");
    bench.run(&[]).fell_short(&[
        "failed: absent: node 2 was away from tick 50 to tick 50: node 2 did not answer: no goodbye",
    ]);
    assert_eq!(
        (bench.failed_checks(), &bench.summary()["bench"]["unrecorded"]),
        (vec!["absent".to_owned()], &json!(0))
    );
}

const NARROW: &str = "key = \"coupling.funnel.end\"\nvalue = 1.0";

fn three_with_storages() -> (Vec<String>, tempfile::TempDir) {
    let folder = tempfile::tempdir().unwrap();
    let storage =
        |node| format!("host = true\nstorage = \"{}\"", folder.path().join(format!("flash{node}")).display());
    ((1..=3).map(storage).collect(), folder)
}

/// What they have adopted is what they start with from then on, and the next run does not care.
#[test]
fn processes_adopt_what_is_set_and_keep_it() {
    let (entries, _folder) = three_with_storages();
    let bench = bench_with(&event("100ms", "set", &format!("{NARROW}\nnodes = [1, 3]")), &entries);
    let stored = |ended: &boards::Ended| -> Vec<String> {
        assert_eq!(ended.code, Some(0), "{}", ended.err);
        ended
            .out
            .lines()
            .map(|line| line.split_once(": was ").unwrap().1.split_once(", is").unwrap().0.to_owned())
            .collect()
    };
    let summary = assert_bits_of_loopback(&bench, &["set nodes 1, 3: coupling.funnel.end = 1.0"]);
    assert_eq!(summary["bench"]["unrecorded"], 0);
    let told = fs::read_to_string(bench.path("out/events.txt")).unwrap();
    assert!(told.contains("node 1 has another configuration from tick 100 on"), "{told}");
    // A run with another event in which one of them is bounced: it comes back with what it has adopted.
    let bounced = event("50ms", "set", NARROW) + &event("100ms", "bounce", "node = 2\nfor = \"20ms\"");
    let again = bench_with(&bounced, &entries);
    assert_bits_of_loopback(&again, &["set all nodes: coupling.funnel.end = 1.0", "bounce node 2 for 20ms"]);
    let before = stored(&end(again.spawn_commission(&[])));
    assert!(before.iter().all(|was| was.starts_with("id ")), "{before:?}");
    let after = stored(&end(again.spawn_commission(&[])));
    assert!(before.iter().zip(&after).all(|(before, after)| before != after), "{before:?} {after:?}");
    assert_eq!(stored(&end(again.spawn_commission(&[]))), after);
}

#[test]
fn a_process_without_storage_and_its_bench_are_without_what_is_set() {
    let (mut entries, _folder) = three_with_storages();
    entries[1] = HOST.to_owned();
    let bench = bench_with(&(event("100ms", "set", NARROW) + CUT_AND_MENDED), &entries);
    let ended = bench.run(&[]);
    assert_eq!(ended.code, Some(0), "{}", ended.err);
    assert!(
        ended.err.contains("a process without storage keeps nothing that is staged in it"),
        "{}",
        ended.err
    );
    assert_eq!(bench.summary()["bench"]["skipped"], json!(["event.set"]));
    assert_eq!(bench.summary()["bench"]["bit_for_bit"], true);
}

#[test]
fn boards_adopt_what_is_set_also_with_clocks_of_their_own() {
    let boards = [1, 2, 3].map(Board::keeping);
    let bench = bench_with(&event("100ms", "set", NARROW), &entries(&boards));
    assert_bits_of_loopback(&bench, &["set all nodes: coupling.funnel.end = 1.0"]);
    // A busy machine may let a board wait for a fifth of a second, and eight ticks behind the others it is told to be apart.
    let bench = bench_with(&event("1600ms", "set", NARROW), &entries(&boards)).with("clock = \"own\"");
    let sets = ["time.tick=40ms", "time.duration=3200ms", "safety.lost_neighbours=3"];
    let ended = bench.run(&sets.iter().flat_map(|set| ["--set", set]).collect::<Vec<_>>());
    assert_eq!(ended.code, Some(0), "{}", ended.err);
    let told = fs::read_to_string(bench.path("out/events.txt")).unwrap();
    assert_eq!(told.matches("has another configuration from tick 40 on").count(), 3, "{told}");
    assert_eq!(bench.summary()["bench"]["skipped"], json!([]));
}

/// It says that it has what was staged in it, and its telemetry says what it does.
#[test]
fn a_board_that_pretends_to_have_adopted_runs_in_another_funnel_than_the_scenarios() {
    let boards = [Board::keeping(1), Board::pretending(2), Board::keeping(3)];
    let bench = bench_with(&event("100ms", "set", NARROW), &entries(&boards));
    bench.run(&[]).fell_short(&["node 2 runs in another funnel than the scenario's: "]);
    assert_eq!(bench.failed_checks(), ["consistent"]);
    assert_eq!(bench.summary()["bench"]["nodes"][1]["first_difference"], 100);
}

#[test]
fn a_board_that_cannot_stage_ends_the_run_before_it_starts() {
    let boards = [Board::keeping(1), Board::good(2), Board::keeping(3)];
    let bench = bench_with(&event("100ms", "set", NARROW), &entries(&boards));
    bench.run(&[]).failed(3, &["node 2 did not answer: no staged within 1 s"]);
}

#[test]
fn what_a_bench_cannot_make_is_skipped_by_its_kind_and_the_rest_is_made() {
    let boards = three();
    let events = event("20ms", "sensor", "node = 1\noffset = 1.0\nfor = \"10ms\"")
        + &event("30ms", "corrupt", "probability = 0.5\nfor = \"10ms\"")
        + CUT_AND_MENDED;
    let bench = bench_with(&events, &entries(&boards));
    let ended = bench.run(&[]);
    assert_eq!(ended.code, Some(0), "{}", ended.err);
    for line in [
        "skipped: 0.02 s, event sensor node 1 measures its state and 1 for 10ms: it happens in the node",
        "skipped: 0.03 s, event corrupt all links disturbs 0.5 for 10ms: a serial line has a checksum",
    ] {
        assert!(ended.err.contains(line), "{}", ended.err);
    }
    let summary = bench.summary();
    assert_eq!(summary["bench"]["skipped"], json!(["event.corrupt", "event.sensor"]));
    assert_eq!(
        (&summary["bench"]["bit_for_bit"], summary["events"].as_array().unwrap().len()),
        (&json!(true), 2)
    );
    let made = Bench::new(&format!("{SCENARIO}{CUT_AND_MENDED}"), &[]);
    assert_eq!(summary["trace_hash"], loopback_hash(&made.path("scenario.toml")));
    assert!(!fs::read_to_string(bench.path("out/events.txt")).unwrap().contains("event sensor"));
}

/// Drifting clocks would be another loopback beside.
#[test]
fn clocks_of_a_scenario_are_skipped() {
    let boards = three();
    let bench = Bench::of(&boards.each_ref());
    let ended = bench.run(&["--set", "clock={drift_ppm=1000}"]);
    assert_eq!(ended.code, Some(0), "{}", ended.err);
    assert!(ended.err.contains("skipped: clock: the clocks of a bench are its own"), "{}", ended.err);
    let summary = bench.summary();
    assert_eq!(summary["bench"]["skipped"], json!(["clock"]));
    assert_eq!(summary["bench"]["bit_for_bit"], true);
}

#[test]
fn with_clocks_of_their_own_links_are_cut_and_no_node_is_switched() {
    let events = event("600ms", "partition", "link = [1, 2]")
        + &event("1500ms", "repair", "")
        + &event("1800ms", "crash", "node = 3");
    let bench = bench_with(&events, &three_processes()).with("clock = \"own\"");
    // On this graph each has another neighbour. None stops for those that a busy computer is late with.
    let sets = ["time.tick=30ms", "time.duration=2400ms", "bus.latency=15ms", "graph.kind=complete"];
    let sets = sets.iter().chain(&["safety.lost_neighbours=3"]).flat_map(|set| ["--set", set]);
    let ended = bench.run(&sets.collect::<Vec<_>>());
    assert_eq!(ended.code, Some(0), "{}", ended.err);
    assert!(ended.took > Duration::from_millis(2400), "{:?}", ended.took);
    assert!(ended.err.contains("event crash node 3: no node that ticks by its own clock"), "{}", ended.err);
    let summary = bench.summary();
    assert_eq!(summary["bench"]["skipped"], json!(["event.crash"]));
    let node = |n: usize| &summary["bench"]["own_clock"]["nodes"][n]["extrapolated"];
    // Ten ticks without the one, and no longer: then the edge is dropped.
    assert!(node(0).as_u64() >= Some(8) && node(1).as_u64() >= Some(8), "{summary}");
    assert!(summary["counters"]["lost"].as_u64() >= Some(2), "{summary}");
}
