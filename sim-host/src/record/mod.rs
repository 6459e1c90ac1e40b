//! What a run leaves behind: `trajectory.csv`, `summary.json`, a JUnit file, and the hash of all states.
//!
//! Every file appears whole or not at all (see [`AtomicFile`]).

mod atomic;
mod junit;
mod number;
mod reference;
mod summary;
mod trace_hash;
mod trajectory;

pub use atomic::{AtomicFile, RecordError, write_atomic};
pub use junit::junit;
pub use number::{Precision, shortest};
pub use summary::{
    AbsenceSummary, BelievedSummary, BenchNodeSummary, BenchSummary, BusSummary, CanSummary, EmergentSummary,
    Expectation, FunnelSummary, OwnClockNodeSummary, OwnClockSummary, PerComponent, PerInterface,
    ReferenceSummary, Summary, SyncSummary, WiresSummary,
};
pub use trace_hash::TraceHash;
pub use trajectory::{Row, Shape, TrajectoryWriter};
