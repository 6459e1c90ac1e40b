//! The node on the emulated board: `qemu-system-arm -M mps2-an386`. UART 0 is the link, semihosting the log.
#![no_std]
#![no_main]

use firmware::board::{OnLine, Parts};
use firmware::mps2::flash::Flash;
use firmware::mps2::uart::{UART_0, Uart};
use firmware::mps2::{self, BIT_RATE};
use funnelnet_app::watchdog;

type Node = Parts<OnLine<Uart>, Flash, watchdog::Absent>;

#[allow(clippy::expect_used)] // Once, at the start, where nothing else could be done about it.
fn start() -> Node {
    let chip = mps2::start();
    // May panic: at the start, before any task runs.
    let uart = Uart::take(UART_0, BIT_RATE).expect("nobody else takes the UART");
    Node { lines: OnLine(uart), storage: Flash, chip }
}

firmware::node!(start, Node);
