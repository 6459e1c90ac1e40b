//! What a run leaves behind: `trajectory.csv`, `summary.json`, a JUnit file, and the hash of all states.
//!
//! Every file appears whole or not at all (see [`AtomicFile`]).

mod atomic;
mod bus_files;
mod junit;
mod mcap_file;
mod rights;
mod summary;
mod summary_text;
mod temporary;
mod trajectory;

pub(crate) use atomic::follow;
pub use atomic::{AtomicFile, RecordError, is_standard_output, place_new, write_atomic};
pub use bus_files::{BusFiles, BusLogs, OnBus};
pub use funnelnet_sim::trace_hash::TraceHash;
pub use junit::{JunitError, junit, junit_error};
pub use mcap_file::{Gravity, RECORDING, Recording};
pub use rights::remove_earlier;
pub use summary::{
    BelievedSummary, BenchNodeSummary, BenchSummary, BenchSyncSummary, BusSummary, CanSummary, ClockSummary,
    DuringEventsSummary, EmergentSummary, EventSummary, Expectation, FunnelSummary, OwnClockNodeSummary,
    OwnClockSummary, PerComponent, PerInterface, Summary, SyncSummary, WiresSummary,
};
pub use summary_text::failures;
pub use temporary::remove_abandoned;
pub use trajectory::{Row, Shape, TrajectoryWriter};
