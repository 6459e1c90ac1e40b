//! Reading of whole files.

use super::*;
use crate::configure::{Drive, node_configs};
use funnelnet_node::Params;
use funnelnet_protocol::config::{HeardLimits, TickSource};

const FILE: &str = r#"version = 1
seed = 7

[time]
tick = "1ms"
duration = "2s"

[graph]
kind = "path"
nodes = 3

[coupling]
kind = "node-wise"
gain = { kind = "reciprocal", scale = 2.0 }
funnel = { kind = "exponential", start = 40.0, end = 2.0, rate = 1.0 }

[agent]
state = 1.0
dynamics = { kind = "affine", slope = -1.0, sines = [{ amplitude = 10.0, frequency = 1.0 }] }

[[node]]
id = 2
state = -3
dynamics = { slope = -0.5 }
funnel = { factor = 3.0 }
gain = { kind = "logarithmic" }

[expect]
funnel_ratio = 1
"#;

fn read(text: &str, sets: &[&str]) -> Result<Scenario, Diagnostics> {
    let overrides: Vec<_> = sets.iter().map(|set| Override::parse(set).unwrap()).collect();
    Scenario::parse(text, Path::new("dir/a.toml"), &overrides)
}

/// The messages after replacing `from` by `to`, which must be in the file.
fn errors(from: &str, to: &str) -> String {
    assert!(FILE.contains(from), "{from}");
    read(&FILE.replacen(from, to, 1), &[]).unwrap_err().to_string()
}

fn set_error(set: &str) -> String {
    read(FILE, &[set]).unwrap_err().to_string()
}

#[test]
fn defaults_and_overrides_are_resolved() {
    let scenario = read(FILE, &[]).unwrap();
    assert_eq!(scenario.title, "a");
    assert_eq!(scenario.seed, 7);
    assert_eq!(
        scenario.time,
        TimeSpec { tick_ns: 1_000_000, ticks: 2_000, round: 1, start: SlowStart::default() }
    );
    assert_eq!(scenario.time.end_s(), 2.0);
    assert_eq!(scenario.graph.edges.len(), 2);
    let sines = vec![Sine { component: 0, amplitude: 10.0, frequency: 1.0, phase: 0.0 }];
    assert_eq!(
        scenario.nodes[0],
        NodeSpec {
            id: 1,
            state: vec![1.0],
            dynamics: Affine::scalar(-1.0, 0.0, sines.clone()).into(),
            limits: None,
            gain: Gain::Reciprocal { scale: 2.0 },
            funnel: Funnel { factor: 1.0, shape: Shape::Exponential { start: 40.0, end: 2.0, rate: 1.0 } },
            damping: 2.2,
            noise: 0.0,
            compute_ns: 0,
        }
    );
    assert_eq!(
        scenario.nodes[1],
        NodeSpec {
            id: 2,
            state: vec![-3.0],
            dynamics: Affine::scalar(-0.5, 0.0, sines).into(),
            limits: None,
            gain: Gain::Logarithmic { scale: 1.0 },
            funnel: Funnel { factor: 3.0, shape: Shape::Exponential { start: 40.0, end: 2.0, rate: 1.0 } },
            damping: 2.2,
            noise: 0.0,
            compute_ns: 0,
        }
    );
    assert_eq!(initial_ratios(&scenario), [0.1, 8.0 / 120.0, 0.1]);
    assert_eq!(scenario.expect, Expect { funnel_ratio: Some(1.0), ..Expect::default() });
    assert_eq!((scenario.bus, scenario.links), (BusSpec::default(), Vec::new()));
}

#[test]
fn a_wrong_value_names_place_key_value_and_range() {
    assert_eq!(
        errors("rate = 1.0", "rate = -1.0"),
        "dir/a.toml:15:66: coupling.funnel.rate = -1.0: must be > 0 (1/s)"
    );
    assert_eq!(
        errors("state = 1.0", "state = nan"),
        "dir/a.toml:18:9: agent.state = nan: must be a finite number (state units)"
    );
    assert_eq!(
        errors("start = 40.0", "start = inf"),
        "dir/a.toml:15:42: coupling.funnel.start = inf: must be finite and > 0 (state units)"
    );
    assert_eq!(
        errors("state = -3", "state = true"),
        "dir/a.toml:23:9: node.2.state = true: must be a finite number (state units) or an array of such numbers, not a \
         boolean"
    );
    assert_eq!(
        errors("state = -3", "state = 1e300"),
        "dir/a.toml:23:9: node.2.state = 1e300: must be at most 1e9 in size, to suit a node (state units)"
    );
}

#[test]
fn unknown_keys_come_with_the_known_ones() {
    assert_eq!(
        errors("nodes = 3", "nodse = 3"),
        "dir/a.toml:8:1: missing key 'nodes' in [graph] of kind 'path': must be an integer from 1 to 2000 \
         (and a run takes 127 at most, without bus.model = \"none\")\n\
         dir/a.toml:10:1: unknown key 'nodse' in [graph] of kind 'path'; known: kind, nodes, weight; \
         did you mean 'nodes'?"
    );
    assert_eq!(
        errors("[expect]", "[expcet]"),
        "dir/a.toml:28:2: unknown key 'expcet' in the file; known: version, title, seed, time, \
         graph, coupling, \
         agent, node, bus, link, event, faults, clock, sync, safety, expect; did you mean 'expect'?"
    );
    assert_eq!(
        errors("kind = \"path\"", "kind = \"pat\""),
        "dir/a.toml:9:8: graph.kind = \"pat\": must be one of ring, path, star, complete, grid, \
         torus, ring-lattice, \
         random-regular, erdos-renyi, edges, file; did you mean 'path'?"
    );
}

#[test]
fn several_mistakes_are_reported_at_once_and_each_once() {
    let text = FILE
        .replace("rate = 1.0", "rate = 0")
        .replace("state = -3", "stat = -3")
        .replace("tick = \"1ms\"", "");
    let found = read(&text, &[]).unwrap_err();
    let lines: Vec<_> = found.0.iter().map(|diagnostic| (diagnostic.line, diagnostic.key.as_str())).collect();
    assert_eq!(lines, [(4, "time.tick"), (15, "coupling.funnel.rate"), (23, "node.2.stat")]);
}

#[test]
fn times_need_units_and_whole_ticks() {
    assert_eq!(
        errors("\"1ms\"", "1"),
        "dir/a.toml:5:8: time.tick = 1: must be a duration with a unit, as \"1ms\" (units: ns, us, \
         ms, s, min, h)"
    );
    assert!(errors("\"1ms\"", "\"1 m\"").contains("units: ns, us, ms, s, min, h"));
    assert_eq!(errors("\"1ms\"", "\"0ms\""), "dir/a.toml:5:8: time.tick = \"0ms\": must be longer than 0s");
    assert_eq!(
        errors("\"2s\"", "\"2.0004s\""),
        "dir/a.toml:6:12: time.duration = \"2.0004s\": must be a whole number of ticks of 1ms; \
         \"2s\" would do"
    );
    assert!(errors("\"2s\"", "\"200000h\"").contains("2^40 node-ticks"));
}

