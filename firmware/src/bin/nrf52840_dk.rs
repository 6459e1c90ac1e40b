//! The node on an nRF52840-DK: UARTE 0 on the virtual COM port, the log by RTT. docs/book/src/boards.md
#![no_std]
#![no_main]

use embassy_nrf::buffered_uarte::{self, BufferedUarte};
use embassy_nrf::{bind_interrupts, peripherals};
use firmware::board::{OnLine, Parts, host_buffers};
use firmware::nrf::{self, OrRestart, Wdt};

bind_interrupts!(struct Interrupts {
    UARTE0 => buffered_uarte::InterruptHandler<peripherals::UARTE0>;
});

type Node = Parts<OnLine<OrRestart<BufferedUarte<'static>>>, nrf::Storage, Wdt>;

fn start() -> Node {
    let board = embassy_nrf::init(nrf::clocks());
    let chip = nrf::begin(board.WDT, board.TIMER2);
    let (transmit, receive) = host_buffers();
    let uart = BufferedUarte::new(
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
    Node { lines: OnLine(OrRestart(uart)), storage: nrf::storage(board.NVMC), chip }
}

firmware::node!(start, Node);
