//! Clocks of the Nucleo-G474RE.

use embassy_stm32::Config;
use embassy_stm32::rcc::{
    AHBPrescaler, APBPrescaler, Hse, HseMode, Pll, PllMul, PllPreDiv, PllQDiv, PllRDiv, PllSource, Sysclk,
    mux,
};
use embassy_stm32::time::Hertz;

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
