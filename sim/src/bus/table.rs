//! What a CAN bus carried, by identifier: the same table for loopback, for a bench by its log, and as `check`
//! computes it.

use crate::number_format::significant;
use funnelnet_can_bus::table::{Latencies, Row};
use funnelnet_can_bus::{Id, Table};
use serde::{Serialize, Serializer};
use std::collections::BTreeMap;

/// Identifiers that the text shows.
const SHOWN: usize = 10;
/// Identifiers that won over another one, for each: the most frequent.
const WINNERS: usize = 3;

/// Table of one bus. What is not known is `null`: a log does not say who lost an arbitration, nor what
/// waited.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct BusTable {
    /// Its name.
    pub interface: String,
    /// Nominal bit rate, bit/s.
    pub bitrate: Option<u32>,
    /// Share of the time that it was busy, from each start of frame to the end of the intermission, error
    /// frames included, 0 to 1.
    pub utilisation: Option<f64>,
    /// Attempts to send that ended in an error.
    pub error_frames: Option<u64>,
    /// Frames that a controller's receive FIFO had no room for.
    pub fifo_overflows: Option<u64>,
    /// Frames that a driver's queue had no room for.
    pub queue_overflows: Option<u64>,
    /// Number of times that a controller became error-passive.
    pub error_passive: Option<u64>,
    /// Number of times that a controller went off the bus.
    pub bus_off: Option<u64>,
    /// Frames that were never sent, for want of room: the next one took their place.
    pub unsent: Option<u64>,
    /// Instant that latencies count from: `tick`, when the node gave the frame to its port, or `sync`, when
    /// SYNC of its tick was on the bus.
    pub latency_from: Option<&'static str>,
    /// Rows by identifier, the most urgent first.
    pub identifiers: Vec<IdentifierRow>,
}

/// Row of one identifier.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct IdentifierRow {
    /// Identifier, three hexadecimal digits, or eight.
    pub id: String,
    /// The node that sends it; `null` where it is none of a node.
    pub node: Option<u8>,
    /// Frames sent.
    pub frames: u64,
    /// Attempts of them that ended in an error.
    pub errors: Option<u64>,
    /// Frames that were never sent.
    pub unsent: Option<u64>,
    /// Lost arbitrations.
    pub lost: Option<u64>,
    /// The identifiers that won most of them, and how many.
    pub lost_to: Vec<(String, u64)>,
    /// Longest time to the start of the attempt that succeeded, s.
    pub longest_wait_s: Option<f64>,
    /// Time to the last bit; `null` where it is not known.
    pub latency_s: Option<LatencyRow>,
}

/// Latencies, s. A share is up to a sixteenth too long, the longest one is exact.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub struct LatencyRow {
    /// Half of the frames have no more.
    pub p50: Option<f64>,
    /// 99 % have no more.
    pub p99: Option<f64>,
    /// The longest.
    pub max: f64,
}

/// One per bus, in the order of the bench file: an object where there is one, an array where there are
/// several.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct BusTables(pub Vec<BusTable>);

impl BusTables {
    /// Whether there is none.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.0.is_empty()
    }
}

impl Serialize for BusTables {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        match self.0.as_slice() {
            [table] => table.serialize(serializer),
            tables => tables.serialize(serializer),
        }
    }
}

impl BusTable {
    /// Table of a simulated bus, which knows all of it.
    #[must_use]
    pub fn of_simulation(table: &Table, unsent: &BTreeMap<Id, u64>) -> Self {
        // What was never sent at all has no row.
        let none = Row::default();
        let rows: BTreeMap<Id, &Row> = table.rows().collect();
        let ids: std::collections::BTreeSet<Id> = rows
            .keys()
            .copied()
            .chain(unsent.iter().filter(|(_, count)| **count > 0).map(|(&id, _)| id))
            .collect();
        let mut winners: BTreeMap<Id, Vec<(u64, Id)>> = BTreeMap::new();
        for (loser, winner, count) in table.losses() {
            winners.entry(loser).or_default().push((count, winner));
        }
        let row = |id: Id| {
            let row = rows.get(&id).copied().unwrap_or(&none);
            let mut won = winners.remove(&id).unwrap_or_default();
            // Stable: of equally many the most urgent first.
            won.sort_by_key(|&(count, _)| std::cmp::Reverse(count));
            won.truncate(WINNERS);
            IdentifierRow {
                errors: Some(row.errors),
                unsent: Some(unsent.get(&id).copied().unwrap_or(0)),
                lost: Some(row.losses),
                lost_to: won.into_iter().map(|(count, id)| (id.to_string(), count)).collect(),
                longest_wait_s: (row.frames > 0).then_some(row.longest_wait as f64 / 1e9),
                ..IdentifierRow::new(id, row)
            }
        };
        Self {
            error_frames: Some(table.failed()),
            fifo_overflows: Some(table.overflows()),
            error_passive: Some(table.passive()),
            bus_off: Some(table.off()),
            unsent: Some(unsent.values().sum()),
            latency_from: Some("tick"),
            identifiers: ids.into_iter().map(row).collect(),
            ..Self::default()
        }
    }

