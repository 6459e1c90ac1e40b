//! The node on a Nucleo-G474RE: FDCAN 1 on PA11/PA12, LPUART 1 on the virtual COM port, the log by RTT. docs/book/src/boards.md
#![no_std]
#![no_main]

use core::panic::PanicInfo;
use core::pin::pin;

use cortex_m_rt::entry;
use defmt_rtt as _;
use embassy_stm32::can::config::NominalBitTiming;
use embassy_stm32::can::{CanConfigurator, IT0InterruptHandler, IT1InterruptHandler};
use embassy_stm32::flash::{self, Flash};
use embassy_stm32::usart::{self, BufferedUart};
use embassy_stm32::{bind_interrupts, peripherals};
use firmware::app::{self, Chip, SessionOf};
use firmware::executor::Executor;
use firmware::panic;
use firmware::stm32::clocks::clocks;
use firmware::stm32::fdcan::{FdCan, FdTiming, TakeFrames, fd_timing, timing};
use firmware::stm32::line::{self, CountErrors, service_plane};
use firmware::stm32::safety::{self, Iwdg};
use firmware::storage::flash::{Blocking, InFlash, region};
use funnelnet_app::link::can::CanNode;
use funnelnet_app::link::serial::Serial;
use funnelnet_plant::Virtual;
use static_cell::{ConstStaticCell, StaticCell};

bind_interrupts!(struct Interrupts {
    FDCAN1_IT0 => IT0InterruptHandler<peripherals::FDCAN1>, TakeFrames;
    FDCAN1_IT1 => IT1InterruptHandler<peripherals::FDCAN1>;
    LPUART1 => CountErrors, usart::BufferedInterruptHandler<peripherals::LPUART1>;
});

/// 1 Mbit/s from 80 MHz: 80 time quanta, sampled after 64 (80 %).
const NOMINAL: NominalBitTiming = timing(1, 63, 16);
/// 2 Mbit/s in the data phase of CAN FD: 40 time quanta, sampled after 30 (75 %). All nodes of a bus must agree on it.
const FD: Option<FdTiming> = if cfg!(feature = "can-fd") { Some(fd_timing(1, 29, 10)) } else { None };

#[embassy_executor::task]
async fn node(
    can: FdCan,
    uart: BufferedUart<'static>,
    flash: Flash<'static, flash::Blocking>,
    chip: Chip<Iwdg>,
) {
    static SESSION: StaticCell<SessionOf<Virtual>> = StaticCell::new();
    static LINK: StaticCell<CanNode<FdCan, BufferedUart<'static>>> = StaticCell::new();
    // In the second bank, while the program runs in the first.
    static STORAGE: StaticCell<InFlash<Blocking<Flash<'static, flash::Blocking>>>> = StaticCell::new();
    let link = LINK.init_with(|| CanNode::new(can, Serial::new(uart).with_errors(&line::ERRORS)));
    let storage = STORAGE.init_with(|| InFlash::new(Blocking(flash), region(flash::FLASH_BASE as u32)));
    storage.open().await;
    pin!(app::run(&SESSION, link, storage, Virtual, chip)).await
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
    let uart = BufferedUart::new(chip.LPUART1, chip.PA3, chip.PA2, transmit, receive, Interrupts, config)
        .expect("the bit rate is possible");
    // Not PB8, which the Nucleo's Arduino header calls D15: it is also BOOT0, and a transceiver drives it high.
    let can = CanConfigurator::new(chip.FDCAN1, chip.PA11, chip.PA12, Interrupts);
    let can = FdCan::start(can, NOMINAL, FD);
    let flash = Flash::new_blocking(chip.FLASH);
    let node = node(can, uart, flash, of_node).expect("the task is spawned once");
    EXECUTOR.init(Executor::new()).run(|spawner| spawner.spawn(node))
}

#[panic_handler]
fn panic(info: &PanicInfo) -> ! {
    panic::report(info)
}
