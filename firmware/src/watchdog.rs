//! The watchdog of a board. When it is fed is decided by `funnelnet_node::watchdog::Policy`.

use embassy_time::Duration;
use funnelnet_node::watchdog::{Policy, Progress};

/// A node whose loop does not come round for so long is reset.
pub const PERIOD: Duration = Duration::from_secs(2);

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
    /// Starts the watchdog.
    pub fn start(mut watchdog: W) -> Self {
        watchdog.start();
        Self { watchdog, policy: Policy::default() }
    }

    /// Looks at what the node has done until `now` (ns).
    pub fn look(&mut self, progress: Progress, now: u64) {
        if self.policy.may_feed(progress, now) {
            self.watchdog.feed();
        }
    }
}
