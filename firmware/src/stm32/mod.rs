//! What the STM32 boards share: their CAN controllers behind [`funnelnet_app::link::can::Controller`], the service plane's line, and the chip's number.

#[cfg(feature = "nucleo-f446re")]
pub mod bxcan;
#[cfg(feature = "nucleo-g474re")]
pub mod clocks;
#[cfg(feature = "nucleo-g474re")]
mod ecc;
#[cfg(feature = "nucleo-g474re")]
pub mod fdcan;
pub mod safety;
#[cfg(feature = "nucleo-f446re")]
pub mod sectors;

use core::num::NonZeroU8;

use embassy_stm32::can::frame::Header;
use embassy_stm32::usart;
use embedded_can::Id;

use funnelnet_app::link::can::Received;

/// The chip's unique number, folded from 96 bits: wafer and lot, with the place on the wafer over them.
fn uid() -> u64 {
    let [x0, x1, y0, y1, rest @ ..] = embassy_stm32::uid::uid();
    u64::from_le_bytes(rest) ^ u64::from_be_bytes([x0, x1, y0, y1, 0, 0, 0, 0])
}

/// The line to the debugger's virtual COM port: 115,200 bit/s.
pub fn service_plane() -> usart::Config {
    line(115_200)
}

/// A serial line, bit/s.
pub fn line(bit_rate: u32) -> usart::Config {
    let mut config = usart::Config::default();
    config.baudrate = bit_rate;
    config
}

/// A frame of the real-time plane that holds `length` bytes, or `None` for one with a 29-bit identifier and for a remote frame.
fn received(header: &Header, length: u8, bytes: &[u8]) -> Option<Received> {
    let Id::Standard(id) = header.id() else { return None };
    (!header.rtr()).then(|| Received::new(id.as_raw(), length, bytes))
}

/// A number that is not zero, at compile time: quanta and prescalers of a bit.
#[allow(clippy::panic)] // at compile time
const fn width(quanta: u8) -> NonZeroU8 {
    match NonZeroU8::new(quanta) {
        Some(width) => width,
        None => panic!("a bit has no empty segment"),
    }
}
