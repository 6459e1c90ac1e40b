//! Who has heard whom, as far as this program can know: by what it has handed over, and by what nodes say
//! that they have accepted.

use super::Conductor;
use funnelnet_protocol::report::Report;

/// CTRL frames that a node accepts in a run: start and stop.
const COMMANDS: u64 = 2;

/// What was handed over.
#[derive(Clone, Debug)]
pub(super) struct Hearing {
    nodes: usize,
    /// Tick at which a state of a node was last handed to another one, by sender and then by receiver.
    last: Vec<Option<u32>>,
    /// Components of states that were handed to a node, and other frames.
    handed: Vec<(u64, u64)>,
}

impl Hearing {
    pub(super) fn of(nodes: usize) -> Self {
        Self { nodes, last: vec![None; nodes * nodes], handed: vec![(0, 0); nodes] }
    }

    /// A frame of one node was handed to another one.
    pub(super) fn hand(&mut self, from: usize, to: usize, is_state: bool, tick: u32) {
        if let Some((states, others)) = self.handed.get_mut(to) {
            *(if is_state { states } else { others }) += 1;
        }
        if let Some(last) = self.last.get_mut(from * self.nodes + to).filter(|_| is_state) {
            *last = Some(tick);
        }
    }

    /// A node was told something beside start and stop.
    pub(super) fn command(&mut self, to: usize) {
        if let Some((_, others)) = self.handed.get_mut(to) {
            *others += 1;
        }
    }

    /// Forgets what was handed to a node before it came.
    pub(super) fn forget(&mut self, to: usize) {
        if let Some(handed) = self.handed.get_mut(to) {
            *handed = (0, 0);
        }
    }

    fn last(&self, from: usize, to: usize) -> Option<u32> {
        self.last.get(from * self.nodes + to).copied().flatten()
    }

    fn handed(&self, to: usize) -> (u64, u64) {
        self.handed.get(to).copied().unwrap_or_default()
    }
}

impl Conductor {
    /// Ids of nodes with neighbours of which none has ever heard a state of it; `reports` by index.
    pub fn unheard(&self, reports: &[Option<Report>]) -> Vec<u16> {
        let report = |index: usize| reports.get(index).and_then(Option::as_ref);
        let heard = |from: usize, to: usize| {
            if report(to).is_some_and(|report| self.accepted(to, report) == 0) {
                return false;
            }
            match self.bus.carries(from, to) {
                true => self.hearing.last(from, to).is_some(),
                false => report(to).is_none_or(|report| self.may_have_heard_by_wire(to, report)),
            }
        };
        self.those_who(|from, neighbours| neighbours.iter().all(|&to| !heard(from, to)))
    }

    /// Ids of nodes that run to the end, and whose states reach none of the neighbours that do so, too, any
    /// more; `reports` by index.
    pub fn silent(&self, reports: &[Option<Report>]) -> Vec<u16> {
        let runs = |index: usize| self.nodes.get(index).is_some_and(|node| node.is_here() && !node.stopped);
        let has_lost = |from: usize, to: usize| {
            let (Some(node), Some(Some(report))) = (self.nodes.get(to), reports.get(to)) else {
                return false;
            };
            let patience = u32::from(node.config.extrapolate_ticks);
            let late =
                self.hearing.last(from, to).is_none_or(|last| self.tick.saturating_sub(last) > patience);
            late && report.counters.neighbours_lost > 0 && self.bus.carries(from, to)
        };
        self.those_who(|from, neighbours| {
            let running: Vec<_> = neighbours.iter().copied().filter(|&to| runs(to)).collect();
            runs(from) && !running.is_empty() && running.iter().all(|&to| has_lost(from, to))
        })
    }

    /// Ids of nodes for which something holds of their index and those of their neighbours. Nobody hears anybody
    /// over a link that an event keeps cut at the end, or a node that it keeps off.
    fn those_who(&self, holds: impl Fn(usize, &[usize]) -> bool) -> Vec<u16> {
        let index = |id: u8| self.nodes.iter().position(|node| node.config.id == id);
        let of = |(from, node): (usize, &super::member::Member)| {
            let neighbours: Vec<_> = node
                .config
                .neighbours
                .iter()
                .filter_map(|edge| index(edge.id))
                .filter(|&near| self.are_joined(from, near))
                .collect();
            (!neighbours.is_empty() && holds(from, &neighbours)).then_some(u16::from(node.config.id))
        };
        self.nodes.iter().enumerate().filter_map(of).collect()
    }

    /// Components of states that a node has accepted: the rest are SYNC and CTRL, and what else was handed to
    /// it, such as announced weights.
    fn accepted(&self, to: usize, report: &Report) -> u64 {
        let syncs = if self.own.is_some() { 0 } else { report.counters.ticks };
        let (_, others) = self.hearing.handed(to);
        u64::from(report.counters.accepted).saturating_sub(u64::from(syncs) + COMMANDS + others)
    }

    /// Whether more states have come to a node than this program has handed to it.
    fn may_have_heard_by_wire(&self, to: usize, report: &Report) -> bool {
        let refused = report.counters.all_refused();
        let (states, _) = self.hearing.handed(to);
        self.accepted(to, report) + refused > states
    }
}