#[test]
fn a_can_bus_has_bit_rates_and_bit_errors_and_no_latency() {
    let bus = |keys: &str| format!("[bus]\nmodel = \"can\"\n{keys}\n[expect]");
    let read = |keys: &str| read(&FILE.replacen("[expect]", &bus(keys), 1), &[]).unwrap().bus;
    let (default, set) = (read(""), read("bitrate = 500_000\nbit_errors = 1e-4"));
    assert_eq!((default.model, default.bitrate, default.bit_errors), (BusModel::Can, 1_000_000, 0));
    assert_eq!((set.bitrate, set.bit_errors, set.loss), (500_000, 100_000, Loss::NONE));
    let lossy =
        self::read(&FILE.replacen("[expect]", &bus("loss = 0.1\nsample_point = 0.8"), 1), &[]).unwrap().bus;
    assert_eq!((lossy.loss, lossy.sample_per_mille), (Loss::independent(0.1), 800));
    for (keys, message) in [
        (
            "bitrate = 333333",
            "bus.bitrate = 333333: a bit and its first 87.5 % must have whole nanoseconds; the nearest rate that does is 312500",
        ),
        ("bitrate = 2000000", "bus.bitrate = 2000000: must be an integer from 10000 to 1000000 (bit/s)"),
        ("bit_errors = 0.2", "bus.bit_errors = 0.2: must be"),
        (
            "latency = \"1ms\"",
            "unknown key 'latency' in [bus] of model 'can'; known: model, bitrate, sample_point, bit_errors, loss",
        ),
        (
            "sample_point = 0.8755",
            "bus.sample_point = 0.8755: must be a whole number of thousandths of a bit",
        ),
        ("sample_point = 1", "bus.sample_point = 1: must be from 0.001 to 0.999 (of a bit)"),
        ("data_bitrate = 2000000", "unknown key 'data_bitrate'"),
    ] {
        let message_found = errors("[expect]", &bus(keys));
        assert!(message_found.contains(message), "{message_found}");
    }
}

#[test]
fn can_fd_has_a_second_rate_that_is_no_slower() {
    let bus = |keys: &str| format!("[bus]\nmodel = \"can-fd\"\n{keys}\n[expect]");
    let read = |keys: &str| read(&FILE.replacen("[expect]", &bus(keys), 1), &[]).unwrap().bus;
    let (default, set) =
        (read(""), read("bitrate = 500_000\ndata_bitrate = 5_000_000\ndata_sample_point = 0.8"));
    assert_eq!(
        (default.model, default.bitrate, default.data_bitrate),
        (BusModel::CanFd, 1_000_000, 2_000_000)
    );
    assert_eq!((set.data_bitrate, set.data_sample_per_mille), (5_000_000, 800));
    assert!(default.timing().is_some() && set.timing().is_some());
    for (keys, message) in [
        (
            "data_bitrate = 3000000",
            "bus.data_bitrate = 3000000: a bit and its first 75 % must have whole nanoseconds; the nearest",
        ),
        (
            "data_bitrate = 9000000",
            "bus.data_bitrate = 9000000: must be an integer from 10000 to 8000000 (bit/s)",
        ),
        (
            "data_bitrate = 500000",
            "bus.data_bitrate = 500000: the data of CAN FD must not be slower than its arbitration: 500000 and 1000000 bit/s",
        ),
        (
            "data_bitrate = 5000000\ndata_sample_point = 0.751",
            "bus.data_bitrate = 5000000: a bit and its first 75.1 %",
        ),
    ] {
        let message_found = errors("[expect]", &bus(keys));
        assert!(message_found.contains(message), "{message_found}");
    }
}

#[test]
fn serial_lines_have_a_rate_a_wiring_and_room() {
    let bus = |keys: &str| format!("[bus]\nmodel = \"uart\"\n{keys}\n[expect]");
    let read = |keys: &str| read(&FILE.replacen("[expect]", &bus(keys), 1), &[]).unwrap().bus;
    let (default, set) = (read(""), read("bitrate = 115_200\nwiring = \"hub\"\nreceive_buffer = 16"));
    assert_eq!((default.model, default.wiring, default.receive_buffer), (BusModel::Uart, Wiring::Lines, 512));
    assert_eq!((set.bitrate, set.wiring, set.receive_buffer), (115_200, Wiring::Hub, 16));
    for (keys, message) in [
        ("bitrate = 300", "bus.bitrate = 300: must be an integer from 1200 to 10000000 (bit/s)"),
        ("receive_buffer = 0", "bus.receive_buffer = 0: must be an integer from 1 to 65536 (bytes)"),
        ("wiring = \"star\"", "bus.wiring = \"star\": must be one of lines, hub"),
        ("jitter = \"1ms\"", "unknown key 'jitter' in [bus]"),
    ] {
        let message_found = errors("[expect]", &bus(keys));
        assert!(message_found.contains(message), "{message_found}");
    }
    let crowded =
        self::read(FILE, &["graph={kind='star',nodes=9}", "bus={model='uart'}"]).unwrap_err().to_string();
    assert!(
        crowded.contains("node 1 has 8 neighbours, and a node has 7 lines to neighbours at most"),
        "{crowded}"
    );
}

#[test]
fn a_node_computes_for_less_than_its_tick() {
    let compute = |set: &str| read(FILE, &["agent.compute='40us'", set]).map(|scenario| scenario.nodes);
    let nodes = compute("node.2.compute='100us'").unwrap();
    assert_eq!([nodes[0].compute_ns, nodes[1].compute_ns], [40_000, 100_000]);
    let late = compute("node.2.compute='1ms'").unwrap_err().to_string();
    assert!(late.contains("compute = '1ms': must be shorter than the tick, 1ms"), "{late}");
}

#[test]
fn losses_may_come_in_bursts() {
    let bus = |loss: &str| format!("[bus]\nloss = {loss}\n[expect]");
    let read = |loss: &str| read(&FILE.replacen("[expect]", &bus(loss), 1), &[]).unwrap().bus.loss;
    assert_eq!(
        read("{ to_bad = 0.01, to_good = 0.1 }"),
        Loss { good: 0.0, bad: 1.0, to_bad: 0.01, to_good: 0.1 }
    );
    for (loss, message) in [
        ("{ to_bad = 0.01 }", "missing key 'to_good' in [bus.loss]"),
        ("{ to_bad = 0.01, to_good = 0 }", "bus.loss.to_good = 0: must be > 0 and <= 1 (probability)"),
        (
            "{ to_bad = 0.01, to_good = 0.1, bad = 1.5 }",
            "bus.loss.bad = 1.5: must be from 0 to 1 (probability)",
        ),
        ("{ to_bad = 0.01, to_good = 0.1, good_ = 0 }", "unknown key 'good_'"),
        ("\"much\"", "must be from 0 to 1 (probability), or { good, bad, to_bad, to_good }, not a string"),
        ("1.01", "bus.loss = 1.01: must be from 0 to 1 (probability)"),
    ] {
        let message_found = errors("[expect]", &bus(loss));
        assert!(message_found.contains(message), "{message_found}");
    }
}

