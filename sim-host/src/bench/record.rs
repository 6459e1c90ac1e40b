//! `bench.csv`: when the host sent and read what belongs to each tick of each node.

use crate::hub::Stamps;
use crate::record::{AtomicFile, RecordError};
use std::io::{self, Write};
use std::path::PathBuf;
use std::time::Duration;

/// Writes the file row by row; it gets its name on [`finish`](Self::finish).
///
/// Columns: `tick`, `node`, then host time since the start, in seconds with microseconds: `sync_s`,
/// `state_s`, `telemetry_s`; and bus time, when the kernel says that the state was on CAN: `bus_s`. Empty
/// where there was none: the node had stopped, or is on no CAN.
pub struct Stampings(AtomicFile);

impl Stampings {
    /// Opens the file and writes the header.
    ///
    /// # Errors
    /// [`RecordError`], naming `path` and the reason.
    pub fn create(path: impl Into<PathBuf>) -> Result<Self, RecordError> {
        let mut file = AtomicFile::create(path)?;
        file.write(|out| writeln!(out, "tick,node,sync_s,state_s,telemetry_s,bus_s"))?;
        Ok(Self(file))
    }

    /// Appends a tick: node ids with their stamps.
    ///
    /// # Errors
    /// [`RecordError`].
    pub fn tick<'a>(
        &mut self,
        tick: u64,
        nodes: impl IntoIterator<Item = (u8, &'a Stamps)>,
    ) -> Result<(), RecordError> {
        self.0.write(|out| nodes.into_iter().try_for_each(|(node, stamps)| line(out, tick, node, stamps)))
    }

    /// Gives the file its name.
    ///
    /// # Errors
    /// [`RecordError`]; no half file is left.
    pub fn finish(self) -> Result<(), RecordError> {
        self.0.commit()
    }
}

fn line(out: &mut dyn Write, tick: u64, node: u8, stamps: &Stamps) -> io::Result<()> {
    let [sync, state, telemetry, bus] =
        [stamps.sync, stamps.state, stamps.telemetry, stamps.bus].map(seconds);
    writeln!(out, "{tick},{node},{sync},{state},{telemetry},{bus}")
}

fn seconds(stamp: Option<Duration>) -> String {
    stamp.map_or(String::new(), |stamp| format!("{:.6}", stamp.as_secs_f64()))
}
