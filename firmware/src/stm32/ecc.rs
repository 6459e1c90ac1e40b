//! A word of flash whose write a power cut has interrupted: the STM32G4 raises an NMI when it is read (RM0440, "Flash memory error
//! code correction"). In the storage that is nothing but a record that was not finished; anywhere else it is a defect.
//!
//! Where the word is says the controller, and not what the program does at the moment: the NMI may come some cycles after the read.
#![allow(unsafe_code)]

use cortex_m_rt::exception;
use embassy_stm32::flash::{BANK1_REGION, FLASH_BASE, FLASH_SIZE};
use embassy_stm32::pac;
use embassy_stm32::pac::flash::regs::Eccr;

use crate::panic;
use crate::storage::flash::region;

/// Where the second bank begins, bytes from the first; where there is one bank alone, BK_ECC is reserved.
const SECOND_BANK: u32 = if FLASH_SIZE as u32 > BANK1_REGION.size { BANK1_REGION.size } else { 0 };
/// What one count of ADDR_ECC may be, bytes. The field is as wide as a bank has bytes; that it counts them, and not double words, is not tried.
/// Either way no code is where the storage is taken to be.
const UNITS: [u32; 2] = [1, 8];

// SAFETY: the handler uses one register, whose flags are cleared by writing what was read.
#[exception]
unsafe fn NonMaskableInt() {
    let eccr = pac::FLASH.eccr().read();
    let is_double = eccr.eccd() || eccr.eccd2();
    if is_double && UNITS.iter().any(|unit| is_stored(address(eccr, *unit))) {
        pac::FLASH.eccr().write_value(eccr);
    } else {
        panic::memory_error(address(eccr, 1));
    }
}

/// Where the error is, if ADDR_ECC counts `unit` bytes.
fn address(eccr: Eccr, unit: u32) -> u32 {
    let bank = if eccr.bk_ecc() { SECOND_BANK } else { 0 };
    (FLASH_BASE as u32).wrapping_add(bank).wrapping_add(eccr.addr_ecc().wrapping_mul(unit))
}

fn is_stored(address: u32) -> bool {
    region(0).contains(&address)
}
