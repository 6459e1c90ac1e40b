//! A heater on a Nucleo-G474RE: sensor on PA0 (ADC 1), heater's transistor on PA6 (PWM of TIM 3), states on CAN as on `nucleo_g474re`, LPUART 1 on the
//! virtual COM port, the log by RTT. Its plant is `src/heater.rs`. docs/book/src/your-own-node.md
#![no_std]
#![no_main]

use core::convert::Infallible;
use core::panic::PanicInfo;
use core::pin::pin;

use cortex_m_rt::entry;
use embassy_stm32::adc::{Adc, AdcConfig, SampleTime};
use embassy_stm32::can::{CanConfigurator, IT0InterruptHandler, IT1InterruptHandler};
use embassy_stm32::gpio::OutputType;
use embassy_stm32::pac::gpio::vals::Moder;
use embassy_stm32::peripherals::{ADC1, FDCAN1, LPUART1, PA0, PA6, TIM3};
use embassy_stm32::rcc::mux::Adcsel;
use embassy_stm32::time::Hertz;
use embassy_stm32::timer::simple_pwm::{PwmPin, SimplePwm, SimplePwmChannel};
use embassy_stm32::usart::{self, BufferedUart};
use embassy_stm32::{Peri, bind_interrupts, pac};
use embedded_hal::pwm::{ErrorType, SetDutyCycle};
use firmware::app::{self, Chip, SessionOf};
use firmware::board::{Lines, OnCan, host_buffers};
use firmware::executor::Executor;
use firmware::heater::{self, Block};
use firmware::panic;
use firmware::stm32::fdcan::{FdCan, TakeFrames};
use firmware::stm32::line::{CountErrors, ERRORS, opened, service_plane};
use firmware::stm32::safety::Iwdg;
use firmware::stm32::{g4, safety};
use funnelnet_app::link::can::CanNode;
use funnelnet_app::storage::Absent;
use funnelnet_node::Fixed;
use funnelnet_plant::{Sampled, Source};
use static_cell::StaticCell;

bind_interrupts!(struct Interrupts {
    FDCAN1_IT0 => IT0InterruptHandler<FDCAN1>, TakeFrames;
    FDCAN1_IT1 => IT1InterruptHandler<FDCAN1>;
    LPUART1 => CountErrors, usart::BufferedInterruptHandler<LPUART1>;
});

/// The heater's pin, PA6.
const HEATER: usize = 6;
/// Of the heater's PWM.
const PWM: Hertz = Hertz(1_000);
/// Of a sample: 6.2 us at 40 MHz, for a sensor that is not a stiff source.
const SAMPLE: SampleTime = SampleTime::CYCLES247_5;

/// The chip's converter, one channel of it. It gives counts of 12 bits, as the Pico's does.
struct Converter {
    adc: Adc<'static, ADC1>,
    sensor: Peri<'static, PA0>,
}

impl Source for Converter {
    type Error = Infallible;

    fn counts(&mut self) -> Result<i32, Infallible> {
        Ok(self.adc.blocking_read(&mut self.sensor, SAMPLE).into())
    }
}

/// Channel 1 of TIM 3. embassy sets it up; its own setter can panic, and a node must not.
struct Duty {
    /// Its drop would give the pin back.
    _channel: SimplePwmChannel<'static, TIM3>,
    full: u16,
}

impl Duty {
    fn new(timer: Peri<'static, TIM3>, heater: Peri<'static, PA6>) -> Self {
        let pin = PwmPin::new(heater, OutputType::PushPull);
        let pwm = SimplePwm::new(timer, Some(pin), None, None, None, PWM, Default::default());
        let mut channel = pwm.split().ch1;
        channel.enable();
        Self { full: u16::try_from(channel.max_duty_cycle()).unwrap_or(u16::MAX), _channel: channel }
    }
}

impl ErrorType for Duty {
    type Error = Infallible;
}

impl SetDutyCycle for Duty {
    fn max_duty_cycle(&self) -> u16 {
        self.full
    }

    fn set_duty_cycle(&mut self, duty: u16) -> Result<(), Infallible> {
        pac::TIM3.ccr(0).write(|reg| reg.set_ccr(duty.min(self.full)));
        Ok(())
    }
}

type Plant = Sampled<Converter, Duty, Fixed<Block>>;
type OnBoard = OnCan<FdCan, BufferedUart<'static>>;

#[embassy_executor::task]
async fn node(lines: OnBoard, converter: Converter, duty: Duty, chip: Chip<Iwdg>) {
    static SESSION: StaticCell<SessionOf<Plant>> = StaticCell::new();
    static LINK: StaticCell<CanNode<FdCan, BufferedUart<'static>>> = StaticCell::new();
    let plant = heater::plant(converter, duty, heater::MODEL);
    pin!(app::run(&SESSION, lines.link(&LINK), &mut Absent, plant, chip)).await
}

/// The pin low, whatever the timer does.
fn heater_off() {
    pac::GPIOA.bsrr().write(|reg| reg.set_br(HEATER, true));
    pac::GPIOA.moder().modify(|reg| reg.set_moder(HEATER, Moder::OUTPUT));
}

#[entry]
#[allow(clippy::expect_used)] // Once, at the start, where nothing else could be done about it.
fn main() -> ! {
    static EXECUTOR: StaticCell<Executor> = StaticCell::new();
    safety::watch_the_start();
    let mut clocks = g4::clocks();
    clocks.rcc.mux.adc12sel = Adcsel::SYS;
    let board = embassy_stm32::init(clocks);
    panic::on_defect(heater_off);
    let of_node = safety::begin(board.IWDG);
    let (transmit, receive) = host_buffers();
    let config = service_plane();
    let uart = BufferedUart::new(board.LPUART1, board.PA3, board.PA2, transmit, receive, Interrupts, config);
    let can = g4::can(CanConfigurator::new(board.FDCAN1, board.PA11, board.PA12, Interrupts));
    let lines = OnCan { can, service: opened(uart), errors: &ERRORS };
    let converter = Converter { adc: Adc::new(board.ADC1, AdcConfig::default()), sensor: board.PA0 };
    let duty = Duty::new(board.TIM3, board.PA6);
    let node = node(lines, converter, duty, of_node).expect("the task is spawned once");
    EXECUTOR.init(Executor::new()).run(|spawner| spawner.spawn(node))
}

#[panic_handler]
fn panic(info: &PanicInfo) -> ! {
    panic::report(info)
}