#[test]
fn links_are_edges_with_one_direction_or_both() {
    let read = |links: &str| read(&format!("{FILE}\n{links}"), &[]).unwrap().links;
    let both = read("[[link]]\nbetween = [1, 2]\nloss = 0.5\nlatency = \"3ms\"");
    let settings =
        LinkSettings { loss: Loss::independent(0.5), latency_ns: 3_000_000, ..LinkSettings::default() };
    assert_eq!(both, [(0, 1), (1, 0)].map(|(from, to)| LinkSpec { from, to, settings }));
    let one =
        read("[[link]]\nfrom = 2\nto = 1\nduplicate = 0.1\nreorder = 0.2\ncorrupt = 0.3\njitter = \"1ms\"");
    let settings = LinkSettings {
        duplicate: 0.1,
        reorder: 0.2,
        corrupt: 0.3,
        jitter_ns: 1_000_000,
        ..LinkSettings::default()
    };
    assert_eq!(one, [LinkSpec { from: 1, to: 0, settings }]);
    for (links, message) in [
        ("between = [1, 9]\nloss = 0.5", "link[0].between[1] = 9: must be an integer from 1 to"),
        ("between = [1, 1]\nloss = 0.5", "must be an edge of the graph; node 1 has edges to"),
        ("between = [1]\nloss = 0.5", "must be the ids of two neighbours, as [1, 2]"),
        ("from = 1\nloss = 0.5", "missing key 'to' in [link[0]]"),
        ("loss = 0.5", "missing key 'between' in [link[0]]"),
        ("between = [1, 2]\nto = 2\nloss = 0.5", "must not be there beside between"),
        ("between = [1, 2]", "must do something: loss, latency, jitter, reorder, duplicate or corrupt"),
        ("between = [1, 2]\nloss = 2", "link[0].loss = 2: must be from 0 to 1 (probability)"),
        ("between = [1, 2]\nreorder = -1", "link[0].reorder = -1: must be from 0 to 1 (probability)"),
        ("between = [1, 2]\nlatency = \"10s\"", "latency and jitter must not exceed"),
        ("between = [1, 2]\nlos = 0.5", "did you mean 'loss'"),
        (
            "between = [1, 2]\nloss = 0.5\n[[link]]\nfrom = 2\nto = 1\nloss = 0.1",
            "must be the only one with this direction: an earlier [[link]] is from 2 to 1",
        ),
    ] {
        let text = format!("{FILE}\n[[link]]\n{links}");
        let found = super::Scenario::parse(&text, Path::new("dir/a.toml"), &[]).unwrap_err().to_string();
        assert!(found.contains(message), "{found}");
    }
}

/// Two components, and a matrix at node 2.
const VECTOR: &[&str] = &[
    "agent.state=[1, 2]",
    "agent.dynamics={kind='affine',slope=-1,offset=[0.5,0],sines=[{amplitude=[0,3],frequency=2,phase=[0,1]},{amplitude=1,frequency=3}]}",
    "node.2.dynamics.slope=[[-1,4],[-4,-2]]",
];

#[test]
fn vector_states_take_a_number_or_an_array_everywhere() {
    let scenario = read(FILE, VECTOR).unwrap();
    assert_eq!(scenario.components(), 2);
    assert_eq!(scenario.initial_states(), [1.0, 2.0, -3.0, -3.0, 1.0, 2.0]);
    let sine = |component, amplitude, frequency, phase| Sine { component, amplitude, frequency, phase };
    let sines = vec![sine(1, 3.0, 2.0, 1.0), sine(0, 1.0, 3.0, 0.0), sine(1, 1.0, 3.0, 0.0)];
    let first = Affine { slope: vec![-1.0], offset: vec![0.5, 0.0], sines: sines.clone() };
    assert_eq!(scenario.nodes[0].dynamics, first.clone().into());
    let second = Affine { slope: vec![-1.0, 4.0, -4.0, -2.0], offset: vec![0.5, 0.0], sines };
    assert_eq!(scenario.nodes[1].dynamics, second.clone().into());
    assert_eq!(second.component(0, 0.0, &[1.0, 10.0]), -1.0 + 40.0 + 0.5);
    let wave = 3.0 * funnelnet_law::math::sin(2.0 * 0.25 + 1.0) + funnelnet_law::math::sin(3.0 * 0.25);
    assert!((second.component(1, 0.25, &[1.0, 10.0]) - (-4.0 - 20.0 + wave)).abs() < 1e-15);
    assert_eq!((first.lipschitz(), second.lipschitz()), (1.0, 6.0));
    // |nu| is 4 and 5, of node 2 twice that; its funnel has the factor 3.
    assert_eq!(initial_ratios(&scenario), [0.1, 0.125, 8.0 / 120.0, 10.0 / 120.0, 0.1, 0.125]);
    let scenario = read(FILE, &["agent.dynamics.slope=[[-1]]"]).unwrap();
    assert_eq!(scenario.nodes[0].dynamics.affine().unwrap().slope, [-1.0]);
}

#[test]
fn arrays_of_another_length_name_the_one_that_counts() {
    let set = |more: &str| read(FILE, &[VECTOR, &[more]].concat()).unwrap_err().to_string();
    assert!(set("node.3.state=[1,2,3]").starts_with(
        "--set agent.state=[1, 2]: agent.state = [1, 2]: must have 3 numbers, one per component, since node.3.state has as \
         many; here are 2\n"
    ));
    assert!(
        set("node.1.state=[]")
            .ends_with("node.1.state = []: must have 1 to 8 numbers, one per component; here are 0")
    );
    assert!(
        set("node.1.state=[1,2,3,4,5,6,7,8,9]")
            .ends_with("must have 1 to 8 numbers, one per component; here are 9")
    );
    assert!(
        set("node.1.dynamics.slope=[[1,2],[3]]").ends_with(
            "node.1.dynamics.slope[1] = [3]: must have 2 numbers, one per component, since agent.state has as many; here are 1"
        ),
        "{}",
        set("node.1.dynamics.slope=[[1,2],[3]]")
    );
    assert!(
        set("node.1.dynamics.slope=[1,2]")
            .contains("node.1.dynamics.slope[0] = 1: must be a row of the matrix, an array of numbers")
    );
    assert!(set("node.1.dynamics.offset='x'").ends_with(
        "must be a finite number (state units per second) or an array of such numbers, not a string"
    ));
    assert!(set("node.1.dynamics.slope=true").ends_with(
        "must be a finite number (1/s) or a matrix of such numbers, an array of rows, not a boolean"
    ));
    assert!(
        set("node.1.state=[1,nan]").contains("node.1.state[1] = nan: must be a finite number (state units)")
    );
}

