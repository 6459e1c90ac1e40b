//! Interrupt-driven CMSDK UARTs, 8N1, without flow control.

use core::cell::Cell;
use core::convert::Infallible;
use core::future::poll_fn;
use core::sync::atomic::{AtomicU32, Ordering};
use core::task::{Context, Poll};

use critical_section::Mutex;
use embassy_sync::waitqueue::AtomicWaker;
use embedded_io_async::{ErrorType, Read, Write};

use super::CLOCK_HZ;
use super::interrupt::{self, Interrupt};
use super::register::{self, UARTS, uart};
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

/// The UARTs that are in use, for their interrupts. Those that a program does not use take no room in it.
static IN_USE: Mutex<[Cell<Option<Port>>; UARTS]> = Mutex::new([const { Cell::new(None) }; UARTS]);

/// UART 0.
pub const UART_0: Port = Port { number: 0, shared: &SHARED_0 };
/// UART 1.
pub const UART_1: Port = Port { number: 1, shared: &SHARED_1 };
/// UART 2.
pub const UART_2: Port = Port { number: 2, shared: &SHARED_2 };
/// UART 3; the loss of a byte in the device is not counted.
pub const UART_3: Port = Port { number: 3, shared: &SHARED_3 };
/// UART 4; as UART 3.
pub const UART_4: Port = Port { number: 4, shared: &SHARED_4 };

static SHARED_0: Shared = Shared::new();
static SHARED_1: Shared = Shared::new();
static SHARED_2: Shared = Shared::new();
static SHARED_3: Shared = Shared::new();
static SHARED_4: Shared = Shared::new();

/// Bytes lost on reception since the start.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, defmt::Format)]
pub struct Lost {
    /// The interrupt came too late for the device's one-byte buffer (events; each is at least one byte).
    pub in_device: u32,
    /// The task came too late for the receive buffer.
    pub in_buffer: u32,
}

/// A UART of the AN386.
#[derive(Clone, Copy)]
pub struct Port {
    number: usize,
    shared: &'static Shared,
}

/// What a UART and its interrupts share: all zeros at first, so that it takes no room in the image.
struct Shared {
    received: Ring<RECEIVE_BUFFER>,
    reader: AtomicWaker,
    writer: AtomicWaker,
    lost_in_device: AtomicU32,
    lost_in_buffer: AtomicU32,
}

impl Shared {
    const fn new() -> Self {
        Self {
            received: Ring::new(),
            reader: AtomicWaker::new(),
            writer: AtomicWaker::new(),
            lost_in_device: AtomicU32::new(0),
            lost_in_buffer: AtomicU32::new(0),
        }
    }
}

impl Port {
    /// What was lost on reception since the start.
    pub fn lost(&self) -> Lost {
        Lost {
            in_device: self.shared.lost_in_device.load(Ordering::Relaxed),
            in_buffer: self.shared.lost_in_buffer.load(Ordering::Relaxed),
        }
    }

    fn registers(&self) -> &'static register::Uart {
        uart(self.number)
    }

    fn has_room(&self) -> bool {
        self.registers().state.read() & TRANSMIT_FULL == 0
    }
}

/// The port in use behind an interrupt.
fn in_use(number: usize) -> Option<Port> {
    critical_section::with(|token| IN_USE.borrow(token).get(number)?.get())
}

/// A UART. Reading never fails: what is lost is counted ([`Port::lost`]), and the frame it belonged to fails
/// its check. Dropping a pending `read` or `write` loses nothing.
pub struct Uart {
    receiver: Receiver,
    transmitter: Transmitter,
}

/// The half that reads.
pub struct Receiver(Port);

/// The half that writes.
pub struct Transmitter(Port);

impl Uart {
    /// The one UART of `port`, set to `bit_rate` in bit/s (at most [`CLOCK_HZ`] / 16), or `None` if it is
    /// taken.
    pub fn take(port: Port, bit_rate: u32) -> Option<Self> {
        let before =
            critical_section::with(|token| Some(IN_USE.borrow(token).get(port.number)?.replace(Some(port))));
        if !matches!(before, Some(None)) {
            return None;
        }
        let registers = port.registers();
        registers.baud_divider.write((CLOCK_HZ / bit_rate.max(1)).max(SMALLEST_DIVIDER));
        registers.control.write(ENABLE | RECEIVE_INTERRUPTS);
        let number = port.number;
        for each in
            [Interrupt::uart_receive(number), Interrupt::uart_transmit(number), Interrupt::UART_OVERRUN]
        {
            interrupt::enable(each);
        }
        Some(Self { receiver: Receiver(port), transmitter: Transmitter(port) })
    }

