//! Nodes that say what they are not, in networks with limits of what is heard and without: what is noticed, after how long, and what it
//! does to the honest ones. The table of the book's page of faults is `the_table`.
#![allow(clippy::unwrap_used, clippy::panic, reason = "helpers of tests, which clippy does not know as such")]

use funnelnet_node::Event;
use funnelnet_sim::bus::Medium;
use funnelnet_sim::engine::Engine;
use funnelnet_sim::loopback::{can_bus, engine_on, ideal_bus};
use funnelnet_sim::random::{self, Purpose};
use funnelnet_sim::{Scenario, Simulation};
use std::path::Path;

/// A network that keeps its funnel by itself, with inputs up to 15 per second and fields up to 4.
const NETWORK: &str = r#"version = 1
time = { tick = "1ms", duration = "3s" }
coupling.kind = "node-wise"
coupling.gain = { kind = "reciprocal", scale = 1.0 }
coupling.funnel = { kind = "exponential", start = 8.0, end = 0.2, rate = 12.0 }
agent.dynamics = { kind = "affine", slope = -0.5 }
"#;
/// Inputs are bounded, so that no honest node can be too fast, whatever happens.
const LIMITS: &str = "coupling.u_max = 20.0\nsafety = { heard_limit = 8.0, heard_rate = 25.0 }\n";
/// The same without that bound: inputs reach twelve times those of the undisturbed run.
const UNBOUNDED: &str = "safety = { heard_limit = 8.0, heard_rate = 20.0 }\n";

/// Time of the lie, ticks.
const AT: u64 = 1_000;
const END: u64 = 1_500;
/// The liar starts anew after it, and is off for longer than a silent neighbour is extrapolated.
const RESTART: &str = "[[event]]\nat = \"1500ms\"\nkind = \"bounce\"\nnode = LIAR\nfor = \"200ms\"\n";

/// A graph, and who lies in it.
#[derive(Clone, Copy)]
struct Place {
    name: &'static str,
    graph: &'static str,
    nodes: usize,
    liar: usize,
}

const PLACES: [Place; 4] = [
    Place { name: "ring", graph: "{ kind = \"ring\", nodes = 6 }", nodes: 6, liar: 1 },
    Place { name: "star, a leaf", graph: "{ kind = \"star\", nodes = 6 }", nodes: 6, liar: 2 },
    Place {
        name: "random, degree 3",
        graph: "{ kind = \"random-regular\", nodes = 8, degree = 3 }",
        nodes: 8,
        liar: 1,
    },
    Place { name: "star, its hub", graph: "{ kind = \"star\", nodes = 6 }", nodes: 6, liar: 1 },
];

const LIES: [&str; 6] =
    ["constant = 5", "constant = 1", "ramp = 100", "ramp = 5", "offset = 2", "offset = 0.1"];

/// What is seen of a run.
#[derive(Clone, Debug, Default)]
struct Seen {
    /// Ticks from the first lie to the first one that was not taken.
    noticed: Option<u64>,
    /// Ticks until the last neighbour has dropped its edge to the liar.
    dropped: Option<u64>,
    /// States of honest nodes that were not taken, rows of them, and edges between them that were dropped.
    doubted: usize,
    wronged: usize,
    /// The largest true ratio of honest nodes while it lasts.
    ratio: f64,
    /// The same without the edges to the liar.
    among: f64,
    /// Ticks from its end to the last one with an honest node outside, with all edges.
    back: u64,
}

fn scenario(place: Place, number: u64, lie: &str, rest: &str, limits: &str) -> Scenario {
    let Place { graph, nodes, liar, .. } = place;
    let mut dice = random::stream(number, Purpose::Graph, 0);
    let mut between =
        |low: f64, high: f64| ((low + (high - low) * random::uniform(&mut dice)) * 1e3).round() / 1e3;
    let node = |id: usize| {
        let (state, offset) = (between(-1.0, 1.0), between(-2.0, 2.0));
        format!("[[node]]\nid = {id}\nstate = {state:?}\ndynamics = {{ offset = {offset:?} }}\n")
    };
    let tables: String = (1..=nodes).map(node).collect();
    let lie = match lie {
        "" => String::new(),
        lie => format!("[[event]]\nat = \"1s\"\nkind = \"liar\"\nnode = {liar}\nfor = \"500ms\"\n{lie}\n"),
    };
    let rest = rest.replace("LIAR", &liar.to_string());
    let text = format!("{NETWORK}{limits}seed = {number}\ngraph = {graph}\n{tables}{lie}{rest}");
    Scenario::parse(&text, Path::new("liar.toml"), &[]).unwrap_or_else(|errors| panic!("{errors}"))
}

