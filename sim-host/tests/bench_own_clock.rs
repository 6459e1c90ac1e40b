//! Benches whose nodes tick by their own clock: played boards behind pseudo-terminals, and nodes in processes
//! of their own.
//!
//! Nothing here relies on the bits of loopback unless nothing was late: this is real time on a computer that
//! does other things, too.
#![allow(clippy::unwrap_used, clippy::panic, reason = "helpers of tests, which clippy does not know as such")]

mod boards;

use boards::{
    AT_ONCE, Act, Bench, Board, children, end, loopback_hash, orphaned, repository, second, three, wait,
};
use funnelnet_node::Phase;
use funnelnet_protocol::message::FaultCode;
use serde_json::Value;
use std::fs;
use std::process::Command;
use std::time::Duration;

/// A tick that a loaded computer keeps mostly; 51 of them.
const TICKS: [&str; 4] = ["--set", "time.tick=10ms", "--set", "time.duration=500ms"];
/// The same for hours, to be ended otherwise.
const ENDLESS: [&str; 4] = ["--set", "time.tick=10ms", "--set", "time.duration=10min"];

fn bench_of(boards: &[Board; 3]) -> Bench {
    Bench::of(&boards.each_ref()).with("clock = \"own\"")
}

fn number(value: &Value) -> f64 {
    value.as_f64().unwrap_or_else(|| panic!("{value}"))
}

/// The sum of a count over all nodes.
fn sum(bench: &Value, count: &str) -> u64 {
    bench["own_clock"]["nodes"].as_array().unwrap().iter().map(|node| node[count].as_u64().unwrap()).sum()
}

fn largest_deviation(bench: &Value) -> f64 {
    let nodes = bench["nodes"].as_array().unwrap();
    nodes.iter().map(|node| number(&node["largest_deviation"])).fold(0.0, f64::max)
}

/// The five agents on a ring as processes, for 2 s, with frames that arrive between two ticks.
fn five() -> Bench {
    let text = fs::read_to_string(repository().join("scenarios/five-agents.toml")).unwrap();
    let scenario = text
        .replace("tick = \"1ms\"\nduration = \"20s\"", "tick = \"10ms\"\nduration = \"2s\"")
        .replace("reference_error = 1e-3\n", "")
        + "\n[bus]\nlatency = \"5ms\"\n";
    assert!(scenario.contains("\"10ms\"") && !scenario.contains("reference_error"));
    Bench::new(&scenario, &vec!["host = true".to_owned(); 5]).with("clock = \"own\"")
}

#[test]
fn five_processes_run_the_scenario_in_real_time() {
    let bench = five();
    let ended = bench.run(&["--junit", bench.path("junit.xml").to_str().unwrap()]);
    assert_eq!(ended.code, Some(0), "{}", ended.err);
    // 200 ticks, after one for the announced states.
    assert!(ended.took > Duration::from_millis(2000), "{:?}", ended.took);
    let (summary, clocks) = (bench.summary(), &bench.summary()["bench"]["own_clock"]);
    assert!(number(&summary["funnel"]["max_ratio"]) < 1.0, "{summary}");
    assert_eq!(
        (&summary["expect"][0]["name"], &summary["expect"][0]["pass"]),
        (&"funnel_ratio".into(), &true.into())
    );
    assert!(fs::read_to_string(bench.path("junit.xml")).unwrap().contains("sim-host.bench"));
    assert_eq!(summary["stopped"], serde_json::json!([]));
    // Whoever was late has left out at most what it made up for.
    let (missed, overruns) = (clocks["missed"].as_u64().unwrap(), sum(&summary["bench"], "overruns"));
    assert!(missed <= 4 * overruns, "{missed} missed, {overruns} overruns");
    assert!(number(&clocks["start_spread_s"]) < number(&clocks["largest_skew_s"]) + 0.005, "{clocks}");
    let late = sum(&summary["bench"], "extrapolated") + sum(&summary["bench"], "late");
    // A state of a node that is ahead by the half of a tick comes before its receiver's last tick.
    let early = u64::from(number(&clocks["largest_skew_s"]) >= 0.005);
    assert_beside_loopback(&bench, missed + late + early);
}

/// The bits of loopback where nothing was late or early, and else near it: a late value is extrapolated by one tick,
/// over which a state here changes by 1 at most (10 ms, `|f| <= 100`), and the funnel, whose width is at
/// least 2, holds what comes of it.
fn assert_beside_loopback(bench: &Bench, untimely: u64) {
    let summary = bench.summary();
    assert!(largest_deviation(&summary["bench"]) < 1.0, "{summary}");
    if untimely == 0 {
        assert_eq!(summary["bench"]["bit_for_bit"], true, "{summary}");
        assert_eq!(summary["trace_hash"], loopback_hash(&bench.path("scenario.toml")));
    }
}

