//! What STM32F4 chips share on Nucleo boards: clocks from the ST-LINK's 8 MHz, the bit timing that is made of them, and flash.

use embassy_stm32::can::Can;
use embassy_stm32::can::util::NominalBitTiming;
use embassy_stm32::flash::FLASH_BASE;
use embassy_stm32::rcc::{
    AHBPrescaler, APBPrescaler, Hse, HseMode, Pll, PllMul, PllPDiv, PllPreDiv, PllSource, Sysclk,
};
use embassy_stm32::time::Hertz;
use embassy_stm32::usart::BufferedUart;
use embassy_stm32::{Config, Peri, Peripherals, pac, peripherals};
use funnelnet_store::split::Split;

use super::bxcan::{BxCan, timing};
use super::safety::Iwdg;
use super::sectors::{Sectors, use_caches};
use super::stalls;
use crate::board::{OnCan, Parts};
use crate::storage::flash::{Blocking, OnFlash};

/// 1 Mbit/s from 40 MHz: 20 time quanta of 2 periods, sampled after 16 (80 %).
const TIMING: NominalBitTiming = timing(2, 15, 4);

/// The storage of these chips: two sectors, a half of the store each.
pub type Storage = OnFlash<Split<Blocking<Sectors>, 2>>;
/// A node with its states on CAN.
pub type Node = Parts<OnCan<BxCan, BufferedUart<'static>>, Storage, Iwdg>;

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

/// The chip with [`clocks`], its flash read through caches, and what keeps its time right over an erase. Called once.
pub fn begin() -> Peripherals {
    begin_with(clocks())
}

fn begin_with(clocks: Config) -> Peripherals {
    let chip = embassy_stm32::init(clocks);
    use_caches();
    stalls::begin();
    chip
}

/// Readings of a register to wait for the ST-LINK's clock at most: 10 ms or more. The watchdog bites after 0.5 s.
const LONGEST_WAIT: u32 = 20_000;

/// Whether the ST-LINK gives its clock; it stays on. Before [`begin_check`].
pub fn has_clock() -> bool {
    pac::RCC.cr().modify(|reg| reg.set_hsebyp(true));
    pac::RCC.cr().modify(|reg| reg.set_hseon(true));
    (0..LONGEST_WAIT).any(|_| pac::RCC.cr().read().hserdy())
}

/// As [`begin`]; without that clock with one of the same rate from the RC oscillator: for a look at the rest of the board, not for a node. Called once.
pub fn begin_check(has_clock: bool) -> Peripherals {
    let mut config = clocks();
    if !has_clock {
        config.rcc.hse = None;
        config.rcc.pll_src = PllSource::HSI;
        // Of 16 MHz.
        config.rcc.pll = config.rcc.pll.map(|pll| Pll { prediv: PllPreDiv::DIV8, ..pll });
    }
    begin_with(config)
}

/// CAN 1, which hears itself alone.
pub fn looped_can(can: Can<'static>) -> BxCan {
    BxCan::start_looped(can, TIMING)
}

/// CAN 1 at 1 Mbit/s, with [`clocks`].
pub fn can(can: Can<'static>) -> BxCan {
    BxCan::start(can, TIMING)
}

/// The small sectors at the beginning of flash.
pub fn storage(flash: Peri<'static, peripherals::FLASH>) -> Storage {
    OnFlash::new(Split(Blocking(Sectors::new(flash))), FLASH_BASE as u32)
}
