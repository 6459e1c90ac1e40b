//! The node on a Raspberry Pi Pico: UART 0 on GP0/GP1, the log by RTT. docs/book/src/boards.md
#![no_std]
#![no_main]

use embassy_rp::uart::{self, BufferedUart};
use embassy_rp::{bind_interrupts, peripherals};
use firmware::board::{OnLine, Parts, host_buffers};
use firmware::rp::{self, Timer};

bind_interrupts!(struct Interrupts {
    UART0_IRQ => uart::BufferedInterruptHandler<peripherals::UART0>;
});

type Node = Parts<OnLine<BufferedUart>, rp::Storage, Timer>;

fn start() -> Node {
    let board = embassy_rp::init(Default::default());
    let (chip, storage) = rp::begin(board.FLASH, board.WATCHDOG);
    let (transmit, receive) = host_buffers();
    let uart =
        BufferedUart::new(board.UART0, board.PIN_0, board.PIN_1, Interrupts, transmit, receive, rp::line());
    rp::pull_up(rp::HOST_RX);
    Node { lines: OnLine(uart), storage, chip }
}

firmware::node!(start, Node);