fn run(place: Place, number: u64, lie: &str, rest: &str, limits: &str) -> Seen {
    let scenario = scenario(place, number, lie, rest, limits);
    let liar = place.liar - 1;
    let mut engine = engine_on(&scenario, ideal_bus(&scenario)).unwrap();
    engine.start();
    let mut left = scenario.graph.edges.iter().filter(|edge| edge.a == liar || edge.b == liar).count();
    let mut seen = Seen::default();
    for k in 0..=scenario.time.ticks {
        let states: Vec<f64> = engine.advance().unwrap().iter().map(|seen| f64::from(seen.x)).collect();
        for told in engine.take_events() {
            let (of, is_last) = match told.event {
                Event::TooFast { node, .. } | Event::TooFar { node, .. } => (node, false),
                Event::Barred(node) => (node, true),
                _ => continue,
            };
            let is_right = usize::from(of.get()) == place.liar && k >= AT;
            seen.doubted += usize::from(!is_right && !is_last);
            seen.wronged += usize::from(!is_right && is_last);
            left -= usize::from(is_right && is_last && left > 0);
            let ticks = k.saturating_sub(AT);
            seen.noticed = seen.noticed.or(is_right.then_some(ticks));
            seen.dropped = seen.dropped.or((left == 0).then_some(ticks));
        }
        if k < AT {
            continue;
        }
        let psi = scenario.nodes[0].funnel.width(k as f64 * 1e-3);
        for node in (0..states.len()).filter(|&node| node != liar) {
            let (mut all, mut among) = (0.0, 0.0);
            for edge in &scenario.graph.edges {
                let other = match node {
                    _ if node == edge.a => edge.b,
                    _ if node == edge.b => edge.a,
                    _ => continue,
                };
                // Who is off has no state.
                let term = edge.weight * (states[other] - states[node]);
                if term.is_finite() {
                    all += term;
                    among += if other == liar { 0.0 } else { term };
                }
            }
            if k < END {
                seen.ratio = seen.ratio.max(all.abs() / psi);
                seen.among = seen.among.max(among.abs() / psi);
            } else if all.abs() >= psi {
                seen.back = k - END;
            }
        }
    }
    seen
}

fn played<M: Medium>(scenario: &Scenario, medium: M) -> (Vec<u32>, Engine<M>) {
    let mut engine = engine_on(scenario, medium).unwrap();
    engine.start();
    let mut states = Vec::new();
    for _ in 0..=scenario.time.ticks {
        states.extend(engine.advance().unwrap().iter().map(|seen| seen.x.to_bits()));
    }
    (states, engine)
}

#[test]
fn honest_networks_have_the_same_bits_with_limits_that_they_keep() {
    for place in PLACES {
        for number in 0..3 {
            let states = |limits| {
                let scenario = scenario(place, number, "", "", limits);
                played(&scenario, ideal_bus(&scenario)).0
            };
            assert!(states(LIMITS) == states(""), "{} {number}", place.name);
            // Below what the start does they are not.
            assert!(states("safety.heard_rate = 2.0\n") != states(""), "{} {number}", place.name);
        }
    }
}

/// A jump by more than a neighbour can move in ten ticks, and a ramp that is steeper.
#[test]
fn a_lie_that_jumps_or_is_too_fast_is_dropped_in_eleven_ticks_and_honest_nodes_keep_their_funnels() {
    for place in &PLACES[..3] {
        for lie in ["constant = 5", "ramp = 100", "offset = 2"] {
            for number in 0..3 {
                let bare = run(*place, number, lie, "", "");
                let limited = run(*place, number, lie, RESTART, LIMITS);
                let what = format!("{} {lie} {number}: {bare:?}, {limited:?}", place.name);
                assert!(bare.noticed.is_none() && bare.ratio > 1.3 && bare.back < 300, "{what}");
                assert!(limited.noticed.unwrap() <= 2 && limited.dropped.unwrap() <= 11, "{what}");
                assert!(limited.among < 1.0, "{what}");
                assert!(limited.wronged == 0 && limited.doubted == 0, "{what}");
                assert!(limited.back < 1_000, "{what}");
            }
        }
    }
}

