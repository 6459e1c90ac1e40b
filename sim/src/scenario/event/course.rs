//! What the events of a scenario come to, step by step: which nodes are on and which links are cut at which time.

use super::{EventKind, EventSpec};
use crate::scenario::{Graph, TimeSpec};
use std::collections::BTreeMap;

/// One change that an event makes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Change {
    /// A node is off from now on.
    Off {
        /// Its index.
        node: usize,
        /// It is told to stop first.
        told: bool,
    },
    /// A node is on from now on.
    On {
        /// Its index.
        node: usize,
    },
    /// The link between two nodes carries nothing from now on; the lower index first.
    Cut(usize, usize),
    /// It carries again what is sent.
    Mend(usize, usize),
}

impl Change {
    /// The node that it switches.
    fn node(self) -> Option<usize> {
        match self {
            Self::Off { node, .. } | Self::On { node } => Some(node),
            Self::Cut(..) | Self::Mend(..) => None,
        }
    }
}

/// A change at a time.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Step {
    /// Time of the scenario, ns.
    pub at_ns: u64,
    /// Index of the event that makes it.
    pub event: usize,
    /// The change.
    pub change: Change,
}

/// Ticks at which a node is off.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Absence {
    /// Its index.
    pub node: usize,
    /// The first of them.
    pub from_tick: u64,
    /// The first tick after them; none where it stays off.
    pub to_tick: Option<u64>,
}

/// Time from the begin of an event to its end.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Disturbance {
    /// Begin, ns of the scenario.
    pub from_ns: u64,
    /// End: a bounced node is back, the links of a partition are mended, what goes on for a while is over; else the begin. None where links stay cut.
    pub end_ns: Option<u64>,
}

/// All steps of a scenario, in the order of time.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Course {
    steps: Vec<Step>,
    /// Nodes to which it happens first that they come, by index.
    absent: Vec<bool>,
}

impl Course {
    /// The course of `events`, which are in the order of time. What happens at the same time happens in the order of the file.
    #[must_use]
    pub fn of(events: &[EventSpec], graph: &Graph) -> Self {
        let steps = events.iter().enumerate().flat_map(|(event, spec)| {
            changes(spec, graph).into_iter().map(move |(at_ns, change)| Step { at_ns, event, change })
        });
        let mut steps: Vec<Step> = steps.collect();
        // Stable: a node that comes back has been bounced before the event that happens at that time.
        steps.sort_by_key(|step| step.at_ns);
        let (mut absent, mut seen) = (vec![false; graph.nodes], vec![false; graph.nodes]);
        for change in steps.iter().map(|step| step.change) {
            if let Some(node) = change.node()
                && !std::mem::replace(&mut seen[node], true)
            {
                absent[node] = matches!(change, Change::On { .. });
            }
        }
        Self { steps, absent }
    }

    /// The same at what the nodes' clocks show then.
    #[must_use]
    pub fn on_clock(mut self, time: &TimeSpec) -> Self {
        self.steps.iter_mut().for_each(|step| step.at_ns = time.on_clock(step.at_ns));
        self
    }

    /// The steps.
    #[must_use]
    pub fn steps(&self) -> &[Step] {
        &self.steps
    }

    /// Whether a node is absent from the start: the first thing that happens to it is that it comes.
    #[must_use]
    pub fn begins_absent(&self, node: usize) -> bool {
        self.absent.get(node) == Some(&true)
    }

    /// The absences of all nodes, in the order in which they begin. A node that is back before its next tick misses none.
    #[must_use]
    pub fn absences(&self, time: &TimeSpec) -> Vec<Absence> {
        let mut absences: Vec<Absence> = Vec::new();
        // Place of the last absence of each node.
        let mut last = vec![None; self.absent.len()];
        for node in (0..last.len()).filter(|&node| self.absent[node]) {
            last[node] = Some(absences.len());
            absences.push(Absence { node, from_tick: 0, to_tick: None });
        }
        for step in &self.steps {
            let tick = time.first_tick(step.at_ns);
            match step.change {
                Change::Off { node, .. } => {
                    last[node] = Some(absences.len());
                    absences.push(Absence { node, from_tick: tick, to_tick: None });
                }
                Change::On { node } => {
                    if let Some(absence) = last[node].and_then(|at| absences.get_mut(at)) {
                        absence.to_tick = Some(tick);
                    }
                }
                Change::Cut(..) | Change::Mend(..) => {}
            }
        }
        absences
            .retain(|absence| absence.to_tick != Some(absence.from_tick) && absence.from_tick <= time.ticks);
        absences
    }

    /// The disturbances of `events`, in their order.
    #[must_use]
    pub fn disturbances(&self, events: &[EventSpec]) -> Vec<Disturbance> {
        let of = |spec: &EventSpec| Disturbance { from_ns: spec.at_ns, end_ns: Some(spec.end_ns()) };
        let mut disturbances: Vec<_> = events.iter().map(of).collect();
        // Backwards: when each link is mended next.
        let mut mended = BTreeMap::new();
        for step in self.steps.iter().rev() {
            match step.change {
                Change::Mend(a, b) => drop(mended.insert((a, b), step.at_ns)),
                Change::Cut(a, b) => {
                    let end_ns = &mut disturbances[step.event].end_ns;
                    *end_ns = end_ns.zip(mended.get(&(a, b)).copied()).map(|(end, mended)| end.max(mended));
                }
                Change::Off { .. } | Change::On { .. } => {}
            }
        }
        disturbances
    }
}

/// The changes that an event makes, each with its time, ns.
fn changes(spec: &EventSpec, graph: &Graph) -> Vec<(u64, Change)> {
    let mut changes = Vec::new();
    if !spec.kind.is_of_presence() {
        return changes;
    }
    for &node in spec.targets.nodes() {
        changes.push(match spec.kind {
            EventKind::Join => (spec.at_ns, Change::On { node }),
            kind => (spec.at_ns, Change::Off { node, told: kind == EventKind::Leave }),
        });
        if spec.kind == EventKind::Bounce {
            changes.push((spec.at_ns.saturating_add(spec.lasts_ns), Change::On { node }));
        }
    }
    let links = spec.targets.links(graph).into_iter();
    let change = |(a, b)| if spec.kind == EventKind::Repair { Change::Mend(a, b) } else { Change::Cut(a, b) };
    changes.extend(links.map(|link| (spec.at_ns, change(link))));
    changes
}