    /// Table of what a log says.
    #[must_use]
    pub fn of_log(table: &Table) -> Self {
        let identifiers = table.rows().map(|(id, row)| IdentifierRow::new(id, row)).collect();
        Self { identifiers, ..Self::default() }
    }

    /// Lines for people: the figures of the bus, then the identifiers whose frames took longest.
    #[must_use]
    pub fn told(&self) -> Vec<String> {
        let mut lines = vec![self.headline()];
        if self.identifiers.is_empty() {
            return lines;
        }
        let mut shown: Vec<&IdentifierRow> = self.identifiers.iter().collect();
        let longest = |row: &IdentifierRow| row.latency_s.map_or(0.0, |latency| latency.max);
        let most = self.identifiers.iter().map(|row| row.frames).max().unwrap_or(0);
        let unsent = |row: &IdentifierRow| row.unsent.unwrap_or(0);
        let is_rare = |row: &IdentifierRow| row.frames < most / 2;
        // What was never sent first; then of what comes every tick the longest latencies; then of the rest.
        shown.sort_by(|a, b| {
            let rare = is_rare(a).cmp(&is_rare(b));
            unsent(b).cmp(&unsent(a)).then(rare).then(longest(b).total_cmp(&longest(a)))
        });
        shown.truncate(SHOWN);
        shown.sort_by_key(|row| self.identifiers.iter().position(|other| other.id == row.id));
        lines.push(format!(
            "{:<9}{:>5}{:>9}{:>8}{:>8}{:>11}{:>11}{:>13}{:>9}  {}",
            "id",
            "node",
            "frames",
            "unsent",
            "errors",
            "half, us",
            "99 %, us",
            "longest, us",
            "lost",
            "most to"
        ));
        lines.extend(shown.into_iter().map(IdentifierRow::told));
        let more = self.identifiers.len().saturating_sub(SHOWN);
        if more > 0 {
            lines.push(format!("and {more} more"));
        }
        lines
    }

    fn headline(&self) -> String {
        let mut parts = Vec::new();
        match (self.utilisation, self.bitrate) {
            (Some(busy), Some(rate)) => {
                parts.push(format!("busy for {} % at {rate} bit/s", significant(100.0 * busy, 3)))
            }
            (Some(busy), None) => parts.push(format!("busy for {} %", significant(100.0 * busy, 3))),
            _ => {}
        }
        let counts = [
            (self.error_frames, "error frame", "error frames"),
            (self.unsent, "frame without room", "frames without room"),
            (self.fifo_overflows, "FIFO overflow", "FIFO overflows"),
            (self.queue_overflows, "queue overflow", "queue overflows"),
            (self.error_passive.filter(|&times| times > 0), "time error-passive", "times error-passive"),
            (self.bus_off, "time off the bus", "times off the bus"),
        ];
        parts.extend(counts.into_iter().filter_map(|(count, one, many)| {
            Some(format!("{} {}", count?, if count == Some(1) { one } else { many }))
        }));
        format!("{}: {}", self.interface, parts.join(", "))
    }
}

impl IdentifierRow {
    fn new(id: Id, row: &Row) -> Self {
        let latency_s = LatencyRow::of(&row.latencies);
        Self { id: id.to_string(), node: node_of(id), frames: row.frames, latency_s, ..Self::default() }
    }

    fn told(&self) -> String {
        let optional = |count: Option<u64>| count.map_or("-".to_owned(), |count| count.to_string());
        let time = |time: Option<f64>| time.map_or("-".to_owned(), |time| significant(1e6 * time, 4));
        let latency = self.latency_s;
        let winners: Vec<_> = self.lost_to.iter().map(|(id, count)| format!("{id} ({count})")).collect();
        format!(
            "{:<9}{:>5}{:>9}{:>8}{:>8}{:>11}{:>11}{:>13}{:>9}  {}",
            self.id,
            optional(self.node.map(u64::from)),
            self.frames,
            optional(self.unsent),
            optional(self.errors),
            time(latency.and_then(|latency| latency.p50)),
            time(latency.and_then(|latency| latency.p99)),
            time(latency.map(|latency| latency.max)),
            optional(self.lost),
            winners.join(", ")
        )
        .trim_end()
        .to_owned()
    }
}

impl LatencyRow {
    fn of(latencies: &Latencies) -> Option<Self> {
        let share = |per_mille| latencies.percentile(per_mille).map(|ns| ns as f64 / 1e9);
        (latencies.count() > 0).then(|| Self {
            p50: share(500),
            p99: share(990),
            max: latencies.longest() as f64 / 1e9,
        })
    }
}

/// The node that an identifier of the real-time plane names (protocol/README.md).
#[must_use]
pub fn node_of(id: Id) -> Option<u8> {
    match id {
        Id::Base(id) => Some((id & 0x7F) as u8).filter(|&node| node > 0),
        Id::Extended(_) => None,
    }
}
