//! What a run keeps of its bus: a table by identifier and, where a log is wanted, what has happened since it
//! was last taken.

use funnelnet_can_bus::{Event, Id, Record, Table, What};
use std::collections::BTreeMap;

/// Keeps what happens on a bus.
#[derive(Debug, Default)]
pub struct Watch {
    /// Time of the bus at the scenario's t = 0, ns. What comes before, which is the announced states, has
    /// time 0 in a log.
    zero_ns: u64,
    records: Option<Vec<Record>>,
    table: Table,
    given: BTreeMap<Id, Given>,
}

/// Frames of one identifier that nodes have given to their ports.
#[derive(Clone, Copy, Debug, Default)]
struct Given {
    count: u64,
    /// Time of the last of them, ns.
    at: u64,
    /// The last of them has not been sent.
    waits: bool,
}

impl Watch {
    /// A watch; with `log`, it keeps what a log holds.
    #[must_use]
    pub fn new(zero_ns: u64, log: bool) -> Self {
        Self { zero_ns, records: log.then(Vec::new), ..Self::default() }
    }

    /// A node gives a frame to its port at `now` (ns): its latency counts from here.
    pub(super) fn give(&mut self, id: Id, now: u64) {
        let given = self.given.entry(id).or_default();
        *given = Given { count: given.count + 1, at: now, waits: true };
    }

    /// Takes an event of the bus.
    pub(super) fn take(&mut self, event: Event) {
        let since_given = self.since_given(event);
        self.table.add(&since_given);
        if let Some(records) = &mut self.records
            && let Some(record) = Record::of_event(&event)
        {
            records.push(record.at(record.at.saturating_sub(self.zero_ns)));
        }
    }

    /// The event with the time at which the node gave the frame, which may be before its transmit buffer had
    /// it.
    fn since_given(&mut self, mut event: Event) -> Event {
        if let What::Sent { frame, ready, .. } = &mut event.what
            && let Some(given) = self.given.get_mut(&frame.id())
            // Not of the next one, where that was given while this one was on its way.
            && given.at <= *ready
        {
            (*ready, given.waits) = (given.at, false);
        }
        event
    }

    /// Records for a log of what happened since the last call.
    pub fn take_records(&mut self) -> Vec<Record> {
        self.records.as_mut().map(std::mem::take).unwrap_or_default()
    }

    /// Table of what was carried so far.
    pub fn table(&self) -> &Table {
        &self.table
    }

    /// Frames of each identifier that were never sent, in order: the next one took their place, or the node
    /// was off the bus. One that still waits is none.
    pub fn unsent(&self) -> BTreeMap<Id, u64> {
        let sent: BTreeMap<Id, u64> = self.table.rows().map(|(id, row)| (id, row.frames)).collect();
        let unsent = |(&id, given): (&Id, &Given)| {
            let done = sent.get(&id).copied().unwrap_or(0) + u64::from(given.waits);
            (id, given.count.saturating_sub(done))
        };
        self.given.iter().map(unsent).collect()
    }
}
