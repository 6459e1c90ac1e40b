//! What the events of a scenario come to, step by step: which nodes are on and which links are cut at which time.

use super::{EventKind, EventSpec};
use crate::scenario::{Graph, TimeSpec};

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
    /// End: a bounced node is back, the links of a partition are mended; else the begin. None where links stay cut.
    pub end_ns: Option<u64>,
}

/// All steps of a scenario, in the order of time.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Course {
    steps: Vec<Step>,
}

impl Course {
    /// The course of `events`, which are in the order of time. What happens at the same time happens in the order of the file.
    #[must_use]
    pub fn of(events: &[EventSpec], graph: &Graph) -> Self {
        let mut steps: Vec<Step> = Vec::new();
        for (event, spec) in events.iter().enumerate() {
            let mut add = |at_ns, change| steps.push(Step { at_ns, event, change });
            for &node in spec.targets.nodes() {
                match spec.kind {
                    EventKind::Join => add(spec.at_ns, Change::On { node }),
                    kind => add(spec.at_ns, Change::Off { node, told: kind == EventKind::Leave }),
                }
                if spec.kind == EventKind::Bounce {
                    add(spec.at_ns.saturating_add(spec.lasts_ns), Change::On { node });
                }
            }
            for (a, b) in spec.targets.links(graph) {
                add(
                    spec.at_ns,
                    match spec.kind {
                        EventKind::Repair => Change::Mend(a, b),
                        _ => Change::Cut(a, b),
                    },
                );
            }
        }
        // Stable: a node that comes back has been bounced before the event that happens at that time.
        steps.sort_by_key(|step| step.at_ns);
        Self { steps }
    }

    /// The steps.
    #[must_use]
    pub fn steps(&self) -> &[Step] {
        &self.steps
    }

    /// Whether a node is absent from the start: the first thing that happens to it is that it comes.
    #[must_use]
    pub fn begins_absent(&self, node: usize) -> bool {
        let first = self.steps.iter().find(|step| step.change.node() == Some(node));
        first.is_some_and(|step| matches!(step.change, Change::On { .. }))
    }

    /// The absences of all `nodes`, in the order in which they begin. A node that is back before its next tick misses none.
    #[must_use]
    pub fn absences(&self, nodes: usize, time: &TimeSpec) -> Vec<Absence> {
        let mut absences: Vec<Absence> = Vec::new();
        let begins = (0..nodes).filter(|&node| self.begins_absent(node));
        absences.extend(begins.map(|node| Absence { node, from_tick: 0, to_tick: None }));
        for step in &self.steps {
            let tick = first_tick(step.at_ns, time);
            match step.change {
                Change::Off { node, .. } => absences.push(Absence { node, from_tick: tick, to_tick: None }),
                Change::On { node } => {
                    if let Some(absence) = absences.iter_mut().rev().find(|absence| absence.node == node) {
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
        let of = |(event, spec): (usize, &EventSpec)| {
            let end_ns = match spec.kind {
                EventKind::Partition => self.mended(event),
                _ => Some(spec.at_ns.saturating_add(spec.lasts_ns)),
            };
            Disturbance { from_ns: spec.at_ns, end_ns }
        };
        events.iter().enumerate().map(of).collect()
    }

    /// Time at which every link that `event` has cut is mended, ns.
    fn mended(&self, event: usize) -> Option<u64> {
        let cut = self.steps.iter().enumerate().filter(|(_, step)| step.event == event);
        let mended = cut.filter_map(|(at, step)| match step.change {
            Change::Cut(a, b) => {
                let mut later = self.steps.iter().skip(at);
                Some(later.find(|step| step.change == Change::Mend(a, b)).map(|step| step.at_ns))
            }
            _ => None,
        });
        mended.collect::<Option<Vec<u64>>>()?.into_iter().max()
    }
}

/// The first tick at or after a time: what happens at the time of a tick happens before it.
#[must_use]
pub(crate) fn first_tick(at_ns: u64, time: &TimeSpec) -> u64 {
    at_ns.div_ceil(time.tick_ns)
}
