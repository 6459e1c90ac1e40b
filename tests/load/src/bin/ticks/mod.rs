//! The load behind the figures of loopback and of CAN: 100 nodes of degree 4.
#![allow(clippy::expect_used)]

use funnelnet_node::{Node, Params};
use funnelnet_protocol::config::{EdgeConfig, Field, NodeConfig, Shape, Sine};
use funnelnet_sim::bus::Medium;
use funnelnet_sim::engine::Engine;

/// Nodes.
pub const NODES: usize = 100;
/// Neighbours of a node: the next two on either side of a ring.
const STEPS: [usize; 4] = [1, 2, NODES - 2, NODES - 1];

fn config(index: usize, tick_ns: u32) -> NodeConfig {
    let neighbours =
        STEPS.map(|step| EdgeConfig { id: ((index + step) % NODES + 1) as u8, weight: 1.0, edges: 4 });
    let sine = Sine { component: 0, amplitude: 10.0, frequency: 1.0, phase: index as f64 };
    NodeConfig::builder(index as u8 + 1, tick_ns)
        .state([index as f32 * 0.01])
        .state_limit(1e6)
        .field(Field::scalar(-1.0, 0.0, [sine]))
        .funnel(Shape::Exponential { start: 40.0, end: 2.0, rate: 1.0 })
        .edges(neighbours)
        .build()
        .expect("room for four edges")
}

/// Who hears each node, by index.
pub fn listeners() -> Vec<Vec<usize>> {
    (0..NODES).map(|i| STEPS.map(|step| (i + step) % NODES).to_vec()).collect()
}

/// Runs the nodes on a bus for as many ticks of `tick_ns` as the command line asks for; prints node-ticks per
/// second and the final state of node 1.
pub fn run(tick_ns: u32, bus: impl Medium) {
    let ticks: u32 =
        std::env::args().nth(1).map_or(10_000, |text| text.parse().expect("TICKS: a whole number"));
    let node = |i| {
        let config = config(i, tick_ns);
        Node::new(Params::new(&config).expect("a valid configuration"), &config.neighbours)
    };
    let mut engine = Engine::new((0..NODES).map(node).collect(), bus);
    let begin = std::time::Instant::now();
    engine.start();
    for _ in 0..ticks {
        engine.advance();
    }
    let seconds = begin.elapsed().as_secs_f64();
    let state = engine.nodes().first().and_then(|node| node.state().next()).unwrap_or_default();
    let rate = NODES as f64 * f64::from(ticks) / seconds;
    println!("{NODES} nodes, {ticks} ticks: {rate:.0} node-ticks/s, state of node 1: {state}");
}
