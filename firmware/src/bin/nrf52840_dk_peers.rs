//! The node on an nRF52840-DK with a serial line to a neighbour: UARTE 0 on the virtual COM port is the line to the host, UARTE 1 on P1.01/P1.02 that to the
//! neighbour. The log by RTT. docs/book/src/boards.md
#![no_std]
#![no_main]

use core::panic::PanicInfo;
use core::pin::pin;

use cortex_m_rt::entry;
use defmt_rtt as _;
use embassy_nrf::buffered_uarte::{self, BufferedUarte, BufferedUarteRx, BufferedUarteTx};
use embassy_nrf::nvmc::Nvmc;
use embassy_nrf::pac::P1;
use embassy_nrf::pac::gpio::vals::Pull;
use embassy_nrf::{bind_interrupts, peripherals, uarte};
use firmware::app::{self, Chip, SessionOf};
use firmware::executor::Executor;
use firmware::nrf::{self, OrRestart, Wdt};
use firmware::storage::flash::{Blocking, InFlash, region};
use firmware::{panic, reset};
use funnelnet_app::link::peers::{PeerBuffers, Peers};
use funnelnet_link::Forwarder;
use funnelnet_plant::Virtual;
use static_cell::{ConstStaticCell, StaticCell};

bind_interrupts!(struct Interrupts {
    UARTE0 => buffered_uarte::InterruptHandler<peripherals::UARTE0>;
    UARTE1 => buffered_uarte::InterruptHandler<peripherals::UARTE1>;
});

/// The pin that hears the neighbour, P1.01.
const PEER_RX: usize = 1;

type Reader = OrRestart<BufferedUarteRx<'static>>;
type Writer = BufferedUarteTx<'static>;
type Halves = (Writer, Reader);
type Link = Peers<Reader, Writer, Reader, Writer, 1>;

#[embassy_executor::task]
async fn node(host: Halves, peer: Halves, flash: Nvmc<'static>, chip: Chip<Wdt>) {
    static FORWARDER: ConstStaticCell<Forwarder<1>> = ConstStaticCell::new(Forwarder::new());
    static SESSION: StaticCell<SessionOf<Virtual>> = StaticCell::new();
    static LINK: StaticCell<Link> = StaticCell::new();
    static STORAGE: StaticCell<InFlash<Blocking<Nvmc<'static>>>> = StaticCell::new();
    let link = Peers::make(&LINK, host, [peer], FORWARDER.take());
    let storage = STORAGE.init_with(|| InFlash::new(Blocking(flash), region(0)));
    storage.open().await;
    pin!(app::run(&SESSION, link, storage, Virtual, chip)).await
}

/// The half that writes first.
fn halves(uart: BufferedUarte<'static>) -> Halves {
    let (receive, transmit) = uart.split();
    (transmit, OrRestart(receive))
}

#[entry]
#[allow(clippy::expect_used)] // Once, at the start, where nothing else could be done about it.
fn main() -> ! {
    static EXECUTOR: StaticCell<Executor> = StaticCell::new();
    static TRANSMIT: ConstStaticCell<[u8; 512]> = ConstStaticCell::new([0; 512]);
    static RECEIVE: ConstStaticCell<[u8; 2048]> = ConstStaticCell::new([0; 2048]);
    static BUFFERS: ConstStaticCell<PeerBuffers> = ConstStaticCell::new(PeerBuffers::NEW);
    let chip = embassy_nrf::init(nrf::clocks());
    let start = reset::begin(nrf::cause());
    let of_node = Chip { uid: nrf::uid(), start, watchdog: Wdt::Idle(chip.WDT) };
    let mut config = uarte::Config::default();
    config.baudrate = uarte::Baudrate::Baud1m;
    let (receive, transmit) = (RECEIVE.take(), TRANSMIT.take());
    let host = BufferedUarte::new(
        chip.UARTE0,
        chip.TIMER0,
        chip.PPI_CH0,
        chip.PPI_CH1,
        chip.PPI_GROUP0,
        chip.P0_08,
        chip.P0_06,
        Interrupts,
        config.clone(),
        receive,
        transmit,
    );
    let (transmit, receive) = BUFFERS.take().halves();
    let peer = BufferedUarte::new(
        chip.UARTE1,
        chip.TIMER1,
        chip.PPI_CH2,
        chip.PPI_CH3,
        chip.PPI_GROUP1,
        chip.P1_01,
        chip.P1_02,
        Interrupts,
        config,
        receive,
        transmit,
    );
    // A line that leads nowhere is silent.
    P1.pin_cnf(PEER_RX).modify(|pin| pin.set_pull(Pull::Pullup));
    let flash = Nvmc::new(chip.NVMC);
    let node = node(halves(host), halves(peer), flash, of_node).expect("the task is spawned once");
    EXECUTOR.init(Executor::new()).run(|spawner| spawner.spawn(node))
}

#[panic_handler]
fn panic(info: &PanicInfo) -> ! {
    panic::report(info)
}