#[test]
fn the_sines_of_all_components_count() {
    let sines = |amplitude: &str| {
        let sines = vec![format!("{{ amplitude = {amplitude}, frequency = 1 }}"); 5].join(",");
        read(FILE, &[VECTOR, &[&format!("agent.dynamics.sines=[{sines}]")]].concat())
    };
    let error = sines("1").unwrap_err().to_string();
    assert!(
        error.contains("agent.dynamics.sines[4] = ")
            && error.contains("at most 8 sines over all components, zero amplitudes apart"),
        "{error}"
    );
    assert_eq!(sines("[0, 1]").unwrap().nodes[0].dynamics.sines().len(), 5);
}

#[test]
fn every_coupling_is_read() {
    for kind in ["node-wise", "edge-wise", "element-wise", "max-gain", "weakly-centralised"] {
        let text = FILE.split("[[node]]").next().unwrap();
        let scenario = read(text, &[&format!("coupling.kind={kind}")]).unwrap();
        assert_eq!(scenario.coupling.kind(), kind);
        assert!(scenario.coupling.keeps_funnels());
    }
    let linear = ["coupling.gain={kind='linear',slope=3}", "node.2.gain={kind='linear',slope=3}"];
    let with = |more: &[&str]| read(FILE, &[&linear, more].concat());
    assert_eq!(with(&["coupling.kind=linear"]).unwrap().nodes[1].gain, Gain::Linear { slope: 3.0 });
    assert!(with(&["coupling.kind=node-wise"]).is_ok());
    let tracker = with(&["coupling.kind=lambda-tracker", "coupling.eta=0.1"]).unwrap();
    assert_eq!(tracker.coupling, Coupling::LambdaTracker { eta: 0.1 });
    let free = FILE.replace("kind = \"node-wise\"", "kind = \"none\"");
    let free = free.replace("gain = { kind = \"reciprocal\", scale = 2.0 }\n", "");
    assert_eq!(read(&free, &[]).unwrap().coupling, Coupling::None);
    // Where nothing is promised, a node may start outside.
    assert!(
        read(&free, &["node.2.state=1e6"]).is_ok()
            && with(&["coupling.kind=linear", "node.2.state=1e6"]).is_ok()
    );
}

#[test]
fn a_gain_that_does_not_suit_the_coupling_is_refused() {
    let set = |sets: &[&str]| read(FILE, sets).unwrap_err().to_string();
    let linear = ["coupling.gain={kind='linear',slope=3}", "node.2.gain={kind='linear',slope=3}"];
    for kind in ["element-wise", "max-gain", "weakly-centralised"] {
        let error = set(&[&linear[..], &[&format!("coupling.kind={kind}")]].concat());
        assert!(
            error.contains(&format!(
                "must be a funnel's gain (reciprocal, logarithmic, locally-linear, median, algebraic) with {kind}"
            )),
            "{error}"
        );
    }
    let error = set(&["coupling.kind=linear"]);
    assert!(error.contains("14:8: coupling.gain = { kind = \"reciprocal\", scale = 2.0 }: must be { kind = \"linear\", slope }"), "{error}");
    let error = set(&["coupling.kind=lambda-tracker", linear[0], linear[1]]);
    assert!(
        error
            .contains("missing key 'eta' in [coupling] of kind 'lambda-tracker': must be >= 0 (state units)"),
        "{error}"
    );
    assert!(set(&["coupling.eta=1"]).contains("unknown key 'eta' in [coupling] of kind 'node-wise'"));
    let error = set(&["coupling.kind=edge-wise"]);
    assert!(
        error.contains("25:10: node.2.funnel = { factor = 3.0 }: must not be there with edge-wise coupling"),
        "{error}"
    );
    assert!(error.contains("26:8: node.2.gain = ") && error.contains("set it in [coupling]"), "{error}");
}

#[test]
fn edge_wise_starts_are_judged_by_the_edges() {
    let text = FILE.split("[[node]]").next().unwrap();
    let sets = ["coupling.kind=edge-wise", "node.2.state=30", "graph.weight=1.3"];
    // Two edges of 29 * 1.3 = 37.7 each, below 40; node-wise their sum is above.
    let edge_wise = read(text, &sets).unwrap();
    assert!(initial_ratios(&edge_wise).iter().all(|ratio| (ratio - 37.7 / 40.0).abs() < 1e-12));
    assert!(read(text, &sets[1..]).is_err());
    assert_eq!(edge_wise.sync_bound(2.0), 2.0 * 2.0 / 1.3);
}

#[test]
fn breach_policies_are_a_name_or_a_table() {
    let policy =
        |value: &str| read(FILE, &[&format!("coupling.on_breach={value}")]).map(|read| read.on_breach);
    assert_eq!(read(FILE, &[]).unwrap().on_breach, Breach::Ride);
    assert_eq!(policy("'ride'").unwrap(), Breach::Ride);
    assert_eq!(policy("stop").unwrap(), Breach::Stop);
    assert_eq!(policy("reopen").unwrap(), Breach::Reopen { margin: 1.5, rate: 1.0 });
    let reopen = "{kind='reopen',margin=2,rate=0.5}";
    assert_eq!(policy(reopen).unwrap(), Breach::Reopen { margin: 2.0, rate: 0.5 });
    let error = |value: &str| policy(value).unwrap_err().to_string();
    assert!(
        error("reopn").ends_with(
            "coupling.on_breach = reopn: must be one of ride, stop, reopen; did you mean 'reopen'?"
        )
    );
    assert!(
        error("{kind='reopen',margin=1}")
            .contains("coupling.on_breach.margin = 1: must be from 1.01 to 1000000 (1)")
    );
    assert!(
        error("{kind='stop',margin=2}")
            .contains("unknown key 'margin' in [coupling.on_breach] of kind 'stop'")
    );
    assert!(error("3").ends_with("coupling.on_breach = 3: must be a table"));
}

#[test]
fn what_a_coupling_cannot_do_is_refused() {
    let text = FILE.split("[[node]]").next().unwrap();
    let error = |sets: &[&str]| read(text, sets).unwrap_err().to_string();
    let edge_wise = error(&["coupling.kind=edge-wise", "coupling.on_breach=reopen"]);
    assert!(
        edge_wise.contains("coupling.on_breach = reopen: must be ride or stop with edge-wise"),
        "{edge_wise}"
    );
    let central = "coupling.kind=weakly-centralised";
    assert!(error(&[central, "coupling.on_breach=stop"]).contains("must be ride with weakly-centralised"));
    let lossy = error(&[central, "bus.loss=0.1"]);
    assert!(lossy.contains("bus.loss = 0.1: must not be there with weakly-centralised coupling"), "{lossy}");
    let crowd = ["graph={kind='star',nodes=65}", "agent.state=[0,0]"];
    let crowded = error(&crowd);
    assert!(
        crowded.contains(
            "graph: node 1 has 64 neighbours with 2 components each; a node has room for 126 in all"
        ),
        "{crowded}"
    );
    assert!(read(text, &["graph={kind='star',nodes=64}", crowd[1]]).is_ok());
}

