//! Benches with nodes that lie, babble, hear nobody or are not heard: played boards whose verdict must not be
//! green.
//!
//! Each test makes a world in which the figures alone look like those of a good run.
#![allow(clippy::unwrap_used, clippy::panic, reason = "helpers of tests, which clippy does not know as such")]

mod boards;

use boards::{AT_ONCE, Act, Bench, Board, Ended, SCENARIO, Says, end, entry, second, wait};
use funnelnet_protocol::message::{Component, FaultCode, Message, NodeId, Severity, TickStamp};
use funnelnet_protocol::report::{Report, Telemetry};
use funnelnet_protocol::serial;
use funnelnet_protocol::service::Reply;
use std::fs;
use std::process::Command;

/// The same scenario at a tick that a loaded computer keeps mostly, by clocks of its own; 51 ticks.
const OWN: [&str; 4] = ["--set", "time.tick=10ms", "--set", "time.duration=500ms"];

/// A bench whose second node says what `lie` makes of it.
fn bench(lie: impl FnMut(Says) -> Vec<Says> + Send + 'static) -> (Bench, [Board; 3]) {
    let boards = [Board::good(1), Board::lying(2, lie), Board::good(3)];
    (Bench::of(&boards.each_ref()), boards)
}

/// What a run of it says on standard error, which has to be a failure with `words`.
fn caught(lie: impl FnMut(Says) -> Vec<Says> + Send + 'static, words: &[&str]) -> serde_json::Value {
    let (bench, _boards) = bench(lie);
    bench.run(&[]).fell_short(words);
    bench.summary()
}

/// Changes telemetry of `ticks`.
fn telemetry(
    ticks: std::ops::Range<u32>,
    mut change: impl FnMut(&mut Telemetry) + Send + 'static,
) -> impl FnMut(Says) -> Vec<Says> + Send + 'static {
    move |said| match said {
        Says::Reply(id, Reply::Telemetry(mut told)) if ticks.contains(&told.tick) => {
            change(&mut told);
            vec![Says::Reply(id, Reply::Telemetry(told))]
        }
        said => vec![said],
    }
}

/// Changes the closing report.
fn report(
    mut change: impl FnMut(&mut Report) + Send + 'static,
) -> impl FnMut(Says) -> Vec<Says> + Send + 'static {
    move |said| match said {
        Says::Reply(id, Reply::Report(mut told)) => {
            change(&mut told);
            vec![Says::Reply(id, Reply::Report(told))]
        }
        said => vec![said],
    }
}

/// Says more before the state of tick `at`.
fn before_state(at: u32, more: Vec<Says>) -> impl FnMut(Says) -> Vec<Says> + Send + 'static {
    move |said| match said {
        Says::Message(Message::State { tick, .. }) if tick.value() == at => {
            [more.clone(), vec![said]].concat()
        }
        said => vec![said],
    }
}

fn id(id: u8) -> NodeId {
    NodeId::new(id).unwrap()
}

fn state(source: u8, tick: u32, x: f32) -> Says {
    Says::Message(Message::State {
        source: id(source),
        component: Component::FIRST,
        tick: TickStamp::full(tick),
        x,
    })
}

fn warning(tick: u32) -> Message {
    let (code, severity) = (FaultCode::BUS_OFF, Severity::Warning);
    Message::Fault { source: id(2), code, severity, arg: 1, tick: TickStamp::full(tick) }
}

#[test]
fn a_node_with_another_funnel_than_the_scenarios_is_named() {
    let wide = caught(
        telemetry(0..1000, |told| told.psi *= 1000.0),
        &[
            "failed: consistent: ",
            "node 2 runs in another funnel than the scenario's: 40000 at tick 0, where it is 40",
        ],
    );
    assert_eq!(wide["bench"]["nodes"][1]["first_difference"], 0);
    // From some tick on, and by a little.
    caught(
        telemetry(100..1000, |told| told.psi *= 1.01),
        &["node 2 runs in another funnel than the scenario's: ", " at tick 100, where it is "],
    );
    caught(
        telemetry(100..1000, |told| told.psi *= 0.5),
        &["node 2 runs in another funnel than the scenario's: "],
    );
}

