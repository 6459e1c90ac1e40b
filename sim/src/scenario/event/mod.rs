//! `[[event]]`: nodes that go and come, links that are cut and mended, frames that are lost, held or false (docs/book/src/faults.md).

mod course;
mod detail;
mod read;
mod read_frames;
mod read_plants;
mod read_set;
mod sense;
mod spell;

pub use course::{Absence, Change, Course, Disturbance, Step};
pub use detail::{ActuatorFault, ClockChange, Detail, Lie, NewValue, SensorFault};
pub(super) use read::read;
#[cfg(feature = "check")]
pub(super) use read_frames::{LARGEST_ID, SAID, SLOPE};
#[cfg(feature = "check")]
pub(super) use read_plants::{DEVIATION, INPUT, INPUT_SLOPE, LIMIT, PART};
pub(super) use sense::{LAST_JOIN, MOST_EVENTS, OLDEST, Setting, make_sense, no_plants};
pub(crate) use spell::on_engine;
pub use spell::{Does, Harm, NoisySpell, Spell};

use super::duration::format_duration;
use super::graph::Graph;
use std::fmt;

/// One event.
#[derive(Clone, Debug, PartialEq)]
pub struct EventSpec {
    /// Time of the scenario at which it happens, ns.
    pub at_ns: u64,
    /// Its kind.
    pub kind: EventKind,
    /// The nodes or links that it happens to.
    pub targets: Targets,
    /// For how long a node is off, or what happens goes on, ns; 0 for what happens at once.
    pub lasts_ns: u64,
    /// What it says beside that.
    pub detail: Detail,
}

impl EventSpec {
    /// When it is over, ns of the scenario.
    #[must_use]
    pub fn end_ns(&self) -> u64 {
        self.at_ns.saturating_add(self.lasts_ns)
    }
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
    /// Frames get lost on links for a while.
    Burst,
    /// Bits of frames are read wrong on links for a while.
    Corrupt,
    /// Frames are held back on links, and let go all at once.
    Hold,
    /// Frames that are held back are let go.
    Release,
    /// Bits of a CAN bus are disturbed for a while.
    Noise,
    /// A node's connector comes off the bus.
    Cut,
    /// A bus is dominant whatever is sent.
    Short,
    /// A node sends without end.
    Babble,
    /// A node says another state than it has.
    Liar,
    /// A node says old states once more.
    Replayer,
    /// A node says states in another one's name.
    Impostor,
    /// A node measures another state than it has.
    Sensor,
    /// A node's actuator does something else than its input.
    Actuator,
    /// Nodes go on with another configuration.
    Set,
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
            Self::Burst => "burst",
            Self::Corrupt => "corrupt",
            Self::Hold => "hold",
            Self::Release => "release",
            Self::Noise => "noise",
            Self::Cut => "cut",
            Self::Short => "short",
            Self::Babble => "babble",
            Self::Liar => "liar",
            Self::Replayer => "replayer",
            Self::Impostor => "impostor",
            Self::Sensor => "sensor",
            Self::Actuator => "actuator",
            Self::Set => "set",
        }
    }

    /// Whether it takes nodes or links away, or brings them back.
    #[must_use]
    pub fn is_of_presence(self) -> bool {
        matches!(self, Self::Crash | Self::Bounce | Self::Leave | Self::Join | Self::Partition | Self::Repair)
    }

    /// Whether it happens to frames on links, which stay.
    #[must_use]
    pub fn is_of_frames(self) -> bool {
        matches!(self, Self::Burst | Self::Corrupt | Self::Hold | Self::Release)
    }

    /// Whether it happens to the wire of a CAN bus.
    #[must_use]
    pub fn is_of_wires(self) -> bool {
        matches!(self, Self::Noise | Self::Cut | Self::Short | Self::Babble)
    }

    /// Whether a node says what is not so.
    #[must_use]
    pub fn is_of_lies(self) -> bool {
        matches!(self, Self::Liar | Self::Replayer | Self::Impostor)
    }

    /// Whether it happens in the node, whatever its bus is.
    #[must_use]
    pub fn is_of_nodes(self) -> bool {
        self.is_of_plants() || self == Self::Set
    }

    /// Whether it happens to the plant of a node, which has one then: its sensor or its actuator fails.
    #[must_use]
    pub fn is_of_plants(self) -> bool {
        matches!(self, Self::Sensor | Self::Actuator)
    }
}

/// Nodes or links that an event happens to; nodes by index.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Targets {
    /// Nodes.
    Nodes(Vec<usize>),
    /// Every node.
    AllNodes,
    /// The link between two nodes.
    Link(usize, usize),
    /// Every link from a node of one group to a node of another. A node in no group keeps its links.
    Groups(Vec<Vec<usize>>),
    /// Every link.
    AllLinks,
    /// Every node that may be time master.
    Masters,
    /// The bus as a whole.
    Bus,
}

