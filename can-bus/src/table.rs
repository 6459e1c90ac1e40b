//! What a bus has carried, by identifier: frames, errors, waits, latencies, and who lost the arbitration to
//! whom.

use crate::counters::Mode;
use crate::event::{Event, What};
use crate::frame::{Id, LARGEST_BASE};
use crate::wire::Field;
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

    /// The latency that this part (per mille) of them does not exceed, ns; up to a sixteenth too long. None,
    /// if there are none.
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

/// The longest latency of a class. A class above the first 32 has its leading bit in the part that is not
/// shifted.
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
    /// Longest time from when it was ready to the start of the attempt that succeeded, ns.
    pub longest_wait: u64,
    /// Times from when it was ready to the last bit of the frame, ns.
    pub latencies: Latencies,
}

/// What a bus has carried. It grows with the number of identifiers, not with time.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Table {
    /// By place.
    rows: Vec<Row>,
    /// How often the identifier at the first place lost to the one at the second.
    losses: Vec<Vec<u64>>,
    places: BTreeMap<Id, usize>,
    /// The same for base identifiers, which are most: looked up for each lost arbitration.
    base: Vec<usize>,
    errors: u64,
    failed: u64,
    overflows: u64,
    passive: u64,
    off: u64,
}

/// No place.
const NONE: usize = usize::MAX;

impl Table {
    /// Takes an event of the bus.
    pub fn add(&mut self, event: &Event) {
        match event.what {
            What::Sent { frame, ready, started, errors, .. } => {
                let row = self.row(frame.id());
                row.frames += 1;
                row.errors += u64::from(errors);
                row.longest_wait = row.longest_wait.max(started - ready.min(started));
                row.latencies.add(event.at - ready);
            }
            What::LostArbitration { id, to } => self.lose(id, to),
            What::Error { sender, field, .. } => {
                self.errors += 1;
                self.failed += u64::from(sender && field != Field::Between);
            }
            What::Received { lost, .. } => self.overflows += u64::from(lost),
            What::Mode { mode, .. } => {
                self.passive += u64::from(mode == Mode::Passive);
                self.off += u64::from(mode == Mode::Off);
            }
            What::Overload => {}
        }
    }

    /// Takes a frame of a log, with the time since it was ready (ns) where that is known.
    pub fn add_logged(&mut self, id: Id, latency: Option<u64>) {
        let row = self.row(id);
        row.frames += 1;
        latency.into_iter().for_each(|latency| row.latencies.add(latency));
    }

    fn lose(&mut self, id: Id, to: Option<Id>) {
        self.row(id).losses += 1;
        let Some(to) = to else { return };
        let (loser, winner) = (self.place(id), self.place(to));
        let of_loser = &mut self.losses[loser];
        if of_loser.len() <= winner {
            of_loser.resize(winner + 1, 0);
        }
        of_loser[winner] += 1;
    }

    fn row(&mut self, id: Id) -> &mut Row {
        let place = self.place(id);
        &mut self.rows[place]
    }

    fn place(&mut self, id: Id) -> usize {
        if let Id::Base(base) = id {
            match self.base.get(usize::from(base)) {
                None => self.base.resize(usize::from(LARGEST_BASE) + 1, NONE),
                Some(&NONE) => {}
                Some(&place) => return place,
            }
        }
        let next = self.rows.len();
        let place = *self.places.entry(id).or_insert(next);
        if place == next {
            self.rows.push(Row::default());
            self.losses.push(Vec::new());
        }
        if let Id::Base(base) = id {
            self.base[usize::from(base)] = place;
        }
        place
    }

    /// Identifiers with what was carried of them, in order.
    pub fn rows(&self) -> impl Iterator<Item = (Id, &Row)> {
        self.places.iter().map(|(&id, &place)| (id, &self.rows[place]))
    }

    /// How often an identifier (first) lost the arbitration to another (second), in order.
    pub fn losses(&self) -> impl Iterator<Item = (Id, Id, u64)> {
        let winners = move |(&loser, &place): (&Id, &usize)| {
            self.places.iter().filter_map(move |(&winner, &at)| {
                let count = self.losses[place].get(at).copied().filter(|&count| count > 0)?;
                Some((loser, winner, count))
            })
        };
        self.places.iter().flat_map(winners)
    }

    /// Errors that controllers have seen; one disturbed bit is one for each.
    pub fn errors(&self) -> u64 {
        self.errors
    }

    /// Attempts to send that ended in an error.
    pub fn failed(&self) -> u64 {
        self.failed
    }

    /// Frames for which the receive FIFO of a controller had no room.
    pub fn overflows(&self) -> u64 {
        self.overflows
    }

    /// How often a controller became error-passive.
    pub fn passive(&self) -> u64 {
        self.passive
    }

    /// How often a controller went off the bus.
    pub fn off(&self) -> u64 {
        self.off
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

    #[test]
    fn who_lost_to_whom_is_counted_by_identifier_and_told_in_order() {
        let mut table = Table::default();
        let ids = [Id::Extended(7), Id::Base(0x200), Id::Base(0x180)];
        let lost = |id, to| Event { at: 0, node: 0, what: What::LostArbitration { id, to } };
        for (loser, winner) in [(0, 1), (0, 2), (0, 1), (1, 2)] {
            table.add(&lost(ids[loser], Some(ids[winner])));
        }
        table.add(&lost(ids[0], None));
        let losses: Vec<_> = table.losses().collect();
        assert_eq!(losses, [(ids[1], ids[2], 1), (ids[0], ids[2], 1), (ids[0], ids[1], 2)]);
        let rows: Vec<_> = table.rows().map(|(id, row)| (id, row.losses)).collect();
        assert_eq!(rows, [(ids[2], 0), (ids[1], 1), (ids[0], 4)]);
    }
}
