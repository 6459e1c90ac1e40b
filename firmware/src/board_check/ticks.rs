//! Ticks as a node waits for them, and how late they come by the board's own clock.

use embedded_hal::digital::OutputPin;
use funnelnet_app::Clock;
use funnelnet_app::watchdog::Watchdog;

use crate::app::BoardClock;

/// How many; a second of them.
pub const TICKS: u32 = 1000;
/// Nanoseconds from one to the next.
const PERIOD: u64 = 1_000_000;

/// What was measured, us.
pub struct Lateness {
    /// The latest tick.
    pub most: u32,
    /// From the least late one to the latest.
    pub spread: u32,
}

/// Runs the ticks. The pin changes at each, for an oscilloscope, which sees what the clock itself does.
pub async fn run(pin: &mut impl OutputPin, watchdog: &mut impl Watchdog) -> Lateness {
    let begin = BoardClock.now() + PERIOD;
    let (mut least, mut most) = (u64::MAX, 0);
    for tick in 0..TICKS {
        let due = begin + u64::from(tick) * PERIOD;
        // A wait may end before its time (`Clock::wait_until`).
        while BoardClock.now() < due {
            BoardClock.wait_until(due).await;
        }
        let late = BoardClock.now() - due;
        let _ = if tick % 2 == 0 { pin.set_high() } else { pin.set_low() };
        (least, most) = (least.min(late), most.max(late));
        watchdog.feed();
    }
    Lateness { most: micros(most), spread: micros(most - least.min(most)) }
}

fn micros(nanos: u64) -> u32 {
    u32::try_from(nanos / 1000).unwrap_or(u32::MAX)
}