#[test]
fn a_process_that_is_killed_is_named_and_the_others_stop() {
    let bench = five();
    let child = bench.spawn(&["--set", "time.duration=10min"]);
    let third = || children(child.id()).get(2).copied();
    wait("five processes", || children(child.id()).len() == 5);
    // Past the start: commissioning of five takes less.
    std::thread::sleep(Duration::from_millis(700));
    assert!(Command::new("kill").args(["-KILL", &third().unwrap().to_string()]).status().unwrap().success());
    let ended = end(child);
    ended.fell_short(&[
        "the process of node 3 ended",
        "signal: 9",
        "stopped: 1, 2, 4, 5; told to stop, but did not confirm it: 3",
    ]);
    assert!(bench.ended_early().contains(" of 60001 ticks: the process of node 3 ended"));
    assert!(ended.took < AT_ONCE, "{:?}", ended.took);
}

#[test]
fn boards_are_started_recorded_and_stopped() {
    let boards = three();
    let bench = bench_of(&boards);
    let ended = bench.run(&TICKS);
    assert_eq!(ended.code, Some(0), "{}", ended.err);
    assert!(
        ended.out.contains("largest skew") && ended.out.contains("node-ticks not recorded"),
        "{}",
        ended.out
    );
    let summary = bench.summary();
    assert!(largest_deviation(&summary["bench"]) < 0.1, "{summary}");
    assert_stamps(&fs::read_to_string(bench.path("out/bench.csv")).unwrap(), &summary["bench"]);
    assert_eq!(boards.map(Board::end), [Some(Phase::Stopped); 3]);
}

/// A row per node and tick, with the time at which the node said what the tick came to: tick `k` runs `k + 1`
/// periods after the start.
fn assert_stamps(text: &str, bench: &Value) {
    let mut lines = text.lines();
    assert_eq!(lines.next(), Some("tick,node,sync_s,state_s,telemetry_s,bus_s"));
    let (mut rows, mut late) = (0, 0);
    for line in lines {
        let fields: Vec<_> = line.split(',').collect();
        let [tick, _, "", state, telemetry, ""] = fields[..] else { panic!("{line}") };
        let due = (tick.parse::<f64>().unwrap() + 1.0) * 0.010;
        let time = |field: &str| field.parse::<f64>().ok();
        rows += 1;
        assert!(time(state).is_none_or(|at| at > due - 0.001), "{line}");
        late += u64::from(time(state).is_none() || time(telemetry).is_none());
    }
    assert_eq!(rows, 51 * 3);
    assert!(late <= 2 * sum(bench, "missed"), "{late} rows with a gap: {bench}");
}

#[test]
fn what_is_lost_on_a_line_is_counted_and_ends_no_run() {
    // Its 20th state and what else is on the line with it.
    let script = |n| if n == 20 { Act::Noise(vec![0xA5; 60]) } else { Act::Send };
    let boards = [Board::good(1), Board::start(2, Box::new(script)), Board::good(3)];
    let bench = bench_of(&boards);
    // Nodes lose neighbours that they do not hear for ten ticks, and a busy machine may let all wait for a tenth of a second.
    let ticks = ["--set", "time.tick=25ms", "--set", "time.duration=1250ms", "--every", "25ms"];
    let ended = bench.run(&ticks);
    assert_eq!(ended.code, Some(0), "{}", ended.err);
    let summary = bench.summary();
    let nodes = &summary["bench"]["own_clock"]["nodes"];
    assert_eq!((&summary["bench"]["nodes"][1]["unreadable"], &nodes[1]["node"]), (&1.into(), &2.into()));
    let missed = nodes[1]["missed"].as_u64().unwrap();
    assert!(missed > 0 && missed <= 1 + 4 * sum(&summary["bench"], "overruns"), "{nodes}");
    // The state of tick 20 is not known.
    let text = fs::read_to_string(bench.path("out/trajectory.csv")).unwrap();
    let x2 = |tick: usize| text.lines().nth(tick + 1).unwrap().split(',').nth(2).unwrap();
    assert_eq!((x2(20), x2(19).is_empty()), ("", false));
    let unrecorded = summary["bench"]["unrecorded"].as_u64().unwrap();
    assert!(unrecorded >= missed && summary["bench"]["bit_for_bit"] == false, "{summary}");
    assert_eq!(boards.map(Board::end), [Some(Phase::Stopped); 3]);
}

#[test]
fn a_board_that_falls_silent_is_named_with_its_last_tick() {
    let boards = second(|| Act::Hang);
    let ended = bench_of(&boards).run(&ENDLESS);
    // It hangs before its 51st state, that of tick 50, which is what tick 49 would have come to.
    ended.fell_short(&["node 2 has said nothing for 1.01 s; its last tick was 48", "stopped: 1, 3;"]);
    assert!(ended.took < 2 * AT_ONCE, "{:?}", ended.took);
    let [first, _, third] = boards.map(Board::end);
    // They lost their only neighbour before the patience with it was over.
    assert_eq!(first, Some(Phase::Faulted(FaultCode::NEIGHBOURS_LOST)));
    assert_eq!(third, first);
}

