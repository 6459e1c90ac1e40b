//! The period of the boards' watchdogs.

use embassy_time::Duration;

/// A node whose loop does not come round for so long is reset.
pub const PERIOD: Duration = Duration::from_secs(2);
