#![allow(clippy::unwrap_used, clippy::panic, reason = "a test that cannot go on has failed")]

use super::*;
use crate::loopback;
use crate::scenario::{AnyScenario, LargeScenario, Override, Scenario, Source};
use crate::simulation::Simulation;
use crate::trace_hash::TraceHash;
use funnelnet_law::field::{Scalar, midpoint_step};
use funnelnet_law::floor::Floor;
use funnelnet_law::funnel::{SampledFunnel, Shape};
use funnelnet_law::gain::Reciprocal;
use funnelnet_law::law::node_wise::{Memory, NodeWise, THETA};
use funnelnet_law::math;
use std::path::{Path, PathBuf};

fn overrides(list: &[&str]) -> Vec<Override> {
    list.iter().map(|text| Override::parse(text).unwrap()).collect()
}

fn large_of(source: &Source, list: &[&str]) -> Result<Box<LargeScenario>, String> {
    match source.any_scenario(&overrides(list)) {
        Ok(AnyScenario::Large(scenario)) => Ok(scenario),
        Ok(AnyScenario::Wired(_)) => Err("has a bus".to_owned()),
        Err(errors) => Err(errors.to_string()),
    }
}

fn of_text(graph: &str, rest: &str) -> Source {
    let text = format!(
        r#"
        version = 1
        seed = 5
        time = {{ tick = "1ms", duration = "100ms" }}
        graph = {{ {graph} }}
        coupling = {{ kind = "node-wise", gain = {{ kind = "reciprocal" }}, funnel = {{ kind = "exponential", start = 60, end = 1, rate = 20 }} }}
        bus.model = "none"
        {rest}
        "#
    );
    Source { text, path: "large.toml".into() }
}

const DRAWN: &str = r#"
        agent.dynamics = { kind = "affine", slope = -1.0, offset = 0.5 }
        agent.random = { state = { uniform = [-2, 2] }, slope = { uniform = [-2, -0.5] }, offset = { normal = [0, 3] } }
"#;

fn scenarios() -> Vec<PathBuf> {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../scenarios");
    let paths = std::fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().path());
    let mut paths: Vec<_> = paths.filter(|path| path.extension().is_some_and(|end| end == "toml")).collect();
    paths.sort();
    paths
}

/// Runs on the ideal bus for so many ticks, and gives the hash of all states.
fn on_ideal_bus(scenario: &Scenario, ticks: u64) -> TraceHash {
    let mut engine = loopback::engine(scenario).unwrap();
    engine.start();
    let mut hash = TraceHash::new();
    for _ in 0..=ticks {
        let seen = engine.advance().unwrap();
        hash.extend(seen.iter().map(|seen| seen.x));
    }
    hash
}

fn without_a_bus(scenario: &LargeScenario, ticks: u64) -> TraceHash {
    let mut network = Network::new(scenario, 1).unwrap();
    (0..=ticks).for_each(|_| assert!(network.step().is_some()));
    network.hash()
}

/// Every scenario of the repository that a run without a bus takes has the bits of the ideal bus.
#[test]
fn every_scenario_that_is_taken_has_the_hash_of_the_ideal_bus() {
    let mut taken = Vec::new();
    for path in scenarios() {
        let source = Source::read(&path).unwrap();
        let Ok(large) = large_of(&source, &["bus.model=none", "expect={}"]) else { continue };
        let wired = source.scenario(&overrides(&["expect={}"])).unwrap();
        let ticks = large.time.ticks.min(1_500);
        assert_eq!(without_a_bus(&large, ticks), on_ideal_bus(&wired, ticks), "{}", path.display());
        taken.push(path.file_stem().unwrap().to_string_lossy().into_owned());
    }
    // Among them sines, expressions, inputs from files, limits, weights, other gains, and funnels.
    for name in [
        "five-agents",
        "average",
        "head-count-20",
        "kuramoto",
        "median-51",
        "tank",
        "asymptotic-path-11",
        "infinite-start",
    ] {
        assert!(taken.iter().any(|taken| taken == name), "{name} is not among {taken:?}");
    }
    assert!(taken.len() > 20, "{taken:?}");
}

