//! An nRF52840-DK that checks its own hardware, and says what it found on the virtual COM port (UARTE 0), 1 Mbit/s; a wire from P1.02 to P1.01 for the
//! echo, an oscilloscope at P1.03. docs/book/src/board-check.md
#![no_std]
#![no_main]

use embassy_nrf::buffered_uarte::{self, BufferedUarte};
use embassy_nrf::gpio::{Level, Output, OutputDrive};
use embassy_nrf::nvmc::Nvmc;
use embassy_nrf::pac::P1;
use embassy_nrf::pac::gpio::vals::Pull;
use embassy_nrf::{bind_interrupts, peripherals};
use firmware::board::host_buffers;
use firmware::board_check::can::NoCan;
use firmware::board_check::{Bench, Facts};
use firmware::nrf::crystals::{self, Crystals};
use firmware::nrf::{self, Wdt};
use firmware::storage::flash::Blocking;
use static_cell::ConstStaticCell;

bind_interrupts!(struct Interrupts {
    UARTE0 => buffered_uarte::InterruptHandler<peripherals::UARTE0>;
    UARTE1 => buffered_uarte::InterruptHandler<peripherals::UARTE1>;
});

/// The pin that hears the echo, P1.01.
const ECHO_RX: usize = 1;

/// Flash: the most that the product specification has, 41 us for each of 1,024 words and 85 ms for a page; and a tenth. Watchdog: 2 s of the crystal.
const FACTS: Facts = Facts {
    board: "board_check_nrf52840",
    jumper: "from P1.02 to P1.01 (D1, D0)",
    clock: "crystals of 32 MHz and 32,768 Hz",
    other_clock: "",
    spread_us: 50,
    page: 4_096,
    program_us: 46_200,
    erase_us: 93_500,
    watchdog_us: (1_980_000, 2_020_000),
};

/// Which crystal is missing.
const fn missing(crystals: Crystals) -> &'static str {
    match (crystals.fast, crystals.slow) {
        (false, false) => "RC oscillators, no crystal",
        (false, true) => "no crystal of 32 MHz",
        (true, _) => "no crystal of 32,768 Hz",
    }
}

type Uart = BufferedUarte<'static>;
type Nrf = Bench<Uart, Uart, NoCan, Blocking<Nvmc<'static>>, Output<'static>, Wdt>;

#[inline(always)] // Into `main`, which may panic before its task runs.
fn start() -> Nrf {
    static TRANSMIT: ConstStaticCell<[u8; 512]> = ConstStaticCell::new([0; 512]);
    static RECEIVE: ConstStaticCell<[u8; 512]> = ConstStaticCell::new([0; 512]);
    let crystals = crystals::look();
    let board = embassy_nrf::init(crystals::clocks(crystals));
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
    let (transmit, receive) = (TRANSMIT.take(), RECEIVE.take());
    let echo = BufferedUarte::new(
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
    P1.pin_cnf(ECHO_RX).modify(|pin| pin.set_pull(Pull::Pullup));
    let pin = Output::new(board.P1_03, Level::Low, OutputDrive::Standard);
    let facts = Facts { other_clock: missing(crystals), ..FACTS };
    let has_clock = crystals.fast && crystals.slow;
    Nrf { facts, host, echo, can: NoCan, storage: nrf::storage(board.NVMC), pin, chip, has_clock }
}

firmware::board_check!(start, Nrf);
