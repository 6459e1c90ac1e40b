//! What a node lets others see: its phase, its events, the last tick.

use funnel_protocol::message::{FaultCode, NodeId};

/// Phase of a node's life.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum Phase {
    /// Configured, not started.
    Ready,
    /// Ticking.
    Running,
    /// Stopped by command.
    Stopped,
    /// Stopped by a fault; silent until it is configured anew.
    Faulted(FaultCode),
}

/// Something that happened. Events are queued for the app, never acted on inside the node.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum Event {
    /// Started; the initial state is announced.
    Started,
    /// Stopped by command.
    Stopped,
    /// A neighbour is heard for the first time, or again.
    NeighbourFound(NodeId),
    /// A neighbour has been silent too long: its edge is dropped.
    NeighbourLost(NodeId),
    /// The diffusive term reached or left the funnel boundary: the guarantee does not hold.
    BreachBegan {
        /// Tick number.
        tick: u32,
        /// `|nu| / psi`.
        ratio: f32,
    },
    /// The diffusive term is inside the funnel again.
    BreachEnded {
        /// Tick number.
        tick: u32,
    },
    /// The funnel is narrower than the resolution of `nu`, and is floored there from now on (LAW.md 4).
    FunnelFloored {
        /// Tick number.
        tick: u32,
        /// The floor, state units.
        width: f32,
    },
    /// A SYNC skipped ticks.
    SyncGap {
        /// How many.
        missed: u32,
    },
    /// The node has stopped by itself.
    Fault(FaultCode),
}

/// What the law did at the last tick.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Observation<F> {
    /// Tick number `k`.
    pub tick: u32,
    /// State at `k`, state units.
    pub x: F,
    /// Diffusive term at `k`, state units.
    pub nu: F,
    /// Funnel at `k`, after flooring, state units.
    pub psi: F,
    /// `|nu| / psi`.
    pub ratio: F,
    /// Input held over the tick that begins at `k`, state units / s.
    pub u: F,
}
