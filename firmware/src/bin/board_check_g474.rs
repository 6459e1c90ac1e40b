//! A Nucleo-G474RE that checks its own hardware, and says what it found on the virtual COM port (LPUART 1), 115,200 bit/s; a wire from PC4 to PC5
//! for the echo, an oscilloscope at PA5, where the LED is. docs/book/src/board-check.md
#![no_std]
#![no_main]

use embassy_stm32::can::{CanConfigurator, IT0InterruptHandler, IT1InterruptHandler};
use embassy_stm32::flash;
use embassy_stm32::gpio::{Level, Output, Pull, Speed};
use embassy_stm32::usart::{self, BufferedUart};
use embassy_stm32::{bind_interrupts, peripherals};
use firmware::board::host_buffers;
use firmware::board_check::can::Looped;
use firmware::board_check::{Bench, Facts};
use firmware::stm32::fdcan::{FdCan, TakeFrames};
use firmware::stm32::line::{CountErrors, line, opened, service_plane};
use firmware::stm32::safety::Iwdg;
use firmware::stm32::{g4, safety};
use firmware::storage::flash::Blocking;
use static_cell::ConstStaticCell;

bind_interrupts!(struct Interrupts {
    FDCAN1_IT0 => IT0InterruptHandler<peripherals::FDCAN1>, TakeFrames;
    FDCAN1_IT1 => IT1InterruptHandler<peripherals::FDCAN1>;
    LPUART1 => CountErrors, usart::BufferedInterruptHandler<peripherals::LPUART1>;
    USART1 => CountErrors, usart::BufferedInterruptHandler<peripherals::USART1>;
});

/// Of the echo, as of a line to a neighbour, bit/s.
const BIT_RATE: u32 = 1_000_000;

/// Flash: twice the most that the data sheet has, 91 us for each of 256 double words and 24.5 ms for a page. Watchdog: 2 s of an oscillator of 32 kHz
/// that may be wrong by 5 %, and the steps of its counter.
const FACTS: Facts = Facts {
    board: "board_check_g474",
    jumper: "from PC4 to PC5 (CN10 pins 34, 6)",
    clock: "160 MHz of the crystal of 24 MHz",
    other_clock: "16 MHz of the RC oscillator, no crystal",
    spread_us: 50,
    page: 2_048,
    program_us: 48_000,
    erase_us: 50_000,
    watchdog_us: (1_850_000, 2_150_000),
};

type Flash = Blocking<flash::Flash<'static, flash::Blocking>>;
type G474 = Bench<BufferedUart<'static>, BufferedUart<'static>, Looped<FdCan>, Flash, Output<'static>, Iwdg>;

#[inline(always)] // Into `main`, which may panic before its task runs.
fn start() -> G474 {
    static TRANSMIT: ConstStaticCell<[u8; 512]> = ConstStaticCell::new([0; 512]);
    static RECEIVE: ConstStaticCell<[u8; 512]> = ConstStaticCell::new([0; 512]);
    safety::watch_the_start();
    let has_clock = g4::has_crystal();
    let board = embassy_stm32::init(if has_clock { g4::clocks() } else { g4::clocks_without_crystal() });
    let chip = safety::begin(board.IWDG);
    let (transmit, receive) = host_buffers();
    let config = service_plane();
    let host = BufferedUart::new(board.LPUART1, board.PA3, board.PA2, transmit, receive, Interrupts, config);
    let mut config = line(BIT_RATE);
    // A line that leads nowhere is silent.
    config.rx_pull = Pull::Up;
    let (transmit, receive) = (TRANSMIT.take(), RECEIVE.take());
    let echo = BufferedUart::new(board.USART1, board.PC5, board.PC4, transmit, receive, Interrupts, config);
    let can = g4::looped_can(CanConfigurator::new(board.FDCAN1, board.PA11, board.PA12, Interrupts));
    let pin = Output::new(board.PA5, Level::Low, Speed::Low);
    let (host, echo, can) = (opened(host), opened(echo), Looped(can));
    G474 { facts: FACTS, host, echo, can, storage: g4::storage(board.FLASH), pin, chip, has_clock }
}

firmware::board_check!(start, G474);
