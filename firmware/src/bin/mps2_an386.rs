//! The node on the emulated board: `qemu-system-arm -M mps2-an386`. UART 0 is the link, semihosting the log.
#![no_std]
#![no_main]

use core::panic::PanicInfo;
use core::pin::pin;

use cortex_m_rt::entry;
use defmt_semihosting as _;
use firmware::app::{self, Chip, SessionOf};
use firmware::executor::Executor;
use firmware::mps2::{
    time,
    uart::{UART_0, Uart},
};
use firmware::panic;
use firmware::reset::{self, Start};
use funnelnet_app::link::serial::Serial;
use funnelnet_app::storage::Absent;
use funnelnet_app::watchdog;
use funnelnet_plant::Virtual;
use funnelnet_protocol::service::ResetCause;
use static_cell::StaticCell;

/// What hardware would run at; the emulator doesn't wait for bits.
const BIT_RATE: u32 = 1_000_000;

#[embassy_executor::task]
async fn node(uart: Uart, start: Start) {
    static SESSION: StaticCell<SessionOf<Virtual>> = StaticCell::new();
    static LINK: StaticCell<Serial<Uart>> = StaticCell::new();
    // Without its watchdog: a busy host may leave an emulator standing for longer than a period, which is no fault of the node.
    let chip = Chip { uid: 0, start, watchdog: watchdog::Absent };
    pin!(app::run(&SESSION, LINK.init_with(|| Serial::new(uart)), &mut Absent, Virtual, chip)).await
}

#[entry]
#[allow(clippy::expect_used)] // Once, at the start, where nothing else could be done about it.
fn main() -> ! {
    static EXECUTOR: StaticCell<Executor> = StaticCell::new();
    // The board's hardware does not tell.
    let start = reset::begin(ResetCause::Unknown);
    time::start();
    let uart = Uart::take(UART_0, BIT_RATE).expect("nobody else takes the UART");
    let node = node(uart, start).expect("the task is spawned once");
    EXECUTOR.init(Executor::new()).run(|spawner| spawner.spawn(node))
}

#[panic_handler]
fn panic(info: &PanicInfo) -> ! {
    panic::report(info)
}
