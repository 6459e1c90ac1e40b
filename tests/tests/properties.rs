//! What holds on every network: random connected weighted graphs, mixed gains, mixed funnels, affine fields.
//! The f32 node behind the loopback engine, every state through a CAN frame.
#![allow(clippy::unwrap_used, clippy::panic, reason = "helpers of tests, which clippy does not know as such")]

use funnelnet_law::emergent::runge_kutta;
use funnelnet_law::math::exp10;
use funnelnet_law::start::SlowStart;
use funnelnet_node::{Node, Params};
use funnelnet_protocol::NodeConfig;
use funnelnet_protocol::config::TickSource;
use proptest::prelude::*;
use proptest::strategy::ValueTree;
use proptest::test_runner::{RngAlgorithm, TestRng, TestRunner};
use sim_host::bus::ideal::{IdealBus, IdealParams};
use sim_host::check::{check, taken_of_narrowest};
use sim_host::configure::{Drive, listeners, node_configs};
use sim_host::engine::Engine;
use sim_host::record::Row;
use sim_host::run::{Fidelity, Outcome};
use sim_host::scenario::{Affine, Edge, Funnel, Gain, Graph, NodeSpec, Scenario, Shape, Sine, TimeSpec};
use system_tests::run;

const TICKS: u64 = 1500;
const TICK_NS: u64 = 2_000_000;

fn decades(low: f64, high: f64) -> impl Strategy<Value = f64> {
    (low..high).prop_map(exp10)
}

fn field() -> impl Strategy<Value = Affine> {
    let sine = (0.0..5.0f64, 0.1..5.0f64, 0.0..6.0f64);
    (-2.0..0.3f64, -5.0..5.0f64, sine).prop_map(|(slope, offset, (amplitude, frequency, phase))| {
        Affine::scalar(slope, offset, vec![Sine { component: 0, amplitude, frequency, phase }])
    })
}

fn gain() -> impl Strategy<Value = Gain<f64>> {
    (0..3, decades(0.5, 1.5)).prop_map(|(kind, scale)| match kind {
        0 => Gain::Reciprocal { scale },
        1 => Gain::Logarithmic { scale },
        _ => Gain::LocallyLinear { bound: scale },
    })
}

/// A node, with a funnel that starts as wide as the test says later.
fn node() -> impl Strategy<Value = NodeSpec> {
    let funnel = (decades(-2.0, 0.0), 0.5..4.0f64, decades(-0.3, 0.3)).prop_map(|(end, rate, factor)| {
        Funnel { factor, shape: Shape::Exponential { start: 0.0, end, rate } }
    });
    (-3.0..3.0f64, field(), gain(), funnel).prop_map(|(state, dynamics, gain, funnel)| NodeSpec {
        id: 0,
        state: vec![state],
        dynamics: dynamics.into(),
        limits: None,
        gain,
        funnel,
        damping: 2.2,
        noise: 0.0,
        compute_ns: 0,
    })
}

/// A random tree with extra edges, weights over two decades. In order of (a, b), each edge once.
fn graph(nodes: usize) -> impl Strategy<Value = Graph> {
    let parents = proptest::collection::vec((0.0..1.0f64, decades(-1.0, 1.0)), nodes);
    let extra = proptest::collection::vec((0..nodes, 0..nodes, decades(-1.0, 1.0)), 0..nodes);
    (parents, extra).prop_map(move |(parents, extra)| {
        let mut weights = std::collections::BTreeMap::new();
        for (i, &(share, weight)) in parents.iter().enumerate().skip(1) {
            weights.insert(((share * i as f64) as usize, i), weight);
        }
        for (i, j, weight) in extra.into_iter().filter(|(i, j, _)| i != j) {
            weights.insert((i.min(j), i.max(j)), weight);
        }
        // As the nodes hold them.
        let edge = |((a, b), weight): (_, f64)| Edge { a, b, weight: f64::from(weight as f32) };
        Graph { nodes, edges: weights.into_iter().map(edge).collect() }
    })
}

/// All nodes start inside their funnels.
fn network() -> impl Strategy<Value = Scenario> {
    (2usize..9).prop_flat_map(|n| (graph(n), proptest::collection::vec(node(), n))).prop_map(build)
}

