//! Tests of the platform on the emulated board; see `firmware::selftest`.
#![no_std]
#![no_main]

use core::panic::PanicInfo;

use cortex_m_rt::entry;
use defmt_semihosting as _;
use firmware::executor::Executor;
use firmware::mps2::{
    flash::{self, Flash},
    interrupt::{self, Interrupt},
    time,
    uart::{UART_0, Uart},
    watchdog::Apb,
};
use firmware::storage::flash::{Blocking, InFlash};
use firmware::{app::Chip, panic, reset, selftest};
use funnelnet_protocol::service::ResetCause;
use static_cell::StaticCell;

/// What hardware would run at; the emulator doesn't wait for bits.
const BIT_RATE: u32 = 1_000_000;

#[embassy_executor::task]
async fn test(link: Uart, chip: Chip<Apb>) {
    static STORAGE: StaticCell<InFlash<Blocking<Flash>>> = StaticCell::new();
    let storage = STORAGE.init_with(|| InFlash::new(Blocking(Flash), 0..flash::SIZE as u32));
    storage.open().await;
    let Ok(()) = selftest::run(link, storage, chip, || UART_0.lost().in_buffer, time::counts).await;
}

#[entry]
#[allow(clippy::expect_used)] // Once, at the start, where nothing else could be done about it.
fn main() -> ! {
    static EXECUTOR: StaticCell<Executor> = StaticCell::new();
    // The board's hardware does not tell.
    let start = reset::begin(ResetCause::Unknown);
    time::start();
    // Some drivers do so; it must not last (self-test `i`).
    interrupt::defer(Interrupt::TIMER_1);
    let link = Uart::take(UART_0, BIT_RATE).expect("nobody else takes the UART");
    let test = test(link, Chip { uid: 0, start, watchdog: Apb }).expect("the task is spawned once");
    EXECUTOR.init(Executor::new()).run(|spawner| spawner.spawn(test))
}

#[panic_handler]
fn panic(info: &PanicInfo) -> ! {
    panic::report(info)
}