#[test]
fn a_schedule_joins_two_funnels() {
    let schedule = "coupling.funnel={kind='schedule',start=40,at='2s',eps=0.01,factor=2,\
                    then={kind='exponential',start=4,end=2,rate=0.5}}";
    let funnel = read(FILE, &[schedule]).unwrap().nodes[0].funnel;
    let joined = 0.01 * (2.0 * funnelnet_law::math::exp(-1.0) + 2.0);
    for (t, width) in [(0.0, 40.0), (1.0, (40.0 * joined).sqrt()), (2.0, joined), (1e9, 0.02)] {
        assert!((funnel.width(t) / (2.0 * width) - 1.0).abs() < 1e-12, "{t}: {}", funnel.width(t));
    }
    assert!((funnel.width(1.999_999_999) / funnel.width(2.0) - 1.0).abs() < 1e-7);
    let error = |set: &str| read(FILE, &[schedule, set]).unwrap_err().to_string();
    assert!(
        error("coupling.funnel.then.kind=reciprocal-time").contains("must be one of exponential, constant")
    );
    assert!(
        error("coupling.funnel.then={kind='constant'}")
            .contains("missing key 'width' in [coupling.funnel.then]")
    );
    assert!(
        error("coupling.funnel.then.factor=2").contains("unknown key 'factor' in [coupling.funnel.then]")
    );
    assert!(
        error("coupling.funnel.eps=0").contains("coupling.funnel.eps = 0: must be from 0.000000001 to 1 (1)")
    );
    assert!(
        error("node.1.state=99").contains("funnel start = 54 (or factor = 2.7) would do"),
        "{}",
        error("node.1.state=99")
    );
}

#[test]
fn noise_and_the_final_value_are_read() {
    let scenario =
        read(FILE, &["agent.noise=0.25", "node.3.noise=0", "expect.final_value={is=-1.5,within=0.05}"])
            .unwrap();
    assert_eq!(scenario.nodes.iter().map(|node| node.noise).collect::<Vec<_>>(), [0.25, 0.25, 0.0]);
    assert_eq!(scenario.expect.final_value, Some(FinalValue { is: -1.5, within: 0.05 }));
    assert!(set_error("agent.noise=-1").ends_with("agent.noise = -1: must be >= 0 (state units)"));
    assert!(set_error("agent.nosie=1").ends_with("did you mean 'noise'?"));
    assert!(set_error("expect.final_value=1").ends_with("expect.final_value = 1: must be a table"));
    assert!(set_error("expect.final_value={is=1}").contains("missing key 'within' in [expect.final_value]"));
    assert!(
        set_error("expect.final_value={is=1,within=1,far=2}")
            .contains("unknown key 'far' in [expect.final_value]")
    );
}

#[test]
fn graphs_that_are_no_network_are_refused() {
    let edges = |list: &str| errors("kind = \"path\"", &format!("kind = \"edges\"\nedges = {list}"));
    assert_eq!(
        edges("[[1, 2]]"),
        "dir/a.toml:10:9: graph: must be connected (Assumption 1), but it falls into 2 parts: {1, 2}, {3}; \
         add an edge between them"
    );
    assert_eq!(
        edges("[[1, 2], [2, 3, 1.0], [3, 2, 0.5]]"),
        "dir/a.toml:10:31: graph.edges[2] = [3, 2, 0.5]: must have one weight: 2 and 3 are already \
         joined with \
         weight 1, and the graph is undirected"
    );
    assert_eq!(
        edges("[[1, 2], [2, 2], [2, 3, 0], [3, 4], [1]]"),
        "dir/a.toml:10:18: graph.edges[1] = [2, 2]: must join two different nodes (no self loops)\n\
         dir/a.toml:10:33: graph.edges[2][2] = 0: must be > 0 (edge weight)\n\
         dir/a.toml:10:41: graph.edges[3][1] = 4: must be an integer from 1 to 3 ([graph] nodes)\n\
         dir/a.toml:10:45: graph.edges[4] = [1]: must be [id, id] or [id, id, weight]"
    );
    assert!(
        errors("nodes = 3", "nodes = 3\nweight = -1")
            .contains("graph.weight = -1: must be > 0 (edge weight)")
    );
    assert!(
        errors("nodes = 3", "nodes = 0").contains("must be an integer from 1 to 2000 (and a run takes 127")
    );
    assert!(
        errors("nodes = 3", "nodes = 2001").contains("graph.nodes = 2001: must be an integer from 1 to 2000")
    );
    let lattice = "kind = \"ring-lattice\"\ndegree = 3";
    assert!(
        errors("kind = \"path\"", lattice)
            .contains("10:10: graph.degree = 3: must be even and below nodes = 3")
    );
}

#[test]
fn edges_may_be_given_twice_with_one_weight() {
    let text = FILE.replace(
        "kind = \"path\"",
        "kind = \"edges\"\nweight = 2\nedges = [[3, 2], [2, 3, 2.0], [1, 2, 0.5]]",
    );
    let edge = |a, b, weight| Edge { a, b, weight };
    assert_eq!(read(&text, &[]).unwrap().graph.edges, [edge(0, 1, 0.5), edge(1, 2, 2.0)]);
}

#[test]
fn node_ids_are_checked() {
    assert!(
        errors("id = 2", "id = 4").contains("node.4.id = 4: must be an integer from 1 to 3 ([graph] nodes)")
    );
    assert!(errors("id = 2", "").contains("missing key 'id' in [node[0]]"));
    let message = errors("[expect]", "[[node]]\nid = 2\n[expect]");
    assert_eq!(message, "dir/a.toml:29:6: node.2.id = 2: must be unique: an earlier [[node]] has this id");
}

#[test]
fn a_start_outside_the_funnel_says_by_how_much_and_what_would_do() {
    assert_eq!(
        errors("state = 1.0", "state = 38.5"),
        "dir/a.toml:18:9: node 1: starts outside its funnel: |nu| = 41.5 at t = 0 must be below psi(0) = 40, \
         and is 1.5 too much (ratio 1.0375); funnel start = 44 (or factor = 1.1) would do\n\
         dir/a.toml:18:9: node 3: starts outside its funnel: |nu| = 41.5 at t = 0 must be below psi(0) = 40, \
         and is 1.5 too much (ratio 1.0375); funnel start = 44 (or factor = 1.1) would do"
    );
    let mended = FILE.replace("state = 1.0", "state = 38.5").replace("start = 40.0", "start = 44");
    assert!(read(&mended, &[]).is_ok());
}

#[test]
fn every_node_needs_dynamics() {
    let text = FILE.replace(
        "dynamics = { kind = \"affine\", slope = -1.0, sines = [{ amplitude = 10.0, frequency = 1.0 }] }",
        "",
    );
    let message = read(&text, &[]).unwrap_err().to_string();
    assert!(message.contains("missing key 'dynamics' in [agent]: node 1 has none"), "{message}");
}

#[test]
fn a_zero_end_is_allowed_for_exponential_funnels() {
    assert!(read(FILE, &["coupling.funnel.end=0"]).is_ok());
}

