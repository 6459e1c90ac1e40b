//! Interrupts take turns: none interrupts another, which is what the bound of the stack counts on
//! (checks/stack.py).
#![allow(unsafe_code)]

use cortex_m::peripheral::NVIC;

/// Gives all interrupts the same priority. Drivers that were made before may have chosen others: the RP2040's
/// put DMA and pins last.
pub fn level() {
    // SAFETY: nothing here relies on one interrupt preceding another; critical sections mask all of them.
    unsafe { (*NVIC::PTR).ipr.iter().for_each(|each| each.write(0)) };
}

/// Whether they all have the same.
pub fn is_level() -> bool {
    // SAFETY: reading it has no side effect.
    unsafe { (*NVIC::PTR).ipr.iter().all(|each| each.read() == 0) }
}
