//! A heater on a Raspberry Pi Pico: sensor on GP26 (ADC 0), heater's transistor on GP20 (PWM 2A), UART 0 on
//! GP0/GP1, the log by RTT. Its plant is `src/heater.rs`. docs/book/src/your-own-node.md
#![no_std]
#![no_main]

use core::panic::PanicInfo;
use core::pin::pin;

use cortex_m_rt::entry;
use defmt_rtt as _;
use embassy_rp::adc::{self, Adc, Channel};
use embassy_rp::gpio::Pull;
use embassy_rp::pwm::{self, Pwm};
use embassy_rp::uart::{self, BufferedUart};
use embassy_rp::{bind_interrupts, peripherals};
use firmware::app::{self, Chip, SessionOf};
use firmware::executor::Executor;
use firmware::heater::{self, Block};
use firmware::panic;
use firmware::rp::{self, Timer};
use funnelnet_app::link::serial::Serial;
use funnelnet_app::storage::Absent;
use funnelnet_node::Fixed;
use funnelnet_plant::{Sampled, Source};
use static_cell::{ConstStaticCell, StaticCell};

bind_interrupts!(struct Interrupts {
    UART0_IRQ => uart::BufferedInterruptHandler<peripherals::UART0>;
});

/// The heater's pin, GP20.
const HEATER: usize = 20;
/// The heater's 1 kHz: 125 MHz / 5 / 25,000.
const PWM: (u8, u16) = (5, 24_999);

/// The Pico's converter, one channel of it.
struct Converter {
    adc: Adc<'static, adc::Blocking>,
    channel: Channel<'static>,
}

impl Source for Converter {
    type Error = adc::Error;

    fn counts(&mut self) -> Result<i32, adc::Error> {
        self.adc.blocking_read(&mut self.channel).map(i32::from)
    }
}

type Plant = Sampled<Converter, Pwm<'static>, Fixed<Block>>;

#[embassy_executor::task]
async fn node(uart: BufferedUart, converter: Converter, pwm: Pwm<'static>, chip: Chip<Timer>) {
    static SESSION: StaticCell<SessionOf<Plant>> = StaticCell::new();
    static LINK: StaticCell<Serial<BufferedUart>> = StaticCell::new();
    let plant = heater::plant(converter, pwm, heater::MODEL);
    pin!(app::run(&SESSION, LINK.init_with(|| Serial::new(uart)), &mut Absent, plant, chip)).await
}

/// The pin low, whatever the PWM does: its function back to a disabled one, its pull-down as after a reset.
fn heater_off() {
    use embassy_rp::pac::{IO_BANK0, PADS_BANK0};
    PADS_BANK0.gpio(HEATER).modify(|pad| {
        pad.set_od(true);
        pad.set_pde(true);
    });
    IO_BANK0.gpio(HEATER).ctrl().modify(|control| control.set_funcsel(0x1F));
}

#[entry]
#[allow(clippy::expect_used)] // Once, at the start, where nothing else could be done about it.
fn main() -> ! {
    static EXECUTOR: StaticCell<Executor> = StaticCell::new();
    static TRANSMIT: ConstStaticCell<[u8; 512]> = ConstStaticCell::new([0; 512]);
    static RECEIVE: ConstStaticCell<[u8; 2048]> = ConstStaticCell::new([0; 2048]);
    let chip = embassy_rp::init(Default::default());
    panic::on_defect(heater_off);
    // Its storage is not used.
    let (of_node, _) = rp::begin(chip.FLASH, chip.WATCHDOG);
    let (transmit, receive) = (TRANSMIT.take(), RECEIVE.take());
    let uart =
        BufferedUart::new(chip.UART0, chip.PIN_0, chip.PIN_1, Interrupts, transmit, receive, rp::line());
    rp::pull_up(rp::HOST_RX);
    let adc = Adc::new_blocking(chip.ADC, adc::Config::default());
    let converter = Converter { adc, channel: Channel::new_pin(chip.PIN_26, Pull::None) };
    let mut config = pwm::Config::default();
    (config.divider, config.top) = (PWM.0.into(), PWM.1);
    let pwm = Pwm::new_output_a(chip.PWM_SLICE2, chip.PIN_20, config);
    let node = node(uart, converter, pwm, of_node).expect("the task is spawned once");
    EXECUTOR.init(Executor::new()).run(|spawner| spawner.spawn(node))
}

#[panic_handler]
fn panic(info: &PanicInfo) -> ! {
    panic::report(info)
}