#[test]
fn a_node_that_floors_or_reopens_its_funnel_unasked_is_named() {
    caught(
        report(|told| told.counters.floored = 5),
        &["failed: floor: node 2 has floored its funnel at 5 ticks"],
    );
    // Reopened, as it says: no scenario has asked for it.
    let mut wide = telemetry(100..1000, |told| told.psi *= 3.0);
    let mut told = report(|told| told.counters.reopened = 1);
    let lie = move |said| wide(said).into_iter().flat_map(&mut told).collect();
    caught(
        lie,
        &[
            "failed: consistent: ",
            "node 2 reports that it has reopened its funnel 1 times, which nobody has asked for",
        ],
    );
}

#[test]
fn telemetry_that_is_no_measurement_is_refused_counted_and_named() {
    type Change = fn(&mut Telemetry);
    let cases: [(Change, &str); 5] = [
        (|told| told.nu = f32::NAN, "nu = NaN"),
        (|told| told.psi = f32::INFINITY, "psi = inf"),
        (|told| told.psi = 0.0, "psi = 0"),
        (|told| told.psi = -told.psi, "psi = -"),
        (|told| told.u = f32::NEG_INFINITY, "u = -inf"),
    ];
    for (change, value) in cases {
        let words = format!("node 2 sent telemetry that is no measurement: {value}");
        let summary =
            caught(telemetry(50..53, change), &["failed: consistent: ", &words, " at tick 50, 3 times"]);
        // Refused, and nothing stands in its place.
        assert_eq!(
            (&summary["bench"]["unrecorded"], &summary["bench"]["bit_for_bit"]),
            (&3.into(), &false.into())
        );
        assert_eq!(summary["bench"]["nodes"][1]["first_difference"], 50);
        assert!(summary["funnel"]["believed"]["max_ratio"].as_f64().unwrap() < 1.0, "{summary}");
        assert_eq!(
            (&summary["funnel"]["breaches"], &summary["funnel"]["believed"]["breaches"]),
            (&0.into(), &0.into())
        );
    }
}

#[test]
fn telemetry_of_another_component_is_refused_and_the_right_one_is_taken() {
    let lie = |said: Says| match &said {
        Says::Reply(id, Reply::Telemetry(told)) if told.tick == 50 => {
            let wrong = Telemetry { component: 3, nu: 1e9, ..*told };
            vec![Says::Reply(*id, Reply::Telemetry(wrong)), said]
        }
        _ => vec![said],
    };
    let words = "node 2 spoke of a component that its state does not have: telemetry of 3 at tick 50";
    let summary = caught(lie, &["failed: consistent: ", words]);
    assert_eq!(
        (&summary["bench"]["unrecorded"], &summary["bench"]["bit_for_bit"]),
        (&0.into(), &true.into())
    );
}

#[test]
fn a_state_that_is_not_a_number_is_refused_and_named() {
    let lie = |said: Says| match said {
        Says::Message(Message::State { source, component, tick, .. }) if tick.value() == 50 => {
            vec![Says::Message(Message::State { source, component, tick, x: f32::NAN })]
        }
        said => vec![said],
    };
    let words = [
        "node 2 ran tick 49, but its state did not arrive",
        "node 2 sent what is not a number: a state or a weight at tick 49",
    ];
    let summary = caught(lie, &words);
    assert!(summary["ended_early"].as_str().unwrap().starts_with("after 49 of 201 ticks: "), "{summary}");
}

