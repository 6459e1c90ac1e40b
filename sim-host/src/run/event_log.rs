//! What nodes reported, in bounded memory: a node that leaves its funnel at every tick of an hour says so
//! seven million times.

use crate::engine::NodeEvent;
use funnelnet_node::Event;
use std::mem::{Discriminant, discriminant};

/// Events of a kind of a node that are kept one by one.
pub(super) const NAMED: u64 = 100;

/// Events of one kind of one node beyond those that are kept.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct MoreEvents {
    /// How many.
    pub count: u64,
    /// The last of them.
    pub last: NodeEvent,
}

/// The first [`NAMED`] events of each kind of each node, and of more their number and the last one.
#[derive(Debug, Default)]
pub(super) struct EventLog {
    named: Vec<NodeEvent>,
    /// By node.
    kinds: Vec<Vec<Kind>>,
    /// Events of a list that grows which have been taken.
    seen: usize,
}

/// One kind of one node.
#[derive(Debug)]
struct Kind {
    kind: Discriminant<Event>,
    count: u64,
    last: NodeEvent,
}

impl EventLog {
    /// Takes the next events.
    pub(super) fn take(&mut self, events: impl IntoIterator<Item = NodeEvent>) {
        events.into_iter().for_each(|event| self.push(event));
    }

    /// Takes those of a list that grows which it has not taken yet.
    pub(super) fn catch_up(&mut self, all: &[NodeEvent]) {
        self.take(all.iter().skip(self.seen).copied());
        self.seen = all.len();
    }

    fn push(&mut self, event: NodeEvent) {
        if self.kinds.len() <= event.node {
            self.kinds.resize_with(event.node + 1, Vec::new);
        }
        let (kind, kinds) = (discriminant(&event.event), &mut self.kinds[event.node]);
        let count = match kinds.iter_mut().find(|known| known.kind == kind) {
            Some(known) => {
                (known.count, known.last) = (known.count + 1, event);
                known.count
            }
            None => {
                kinds.push(Kind { kind, count: 1, last: event });
                1
            }
        };
        if count <= NAMED {
            self.named.push(event);
        }
    }

    /// Those that were kept, and what came of the others, by node.
    pub(super) fn finish(self) -> (Vec<NodeEvent>, Vec<MoreEvents>) {
        let more = |kind: Kind| {
            let count = kind.count.checked_sub(NAMED).filter(|&count| count > 0)?;
            Some(MoreEvents { count, last: kind.last })
        };
        (self.named, self.kinds.into_iter().flatten().filter_map(more).collect())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn of_a_kind_that_goes_on_for_ever_the_first_are_kept_and_the_others_counted() {
        let mut log = EventLog::default();
        let event = |at, node, event| NodeEvent { at, node, event };
        for k in 0..250_u32 {
            let at = u64::from(k);
            log.push(event(at, 1, Event::BreachBegan { tick: k, ratio: 2.0 }));
            log.push(event(at, 1, Event::BreachEnded { tick: k }));
            if k < 100 {
                log.push(event(at, 0, Event::BreachEnded { tick: k }));
            }
        }
        log.catch_up(&[event(250, 2, Event::Started)]);
        log.catch_up(&[event(250, 2, Event::Started), event(251, 1, Event::Stopped)]);
        let (named, more) = log.finish();
        assert_eq!(named.len(), 302);
        assert!(named.is_sorted_by_key(|event| event.at));
        assert_eq!(named[301].event, Event::Stopped, "a kind that is rare is not lost in the others");
        let last = |event| MoreEvents { count: 150, last: NodeEvent { at: 249, node: 1, event } };
        let expected = [Event::BreachBegan { tick: 249, ratio: 2.0 }, Event::BreachEnded { tick: 249 }];
        assert_eq!(more, expected.map(last));
    }
}
