//! Device registers: the one place that turns addresses into references.
#![allow(unsafe_code)]

use core::cell::UnsafeCell;

/// One 32-bit device register.
#[repr(transparent)]
pub struct Register(UnsafeCell<u32>);

// SAFETY: an aligned 32-bit access is one bus transfer, so that the handler and the thread of a single core
// never see half of one. Drivers don't read, modify and write a register from both sides.
unsafe impl Sync for Register {}

impl Register {
    /// Reads the register, with whatever side effect the device attaches to that.
    #[inline(always)]
    pub fn read(&self) -> u32 {
        // SAFETY: `self` is a register of a live device, see `timer` and `uart`: valid and aligned.
        unsafe { self.0.get().read_volatile() }
    }

    /// Writes the register.
    #[inline(always)]
    pub fn write(&self, value: u32) {
        // SAFETY: as in `read`; what the device does on a write touches no memory, since none of these has
        // DMA.
        unsafe { self.0.get().write_volatile(value) }
    }
}

/// CMSDK APB timer: counts down from `value`, then from `reload` (0: stops).
#[repr(C)]
pub struct Timer {
    /// Bit 0: enable; bit 3: interrupt enable.
    pub control: Register,
    /// The present count.
    pub value: Register,
    /// The count that follows 0.
    pub reload: Register,
    /// Bit 0: the count went to 0; write 1 to clear.
    pub interrupt: Register,
}

/// CMSDK APB UART.
#[repr(C)]
pub struct Uart {
    /// Received byte when read, byte to send when written.
    pub data: Register,
    /// Bit 0: transmit buffer full; 1: receive buffer full; 2, 3: transmit, receive overrun (write 1 to
    /// clear).
    pub state: Register,
    /// Bits 0, 1: transmit, receive enable; 2, 3: their interrupts; 4, 5: overrun interrupts.
    pub control: Register,
    /// Bits 0, 1: transmit, receive; 2, 3: their overruns; write 1 to clear.
    pub interrupt: Register,
    /// Clock divided by bit rate, at least 16.
    pub baud_divider: Register,
}

/// Timer 0 or 1 of the AN386.
#[inline(always)]
pub fn timer<const N: usize>() -> &'static Timer {
    const { assert!(N < 2) };
    // SAFETY: AN386 has CMSDK timers at these addresses, word aligned, always powered.
    unsafe { &*((0x4000_0000 + N * 0x1000) as *const Timer) }
}

/// Number of UARTs of the AN386.
pub const UARTS: usize = 5;

/// UART `number` of the AN386, the last one if there are not so many.
#[inline(always)]
pub fn uart(number: usize) -> &'static Uart {
    const BASES: [usize; UARTS] = [0x4000_4000, 0x4000_5000, 0x4000_6000, 0x4000_7000, 0x4000_9000];
    // SAFETY: AN386 has CMSDK UARTs at these addresses, word aligned, always powered.
    unsafe { &*(BASES[number.min(UARTS - 1)] as *const Uart) }
}

/// The watchdog of the AN386.
#[inline(always)]
pub(super) fn watchdog() -> &'static super::watchdog::Registers {
    // SAFETY: AN386 has a CMSDK watchdog at this address, word aligned, always powered.
    unsafe { &*(0x4000_8000 as *const super::watchdog::Registers) }
}
