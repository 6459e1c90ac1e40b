//! Worked example: heaters that agree on a temperature (docs/book/src/your-own-node.md). Copy this file and
//! change it: it is all that a node of your own needs beside the pins in `src/bin/heater.rs` (Pico) or
//! `src/bin/heater_g474.rs` (STM32).
//!
//! A heated block with a sensor of 10 mV/K on a converter of 12 bits, and a heater of 10 W on a duty cycle.
//! The state is the temperature in degrees C, the input is in K/s.

use funnelnet_law::VectorField;
use funnelnet_node::{Fixed, Model};
use funnelnet_plant::{Actuator, ActuatorScale, BadScale, Sampled, Sensor, SensorScale, Sink, Source};

/// What the heater does at full drive: 10 W into 20 J/K, K/s.
pub const FULL: f32 = 0.5;
/// Drive without input. Together with the losses it says where the block ends without its neighbours: at 40
/// degrees C.
pub const AT_ZERO: f32 = 0.4;
/// 0.2 W/K out of 20 J/K, 1/s.
const LOSS: f32 = 0.01;
/// Degrees C.
const ROOM: f32 = 20.0;
/// Samples in a row that may fail: 1 s of ticks of 100 ms.
const COAST_TICKS: u32 = 10;

/// 10 mV/K with 0.5 V at 0 degrees C, of 3.3 V. Below -30 and above 150 degrees C the wire is broken or the
/// sensor shorted.
pub const SENSOR: SensorScale = SensorScale { zero: -50.0, per_count: 330.0 / 4096.0, valid: 248..=2482 };
/// An input of 1 K/s takes `1 / FULL` of full drive. The safe heater is off.
pub const ACTUATOR: ActuatorScale = ActuatorScale { at_zero: AT_ZERO, per_input: 1.0 / FULL, safe: 0.0 };

/// How the block's temperature moves without input. It need not be right: what it predicts, the next sample
/// corrects.
#[derive(Clone, Copy, Debug, Default)]
pub struct Block;

impl VectorField<f32> for Block {
    fn at(&self, _: u64, celsius: f32) -> f32 {
        FULL * AT_ZERO - LOSS * (celsius - ROOM)
    }
}

/// The model of the block, for [`plant`].
pub const MODEL: Fixed<Block> = Fixed(Block);

/// The block, measured by `source` and heated by `sink`.
///
/// # Panics
/// A scale above cannot be; the log names it. Once, at the start.
pub fn plant<S: Source, A: Sink, M: Model + Clone>(source: S, sink: A, model: M) -> Sampled<S, A, M> {
    let sensor = Sensor::new(source, SENSOR).unwrap_or_else(refuse);
    let actuator = Actuator::new(sink, ACTUATOR).unwrap_or_else(refuse);
    Sampled::new([sensor], [actuator], model, COAST_TICKS)
}

#[allow(clippy::panic)] // Nothing else could be done about it.
fn refuse<T>(bad: BadScale) -> T {
    defmt::panic!("{}", bad)
}
