//! A plant whose sensor does not come back.

use funnelnet_law::PreparedField;
use funnelnet_law::field::State;
use funnelnet_node::{Configured, InputRange, Model, PlantSetup};
use funnelnet_plant::Failure;
use funnelnet_protocol::NodeConfig;
use funnelnet_protocol::config::ConfigError;

/// Samples that it gives before.
const SAMPLES: u32 = 5;

/// The field of the configuration, and an actuator.
pub struct Driven;

impl Model for Driven {
    type Field = PreparedField<f32>;

    fn field(&self, config: &NodeConfig, tick: f64) -> Result<Self::Field, ConfigError> {
        Configured.field(config, tick)
    }

    fn plant(&self) -> Option<PlantSetup> {
        Some(PlantSetup::new(InputRange::new(-1.0, 1.0), 0))
    }
}

/// It is at 1.0, until its sensor gets stuck.
#[derive(Default)]
pub struct Plant {
    samples: u32,
}

impl funnelnet_plant::Plant for Plant {
    type Model = Driven;

    fn model(&self) -> Driven {
        Driven
    }

    fn measure(&mut self) -> Result<State<f32>, Failure> {
        self.samples += 1;
        if self.samples > SAMPLES {
            loop {
                cortex_m::asm::nop();
            }
        }
        Ok([1.0].into_iter().collect())
    }

    fn actuate(&mut self, _: &[f32]) -> Result<(), Failure> {
        Ok(())
    }

    fn safe(&mut self) -> Result<(), Failure> {
        Ok(())
    }
}
