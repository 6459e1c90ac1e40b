//! The node on a Nucleo-G474RE with serial lines to neighbours: LPUART 1 on the virtual COM port is the line to the host, USART 1, USART 3, UART 4 and
//! UART 5 are those to neighbours; no CAN. The log by RTT. docs/book/src/boards.md
#![no_std]
#![no_main]

use embassy_stm32::gpio::Pull;
use embassy_stm32::usart::{self, BufferedUart, BufferedUartRx, BufferedUartTx, ConfigError};
use embassy_stm32::{bind_interrupts, peripherals};
use firmware::board::{Parts, ToPeers, host_buffers};
use firmware::stm32::g4;
use firmware::stm32::line::{CountErrors, ERRORS, line, opened};
use firmware::stm32::safety::{self, Iwdg};
use funnelnet_app::link::peers::PeerBuffers;
use funnelnet_link::Forwarder;
use static_cell::ConstStaticCell;

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

type Node = Parts<ToPeers<BufferedUartRx<'static>, BufferedUartTx<'static>, PEERS>, g4::Storage, Iwdg>;

fn start() -> Node {
    static FORWARDER: ConstStaticCell<Forwarder<PEERS>> = ConstStaticCell::new(Forwarder::new());
    static BUFFERS: ConstStaticCell<[PeerBuffers; PEERS]> = ConstStaticCell::new([PeerBuffers::NEW; PEERS]);
    safety::watch_the_start();
    let board = embassy_stm32::init(g4::clocks());
    let chip = safety::begin(board.IWDG);
    let mut config = line(BIT_RATE);
    // A line that leads nowhere is silent.
    config.rx_pull = Pull::Up;
    let halves = |uart: Result<BufferedUart<'static>, ConfigError>| opened(uart).split();
    let (transmit, receive) = host_buffers();
    let host =
        halves(BufferedUart::new(board.LPUART1, board.PA3, board.PA2, transmit, receive, Interrupts, config));
    let [one, two, three, four] = BUFFERS.take().each_mut().map(PeerBuffers::halves);
    let peers = [
        halves(BufferedUart::new(board.USART1, board.PC5, board.PC4, one.0, one.1, Interrupts, config)),
        halves(BufferedUart::new(board.USART3, board.PB11, board.PB10, two.0, two.1, Interrupts, config)),
        halves(BufferedUart::new(board.UART4, board.PC11, board.PC10, three.0, three.1, Interrupts, config)),
        halves(BufferedUart::new(board.UART5, board.PD2, board.PC12, four.0, four.1, Interrupts, config)),
    ];
    let lines = ToPeers { host, peers, forwarder: FORWARDER.take(), errors: Some(&ERRORS) };
    Node { lines, storage: g4::storage(board.FLASH), chip }
}

firmware::node!(start, Node);