fn build((graph, mut nodes): (Graph, Vec<NodeSpec>)) -> Scenario {
    let states: Vec<f64> = nodes.iter().map(|node| node.state[0]).collect();
    for ((i, node), nu) in nodes.iter_mut().enumerate().zip(graph.diffusive_terms(&states)) {
        node.id = i as u16 + 1;
        let factor = node.funnel.factor;
        if let Shape::Exponential { start, end, .. } = &mut node.funnel.shape {
            *start = *end + 1.2 * nu.abs() / factor + 1.0;
        }
    }
    let base = system_tests::scenario("five-agents.toml", &[]);
    Scenario {
        graph,
        nodes,
        time: TimeSpec { tick_ns: TICK_NS, ticks: TICKS, round: 1, start: SlowStart::default() },
        ..base
    }
}

fn simulate(scenario: &Scenario) -> Outcome {
    run(scenario, Fidelity::Loopback)
}

/// The tick that `check` asks for, with its margin; over as many ticks.
fn with_the_tick_of_check(scenario: &Scenario) -> Scenario {
    let share = taken_of_narrowest(scenario).unwrap();
    // Twice as much room as where it warns.
    let factor = (0.25 / share).sqrt().min(1.0);
    let tick_ns = (TICK_NS as f64 * factor) as u64;
    let ticks = TICKS * TICK_NS / tick_ns;
    Scenario { time: TimeSpec { tick_ns, ticks, ..scenario.time }, ..scenario.clone() }
}

/// The same network with node i called `to[i]`.
fn renamed(scenario: &Scenario, to: &[usize]) -> Scenario {
    let mut nodes = scenario.nodes.clone();
    for (i, node) in scenario.nodes.iter().enumerate() {
        nodes[to[i]] = NodeSpec { id: to[i] as u16 + 1, ..node.clone() };
    }
    let rename = |edge: &Edge| Edge {
        a: to[edge.a].min(to[edge.b]),
        b: to[edge.a].max(to[edge.b]),
        weight: edge.weight,
    };
    let mut edges: Vec<_> = scenario.graph.edges.iter().map(rename).collect();
    edges.sort_by_key(|edge| (edge.a, edge.b));
    Scenario { nodes, graph: Graph { nodes: to.len(), edges }, ..scenario.clone() }
}

/// A permutation of 0..n out of a number.
fn permutation(n: usize, mut number: u64) -> Vec<usize> {
    let mut rest: Vec<usize> = (0..n).collect();
    (0..n)
        .map(|_| {
            let at = (number % rest.len() as u64) as usize;
            number /= rest.len() as u64;
            rest.remove(at)
        })
        .collect()
}

/// Largest difference between node i of `left` and node `to[i]` of `right`, over all rows and of `column`.
fn apart(left: &[Row], right: &[Row], to: &[usize], column: fn(&Row) -> &[f64]) -> f64 {
    assert_eq!(left.len(), right.len());
    let of_row = |(left, right): (&Row, &Row)| {
        let differ = |(i, &at): (usize, &usize)| (column(left)[i] - column(right)[at]).abs();
        to.iter().enumerate().map(differ).max_by(f64::total_cmp).unwrap()
    };
    left.iter().zip(right).map(of_row).max_by(f64::total_cmp).unwrap()
}

/// The paper's bounds on every state (Lemma finite): solutions of `max_i f_i` and `min_i f_i` from the
/// extreme states.
fn extremes(scenario: &Scenario) -> Vec<(f64, f64)> {
    const SUBSTEPS: u64 = 4;
    let tick = scenario.time.tick_s();
    let fields = |t: f64, x: f64| scenario.nodes.iter().map(move |node| node.dynamics.value(t, x));
    let highest = |t: f64, x: f64| fields(t, x).fold(f64::NEG_INFINITY, f64::max);
    let lowest = |t: f64, x: f64| fields(t, x).fold(f64::INFINITY, f64::min);
    let states = scenario.initial_states();
    let mut low = states.iter().copied().fold(f64::INFINITY, f64::min);
    let mut high = states.iter().copied().fold(f64::NEG_INFINITY, f64::max);
    let mut bounds = vec![(low, high)];
    for k in 0..scenario.time.ticks {
        for part in 0..SUBSTEPS {
            let (t, step) = ((k as f64 + part as f64 / SUBSTEPS as f64) * tick, tick / SUBSTEPS as f64);
            low = runge_kutta(t, low, step, lowest);
            high = runge_kutta(t, high, step, highest);
        }
        bounds.push((low, high));
    }
    bounds
}

fn cases(count: u32) -> ProptestConfig {
    ProptestConfig { failure_persistence: None, ..ProptestConfig::with_cases(count) }
}

