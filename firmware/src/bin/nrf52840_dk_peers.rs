//! The node on an nRF52840-DK with a serial line to a neighbour: UARTE 0 on the virtual COM port is the line to the host, UARTE 1 on P1.01/P1.02 that to the
//! neighbour. The log by RTT. docs/book/src/boards.md
#![no_std]
#![no_main]

use embassy_nrf::buffered_uarte::{self, BufferedUarte, BufferedUarteRx, BufferedUarteTx};
use embassy_nrf::pac::P1;
use embassy_nrf::pac::gpio::vals::Pull;
use embassy_nrf::{bind_interrupts, peripherals};
use firmware::board::{Parts, ToPeers, host_buffers};
use firmware::nrf::{self, OrRestart, Wdt};
use funnelnet_app::link::peers::PeerBuffers;
use funnelnet_link::Forwarder;
use static_cell::ConstStaticCell;

bind_interrupts!(struct Interrupts {
    UARTE0 => buffered_uarte::InterruptHandler<peripherals::UARTE0>;
    UARTE1 => buffered_uarte::InterruptHandler<peripherals::UARTE1>;
});

/// The pin that hears the neighbour, P1.01.
const PEER_RX: usize = 1;

type Reader = OrRestart<BufferedUarteRx<'static>>;
type Writer = BufferedUarteTx<'static>;
type Node = Parts<ToPeers<Reader, Writer, 1>, nrf::Storage, Wdt>;

/// The half that writes first.
fn halves(uart: BufferedUarte<'static>) -> (Writer, Reader) {
    let (receive, transmit) = uart.split();
    (transmit, OrRestart(receive))
}

fn start() -> Node {
    static FORWARDER: ConstStaticCell<Forwarder<1>> = ConstStaticCell::new(Forwarder::new());
    static BUFFERS: ConstStaticCell<PeerBuffers> = ConstStaticCell::new(PeerBuffers::NEW);
    let board = embassy_nrf::init(nrf::clocks());
    let chip = nrf::begin(board.WDT, board.TIMER2);
    let (transmit, receive) = host_buffers();
    let host = BufferedUarte::new(
        board.UARTE0,
        board.TIMER0,
        board.PPI_CH0,
        board.PPI_CH1,
        board.PPI_GROUP0,
        board.P0_08,
        board.P0_06,
        Interrupts,
        nrf::line(),
        receive,
        transmit,
    );
    let (transmit, receive) = BUFFERS.take().halves();
    let peer = BufferedUarte::new(
        board.UARTE1,
        board.TIMER1,
        board.PPI_CH2,
        board.PPI_CH3,
        board.PPI_GROUP1,
        board.P1_01,
        board.P1_02,
        Interrupts,
        nrf::line(),
        receive,
        transmit,
    );
    // A line that leads nowhere is silent.
    P1.pin_cnf(PEER_RX).modify(|pin| pin.set_pull(Pull::Pullup));
    let lines =
        ToPeers { host: halves(host), peers: [halves(peer)], forwarder: FORWARDER.take(), errors: None };
    Node { lines, storage: nrf::storage(board.NVMC), chip }
}

firmware::node!(start, Node);
