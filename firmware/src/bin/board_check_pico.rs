//! A Raspberry Pi Pico that checks its own hardware, and says what it found on UART 0, GP0/GP1, 1 Mbit/s; a wire from GP4 to GP5 for the echo,
//! an oscilloscope at GP2. docs/book/src/board-check.md
#![no_std]
#![no_main]

use embassy_rp::gpio::{Level, Output};
use embassy_rp::uart::{self, BufferedUart};
use embassy_rp::{bind_interrupts, peripherals};
use firmware::board::host_buffers;
use firmware::board_check::can::NoCan;
use firmware::board_check::{Bench, Facts};
use firmware::rp::{self, PicoFlash, Timer};
use firmware::storage::flash::Blocking;
use static_cell::ConstStaticCell;

bind_interrupts!(struct Interrupts {
    UART0_IRQ => uart::BufferedInterruptHandler<peripherals::UART0>;
    UART1_IRQ => uart::BufferedInterruptHandler<peripherals::UART1>;
});

/// The pin that hears the echo, GP5.
const ECHO_RX: usize = 5;

/// Flash: W25Q16JV, at most 3 ms for each of 16 pages of 256 bytes, 400 ms for a sector; and a tenth for the boot ROM, which goes out of
/// XIP and back. Watchdog: 2 s of the crystal.
const FACTS: Facts = Facts {
    board: "board_check_pico",
    jumper: "from GP4 to GP5 (pins 6, 7)",
    clock: "125 MHz of the crystal of 12 MHz",
    other_clock: "ring oscillator, no crystal",
    spread_us: 50,
    page: 4_096,
    program_us: 53_000,
    erase_us: 440_000,
    watchdog_us: (1_980_000, 2_020_000),
};

type Pico = Bench<BufferedUart, BufferedUart, NoCan, Blocking<PicoFlash>, Output<'static>, Timer>;

#[inline(always)] // Into `main`, which may panic before its task runs.
fn start() -> Pico {
    static TRANSMIT: ConstStaticCell<[u8; 512]> = ConstStaticCell::new([0; 512]);
    static RECEIVE: ConstStaticCell<[u8; 512]> = ConstStaticCell::new([0; 512]);
    let has_clock = rp::has_crystal();
    let board = embassy_rp::init(rp::clocks(has_clock));
    let (chip, storage) = rp::begin(board.FLASH, board.WATCHDOG);
    let (transmit, receive) = host_buffers();
    let host =
        BufferedUart::new(board.UART0, board.PIN_0, board.PIN_1, Interrupts, transmit, receive, rp::line());
    let (transmit, receive) = (TRANSMIT.take(), RECEIVE.take());
    let echo =
        BufferedUart::new(board.UART1, board.PIN_4, board.PIN_5, Interrupts, transmit, receive, rp::line());
    rp::pull_up(rp::HOST_RX);
    rp::pull_up(ECHO_RX);
    let pin = Output::new(board.PIN_2, Level::Low);
    Pico { facts: FACTS, host, echo, can: NoCan, storage, pin, chip, has_clock }
}

firmware::board_check!(start, Pico);
