//! The log of a node.

use crate::link::Health;
use funnelnet_link::Change;
use funnelnet_node::Event;
use funnelnet_plant::Failure;
use funnelnet_protocol::config::ConfigError;

/// A log, told entry by entry. What a platform does not override goes nowhere.
pub trait Log {
    /// The app has put the output in its safe position, and runs.
    fn ready(&mut self) {}

    /// The stored configuration has made this node.
    fn restored(&mut self, _id: u8) {}

    /// The stored configuration cannot be used: the node stays blank.
    fn unusable(&mut self, _why: ConfigError) {}

    /// Something has happened in the node.
    fn event(&mut self, _event: &Event) {}

    /// The link has changed its state, and is as `_health` says.
    fn link(&mut self, _change: Change, _health: Health) {}

    /// The plant could not be measured.
    fn not_measured(&mut self, _why: Failure) {}

    /// The plant could not be driven; the node stops.
    fn not_driven(&mut self, _why: Failure) {}

    /// An actuator could not be put in its safe position.
    fn not_safe(&mut self, _why: Failure) {}
}

/// No log.
impl Log for () {}
