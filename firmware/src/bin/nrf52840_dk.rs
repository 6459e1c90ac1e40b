//! The node on an nRF52840-DK: UARTE 0 on the virtual COM port, the log by RTT. docs/book/src/boards.md
#![no_std]
#![no_main]

use core::panic::PanicInfo;
use core::pin::pin;

use cortex_m_rt::entry;
use defmt_rtt as _;
use embassy_nrf::buffered_uarte::{self, BufferedUarte};
use embassy_nrf::nvmc::Nvmc;
use embassy_nrf::{bind_interrupts, peripherals, uarte};
use firmware::app::{self, Chip, SessionOf};
use firmware::executor::Executor;
use firmware::nrf::{self, OrRestart, Wdt};
use firmware::storage::flash::{Blocking, InFlash, region};
use firmware::{panic, reset};
use funnelnet_app::link::serial::Serial;
use funnelnet_plant::Virtual;
use static_cell::{ConstStaticCell, StaticCell};

bind_interrupts!(struct Interrupts {
    UARTE0 => buffered_uarte::InterruptHandler<peripherals::UARTE0>;
});

#[embassy_executor::task]
async fn node(uart: BufferedUarte<'static>, flash: Nvmc<'static>, chip: Chip<Wdt>) {
    static SESSION: StaticCell<SessionOf<Virtual>> = StaticCell::new();
    static LINK: StaticCell<Serial<OrRestart<BufferedUarte<'static>>>> = StaticCell::new();
    static STORAGE: StaticCell<InFlash<Blocking<Nvmc<'static>>>> = StaticCell::new();
    let link = LINK.init_with(|| Serial::new(OrRestart(uart)));
    let storage = STORAGE.init_with(|| InFlash::new(Blocking(flash), region(0)));
    storage.open().await;
    pin!(app::run(&SESSION, link, storage, Virtual, chip)).await
}

#[entry]
#[allow(clippy::expect_used)] // Once, at the start, where nothing else could be done about it.
fn main() -> ! {
    static EXECUTOR: StaticCell<Executor> = StaticCell::new();
    static TRANSMIT: ConstStaticCell<[u8; 512]> = ConstStaticCell::new([0; 512]);
    static RECEIVE: ConstStaticCell<[u8; 2048]> = ConstStaticCell::new([0; 2048]);
    let chip = embassy_nrf::init(nrf::clocks());
    let start = reset::begin(nrf::cause());
    let of_node = Chip { uid: nrf::uid(), start, watchdog: Wdt::Idle(chip.WDT) };
    let mut config = uarte::Config::default();
    config.baudrate = uarte::Baudrate::Baud1m;
    let (receive, transmit) = (RECEIVE.take(), TRANSMIT.take());
    let uart = BufferedUarte::new(
        chip.UARTE0,
        chip.TIMER0,
        chip.PPI_CH0,
        chip.PPI_CH1,
        chip.PPI_GROUP0,
        chip.P0_08,
        chip.P0_06,
        Interrupts,
        config,
        receive,
        transmit,
    );
    let node = node(uart, Nvmc::new(chip.NVMC), of_node).expect("the task is spawned once");
    EXECUTOR.init(Executor::new()).run(|spawner| spawner.spawn(node))
}

#[panic_handler]
fn panic(info: &PanicInfo) -> ! {
    panic::report(info)
}
