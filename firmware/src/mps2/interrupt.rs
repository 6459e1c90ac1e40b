//! The vector table behind the core's own exceptions.
#![allow(unsafe_code)]

use cortex_m::interrupt::InterruptNumber;
use cortex_m::peripheral::{NVIC, SCB};

use super::{time, uart};

/// Interrupts of the AN386 that are used here.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(u16)]
pub enum Interrupt {
    /// UART 0 has received a byte.
    Uart0Receive = 0,
    /// UART 0 has sent a byte.
    Uart0Transmit = 1,
    /// Timer 1 has run out.
    Timer1 = 9,
    /// UART 0, 1 or 2 has lost a byte.
    UartOverrun = 12,
}

// SAFETY: the numbers are those of the AN386 manual, each used once, and stay the same.
unsafe impl InterruptNumber for Interrupt {
    fn number(self) -> u16 {
        self as u16
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
    unsafe { (*NVIC::PTR).ipr[interrupt as usize].write(0xFF) };
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
    table[Interrupt::Uart0Receive as usize] = uart0_receive;
    table[Interrupt::Uart0Transmit as usize] = uart0_transmit;
    table[Interrupt::Timer1 as usize] = timer1;
    table[Interrupt::UartOverrun as usize] = uart_overrun;
    table
}

extern "C" fn uart0_receive() {
    uart::on_receive();
}

extern "C" fn uart0_transmit() {
    uart::on_transmit();
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
    panic!("unexpected interrupt: exception {active}");
}
