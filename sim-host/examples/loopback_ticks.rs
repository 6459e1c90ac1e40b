//! Runs 100 nodes of degree 4 for a number of ticks: the load behind the loopback figures (`./ci.sh cost`).
//!
//! Usage: `loopback_ticks [TICKS]`; prints node-ticks per second and the final state of node 1.
#![allow(clippy::expect_used)]

use funnelnet_node::{Node, Params};
use funnelnet_protocol::config::{EdgeConfig, Field, NodeConfig, Shape, Sine};
use sim_host::bus::ideal::{IdealBus, IdealParams};
use sim_host::engine::Engine;

const NODES: usize = 100;
/// Neighbours of a node: the next two on either side of a ring.
const STEPS: [usize; 4] = [1, 2, NODES - 2, NODES - 1];

fn config(index: usize) -> NodeConfig {
    let neighbours =
        STEPS.map(|step| EdgeConfig { id: ((index + step) % NODES + 1) as u8, weight: 1.0, edges: 4 });
    let sine = Sine { component: 0, amplitude: 10.0, frequency: 1.0, phase: index as f64 };
    NodeConfig::builder(index as u8 + 1, 1_000_000)
        .state([index as f32 * 0.01])
        .state_limit(1e6)
        .field(Field::scalar(-1.0, 0.0, [sine]))
        .funnel(Shape::Exponential { start: 40.0, end: 2.0, rate: 1.0 })
        .edges(neighbours)
        .build()
        .expect("room for four edges")
}

fn main() {
    let ticks: u32 =
        std::env::args().nth(1).map_or(10_000, |text| text.parse().expect("TICKS: a whole number"));
    let node = |i| {
        let config = config(i);
        Node::new(Params::new(&config).expect("a valid configuration"), &config.neighbours)
    };
    let nodes = (0..NODES).map(node).collect();
    let listeners = (0..NODES).map(|i| STEPS.map(|step| (i + step) % NODES).to_vec()).collect();
    let mut engine = Engine::new(nodes, IdealBus::new(IdealParams::default(), 1, listeners));
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
