//! The watchdog of a board. When it is fed is decided by `funnelnet_node::Feeding`.

use embassy_time::Duration;
use funnelnet_node::feeding::{Feeding, Progress};

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
    feeding: Feeding,
}

impl<W: Watchdog> Guard<W> {
    /// Starts the watchdog.
    pub fn start(mut watchdog: W) -> Self {
        watchdog.start();
        Self { watchdog, feeding: Feeding::default() }
    }

    /// Looks at what the node has done until `now` (ns).
    pub fn look(&mut self, progress: Progress, now: u64) {
        if self.feeding.may_feed(progress, now) {
            self.watchdog.feed();
        }
    }
}
