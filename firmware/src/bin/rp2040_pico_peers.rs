//! The node on a Raspberry Pi Pico with a serial line to a neighbour: UART 0 on GP0/GP1 is the line to the host, UART 1 on GP4/GP5 that to the neighbour. The log by
//! RTT. docs/book/src/boards.md
#![no_std]
#![no_main]

use core::panic::PanicInfo;
use core::pin::pin;

use cortex_m_rt::entry;
use defmt_rtt as _;
use embassy_rp::pac::PADS_BANK0;
use embassy_rp::uart::{self, BufferedUart, BufferedUartRx, BufferedUartTx};
use embassy_rp::{bind_interrupts, flash, peripherals};
use firmware::app::{self, Chip, SessionOf};
use firmware::executor::Executor;
use firmware::rp::{self, PicoFlash, Timer};
use firmware::storage::flash::{Blocking, InFlash, region};
use firmware::{panic, reset};
use funnelnet_app::link::peers::{PeerBuffers, Peers};
use funnelnet_link::Forwarder;
use funnelnet_plant::Virtual;
use static_cell::{ConstStaticCell, StaticCell};

bind_interrupts!(struct Interrupts {
    UART0_IRQ => uart::BufferedInterruptHandler<peripherals::UART0>;
    UART1_IRQ => uart::BufferedInterruptHandler<peripherals::UART1>;
});

/// Of both lines, bit/s.
const BIT_RATE: u32 = 1_000_000;
/// The pin that hears the neighbour, GP5.
const PEER_RX: usize = 5;

type Halves = (BufferedUartTx, BufferedUartRx);
type Link = Peers<BufferedUartRx, BufferedUartTx, BufferedUartRx, BufferedUartTx, 1>;

#[embassy_executor::task]
async fn node(host: Halves, peer: Halves, flash: PicoFlash, chip: Chip<Timer>) {
    static FORWARDER: ConstStaticCell<Forwarder<1>> = ConstStaticCell::new(Forwarder::new());
    static SESSION: StaticCell<SessionOf<Virtual>> = StaticCell::new();
    static LINK: StaticCell<Link> = StaticCell::new();
    static STORAGE: StaticCell<InFlash<Blocking<PicoFlash>>> = StaticCell::new();
    let link = Peers::make(&LINK, host, [peer], FORWARDER.take());
    let storage = STORAGE.init_with(|| InFlash::new(Blocking(flash), region(flash::FLASH_BASE as u32)));
    storage.open().await;
    pin!(app::run(&SESSION, link, storage, Virtual, chip)).await
}

#[entry]
#[allow(clippy::expect_used)] // Once, at the start, where nothing else could be done about it.
fn main() -> ! {
    static EXECUTOR: StaticCell<Executor> = StaticCell::new();
    static TRANSMIT: ConstStaticCell<[u8; 512]> = ConstStaticCell::new([0; 512]);
    static RECEIVE: ConstStaticCell<[u8; 2048]> = ConstStaticCell::new([0; 2048]);
    static BUFFERS: ConstStaticCell<PeerBuffers> = ConstStaticCell::new(PeerBuffers::NEW);
    let chip = embassy_rp::init(Default::default());
    let start = reset::begin(rp::cause());
    // Before anything else runs: the flash cannot be executed from while it is asked.
    let mut flash = PicoFlash::new_blocking(chip.FLASH);
    let of_node = Chip { uid: rp::uid(&mut flash), start, watchdog: Timer::new(chip.WATCHDOG) };
    let mut config = uart::Config::default();
    config.baudrate = BIT_RATE;
    let (transmit, receive) = (TRANSMIT.take(), RECEIVE.take());
    let host = BufferedUart::new(chip.UART0, chip.PIN_0, chip.PIN_1, Interrupts, transmit, receive, config);
    let (transmit, receive) = BUFFERS.take().halves();
    let peer = BufferedUart::new(chip.UART1, chip.PIN_4, chip.PIN_5, Interrupts, transmit, receive, config);
    // A line that leads nowhere is silent.
    PADS_BANK0.gpio(PEER_RX).modify(|pad| {
        pad.set_pde(false);
        pad.set_pue(true);
    });
    let node = node(host.split(), peer.split(), flash, of_node).expect("the task is spawned once");
    EXECUTOR.init(Executor::new()).run(|spawner| spawner.spawn(node))
}

#[panic_handler]
fn panic(info: &PanicInfo) -> ! {
    panic::report(info)
}
