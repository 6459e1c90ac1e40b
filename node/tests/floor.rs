//! The floor of the funnel against the rounding that it is there for.
#![allow(clippy::unwrap_used, reason = "helpers of tests, which clippy does not know as such")]

use funnelnet_law::floor::{Floor, ROUNDING};
use funnelnet_node::{Action, Node, Params};
use funnelnet_protocol::config::{EdgeConfig, Field, Funnel, Gain, NodeConfig, Shape};
use funnelnet_protocol::message::{Command, Message, Target};

/// A network of nodes with fields `offset - x`, in lockstep, every state heard in time.
struct Net {
    nodes: Vec<Node>,
    tick_ns: u64,
    now: u64,
}

/// What is drawn of a network.
struct Draw {
    tick_ns: u32,
    offsets: Vec<f32>,
    /// Of an edge from its smaller end to its larger one; 0 for none.
    weights: Vec<Vec<f32>>,
    scale: f32,
    factor: f32,
}

impl Draw {
    fn weight(&self, a: usize, b: usize) -> f32 {
        self.weights[a.min(b)][a.max(b)]
    }

    fn degree(&self, a: usize) -> f64 {
        (0..self.offsets.len()).filter(|&b| b != a).map(|b| f64::from(self.weight(a, b))).sum()
    }

    fn config(&self, a: usize) -> NodeConfig {
        let n = self.offsets.len();
        let edges = |a: usize| (0..n).filter(|&b| b != a && self.weight(a, b) > 0.0).count() as u8;
        let edge =
            |b: usize| EdgeConfig { id: b as u8 + 1, weight: self.weight(a, b), edges: edges(b).max(1) };
        NodeConfig::builder(a as u8 + 1, self.tick_ns)
            .state([self.offsets.iter().sum::<f32>() / n as f32])
            .state_limit(1e9)
            .field(Field::scalar(-1.0, self.offsets[a], []))
            .gain(Gain::Reciprocal { scale: self.scale })
            // As good as closed.
            .funnel(Funnel { factor: self.factor, shape: Shape::Constant { width: 1e-9 } })
            .edges((0..n).filter(|&b| b != a && self.weight(a, b) > 0.0).map(edge))
            .extrapolate_ticks(3)
            .build()
            .unwrap()
    }
}

impl Net {
    fn new(draw: &Draw) -> Self {
        let configs = (0..draw.offsets.len()).map(|a| draw.config(a));
        let nodes = configs.map(|config| Node::new(Params::new(&config).unwrap(), &config.neighbours));
        let mut net = Self { nodes: nodes.collect(), tick_ns: draw.tick_ns.into(), now: 0 };
        let start = Message::Ctrl { target: Target::All, command: Command::Start, arg: 0, at_tick: 0 };
        net.nodes.iter_mut().for_each(|node| node.on_message(&start, 0).unwrap());
        net.exchange();
        net
    }

    fn exchange(&mut self) {
        let now = self.now;
        let mut said = Vec::new();
        for node in &mut self.nodes {
            said.extend(core::iter::from_fn(|| node.poll(now)).filter_map(|action| match action {
                Action::Send(message) => Some(message),
                _ => None,
            }));
        }
        for message in &said {
            for node in &mut self.nodes {
                let Message::State { source, .. } = message else { continue };
                if *source != node.id() {
                    let _ = node.on_message(message, now);
                }
            }
        }
    }

    fn tick(&mut self) {
        self.now += self.tick_ns;
        self.exchange();
    }
}

/// Uniform in [0, 1), the same everywhere.
struct Random(u64);

impl Random {
    fn next(&mut self) -> f32 {
        self.0 = self.0.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (self.0 >> 40) as f32 / (1 << 24) as f32
    }

    /// Between these powers of ten.
    fn decades(&mut self, low: f32, high: f32) -> f32 {
        funnelnet_law::math::pow(10.0, f64::from(low + (high - low) * self.next())) as f32
    }
}

/// A ring with chords, or nearly a complete graph; weights, states and inputs over decades.
fn draw(random: &mut Random) -> Draw {
    let n = 2 + (random.next() * 11.0) as usize;
    let (share, weight) = (random.next(), random.decades(-1.0, 2.0));
    let (common, apart) = (random.decades(-1.0, 4.0), random.decades(-1.0, 5.0));
    let mut between = |a: usize, b: usize| {
        let joined = b == a + 1 || (b > a && random.next() < share);
        if joined { weight * random.decades(0.0, 1.0) } else { 0.0 }
    };
    let weights = (0..n).map(|a| (0..n).map(|b| between(a, b)).collect()).collect();
    let offsets: Vec<f32> = (0..n).map(|_| common + apart * (random.next() - 0.5)).collect();
    let tick_ns = [100_000, 1_000_000, 10_000_000][(random.next() * 3.0) as usize];
    // Nodes settle between the middle of their funnels and 80 % of them.
    let scale = apart * random.decades(-0.6, 1.0);
    Draw { tick_ns, offsets, weights, scale, factor: 1.0 }
}

