//! A Nucleo-F446RE that checks its own hardware, and says what it found on the virtual COM port (USART 2), 115,200 bit/s; a wire from PA9 to PA10
//! for the echo, an oscilloscope at PA5, where the LED is. docs/book/src/board-check.md
#![no_std]
#![no_main]

use embassy_stm32::can::{
    Can, Rx0InterruptHandler, Rx1InterruptHandler, SceInterruptHandler, TxInterruptHandler,
};
use embassy_stm32::gpio::{Level, Output, Pull, Speed};
use embassy_stm32::usart::{self, BufferedUart};
use embassy_stm32::{bind_interrupts, peripherals};
use firmware::board::host_buffers;
use firmware::board_check::can::Looped;
use firmware::board_check::{Bench, Facts};
use firmware::stm32::bxcan::{self, BxCan, TakeFrames};
use firmware::stm32::line::{self, line, opened, service_plane};
use firmware::stm32::safety::Iwdg;
use firmware::stm32::sectors::Sectors;
use firmware::stm32::{f4, safety};
use firmware::storage::flash::Blocking;
use funnelnet_store::split::Split;
use static_cell::ConstStaticCell;

bind_interrupts!(struct Interrupts {
    CAN1_TX => TxInterruptHandler<peripherals::CAN1>;
    CAN1_RX0 => Rx0InterruptHandler<peripherals::CAN1>, TakeFrames;
    CAN1_RX1 => Rx1InterruptHandler<peripherals::CAN1>;
    CAN1_SCE => bxcan::CountErrors, SceInterruptHandler<peripherals::CAN1>;
    USART1 => line::CountErrors, usart::BufferedInterruptHandler<peripherals::USART1>;
    USART2 => line::CountErrors, usart::BufferedInterruptHandler<peripherals::USART2>;
});

/// Of the echo, as of a line to a neighbour, bit/s.
const BIT_RATE: u32 = 1_000_000;

/// Flash: the most that the data sheet has, 100 us for each of 4,096 words and 500 ms for a sector of 16 KiB, which is half of the storage; and a tenth.
/// Watchdog: 2 s of an oscillator of 32 kHz, which the data sheet has between 17 and 47 kHz.
const FACTS: Facts = Facts {
    board: "board_check_f446",
    jumper: "from PA9 to PA10 (CN10 pins 21, 33)",
    clock: "160 MHz of the ST-LINK's 8 MHz",
    other_clock: "160 MHz of the RC oscillator, no clock of the ST-LINK",
    spread_us: 50,
    page: 16_384,
    program_us: 451_000,
    erase_us: 550_000,
    watchdog_us: (1_361_000, 3_765_000),
};

type Flash = Split<Blocking<Sectors>, 2>;
type F446 = Bench<BufferedUart<'static>, BufferedUart<'static>, Looped<BxCan>, Flash, Output<'static>, Iwdg>;

#[inline(always)] // Into `main`, which may panic before its task runs.
fn start() -> F446 {
    static TRANSMIT: ConstStaticCell<[u8; 512]> = ConstStaticCell::new([0; 512]);
    static RECEIVE: ConstStaticCell<[u8; 512]> = ConstStaticCell::new([0; 512]);
    safety::watch_the_start();
    let has_clock = f4::has_clock();
    let board = f4::begin_check(has_clock);
    let chip = safety::begin(board.IWDG);
    let (transmit, receive) = host_buffers();
    let config = service_plane();
    let host = BufferedUart::new(board.USART2, board.PA3, board.PA2, transmit, receive, Interrupts, config);
    let mut config = line(BIT_RATE);
    // A line that leads nowhere is silent.
    config.rx_pull = Pull::Up;
    let (transmit, receive) = (TRANSMIT.take(), RECEIVE.take());
    let echo = BufferedUart::new(board.USART1, board.PA10, board.PA9, transmit, receive, Interrupts, config);
    let can = f4::looped_can(Can::new(board.CAN1, board.PA11, board.PA12, Interrupts));
    let pin = Output::new(board.PA5, Level::Low, Speed::Low);
    let (host, echo, can) = (opened(host), opened(echo), Looped(can));
    F446 { facts: FACTS, host, echo, can, storage: f4::storage(board.FLASH), pin, chip, has_clock }
}

firmware::board_check!(start, F446);
