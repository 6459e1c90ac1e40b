//! A plant with a converter and an actuator for every component of its state.

use crate::actuator::{Actuator, Sink};
use crate::failure::Failure;
use crate::sensor::{Sensor, Source};
use crate::{Model, Plant};
use funnelnet_law::field::State;
use funnelnet_node::PlantSetup;
use funnelnet_protocol::NodeConfig;
use funnelnet_protocol::config::ConfigError;

/// A plant with `N` (1 to 8) components, each with a sensor and an actuator of its own.
#[derive(Debug)]
pub struct Sampled<S, A, M, const N: usize = 1> {
    sensors: [Sensor<S>; N],
    actuators: [Actuator<A>; N],
    model: M,
    coast_ticks: u32,
}

impl<S: Source, A: Sink, M: Model + Clone, const N: usize> Sampled<S, A, M, N> {
    /// A plant whose next state `model` predicts: the configuration's field (`funnelnet_node::Configured`),
    /// or one of the user's own. Up to `coast_ticks` samples in a row may fail before the node stops.
    pub fn new(sensors: [Sensor<S>; N], actuators: [Actuator<A>; N], model: M, coast_ticks: u32) -> Self {
        const { assert!(N >= 1 && N <= 8, "a state has 1 to 8 components") };
        Self { sensors, actuators, model, coast_ticks }
    }
}

impl<S: Source, A: Sink, M: Model + Clone, const N: usize> Plant for Sampled<S, A, M, N> {
    type Model = WithPlant<M>;

    fn model(&self) -> WithPlant<M> {
        let inputs = self.actuators.iter().map(Actuator::range);
        WithPlant { model: self.model.clone(), plant: PlantSetup::new(inputs, self.coast_ticks) }
    }

    fn measure(&mut self) -> Result<State<f32>, Failure> {
        let mut state = State::new();
        for (sensor, component) in self.sensors.iter_mut().zip(0..) {
            let x = sensor.read(component)?;
            state.push(x).map_err(|_| Failure::Components)?;
        }
        Ok(state)
    }

    fn actuate(&mut self, u: &[f32]) -> Result<(), Failure> {
        if u.len() != N {
            return Err(Failure::Components);
        }
        let mut driven = self.actuators.iter_mut().zip(u).zip(0..);
        driven.try_for_each(|((actuator, &u), component)| actuator.drive(component, u))
    }

    fn safe(&mut self) -> Result<(), Failure> {
        let safe = self.actuators.iter_mut().zip(0..).map(|(actuator, component)| actuator.safe(component));
        // All of them, also after one that refuses.
        safe.fold(Ok(()), Result::and)
    }
}

/// A model's field, with what there is to know of a plant.
#[derive(Clone, Debug)]
pub struct WithPlant<M> {
    model: M,
    plant: PlantSetup,
}

impl<M: Model> Model for WithPlant<M> {
    type Field = M::Field;

    fn field(&self, config: &NodeConfig, tick: f64) -> Result<M::Field, ConfigError> {
        self.model.field(config, tick)
    }

    fn plant(&self) -> Option<PlantSetup> {
        Some(self.plant.clone())
    }
}
