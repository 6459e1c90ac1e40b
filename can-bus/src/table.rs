//! What a bus has carried, by identifier: frames, errors, waits, latencies, and who lost the arbitration to whom.

use crate::event::{Event, What};
use crate::frame::Id;
use std::collections::BTreeMap;

/// Latencies, counted in classes of a sixteenth of their size.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Latencies {
    classes: BTreeMap<u16, u64>,
    count: u64,
    longest: u64,
}

/// Bits that distinguish the classes between two powers of two.
const FINE: u32 = 4;

impl Latencies {
    /// Counts a latency, ns.
    pub fn add(&mut self, ns: u64) {
        *self.classes.entry(class(ns)).or_default() += 1;
        self.count += 1;
        self.longest = self.longest.max(ns);
    }

    /// How many were counted.
    pub fn count(&self) -> u64 {
        self.count
    }

    /// The longest one, ns.
    pub fn longest(&self) -> u64 {
        self.longest
    }

    /// The latency that this part (per mille) of them does not exceed, ns; up to a sixteenth too long. None, if there are none.
    pub fn percentile(&self, per_mille: u64) -> Option<u64> {
        let wanted = (self.count * per_mille.min(1000)).div_ceil(1000).max(1);
        let mut so_far = 0;
        let reached = |(&class, &count): (&u16, &u64)| {
            so_far += count;
            (so_far >= wanted).then_some(class)
        };
        self.classes.iter().find_map(reached).map(|class| last_of(class).min(self.longest))
    }
}

fn class(ns: u64) -> u16 {
    let shift = (u64::BITS - ns.leading_zeros()).saturating_sub(FINE + 1);
    (shift << FINE) as u16 + (ns >> shift) as u16
}

/// The longest latency of a class. A class above the first 32 has its leading bit in the part that is not shifted.
fn last_of(class: u16) -> u64 {
    let shift = (class >> FINE).saturating_sub(1);
    let first = u64::from(class - (shift << FINE));
    (first << shift) | ((1 << shift) - 1)
}

/// What the bus has carried of one identifier.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Row {
    /// Frames that were sent.
    pub frames: u64,
    /// Attempts of them that ended in an error.
    pub errors: u64,
    /// Lost arbitrations.
    pub losses: u64,
    /// Longest time from the transmit buffer to the start of the attempt that succeeded, ns.
    pub longest_wait: u64,
    /// Times from the transmit buffer to the last bit of the frame, ns.
    pub latencies: Latencies,
}

/// What a bus has carried. It grows with the number of identifiers, not with time.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Table {
    rows: BTreeMap<Id, Row>,
    losses: BTreeMap<(Id, Id), u64>,
    errors: u64,
    overflows: u64,
}

impl Table {
    /// Takes an event of the bus.
    pub fn add(&mut self, event: &Event) {
        match event.what {
            What::Sent { frame, ready, started, errors, .. } => {
                let row = self.rows.entry(frame.id()).or_default();
                row.frames += 1;
                row.errors += u64::from(errors);
                row.longest_wait = row.longest_wait.max(started - ready.min(started));
                row.latencies.add(event.at - ready);
            }
            What::LostArbitration { id, to } => {
                self.rows.entry(id).or_default().losses += 1;
                if let Some(to) = to {
                    *self.losses.entry((id, to)).or_default() += 1;
                }
            }
            What::Error { .. } => self.errors += 1,
            What::Received { lost, .. } => self.overflows += u64::from(lost),
            What::Overload | What::Mode { .. } => {}
        }
    }

    /// Identifiers with what was carried of them, in order.
    pub fn rows(&self) -> impl Iterator<Item = (Id, &Row)> {
        self.rows.iter().map(|(&id, row)| (id, row))
    }

    /// How often an identifier (first) lost the arbitration to another (second), in order.
    pub fn losses(&self) -> impl Iterator<Item = (Id, Id, u64)> {
        self.losses.iter().map(|(&(loser, winner), &count)| (loser, winner, count))
    }

    /// Errors that controllers have seen; one disturbed bit is one for each.
    pub fn errors(&self) -> u64 {
        self.errors
    }

    /// Frames for which the receive FIFO of a controller had no room.
    pub fn overflows(&self) -> u64 {
        self.overflows
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn percentiles_are_at_most_a_sixteenth_too_long() {
        let mut latencies = Latencies::default();
        assert_eq!(latencies.percentile(500), None);
        (1..=10_000).for_each(|ns| latencies.add(ns * 1000));
        for (per_mille, exact) in [(1, 10_000), (500, 5_000_000), (990, 9_900_000), (1000, 10_000_000)] {
            let found = latencies.percentile(per_mille).unwrap();
            assert!((exact..=exact + exact / 16).contains(&found), "{per_mille}: {found}");
        }
        assert_eq!((latencies.count(), latencies.longest()), (10_000, 10_000_000));
    }

    #[test]
    fn every_latency_is_within_its_class() {
        for ns in (0..200_000).chain([u64::MAX / 3, u64::MAX]) {
            let last = last_of(class(ns));
            assert!(last >= ns && last - ns <= ns / 16, "{ns}: {last}");
            assert_eq!(class(last), class(ns));
        }
    }
}
