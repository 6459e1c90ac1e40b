//! The node on a Nucleo-F446RE: CAN 1 on PA11/PA12, USART 2 on the virtual COM port, the log by RTT. docs/book/src/boards.md
#![no_std]
#![no_main]

use core::panic::PanicInfo;
use core::pin::pin;

use cortex_m_rt::entry;
use defmt_rtt as _;
use embassy_stm32::can::util::NominalBitTiming;
use embassy_stm32::can::{
    Can, Rx0InterruptHandler, Rx1InterruptHandler, SceInterruptHandler, TxInterruptHandler,
};
use embassy_stm32::flash::FLASH_BASE;
use embassy_stm32::rcc::{
    AHBPrescaler, APBPrescaler, Hse, HseMode, Pll, PllMul, PllPDiv, PllPreDiv, PllSource, Sysclk,
};
use embassy_stm32::time::Hertz;
use embassy_stm32::usart::{self, BufferedUart};
use embassy_stm32::{Config, bind_interrupts, peripherals};
use firmware::app::{self, Chip, SessionOf};
use firmware::executor::Executor;
use firmware::panic;
use firmware::stm32::bxcan::{self, BxCan, TakeFrames, timing};
use firmware::stm32::line::{self, service_plane};
use firmware::stm32::safety::{self, Iwdg};
use firmware::stm32::sectors::Sectors;
use firmware::storage::flash::{Blocking, InFlash, region};
use funnelnet_app::link::can::CanNode;
use funnelnet_app::link::serial::Serial;
use funnelnet_plant::Virtual;
use funnelnet_store::split::Split;
use static_cell::{ConstStaticCell, StaticCell};

bind_interrupts!(struct Interrupts {
    CAN1_TX => TxInterruptHandler<peripherals::CAN1>;
    CAN1_RX0 => Rx0InterruptHandler<peripherals::CAN1>, TakeFrames;
    CAN1_RX1 => Rx1InterruptHandler<peripherals::CAN1>;
    CAN1_SCE => bxcan::CountErrors, SceInterruptHandler<peripherals::CAN1>;
    USART2 => line::CountErrors, usart::BufferedInterruptHandler<peripherals::USART2>;
});

/// 1 Mbit/s from 40 MHz: 20 time quanta of 2 periods, sampled after 16 (80 %).
const TIMING: NominalBitTiming = timing(2, 15, 4);

#[embassy_executor::task]
async fn node(can: BxCan, uart: BufferedUart<'static>, flash: Sectors, chip: Chip<Iwdg>) {
    static SESSION: StaticCell<SessionOf<Virtual>> = StaticCell::new();
    static LINK: StaticCell<CanNode<BxCan, BufferedUart<'static>>> = StaticCell::new();
    // Two sectors, a half of the store each.
    static STORAGE: StaticCell<InFlash<Split<Blocking<Sectors>, 2>>> = StaticCell::new();
    let link = LINK.init_with(|| CanNode::new(can, Serial::new(uart).with_errors(&line::ERRORS)));
    let storage = STORAGE.init_with(|| InFlash::new(Split(Blocking(flash)), region(FLASH_BASE as u32)));
    storage.open().await;
    pin!(app::run(&SESSION, link, storage, Virtual, chip)).await
}

/// 160 MHz, and 40 MHz for CAN, from the 8 MHz that the board's ST-LINK gives: the RC oscillator is too inaccurate for CAN.
fn clocks() -> Config {
    let mut config = Config::default();
    config.rcc.hse = Some(Hse { freq: Hertz(8_000_000), mode: HseMode::Bypass });
    config.rcc.pll_src = PllSource::HSE;
    config.rcc.pll = Some(Pll {
        prediv: PllPreDiv::DIV4,
        mul: PllMul::MUL160,
        divp: Some(PllPDiv::DIV2),
        divq: None,
        divr: None,
    });
    config.rcc.sys = Sysclk::PLL1_P;
    (config.rcc.ahb_pre, config.rcc.apb1_pre, config.rcc.apb2_pre) =
        (AHBPrescaler::DIV1, APBPrescaler::DIV4, APBPrescaler::DIV2);
    config
}

#[entry]
#[allow(clippy::expect_used)] // Once, at the start, where nothing else could be done about it.
fn main() -> ! {
    static EXECUTOR: StaticCell<Executor> = StaticCell::new();
    static TRANSMIT: ConstStaticCell<[u8; 512]> = ConstStaticCell::new([0; 512]);
    static RECEIVE: ConstStaticCell<[u8; 2048]> = ConstStaticCell::new([0; 2048]);
    safety::watch_the_start();
    let chip = embassy_stm32::init(clocks());
    let of_node = safety::begin(chip.IWDG);
    let config = service_plane();
    let (transmit, receive) = (TRANSMIT.take(), RECEIVE.take());
    let uart = BufferedUart::new(chip.USART2, chip.PA3, chip.PA2, transmit, receive, Interrupts, config)
        .expect("the bit rate is possible");
    let can = Can::new(chip.CAN1, chip.PA11, chip.PA12, Interrupts);
    let can = BxCan::start(can, TIMING);
    let flash = Sectors::new(chip.FLASH);
    let node = node(can, uart, flash, of_node).expect("the task is spawned once");
    EXECUTOR.init(Executor::new()).run(|spawner| spawner.spawn(node))
}

#[panic_handler]
fn panic(info: &PanicInfo) -> ! {
    panic::report(info)
}
