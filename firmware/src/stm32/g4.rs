//! What STM32G4 chips share on Nucleo boards: clocks from a crystal of 24 MHz, the bit timing that is made of them, and flash.

use embassy_stm32::can::CanConfigurator;
use embassy_stm32::can::config::NominalBitTiming;
use embassy_stm32::flash::{self, FLASH_BASE};
use embassy_stm32::rcc::{
    AHBPrescaler, APBPrescaler, Hse, HseMode, Pll, PllMul, PllPreDiv, PllQDiv, PllRDiv, PllSource, Sysclk,
    mux,
};
use embassy_stm32::time::Hertz;
use embassy_stm32::usart::BufferedUart;
use embassy_stm32::{Config, Peri, pac, peripherals};

use super::fdcan::{FdCan, FdTiming, fd_timing, timing};
use super::safety::Iwdg;
use crate::board::{OnCan, Parts};
use crate::storage::flash::{Blocking, OnFlash};

/// 1 Mbit/s from 80 MHz: 80 time quanta, sampled after 64 (80 %).
const NOMINAL: NominalBitTiming = timing(1, 63, 16);
/// 2 Mbit/s in the data phase of CAN FD: 40 time quanta, sampled after 30 (75 %). All nodes of a bus must agree on it.
const FD: Option<FdTiming> = if cfg!(feature = "can-fd") { Some(fd_timing(1, 29, 10)) } else { None };

/// The storage of these chips.
pub type Storage = OnFlash<Blocking<flash::Flash<'static, flash::Blocking>>>;
/// A node with its states on CAN.
pub type Node = Parts<OnCan<FdCan, BufferedUart<'static>>, Storage, Iwdg>;

/// 160 MHz, and 80 MHz for FDCAN, both from the crystal (24 MHz): the RC oscillator is too inaccurate for CAN.
pub fn clocks() -> Config {
    let mut config = Config::default();
    config.rcc.hse = Some(Hse { freq: Hertz(24_000_000), mode: HseMode::Oscillator });
    config.rcc.pll = Some(Pll {
        source: PllSource::HSE,
        prediv: PllPreDiv::DIV6,
        mul: PllMul::MUL80,
        divp: None,
        divq: Some(PllQDiv::DIV4),
        divr: Some(PllRDiv::DIV2),
    });
    config.rcc.sys = Sysclk::PLL1_R;
    config.rcc.boost = true; // above 150 MHz
    (config.rcc.ahb_pre, config.rcc.apb1_pre, config.rcc.apb2_pre) =
        (AHBPrescaler::DIV1, APBPrescaler::DIV1, APBPrescaler::DIV1);
    config.rcc.mux.fdcansel = mux::Fdcansel::PLL1_Q;
    config
}

/// Readings of a register to wait for the crystal at most: 10 ms or more, five times what its data sheet says. The watchdog bites after 0.5 s.
const LONGEST_WAIT: u32 = 20_000;

/// Whether the crystal starts; it stays on. Before `embassy_stm32::init`, which waits for it without limit.
pub fn has_crystal() -> bool {
    pac::RCC.cr().modify(|reg| reg.set_hseon(true));
    (0..LONGEST_WAIT).any(|_| pac::RCC.cr().read().hserdy())
}

/// 16 MHz from the RC oscillator, for a board whose crystal is missing: for a look at the rest of it, not for a node.
pub fn clocks_without_crystal() -> Config {
    let mut config = Config::default();
    config.rcc.mux.fdcansel = mux::Fdcansel::PCLK1;
    config
}

/// FDCAN 1, which hears itself alone.
pub fn looped_can(configurator: CanConfigurator<'static>) -> FdCan {
    FdCan::start_looped(configurator, NOMINAL)
}

/// FDCAN 1 at 1 Mbit/s, with [`clocks`].
pub fn can(configurator: CanConfigurator<'static>) -> FdCan {
    FdCan::start(configurator, NOMINAL, FD)
}

/// The end of flash. Where there are two banks it is in the second, while the program runs in the first.
pub fn storage(flash: Peri<'static, peripherals::FLASH>) -> Storage {
    OnFlash::new(Blocking(flash::Flash::new_blocking(flash)), FLASH_BASE as u32)
}
