//! What check says.

use std::path::Path;

use super::*;
use crate::emergent::EmergentTrajectory;
use crate::scenario::{Gain, Override};
use funnelnet_law::floor::Floor;
use funnelnet_law::math;
use serde_json::json;

fn scenario(file: &str, sets: &[&str]) -> Scenario {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../scenarios").join(file);
    let overrides: Vec<_> = sets.iter().map(|set| Override::parse(set).unwrap()).collect();
    Scenario::load(&path, &overrides).unwrap()
}

fn load(file: &str, sets: &[&str]) -> Report {
    check(&scenario(file, sets))
}

/// Two nodes whose fields swing against each other: `10 sin(5 t)` and `-10 sin(5 t)`.
const PAIR: &str = r#"
version = 1
time = { tick = "1ms", duration = "10s" }
graph = { kind = "path", nodes = 2 }
[coupling]
kind = "node-wise"
gain = { kind = "reciprocal", scale = 1.0 }
funnel = { kind = "constant", width = 1.0 }
[[node]]
id = 1
dynamics = { kind = "affine", sines = [{ amplitude = 10.0, frequency = 5.0 }] }
[[node]]
id = 2
dynamics = { kind = "affine", sines = [{ amplitude = -10.0, frequency = 5.0 }] }
"#;

fn pair(sets: &[&str]) -> Report {
    let overrides: Vec<_> = sets.iter().map(|set| Override::parse(set).unwrap()).collect();
    check(&Scenario::parse(PAIR, Path::new("pair.toml"), &overrides).unwrap())
}

fn find<'r>(report: &'r Report, name: &str) -> &'r Finding {
    report.findings.iter().find(|finding| finding.name == name).unwrap()
}

/// A figure of a finding.
fn value(report: &Report, name: &str, key: &str) -> f64 {
    let found = find(report, name);
    found.values[key].as_f64().unwrap_or_else(|| panic!("{key} of {found:?}"))
}

#[track_caller]
fn near(found: f64, expected: f64, relative: f64) {
    assert!((found - expected).abs() <= relative * expected.abs(), "{found} is not {expected}");
}

/// The pair moves by 10 per second.
#[test]
fn limits_of_what_is_heard_are_held_against_what_honest_nodes_say() {
    assert!(pair(&[]).findings.iter().all(|finding| finding.name != "heard"));
    let status = |sets: &[&str]| find(&pair(sets), "heard").status;
    let report = pair(&["safety.heard_rate=30"]);
    let rate = value(&report, "heard", "rate");
    assert!((1.0..20.0).contains(&rate), "{rate}");
    let text = &find(&report, "heard").text;
    assert!(
        text.contains("A jump of more than 0.03 is not, and one of more than 0.3 drops the edge"),
        "{text}"
    );
    assert_eq!(find(&report, "heard").status, Status::Ok);
    let below = format!("safety.heard_rate={}", 0.9 * rate);
    let report = pair(&[&below]);
    let found = find(&report, "heard");
    assert_eq!(found.status, Status::Warn);
    let advised = found.advice.as_ref().unwrap().settings().next().unwrap();
    assert_eq!(status(&[&format!("{}={}", advised.key, advised.value)]), Status::Ok);
    // Two states in a row differ by the noise of both.
    assert_eq!(status(&["safety.heard_rate=30", "agent.noise=0.01"]), Status::Warn);
    assert_eq!(status(&["safety.heard_limit=50"]), Status::Ok);
    // Where something disturbs, inputs reach twelve times the undisturbed ones.
    assert_eq!(status(&["safety.heard_rate=30", "bus.loss=0.01"]), Status::Warn);
    let u_max = ["safety.heard_rate=30", "bus.loss=0.01", "coupling.u_max=20"];
    assert_eq!(status(&u_max), Status::Ok);
    // Fields do up to 10 beside that.
    let sets = ["safety.heard_rate=29", "bus.loss=0.01", "coupling.u_max=20"];
    let report = pair(&sets);
    let advice = &find(&report, "heard").advice.as_ref().unwrap().text;
    assert!(advice.contains("coupling.u_max be below 19") && advice.contains("more than 30"), "{advice}");
    assert_eq!(status(&["safety.heard_rate=9", "bus.loss=0.01", "coupling.u_max=1"]), Status::Warn);
    assert_eq!(status(&["safety.heard_rate=30", "coupling.kind=edge-wise"]), Status::NotChecked);
}

/// A setting that is advised cures what it is advised for.
#[track_caller]
fn is_cured_by_its_advice(sets: &[&str], name: &str) {
    let advised = find(&pair(sets), name).advice.clone().unwrap();
    let cure: Vec<_> = advised.settings().map(|set| format!("{}={}", set.key, set.value)).collect();
    assert!(!cure.is_empty(), "{advised:?}");
    let sets: Vec<_> = sets.iter().copied().chain(cure.iter().map(String::as_str)).collect();
    // There may be nothing left to be said.
    let report = pair(&sets);
    let left = report.findings.iter().find(|finding| finding.name == name);
    assert!(left.is_none_or(|left| left.status == Status::Ok), "{cure:?}: {left:?}");
}

/// Two nodes, so that each has one neighbour: 11 ticks of silence have a probability of `p^11 (1 - p)` per tick and node.
#[test]
fn lost_frames_are_held_against_neighbours_that_may_be_silent() {
    const KEY: &str = "lost-neighbours";
    let has = |sets: &[&str]| pair(sets).findings.iter().any(|finding| finding.name == KEY);
    assert!(!has(&["safety.lost_neighbours=1"]) && !has(&["bus.loss=0.5"]));
    let report = pair(&["safety.lost_neighbours=1", "bus.loss=0.3"]);
    near(value(&report, KEY, "share"), 2.0 * 10_000.0 * math::pow(0.3, 11.0) * 0.7, 0.02);
    let status = |sets: &[&str]| find(&pair(sets), KEY).status;
    assert_eq!(status(&["safety.lost_neighbours=1", "bus.loss=0.1"]), Status::Ok);
    assert_eq!(status(&["safety.lost_neighbours=1", "bus.loss=0.3"]), Status::Warn);
    assert_eq!(status(&["safety.lost_neighbours=1", "bus.loss=0.6"]), Status::Fail);
    // The share of all frames is small, and losses come in runs.
    let bursts = "bus.loss={ to_bad = 0.001, to_good = 0.1 }";
    assert_eq!(status(&["safety.lost_neighbours=1", bursts]), Status::Fail);
    // Frames that come after more than eight ticks are not taken, on a bus and on a link, and nothing is lost.
    assert_eq!(status(&["safety.lost_neighbours=1", "bus.latency=6ms", "bus.jitter=4ms"]), Status::Fail);
    let slow = "link=[{ from = 1, to = 2, latency = '12ms' }]";
    assert_eq!(status(&["safety.lost_neighbours=1", slow]), Status::Fail);
    assert_eq!(
        status(&["safety.lost_neighbours=1", "link=[{ from = 1, to = 2, loss = 1.0 }]"]),
        Status::Fail
    );
    // Nobody has two neighbours.
    assert_eq!(status(&["safety.lost_neighbours=2", bursts]), Status::Ok);
    // What is late is silent from earlier on.
    assert_eq!(status(&["safety.lost_neighbours=1", "bus.loss=0.1", "bus.latency=6ms"]), Status::Warn);
    // Links lose as well, on every bus.
    let link = "link=[{ from = 1, to = 2, loss = 0.3 }]";
    assert_eq!(status(&["safety.lost_neighbours=1", link]), Status::Warn);
    assert_eq!(status(&["safety.lost_neighbours=1", link, "bus.model=can"]), Status::Warn);
    let ring = ["graph={ kind = 'ring', nodes = 3 }", "agent.dynamics={ kind = 'affine' }"];
    is_cured_by_its_advice(&[ring[0], ring[1], "safety.lost_neighbours=1", "bus.loss=0.3"], KEY);
}

