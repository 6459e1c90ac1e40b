//! The boot loader of a Raspberry Pi Pico that takes updates: it swaps programs where that is due, and starts what is there. docs/book/src/update.md
#![no_std]
#![no_main]

use core::cell::RefCell;

use embassy_boot_rp::{AlignedBuffer, BootLoader, WatchdogFlash};
use embassy_rp::flash::{ERASE_SIZE, FLASH_BASE};
use embassy_time::Duration;
use firmware::rp::FLASH_SIZE;
use firmware::storage::programs;
use funnelnet_update::boot::{Shared, prepare};

/// Of the watchdog from here on, until the program starts its own: the longest that the chip can count. A sector takes 0.4 s at most.
const PERIOD: Duration = Duration::from_secs(8);

#[cortex_m_rt::entry]
fn main() -> ! {
    let board = embassy_rp::init(Default::default());
    let flash = WatchdogFlash::<FLASH_SIZE>::start(board.FLASH, board.WATCHDOG, PERIOD);
    let shared: Shared<_> = Shared::new(RefCell::new(flash));
    let mut buffer = AlignedBuffer([0; ERASE_SIZE]);
    let base = FLASH_BASE as u32;
    let regions = programs::regions(base);
    match prepare(&shared, &regions, buffer.as_mut()) {
        Ok(state) => start(BootLoader { state }, base.wrapping_add(regions.active.start)),
        // The next start goes on where this one was.
        Err(_) => firmware::reset::restart(),
    }
}

/// Starts the program at this address.
fn start(loader: BootLoader, address: u32) -> ! {
    // SAFETY: the program was linked for this address, and nothing of this one is used any more.
    #[allow(unsafe_code)]
    unsafe {
        loader.load(address)
    }
}

#[panic_handler]
fn panic(info: &core::panic::PanicInfo) -> ! {
    firmware::panic::report(info)
}
