//! The node on a Nucleo-G474RE with serial lines to neighbours: LPUART 1 on the virtual COM port is the line to the host, USART 1, USART 3, UART 4 and
//! UART 5 are those to neighbours; no CAN. The log by RTT. docs/book/src/boards.md
#![no_std]
#![no_main]

use core::panic::PanicInfo;
use core::pin::pin;

use cortex_m_rt::entry;
use defmt_rtt as _;
use embassy_stm32::flash::{self, Flash};
use embassy_stm32::gpio::Pull;
use embassy_stm32::usart::{self, BufferedUart, BufferedUartRx, BufferedUartTx, ConfigError};
use embassy_stm32::{bind_interrupts, peripherals};
use firmware::app::{self, Chip, SessionOf};
use firmware::executor::Executor;
use firmware::panic;
use firmware::stm32::clocks::clocks;
use firmware::stm32::line::{CountErrors, ERRORS, line};
use firmware::stm32::safety::{self, Iwdg};
use firmware::storage::flash::{Blocking, InFlash, region};
use funnelnet_app::link::peers::{PeerBuffers, Peers};
use funnelnet_link::Forwarder;
use funnelnet_plant::Virtual;
use static_cell::{ConstStaticCell, StaticCell};

bind_interrupts!(struct Interrupts {
    LPUART1 => CountErrors, usart::BufferedInterruptHandler<peripherals::LPUART1>;
    USART1 => CountErrors, usart::BufferedInterruptHandler<peripherals::USART1>;
    USART3 => CountErrors, usart::BufferedInterruptHandler<peripherals::USART3>;
    UART4 => CountErrors, usart::BufferedInterruptHandler<peripherals::UART4>;
    UART5 => CountErrors, usart::BufferedInterruptHandler<peripherals::UART5>;
});

/// Lines to neighbours.
const PEERS: usize = 4;
/// Of every line, bit/s.
const BIT_RATE: u32 = 1_000_000;

type Reader = BufferedUartRx<'static>;
type Writer = BufferedUartTx<'static>;
type Halves = (Writer, Reader);
type Link = Peers<Reader, Writer, Reader, Writer, PEERS>;

#[embassy_executor::task]
async fn node(
    host: Halves,
    peers: [Halves; PEERS],
    flash: Flash<'static, flash::Blocking>,
    chip: Chip<Iwdg>,
) {
    static FORWARDER: ConstStaticCell<Forwarder<PEERS>> = ConstStaticCell::new(Forwarder::new());
    static SESSION: StaticCell<SessionOf<Virtual>> = StaticCell::new();
    static LINK: StaticCell<Link> = StaticCell::new();
    // In the second bank, while the program runs in the first.
    static STORAGE: StaticCell<InFlash<Blocking<Flash<'static, flash::Blocking>>>> = StaticCell::new();
    let link = Peers::make(&LINK, host, peers, FORWARDER.take());
    link.count_errors(&ERRORS);
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
    static BUFFERS: ConstStaticCell<[PeerBuffers; PEERS]> = ConstStaticCell::new([PeerBuffers::NEW; PEERS]);
    safety::watch_the_start();
    let chip = embassy_stm32::init(clocks());
    let of_node = safety::begin(chip.IWDG);
    let mut config = line(BIT_RATE);
    // A line that leads nowhere is silent.
    config.rx_pull = Pull::Up;
    let (transmit, receive) = (TRANSMIT.take(), RECEIVE.take());
    let halves =
        |uart: Result<BufferedUart<'static>, ConfigError>| uart.expect("the bit rate is possible").split();
    let host =
        halves(BufferedUart::new(chip.LPUART1, chip.PA3, chip.PA2, transmit, receive, Interrupts, config));
    let [one, two, three, four] = BUFFERS.take().each_mut().map(PeerBuffers::halves);
    let peers = [
        halves(BufferedUart::new(chip.USART1, chip.PC5, chip.PC4, one.0, one.1, Interrupts, config)),
        halves(BufferedUart::new(chip.USART3, chip.PB11, chip.PB10, two.0, two.1, Interrupts, config)),
        halves(BufferedUart::new(chip.UART4, chip.PC11, chip.PC10, three.0, three.1, Interrupts, config)),
        halves(BufferedUart::new(chip.UART5, chip.PD2, chip.PC12, four.0, four.1, Interrupts, config)),
    ];
    let node = node(host, peers, Flash::new_blocking(chip.FLASH), of_node).expect("the task is spawned once");
    EXECUTOR.init(Executor::new()).run(|spawner| spawner.spawn(node))
}

#[panic_handler]
fn panic(info: &PanicInfo) -> ! {
    panic::report(info)
}