proptest! {
    #![proptest_config(cases(24))]

    /// What one end of an edge pulls by, the other is pulled by; the rest is the rounding of the sums and of
    /// the carry.
    #[test]
    fn diffusive_terms_add_up_to_nothing(scenario in network()) {
        let degrees: f64 = scenario.graph.degrees().iter().sum();
        for row in &simulate(&scenario).rows {
            let largest = row.x.iter().map(|x| x.abs()).fold(0.0, f64::max);
            let sum: f64 = row.nu.iter().sum();
            prop_assert!(sum.abs() <= 2.0 * f64::from(f32::EPSILON) * degrees * largest, "{sum:e} at {} s", row.t);
        }
    }

    /// The slack is a thousandth of what the fields move the states by in a tick.
    #[test]
    fn states_stay_between_the_extreme_fields(scenario in network()) {
        let fields = |row: &Row| {
            let size = |(node, x): (&NodeSpec, &f64)| node.dynamics.value(row.t, *x).abs();
            scenario.nodes.iter().zip(&row.x).map(size).fold(0.0, f64::max)
        };
        for (row, (low, high)) in simulate(&scenario).rows.iter().zip(extremes(&scenario)) {
            let slack = 1e-3 * scenario.time.tick_s() * fields(row);
            for x in &row.x {
                prop_assert!(*x >= low - slack && *x <= high + slack, "{x} not in {low}..{high} at {} s", row.t);
            }
        }
    }

    /// `check` knows how fast the fields drift apart, not how fast neighbours still move in the first
    /// hundredths of a second, when the coupling itself moves them. Of 20,000 networks some ten passed 1, by
    /// up to 1.13 there and by up to 1.02 later.
    #[test]
    fn the_funnel_is_kept_at_the_tick_that_check_asks_for(scenario in network()) {
        let outcome = simulate(&with_the_tick_of_check(&scenario));
        for row in &outcome.rows {
            let ratio = row.nu.iter().zip(&row.psi).map(|(nu, psi)| nu.abs() / psi).fold(0.0, f64::max);
            let limit = if row.t < 0.1 { 1.5 } else { 1.1 };
            prop_assert!(ratio < limit, "{ratio} at {} s", row.t);
        }
    }

    /// Sums go by the order of the neighbour table, that is of the ids.
    #[test]
    fn names_do_not_matter_but_for_rounding(scenario in network(), number: u64) {
        let to = permutation(scenario.nodes.len(), number);
        let (before, after) = (simulate(&scenario), simulate(&renamed(&scenario, &to)));
        let states = apart(&before.rows, &after.rows, &to, |row| &row.x);
        prop_assert!(states < 3e-5, "{states:e}");
    }

    /// With two neighbours or fewer a sum has no order: to the last bit.
    #[test]
    fn names_do_not_matter_at_all_on_rings_and_paths(scenario in network(), closed: bool, number: u64) {
        let scenario = ring_or_path(scenario, closed);
        let to = permutation(scenario.nodes.len(), number);
        let (before, after) = (simulate(&scenario), simulate(&renamed(&scenario, &to)));
        let columns: [fn(&Row) -> &[f64]; 4] = [|row| &row.x, |row| &row.nu, |row| &row.psi, |row| &row.u];
        for column in columns {
            prop_assert_eq!(apart(&before.rows, &after.rows, &to, column), 0.0);
        }
    }
}

#[test]
fn the_tick_is_the_one_that_check_asks_for() {
    let mut runner = TestRunner::new_with_rng(cases(1), TestRng::deterministic_rng(RngAlgorithm::ChaCha));
    for _ in 0..3 {
        let scenario = network().new_tree(&mut runner).unwrap().current();
        let found =
            check(&scenario).findings.into_iter().find(|found| found.name == "narrowest-funnel").unwrap();
        let share = found.values["narrowest"].as_f64().unwrap() / found.values["psi_min"].as_f64().unwrap();
        assert_eq!(taken_of_narrowest(&scenario), Some(share));
    }
}

/// A ratio `|nu| / psi`, and the tick that has it.
type Ratio = (f64, u64);

