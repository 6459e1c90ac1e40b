//! The vector table behind the core's own exceptions.
#![allow(unsafe_code)]

use cortex_m::interrupt::InterruptNumber;
use cortex_m::peripheral::{NVIC, SCB};

use super::{time, uart};

/// An interrupt of the AN386, by number.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Interrupt(u16);

impl Interrupt {
    /// Timer 1 has run out.
    pub const TIMER_1: Self = Self(9);
    /// UART 0, 1 or 2 has lost a byte.
    pub const UART_OVERRUN: Self = Self(12);

    /// UART `N` has received a byte.
    pub const fn uart_receive(uart: usize) -> Self {
        Self([0, 2, 4, 18, 20][uart])
    }

    /// UART `N` has sent a byte.
    pub const fn uart_transmit(uart: usize) -> Self {
        Self(Self::uart_receive(uart).0 + 1)
    }

    const fn place(self) -> usize {
        self.0 as usize
    }
}

// SAFETY: the numbers are those of the AN386 manual, below 32, and stay the same.
unsafe impl InterruptNumber for Interrupt {
    fn number(self) -> u16 {
        self.0
    }
}

/// Lets the interrupt through.
pub fn enable(interrupt: Interrupt) {
    // SAFETY: no code here relies on masked interrupts for a critical section; PRIMASK does that.
    unsafe { NVIC::unmask(interrupt) };
}

/// Lets all others precede the interrupt.
pub fn defer(interrupt: Interrupt) {
    // SAFETY: as above.
    unsafe { (*NVIC::PTR).ipr[interrupt.place()].write(0xFF) };
}

/// An entry of the vector table.
type Handler = extern "C" fn();

// SAFETY (of the attributes): cortex-m-rt expects exactly this symbol there; AN386 has 32 interrupts, and the
// core pushes what the C calling convention doesn't preserve, so that plain functions are handlers.
#[unsafe(link_section = ".vector_table.interrupts")]
#[unsafe(no_mangle)]
static __INTERRUPTS: [Handler; 32] = table();

const fn table() -> [Handler; 32] {
    let mut table: [Handler; 32] = [unexpected; 32];
    (table[Interrupt::uart_receive(0).place()], table[Interrupt::uart_transmit(0).place()]) = handlers::<0>();
    (table[Interrupt::uart_receive(1).place()], table[Interrupt::uart_transmit(1).place()]) = handlers::<1>();
    (table[Interrupt::uart_receive(2).place()], table[Interrupt::uart_transmit(2).place()]) = handlers::<2>();
    (table[Interrupt::uart_receive(3).place()], table[Interrupt::uart_transmit(3).place()]) = handlers::<3>();
    (table[Interrupt::uart_receive(4).place()], table[Interrupt::uart_transmit(4).place()]) = handlers::<4>();
    table[Interrupt::TIMER_1.place()] = timer1;
    table[Interrupt::UART_OVERRUN.place()] = uart_overrun;
    table
}

/// For reception and transmission of a UART.
const fn handlers<const N: usize>() -> (Handler, Handler) {
    (uart_receive::<N>, uart_transmit::<N>)
}

extern "C" fn uart_receive<const N: usize>() {
    uart::on_receive(N);
}

extern "C" fn uart_transmit<const N: usize>() {
    uart::on_transmit(N);
}

extern "C" fn uart_overrun() {
    uart::on_overrun();
}

extern "C" fn timer1() {
    time::on_alarm();
}

/// Nothing enables these, so one that fires is a defect.
#[allow(clippy::panic)]
extern "C" fn unexpected() {
    // SAFETY: reading ICSR has no side effect.
    let active = unsafe { (*SCB::PTR).icsr.read() } & 0x1FF;
    // As a number, since the formatting of its name would take a kilobyte.
    // May panic: on purpose.
    panic!("unexpected interrupt: exception {active}");
}
