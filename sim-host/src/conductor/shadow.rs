//! The state of a node that only listens.
//!
//! A newcomer sends no state before it speaks, and its telemetry has its diffusive term, its funnel and its input
//! alone. So its state is computed here by the node's own code, of the frames that the node was given, and
//! it is believed at a tick only where all that the node tells of this tick has the bits of it.

use funnelnet_node::{Action, Node, Observation, Params};
use funnelnet_protocol::NodeConfig;
use funnelnet_protocol::message::{Command, JOIN, Message, Target};
use funnelnet_protocol::report::Telemetry;
use funnelnet_protocol::serial::{self, Frame};

/// A newcomer as it should be.
pub(super) struct Shadow {
    node: Node,
    /// It has said a state.
    speaks: bool,
}

impl Shadow {
    /// Of a node that is started with this configuration among others that run; none where it is none.
    pub(super) fn of(config: &NodeConfig) -> Option<Self> {
        // This program's time is not that of the node.
        let config = NodeConfig { holdover_ns: 0, ..config.clone() };
        let params = Params::new(&config).ok()?;
        let mut shadow = Self { node: Node::new(params, &config.neighbours), speaks: false };
        let start = Message::Ctrl { target: Target::All, command: Command::Start, arg: 0, at_tick: JOIN };
        shadow.take(&start);
        Some(shadow)
    }

    /// Takes a frame that the node is given, as it is on its line.
    pub(super) fn hear(&mut self, bytes: &[u8]) {
        let mut bytes = bytes.to_vec();
        // Without its final zero.
        bytes.pop();
        match serial::decode(&mut bytes) {
            Ok(Frame::RealTime(message)) => self.take(&message),
            Ok(Frame::Service { .. }) => {}
            Err(reason) => self.node.refuse(reason),
        }
    }

    /// Takes a message, and does what follows.
    pub(super) fn take(&mut self, message: &Message) {
        // It counts what it refuses.
        let _ = self.node.on_message(message, 0);
        while let Some(action) = self.node.poll(0) {
            self.speaks |= matches!(action, Action::Send(Message::State { .. }));
        }
    }

    /// Whether it has said a state.
    pub(super) fn speaks(&self) -> bool {
        self.speaks
    }

    /// Its state at the last tick, state units.
    pub(super) fn x(&self) -> Vec<f32> {
        self.node.observations().iter().map(|seen| seen.x).collect()
    }

    /// Whether a node that tells this is as it should be.
    pub(super) fn agrees(&self, told: &Telemetry) -> bool {
        let seen = self.node.observations().get(usize::from(told.component));
        let bits = |nu: f32, psi: f32, u: f32| [nu, psi, u].map(f32::to_bits);
        seen.is_some_and(|&Observation { tick, nu, psi, u, .. }| {
            tick == told.tick && bits(nu, psi, u) == bits(told.nu, told.psi, told.u)
        })
    }
}
