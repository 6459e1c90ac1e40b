//! What the STM32 boards share: their CAN controllers behind [`funnelnet_app::link::can::Controller`], the service plane's line, and the chip's number.

#[cfg(feature = "_f4")]
pub mod bxcan;
#[cfg(feature = "_g4")]
mod ecc;
#[cfg(feature = "_f4")]
pub mod f4;
#[cfg(feature = "_g4")]
pub mod fdcan;
#[cfg(feature = "_g4")]
pub mod g4;
pub mod line;
mod received;
pub mod safety;
#[cfg(feature = "_f4")]
pub mod sectors;
#[cfg(feature = "_f4")]
pub mod stalls;

use core::num::NonZeroU8;

/// The chip's unique number, folded from 96 bits: wafer and lot, with the place on the wafer over them.
fn uid() -> u64 {
    let [x0, x1, y0, y1, rest @ ..] = embassy_stm32::uid::uid();
    u64::from_le_bytes(rest) ^ u64::from_be_bytes([x0, x1, y0, y1, 0, 0, 0, 0])
}

/// A number that is not zero, at compile time: quanta and prescalers of a bit.
#[allow(clippy::panic)] // at compile time
const fn width(quanta: u8) -> NonZeroU8 {
    match NonZeroU8::new(quanta) {
        Some(width) => width,
        None => panic!("a bit has no empty segment"),
    }
}
