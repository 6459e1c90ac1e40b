//! Two nodes that drift apart by themselves agree within a funnel of 0.5.
//!
//! `cargo run -p funnelnet-node --example two_nodes`

use funnelnet_node::protocol::config::{Field, Shape};
use funnelnet_node::protocol::{Command, Message, NodeConfig, Target};
use funnelnet_node::{Action, Node, Params};
use std::error::Error;

const TICK_NS: u32 = 1_000_000;

/// A node with one neighbour: where it starts, and how fast it drifts by itself (1/s).
fn node(id: u8, other: u8, state: f32, drift: f32) -> Result<Node, Box<dyn Error>> {
    let config = NodeConfig::builder(id, TICK_NS)
        .state([state])
        .field(Field::scalar(0.0, drift, []))
        .funnel(Shape::Exponential { start: 5.0, end: 0.5, rate: 1.0 })
        .edge(other, 1.0)
        .build()?;
    Ok(Node::new(Params::new(&config)?, &config.neighbours))
}

fn main() -> Result<(), Box<dyn Error>> {
    let mut nodes = [node(1, 2, 0.0, 1.0)?, node(2, 1, 3.0, -1.0)?];
    let start = Message::Ctrl { target: Target::All, command: Command::Start, arg: 0, at_tick: 0 };
    for node in &mut nodes {
        node.on_message(&start, 0)?;
    }
    for now in (0..5_000_000_000).step_by(TICK_NS as usize) {
        for from in 0..2 {
            while let Some(action) = nodes[from].poll(now) {
                match action {
                    // The bus: the other node hears it at once.
                    Action::Send(message) => {
                        nodes[1 - from].on_message(&message, now)?;
                    }
                    Action::Report(event) => println!("{} ms: node {}: {event}", now / 1_000_000, from + 1),
                    Action::Safe | Action::Sample | Action::Actuate => {}
                }
            }
        }
    }
    for node in &nodes {
        let (x, worst) = (node.state().next().unwrap_or_default(), node.report().max_ratio);
        println!("node {}: x = {x:.3}, |nu| / psi at most {worst:.3}", node.id().get());
        assert!(worst < 1.0);
    }
    Ok(())
}
