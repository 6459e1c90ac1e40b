//! What STM32F4 chips share on Nucleo boards: clocks from the ST-LINK's 8 MHz, the bit timing that is made of them, and flash.

use embassy_stm32::can::Can;
use embassy_stm32::can::util::NominalBitTiming;
use embassy_stm32::flash::FLASH_BASE;
use embassy_stm32::rcc::{
    AHBPrescaler, APBPrescaler, Hse, HseMode, Pll, PllMul, PllPDiv, PllPreDiv, PllSource, Sysclk,
};
use embassy_stm32::time::Hertz;
use embassy_stm32::usart::BufferedUart;
use embassy_stm32::{Config, Peri, Peripherals, peripherals};
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
    let chip = embassy_stm32::init(clocks());
    use_caches();
    stalls::begin();
    chip
}

/// CAN 1 at 1 Mbit/s, with [`clocks`].
pub fn can(can: Can<'static>) -> BxCan {
    BxCan::start(can, TIMING)
}

/// The small sectors at the beginning of flash.
pub fn storage(flash: Peri<'static, peripherals::FLASH>) -> Storage {
    OnFlash::new(Split(Blocking(Sectors::new(flash))), FLASH_BASE as u32)
}
