//! The watchdog of a board. When it is fed is decided by `funnelnet_node::watchdog`.

use funnelnet_node::watchdog::{Policy, Progress};

/// A hardware watchdog.
pub trait Watchdog {
    /// Begins to count; there may be no way back.
    fn start(&mut self);
    /// Begins to count anew.
    fn feed(&mut self);
}

/// No watchdog.
pub struct Absent;

impl Watchdog for Absent {
    fn start(&mut self) {}
    fn feed(&mut self) {}
}

/// A watchdog that is fed when the node has earned it.
pub struct Guard<W> {
    watchdog: W,
    policy: Policy,
}

impl<W: Watchdog> Guard<W> {
    /// One that still has to be [started](Self::start).
    pub fn new(watchdog: W) -> Self {
        Self { watchdog, policy: Policy::default() }
    }

    /// Starts the watchdog.
    pub fn start(&mut self) {
        self.watchdog.start();
    }

    /// Looks at what the node has done until `now` (ns).
    pub fn look(&mut self, progress: Progress, now: u64) {
        if self.policy.may_feed(progress, now) {
            self.watchdog.feed();
        }
    }
}