/// The largest `|nu| / psi` of a run before tick `from` and from there on. Without rows, predictions and
/// verdicts, which would take most of the time.
fn ratios(scenario: &Scenario, from: u64) -> (Ratio, Ratio) {
    let drive = Drive { tick_source: TickSource::Timer, telemetry_every: 0, is_simulated: true };
    let node = |config: &NodeConfig| Node::new(Params::new(config).unwrap(), &config.neighbours);
    let nodes = node_configs(scenario, drive).unwrap().iter().map(node).collect();
    let bus = IdealBus::new(IdealParams::default(), scenario.seed, listeners(scenario));
    let mut engine = Engine::new(nodes, bus);
    engine.start();
    let (mut before, mut after): (Ratio, Ratio) = ((0.0, 0), (0.0, 0));
    for k in 0..=scenario.time.ticks {
        let seen = engine.advance().unwrap();
        // What is not a number is the largest.
        let ratio = seen.iter().map(|seen| f64::from(seen.ratio)).max_by(f64::total_cmp).unwrap();
        let most = if k < from { &mut before } else { &mut after };
        if ratio > most.0 || ratio.is_nan() {
            *most = (ratio, k);
        }
    }
    // All of them ran to the end.
    assert!(engine.nodes().iter().all(|node| node.counters().ticks > scenario.time.ticks as u32));
    (before, after)
}

/// Networks that left their funnels.
#[derive(Default)]
struct Left {
    count: usize,
    /// Number, largest ratio and its tick of the worst.
    worst: (u32, Ratio),
}

impl Left {
    fn note(&mut self, number: u32, ratio: Ratio) {
        // What is not a number is not inside.
        let inside = ratio.0 < 1.0;
        self.count += usize::from(!inside);
        if ratio.0 > self.worst.1.0 {
            self.worst = (number, ratio);
        }
    }
}

impl std::fmt::Display for Left {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let (number, (ratio, tick)) = self.worst;
        write!(f, "{} outside, the worst is network {number} with {ratio:.4} at tick {tick}", self.count)
    }
}

/// How many networks are tried says FUNNEL_NETWORKS, and which is the first of them FUNNEL_FIRST. With a
/// guard of 5 % none is outside later than a hundred ticks after its start; what happens before is counted.
/// With a slow start of 10 ms and a guard of 10 % all but two in 20,000 are inside from the first tick on.
#[test]
#[ignore = "minutes: ./ci.sh extended"]
fn with_a_guard_no_network_is_outside_after_its_start_and_with_a_slow_start_none_at_all() {
    const START: u64 = 100;
    let told = |name: &str, default| std::env::var(name).map_or(default, |text| text.parse().unwrap());
    let (first, count): (u32, u32) = (told("FUNNEL_FIRST", 0), told("FUNNEL_NETWORKS", 20_000));
    let mut runner = TestRunner::new_with_rng(cases(1), TestRng::deterministic_rng(RngAlgorithm::ChaCha));
    let (mut at_the_start, mut later, mut slow) = (Left::default(), Left::default(), Left::default());
    for number in 0..count {
        let network = network().new_tree(&mut runner).unwrap().current();
        if number < first {
            continue;
        }
        let network = with_the_tick_of_check(&network);
        let (before, after) = ratios(&Scenario { guard: 0.05, ..network.clone() }, START);
        at_the_start.note(number, before);
        later.note(number, after);
        let (before, after) = ratios(&slowly_started(network), START);
        slow.note(number, if before.0 > after.0 { before } else { after });
        if (number + 1).is_multiple_of(100) || number + 1 == count {
            println!(
                "{} networks. Guard 0.05, first {START} ticks: {at_the_start}; later: {later}. Slow start, guard 0.1: {slow}",
                number + 1
            );
        }
    }
    assert_eq!(later.count, 0, "{later}");
    assert!(slow.count <= 2 * (count as usize).div_ceil(20_000), "{slow}");
}

/// A network with a slow start of 10 ms, or the next whole number of ticks, and a guard of 10 %.
fn slowly_started(network: Scenario) -> Scenario {
    let time = network.time;
    let start = SlowStart::new(10_000_000u64.div_ceil(time.tick_ns) as u16);
    let ticks = time.ticks + u64::from(start.behind());
    Scenario { guard: 0.1, time: TimeSpec { ticks, start, ..time }, ..network }
}

/// The same nodes in a row; `closed` joins the ends.
fn ring_or_path(scenario: Scenario, closed: bool) -> Scenario {
    let nodes = scenario.nodes.len();
    let weight = |i: usize| f64::from(0.5 + 0.3 * i as f32);
    let mut edges: Vec<_> = (1..nodes).map(|b| Edge { a: b - 1, b, weight: weight(b) }).collect();
    if closed && nodes > 2 {
        edges.push(Edge { a: 0, b: nodes - 1, weight: weight(0) });
    }
    edges.sort_by_key(|edge| (edge.a, edge.b));
    build((Graph { nodes, edges }, scenario.nodes))
}
