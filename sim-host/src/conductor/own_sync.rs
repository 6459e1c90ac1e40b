//! SYNC of time masters among nodes that tick by their own clock: this program is the medium that carries it, as
//! it carries states (docs/notes/2026-11-30-time.md).
//!
//! It goes to all nodes at once, over no link of the graph. What the scenario's bus loses or delays is not applied
//! to it: SYNC says when it was on the wire, and a bench has its own delays.

use super::member::Member;
use super::{Conductor, HubError};
use funnelnet_protocol::message::{Message, NodeId};
use funnelnet_protocol::serial;

/// What belongs to SYNC that this program carries.
#[derive(Debug, Default)]
pub(super) struct Medium {
    /// From and to when SYNC of a node is not carried, by index, ns.
    silences: Vec<Vec<(u64, u64)>>,
    /// What waits for buses, and the bus that it came from.
    for_can: Vec<(Option<usize>, Message)>,
    leader: Option<usize>,
    counts: SyncCounts,
}

/// SYNC of a run, as this program has heard it.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct SyncCounts {
    /// Frames of time masters.
    pub frames: u64,
    /// Those of them that an event had this program not carry.
    pub kept: u64,
    /// How often another node than before was time master.
    pub masters: u64,
}

impl Medium {
    /// Takes note of a SYNC of a node at `now` (ns); whether it is carried.
    fn take(&mut self, index: usize, now: u64) -> bool {
        self.counts.frames += 1;
        let is_kept =
            |silences: &Vec<(u64, u64)>| silences.iter().any(|&(from, to)| (from..to).contains(&now));
        if self.silences.get(index).is_some_and(is_kept) {
            self.counts.kept += 1;
            return false;
        }
        // Who is not heard leads nobody.
        if self.leader.replace(index) != Some(index) {
            self.counts.masters += 1;
        }
        true
    }
}

impl Conductor {
    /// With time masters among nodes that tick by their own clock; `silences` are from and to when SYNC of a node is
    /// not carried, by index, ns since the start.
    #[must_use]
    pub fn with_sync(mut self, silences: Vec<Vec<(u64, u64)>>) -> Self {
        if let Some(own) = &mut self.own {
            own.medium = Some(Medium { silences, ..Medium::default() });
        }
        self
    }

    /// SYNC so far; none where nobody keeps time by it.
    pub fn syncs(&self) -> Option<SyncCounts> {
        Some(self.own.as_ref()?.medium.as_ref()?.counts)
    }

    /// Carries a SYNC of a node to all others that do not hear it themselves.
    pub(super) fn carry_sync(&mut self, index: usize, source: NodeId, sync: &Message, now: u64) {
        let from = self.nodes.get(index).map(|node| (node.config.id, node.on_can));
        let Some((_, bus)) = from.filter(|&(id, _)| id == source.get()) else { return };
        let Some(medium) = self.own.as_mut().and_then(|own| own.medium.as_mut()) else { return };
        let is_carried = medium.take(index, now);
        let tick = self.tick;
        // Those on its own bus have heard it in any case, and those on other buses hear what is carried.
        let hear = |node: &Member| match node.on_can {
            Some(_) if node.on_can == bus => true,
            _ => is_carried,
        };
        let others = self.nodes.iter().enumerate().filter(|&(to, node)| to != index && is_running(node));
        for (to, _) in others.filter(|(_, node)| hear(node)) {
            self.hearing.hand(index, to, false, tick);
        }
        if !is_carried {
            return;
        }
        if !self.can.is_empty() {
            medium.for_can.push((bus, *sync));
        }
        let bytes = serial::encode(sync);
        let on_lines = self.nodes.iter_mut().enumerate().filter(|(_, node)| node.on_can.is_none());
        for (_, node) in on_lines.filter(|(to, node)| *to != index && is_running(node)) {
            node.contact.queue(&bytes);
        }
    }

    /// Says on the buses what waits for them.
    pub(super) async fn say_syncs(&mut self) -> Result<(), HubError> {
        let medium = self.own.as_mut().and_then(|own| own.medium.as_mut());
        let waiting = medium.map_or_else(Vec::new, |medium| std::mem::take(&mut medium.for_can));
        for (from, sync) in waiting {
            self.say_on_others(from, &sync).await?;
        }
        Ok(())
    }
}

fn is_running(node: &Member) -> bool {
    node.is_here() && !node.stopped
}
