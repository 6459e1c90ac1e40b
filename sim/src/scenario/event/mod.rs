//! `[[event]]`: nodes that go and come, links that are cut and mended (docs/book/src/faults.md).

mod course;
mod read;
mod sense;

pub use course::{Absence, Change, Course, Disturbance, Step};
pub(super) use read::read;
pub(super) use sense::{Setting, make_sense};

use super::duration::format_duration;
use super::graph::Graph;
use std::fmt;

/// One event.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct EventSpec {
    /// Time of the scenario at which it happens, ns.
    pub at_ns: u64,
    /// Its kind.
    pub kind: EventKind,
    /// The nodes or links that it happens to.
    pub targets: Targets,
    /// Time for which a bounced node is off, or SYNC do not go out, ns; 0 for other kinds.
    pub lasts_ns: u64,
    /// What becomes of a clock; nothing for other kinds.
    pub clock: ClockChange,
}

/// What becomes of a clock at an event.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct ClockChange {
    /// How far it jumps, ns.
    pub by_ns: i64,
    /// How much too fast it is from then on, parts in a billion; none where that stays.
    pub drift_ppb: Option<i64>,
}

/// Kind of an event.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum EventKind {
    /// A node is off, and its state is lost.
    Crash,
    /// A node is off for a while, and then as after power-on.
    Bounce,
    /// A node is told to stop, and is off.
    Leave,
    /// A node that is off comes, as after power-on.
    Join,
    /// Links carry nothing.
    Partition,
    /// Links carry again what is sent.
    Repair,
    /// A clock jumps, or drifts from then on.
    Clock,
    /// SYNC do not go out for a while.
    SyncLoss,
}

impl EventKind {
    /// Its name in a scenario.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Crash => "crash",
            Self::Bounce => "bounce",
            Self::Leave => "leave",
            Self::Join => "join",
            Self::Partition => "partition",
            Self::Repair => "repair",
            Self::Clock => "clock",
            Self::SyncLoss => "sync-loss",
        }
    }

    /// Whether it happens to clocks alone: all nodes and links stay.
    #[must_use]
    pub fn is_of_clocks(self) -> bool {
        matches!(self, Self::Clock | Self::SyncLoss)
    }
}

/// Nodes or links that an event happens to; nodes by index.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Targets {
    /// Nodes.
    Nodes(Vec<usize>),
    /// The link between two nodes.
    Link(usize, usize),
    /// Every link from a node of one group to a node of another. A node in no group keeps its links.
    Groups(Vec<Vec<usize>>),
    /// Every link.
    AllLinks,
    /// Every node that may be time master.
    Masters,
}

impl Targets {
    /// The nodes; none where they are links, or time masters.
    #[must_use]
    pub fn nodes(&self) -> &[usize] {
        match self {
            Self::Nodes(nodes) => nodes,
            Self::Link(..) | Self::Groups(_) | Self::AllLinks | Self::Masters => &[],
        }
    }

    /// The links that are edges of `graph`, the lower end first.
    #[must_use]
    pub fn links(&self, graph: &Graph) -> Vec<(usize, usize)> {
        let edges = graph.edges.iter().map(|edge| (edge.a, edge.b));
        match self {
            Self::Nodes(_) | Self::Masters => Vec::new(),
            Self::Link(a, b) => edges.filter(|&edge| edge == (*a.min(b), *a.max(b))).collect(),
            Self::Groups(groups) => {
                let group = groups_of(groups, graph.nodes);
                let are_apart = |a: usize, b: usize| group[a].zip(group[b]).is_some_and(|(a, b)| a != b);
                edges.filter(|&(a, b)| are_apart(a, b)).collect()
            }
            Self::AllLinks => edges.collect(),
        }
    }
}

/// The group of each node, by index.
fn groups_of(groups: &[Vec<usize>], nodes: usize) -> Vec<Option<usize>> {
    let mut of = vec![None; nodes];
    for (group, members) in groups.iter().enumerate() {
        members.iter().for_each(|&node| of[node] = Some(group));
    }
    of
}

impl fmt::Display for EventSpec {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{} {}", self.kind.name(), self.targets)?;
        if self.clock.by_ns != 0 {
            write!(f, " by {}", format_signed(self.clock.by_ns))?;
        }
        if let Some(ppb) = self.clock.drift_ppb {
            write!(f, " drifts by {} ppm", ppb as f64 / 1000.0)?;
        }
        match self.lasts_ns {
            0 => Ok(()),
            ns => write!(f, " for {}", format_duration(ns)),
        }
    }
}

impl fmt::Display for Targets {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Nodes(nodes) if nodes.len() == 1 => write!(f, "node {}", ids(nodes)),
            Self::Nodes(nodes) => write!(f, "nodes {}", ids(nodes)),
            Self::Link(a, b) => write!(f, "link {}", ids(&[*a, *b])),
            Self::Groups(groups) => {
                let groups: Vec<_> = groups.iter().map(|group| ids(group)).collect();
                write!(f, "groups {}", groups.join(" | "))
            }
            Self::AllLinks => f.write_str("all links"),
            Self::Masters => f.write_str("all time masters"),
        }
    }
}

fn format_signed(ns: i64) -> String {
    let size = format_duration(ns.unsigned_abs());
    if ns < 0 { format!("-{size}") } else { size }
}

fn ids(nodes: &[usize]) -> String {
    let ids: Vec<_> = nodes.iter().map(|node| (node + 1).to_string()).collect();
    ids.join(", ")
}

#[cfg(test)]
mod tests;
