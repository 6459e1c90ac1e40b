//! Interrupt-driven CMSDK UART 0, 8N1, without flow control.

use core::convert::Infallible;
use core::future::poll_fn;
use core::sync::atomic::{AtomicBool, AtomicU32, Ordering};
use core::task::{Context, Poll};

use embassy_sync::waitqueue::AtomicWaker;
use embedded_io_async::{ErrorType, Read, Write};

use super::CLOCK_HZ;
use super::interrupt::{self, Interrupt};
use super::register::uart0;
use crate::ring::{Pushed, Ring};

/// Bytes that can wait for the task: some 20 ms at 1 Mbit/s.
pub const RECEIVE_BUFFER: usize = 2048;

/// Smallest divider that the device accepts.
const SMALLEST_DIVIDER: u32 = 16;

const TRANSMIT_FULL: u32 = 1 << 0;
const RECEIVE_FULL: u32 = 1 << 1;
const RECEIVE_OVERRUN: u32 = 1 << 3;

const ENABLE: u32 = 1 << 0 | 1 << 1;
const TRANSMIT_INTERRUPT: u32 = 1 << 2;
const RECEIVE_INTERRUPTS: u32 = 1 << 3 | 1 << 5;

static RECEIVED: Ring<RECEIVE_BUFFER> = Ring::new();
static READER: AtomicWaker = AtomicWaker::new();
static WRITER: AtomicWaker = AtomicWaker::new();
static LOST_IN_DEVICE: AtomicU32 = AtomicU32::new(0);
static LOST_IN_BUFFER: AtomicU32 = AtomicU32::new(0);
static TAKEN: AtomicBool = AtomicBool::new(false);

/// Bytes lost on reception since the start.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, defmt::Format)]
pub struct Lost {
    /// The interrupt came too late for the device's one-byte buffer (events; each is at least one byte).
    pub in_device: u32,
    /// The task came too late for the receive buffer.
    pub in_buffer: u32,
}

/// What was lost on reception since the start.
pub fn lost() -> Lost {
    Lost {
        in_device: LOST_IN_DEVICE.load(Ordering::Relaxed),
        in_buffer: LOST_IN_BUFFER.load(Ordering::Relaxed),
    }
}

/// UART 0. Reading never fails: what is lost is counted ([`lost`]), and the frame it belonged to fails its
/// check. Dropping a pending `read` or `write` loses nothing.
pub struct Uart0 {
    _taken: (),
}

impl Uart0 {
    /// The one UART 0, set to `bit_rate` in bit/s (at most [`CLOCK_HZ`] / 16), or `None` if it is taken.
    pub fn take(bit_rate: u32) -> Option<Self> {
        if TAKEN.swap(true, Ordering::Relaxed) {
            return None;
        }
        let uart = uart0();
        uart.baud_divider.write((CLOCK_HZ / bit_rate.max(1)).max(SMALLEST_DIVIDER));
        uart.control.write(ENABLE | RECEIVE_INTERRUPTS);
        for each in [Interrupt::Uart0Receive, Interrupt::Uart0Transmit, Interrupt::UartOverrun] {
            interrupt::enable(each);
        }
        Some(Self { _taken: () })
    }

    fn poll_read(&mut self, buffer: &mut [u8], context: &mut Context) -> Poll<usize> {
        let count = RECEIVED.pop(buffer);
        if count > 0 {
            return Poll::Ready(count);
        }
        READER.register(context.waker());
        // A byte may have come between the first look and the registration.
        match RECEIVED.pop(buffer) {
            0 => Poll::Pending,
            count => Poll::Ready(count),
        }
    }

    fn poll_room(&mut self, context: &mut Context) -> Poll<()> {
        if has_room() {
            return Poll::Ready(());
        }
        WRITER.register(context.waker());
        uart0().control.write(ENABLE | RECEIVE_INTERRUPTS | TRANSMIT_INTERRUPT);
        // The buffer may have emptied before its interrupt was enabled.
        if has_room() { Poll::Ready(()) } else { Poll::Pending }
    }
}

fn has_room() -> bool {
    uart0().state.read() & TRANSMIT_FULL == 0
}

impl ErrorType for Uart0 {
    type Error = Infallible;
}

impl Read for Uart0 {
    async fn read(&mut self, buffer: &mut [u8]) -> Result<usize, Infallible> {
        if buffer.is_empty() {
            return Ok(0);
        }
        Ok(poll_fn(|context| self.poll_read(buffer, context)).await)
    }
}

impl Write for Uart0 {
    async fn write(&mut self, bytes: &[u8]) -> Result<usize, Infallible> {
        if bytes.is_empty() {
            return Ok(0);
        }
        poll_fn(|context| self.poll_room(context)).await;
        let mut count = 0;
        while count < bytes.len() && has_room() {
            uart0().data.write(bytes[count].into());
            count += 1;
        }
        Ok(count)
    }

    async fn flush(&mut self) -> Result<(), Infallible> {
        poll_fn(|context| self.poll_room(context)).await;
        Ok(())
    }
}

/// Interrupt handler: moves bytes into the ring.
pub(super) fn on_receive() {
    let uart = uart0();
    // Cleared before the byte is taken: one that comes afterwards raises it again.
    uart.interrupt.write(1 << 1);
    while uart.state.read() & RECEIVE_FULL != 0 {
        match RECEIVED.push(uart.data.read() as u8) {
            Pushed::First => READER.wake(),
            Pushed::More => {}
            Pushed::Full => count(&LOST_IN_BUFFER),
        }
    }
}

/// Interrupt handler: the transmit buffer is free, and nobody waits for it any more.
pub(super) fn on_transmit() {
    let uart = uart0();
    uart.control.write(ENABLE | RECEIVE_INTERRUPTS);
    uart.interrupt.write(1 << 0);
    WRITER.wake();
}

/// Interrupt handler: the device had to drop a byte.
pub(super) fn on_overrun() {
    let uart = uart0();
    uart.state.write(RECEIVE_OVERRUN);
    uart.interrupt.write(1 << 3);
    count(&LOST_IN_DEVICE);
}

fn count(counter: &AtomicU32) {
    counter.fetch_add(1, Ordering::Relaxed);
}
