//! The heater of `src/heater.rs` on the emulated board, which has no converter: a simulated block stands
//! behind the same two traits.
//!
//! The block differs from its model, and from node to node. Its time is that of the ticks: a sample lets one
//! period pass, so that a run in lockstep is the same on a slow machine.
#![no_std]
#![no_main]

use core::cell::Cell;
use core::convert::Infallible;
use core::panic::PanicInfo;
use core::pin::pin;

use cortex_m_rt::entry;
use critical_section::Mutex;
use defmt_semihosting as _;
use embedded_hal::pwm::{ErrorType, SetDutyCycle};
use firmware::app::{self, Chip, SessionOf};
use firmware::executor::Executor;
use firmware::heater::{self, Block, FULL, SENSOR};
use firmware::mps2::{
    time,
    uart::{UART_0, Uart},
};
use firmware::panic;
use funnelnet_app::link::serial::Serial;
use funnelnet_app::storage::Absent;
use funnelnet_node::Model;
use funnelnet_plant::{Sampled, Source};
use funnelnet_protocol::NodeConfig;
use funnelnet_protocol::config::ConfigError;
use static_cell::StaticCell;

/// What hardware would run at; the emulator doesn't wait for bits.
const BIT_RATE: u32 = 1_000_000;
/// Largest duty cycle.
const DUTY: u16 = 999;
/// Steps of the simulation per tick.
const STEPS: u16 = 10;

/// The simulated block.
#[derive(Clone, Copy)]
struct Simulated {
    /// Degrees C.
    celsius: f32,
    /// Fraction of full drive.
    drive: f32,
    /// K/s at full drive.
    full: f32,
    /// 1/s.
    loss: f32,
    /// Degrees C.
    room: f32,
    /// Tick period, s.
    tick: f32,
}

impl Simulated {
    /// The one of node `id`: every node has a heater, losses and a room of its own.
    fn of_node(id: u8, tick: f32) -> Self {
        let which = f32::from(id % 3);
        Self {
            celsius: 18.0 + 6.0 * which,
            drive: 0.0,
            full: FULL * (0.9 + 0.1 * which),
            loss: 0.014 - 0.004 * which,
            room: 15.0 + 5.0 * which,
            tick,
        }
    }

    fn after_a_tick(self) -> Self {
        let step = self.tick / f32::from(STEPS);
        let euler = |x: f32, _| x + step * (self.full * self.drive - self.loss * (x - self.room));
        Self { celsius: (0..STEPS).fold(self.celsius, euler), ..self }
    }
}

static BLOCK: Mutex<Cell<Option<Simulated>>> = Mutex::new(Cell::new(None));

/// Changes the block, once there is one, and gives it.
fn change(change: impl FnOnce(Simulated) -> Simulated) -> Option<Simulated> {
    critical_section::with(|token| {
        let block = BLOCK.borrow(token);
        block.set(block.get().map(change));
        block.get()
    })
}

/// The model of `src/heater.rs`; besides, it puts the block where the configuration says that it is.
#[derive(Clone, Copy)]
struct Placed;

impl Model for Placed {
    type Field = Block;

    fn field(&self, config: &NodeConfig, tick: f64) -> Result<Block, ConfigError> {
        let block = Simulated::of_node(config.id, tick as f32);
        critical_section::with(|token| BLOCK.borrow(token).set(Some(block)));
        heater::MODEL.field(config, tick)
    }
}

/// The converter at the block's sensor.
struct Converter;

impl Source for Converter {
    type Error = ();

    fn counts(&mut self) -> Result<i32, ()> {
        let block = change(Simulated::after_a_tick).ok_or(())?;
        Ok(((block.celsius - SENSOR.zero) / SENSOR.per_count) as i32)
    }
}

/// The pin of the block's heater.
struct Pin;

impl ErrorType for Pin {
    type Error = Infallible;
}

impl SetDutyCycle for Pin {
    fn max_duty_cycle(&self) -> u16 {
        DUTY
    }

    fn set_duty_cycle(&mut self, duty: u16) -> Result<(), Infallible> {
        change(|block| Simulated { drive: f32::from(duty) / f32::from(DUTY), ..block });
        Ok(())
    }
}

#[embassy_executor::task]
async fn node(uart: Uart) {
    static SESSION: StaticCell<SessionOf<Sampled<Converter, Pin, Placed>>> = StaticCell::new();
    static LINK: StaticCell<Serial<Uart>> = StaticCell::new();
    let plant = heater::plant(Converter, Pin, Placed);
    pin!(app::run(&SESSION, LINK.init_with(|| Serial::new(uart)), &mut Absent, plant, Chip::UNKNOWN)).await
}

#[entry]
#[allow(clippy::expect_used)] // Once, at the start, where nothing else could be done about it.
fn main() -> ! {
    static EXECUTOR: StaticCell<Executor> = StaticCell::new();
    time::start();
    let link = Uart::take(UART_0, BIT_RATE).expect("nobody else takes the UART");
    let node = node(link).expect("the task is spawned once");
    EXECUTOR.init(Executor::new()).run(|spawner| spawner.spawn(node))
}

#[panic_handler]
fn panic(info: &PanicInfo) -> ! {
    panic::report(info)
}