/// What an honest node could have said, nobody can tell from a lie.
#[test]
fn a_lie_within_the_limits_is_believed() {
    for place in PLACES {
        let ramp = run(place, 0, "ramp = 5", "", LIMITS);
        assert!(ramp.noticed.unwrap() > END - AT, "at its end it jumps back: {ramp:?}");
        let offset = run(place, 0, "offset = 0.1", "", LIMITS);
        assert!(offset.dropped.is_none() && offset.wronged == 0, "{offset:?}");
    }
    // In the end it is too far.
    let limit = "coupling.u_max = 20.0\nsafety = { heard_limit = 4.0, heard_rate = 25.0 }\n";
    let ramp = run(PLACES[0], 0, "ramp = 15", "", limit);
    let at = ramp.noticed.unwrap();
    assert!((200..300).contains(&at) && ramp.dropped == Some(at + 9), "{ramp:?}");
}

/// Two pull each other's way. The second comes back where its neighbours are, which is far from where it was.
const APART: &str = r#"version = 1
time = { tick = "1ms", duration = "2s" }
graph = { kind = "path", nodes = 3 }
coupling.kind = "node-wise"
coupling.gain = { kind = "reciprocal", scale = 1.0 }
coupling.funnel = { kind = "constant", width = 8.0 }
coupling.u_max = 20.0
agent.dynamics = { kind = "affine", slope = -1.0 }
node = [{ id = 1, dynamics = { offset = 8.0 } }]
event = [{ at = "1s", kind = "bounce", node = 1, for = "20ms" }]
"#;

/// It is off for less than it is extrapolated, and says that it starts anew.
#[test]
fn an_honest_node_that_was_off_for_a_moment_and_is_elsewhere_then_is_heard() {
    for limits in ["safety = { heard_limit = 50.0, heard_rate = 40.0 }\n", ""] {
        for bus in ["", "bus = { model = \"can\", bitrate = 1000000 }\n"] {
            let text = format!("{APART}{limits}{bus}");
            let scenario = Scenario::parse(&text, Path::new("apart.toml"), &[]).unwrap();
            let mut simulation = Simulation::new(&scenario).unwrap();
            let (mut x, mut barred) = (Vec::new(), 0);
            while simulation.step().is_some() {
                x.push(simulation.node(1)[0].x);
            }
            let mut anew = 0;
            for told in simulation.events() {
                barred += usize::from(matches!(told.event, Event::Barred(_) | Event::TooFast { .. }));
                anew += usize::from(matches!(told.event, Event::NeighbourFound(id) if id.get() == 1));
            }
            assert!((x[999] - x[1025]).abs() > 2.0, "{} {}", x[999], x[1025]);
            // Its neighbour notices nothing but a jump, and drops nothing.
            assert_eq!((barred, anew), (0, 1), "{limits} {bus}");
        }
    }
}

/// Each stops where a single neighbour is lost, and the first state of who is back comes after a neighbour's tick, or not at all.
#[test]
fn nobody_stops_because_a_neighbour_has_started_anew() {
    let text = |seed, bus| {
        format!(
            r#"version = 1
seed = {seed}
time = {{ tick = "1ms", duration = "500ms" }}
graph = {{ kind = "ring", nodes = 5 }}
agent.dynamics = {{ kind = "affine", slope = -0.5 }}
coupling.kind = "node-wise"
coupling.gain = {{ kind = "reciprocal", scale = 1.0 }}
coupling.funnel = {{ kind = "constant", width = 4.0 }}
coupling.u_max = 20.0
safety = {{ heard_rate = 40.0, lost_neighbours = 1 }}
event = [{{ at = "300ms", kind = "bounce", node = 2, for = "5ms" }}]
bus = {{ {bus} }}
"#
        )
    };
    for bus in ["latency = '850us', jitter = '300us'", "loss = 0.1"] {
        for seed in 1..=20 {
            let scenario = Scenario::parse(&text(seed, bus), Path::new("anew.toml"), &[]).unwrap();
            let mut simulation = Simulation::new(&scenario).unwrap();
            while simulation.step().is_some() {}
            let stops: Vec<_> =
                simulation.events().iter().filter(|told| matches!(told.event, Event::Fault(_))).collect();
            assert!(stops.is_empty(), "{bus}, seed {seed}: {stops:?}");
        }
    }
}