impl Targets {
    /// The nodes that are named; none where they are links, or time masters.
    #[must_use]
    pub fn nodes(&self) -> &[usize] {
        match self {
            Self::Nodes(nodes) => nodes,
            Self::AllNodes
            | Self::Link(..)
            | Self::Groups(_)
            | Self::AllLinks
            | Self::Masters
            | Self::Bus => &[],
        }
    }

    /// The links that are edges of `graph`, the lower end first.
    #[must_use]
    pub fn links(&self, graph: &Graph) -> Vec<(usize, usize)> {
        let edges = graph.edges.iter().map(|edge| (edge.a, edge.b));
        match self {
            Self::Nodes(_) | Self::AllNodes | Self::Masters | Self::Bus => Vec::new(),
            Self::Link(a, b) => edges.filter(|&edge| edge == (*a.min(b), *a.max(b))).collect(),
            Self::Groups(groups) => {
                let group = groups_of(groups, graph.nodes);
                let are_apart = |a: usize, b: usize| group[a].zip(group[b]).is_some_and(|(a, b)| a != b);
                edges.filter(|&(a, b)| are_apart(a, b)).collect()
            }
            Self::AllLinks => edges.collect(),
        }
    }

    /// The same with all links of a node, where nodes are named.
    #[must_use]
    pub fn frames(&self, graph: &Graph) -> Vec<(usize, usize)> {
        let Self::Nodes(nodes) = self else { return self.links(graph) };
        let of_one = |&(a, b): &(usize, usize)| nodes.contains(&a) || nodes.contains(&b);
        graph.edges.iter().map(|edge| (edge.a, edge.b)).filter(of_one).collect()
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
        self.detail.fmt(f)?;
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
            Self::AllNodes => f.write_str("all nodes"),
            Self::Link(a, b) => write!(f, "link {}", ids(&[*a, *b])),
            Self::Groups(groups) => {
                let groups: Vec<_> = groups.iter().map(|group| ids(group)).collect();
                write!(f, "groups {}", groups.join(" | "))
            }
            Self::AllLinks => f.write_str("all links"),
            Self::Masters => f.write_str("all time masters"),
            Self::Bus => f.write_str("on the bus"),
        }
    }
}

impl fmt::Display for Detail {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match *self {
            Self::None => Ok(()),
            Self::Set(NewValue { ref key, ref value, .. }) => write!(f, ": {key} = {value}"),
            Self::Clock(ClockChange { by_ns, drift_ppb }) => {
                if by_ns != 0 {
                    write!(f, " by {}", format_signed(by_ns))?;
                }
                drift_ppb.map_or(Ok(()), |ppb| write!(f, " drifts by {} ppm", ppb as f64 / 1000.0))
            }
            Self::Loss(loss) => write!(f, " loses {}", loss.mean()),
            Self::Corrupt(probability) => write!(f, " disturbs {probability}"),
            Self::BitErrors(per_billion) => {
                write!(f, " disturbs {} of the bits", f64::from(per_billion) / 1e9)
            }
            Self::Babble(id) => write!(f, " sends {id:#05x}"),
            Self::Lie(lie) => write!(f, " says {lie}"),
            Self::Impostor { name, lie } => write!(f, " says {lie} as node {}", name + 1),
            Self::Age(ns) => write!(f, " says what is {} old", format_duration(ns)),
            Self::Sensor(fault) => write!(f, " {fault}"),
            Self::Actuator(fault) => write!(f, " {fault}"),
        }
    }
}

impl fmt::Display for Lie {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match *self {
            Self::Constant(value) => write!(f, "{value}"),
            Self::Ramp(slope) => write!(f, "a ramp of {slope} per s"),
            Self::Offset(offset) => write!(f, "its state and {offset}"),
        }
    }
}

impl fmt::Display for SensorFault {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match *self {
            Self::Gives(Lie::Ramp(0.0)) => f.write_str("is stuck"),
            Self::Gives(lie) => write!(f, "measures {lie}"),
            Self::Noise(deviation) => write!(f, "measures with a noise of {deviation}"),
            Self::Loss(probability) => write!(f, "loses {probability} of the samples"),
            Self::Age(ns) => write!(f, "measures what is {} old", format_duration(ns)),
        }
    }
}

impl fmt::Display for ActuatorFault {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match *self {
            Self::Part(0.0) => f.write_str("is dead"),
            Self::Part(part) => write!(f, "does {part} of the input"),
            Self::Limit(limit) => write!(f, "does {limit} per s at most"),
            Self::Constant(value) => write!(f, "does {value} per s"),
            Self::Ramp(0.0) => f.write_str("is stuck"),
            Self::Ramp(slope) => write!(f, "does a ramp of {slope} per s^2"),
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
