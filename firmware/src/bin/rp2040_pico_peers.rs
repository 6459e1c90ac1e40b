//! The node on a Raspberry Pi Pico with a serial line to a neighbour: UART 0 on GP0/GP1 is the line to the host, UART 1 on GP4/GP5 that to the neighbour. The log by
//! RTT. docs/book/src/boards.md
#![no_std]
#![no_main]

use embassy_rp::uart::{self, BufferedUart, BufferedUartRx, BufferedUartTx};
use embassy_rp::{bind_interrupts, peripherals};
use firmware::board::{Parts, ToPeers, host_buffers};
use firmware::rp::{self, Timer};
use funnelnet_app::link::peers::PeerBuffers;
use funnelnet_link::Forwarder;
use static_cell::ConstStaticCell;

bind_interrupts!(struct Interrupts {
    UART0_IRQ => uart::BufferedInterruptHandler<peripherals::UART0>;
    UART1_IRQ => uart::BufferedInterruptHandler<peripherals::UART1>;
});

/// The pin that hears the neighbour, GP5.
const PEER_RX: usize = 5;

type Node = Parts<ToPeers<BufferedUartRx, BufferedUartTx, 1>, rp::Storage, Timer>;

fn start() -> Node {
    static FORWARDER: ConstStaticCell<Forwarder<1>> = ConstStaticCell::new(Forwarder::new());
    static BUFFERS: ConstStaticCell<PeerBuffers> = ConstStaticCell::new(PeerBuffers::NEW);
    let board = embassy_rp::init(Default::default());
    let (chip, storage) = rp::begin(board.FLASH, board.WATCHDOG);
    let (transmit, receive) = host_buffers();
    let host =
        BufferedUart::new(board.UART0, board.PIN_0, board.PIN_1, Interrupts, transmit, receive, rp::line());
    let (transmit, receive) = BUFFERS.take().halves();
    let peer =
        BufferedUart::new(board.UART1, board.PIN_4, board.PIN_5, Interrupts, transmit, receive, rp::line());
    rp::pull_up(rp::HOST_RX);
    rp::pull_up(PEER_RX);
    let (host, peers) = (host.split(), [peer.split()]);
    Node { lines: ToPeers { host, peers, forwarder: FORWARDER.take(), errors: None }, storage, chip }
}

firmware::node!(start, Node);
