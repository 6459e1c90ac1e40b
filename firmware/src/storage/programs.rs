//! Where programs are that a boot loader swaps: the parts of the memory map that only images with the features `update` and `boot-loader` have.

use core::ops::Range;

use funnelnet_update::Regions;

#[allow(unsafe_code)] // Declared, and never read.
unsafe extern "C" {
    /// Their addresses are those of the parts.
    static __update_state_start: u8;
    static __update_state_end: u8;
    static __update_active_start: u8;
    static __update_active_end: u8;
    static __update_spare_start: u8;
    static __update_spare_end: u8;
}

/// The parts, for a driver that counts from `base`.
pub fn regions(base: u32) -> Regions {
    let part = |start: *const u8, end: *const u8| -> Range<u32> {
        (start as u32).wrapping_sub(base)..(end as u32).wrapping_sub(base)
    };
    Regions {
        state: part(&raw const __update_state_start, &raw const __update_state_end),
        active: part(&raw const __update_active_start, &raw const __update_active_end),
        spare: part(&raw const __update_spare_start, &raw const __update_spare_end),
    }
}
