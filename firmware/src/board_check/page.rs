//! A page of flash that is written and erased.

use core::ops::Range;

use embedded_storage_async::nor_flash::NorFlash;
use funnelnet_app::Clock;
use funnelnet_app::watchdog::Watchdog;

use super::since;
use crate::app::BoardClock;

/// Bytes that are written or read at once: whole words of any flash here.
const AT_ONCE: usize = 256;
/// What erased flash reads as.
const BLANK: u8 = 0xFF;

/// What was measured.
pub struct Outcome {
    /// Of writing the whole page, us.
    pub program_us: u32,
    /// Bytes that are not what was written.
    pub wrong: u32,
    /// Of erasing what was written, us.
    pub erase_us: u32,
    /// Bytes that are not erased after it.
    pub left: u32,
}

/// Writes a page and erases it; it is blank afterwards. An erase is measured on what was written: one of a page that is blank already shows nothing.
///
/// The watchdog is fed before each part: together they may take longer than it waits.
///
/// # Errors
/// Of the driver.
pub async fn run<S: NorFlash>(
    flash: &mut S,
    page: Range<u32>,
    watchdog: &mut impl Watchdog,
) -> Result<Outcome, S::Error> {
    flash.erase(page.start, page.end).await?;
    watchdog.feed();
    let begin = BoardClock.now();
    for at in page.clone().step_by(AT_ONCE) {
        flash.write(at, &written(at)).await?;
    }
    let program_us = since(begin);
    let wrong = differing(flash, page.clone(), written).await?;
    watchdog.feed();
    let begin = BoardClock.now();
    flash.erase(page.start, page.end).await?;
    let erase_us = since(begin);
    let left = differing(flash, page, |_| [BLANK; AT_ONCE]).await?;
    Ok(Outcome { program_us, wrong, erase_us, left })
}

/// What is written at this address: bytes of which none is like its neighbours, nor like those of the piece before.
fn written(at: u32) -> [u8; AT_ONCE] {
    core::array::from_fn(|place| {
        (at / AT_ONCE as u32).wrapping_mul(29).wrapping_add(place as u32 * 151) as u8
    })
}

async fn differing<S: NorFlash>(
    flash: &mut S,
    page: Range<u32>,
    expected: impl Fn(u32) -> [u8; AT_ONCE],
) -> Result<u32, S::Error> {
    let (mut count, mut bytes) = (0, [0; AT_ONCE]);
    for at in page.step_by(AT_ONCE) {
        flash.read(at, &mut bytes).await?;
        count += expected(at).iter().zip(&bytes).filter(|(wanted, found)| wanted != found).count() as u32;
    }
    Ok(count)
}