/// SYNC every 100 ms, and what a node does without.
#[test]
fn lost_frames_are_held_against_the_time_without_sync() {
    const KEY: &str = "lost-sync";
    let on_can = |sets: &[&'static str]| {
        let clocks = ["bus.model=can", "clock.drift_ppm=50", "sync={ period = '100ms', masters = [1] }"];
        clocks.into_iter().chain(sets.iter().copied()).collect::<Vec<_>>()
    };
    let has = |sets: &[&'static str]| pair(&on_can(sets)).findings.iter().any(|finding| finding.name == KEY);
    assert!(!has(&["bus.loss=0.1"]) && !has(&["safety.holdover=101ms"]));
    assert_eq!(find(&pair(&on_can(&["bus.loss=1.0"])), "bus").status, Status::Fail);
    let status = |sets: &[&'static str]| find(&pair(&on_can(sets)), KEY).status;
    // The next one always comes too late.
    assert_eq!(status(&["safety.holdover=100ms"]), Status::Fail);
    is_cured_by_its_advice(&on_can(&["safety.holdover=100ms"]), KEY);
    // It is on its way for a while, and clocks drift.
    assert_eq!(status(&["safety.holdover=100020us"]), Status::Warn);
    // Whole ticks: one comes every 98 ms, since the tick is 49 ms.
    let ticks = ["time.tick=49ms", "time.duration=9800ms", "safety.holdover=99ms"];
    assert!(!has(&ticks));
    // Here one comes each tick, and the third of them is the first that is taken.
    assert_eq!(status(&["time.tick=80ms", "time.duration=8s", "safety.holdover=130ms"]), Status::Fail);
    // One that is lost costs two: the next one cannot be taken.
    let report = pair(&on_can(&["safety.holdover=250ms", "bus.loss=0.001"]));
    let stops = 97.0 * 0.999 * 0.999 * 0.001;
    near(value(&report, KEY, "share"), 1.0 - math::exp(-stops), 1e-2);
    assert_eq!(status(&["safety.holdover=250ms", "bus.loss=0.001"]), Status::Warn);
    assert_eq!(status(&["safety.holdover=250ms", "bus.loss=0.1"]), Status::Fail);
    is_cured_by_its_advice(&on_can(&["safety.holdover=250ms", "bus.loss=0.1"]), KEY);
}

/// Two clocks that differ by 100 ppm on a bus whose frames take 0.1 ms at most.
#[test]
fn clocks_come_apart_and_what_breaks_then_is_said() {
    const KEY: &str = "clocks";
    let apart =
        ["bus.model=can", "node.1.clock.drift_ppm=50", "node.2.clock.drift_ppm=-50", "time.duration=100s"];
    let with =
        |sets: &[&'static str]| pair(&apart.iter().copied().chain(sets.iter().copied()).collect::<Vec<_>>());
    assert!(pair(&["bus.model=can"]).findings.iter().all(|finding| finding.name != KEY));
    let report = with(&[]);
    assert_eq!(find(&report, KEY).status, Status::Fail);
    near(value(&report, KEY, "skew_s"), 10e-3, 1e-2);
    near(value(&report, KEY, "late_from_s"), 9.0, 2e-2);
    near(value(&report, KEY, "deaf_from_s"), 21.0, 1e-2);
    assert_eq!(find(&with(&["time.duration=15s"]), KEY).status, Status::Warn);
    assert_eq!(find(&with(&["time.duration=5s"]), KEY).status, Status::Ok);
    let kept = |sets: &[&'static str]| {
        let sync = ["sync={ period = '100ms', masters = [1] }"];
        with(&sync.iter().copied().chain(sets.iter().copied()).collect::<Vec<_>>())
    };
    assert_eq!(find(&kept(&[]), KEY).status, Status::Ok);
    assert!(value(&kept(&[]), KEY, "skew_s") < 20e-6);
    assert_eq!(find(&kept(&["node.2.clock.drift_ppm=-250"]), KEY).status, Status::Note);
    // What a node can make up for is 400 ppm.
    let report = kept(&["node.2.clock.drift_ppm=-450"]);
    assert_eq!(find(&report, KEY).status, Status::Warn);
    near(value(&report, KEY, "skew_s"), 10e-3, 1e-2);
    let jump = |by: &'static str| find(&kept(&["time.duration=20s", by]), KEY).status;
    assert_eq!(jump("node.2.clock.jumps=[{ at = '1s', by = '500us' }]"), Status::Ok);
    assert_eq!(jump("node.2.clock.jumps=[{ at = '1s', by = '1500us' }]"), Status::Warn);
    assert_eq!(jump("node.2.clock.jumps=[{ at = '1s', by = '50ms' }]"), Status::Warn);
    // Where the time master jumps, nobody is accused of it.
    let report = kept(&["time.duration=20s", "node.1.clock.jumps=[{ at = '1s', by = '50ms' }]"]);
    let advice = &find(&report, KEY).advice.as_ref().unwrap().text;
    assert!(advice.starts_with("node 2 and its time master come apart by 0.05 s"), "{advice}");
}

/// A frame is some 90 bits long. From about a ninth of them on, the counter of a sender rises.
#[test]
fn disturbed_bits_are_held_against_the_error_counters() {
    const KEY: &str = "bus-off";
    let status = |sets: &[&str]| find(&pair(sets), KEY).status;
    assert!(pair(&["bus.model=can"]).findings.iter().all(|finding| finding.name != KEY));
    assert_eq!(status(&["bus.model=can", "bus.bit_errors=0.0001"]), Status::Ok);
    assert_eq!(status(&["bus.model=can", "bus.bit_errors=0.001"]), Status::Warn);
    assert_eq!(status(&["bus.model=can", "bus.bit_errors=0.002"]), Status::Fail);
}

/// `1 - cos(t)` times 5: it comes to 10, and ends where it began.
#[test]
fn a_limit_of_what_is_heard_is_held_against_the_way_and_not_the_end() {
    let one = ["node.1.dynamics.sines.0.amplitude=5", "node.1.dynamics.sines.0.frequency=1"];
    let other = ["node.2.dynamics.sines.0.amplitude=5", "node.2.dynamics.sines.0.frequency=1"];
    let report = |limit| {
        let sets: Vec<_> = one.iter().chain(&other).copied().chain(["time.duration=6283ms", limit]).collect();
        pair(&sets)
    };
    let found = report("safety.heard_limit=6");
    assert_eq!(find(&found, "heard").status, Status::Warn);
    near(value(&found, "heard", "largest"), 10.0, 0.01);
    assert_eq!(find(&report("safety.heard_limit=11"), "heard").status, Status::Ok);
}

#[test]
fn a_restart_that_neighbours_do_not_see_is_warned_of() {
    let of = |events: &str, sets: &[&str]| {
        let overrides: Vec<_> = sets.iter().map(|set| Override::parse(set).unwrap()).collect();
        let text = format!("{PAIR}{events}");
        check(&Scenario::parse(&text, Path::new("pair.toml"), &overrides).unwrap())
    };
    let rate = ["safety.heard_rate=40", "coupling.u_max=20", "bus.loss=0.01"];
    let status = |events: &str| find(&of(events, &rate), "heard").status;
    let event = |at: &str, rest: &str| format!("[[event]]\nat = '{at}'\nnode = 1\nkind = {rest}\n");
    let ticks = value(&of(&event("1s", "'bounce'\nfor = '5ms'"), &rate), "bounds", "extrapolate_ticks");
    let long = ticks + 1.0;
    assert_eq!(status(&event("1s", &format!("'bounce'\nfor = '{ticks}ms'"))), Status::Warn);
    assert_eq!(status(&event("1s", &format!("'bounce'\nfor = '{long}ms'"))), Status::Ok);
    let back = event("1005ms", "'join'");
    assert_eq!(status(&(event("1s", "'crash'") + &back)), Status::Warn);
    // It says that it stops.
    assert_eq!(status(&(event("1s", "'leave'") + &back)), Status::Ok);
    let report = of(&event("1s", "'bounce'\nfor = '5ms'"), &rate);
    let advice = &find(&report, "heard").advice.as_ref().unwrap().text;
    assert!(advice.starts_with("node 1 is off for 5 ticks at 1s, "), "{advice}");
    assert!(advice.ends_with(&format!("for more than {ticks} ticks")), "{advice}");
    // It says that it starts anew, and that comes to all.
    assert_eq!(find(&of(&event("1s", "'bounce'\nfor = '5ms'"), &rate[..2]), "heard").status, Status::Ok);
    // An event may take that word, also one that is drawn.
    let burst = "[[event]]\nat = '900ms'\nkind = 'burst'\nloss = 0.5\nfor = '300ms'\n";
    let faults = "[faults]\nrate = 20.0\nkinds = ['burst']\n";
    for lossy in [burst, "[[event]]\nat = '900ms'\nkind = 'partition'\nlink = [1, 2]\n", faults] {
        let report = of(&(event("1s", "'bounce'\nfor = '5ms'") + lossy), &rate[..2]);
        assert_eq!(find(&report, "heard").status, Status::Warn, "{lossy}");
    }
    let liar = "[[event]]\nat = '900ms'\nkind = 'liar'\nnode = 2\noffset = 0.1\nfor = '10ms'\n";
    let report = of(&(event("1s", "'bounce'\nfor = '5ms'") + liar), &rate[..2]);
    assert_eq!(find(&report, "heard").status, Status::Ok);
    // No edge is dropped, or nobody is known to be too fast.
    let never = ["safety.heard_rate=40", "safety.drop_after=0", "coupling.u_max=20", "bus.loss=0.01"];
    assert_eq!(find(&of(&event("1s", "'bounce'\nfor = '5ms'"), &never), "heard").status, Status::Ok);
    let alone = ["safety.heard_limit=50", "bus.loss=0.01"];
    assert_eq!(find(&of(&event("1s", "'bounce'\nfor = '5ms'"), &alone), "heard").status, Status::Ok);
    // Nor where the motion is not known.
    let edge = ["safety.heard_rate=40", "coupling.kind=edge-wise", "bus.loss=0.01"];
    assert_eq!(find(&of(&event("1s", "'bounce'\nfor = '5ms'"), &edge), "heard").status, Status::Warn);
}

/// Whatever this seed has drawn.
#[test]
fn a_restart_that_some_seed_may_draw_too_short_is_warned_of() {
    let of = |faults: &str, sets: &[&str]| {
        let overrides: Vec<_> = sets.iter().map(|set| Override::parse(set).unwrap()).collect();
        let text = format!("{PAIR}[faults]\nrate = 0.001\n{faults}\n");
        let scenario = Scenario::parse(&text, Path::new("pair.toml"), &overrides).unwrap();
        assert!(scenario.events.is_empty(), "this seed draws none");
        check(&scenario)
    };
    let rate = ["safety.heard_rate=40", "coupling.u_max=20", "bus.loss=0.01"];
    let bounces =
        |shortest: &str| of(&format!("kinds = ['bounce']\nshortest = '{shortest}'\nlongest = '1s'"), &rate);
    let report = bounces("5ms");
    let ticks = value(&report, "bounds", "extrapolate_ticks");
    let found = find(&report, "heard");
    let advice = &found.advice.as_ref().unwrap().text;
    assert!(
        found.status == Status::Warn && advice.starts_with("with some seed [faults] has a node off for 5ms"),
        "{advice}"
    );
    assert!(advice.contains(&format!("faults.shortest be {}ms or more", ticks + 1.0)), "{advice}");
    assert_eq!(find(&bounces(&format!("{}ms", ticks + 1.0)), "heard").status, Status::Ok);
    assert_eq!(find(&bounces(&format!("{ticks}.5ms")), "heard").status, Status::Warn);
    assert_eq!(find(&of("kinds = ['burst']\nshortest = '5ms'", &rate), "heard").status, Status::Ok);
    // It says that it starts anew, and that comes to all.
    assert_eq!(find(&of("kinds = ['bounce']\nshortest = '5ms'", &rate[..2]), "heard").status, Status::Ok);
    let never = ["safety.heard_rate=40", "safety.drop_after=0", "coupling.u_max=20", "bus.loss=0.01"];
    assert_eq!(find(&of("kinds = ['bounce']", &never), "heard").status, Status::Ok);
}

#[test]
fn the_paper_example_holds() {
    let report = load("five-agents.toml", &[]);
    assert!(report.pass && report.findings.iter().all(|finding| finding.status != Status::Warn), "{report}");
    let lambda2 = find(&report, "graph").values["lambda2"].as_f64().unwrap();
    assert!((lambda2 - 1.381_966).abs() < 1e-6);
    let bound = find(&report, "sync-bound").values["end"].as_f64().unwrap();
    assert!((bound - 2.0 * 5f64.sqrt() / lambda2 * 2.0).abs() < 1e-4);
}

#[test]
fn a_funnel_below_what_the_tick_can_hold_is_warned_about() {
    // law.md 4: the prototype kept 0.02 at 2 ms, and left it at 10 ms.
    assert_eq!(find(&load("narrow-ring.toml", &["time.tick=2ms"]), "narrowest-funnel").status, Status::Ok);
    let report = load("narrow-ring.toml", &["time.tick=10ms"]);
    let found = find(&report, "narrowest-funnel");
    assert_eq!(found.status, Status::Warn);
    assert!(found.advice.as_ref().is_some_and(|advice| advice.text.contains("use a tick of")), "{report}");
}

#[test]
fn a_funnel_below_the_resolution_is_warned_about() {
    assert_eq!(find(&load("asymptotic-path-11.toml", &[]), "resolution").status, Status::Warn);
    assert_eq!(find(&load("narrow-ring.toml", &[]), "resolution").status, Status::Ok);
}

#[test]
fn the_resolution_is_the_floor_of_the_node() {
    let report = load("five-agents.toml", &["node.1.state=1e5", "coupling.funnel.start=1e6"]);
    let step = find(&report, "resolution").values["resolution"].as_f64().unwrap();
    // In a ring of unit weights, where an input is far from what a tick makes of 1e5.
    assert!((step - Floor::<f64>::of_f32(2.0, 1e-3).width(1e5, 0.0)).abs() < 1e-9, "{step}");
}

#[test]
fn the_bound_is_that_of_the_floored_funnel() {
    let report = load("asymptotic-path-11.toml", &[]);
    // The run ends 4e-4 apart; the funnel of the scenario, 1e-10, is not the one that the nodes keep.
    assert!(find(&report, "sync-bound").values["end"].as_f64().unwrap() > 4e-4, "{report}");
}

#[test]
fn a_margin_below_the_rounding_is_warned_about() {
    let margin = |sets: &[&str]| load("asymptotic-path-11.toml", sets).findings;
    let found = |sets: &[&str]| margin(sets).into_iter().find(|finding| finding.name == "margin");
    assert_eq!(found(&[]).unwrap().status, Status::Ok);
    let tight = found(&["coupling.gain.scale=1"]).unwrap();
    assert_eq!((tight.status, &tight.values["node"]), (Status::Warn, &json!(5)));
    // f_em - f_5 is about 6.6 - 100.
    assert!((tight.values["margin"].as_f64().unwrap() - 1.0 / 94.0).abs() < 1e-3, "{tight:?}");
    assert!(found(&["coupling.funnel.end=1"]).is_none());
}

#[test]
fn capacity_is_that_of_the_wire() {
    assert_eq!(capacity::classic_bits(8), 135);
    for (nodes, fast, slow) in [(5, 1037.0, 518.0), (20, 259.0, 129.0), (64, 81.0, 40.0), (127, 40.0, 20.0)] {
        assert_eq!(capacity::highest_rate(nodes, 1e6).floor(), fast);
        assert_eq!(capacity::highest_rate(nodes, 5e5).floor(), slow);
    }
}

/// The frame of 16 bytes counted bit by bit, at rates at which each bit of a phase takes 1 s.
#[test]
fn capacity_of_can_fd_is_that_of_the_wire() {
    let arbitration = ["SOF", "RRS", "IDE", "FDF", "res", "BRS"].len() + 11;
    let end = ["ACK", "ACK delimiter"].len() + 7 + 3;
    let data = ["ESI", "CRC delimiter"].len() + 4 + 8 * 16;
    // A stuff bit after every four bits from the start of the frame to the end of the data; before the count
    // of stuff bits and after every four bits of it and of the CRC, a fixed one.
    let stuffed = (arbitration - 1) / 4;
    let stuffed_data = (arbitration + data - 2) / 4 - stuffed;
    let checks = |crc: usize| 4 + crc + (4 + crc).div_ceil(4);
    let (slow, fast) = (arbitration + stuffed + end, data + stuffed_data + checks(17));
    assert_eq!(capacity::fd_time(16, (1.0, f64::INFINITY)), slow as f64);
    assert_eq!(capacity::fd_time(16, (f64::INFINITY, 1.0)), fast as f64);
    let longer = capacity::fd_time(20, (f64::INFINITY, 1.0)) - fast as f64;
    assert_eq!(longer, (4 * 8 + 4 * 2 + checks(21) - checks(17)) as f64);
    for (nodes, rate) in [(5, 1949.0), (20, 487.0), (64, 152.0), (127, 76.0)] {
        assert_eq!(capacity::highest_fd_rate(nodes, 1, (1e6, 5e6)).floor(), rate);
    }
}

#[test]
fn what_is_not_predicted_is_said_and_not_guessed() {
    for (file, sets, words) in [
        (
            "vector-oscillators.toml",
            &[][..],
            "none here for element-wise coupling of states with 2 components",
        ),
        ("five-agents.toml", &["coupling.kind=none"], "the law promises no funnel"),
    ] {
        let report = load(file, sets);
        assert!(find(&report, "predictions").text.contains(words), "{report}");
        for name in ["emergent", "sync-bound", "narrowest-funnel", "resolution", "margin"] {
            assert!(report.findings.iter().all(|finding| finding.name != name), "{report}");
        }
    }
    let load = |report: &Report| find(report, "capacity").values["can_1m_load"].as_f64().unwrap();
    // Every component has a frame of its own.
    assert_eq!(
        load(&self::load("vector-oscillators.toml", &[])),
        2.0 * load(&self::load("five-agents.toml", &[]))
    );
}

#[test]
fn late_frames_are_warned_about_where_they_cost_a_funnel() {
    let status = |file: &str, latency: &str| {
        let report = load(file, &[&format!("bus.latency={latency}")]);
        (find(&report, "bus").status, find(&report, "sampled").status)
    };
    assert_eq!(status("five-agents.toml", "100us"), (Status::Note, Status::Ok));
    // A wide funnel survives a tick, a narrow one does not.
    assert_eq!(status("five-agents.toml", "1ms"), (Status::Note, Status::Ok));
    assert_eq!(status("narrow-ring.toml", "1ms"), (Status::Warn, Status::Fail));
    // A round by which every frame has come is the cure.
    let cured = load("narrow-ring.toml", &["bus.latency=1ms", "time.round=2ms"]);
    let stands = |name| find(&cured, name).status;
    assert!(stands("bus") == Status::Note && stands("sampled") != Status::Fail, "{cured}");
}

#[test]
fn frames_older_than_the_window_are_never_heard() {
    let bus =
        |latency: &str| find(&load("five-agents.toml", &[&format!("bus.latency={latency}")]), "bus").clone();
    assert_ne!(bus("8999us").status, Status::Fail);
    let never = bus("9ms");
    assert_eq!(never.status, Status::Fail);
    let setting = never.advice.unwrap().setting.unwrap();
    assert_eq!((setting.key.as_str(), setting.value.as_str()), ("time.round", "10ms"));
    assert_eq!(find(&load("five-agents.toml", &["bus.latency=10ms"]), "bus").status, Status::Fail);
    assert_eq!(find(&load("five-agents.toml", &["bus.loss=1.0"]), "bus").status, Status::Fail);
}

#[test]
fn a_law_that_runs_away_by_loss_fails() {
    assert!(load("average.toml", &["bus.loss=0.05"]).pass);
    let report = load("average.toml", &["bus.loss=0.3"]);
    assert_eq!((find(&report, "sampled").status, report.pass), (Status::Fail, false), "{report}");
}

#[test]
fn a_bound_that_clips_the_undisturbed_run_is_warned_about() {
    let bounds = |sets: &[&str]| {
        load("five-agents.toml", sets).findings.into_iter().find(|finding| finding.name == "bounds")
    };
    assert!(bounds(&[]).is_none(), "nothing disturbs it");
    let told = bounds(&["bus.loss=0.1"]).unwrap();
    let largest = told.values["u_max"].as_f64().unwrap() / 12.0;
    assert!(told.status == Status::Note && (10.0..30.0).contains(&largest), "{}", told.text);
    assert_eq!(bounds(&[&format!("coupling.u_max={}", 1.01 * largest)]).unwrap().status, Status::Note);
    let clipped = bounds(&[&format!("coupling.u_max={}", 0.5 * largest)]).unwrap();
    let setting = clipped.advice.unwrap().setting.unwrap();
    assert_eq!((clipped.status, setting.key.as_str()), (Status::Warn, "coupling.u_max"));
    assert_eq!(bounds(&[&format!("coupling.u_max={}", setting.value)]).unwrap().status, Status::Note);
}

#[test]
fn heavy_loss_is_warned_about() {
    assert_eq!(find(&load("lossy-ring.toml", &[]), "bus").status, Status::Note);
    let heavy = find(&load("lossy-ring.toml", &["bus.loss=0.3"]), "bus").clone();
    assert_eq!(heavy.status, Status::Warn);
    let setting = heavy.advice.unwrap().setting.unwrap();
    assert_eq!((setting.key.as_str(), setting.value.as_str()), ("coupling.damping", "4"));
    // The cure is one.
    let cured = load("average.toml", &["bus.loss=0.3", "coupling.damping=4"]);
    assert!(find(&cured, "sampled").status != Status::Fail, "{cured}");
    assert_eq!(find(&load("average.toml", &["bus.loss=0.2"]), "bus").status, Status::Warn);
    assert!(load("five-agents.toml", &[]).findings.iter().all(|finding| finding.name != "bus"));
}

#[test]
fn a_lambda2_that_is_lost_in_rounding_is_warned_about() {
    let report = load("five-agents-path.toml", &[]);
    assert_eq!(find(&report, "graph").status, Status::Ok);
    near(value(&report, "graph", "lambda_max"), 2.0 + 2.0 * math::cos(std::f64::consts::PI / 5.0), 1e-12);
    let lost = "graph={kind='edges',nodes=5,edges=[[1,2,1e-9],[2,3,1e3],[3,4],[4,5]]}";
    assert_eq!(find(&load("average.toml", &[lost]), "graph").status, Status::Warn);
}

#[test]
fn the_escape_estimate_bounds_the_states() {
    let report = load("average.toml", &[]);
    assert_eq!(find(&report, "fields").status, Status::Ok);
    near(value(&report, "fields", "state_bound"), 15.0 * (1.0 - math::exp(-20.0)), 1e-6);
    // Above 0.75 the largest field is x + 1.5, from the largest state, 4.
    let report = load("unstable-held.toml", &[]);
    assert_eq!(find(&report, "fields").status, Status::Note);
    near(value(&report, "fields", "state_bound"), 5.5 * math::exp(20.0) - 1.5, 1e-4);
}

#[test]
fn funnels_outside_the_assumption_are_noted() {
    let report = load("five-agents.toml", &[]);
    assert_eq!(find(&report, "funnels").status, Status::Ok);
    assert_eq!(
        (value(&report, "funnels", "psi_bound"), value(&report, "funnels", "psi_slope_bound")),
        (40.0, 38.0)
    );
    near(value(&report, "funnels", "psi_min"), 2.0 + 38.0 * math::exp(-20.0), 1e-9);
    for (file, word) in [("finite-time.toml", "closes"), ("infinite-start.toml", "infinite")] {
        let report = load(file, &[]);
        let found = find(&report, "funnels");
        assert_eq!(found.status, Status::Note);
        assert!(found.advice.as_ref().is_some_and(|advice| advice.text.contains(word)), "{found:?}");
    }
}

#[test]
fn gains_are_known_at_zero_and_at_the_edge() {
    for (file, gamma0) in
        [("five-agents.toml", 1.0), ("average.toml", 80.0), ("median-11.toml", 0.1 * 0.05 / 0.95)]
    {
        let report = load(file, &[]);
        assert_eq!(find(&report, "gains").status, Status::Ok);
        near(value(&report, "gains", "gamma0_min"), gamma0, 1e-12);
    }
    // 2 / (N + 1) is 1/6.
    assert_eq!(find(&load("median-11.toml", &["coupling.gain.eps=0.166"]), "gains").status, Status::Ok);
    assert_eq!(find(&load("median-11.toml", &["coupling.gain.eps=0.167"]), "gains").status, Status::Warn);
    let mut linear = scenario("five-agents.toml", &[]);
    linear.nodes[2].gain = Gain::Linear { slope: 3.0 };
    let report = check(&linear);
    assert_eq!(find(&report, "gains").status, Status::Warn);
    assert!(find(&report, "gains").advice.as_ref().unwrap().text.contains("node 3"));
    assert!(report.findings.iter().all(|finding| finding.name != "input"), "nothing is predicted");
}

#[test]
fn assumption_5_has_its_constants() {
    let report = load("five-agents.toml", &[]);
    assert_eq!(find(&report, "regularity").status, Status::Ok);
    near(value(&report, "regularity", "theta_f"), 10.0 + 0.13 + 96.0, 1e-12);
    near(value(&report, "regularity", "lambda_psi"), 38.0 / 40.0, 1e-12);
    near(value(&load("leader.toml", &[]), "regularity", "r_psi"), 100.0, 1e-12);
    // Between a rate of 1 and one of 2 the ratio is largest on the way, at e^-t = (sqrt(3240) - 18) / 162.
    let funnel = "coupling.funnel={kind='exponential',start=10,end=1,rate=1}";
    let report = load("average.toml", &[funnel, "node.1.funnel={rate=2}"]);
    let y = (3240f64.sqrt() - 18.0) / 162.0;
    near(value(&report, "regularity", "r_psi"), (9.0 * y + 1.0) / (9.0 * y * y + 1.0), 1e-4);
    assert_eq!(find(&load("finite-time.toml", &[]), "regularity").status, Status::Note);
    let open = "node.1.funnel={kind='constant',width=40}";
    assert_eq!(find(&load("finite-time.toml", &[open]), "regularity").status, Status::Warn);
}

#[test]
fn contraction_is_decided_along_the_way() {
    let report = load("contractive-together.toml", &[]);
    assert_eq!(find(&report, "emergent").status, Status::Ok);
    // In the linear part of the gain all weigh the same: (1 - 3 + 1 - 3 + 1) / 5.
    near(value(&report, "emergent", "slowest_rate"), 0.6, 1e-9);
    near(value(&report, "emergent", "mean_rate"), 0.6, 1e-9);
    assert_eq!(value(&report, "emergent", "largest_slope"), 1.0);
    let steeper = ["node.1.dynamics.slope=3", "node.3.dynamics.slope=2"];
    assert_eq!(find(&load("contractive-together.toml", &steeper), "emergent").status, Status::Note);
    // Two unstable agents swing about a stable one, which weighs the most but when they meet: then all weigh
    // the same.
    let report = pair(&[
        "graph.nodes=3",
        "node.1.dynamics.slope=1",
        "node.2.dynamics.slope=1",
        "node.3.dynamics={kind='affine',slope=-1}",
    ]);
    assert_eq!(find(&report, "emergent").status, Status::Note, "{report}");
    near(value(&report, "emergent", "slowest_rate"), -1.0 / 3.0, 1e-9);
    assert!(value(&report, "emergent", "mean_rate") > 0.5);
}

#[test]
fn a_start_at_the_edge_is_warned_about() {
    let report = load("five-agents.toml", &[]);
    assert_eq!(find(&report, "start").status, Status::Ok);
    let terms = scenario("five-agents.toml", &[])
        .graph
        .diffusive_terms(&scenario("five-agents.toml", &[]).initial_states());
    let largest = terms.iter().map(|nu| nu.abs()).fold(0.0, f64::max);
    near(value(&report, "start", "worst"), largest / 40.0, 1e-12);
    let report = load("five-agents.toml", &["coupling.funnel.start=16"]);
    let found = find(&report, "start");
    assert_eq!(found.status, Status::Warn);
    // What the advice names does what it says.
    let advised = load("five-agents.toml", &["coupling.funnel.start=16", "coupling.funnel.factor=2.084"]);
    assert!(found.advice.as_ref().unwrap().text.contains("factor = 2.083"), "{found:?}");
    near(value(&advised, "start", "worst"), 0.45, 1e-3);
}

#[test]
fn time_masters_on_a_bus_on_which_no_simulation_has_them_are_said_to_be_for_a_bench() {
    let said =
        |sets: &[&str]| load("five-agents.toml", sets).findings.iter().any(|it| it.name == "time-masters");
    assert!(said(&["sync.masters=[2]"]));
    assert!(!said(&["sync.masters=[2]", "bus.model=can"]) && !said(&[]));
    let report = load("five-agents.toml", &["sync.masters=[2]"]);
    let found = find(&report, "time-masters");
    assert_eq!((found.status, &found.values["masters"]), (Status::Note, &json!([2])));
    assert!(found.text.contains("only for a bench with clock = \"own\""), "{}", found.text);
}

#[test]
fn the_bound_is_followed_over_time() {
    let report = load("finite-time.toml", &[]);
    let found = find(&report, "sync-bound");
    assert_eq!(found.status, Status::Ok);
    let per_width = 2.0 * 5f64.sqrt() / 1.381_966_011_250_105;
    near(value(&report, "sync-bound", "per_width"), per_width, 1e-9);
    // 40 (1 - t / 5)^2 is the width that the bound allows for 1e-3.
    let when = 5.0 * (1.0 - (1e-3 / per_width / 40.0).sqrt());
    near(value(&report, "sync-bound", "below_final_spread_at"), when, 1e-9);
    let rows = found.values["times"].as_array().unwrap();
    assert_eq!((rows.len(), &rows[3]["t"]), (6, &json!(2.0)));
    near(rows[3]["bound"].as_f64().unwrap(), per_width * 40.0 * 0.36, 1e-9);
    let report = load("average.toml", &[]);
    assert_eq!(find(&report, "sync-bound").status, Status::Note);
    assert!(find(&report, "sync-bound").values["below_final_spread_at"].is_null());
}

#[test]
fn the_tick_holds_what_the_fields_leave() {
    // xi rests; u_1 = -10 sin(5 t) changes by 50 at most, from the start on; both degrees are 1.
    let report = pair(&[]);
    assert_eq!(find(&report, "narrowest-funnel").status, Status::Ok);
    // (1 - 2 g) 1.1 T^2 50 cos(5 t), in the margin 1 / (1 + |u|) that a reciprocal gain leaves with |u| = 10
    // sin(5 t).
    let excess = |angle: f64| 0.8 * 5.5e-5 * math::cos(angle) * (1.0 + 10.0 * math::sin(angle));
    let most = (0..9000).map(|part| excess(f64::from(part) * 1e-4)).fold(0.0, f64::max);
    near(value(&report, "narrowest-funnel", "narrowest"), most, 1e-3);
    near(value(&report, "narrowest-funnel", "share"), most, 1e-3);
    near(value(&report, "narrowest-funnel", "longest_tick_by_formula_s"), 1e-3 / most.sqrt(), 1e-3);
    assert_eq!(value(&report, "narrowest-funnel", "node"), 1.0);
    assert_eq!(find(&pair(&["time.tick=100ms"]), "narrowest-funnel").status, Status::Warn);
    // A narrow funnel counts when it is narrow: the same floor, in a funnel that has closed to it.
    let report = pair(&["coupling.funnel={kind='exponential',start=1,end=1.5e-4,rate=10}"]);
    assert_eq!(find(&report, "narrowest-funnel").status, Status::Warn);
    assert!(value(&report, "narrowest-funnel", "t") > 0.5, "{report}");
}

#[test]
fn fields_too_fast_for_the_tick_are_warned_about() {
    let report = load("five-agents.toml", &[]);
    assert_eq!(find(&report, "speed").status, Status::Ok);
    near(value(&report, "speed", "tick_slope"), 1.24e-3, 1e-12);
    near(value(&report, "speed", "tick_frequency"), 0.01, 1e-12);
    let report = load("five-agents.toml", &["time.tick=100ms"]);
    assert_eq!(find(&report, "speed").status, Status::Note);
    assert!(find(&report, "speed").advice.as_ref().unwrap().text.contains("50ms or less"), "{report}");
    let report = load("average.toml", &["agent.dynamics.slope=-600"]);
    assert_eq!(find(&report, "speed").status, Status::Note);
    let report = load("average.toml", &["agent.dynamics.slope=-2000"]);
    assert_eq!((find(&report, "speed").status, report.pass), (Status::Fail, false));
    // Growing fast is no instability of the step.
    let report = load("average.toml", &["node.1.dynamics.slope=2000", "time.duration=1ms"]);
    assert_eq!(find(&report, "speed").status, Status::Note);
}

#[test]
fn the_prediction_is_that_of_the_emergent_dynamics() {
    for file in
        ["five-agents.toml", "unstable-held.toml", "leader.toml", "head-count-20.toml", "infinite-start.toml"]
    {
        let scenario = scenario(file, &[]);
        let expected = EmergentTrajectory::new(&scenario).unwrap().advance(20.0)[0];
        near(value(&load(file, &["time.duration=20s"]), "prediction", "xi_end"), expected, 1e-4);
    }
    let report = load("unstable-held.toml", &[]);
    assert_eq!(find(&report, "prediction").status, Status::Ok);
    near(value(&report, "prediction", "xi_min"), 0.9, 1e-12);
    // The fields add up to -3 x + 8.5.
    near(value(&report, "prediction", "blended_end"), 8.5 / 3.0 + (0.9 - 8.5 / 3.0) * math::exp(-12.0), 1e-9);
}

#[test]
fn a_motion_that_no_node_follows_is_warned_about() {
    let report = load("average.toml", &["agent.dynamics.slope=2"]);
    assert_eq!(find(&report, "prediction").status, Status::Fail);
    assert!(value(&report, "prediction", "until") < 20.0, "not followed for ever");
}

#[test]
fn a_run_too_long_to_predict_is_predicted_as_far_as_it_goes() {
    let report = load("five-agents.toml", &["time.duration=10000s"]);
    assert_eq!(find(&report, "prediction").status, Status::Note);
    // 50,000 steps of an eighth of a radian of 10 rad/s.
    near(value(&report, "prediction", "until"), 625.0, 1e-6);
}

#[test]
fn the_tightest_node_is_named() {
    let report = load("asymptotic-path-11.toml", &[]);
    assert_eq!(find(&report, "input").status, Status::Ok);
    let (xi, input) = (value(&report, "prediction", "xi_end"), value(&report, "input", "largest_input"));
    near(input, 100.0 - xi, 1e-6);
    near(value(&report, "input", "margin"), 5.0 / (5.0 + input), 1e-9);
    assert_eq!(value(&report, "input", "node"), 5.0);
    let report = load("malicious-11.toml", &[]);
    let found = find(&report, "input");
    assert_eq!((found.status, value(&report, "input", "node")), (Status::Note, 4.0));
    near(value(&report, "input", "margin"), 0.05 / 0.9 / 1005.0, 1e-2);
    assert!(found.advice.as_ref().unwrap().text.contains("eta = 185"), "{found:?}");
    let advised = load("malicious-11.toml", &["coupling.gain.eta=185"]);
    near(value(&advised, "input", "margin"), 0.02, 0.05);
}

#[test]
fn inputs_outside_the_linear_part_are_warned_about() {
    let report = load("average.toml", &[]);
    assert_eq!(find(&report, "linear-part").status, Status::Ok);
    near(value(&report, "linear-part", "share"), 10.0 / 40.0, 1e-9);
    let report = load("average.toml", &["coupling.gain.bound=4"]);
    assert_eq!(find(&report, "linear-part").status, Status::Note);
    assert!(load("five-agents.toml", &[]).findings.iter().all(|finding| finding.name != "linear-part"));
}

#[test]
fn every_node_has_its_row() {
    let report = load("asymptotic-path-11.toml", &[]);
    let row = report.per_node[4];
    assert_eq!((row.id, row.degree, row.start_ratio, row.tick_floor), (5, 2.0, 0.0, Some(0.0)));
    assert_eq!(Some(row.psi_min), row.resolution);
    near(row.margin.unwrap() + row.steady_ratio.unwrap(), 1.0, 1e-12);
    assert_eq!(row.margin.unwrap(), value(&report, "input", "margin"));
    let text = report.to_string();
    assert!(text.contains("\n   11        1"), "{text}");
    assert!(!load("head-count-20.toml", &[]).to_string().contains("\n   11"), "20 rows are too many to read");
}

#[test]
fn a_schedule_that_widens_first_is_widest_where_it_joins() {
    let widening = "coupling.funnel={kind='schedule',start=40.0,at='2s',eps=1.0,then={kind='exponential',start=900.0,end=1.0,rate=1.0}}";
    let report = load("five-agents.toml", &[widening]);
    near(value(&report, "funnels", "psi_bound"), 1.0 + 899.0 * math::exp(-2.0), 1e-6);
}

#[test]
fn a_ripple_of_whole_turns_per_tick_is_predicted_and_warned_about() {
    // -x + 1 + 10 sin(100 pi t + 1.2): beside the ripple, which is 0.03 high, xi goes to 1. A node that ticks
    // at 20 ms sees a constant.
    let ripple =
        "{kind='affine',slope=-1.0,offset=1.0,sines=[{amplitude=10.0,frequency=314.159265358979,phase=1.2}]}";
    let sets = [format!("node.1.dynamics={ripple}"), format!("node.2.dynamics={ripple}")];
    for tick in ["time.tick=20ms", "time.tick=1ms"] {
        let report = pair(&[&sets[0], &sets[1], tick]);
        near(value(&report, "prediction", "xi_end"), 1.0, 0.04);
        assert_eq!(value(&report, "prediction", "until"), 10.0);
        // Where nodes see a constant the law goes elsewhere, and the prediction is no more than that.
        let stands = if tick == "time.tick=1ms" { Status::Ok } else { Status::Note };
        assert_eq!(find(&report, "prediction").status, stands, "{report}");
        let speed = find(&report, "speed");
        let sees = speed.advice.as_ref().is_some_and(|advice| advice.text.contains("sees it once per tick"));
        assert_eq!(
            (speed.status == Status::Ok, sees),
            (tick == "time.tick=1ms", tick == "time.tick=20ms"),
            "{speed:?}"
        );
    }
    let idle = "node.1.dynamics={kind='affine',slope=-1.0,sines=[{amplitude=0.0,frequency=1e6}]}";
    assert_eq!(find(&pair(&[idle]), "speed").status, Status::Ok);
}

#[test]
fn fields_are_compared_with_the_tick_under_every_coupling() {
    let linear = "coupling.gain={kind='linear',slope=5}";
    for kind in ["none", "linear", "edge-wise", "weakly-centralised"] {
        let kind = format!("coupling.kind={kind}");
        let sets = [kind.as_str(), linear];
        let sets = if kind.ends_with("linear") { &sets[..] } else { &sets[..1] };
        assert_eq!(find(&load("five-agents.toml", sets), "speed").status, Status::Ok);
        let slow: Vec<_> = sets.iter().copied().chain(["time.tick=100ms"]).collect();
        assert_eq!(find(&load("five-agents.toml", &slow), "speed").status, Status::Note);
    }
    assert_eq!(find(&load("vector-oscillators.toml", &[]), "speed").status, Status::Ok);
    let slow = load("vector-oscillators.toml", &["time.tick=500ms"]);
    assert_eq!(find(&slow, "speed").status, Status::Note);
}

#[test]
fn what_was_looked_at_in_part_is_not_found_to_hold() {
    let report = load("five-agents.toml", &["time.duration=10000s"]);
    for name in ["fields", "emergent", "narrowest-funnel", "resolution", "input"] {
        let found = find(&report, name);
        assert_eq!(found.status, Status::Note, "{found:?}");
        assert!(
            found.advice.as_ref().is_some_and(|advice| advice.text == "looked at up to 625 s only"),
            "{found:?}"
        );
    }
    assert_eq!(find(&report, "graph").status, Status::Ok);
}

#[test]
fn the_largest_and_the_extremes_keep_what_is_not_a_number() {
    let (index, value) = largest([1.0, f64::NAN, 7.0, f64::NAN]);
    assert!(index == 1 && value.is_nan());
    assert_eq!(largest([1.0, 7.0, 3.0]), (1, 7.0));
    let (low, high) = extremes([1.0, f64::NAN, 7.0]);
    assert!(low.is_nan() && high.is_nan());
}

#[test]
fn a_motion_that_is_not_a_number_leaves_no_finding_ok() {
    let scenario = scenario("five-agents.toml", &[]);
    let mut subject = Subject::of(&scenario);
    let mut forecast = subject.forecast.take().unwrap();
    forecast.xi[7] = f64::NAN;
    forecast.reach = f64::NAN;
    (forecast.largest_state, forecast.slope_largest, forecast.slope_mean) = (f64::NAN, f64::NAN, f64::NAN);
    forecast.resolution[2] = f64::NAN;
    let node = &mut forecast.nodes[3];
    (node.input, node.margin, node.taken, node.floor) = (f64::NAN, f64::NAN, f64::NAN, f64::NAN);
    subject.forecast = Some(forecast);
    let mut findings = assumptions::findings(&subject);
    findings.extend(start::findings(&subject));
    let forecast = subject.forecast.as_ref().unwrap();
    findings.extend(limits::findings(&subject, forecast));
    findings.extend(predictions::findings(&subject, forecast));
    for name in ["fields", "emergent", "narrowest-funnel", "resolution", "prediction", "input"] {
        let found = findings.iter().find(|finding| finding.name == name).unwrap();
        assert_ne!(found.status, Status::Ok, "{found:?}");
        assert!(found.text.contains("NaN"), "{found:?}");
    }
}

#[test]
fn a_motion_that_errors_outgrow_is_not_ok() {
    let unstable = |slope: &str| {
        let field = format!("{{kind='affine',slope={slope},sines=[{{amplitude=1.0,frequency=2.0}}]}}");
        pair(&[
            &format!("node.1.dynamics={field}"),
            &format!("node.2.dynamics={field}"),
            "agent.state=-0.4",
            "time.duration=30s",
        ])
    };
    // Exactly -0.2 sin(2 t) - 0.4 cos(2 t), which is 0.44 at 30 s.
    assert_eq!(find(&unstable("1.0"), "prediction").status, Status::NotChecked);
    assert_eq!(find(&unstable("-1.0"), "prediction").status, Status::Ok);
}

#[test]
fn nothing_of_a_run_with_events_reads_as_checked() {
    let report = load("partition.toml", &[]);
    assert_eq!(find(&report, "events").status, Status::NotChecked);
    assert_eq!(find(&report, "events").values, json!({ "events": 2 }));
    let expected: Vec<_> =
        report.findings.iter().filter(|finding| finding.name.starts_with("expect-")).collect();
    assert_eq!(expected.len(), 2);
    assert!(expected.iter().all(|finding| finding.status == Status::NotChecked), "{report}");
    assert!(load("five-agents.toml", &[]).findings.iter().all(|finding| finding.name != "events"));
    // All nodes at once, from their initial states on, is no part of a run with a node that joins.
    let report = load("bounce-join.toml", &["node.5.state=500"]);
    for name in ["kick", "sampled"] {
        assert_eq!(find(&report, name).status, Status::NotChecked, "{report}");
    }
    assert!(report.pass, "{report}");
}
