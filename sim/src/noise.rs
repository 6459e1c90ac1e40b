//! Measurement noise: what neighbours see of a state, while the node itself knows it exactly.

use crate::random::{self, Purpose};
use crate::scenario::Scenario;
use funnelnet_protocol::message::Message;
use rand_pcg::Pcg64;

/// Gaussian noise on the states that nodes send: one stream per node, one draw per frame, in the order of the
/// frames.
#[derive(Clone, Debug, Default)]
pub struct Noise {
    /// Standard deviation (state units) and stream, by index; empty where there is no noise at all.
    nodes: Vec<(f64, Pcg64)>,
}

impl Noise {
    /// The noise of a scenario.
    pub fn of(scenario: &Scenario) -> Self {
        if scenario.nodes.iter().all(|node| node.noise == 0.0) {
            return Self::default();
        }
        let stream = |index: usize| random::stream(scenario.seed, Purpose::Noise, index as u64);
        let nodes = scenario.nodes.iter().enumerate().map(|(index, node)| (node.noise, stream(index)));
        Self { nodes: nodes.collect() }
    }

    /// Whether there is none.
    pub fn is_none(&self) -> bool {
        self.nodes.is_empty()
    }

    /// The message of node `index` as it goes on the bus.
    pub fn disturb(&mut self, index: usize, message: Message) -> Message {
        match message {
            Message::State { source, component, tick, x } => {
                Message::State { source, component, tick, x: self.measure(index, x) }
            }
            message => message,
        }
    }

    /// State that others measure for the state `x` (state units) of node `index`.
    pub fn measure(&mut self, index: usize, x: f32) -> f32 {
        match self.nodes.get_mut(index) {
            Some((deviation, stream)) if *deviation > 0.0 => {
                (f64::from(x) + *deviation * random::gaussian(stream)) as f32
            }
            _ => x,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use funnelnet_protocol::TickStamp;
    use funnelnet_protocol::message::{Component, NodeId};

    #[test]
    fn only_states_of_noisy_nodes_are_disturbed() {
        let mut noise = Noise {
            nodes: vec![
                (0.5, random::stream(1, Purpose::Noise, 0)),
                (0.0, random::stream(1, Purpose::Noise, 1)),
            ],
        };
        let source = NodeId::new(1).unwrap();
        let state = Message::State { source, component: Component::FIRST, tick: TickStamp::full(3), x: 2.0 };
        let edge = Message::Edge { source, neighbour: source, weight: 1.0 };
        let disturbed = [0, 0, 1].map(|index| noise.disturb(index, state));
        assert_eq!(disturbed[2], state);
        assert!(disturbed[0] != state && disturbed[1] != state && disturbed[0] != disturbed[1]);
        assert_eq!(noise.disturb(0, edge), edge);
    }
}