/// The largest that `nu` of a node is away from its mean once the network is at rest, in
/// `d (ulp(x) + T ulp(u))`; and the largest ratio.
fn rounding(draw: &Draw) -> (f64, f64) {
    let mut net = Net::new(draw);
    (0..20_000).for_each(|_| net.tick());
    let mut seen = vec![Vec::new(); net.nodes.len()];
    let mut ratio = 0.0f64;
    for _ in 0..400 {
        net.tick();
        for (node, seen) in net.nodes.iter().zip(&mut seen) {
            let last = node.observations()[0];
            ratio = ratio.max(f64::from(last.ratio));
            seen.push([last.x, last.nu, last.u].map(f64::from));
        }
    }
    let most = |of: &[[f64; 3]], part: usize| of.iter().fold(0.0f64, |most, row| most.max(row[part].abs()));
    let largest = seen.iter().fold(0.0f64, |largest, seen| largest.max(most(seen, 0)));
    let tick_s = f64::from(draw.tick_ns) * 1e-9;
    let moved = seen.iter().enumerate().map(|(a, seen)| {
        let mean = seen.iter().map(|row| row[1]).sum::<f64>() / seen.len() as f64;
        let away = seen.iter().fold(0.0f64, |away, row| away.max((row[1] - mean).abs()));
        away / (draw.degree(a) * f64::from(f32::EPSILON) * (largest + tick_s * most(seen, 2)))
    });
    (moved.fold(0.0, f64::max), ratio)
}

#[test]
fn rounding_moves_nu_by_no_more_than_the_floor_allows_for() {
    let mut random = Random(1);
    let (mut moved, mut ratio) = (0.0f64, 0.0f64);
    for _ in 0..100 {
        let draw = draw(&mut random);
        let (of_draw, left) = rounding(&draw);
        (moved, ratio) = (moved.max(of_draw), ratio.max(left));
    }
    println!("rounding moves nu by up to {moved:.2} d (ulp(x) + T ulp(u)); the largest ratio is {ratio:.3}");
    assert!(moved < ROUNDING && moved > ROUNDING / 4.0, "{moved}");
    assert!(
        ratio < 1.0,
        "nodes settle within 80 % of their funnels, and rounding takes less than the rest: {ratio}"
    );
}

/// Two nodes, one edge.
fn pair(weight: f32, factor: f32) -> Draw {
    let weights = vec![vec![0.0, weight], vec![0.0; 2]];
    Draw { tick_ns: 1_000_000, offsets: vec![50.0, 40.0], weights, scale: 5.0, factor }
}

#[test]
fn the_factor_of_a_funnel_neither_closes_nor_opens_what_rounding_leaves() {
    // Times a funnel of 1e-9, all of them are closed.
    let width = |factor| {
        let draw = pair(1.0, factor);
        let (_, ratio) = rounding(&draw);
        assert!(ratio < 1.0, "a margin of a half at factor {factor}: {ratio}");
        let mut net = Net::new(&draw);
        net.tick();
        net.nodes[0].observations()[0].psi
    };
    let [little, one, great] = [1e-6, 1.0, 1e3].map(width);
    assert!(little == one && one == great, "{little} {one} {great}");
}

#[test]
fn the_floor_grows_with_the_degree_and_with_what_a_tick_makes_of_the_input() {
    let at = |degree, tick_s, u| Floor::<f64>::of_f32(degree, tick_s).width(100.0, u);
    let all_share = 256.0 * f64::from(f32::EPSILON) * 100.0;
    assert!(close(at(1.0, 1e-3, 0.0), all_share) && close(at(16.0, 1e-3, 0.0), all_share));
    assert!(close(at(1600.0, 1e-3, 0.0), 100.0 * all_share));
    assert!(close(at(16.0, 1e-2, 1e6), 101.0 * all_share), "T u is 100 times x");
    // A node in f32 and a judge in f64 say the same.
    for (degree, u) in [(3.0, 7.0), (1e4, 1e9)] {
        let node = f64::from(Floor::<f32>::new(degree, 1e-3).width(100.0, u as f32));
        let judge = Floor::<f64>::of_f32(degree, 1e-3).width(100.0, u);
        assert!((node - judge).abs() <= 1e-6 * judge, "{node} {judge}");
    }
    assert!(Floor::<f64>::of_f32(1.0, 1e-3).width(0.0, 0.0) > 0.0, "nothing is seen, and ratios are defined");
    for (x, u) in [(f32::NAN, 0.0), (0.0, f32::NAN)] {
        assert!(Floor::<f32>::new(1.0, 1e-3).width(x, u).is_nan(), "{x} {u}");
    }
}

fn close(a: f64, b: f64) -> bool {
    (a - b).abs() <= 1e-9 * b
}

#[test]
fn a_heavy_edge_keeps_its_nodes_inside_the_floored_funnel() {
    let (moved, ratio) = rounding(&pair(1e4, 1.0));
    assert!(ratio < 1.0, "{ratio}, moved by {moved}");
}
