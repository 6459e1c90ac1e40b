//! Frames that a line has doubled: an adapter that sends a buffer again, for example. The first one has been
//! taken, so nothing is lost with the second one, and it is no fault of the node.
//!
//! States and telemetry name their tick, so that a node never says the same one twice. A weight may be
//! announced again, and who goes on announcing one babbles.

use super::Received;
use funnelnet_protocol::message::Message;
use funnelnet_protocol::report::Telemetry;
use funnelnet_protocol::service::Reply;
use std::collections::VecDeque;

/// States and telemetry back that a double is looked for: what a node of eight components says of two ticks.
const BACK: usize = 32;

/// What a frame says, bit by bit: telemetry may have a value that equals nothing.
type Said = (&'static str, [u32; 5]);

/// The last frames of a line.
#[derive(Debug, Default)]
pub(super) struct Doubles {
    last: VecDeque<Said>,
}

impl Doubles {
    /// Takes a frame; what it is, where the line has said it before.
    pub(super) fn of(&mut self, received: &Received) -> Option<&'static str> {
        let said = said(received)?;
        if self.last.contains(&said) {
            return Some(said.0);
        }
        if self.last.len() == BACK {
            self.last.pop_front();
        }
        self.last.push_back(said);
        None
    }
}

/// What may not come again. Faults are told by two ways, and answers are asked for again.
fn said(received: &Received) -> Option<Said> {
    match received {
        Received::Message(Message::State { source, component, tick, x }) => {
            let which = [u32::from(source.get()), u32::from(component.get()), tick.value(), x.to_bits(), 0];
            Some(("a state", which))
        }
        Received::Reply(Reply::Telemetry(Telemetry { tick, component, nu, psi, u })) => {
            let values = [nu, psi, u].map(|value| value.to_bits());
            Some(("telemetry", [*tick, u32::from(*component), values[0], values[1], values[2]]))
        }
        Received::Message(_) | Received::Reply(_) => None,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use funnelnet_protocol::NodeId;
    use funnelnet_protocol::message::{Component, TickStamp};

    fn state(tick: u32, x: f32) -> Received {
        let (source, component) = (NodeId::new(2).unwrap(), Component::FIRST);
        Received::Message(Message::State { source, component, tick: TickStamp::full(tick), x })
    }

    fn telemetry(tick: u32, component: u8) -> Received {
        Received::Reply(Reply::Telemetry(Telemetry { tick, component, nu: f32::NAN, psi: 1.0, u: 0.0 }))
    }

    fn edge(weight: f32) -> Received {
        let [source, neighbour] = [2, 3].map(|id| NodeId::new(id).unwrap());
        Received::Message(Message::Edge { source, neighbour, weight })
    }

    fn found(frames: &[Received]) -> Vec<Option<&'static str>> {
        let mut doubles = Doubles::default();
        frames.iter().map(|frame| doubles.of(frame)).collect()
    }

    #[test]
    fn a_frame_or_a_block_that_comes_again_is_a_double() {
        let (a_state, told) = (Some("a state"), Some("telemetry"));
        assert_eq!(
            found(&[state(5, 1.0), state(5, 1.0), telemetry(4, 0), telemetry(4, 0)]),
            [None, a_state, None, told]
        );
        let block = || [state(5, 1.0), telemetry(4, 0), telemetry(4, 1)];
        let twice: Vec<_> = block().into_iter().chain(block()).collect();
        assert_eq!(found(&twice), [None, None, None, a_state, told, told]);
    }

    #[test]
    fn what_a_node_may_say_is_none() {
        // At rest, at tick after tick; two states of one tick, which is the node's own fault; a weight that
        // is announced anew.
        assert_eq!(found(&[state(5, 0.0), telemetry(4, 0), state(6, 0.0), telemetry(5, 0)]), [None; 4]);
        assert_eq!(found(&[state(5, 1.0), state(5, 2.0)]), [None; 2]);
        assert_eq!(found(&[edge(1.0), edge(1.0), state(5, 1.0), edge(1.0)]), [None; 4]);
    }
}