#[test]
fn a_report_that_contradicts_the_run_fails_it_beside_the_bits_of_loopback() {
    type Change = fn(&mut Report);
    let cases: [(Change, &str); 7] = [
        (|told| told.counters.breaches = 4321, "node 2 reports 4321 breaches, and was seen to have 0"),
        (
            |told| told.max_ratio = 0.99,
            "node 2 reports a largest |nu| / psi of 0.99, and was seen to have 0.2",
        ),
        (
            |told| told.max_ratio = 0.01,
            "node 2 reports a largest |nu| / psi of 0.01, and was seen to have 0.2",
        ),
        (|told| told.max_ratio = f32::NAN, "node 2 reports a largest |nu| / psi of NaN"),
        (|told| told.counters.ticks = 150, "node 2 reports 150 ticks, and was seen to run 201"),
        (|told| told.counters.sync_gaps = 3, "node 2 reports 3 SYNC gaps, and was seen to run every tick"),
        (|told| told.counters.overruns = 4, "node 2 reports 4 overruns, and was told when to tick"),
    ];
    for (change, words) in cases {
        let summary = caught(report(change), &["failed: consistent: ", words]);
        assert_eq!(summary["bench"]["bit_for_bit"], true);
    }
}

#[test]
fn warnings_are_counted_and_listed_and_stop_nobody() {
    let (bench, _boards) = bench(before_state(50, vec![Says::Message(warning(50))]));
    let ended = bench.run(&[]);
    assert_eq!(ended.code, Some(0), "{}", ended.err);
    let summary = bench.summary();
    assert_eq!(
        (&summary["counters"]["warnings"], &summary["bench"]["bit_for_bit"]),
        (&1.into(), &true.into())
    );
    let events = fs::read_to_string(bench.path("out/events.txt")).unwrap();
    assert_eq!(events, "0.049000 s, node 2 warns: its CAN controller went off the bus\n");
    assert!(ended.err.contains(events.trim_end()), "{}", ended.err);
}

#[test]
fn a_warning_after_a_stop_does_not_make_the_node_run_again() {
    // It stops at the end of a tick, so that its telemetry of it follows the warning.
    let stop = |said: Says| match said {
        Says::Message(Message::State { tick, .. }) if tick.value() == 50 => {
            let (source, code, severity) = (id(2), FaultCode::FUNNEL_LEFT, Severity::Stopped);
            let stopped = Message::Fault { source, code, severity, arg: 0, tick };
            vec![Says::Message(warning(50)), Says::Message(stopped), Says::Message(warning(51))]
        }
        said => vec![said],
    };
    let summary = caught(
        stop,
        &["failed: stopped: node 2 stopped by itself at 0.049 s: its diffusive term has left the funnel"],
    );
    assert_eq!(
        (&summary["stopped"], &summary["ended_early"]),
        (&serde_json::json!([2]), &serde_json::Value::Null)
    );
    assert_eq!(summary["bench"]["bit_for_bit"], false);
}

#[test]
fn a_weight_that_a_node_was_not_given_is_named_by_who_announces_it() {
    let lie = |said: Says| match said {
        Says::Message(Message::Edge { source, neighbour, .. }) if neighbour.get() == 1 => {
            vec![Says::Message(Message::Edge { source, neighbour, weight: 5.0 })]
        }
        said => vec![said],
    };
    let words =
        "node 2 announced another weight than it was given: 5 for the edge to node 1, which has 1 at tick ";
    caught(lie, &["failed: consistent: ", words, "node 1 was announced other weights 1 times"]);
}

#[test]
fn what_a_node_says_as_another_one_is_refused_and_named() {
    let edge = Message::Edge { source: id(1), neighbour: id(2), weight: 7.0 };
    let more = vec![state(3, 50, 1.0), state(1, 50, 1.0), Says::Message(edge)];
    let summary = caught(
        before_state(50, more),
        &["failed: consistent: ", "node 2 spoke as another node: a state of node 3 at tick 49, 3 times"],
    );
    // Nobody has heard it.
    assert_eq!(summary["bench"]["bit_for_bit"], true, "{summary}");
    // Its own telemetry by another id is none of its own.
    let lie = |said: Says| match said {
        Says::Reply(_, Reply::Telemetry(told)) if told.tick == 50 => {
            vec![Says::Reply(7, Reply::Telemetry(told))]
        }
        said => vec![said],
    };
    caught(lie, &["no telemetry within 1 s", "node 2 spoke as another node: telemetry of node 7"]);
}

