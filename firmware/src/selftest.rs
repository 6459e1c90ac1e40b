//! Does the platform keep its promises? Run by `./ci.sh selftest` in the emulator, and at the bring-up of a new board.
//!
//! The first byte that comes chooses a test; everything after it belongs to that test.

use embassy_time::{Duration, Instant, Ticker};
use embedded_io_async::{Read, Write};

use crate::app::echo;

/// Ticks of the timing test.
pub const TICKS: u32 = 1000;
/// Period of the timing test.
pub const PERIOD: Duration = Duration::from_millis(1);

/// Runs the chosen test: `e` echo for ever, `t` ticker, `p` panic, `f` hard fault.
pub async fn run<L: Read + Write>(mut link: L) -> Result<(), L::Error> {
    defmt::info!("selftest ready");
    let mut choice = [0];
    link.read(&mut choice).await?;
    match choice[0] {
        b'e' => loop {
            echo(&mut link).await?;
        },
        b't' => ticker(&mut link).await,
        b'p' => deliberate_panic(),
        b'f' => cortex_m::asm::udf(),
        other => {
            defmt::error!("no test is called {=u8:#04x}", other);
            Ok(())
        }
    }
}

#[allow(clippy::panic)] // That is the test.
fn deliberate_panic() -> ! {
    panic!("deliberate, as asked for")
}

/// Sends, as two little-endian u32 in microseconds, how long [`TICKS`] periods took and how late the latest tick was.
async fn ticker<L: Write>(link: &mut L) -> Result<(), L::Error> {
    let start = Instant::now();
    let mut ticker = Ticker::every(PERIOD);
    let mut latest = 0;
    for tick in 1..=TICKS {
        ticker.next().await;
        let due = start + PERIOD * tick;
        latest = Instant::now().saturating_duration_since(due).as_micros().max(latest);
    }
    let took = start.elapsed().as_micros();
    defmt::info!("{=u32} ticks took {=u64} us, the latest was {=u64} us late", TICKS, took, latest);
    link.write_all(&(took as u32).to_le_bytes()).await?;
    link.write_all(&(latest as u32).to_le_bytes()).await
}
