//! The clock of embassy-time, as a node's app takes it.

use embassy_time::{Duration, Instant, Timer};
use funnelnet_app::Clock;

/// The clock of embassy-time.
#[derive(Clone, Copy)]
pub struct Embassy;

impl Clock for Embassy {
    fn now(self) -> u64 {
        Instant::now().as_micros() * 1000
    }

    /// Not as long where that is more than four seconds away. So the division is one of 32 bits, which is an
    /// instruction.
    fn wait_until(self, at: u64) -> impl Future<Output = ()> {
        let now = Instant::now();
        let wait_ns = at.saturating_sub(now.as_micros() * 1000);
        let wait_us = u32::try_from(wait_ns).unwrap_or(u32::MAX).div_ceil(1000);
        Timer::at(now + Duration::from_micros(wait_us.into()))
    }
}