#[test]
fn a_state_of_another_tick_is_refused_and_named() {
    let summary = caught(
        before_state(50, vec![state(2, 77, 1.0)]),
        &[
            "failed: consistent: ",
            "node 2 sent a state of another tick: the stamp 77 where 50 was awaited at tick 49",
        ],
    );
    assert_eq!(summary["bench"]["bit_for_bit"], true, "{summary}");
    let summary = caught(
        before_state(50, vec![state(2, 50, 1.0)]),
        &["failed: consistent: ", "node 2 sent two states of one tick: 1 and "],
    );
    assert_eq!(summary["bench"]["bit_for_bit"], false);
    let late = telemetry(50..51, |told| told.tick = 49);
    caught(late, &["node 2 ran tick 49 when it was asked for tick 50", "after 50 of 201 ticks"]);
}

#[test]
fn a_node_that_babbles_has_one_deadline_for_a_tick() {
    let edge = Message::Edge { source: id(2), neighbour: id(1), weight: 1.0 };
    let words = serial::encode(&edge).to_vec();
    let boards = second(move || Act::Babble(words.clone()));
    let bench = Bench::of(&boards.each_ref());
    let ended = bench.run(&[]);
    ended.fell_short(&["node 2 goes on speaking, but said no state of tick 49 within 1 s", "stopped: 1, 3;"]);
    assert!(ended.took < 2 * AT_ONCE, "{:?}", ended.took);
    assert!(bench.ended_early().starts_with("after 49 of 201 ticks"));
}

#[test]
fn a_node_that_babbles_by_its_own_clock_is_named() {
    let words = serial::encode(&warning(50)).to_vec();
    let boards = second(move || Act::Babble(words.clone()));
    let bench = Bench::of(&boards.each_ref()).with("clock = \"own\"");
    let ended = bench.run(&["--set", "time.tick=10ms", "--set", "time.duration=10min"]);
    ended.fell_short(&["node 2 goes on speaking, but said no telemetry of tick 49 within 1.01 s"]);
    assert!(ended.took < 2 * AT_ONCE, "{:?}", ended.took);
    // One and the same, however often it is said.
    assert_eq!(bench.summary()["counters"]["warnings"], 1);
}

#[test]
fn a_node_that_is_lost_at_its_first_tick_was_never_there() {
    let boards = [
        Board::good(1),
        Board::start(2, Box::new(|n| if n == 1 { Act::Vanish } else { Act::Send })),
        Board::good(3),
    ];
    let bench = Bench::of(&boards.each_ref()).with("on_loss = \"go-on\"");
    // At rest all of them: what is gone sends what it would have sent.
    let scenario = fs::read_to_string(bench.path("scenario.toml")).unwrap();
    let rest = scenario.replace("state = 3.5", "state = 0.0").replace("state = -2.5", "state = 0.0");
    fs::write(bench.path("scenario.toml"), rest.replace("amplitude = 10.0", "amplitude = 0.0")).unwrap();
    let ended = bench.run(&[]);
    ended.fell_short(&["failed: absent: node 2 was away from tick 0 to the end"]);
    assert!(!ended.out.contains("bit for bit"), "{}", ended.out);
    let summary = bench.summary();
    assert_eq!(
        (&summary["bench"]["unrecorded"], &summary["bench"]["bit_for_bit"]),
        (&201.into(), &false.into())
    );
    // Both terms of the others have its state in them.
    assert_eq!(summary["funnel"]["unknown"], 3 * 201);
}

