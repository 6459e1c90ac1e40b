//! Benches whose nodes tick by clocks of their own and keep one time by SYNC, in real time: nodes in processes whose
//! clocks drift, and played boards. A computer that does other things, too, holds them up now and then: nothing here
//! demands that nothing was late.
#![allow(clippy::unwrap_used, clippy::panic, reason = "helpers of tests, which clippy does not know as such")]

mod boards;

use boards::{Bench, Board, SCENARIO};
use funnelnet_node::Phase;
use serde_json::Value;

/// 380 ppm between two neighbours: in 20 s 7.6 ms, which is more than a tick.
const DRIFTS: [f64; 3] = [0.0, 190.0, -190.0];

/// None stops for neighbours that a busy computer is late with.
const BUSY: &str = "[safety]\nlost_neighbours = 3\n";

fn processes(drifts: &[f64], sync: &str, events: &str, duration: &str) -> Bench {
    let scenario = SCENARIO.replace(
        "tick = \"1ms\"\nduration = \"200ms\"",
        &format!("tick = \"5ms\"\nduration = \"{duration}\""),
    ) + BUSY
        + sync
        + events;
    assert!(scenario.contains("\"5ms\""));
    let entry = |drift: &f64| format!("host = true\ndrift_ppm = {drift:?}");
    Bench::new(&scenario, &drifts.iter().map(entry).collect::<Vec<_>>()).with("clock = \"own\"").patient()
}

fn own_clock(bench: &Bench) -> Value {
    bench.summary()["bench"]["own_clock"].clone()
}

/// The sum of a count over all nodes.
fn sum(clocks: &Value, count: &str) -> u64 {
    clocks["nodes"].as_array().unwrap().iter().map(|node| node[count].as_u64().unwrap()).sum()
}

#[test]
fn processes_with_drifting_clocks_keep_one_time_with_sync_and_go_stale_without() {
    let (with, without) = std::thread::scope(|scope| {
        let run = |sync: &'static str| {
            move || {
                let bench = processes(&DRIFTS, sync, "", "20s");
                let ended = bench.run(&[]);
                assert_eq!(ended.code, Some(0), "{}", ended.err);
                (own_clock(&bench), ended, bench.summary())
            }
        };
        let without = scope.spawn(run(""));
        let with = scope.spawn(run("[sync]\nmasters = [1]\n"));
        (with.join().unwrap(), without.join().unwrap())
    });
    let skew = |clocks: &Value| clocks["end_skew_s"].as_f64().unwrap();
    let (with, ended, summary) = with;
    let (without, ..) = without;
    // Three nodes that are read one after the other, and the way of a SYNC.
    assert!(skew(&with) < 0.003, "{with}");
    assert!(skew(&without) > 0.006, "{without}");
    assert!(sum(&without, "extrapolated") > 500, "{without}");
    assert!(5 * sum(&with, "extrapolated") < sum(&without, "extrapolated"), "{with}\n{without}");
    let frames = with["sync"]["frames"].as_u64().unwrap();
    assert!((180..=220).contains(&frames), "{with}");
    assert_eq!((&with["sync"]["masters"], &without["sync"]), (&1.into(), &Value::Null));
    assert!(ended.out.contains("SYNC, one time master, largest skew"), "{}", ended.out);
    assert_eq!(summary["bench"]["skipped"], serde_json::json!([]));
}

#[test]
fn a_process_that_is_killed_by_an_event_comes_back_and_learns_the_tick() {
    let events = "[[event]]\nat = \"2s\"\nkind = \"bounce\"\nnode = 3\nfor = \"1s\"\n\
                  [[event]]\nat = \"7s\"\nkind = \"sync-loss\"\nfor = \"1s\"\n";
    let bench = processes(&DRIFTS, "[sync]\nmasters = [1, 2]\n", events, "10s");
    let ended = bench.run(&["--every", "5ms"]);
    let summary = bench.summary();
    assert_eq!(
        (summary["ended_early"].as_str(), &summary["stopped"]),
        (None, &serde_json::json!([])),
        "{}",
        ended.err
    );
    assert_eq!(summary["bench"]["skipped"], serde_json::json!([]), "{}", ended.err);
    let clocks = own_clock(&bench);
    // Without SYNC the first of them would be 1.9 ms apart, and the last one 1.3 ms more since its restart.
    assert!(clocks["end_skew_s"].as_f64().unwrap() < 0.002, "{clocks}");
    // Ten SYNC a second of each master that leads and is not heard.
    let sync = &clocks["sync"];
    assert!(sync["kept"].as_u64().unwrap() >= 5, "{sync}");
    // While it is off it has no state, and at the end it has one again.
    let text = std::fs::read_to_string(bench.path("out/trajectory.csv")).unwrap();
    let rows: Vec<_> = text.lines().skip(1).collect();
    let x3 = |tick: usize| rows[tick].split(',').nth(3).unwrap().to_owned();
    assert_eq!(
        (x3(500).as_str(), x3(300).is_empty(), x3(1_900).is_empty()),
        ("", false, false),
        "{}",
        rows[500]
    );
}