#[test]
fn overrides_from_the_command_line_apply_and_are_blamed() {
    let sets = [
        "time.tick=2ms",
        "coupling.funnel.rate=0.5",
        "node.2.state=5",
        "node.3.funnel.factor=2",
        "agent.dynamics.sines=[]",
        "graph={kind=\"star\",nodes=3}",
        "bus.loss=0.25",
        "title=Two words",
    ];
    let scenario = read(FILE, &sets).unwrap();
    assert_eq!(scenario.time.ticks, 1_000);
    assert_eq!(scenario.nodes[1].state, [5.0]);
    assert_eq!(
        scenario.nodes[2].funnel,
        Funnel { factor: 2.0, shape: Shape::Exponential { start: 40.0, end: 2.0, rate: 0.5 } }
    );
    assert!(scenario.nodes.iter().all(|node| node.dynamics.sines().is_empty()));
    assert_eq!(scenario.graph.degrees()[0], 2.0);
    assert_eq!(scenario.bus.loss, Loss::independent(0.25));
    assert_eq!(scenario.title, "Two words");
    assert_eq!(
        set_error("coupling.funnel.rate=-1"),
        "--set coupling.funnel.rate=-1: coupling.funnel.rate = -1: must be > 0 (1/s)"
    );
    assert_eq!(
        set_error("bus.los=0.1"),
        "--set bus.los=0.1: unknown key 'los' in [bus]; known: model, loss, latency, jitter; did \
         you mean 'loss'?"
    );
    assert!(set_error("seed.x=1").contains("seed is an integer, so it has no key 'x'"));
    assert!(set_error("node.x.state=1").contains("'x' is not an id"));
    assert!(set_error("node.9.state=1").contains("node.9.id = 9: must be an integer from 1 to 3"));
    assert!(
        set_error("agent.dynamics.sines.4.phase=1").contains("agent.dynamics.sines has 1, counted from 0")
    );
    assert!(Override::parse("nonsense").is_err() && Override::parse("a..b=1").is_err());
}

#[test]
fn syntax_errors_and_missing_sections_are_placed() {
    let message = errors("nodes = 3", "nodes = = 3");
    assert!(message.starts_with("dir/a.toml:10:9: not valid TOML: "), "{message}");
    assert!(errors("nodes = 3", "nodes = 3\nnodes = 4").contains("duplicate key"));
    let message = read("version = 1", &[]).unwrap_err().to_string();
    assert_eq!(message.lines().count(), 3);
    assert!(message.starts_with("dir/a.toml:1:1: missing key 'time' in the file: must be a section [time]"));
    assert!(errors("version = 1\n", "").contains("write version = 1"));
    assert!(
        errors("version = 1", "version = 2").contains("version = 2: must be 1 (the version of this format")
    );
}

#[test]
fn one_node_and_the_whole_id_space_work() {
    assert_eq!(read(FILE, &["graph.nodes=127"]).unwrap().nodes.last().unwrap().id, 127);
    let text = FILE.split("[[node]]").next().unwrap();
    let scenario = read(text, &["graph.nodes=1"]).unwrap();
    assert_eq!((scenario.nodes.len(), scenario.graph.lambda2(), scenario.sync_bound(1.0)), (1, 0.0, 0.0));
}

#[test]
fn random_graphs_depend_on_the_seed_alone() {
    let graph = "graph={kind=\"random-regular\",nodes=30,degree=4}";
    let draw = |seed: &str| read(FILE, &[graph, seed]).unwrap().graph;
    assert_eq!(draw("seed=3"), draw("seed=3"));
    assert_ne!(draw("seed=3"), draw("seed=4"));
    let message = set_error("graph={kind=\"erdos-renyi\",nodes=60,probability=0.001}");
    assert!(message.contains("gave no connected graph in 1000 draws"), "{message}");
}

#[test]
fn an_override_of_another_kind_starts_afresh() {
    let constant = "node.2.funnel={kind=\"constant\",width=90}";
    let scenario = read(FILE, &[constant]).unwrap();
    assert_eq!(scenario.nodes[1].funnel, Funnel { factor: 1.0, shape: Shape::Constant { width: 90.0 } });
    let same = "node.2.funnel={kind=\"exponential\",end=1}";
    let funnel = Funnel { factor: 1.0, shape: Shape::Exponential { start: 40.0, end: 1.0, rate: 1.0 } };
    assert_eq!(read(FILE, &[same]).unwrap().nodes[1].funnel, funnel);
}

#[test]
fn damaged_files_never_panic_and_errors_always_say_something() {
    use rand_pcg::rand_core::Rng;
    let mut generator = crate::random::stream(1, crate::random::Purpose::Graph, 99);
    let pieces = [
        "",
        "=",
        "[",
        "]]",
        "{",
        "\"",
        "\n",
        "-",
        "0",
        "1e999",
        "nan",
        "µ",
        "[[node]]\n",
        "true",
        "9999999999",
    ];
    for _ in 0..5_000 {
        let mut text: Vec<char> = FILE.chars().collect();
        for _ in 0..=crate::random::below(&mut generator, 3) {
            let at = crate::random::below(&mut generator, text.len());
            let end = (at + (generator.next_u64() % 4) as usize).min(text.len());
            let piece = pieces[crate::random::below(&mut generator, pieces.len())];
            text.splice(at..end, piece.chars());
        }
        let text: String = text.into_iter().collect();
        if let Err(errors) = read(&text, &[]) {
            assert!(!errors.0.is_empty() && errors.0.iter().all(|error| !error.allowed.is_empty()), "{text}");
        }
    }
}

#[test]
fn what_no_node_takes_is_refused_with_its_place() {
    let set = |key: &str, value: &str| set_error(&format!("{key}={value}"));
    for (key, value, text) in [
        ("agent.state", "1e12", "must be at most 1e9 in size, to suit a node (state units)"),
        (
            "graph.weight",
            "1e-12",
            "must be at least 1e-9 and at most 1e6 in size, to suit a node (edge weight)",
        ),
        (
            "coupling.funnel.rate",
            "1e7",
            "must be at least 1e-9 and at most 1e6 in size, to suit a node (1/s)",
        ),
        ("time.tick", "1us", "must be from 10us to 4.294967295s, to suit a node"),
        ("time.tick", "5s", "must be from 10us to 4.294967295s, to suit a node"),
        ("bus.latency", "255ms", "later frames would pass for new ones"),
        ("bus.jitter", "500000h", "later frames would pass for new ones"),
        ("graph.weight", "9e5", "the weights of node 2 add up to 1.8e6; a node takes 1e6 at most"),
    ] {
        let error = set(key, value);
        assert!(error.starts_with(&format!("--set {key}={value}: ")) || error.contains("graph: "), "{error}");
        assert!(error.contains(text), "{error}");
    }
    let sines = ["{ amplitude = 1, frequency = 1 }"; 9].join(",");
    assert!(set("agent.dynamics.sines", &format!("[{sines}]")).contains("at most 8 sines"));
    assert!(read(FILE, &["bus.latency=240ms"]).is_ok());
}

