//! The node on the emulated board, with lines to neighbours: UART 0 is the line to the host, UARTs 1 to 4 are those to neighbours.
#![no_std]
#![no_main]

use firmware::board::{Parts, ToPeers};
use firmware::mps2::flash::Flash;
use firmware::mps2::uart::{Receiver, Transmitter, UART_0, UART_1, UART_2, UART_3, UART_4, Uart};
use firmware::mps2::{self, BIT_RATE};
use funnelnet_app::watchdog;
use funnelnet_link::Forwarder;
use static_cell::ConstStaticCell;

type Node = Parts<ToPeers<Receiver, Transmitter, 4>, Flash, watchdog::Absent>;

#[allow(clippy::expect_used)] // Once, at the start, where nothing else could be done about it.
fn start() -> Node {
    static FORWARDER: ConstStaticCell<Forwarder<4>> = ConstStaticCell::new(Forwarder::new());
    let chip = mps2::start();
    let ports = [UART_0, UART_1, UART_2, UART_3, UART_4];
    let [host, peers @ ..] =
        // May panic: at the start, before any task runs.
        ports.map(|port| Uart::take(port, BIT_RATE).expect("nobody else takes the UART").split());
    let lines = ToPeers { host, peers, forwarder: FORWARDER.take(), errors: None };
    Node { lines, storage: Flash, chip }
}

firmware::node!(start, Node);
