//! How far the clocks of nodes have come, and which of them has fallen silent. Times are nanoseconds since
//! the start.

use funnelnet_node::neighbour::{WINDOW_AHEAD, WINDOW_BACK};
use std::time::Duration;

/// Ticks for which a node may be silent before its tick is no measure of its clock any more.
const SILENT_TICKS: u64 = 3;

/// Nodes that tick by clocks of their own, by index.
pub(crate) struct Watch {
    tick_ns: u64,
    nodes: Vec<Watched>,
}

/// What is known of one node's clock.
#[derive(Clone, Debug, Default)]
struct Watched {
    /// Who hears it, by index.
    listeners: Vec<usize>,
    heard: u64,
    /// When it has last told of a tick, whatever else it says.
    told: u64,
    /// Tick of the newest state that it has sent.
    newest: u32,
    /// States in a row that a receiver which ticks had to refuse.
    outside: u32,
}

/// How a node fails that does not tell of its ticks any more.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Failing {
    /// It says nothing.
    Silent,
    /// It says other things.
    Babbling,
}

impl Watch {
    /// Of nodes with these listeners, from the start on.
    pub(crate) fn new(tick_ns: u64, listeners: impl IntoIterator<Item = Vec<usize>>) -> Self {
        let watched = |listeners| Watched { listeners, ..Watched::default() };
        Self { tick_ns, nodes: listeners.into_iter().map(watched).collect() }
    }

    /// Takes note that a node has said something.
    pub(crate) fn heard(&mut self, node: usize, now: u64) {
        if let Some(node) = self.nodes.get_mut(node) {
            node.heard = now;
        }
    }

    /// Takes note that a node has told of a whole tick.
    pub(crate) fn told(&mut self, node: usize, now: u64) {
        if let Some(node) = self.nodes.get_mut(node) {
            node.told = now;
        }
    }

    /// Takes note that a node has come to `tick`, whether or not its states come.
    pub(crate) fn reached(&mut self, node: usize, tick: u32) {
        if let Some(node) = self.nodes.get_mut(node) {
            node.newest = node.newest.max(tick);
        }
    }

    /// Takes the stamp of a state, and gives a listener that has had to refuse `patience` of them in a row.
    pub(crate) fn state(
        &mut self,
        node: usize,
        tick: u32,
        now: u64,
        patience: u32,
        runs: impl Fn(usize) -> bool,
    ) -> Option<usize> {
        let refuses = self.who_refuses(node, tick, now, runs);
        let watched = self.nodes.get_mut(node)?;
        watched.newest = tick;
        watched.outside = if refuses.is_some() { watched.outside + 1 } else { 0 };
        refuses.filter(|_| watched.outside >= patience)
    }

    /// The first node for which a state stamped `tick` of another one is too far from its own tick
    /// (protocol/README.md, "Ticks").
    fn who_refuses(&self, node: usize, tick: u32, now: u64, runs: impl Fn(usize) -> bool) -> Option<usize> {
        let silence = self.tick_ns.saturating_mul(SILENT_TICKS);
        let refuses = |&listener: &usize| {
            let Some(own) = self.nodes.get(listener) else { return false };
            let ahead = i64::from(tick) - i64::from(own.newest);
            let outside = ahead > i64::from(WINDOW_AHEAD) || ahead < -i64::from(WINDOW_BACK);
            outside && runs(listener) && now.saturating_sub(own.heard) < silence
        };
        self.nodes.get(node)?.listeners.iter().copied().find(refuses)
    }

    /// Two nodes, the one that is farther from the tick of most first.
    pub(crate) fn odd_and_even(&self, one: usize, other: usize) -> (usize, usize) {
        let mut ticks: Vec<_> = self.nodes.iter().map(|node| node.newest).collect();
        ticks.sort_unstable();
        let most = ticks.get(ticks.len() / 2).copied().unwrap_or(0);
        let from_most = |node| self.newest(node).abs_diff(most);
        if from_most(other) > from_most(one) { (other, one) } else { (one, other) }
    }

    /// Tick of the newest state of a node.
    pub(crate) fn newest(&self, node: usize) -> u32 {
        self.nodes.get(node).map_or(0, |node| node.newest)
    }

    /// How a node fails, if it has not told of a tick for longer than `limit`.
    pub(crate) fn failing(&self, node: usize, now: u64, limit: Duration) -> Option<Failing> {
        let node = self.nodes.get(node)?;
        let since = |then: u64| Duration::from_nanos(now.saturating_sub(then));
        match (since(node.told) > limit, since(node.heard) > limit) {
            (false, _) => None,
            (true, true) => Some(Failing::Silent),
            (true, false) => Some(Failing::Babbling),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const TICK: u64 = 1_000;

    /// Three nodes that all hear each other.
    fn watch() -> Watch {
        Watch::new(TICK, [vec![1, 2], vec![0, 2], vec![0, 1]])
    }

    #[test]
    fn a_clock_that_runs_away_is_named_once_a_listener_has_refused_enough() {
        let mut watch = watch();
        let far = WINDOW_AHEAD + 1;
        assert_eq!(watch.state(0, far, 0, 2, |_| true), None);
        assert_eq!(watch.state(0, far + 1, 0, 2, |_| true), Some(1));
        assert_eq!(watch.odd_and_even(1, 0), (0, 1));
        assert_eq!(watch.newest(0), far + 1);
    }

    #[test]
    fn one_state_that_is_taken_begins_the_count_anew() {
        let mut watch = watch();
        let far = WINDOW_AHEAD + 1;
        assert_eq!(watch.state(0, far, 0, 2, |_| true), None);
        assert_eq!(watch.state(0, 0, 0, 2, |_| true), None);
        assert_eq!(watch.state(0, far, 0, 2, |_| true), None);
    }

    #[test]
    fn who_has_stopped_or_fallen_silent_refuses_nothing() {
        let mut watch = watch();
        let far = WINDOW_AHEAD + 1;
        assert_eq!(watch.state(0, far, 0, 1, |_| false), None);
        assert_eq!(watch.state(0, far, 3 * TICK, 1, |_| true), None);
        watch.heard(2, TICK);
        assert_eq!(watch.state(0, far, 3 * TICK, 1, |_| true), Some(2));
        watch.reached(2, far);
        assert_eq!(watch.state(0, far, 3 * TICK, 1, |_| true), None);
    }

    #[test]
    fn silence_and_babble_are_told_apart_after_the_limit() {
        let mut watch = watch();
        let limit = Duration::from_nanos(5 * TICK);
        assert_eq!(watch.failing(0, 5 * TICK, limit), None);
        assert_eq!(watch.failing(0, 5 * TICK + 1, limit), Some(Failing::Silent));
        watch.heard(0, TICK);
        assert_eq!(watch.failing(0, 5 * TICK + 1, limit), Some(Failing::Babbling));
        watch.told(0, TICK);
        assert_eq!(watch.failing(0, 5 * TICK + 1, limit), None);
    }
}
