//! A word of flash whose write a power cut has interrupted: the STM32G4 raises an NMI when it is read (RM0440, "Flash memory error
//! code correction"). In the storage that is nothing but a record that was not finished; anywhere else it is a defect.
#![allow(unsafe_code)]

use core::sync::atomic::Ordering;

use cortex_m_rt::exception;
use embassy_stm32::pac;

use crate::panic;
use crate::storage::flash::READING;

// SAFETY: the handler uses one register, whose flags are cleared by writing what was read, and one atomic.
#[exception]
unsafe fn NonMaskableInt() {
    let eccr = pac::FLASH.eccr().read();
    if READING.load(Ordering::Relaxed) && (eccr.eccd() || eccr.eccd2()) {
        pac::FLASH.eccr().write_value(eccr);
    } else {
        panic::memory_error(eccr.addr_ecc());
    }
}