    /// Both halves.
    pub fn split(self) -> (Transmitter, Receiver) {
        (self.transmitter, self.receiver)
    }
}

impl Receiver {
    fn poll_read(&mut self, buffer: &mut [u8], context: &mut Context) -> Poll<usize> {
        let Self(port) = self;
        let count = port.shared.received.pop(buffer);
        if count > 0 {
            return Poll::Ready(count);
        }
        port.shared.reader.register(context.waker());
        // A byte may have come between the first look and the registration.
        match port.shared.received.pop(buffer) {
            0 => Poll::Pending,
            count => Poll::Ready(count),
        }
    }
}

impl Transmitter {
    fn poll_room(&mut self, context: &mut Context) -> Poll<()> {
        let Self(port) = self;
        if port.has_room() {
            return Poll::Ready(());
        }
        port.shared.writer.register(context.waker());
        port.registers().control.write(ENABLE | RECEIVE_INTERRUPTS | TRANSMIT_INTERRUPT);
        // The buffer may have emptied before its interrupt was enabled.
        if port.has_room() { Poll::Ready(()) } else { Poll::Pending }
    }
}

impl ErrorType for Receiver {
    type Error = Infallible;
}

impl Read for Receiver {
    async fn read(&mut self, buffer: &mut [u8]) -> Result<usize, Infallible> {
        if buffer.is_empty() {
            return Ok(0);
        }
        Ok(poll_fn(|context| self.poll_read(buffer, context)).await)
    }
}

impl ErrorType for Transmitter {
    type Error = Infallible;
}

impl Write for Transmitter {
    async fn write(&mut self, bytes: &[u8]) -> Result<usize, Infallible> {
        if bytes.is_empty() {
            return Ok(0);
        }
        poll_fn(|context| self.poll_room(context)).await;
        let Self(port) = self;
        let mut count = 0;
        for &byte in bytes.iter().take_while(|_| port.has_room()) {
            port.registers().data.write(byte.into());
            count += 1;
        }
        Ok(count)
    }

    async fn flush(&mut self) -> Result<(), Infallible> {
        poll_fn(|context| self.poll_room(context)).await;
        Ok(())
    }
}

impl ErrorType for Uart {
    type Error = Infallible;
}

impl Read for Uart {
    async fn read(&mut self, buffer: &mut [u8]) -> Result<usize, Infallible> {
        self.receiver.read(buffer).await
    }
}

impl Write for Uart {
    async fn write(&mut self, bytes: &[u8]) -> Result<usize, Infallible> {
        self.transmitter.write(bytes).await
    }

    async fn flush(&mut self) -> Result<(), Infallible> {
        self.transmitter.flush().await
    }
}

/// Interrupt handler: moves bytes into the ring.
pub(super) fn on_receive(number: usize) {
    let Some(port) = in_use(number) else { return };
    let registers = port.registers();
    // Cleared before the byte is taken: one that comes afterwards raises it again.
    registers.interrupt.write(1 << 1);
    while registers.state.read() & RECEIVE_FULL != 0 {
        match port.shared.received.push(registers.data.read() as u8) {
            Pushed::First => port.shared.reader.wake(),
            Pushed::More => {}
            Pushed::Full => count(&port.shared.lost_in_buffer),
        }
    }
}

/// Interrupt handler: the transmit buffer is free, and nobody waits for it any more.
pub(super) fn on_transmit(number: usize) {
    let Some(port) = in_use(number) else { return };
    port.registers().control.write(ENABLE | RECEIVE_INTERRUPTS);
    port.registers().interrupt.write(1 << 0);
    port.shared.writer.wake();
}

/// Interrupt handler: one of the devices had to drop a byte.
pub(super) fn on_overrun() {
    for port in (0..UARTS).filter_map(in_use) {
        let registers = port.registers();
        if registers.state.read() & RECEIVE_OVERRUN != 0 {
            registers.state.write(RECEIVE_OVERRUN);
            registers.interrupt.write(1 << 3);
            count(&port.shared.lost_in_device);
        }
    }
}

fn count(counter: &AtomicU32) {
    counter.fetch_add(1, Ordering::Relaxed);
}
