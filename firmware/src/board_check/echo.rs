//! A serial line that hears itself, by a wire from its TX to its RX.

use embassy_futures::select::{Either, select};
use embedded_io_async::{Read, Write};
use funnelnet_app::Clock;

use crate::app::BoardClock;

/// Each byte once.
pub const BYTES: usize = 256;
/// Nanoseconds for all: 256 bytes at 1 Mbit/s take 2.6 ms.
const LONGEST: u64 = 100_000_000;

/// What came back.
pub struct Heard {
    /// Bytes.
    pub heard: u32,
    /// Those that were not what was sent, those that are missing, and errors that the driver has seen.
    pub wrong: u32,
}

/// Sends each byte once, and listens. The driver's buffers have room for all of them.
pub async fn run(line: &mut (impl Read + Write)) -> Heard {
    let end = BoardClock.now() + LONGEST;
    let sent: [u8; BYTES] = core::array::from_fn(byte);
    let mut rest = &sent[..];
    while !rest.is_empty() {
        let Either::First(Ok(written)) = select(line.write(rest), BoardClock.wait_until(end)).await else {
            break;
        };
        rest = rest.get(written.max(1)..).unwrap_or(&[]);
    }
    listen(line, end).await
}

async fn listen(line: &mut impl Read, end: u64) -> Heard {
    let (mut heard, mut wrong) = (0, 0);
    let mut bytes = [0; 32];
    while heard < BYTES {
        match select(line.read(&mut bytes), BoardClock.wait_until(end)).await {
            Either::First(Ok(count)) => {
                for came in bytes.iter().take(count) {
                    wrong += u32::from(*came != byte(heard));
                    heard += 1;
                }
            }
            Either::First(Err(_)) => wrong += 1,
            Either::Second(()) => break,
        }
    }
    let missing = if heard == 0 { 0 } else { BYTES.saturating_sub(heard) };
    Heard { heard: heard as u32, wrong: wrong + missing as u32 }
}

/// The byte at this place; neighbours differ in many bits.
const fn byte(place: usize) -> u8 {
    (place as u8).wrapping_mul(151).wrapping_add(7)
}