/// Who is barred to the end is heard: it is not what fails such a run.
#[test]
fn a_liar_that_is_dropped_to_the_end_is_no_silent_node() {
    let scenario = scenario(PLACES[0], 1, "constant = 5", "", LIMITS);
    let verdict = Simulation::new(&scenario).unwrap().run();
    let heard = verdict.checks.iter().find(|check| check.name == "heard").unwrap();
    assert!(heard.pass, "{heard:?}");
    assert!(run(PLACES[0], 1, "constant = 5", "", LIMITS).dropped.is_some());
}

#[test]
fn limits_do_the_same_on_can() {
    let on = |bus: &str| scenario(PLACES[0], 1, "constant = 5", bus, LIMITS);
    let ideal = on("");
    let can = Scenario { bus: on("[bus]\nmodel = \"can\"\n").bus, ..ideal.clone() };
    let (states, engine) = played(&ideal, ideal_bus(&ideal));
    let (on_can, can) = played(&can, can_bus::<funnelnet_link::Classic>(&can).unwrap());
    assert!(states == on_can);
    let kept = |reports: Vec<Option<funnelnet_protocol::report::Report>>| -> Vec<_> {
        reports.into_iter().flatten().map(|report| report.counters.kept).collect()
    };
    let (ideal, can) = (kept(engine.reports()), kept(can.reports()));
    assert!(ideal == can && ideal.iter().map(|kept| kept.edges).sum::<u32>() == 2, "{ideal:?} {can:?}");
}

/// A node that obeys the law with a bad field is borne by the median gain, and not by a linear coupling.
#[test]
fn with_the_median_gain_all_end_within_eta_of_the_median_of_all_fields() {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../scenarios/malicious-11.toml");
    let text = std::fs::read_to_string(path).unwrap();
    let farthest = |text: &str| {
        let scenario = Scenario::parse(text, Path::new("malicious.toml"), &[]).unwrap();
        let last = Simulation::new(&scenario).unwrap().run().findings.last;
        last.iter().fold(0.0, |most: f64, x| most.max((x - 5.0).abs()))
    };
    let median = r#"{ kind = "median", eta = 0.5, eps = 0.1 }"#;
    assert!(farthest(&text) < 0.2);
    let other = text
        .replace(median, r#"{ kind = "linear", slope = 10.0 }"#)
        .replace(r#"kind = "node-wise""#, r#"kind = "linear""#);
    assert!(other != text && farthest(&other) > 10.0);
}

#[test]
#[ignore = "the book's table: cargo test --locked -p funnelnet-sim --test liars -- --ignored --nocapture"]
fn the_table() {
    let runs = std::env::var("RUNS").map_or(100, |runs| runs.parse().unwrap());
    println!(
        "| lie | graph | no limits: ratio; inside after | not taken after; dropped after | ratio among honest; with the liar's edge | inside after, the liar restarted | honest edges dropped |"
    );
    println!("|---|---|---:|---:|---:|---:|---:|");
    let limits = if std::env::var("UNBOUNDED").is_ok() { UNBOUNDED } else { LIMITS };
    for lie in LIES {
        for place in PLACES {
            let all = |rest: &str, limits: &str| -> Vec<_> {
                (0..runs).map(|number| run(place, number, lie, rest, limits)).collect()
            };
            println!("| `{lie}` | {} {}", place.name, row(&all("", ""), &all(RESTART, limits)));
        }
    }
}

fn row(bare: &[Seen], limited: &[Seen]) -> String {
    let most = |runs: &[Seen], of: fn(&Seen) -> f64| runs.iter().map(of).fold(0.0, f64::max);
    let when = |of: fn(&Seen) -> Option<u64>| {
        let ticks: Vec<_> = limited.iter().filter_map(of).collect();
        match ticks.iter().max() {
            None => "never".to_owned(),
            Some(most) if ticks.len() == limited.len() => format!("{most}"),
            Some(most) => format!("{most} ({} %)", 100 * ticks.len() / limited.len()),
        }
    };
    let wronged: usize = limited.iter().map(|seen| seen.wronged).sum();
    format!(
        "| {:.1}; {:.0} ms | {}; {} | {:.2}; {:.2} | {:.0} ms | {wronged} |",
        most(bare, |seen| seen.ratio),
        most(bare, |seen| seen.back as f64),
        when(|seen| seen.noticed),
        when(|seen| seen.dropped),
        most(limited, |seen| seen.among),
        most(limited, |seen| seen.ratio),
        most(limited, |seen| seen.back as f64),
    )
}