#[test]
fn without_sync_events_that_take_nodes_off_are_skipped_with_the_reason() {
    let events = "[[event]]\nat = \"500ms\"\nkind = \"bounce\"\nnode = 3\nfor = \"100ms\"\n";
    let bench = processes(&[0.0; 3], "", events, "1s");
    let ended = bench.run(&[]);
    assert_eq!(ended.code, Some(0), "{}", ended.err);
    assert!(
        ended.err.contains("no node that ticks by its own clock is taken off or brought back without [sync]"),
        "{}",
        ended.err
    );
    assert_eq!(bench.summary()["bench"]["skipped"], serde_json::json!(["event.bounce"]));
}

#[test]
fn boards_behind_serial_lines_keep_one_time_and_stop_with_their_run() {
    let boards = [Board::good(1), Board::with_clock(2, 1.000_19), Board::with_clock(3, 0.999_81)];
    let bench = Bench::of(&boards.each_ref()).with("clock = \"own\"").patient();
    let path = bench.path("scenario.toml");
    let text =
        std::fs::read_to_string(&path).unwrap() + BUSY + "[sync]\nmasters = [1, 3]\nperiod = \"200ms\"\n";
    std::fs::write(path, text).unwrap();
    let ended = bench.run(&["--set", "time.tick=20ms", "--set", "time.duration=10s"]);
    assert_eq!(ended.code, Some(0), "{}", ended.err);
    let clocks = own_clock(&bench);
    assert!(clocks["sync"]["frames"].as_u64().unwrap() >= 50, "{clocks}");
    // Without SYNC 3.8 ms.
    assert!(clocks["end_skew_s"].as_f64().unwrap() < 0.002, "{clocks}");
    assert_eq!(boards.map(Board::end), [Some(Phase::Stopped); 3]);
}

#[test]
fn where_the_host_ticks_sync_of_masters_is_skipped_and_the_run_is_lockstep() {
    let scenario = SCENARIO.to_owned() + "[sync]\nmasters = [1]\n";
    let bench = Bench::new(&scenario, &vec!["host = true".to_owned(); 3]);
    let ended = bench.run(&[]);
    assert_eq!(ended.code, Some(0), "{}", ended.err);
    assert_eq!(bench.summary()["bench"]["bit_for_bit"], true);
    assert!(ended.err.contains("skipped: sync: the clocks of a bench are its own"), "{}", ended.err);
}

/// The firmware's image, whose clock is the computer's: it leads, follows, and learns the tick after a restart.
#[test]
#[ignore = "needs QEMU and the firmware image: ./ci.sh parity"]
fn emulated_boards_follow_a_time_master_and_one_that_restarts_learns_the_tick() {
    let events = "[[event]]\nat = \"3s\"\nkind = \"bounce\"\nnode = 3\nfor = \"1s\"\n";
    let scenario = SCENARIO
        .replace("tick = \"1ms\"\nduration = \"200ms\"", "tick = \"20ms\"\nduration = \"10s\"")
        .replace("[expect]\nfunnel_ratio = 1.0\n", "")
        + BUSY
        + "[sync]\nmasters = [1]\n"
        + events;
    let bench =
        Bench::new(&scenario, &vec!["emulator = true".to_owned(); 3]).with("clock = \"own\"").patient();
    let ended = bench.run(&[]);
    let summary = bench.summary();
    assert_eq!(summary["ended_early"], Value::Null, "{}", ended.err);
    assert_eq!(
        (&summary["stopped"], &summary["bench"]["skipped"]),
        (&serde_json::json!([]), &serde_json::json!([]))
    );
    let clocks = own_clock(&bench);
    assert!(clocks["sync"]["frames"].as_u64().unwrap() >= 90, "{clocks}");
    assert!(clocks["end_skew_s"].as_f64().unwrap() < 0.02, "{clocks}");
}
