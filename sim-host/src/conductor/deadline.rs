//! Until when something is waited for. Times are nanoseconds on the clock of who polls.

use std::time::Duration;

/// The end of a wait, whatever a node says meanwhile.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Deadline {
    pub(super) end: u64,
    /// From its begin to its end.
    pub(super) limit: Duration,
}

impl Deadline {
    pub(super) fn after(limit: Duration, now: u64) -> Self {
        Self { end: now.saturating_add(ns(limit)), limit }
    }

    pub(super) fn is_over(&self, now: u64) -> bool {
        now > self.end
    }

    /// First moment at which it is over.
    pub(super) fn until(&self) -> u64 {
        self.end.saturating_add(1)
    }
}

/// A duration in nanoseconds.
pub(super) fn ns(duration: Duration) -> u64 {
    u64::try_from(duration.as_nanos()).unwrap_or(u64::MAX)
}