#[test]
fn what_the_reader_takes_a_node_takes() {
    let drive = Drive { tick_source: TickSource::Sync, telemetry_every: 1, is_simulated: false };
    for sets in [
        &["time.tick=10us"][..],
        &["time.tick=4s", "time.duration=8s"],
        &["graph.weight=1e-9", "coupling.gain.scale=1e-9", "coupling.funnel.rate=1e-9"],
        &[
            "coupling.funnel.start=1e9",
            "node.2.funnel.factor=1e9",
            "node.1.state=1e9",
            "coupling.funnel.factor=1e3",
        ],
        &["coupling.funnel.end=1e-20", "agent.dynamics.slope=-1e6", "agent.dynamics.offset=1e-20"],
        &["graph.weight=5e5", "coupling.funnel.start=1e9", "coupling.gain.scale=1e9"],
        &[
            "coupling.gain={kind='locally-linear',bound=1e9}",
            "coupling.funnel={kind='reciprocal-time',scale=1e9}",
        ],
        VECTOR,
        &["agent.state=[0,0,0,0,0,0,0,0]", "agent.dynamics.sines=[]", "coupling.kind=element-wise"],
        &["coupling.kind=max-gain", "coupling.on_breach={kind='reopen',margin=1e6,rate=1e6}"],
        &["coupling.kind=none", "coupling.on_breach={kind='reopen',margin=1.01,rate=1e-9}"],
        &[
            "coupling.kind=lambda-tracker",
            "coupling.eta=0",
            "coupling.gain={kind='linear',slope=1e9}",
            "node.2.gain={kind='linear',slope=1e-9}",
        ],
        &["coupling.funnel={kind='schedule',start=40,at='2s',eps=1e-9,then={kind='constant',width=1e-9}}"],
        &[
            "coupling.funnel={kind='schedule',start=1e9,at='1ns',eps=1,then={kind='exponential',start=1e9,end=0,rate=1e6}}",
        ],
        &[
            "coupling.gain={kind='median',eta=1e-9,eps=0.999}",
            "coupling.funnel={kind='finite-time',start=1e9,at='1s',power=10}",
        ],
    ] {
        let scenario = read(FILE, sets).unwrap();
        for config in node_configs(&scenario, drive).unwrap() {
            let params = Params::<f32>::new(&config);
            assert!(params.is_ok(), "{sets:?}: {}", params.unwrap_err());
        }
    }
}

#[test]
fn safety_is_read_and_refused_by_name() {
    let safety = |sets: &[&str]| read(FILE, sets).unwrap().safety;
    assert_eq!(safety(&[]), SafetySpec::default());
    let set = safety(&["safety.lost_neighbours=2", "safety.holdover=500ms"]);
    let expected = SafetySpec { lost_neighbours: 2, holdover_ns: Some(500_000_000), ..SafetySpec::default() };
    assert_eq!(set, expected);
    let set = safety(&["safety.heard_limit=50", "safety.heard_rate=200", "safety.drop_after=20"]);
    let expected = SafetySpec {
        heard_limit: Some(50.0),
        heard_rate: Some(200.0),
        drop_after: 20,
        ..SafetySpec::default()
    };
    assert_eq!(set, expected);
    assert_eq!(safety(&["safety.heard_rate=200"]).drop_after, 10);
    assert_eq!(safety(&["safety.heard_limit=50", "safety.drop_after=0"]).drop_after, 0);
    for (key, value, text) in [
        (
            "lost_neighbours",
            "127",
            "must be an integer from 0 to 126 (neighbours lost at once; 0 never stops)",
        ),
        ("lost_neighbours", "-1", "must be an integer from 0 to 126"),
        ("holdover", "0.5", "must be a duration with a unit"),
        ("holdover", "100us", "must be from 1ms to 3600s, from a tick to an hour without SYNC"),
        ("holdover", "2h", "must be from 1ms to 3600s"),
        ("holdovr", "1s", "did you mean 'holdover'?"),
        ("heard_limit", "0", "heard_limit"),
        ("heard_limit", "0.001", "must be at least the size of each initial state; node"),
        ("heard_rate", "-1", "heard_rate"),
        ("heard_rate", "nan", "heard_rate"),
        ("drop_after", "256", "must be an integer from 0 to 255 (states in a row; 0 never does)"),
        ("drop_after", "3", "does nothing without safety.heard_limit or safety.heard_rate"),
    ] {
        let error = set_error(&format!("safety.{key}={value}"));
        assert!(error.contains(text), "{error}");
    }
    let drive = Drive { tick_source: TickSource::Sync, telemetry_every: 1, is_simulated: false };
    let scenario = read(FILE, &["safety.lost_neighbours=2", "safety.holdover=1ms"]).unwrap();
    for config in node_configs(&scenario, drive).unwrap() {
        assert_eq!((config.lost_neighbours, config.holdover_ns), (2, 1_000_000));
        assert!(Params::<f32>::new(&config).is_ok() && config.heard.is_none());
    }
    let heard = ["safety.heard_limit=50", "safety.heard_rate=200", "safety.drop_after=20"];
    for config in node_configs(&read(FILE, &heard).unwrap(), drive).unwrap() {
        assert_eq!(config.heard, HeardLimits { limit: 50.0, rate: 200.0, drop_after: 20 });
        assert!(Params::<f32>::new(&config).is_ok());
    }
    let weak = ["coupling.kind=weakly-centralised", "safety.heard_rate=200"];
    let error = read(FILE, &weak).unwrap_err().to_string();
    assert!(error.contains("is not for weakly-centralised coupling"), "{error}");
}

#[test]
fn the_slope_of_a_funnel_is_its_derivative() {
    let funnels = [
        Funnel { factor: 3.0, shape: Shape::Exponential { start: 40.0, end: 2.0, rate: 0.7 } },
        Funnel { factor: 3.0, shape: Shape::Constant { width: 2.0 } },
        Funnel { factor: 0.5, shape: Shape::ReciprocalTime { scale: 5.0 } },
        Funnel { factor: 2.0, shape: Shape::FiniteTime { start: 10.0, at_ns: 2_000_000_000, power: 1.5 } },
        Funnel {
            factor: 2.0,
            shape: Shape::Schedule {
                start: 9.0,
                at_ns: 3_000_000_000,
                eps: 0.5,
                then: Normalised::Exponential { start: 5.0, end: 1.0, rate: 0.4 },
            },
        },
    ];
    for funnel in funnels {
        for t in [0.3, 1.9, 2.0, 7.0] {
            let difference = (funnel.width(t + 1e-6) - funnel.width(t - 1e-6)) / 2e-6;
            // The finite-time funnel closes at 2 s with a slope that is zero only there.
            let tolerance = if t == 2.0 { 0.02 } else { 1e-6 };
            assert!((funnel.slope(t) - difference).abs() < tolerance, "{funnel:?} at {t}: {difference}");
        }
    }
}

