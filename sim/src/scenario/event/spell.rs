//! What events do to frames for a while, link by link and on the whole bus, in the time of the engine.

use super::{Detail, EventKind, EventSpec};
use crate::scenario::{Graph, Loss, Scenario, TimeSpec};
use std::collections::BTreeMap;
use std::ops::Range;

/// What happens to frames on their way from one node to another for a while.
#[derive(Clone, Debug, PartialEq)]
pub struct Spell {
    /// Index of the sender.
    pub from: usize,
    /// Index of the receiver.
    pub to: usize,
    /// Number of the event, for its random stream.
    pub event: usize,
    /// Engine time, ns.
    pub during: Range<u64>,
    /// What happens.
    pub does: Does,
}

/// What happens to frames.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Does {
    /// They get lost.
    Lose(Loss),
    /// A bit of one is read wrong, with this probability.
    Corrupt(f64),
    /// They wait until the spell is over.
    Hold,
}

/// Bit errors of a bus for a while.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct NoisySpell {
    /// Engine time, ns.
    pub during: Range<u64>,
    /// Disturbed bits among a billion.
    pub per_billion: u32,
}

/// What happens to the wire of a CAN bus, or to who is on it, for a while.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Harm {
    /// It is dominant (engine time, ns).
    Short(Range<u64>),
    /// The connector of a node is off.
    Cut {
        /// Its index.
        node: usize,
        /// Engine time, ns.
        during: Range<u64>,
    },
    /// A node sends without end.
    Babble {
        /// Its index.
        node: usize,
        /// The 11-bit identifier of what it sends.
        id: u16,
        /// Engine time, ns.
        during: Range<u64>,
    },
}

impl Scenario {
    /// What its events do to frames on their links, event by event.
    #[must_use]
    pub fn spells(&self) -> Vec<Spell> {
        let let_go = let_go(&self.events, &self.graph);
        let of = |(event, spec): (usize, &EventSpec)| {
            let does = match (spec.kind, &spec.detail) {
                (EventKind::Burst, Detail::Loss(loss)) => Does::Lose(*loss),
                (EventKind::Corrupt, Detail::Corrupt(probability)) => Does::Corrupt(*probability),
                (EventKind::Hold, _) => Does::Hold,
                _ => return Vec::new(),
            };
            let links = spec.targets.frames(&self.graph).into_iter();
            let spell = |(from, to, during)| Spell { from, to, event, during, does };
            let both = |(a, b)| {
                let until = let_go.get(&(event, (a, b))).copied().unwrap_or(spec.end_ns());
                let during = on_engine(&self.time, spec.at_ns, until);
                [(a, b, during.clone()), (b, a, during)].map(spell)
            };
            links.flat_map(both).collect()
        };
        self.events.iter().enumerate().flat_map(of).collect()
    }

    /// What its events do to the wire of a CAN bus, event by event.
    #[must_use]
    pub fn harms(&self) -> Vec<Harm> {
        let of = |spec: &EventSpec| {
            let during = on_engine(&self.time, spec.at_ns, spec.end_ns());
            let of_node = |&node: &usize| match (spec.kind, &spec.detail) {
                (EventKind::Cut, _) => Some(Harm::Cut { node, during: during.clone() }),
                (EventKind::Babble, &Detail::Babble(id)) => {
                    Some(Harm::Babble { node, id, during: during.clone() })
                }
                _ => None,
            };
            let of_bus = (spec.kind == EventKind::Short).then(|| Harm::Short(during.clone()));
            let of_nodes: Vec<Harm> = spec.targets.nodes().iter().filter_map(of_node).collect();
            of_bus.into_iter().chain(of_nodes)
        };
        self.events.iter().flat_map(of).collect()
    }

    /// What its events do to the bits of a bus.
    #[must_use]
    pub fn noisy_spells(&self) -> Vec<NoisySpell> {
        let of = |spec: &EventSpec| match spec.detail {
            Detail::BitErrors(per_billion) => {
                let during = on_engine(&self.time, spec.at_ns, spec.end_ns());
                Some(NoisySpell { during, per_billion })
            }
            _ => None,
        };
        self.events.iter().filter_map(of).collect()
    }
}

/// Engine time of a time of the scenario: tick 0 comes a period after the start, before which nodes announce themselves.
pub(crate) fn on_engine(time: &TimeSpec, from_ns: u64, to_ns: u64) -> Range<u64> {
    let engine = |at_ns: u64| time.on_clock(at_ns).saturating_add(time.tick_ns);
    let from = if from_ns == 0 { 0 } else { engine(from_ns) };
    from..engine(to_ns)
}

/// When frames that are held back are let go, ns: by event and link. A hold that nothing ends has no end but `u64::MAX`.
pub(super) fn let_go(events: &[EventSpec], graph: &Graph) -> BTreeMap<(usize, (usize, usize)), u64> {
    let (mut ends, mut released) = (BTreeMap::new(), BTreeMap::new());
    // Backwards: when each link is released next.
    for (index, event) in events.iter().enumerate().rev() {
        match event.kind {
            EventKind::Release => {
                let links = event.targets.frames(graph).into_iter();
                released.extend(links.map(|link| (link, event.at_ns)));
            }
            EventKind::Hold => {
                let end = |link| released.get(&link).copied().unwrap_or(u64::MAX).min(event.end_ns());
                let links = event.targets.frames(graph).into_iter();
                ends.extend(links.map(|link| ((index, link), end(link))));
            }
            _ => {}
        }
    }
    ends
}
