//! Things that a node lets others see: its phase, its events, the last tick.

use core::fmt;
use funnelnet_protocol::message::{FaultCode, NodeId};

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
pub enum Event {
    /// Started; the initial state is announced.
    Started,
    /// Stopped by command.
    Stopped,
    /// A neighbour is heard for the first time, or again.
    NeighbourFound(NodeId),
    /// A neighbour has been silent too long: its edge is dropped.
    NeighbourLost(NodeId),
    /// A neighbour's state has changed faster than the limit, and is not taken: the first one in a row.
    TooFast {
        /// The neighbour.
        node: NodeId,
        /// Change since the last state that was taken, state units.
        change: f32,
    },
    /// A neighbour's state is beyond the limit, and is not taken: the first one in a row.
    TooFar {
        /// The neighbour.
        node: NodeId,
        /// The state, state units.
        x: f32,
    },
    /// Too many states of a neighbour in a row were not taken: its edge is dropped until it starts anew.
    Barred(NodeId),
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
    /// The funnel is narrower than the resolution of `nu`, and is floored there from now on (law.md 4).
    FunnelFloored {
        /// Tick number.
        tick: u32,
        /// The floor, state units.
        width: f32,
    },
    /// The node has widened its own funnel after a breach (law.md 5, `reopen`).
    FunnelReopened {
        /// Tick number.
        tick: u32,
        /// The new width, state units.
        width: f32,
    },
    /// A neighbour announces another weight for the edge than the node has (0: no edge at all).
    WeightsDiffer {
        /// The neighbour.
        node: NodeId,
        /// The node's own weight.
        own: f32,
        /// The neighbour's.
        theirs: f32,
    },
    /// A SYNC skipped ticks.
    SyncGap {
        /// Number of neighbours.
        missed: u32,
    },
    /// Ticks of the timer come a whole period late or more, from this one on.
    Overrun {
        /// Tick number.
        tick: u32,
    },
    /// The node goes on with another configuration.
    Adopted {
        /// First tick that it is for.
        tick: u32,
    },
    /// The node comes to a network that runs: it hears its neighbours, and sends no states yet.
    Listens {
        /// Tick number.
        tick: u32,
    },
    /// The node is where its neighbours are, or hears none, and sends states from now on.
    Joins {
        /// Tick number.
        tick: u32,
    },
    /// The node is time master from now on.
    TimeMaster,
    /// The node follows this time master from now on.
    Follows(NodeId),
    /// The time master is silent, and the node goes on by its own clock.
    NoTimeMaster,
    /// The node has said a fault that did not stop it.
    Warned(FaultCode),
    /// The node has stopped by itself.
    Fault(FaultCode),
}

/// Writes an event by `core::write` and `defmt::write` alike: host and node log the same words.
macro_rules! say {
    ($($write:ident)::+, $f:expr, $event:expr) => {
        match *$event {
            Event::Started => $($write)::+!($f, "started"),
            Event::Stopped => $($write)::+!($f, "stopped by command"),
            Event::NeighbourFound(id) => $($write)::+!($f, "hears node {}", id.get()),
            Event::NeighbourLost(id) => $($write)::+!($f, "has lost node {} and drops the edge", id.get()),
            Event::TooFast { node, change } => {
                $($write)::+!($f, "hears node {} jump by {} and does not take it", node.get(), change)
            }
            Event::TooFar { node, x } => {
                $($write)::+!($f, "hears node {} say {} and does not take it", node.get(), x)
            }
            Event::Barred(id) => $($write)::+!(
                $f,
                "drops the edge to node {}: it could take no state of it for too long",
                id.get()
            ),
            Event::BreachBegan { tick, ratio } => {
                $($write)::+!($f, "left its funnel at tick {}: |nu| / psi = {}", tick, ratio)
            }
            Event::BreachEnded { tick } => $($write)::+!($f, "is inside its funnel again at tick {}", tick),
            Event::FunnelFloored { tick, width } => {
                $($write)::+!($f, "keeps its funnel at {} from tick {} on, the resolution of nu", width, tick)
            }
            Event::FunnelReopened { tick, width } => {
                $($write)::+!($f, "reopens its funnel to {} at tick {}", width, tick)
            }
            Event::WeightsDiffer { node, own, theirs } => $($write)::+!(
                $f,
                "gives the edge to node {} the weight {}, which node {} gives {}: the graph is not undirected",
                node.get(),
                own,
                node.get(),
                theirs
            ),
            Event::SyncGap { missed } => $($write)::+!($f, "skips {} ticks that SYNC has skipped", missed),
            Event::Overrun { tick } => {
                $($write)::+!($f, "is late by a whole period or more from tick {} on", tick)
            }
            Event::Adopted { tick } => $($write)::+!($f, "has another configuration from tick {} on", tick),
            Event::Listens { tick } => $($write)::+!($f, "listens before it speaks, from tick {} on", tick),
            Event::Joins { tick } => $($write)::+!($f, "is one of its neighbours from tick {} on", tick),
            Event::TimeMaster => $($write)::+!($f, "is time master"),
            Event::Follows(id) => $($write)::+!($f, "follows time master {}", id.get()),
            Event::NoTimeMaster => $($write)::+!($f, "hears no time master and goes on by its own clock"),
            Event::Warned(code) => $($write)::+!($f, "warns: {}", code),
            Event::Fault(code) => $($write)::+!($f, "stopped by itself: {}", code),
        }
    };
}

impl fmt::Display for Event {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        say!(core::write, f, self)
    }
}

#[cfg(feature = "defmt")]
impl defmt::Format for Event {
    fn format(&self, f: defmt::Formatter<'_>) {
        say!(defmt::write, f, self);
    }
}

/// Values of the law at the last tick, in one component of the state.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Observation<F> {
    /// Tick number `k`.
    pub tick: u32,
    /// State at `k`, state units.
    pub x: F,
    /// Diffusive term at `k`, state units; with edge-wise coupling that of the edge where it is largest.
    pub nu: F,
    /// Funnel at `k`, after flooring, state units.
    pub psi: F,
    /// `|nu| / psi`.
    pub ratio: F,
    /// Input held over the tick that begins at `k`, state units / s.
    pub u: F,
}

#[cfg(test)]
mod tests {
    extern crate std;
    use super::*;
    use std::string::ToString;

    #[test]
    fn events_read_as_sentences_about_their_node() {
        let id = NodeId::new(7).unwrap();
        for (event, text) in [
            (Event::NeighbourFound(id), "hears node 7"),
            (Event::TooFast { node: id, change: -2.5 }, "hears node 7 jump by -2.5 and does not take it"),
            (Event::TooFar { node: id, x: 55.0 }, "hears node 7 say 55 and does not take it"),
            (Event::Barred(id), "drops the edge to node 7: it could take no state of it for too long"),
            (Event::BreachBegan { tick: 40, ratio: 1.5 }, "left its funnel at tick 40: |nu| / psi = 1.5"),
            (Event::Fault(FaultCode::STATE_LIMIT), "stopped by itself: its state is beyond its limit"),
            (Event::Warned(FaultCode::PANIC), "warns: its firmware panicked"),
            (Event::Fault(FaultCode(99)), "stopped by itself: fault 99"),
        ] {
            assert_eq!(event.to_string(), text);
        }
    }
}