#[test]
fn many_mistakes_of_one_kind_do_not_fill_the_screen() {
    // Every node but the middle one of 60 has a funnel that is far too narrow on a star.
    let sets =
        ["graph.kind=star", "graph.nodes=60", "coupling.funnel.start=0.001", "coupling.funnel.end=0.001"];
    let states: Vec<_> = (1..=60).map(|id| format!("node.{id}.state={id}")).collect();
    let sets: Vec<_> = sets.into_iter().chain(states.iter().map(String::as_str)).collect();
    let told = read(FILE, &sets).unwrap_err().to_string();
    assert_eq!(told.lines().count(), 21, "{told}");
    assert!(told.ends_with("\nand 40 more"), "{told}");
}

#[test]
fn the_unit_of_the_states_is_read_and_fits_on_an_axis() {
    assert_eq!(read(FILE, &[]).unwrap().unit, None);
    assert_eq!(read(FILE, &["agent.unit=\"degC\""]).unwrap().unit.as_deref(), Some("degC"));
    for wrong in ["3", "\"\"", "\"a\\u001bb\"", "\"seventeen letters\""] {
        let error = set_error(&format!("agent.unit={wrong}"));
        assert!(
            error.contains("must be a string of 1 to 16 characters without control characters"),
            "{error}"
        );
    }
}

#[cfg(unix)]
#[test]
fn what_goes_on_for_ever_is_no_scenario() {
    let found = Scenario::load(Path::new("/dev/zero"), &[]).unwrap_err().to_string();
    assert_eq!(found, "/dev/zero: is no scenario: it has more than 8 MiB");
}

#[test]
fn thirty_thousand_mistakes_are_counted_and_twenty_spelt_out() {
    let keys: String = (0..30_000).map(|i| format!("key{i} = 1\n")).collect();
    let found = Scenario::parse(&keys, Path::new("many.toml"), &[]).unwrap_err();
    assert!(found.0.len() >= 30_000);
    assert_eq!(found.to_string().lines().count(), 21);
}

/// FILE with an expression for all nodes.
fn expressed(f: &str, more: &[&str]) -> Result<Scenario, Diagnostics> {
    let dynamics = format!("agent.dynamics={{kind='expression',f={f}}}");
    let drop = ["node.2.dynamics={kind='expression',f='-0.5*x'}"];
    read(FILE, &[&[dynamics.as_str()], &drop[..], more].concat())
}

#[test]
fn an_expression_is_a_field() {
    let scenario = expressed("'-x + 3*tanh(x) + 2*sin(0.5*t)'", &[]).unwrap();
    let field = scenario.nodes[0].dynamics.expression().unwrap();
    assert_eq!(field.text, ["-x + 3*tanh(x) + 2*sin(0.5*t)"]);
    let (t, x) = (1.5, 0.25);
    let expected = -x + 3.0 * funnelnet_law::Real::tanh(x) + 2.0 * funnelnet_law::math::sin(0.5 * t);
    assert!((scenario.nodes[0].dynamics.value(t, x) - expected).abs() < 1e-15);
    assert_eq!(scenario.nodes[1].dynamics.value(t, 4.0), -2.0);
    let vector = ["agent.state=[1, 2]", "node.2.dynamics={kind='expression',f=['x1','x2']}"];
    let scenario = expressed("['x2', '-x1 - 0.1*x2 + cos(t)']", &vector).unwrap();
    assert!((scenario.nodes[2].dynamics.component(1, 0.0, &[1.0, 2.0]) + 0.2).abs() < 1e-15);
}

#[test]
fn a_mistake_in_an_expression_is_shown_in_the_file() {
    let text = |f: &str| format!("kind = \"expression\", f = {f}");
    let of = |f: &str| {
        errors("kind = \"affine\", slope = -1.0, sines = [{ amplitude = 10.0, frequency = 1.0 }]", &text(f))
    };
    let column = |message: &str| -> usize { message.split(':').nth(2).unwrap().parse().unwrap() };
    let message = of("\"-x + foo(x)\"");
    assert!(
        message.contains("agent.dynamics.f = \"-x + foo(x)\": in column 6 of it, nothing is called 'foo'"),
        "{message}"
    );
    let begin = column(&of("3"));
    assert_eq!(column(&message), begin + 6);
    assert_eq!(column(&of("'x +'")), begin + 4);
    // Where the text is not written as it is, its beginning is shown.
    assert_eq!(column(&of("\"\\u0078 +\"")), begin);
    assert!(of("3").contains("must be an expression in quotes"));
    assert!(
        of("\"ln(x - 1)\"").contains("must be finite at the start: component 1 is -inf at t = 0, x = [1.0]")
    );
    assert!(of("[\"x\", \"t\"]").contains("nothing is called 'x'; known: x1, x2, t, pi"));
}

#[test]
fn limits_leave_room_for_no_input() {
    let scenario = read(FILE, &["agent.limits={low=-1,high=5}", "node.2.limits={low=0,high=2}"]).unwrap();
    let limits = |index: usize| scenario.nodes[index].limits.unwrap();
    assert_eq!(
        (limits(0), limits(1)),
        (InputLimits { low: -1.0, high: 5.0 }, InputLimits { low: 0.0, high: 2.0 })
    );
    for wrong in ["{low=1,high=5}", "{low=0,high=0}", "{low=-1,high=-2}"] {
        let error = read(FILE, &[&format!("agent.limits={wrong}")]).unwrap_err().to_string();
        assert!(error.contains("must have low <= 0 <= high and low < high"), "{error}");
    }
    assert!(read(FILE, &["agent.limits={low=-1}"]).unwrap_err().to_string().contains("missing key 'high'"));
}

#[test]
fn inputs_are_read_beside_the_scenario() {
    let folder = tempfile::tempdir().unwrap();
    std::fs::write(folder.path().join("load.csv"), "t,p_kw\n0,1\n2,3\n").unwrap();
    let read = |sets: &[&str]| {
        let other = "node.2.dynamics={kind='expression',f='-x'}";
        let sets: Vec<_> = sets.iter().chain([&other]).map(|set| Override::parse(set).unwrap()).collect();
        Scenario::parse(FILE, &folder.path().join("a.toml"), &sets)
    };
    let f = "agent.dynamics={kind='expression',f='-x + load'}";
    let inputs = "agent.inputs={load={file='load.csv',time='t',column='p_kw'}}";
    let scenario = read(&[f, inputs]).unwrap();
    assert_eq!(scenario.nodes[0].dynamics.value(1.0, 5.0), -3.0);
    let wrong = |sets: &[&str]| read(sets).unwrap_err().to_string();
    assert!(wrong(&[f]).contains("nothing is called 'load'"));
    assert!(wrong(&[f, inputs, "time.duration=3s"]).contains("known from 0 s to 2 s"));
    assert!(
        wrong(&[f, "agent.inputs={sin={file='load.csv',column='p_kw'}}"])
            .contains("an input is named by a letter")
    );
    assert!(
        wrong(&[f, "agent.inputs={a={file='load.csv',column='q'}}"])
            .contains("has no column 'q'; it has t, p_kw")
    );
    assert!(wrong(&[f, "agent.inputs={a={file='load.csv'}}"]).contains("missing key 'column'"));
}