#[test]
fn honest_nodes_that_stop_as_the_scenario_allows_contradict_nothing() {
    let boards = boards::three();
    let bench = Bench::of(&boards.each_ref());
    // Who stops says so, and is dropped: the last one goes its own way from there on, far from those that
    // stand still.
    let sets = ["coupling.on_breach=stop", "agent.noise=20", "expect.funnel_ratio=100", "expect.stopped=any"];
    let ended = bench.run(&sets.iter().flat_map(|set| ["--set", set]).collect::<Vec<_>>());
    assert_eq!(ended.code, Some(0), "{}", ended.err);
    let summary = bench.summary();
    assert!(!summary["stopped"].as_array().unwrap().is_empty(), "{summary}");
    // They stop in loopback too, at the same ticks.
    assert_eq!(
        (&summary["bench"]["bit_for_bit"], &summary["bench"]["unrecorded"]),
        (&true.into(), &0.into())
    );
    drop(boards);
    let boards = boards::three();
    let bench = Bench::of(&boards.each_ref());
    let ended = bench.run(&sets[..3].iter().flat_map(|set| ["--set", set]).collect::<Vec<_>>());
    ended.fell_short(&["failed: stopped: node "]);
    assert_eq!(bench.failed_checks(), ["stopped"]);
}

#[test]
fn nodes_that_nobody_hears_are_named() {
    let boards = boards::three();
    let bench = Bench::of(&boards.each_ref());
    let never = |id| format!("no neighbour has ever heard node {id}");
    let words = [1, 2, 3].map(never);
    let ended = bench.run(&["--set", "bus.loss=1.0"]);
    ended.fell_short(&words.each_ref().map(String::as_str));
    assert_eq!(bench.summary()["bench"]["bit_for_bit"], true, "loopback is as deaf");
}

#[test]
fn a_node_that_hears_nobody_leaves_its_neighbours_unheard() {
    let boards = [Board::good(1), Board::deaf(2), Board::good(3)];
    let bench = Bench::of(&boards.each_ref());
    let ended = bench.run(&[]);
    ended.fell_short(&[
        "failed: heard: no neighbour has ever heard node 1; no neighbour has ever heard node 3\n",
    ]);
}

/// A bench by clocks of its own whose second node says what `lie` makes of it.
fn by_its_own_clock(lie: impl FnMut(Says) -> Vec<Says> + Send + 'static) -> (Ended, serde_json::Value) {
    let (bench, _boards) = bench(lie);
    let bench = bench.with("clock = \"own\"");
    let ended = bench.run(&OWN);
    (ended, bench.summary())
}

#[test]
fn telemetry_that_is_no_measurement_is_refused_by_clocks_of_their_own_too() {
    let (ended, summary) = by_its_own_clock(telemetry(20..23, |told| told.nu = f32::NAN));
    ended.fell_short(&["node 2 sent telemetry that is no measurement: nu = NaN at tick 20, "]);
    let missed = summary["bench"]["own_clock"]["nodes"][1]["missed"].as_u64().unwrap();
    assert!(missed >= 3 && summary["ended_early"].is_null(), "{summary}");
    assert!(summary["bench"]["unrecorded"].as_u64() >= Some(missed), "{summary}");
}

#[test]
fn a_node_whose_states_never_come_is_named_though_it_tells_every_tick() {
    let mute = |said: Says| match said {
        Says::Message(Message::State { .. }) => vec![],
        said => vec![said],
    };
    let (ended, summary) = by_its_own_clock(mute);
    ended.fell_short(&["failed: heard: no neighbour has ever heard node 2"]);
    assert_eq!(summary["bench"]["nodes"][1]["unrecorded"], 51, "{summary}");
}