/// Not only states: the verdict is that of the judge of a run with a bus.
#[test]
fn figures_are_those_of_the_judge() {
    for name in ["five-agents", "narrow-star", "median-11"] {
        let path = Path::new(env!("CARGO_MANIFEST_DIR")).join(format!("../scenarios/{name}.toml"));
        let source = Source::read(&path).unwrap();
        let short = ["expect={}", "time.duration=1s"];
        let wired = source.scenario(&overrides(&short)).unwrap();
        let expected = Simulation::new(&wired).unwrap().run().findings;
        let large = large_of(&source, &["expect={}", "time.duration=1s", "bus.model=none"]).unwrap();
        let mut network = Network::new(&large, 1).unwrap();
        while network.step().is_some() {}
        let found = network.findings();
        assert_eq!(found.max_ratio, expected.max_ratio, "{name}");
        assert_eq!((found.breaches, found.judged), (expected.breaches, expected.judged), "{name}");
        assert_eq!(Some(found.max_spread), expected.max_spread, "{name}");
        assert_eq!(Some(found.final_spread()), expected.final_spread, "{name}");
        assert_eq!(Some(f64::from(found.max_input)), expected.max_input, "{name}");
    }
}

/// A run on an ideal bus draws the same values for its nodes.
#[test]
fn drawn_values_are_those_of_every_bus() {
    let source = of_text(r#"kind = "random-regular", nodes = 100, degree = 4"#, DRAWN);
    let wired = source.scenario(&overrides(&["bus.model=ideal"])).unwrap();
    let large = large_of(&source, &[]).unwrap();
    assert_eq!(without_a_bus(&large, 100), on_ideal_bus(&wired, 100));
    let states: Vec<f64> = wired.nodes.iter().map(|node| node.state[0]).collect();
    let spread = crate::extremes::extremes(states.iter().copied());
    assert!(spread.0 < -1.8 && spread.1 > 1.8 && spread.0 >= -2.0 && spread.1 < 2.0, "{spread:?}");
    let offsets: Vec<f64> = wired.nodes.iter().map(|node| node.dynamics.affine().unwrap().offset()).collect();
    let mean = offsets.iter().sum::<f64>() / 100.0;
    assert!(mean.abs() < 1.2 && offsets.iter().any(|offset| offset.abs() > 4.0), "{mean}");
}

#[test]
fn a_key_that_is_added_changes_no_other_draw_and_a_node_keeps_what_it_says() {
    let graph = r#"kind = "ring", nodes = 5"#;
    let source = of_text(graph, DRAWN);
    let values = |list: &[&str]| {
        let mut values = Vec::new();
        large_of(&source, list).unwrap().for_each_node(|_, _, node| {
            let field = node.dynamics.affine().unwrap();
            values.push((node.state[0], field.slope(), field.offset()));
        });
        values
    };
    let all = values(&[]);
    let fewer = values(&["agent.random={ offset = { normal = [0, 3] } }"]);
    let offsets = |values: &[(f64, f64, f64)]| values.iter().map(|value| value.2).collect::<Vec<_>>();
    assert_eq!(offsets(&all), offsets(&fewer));
    assert!(fewer.iter().all(|value| (value.0, value.1) == (0.0, -1.0)));
    let own = values(&["node.3.state=1.5", "node.3.dynamics.slope=-4"]);
    assert_eq!((own[2].0, own[2].1, own[2].2), (1.5, -4.0, all[2].2));
    assert_eq!((&own[..2], &own[3..]), (&all[..2], &all[3..]));
}

/// Blocks, threads and their borders leave no trace: against one loop over all nodes with the law's own functions.
/// A batch with a node that is watched runs one by one.
#[test]
fn nodes_at_once_have_the_figures_of_nodes_one_by_one() {
    let tight = "coupling.funnel = { kind = 'exponential', start = 60, end = 1e-8, rate = 400 }";
    let open = "coupling.funnel = { kind = 'constant', width = 20 }";
    for (list, is_tight) in [(vec![], false), (vec![tight], true), (vec![open], false)] {
        let list: Vec<_> = list.iter().map(|text: &&str| text.replacen(" = ", "=", 1)).collect();
        let list: Vec<_> = list.iter().map(String::as_str).collect();
        let scenario =
            large_of(&of_text("kind = 'random-regular', nodes = 300, degree = 4", DRAWN), &list).unwrap();
        let figures = |watched: &[usize]| {
            let mut network = Network::watching(&scenario, 1, watched).unwrap();
            let mut rows = Vec::new();
            while network.step().is_some() {
                rows.push(network.row());
            }
            (network.hash(), network.findings().clone(), rows)
        };
        let (at_once, one_by_one) = (figures(&[]), figures(&[0, 64, 128, 192, 256]));
        assert_eq!(at_once, one_by_one);
        assert_eq!(at_once.1.floored > 0, is_tight, "{:?}", at_once.1);
    }
}

#[test]
fn blocks_are_one_network_for_any_number_of_threads() {
    let nodes = 9_001;
    let source = of_text(&format!(r#"kind = "random-regular", nodes = {nodes}, degree = 4"#), DRAWN);
    let scenario = large_of(&source, &[]).unwrap();
    let ticks = 25;
    let expected = by_one_loop(&scenario, ticks);
    let mut first = None;
    for threads in [1, 2, 3, 7] {
        let mut network = Network::watching(&scenario, threads, &[0, 4095, 4096, 9000]).unwrap();
        let mut hashes = [TraceHash::new(); 3];
        for k in 0..=ticks {
            assert_eq!(network.step(), Some(k));
            for (hash, block) in hashes.iter_mut().zip(network.states().chunks(4096)) {
                hash.extend(block.iter().map(|seen| seen.x));
            }
        }
        let differs =
            |(index, (seen, x)): (usize, (&Seen, &f32))| (seen.x.to_bits() != x.to_bits()).then_some(index);
        assert_eq!(network.states().iter().zip(&expected).enumerate().find_map(differs), None);
        let mut whole = TraceHash::new();
        hashes.iter().for_each(|hash| whole.push_bytes(&hash.value().to_le_bytes()));
        assert_eq!(network.hash(), whole);
        let watched: Vec<_> = network.watched().copied().collect();
        assert_eq!(
            watched.iter().map(|seen| seen.x).collect::<Vec<_>>(),
            [0, 4095, 4096, 9000].map(|i| expected[i])
        );
        let found = (network.findings(), network.row(), watched);
        assert_eq!(*first.get_or_insert_with(|| found.clone()), found, "{threads} threads");
        assert_eq!(found.0.judged, nodes as u64 * (ticks + 1));
    }
}

/// States at tick `ticks`, by index.
fn by_one_loop(scenario: &LargeScenario, ticks: u64) -> Vec<f32> {
    let tick = 1e-3;
    let funnel = SampledFunnel::<f32>::new(
        &Shape::Exponential { start: 60.0, end: 1.0, rate: 20.0 }.into(),
        tick,
        THETA,
    );
    let (law, floor) = (NodeWise::new(Reciprocal { scale: 1.0f32 }, tick, 4.0), Floor::<f32>::new(4.0, tick));
    let mut neighbours = vec![Vec::new(); scenario.nodes()];
    for edge in &scenario.graph.edges {
        neighbours[edge.a].push(edge.b);
        neighbours[edge.b].push(edge.a);
    }
    neighbours.iter_mut().for_each(|list| list.sort_unstable());
    let (mut x, mut fields) = (Vec::new(), Vec::new());
    scenario.for_each_node(|_, _, node| {
        x.push(node.state[0] as f32);
        let field = node.dynamics.affine().unwrap();
        fields.push((field.slope() as f32, field.offset() as f32));
    });
    let (mut dx, mut carry, mut memory) =
        (vec![0.0f32; x.len()], vec![0.0f32; x.len()], vec![Memory::<f32>::default(); x.len()]);
    for k in 0..ticks {
        let (states, changes) = (x.clone(), dx.clone());
        for i in 0..states.len() {
            let (mut nu, mut dnu, mut largest) = (0.0f32, 0.0f32, states[i].abs());
            for &j in &neighbours[i] {
                nu += states[j] - states[i];
                dnu += changes[j] - changes[i];
                largest = largest.max(states[j].abs());
            }
            let last = memory[i].last_input().map_or(0.0, f32::abs);
            let psi = funnel.widths(k as u32).floored(floor.width(largest, last));
            let u = law.step(&mut memory[i], nu, dnu, psi).u;
            let field = Scalar { slope: fields[i].0, offset: fields[i].1, phasors: &[] };
            midpoint_step(&field, tick as f32, k, &mut x[i], &mut carry[i], u);
            dx[i] = x[i] - states[i];
        }
    }
    x
}

#[test]
fn what_needs_a_bus_is_refused_by_its_key() {
    let source = of_text(r#"kind = "ring", nodes = 5"#, DRAWN);
    for (setting, key) in [
        ("bus.loss=0.1", "bus.loss"),
        ("bus.latency=1ms", "bus.latency"),
        ("agent.noise=0.1", "agent.noise"),
        ("node.2.noise=0.1", "node.2.noise"),
        ("agent.compute=1us", "agent.compute"),
        ("time.round=2ms", "time.round"),
        ("time.slow_start=2ms", "time.slow_start"),
        ("clock.drift_ppm=5", "clock"),
        ("sync.period=10ms", "sync"),
        ("safety.lost_neighbours=1", "safety"),
        ("faults.rate=0.1", "faults"),
        ("event=[{ at = \"1ms\", kind = \"crash\", node = 1 }]", "event"),
        ("link=[{ between = [1, 2], loss = 0.1 }]", "link"),
        ("coupling.kind=edge-wise", "coupling.kind"),
        ("coupling.kind=max-gain", "coupling.kind"),
        ("coupling.on_breach=stop", "coupling.on_breach"),
        ("coupling.floor=0.5", "coupling.floor"),
        ("expect.emergent_error=0.1", "expect.emergent_error"),
        ("expect.reference_error=0.1", "expect.reference_error"),
        ("expect.stopped=any", "expect.stopped"),
        ("agent.state=[1, 2]", "agent.state"),
        ("agent.random.slope={ uniform = [2, 1] }", "agent.random.slope"),
        ("agent.random.phase={ uniform = [0, 1] }", "agent.random.phase"),
        ("agent.random.slope={ normal = [0, 1e9] }", "agent.random.slope"),
        ("graph.nodes=1000001", "graph.nodes"),
    ] {
        let error = large_of(&source, &[setting]).unwrap_err();
        assert!(error.contains(key), "{setting}: {error}");
    }
    assert!(large_of(&source, &["coupling.floor=f32"]).is_ok());
    let error = source.scenario(&[]).unwrap_err().to_string();
    assert!(error.contains("bus.model") && error.contains("`run`, `check` and `sweep`"), "{error}");
}

#[test]
fn one_node_that_starts_outside_is_named_for_all() {
    let source = of_text(r#"kind = "ring", nodes = 5000"#, DRAWN);
    let error = large_of(&source, &["node.77.state=100"]).unwrap_err();
    assert!(error.contains("node 77: starts outside") && error.contains("3 of 5000"), "{error}");
}

/// Without a bus nobody hears that a node has stopped: the run says so, and ends.
#[test]
fn a_run_ends_where_a_node_would_stop() {
    let source = of_text(r#"kind = "ring", nodes = 5000"#, DRAWN);
    // Runs away on its own, and its neighbours' pull is bounded.
    let scenario = large_of(
        &source,
        &[
            "node.4321.dynamics.slope=900",
            "coupling.u_max=1",
            "coupling.funnel={ kind = \"constant\", width = 1e6 }",
        ],
    )
    .unwrap();
    let mut network = Network::new(&scenario, 2).unwrap();
    while network.step().is_some() {}
    let findings = network.findings();
    let halt = findings.halt.clone().unwrap();
    assert_eq!((halt.node, halt.why), (4320, "its state is beyond its limit"));
    assert!(halt.tick < 100 && findings.limited > 0, "{halt:?}");
}

/// Quantiles and verdict are of one ratio, where a funnel has closed and the floor of f32 is accepted, too.
#[test]
fn the_largest_ratio_of_all_rows_is_that_of_the_verdict() {
    let source = of_text(r#"kind = "ring", nodes = 50"#, DRAWN);
    let closing = "coupling.funnel={ kind = \"finite-time\", start = 60, at = \"50ms\", power = 2 }";
    for list in [&[][..], &["coupling.floor=f32"], &[closing, "coupling.floor=f32"]] {
        let scenario = large_of(&source, list).unwrap();
        let mut network = Network::new(&scenario, 1).unwrap();
        let mut largest = 0.0f32;
        while network.step().is_some() {
            largest = math::larger(largest, network.row().ratio[2]);
        }
        let found = network.findings();
        assert!(found.max_ratio.is_finite() && found.max_ratio > 0.0, "{list:?} {found:?}");
        assert_eq!(largest, found.max_ratio as f32, "{list:?}");
    }
}