#[test]
fn an_unplugged_board_is_named_at_once() {
    let boards = second(|| Act::Vanish);
    let bench = bench_of(&boards);
    let ended = bench.run(&ENDLESS);
    let place = format!("the serial port {} of node 2 ended", boards[1].path);
    ended.fell_short(&[&place, "stopped: 1, 3; told to stop, but did not confirm it: 2"]);
    assert!(ended.took < AT_ONCE, "{:?}", ended.took);
    assert!(bench.ended_early().starts_with("after 49 of 60001 ticks"));
    let [first, _, third] = boards.map(Board::end);
    assert_eq!([first, third], [Some(Phase::Stopped); 2]);
}

#[test]
fn a_clock_that_runs_away_is_named() {
    for rate in [1.2, 0.8] {
        let boards = [Board::good(1), Board::good(2), Board::with_clock(3, rate)];
        let ended = bench_of(&boards).run(&ENDLESS);
        ended.fell_short(&[
            "node 3 runs apart from the others: its newest state is of tick",
            "that of node 2 of tick",
        ]);
        assert!(ended.err.contains("all nodes confirmed that they stopped"), "{}", ended.err);
        // The odd one may have lost its only neighbour just before.
        let [first, second, _] = boards.map(Board::end);
        assert_eq!([first, second], [Some(Phase::Stopped); 2]);
    }
}

#[test]
fn ctrl_c_stops_every_node() {
    let boards = three();
    let bench = bench_of(&boards);
    let child = bench.spawn(&ENDLESS);
    boards.iter().for_each(Board::wait_until_running);
    assert!(Command::new("kill").args(["-INT", &child.id().to_string()]).status().unwrap().success());
    let ended = end(child);
    ended.failed(130, &["interrupted after ", " of 60001 ticks; ", "all nodes confirmed that they stopped"]);
    assert!(bench.ended_early().ends_with(": interrupted"));
    // 60,000 ticks of crystals that nobody synchronises.
    assert!(
        ended
            .err
            .contains("may be two ticks apart, which ends the run, after 20000 ticks (200 s); it has 60000")
    );
    assert!(ended.took < AT_ONCE, "{:?}", ended.took);
    assert_eq!(boards.map(Board::end), [Some(Phase::Stopped); 3]);
}

#[test]
fn ctrl_c_is_heard_between_two_ticks() {
    let boards = three();
    let bench = bench_of(&boards);
    let child = bench.spawn(&["--set", "time.tick=4s", "--set", "time.duration=400s"]);
    wait("announcements", || boards.iter().all(Board::has_started));
    assert!(Command::new("kill").args(["-INT", &child.id().to_string()]).status().unwrap().success());
    let ended = end(child);
    ended.failed(130, &["all nodes confirmed that they stopped"]);
    assert!(ended.took < AT_ONCE, "{:?}", ended.took);
}

#[test]
fn boards_whose_host_program_dies_stop_for_want_of_neighbours() {
    let boards = three();
    let bench = bench_of(&boards);
    let running = || boards.iter().for_each(Board::wait_until_running);
    let faults = orphaned(&bench, &boards[1].path, running, &["--set", "time.tick=40ms"]);
    let [(FaultCode::NEIGHBOURS_LOST, after)] = faults[..] else { panic!("{faults:?}") };
    // Ten ticks of extrapolation; a busy machine may have let the boards wait for a tenth of a second before.
    assert!(after > Duration::from_millis(280) && after < Duration::from_secs(1), "{after:?}");
    assert_eq!(boards.map(Board::end), [Some(Phase::Faulted(FaultCode::NEIGHBOURS_LOST)); 3]);
}

#[test]
fn nodes_that_stop_by_themselves_are_told_of_and_the_run_ends() {
    let boards = three();
    let bench = bench_of(&boards);
    // Nobody is waited for who has told all he had to tell.
    let path = bench.path("bench.toml");
    let patient = fs::read_to_string(&path).unwrap().replace("\"1s\"", "\"10s\"");
    fs::write(path, patient).unwrap();
    // What neighbours see of a state is off by more than the funnel is wide.
    let breach = ["--set", "coupling.on_breach=stop", "--set", "agent.noise=200"];
    let ended = bench.run(&[&TICKS[..], &breach].concat());
    assert_eq!(ended.code, Some(1), "{}", ended.err);
    let summary = bench.summary();
    assert_eq!(summary["stopped"], serde_json::json!([1, 2, 3]), "{}", ended.err);
    // What they have heard was off, and no state was.
    assert!(number(&summary["funnel"]["believed"]["max_ratio"]) > 1.0, "{summary}");
    assert!(number(&summary["funnel"]["max_ratio"]) < 1.0, "{summary}");
    assert_eq!(sum(&summary["bench"], "missed"), 0, "{summary}");
    assert!(ended.took < AT_ONCE, "{:?}", ended.took);
}