#[test]
fn a_state_of_a_tick_that_is_nowhere_near_is_named_by_clocks_of_their_own_too() {
    let (ended, summary) = by_its_own_clock(before_state(20, vec![state(2, 5020, 1.0)]));
    ended.fell_short(&["node 2 sent a state of another tick: the stamp 5020 after tick "]);
    assert!(summary["ended_early"].is_null(), "{summary}");
}

#[test]
fn a_node_that_falls_mute_is_lost_by_its_neighbours_at_the_end() {
    let mute = |said: Says| match said {
        Says::Message(Message::State { tick, .. }) if tick.value() > 20 => vec![],
        said => vec![said],
    };
    let (bench, _boards) = bench(mute);
    let bench = bench.with("clock = \"own\"");
    // Its neighbours do not stop for it.
    let ended = bench.run(&[&OWN[..], &["--set", "safety.lost_neighbours=2"]].concat());
    ended.fell_short(&["failed: heard: all neighbours of node 2 have lost it at the end"]);
    assert_eq!(bench.failed_checks()[0], "heard", "{}", ended.err);
}

#[test]
fn what_a_clock_of_its_own_cannot_have_counted_is_named() {
    let (ended, _) = by_its_own_clock(report(|told| told.counters.breaches = 4321));
    ended.fell_short(&["node 2 reports 4321 breaches, and was seen to have 0"]);
    let (ended, _) = by_its_own_clock(report(|told| told.counters.ticks = 3));
    ended.fell_short(&["node 2 reports 3 ticks, and was seen to run "]);
}

#[test]
fn what_was_recorded_until_the_user_stops_a_run_is_written_and_marked() {
    let boards = boards::three();
    let entries: Vec<_> = boards.iter().map(|board| entry(&board.path)).collect();
    let bench = Bench::new(SCENARIO, &entries);
    let (json, junit) = (bench.path("run.json"), bench.path("junit.xml"));
    let outputs = ["--json", json.to_str().unwrap(), "--junit", junit.to_str().unwrap()];
    let child = bench.spawn(&[&outputs[..], &["--set", "time.duration=10min", "--every", "1ms"]].concat());
    boards.iter().for_each(Board::wait_until_running);
    wait("some ticks", || boards.iter().all(Board::has_started));
    assert!(Command::new("kill").args(["-INT", &child.id().to_string()]).status().unwrap().success());
    end(child).failed(130, &["interrupted after ", "all nodes confirmed that they stopped"]);
    let why = bench.ended_early();
    let recorded: usize = why.split(' ').nth(1).unwrap().parse().unwrap();
    let rows = fs::read_to_string(bench.path("out/trajectory.csv")).unwrap().lines().count() - 1;
    assert!(recorded > 0 && rows == recorded, "{rows} rows: {why}");
    assert!(fs::read_to_string(junit).unwrap().contains("complete"));
    assert!(fs::read_to_string(json).unwrap().contains("\"ended_early\": \"after "));
}

#[test]
fn a_line_that_doubles_frames_is_named_and_every_tick_is_recorded() {
    let words = ["failed: consistent: node 2 has a line that doubles frames: a state at tick 0, "];
    let summary = caught(|said| vec![said.clone(), said], &words);
    assert_eq!(
        (&summary["bench"]["unrecorded"], &summary["bench"]["bit_for_bit"]),
        (&0.into(), &true.into())
    );
    assert!(summary["ended_early"].is_null(), "{summary}");
    let failed = summary["checks"].as_array().unwrap().iter().filter(|check| check["pass"] == false);
    assert_eq!(failed.map(|check| check["name"].as_str().unwrap()).collect::<Vec<_>>(), ["consistent"]);
}

#[test]
fn a_line_that_doubles_frames_of_a_clock_of_its_own_is_named_too() {
    let (ended, summary) = by_its_own_clock(|said| vec![said.clone(), said]);
    ended.fell_short(&["node 2 has a line that doubles frames: "]);
    assert!(summary["ended_early"].is_null(), "{summary}");
}
