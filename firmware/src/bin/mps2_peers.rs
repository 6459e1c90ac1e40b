//! The node on the emulated board, with lines to neighbours: UART 0 is the line to the host, UARTs 1 to 4 are those to neighbours.
#![no_std]
#![no_main]

use core::panic::PanicInfo;
use core::pin::pin;

use cortex_m_rt::entry;
use defmt_semihosting as _;
use firmware::app::{self, Chip, SessionOf};
use firmware::executor::Executor;
use firmware::mps2::time;
use firmware::mps2::uart::{Receiver, Transmitter, UART_0, UART_1, UART_2, UART_3, UART_4, Uart};
use firmware::panic;
use firmware::reset::{self, Start};
use funnelnet_app::link::peers::Peers;
use funnelnet_app::storage::Absent;
use funnelnet_app::watchdog;
use funnelnet_link::Forwarder;
use funnelnet_plant::Virtual;
use funnelnet_protocol::service::ResetCause;
use static_cell::{ConstStaticCell, StaticCell};

/// What hardware would run at; the emulator doesn't wait for bits.
const BIT_RATE: u32 = 1_000_000;

type Halves = (Transmitter, Receiver);
type Link = Peers<Receiver, Transmitter, Receiver, Transmitter, 4>;

#[embassy_executor::task]
async fn node(host: Halves, peers: [Halves; 4], start: Start) {
    static FORWARDER: ConstStaticCell<Forwarder<4>> = ConstStaticCell::new(Forwarder::new());
    static SESSION: StaticCell<SessionOf<Virtual>> = StaticCell::new();
    static LINK: StaticCell<Link> = StaticCell::new();
    // Without its watchdog: a busy host may leave an emulator standing for longer than a period, which is no fault of the node.
    let chip = Chip { uid: 0, start, watchdog: watchdog::Absent };
    let link = Peers::make(&LINK, host, peers, FORWARDER.take());
    pin!(app::run(&SESSION, link, &mut Absent, Virtual, chip)).await
}

#[entry]
#[allow(clippy::expect_used)] // Once, at the start, where nothing else could be done about it.
fn main() -> ! {
    static EXECUTOR: StaticCell<Executor> = StaticCell::new();
    // The board's hardware does not tell.
    let start = reset::begin(ResetCause::Unknown);
    time::start();
    let ports = [UART_0, UART_1, UART_2, UART_3, UART_4];
    let [host, peers @ ..] =
        ports.map(|port| Uart::take(port, BIT_RATE).expect("nobody else takes the UART").split());
    let node = node(host, peers, start).expect("the task is spawned once");
    EXECUTOR.init(Executor::new()).run(|spawner| spawner.spawn(node))
}

#[panic_handler]
fn panic(info: &PanicInfo) -> ! {
    panic::report(info)
}
