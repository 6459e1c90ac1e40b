//! Serial lines of an STM32, and their errors: embassy's driver clears them, logs them, and tells nobody.
#![allow(unsafe_code)] // Handlers of interrupts are unsafe to call.

use core::sync::atomic::{AtomicU32, Ordering};

use embassy_stm32::interrupt::typelevel::{self, Handler};
use embassy_stm32::usart::BufferedUart;
use embassy_stm32::{pac, usart};

/// Overruns, noise and wrong stop bits of all lines, saturating.
pub static ERRORS: AtomicU32 = AtomicU32::new(0);

/// Counts the errors of a line. It goes before embassy's handler, which clears them.
pub struct CountErrors;

/// A line's handler: `$status` is its status register.
macro_rules! count_errors {
    ($($name:ident $status:ident),*) => {$(
        impl Handler<typelevel::$name> for CountErrors {
            unsafe fn on_interrupt() {
                let status = pac::$name.$status().read();
                if status.ore() || status.ne() || status.fe() {
                    ERRORS.store(ERRORS.load(Ordering::Relaxed).saturating_add(1), Ordering::Relaxed);
                }
            }
        }
    )*};
}

#[cfg(feature = "_g4")]
count_errors!(LPUART1 isr, USART1 isr, USART3 isr, UART4 isr, UART5 isr);
#[cfg(feature = "_f4")]
count_errors!(USART1 sr, USART2 sr);

/// The line to the debugger's virtual COM port: 115,200 bit/s.
pub fn service_plane() -> usart::Config {
    line(115_200)
}

/// Bytes at which a reader is woken on a line that does not fall silent: a frame waits for so many of the next ones at most. By itself embassy's driver wakes at a
/// pause, or once its buffer is half full (issue 2719); with 1 it would wake for each byte.
const EAGER: usize = 8;

/// A serial line, bit/s.
pub fn line(bit_rate: u32) -> usart::Config {
    let mut config = usart::Config::default();
    config.baudrate = bit_rate;
    config.eager_reads = Some(EAGER);
    config
}

/// The line, once it is open.
///
/// # Panics
/// Its clock cannot make the bit rate.
#[allow(clippy::expect_used)] // Once, at the start, where nothing else could be done about it.
pub fn opened(uart: Result<BufferedUart<'static>, usart::ConfigError>) -> BufferedUart<'static> {
    // May panic: at the start, before any task runs.
    uart.expect("the bit rate is possible")
}
