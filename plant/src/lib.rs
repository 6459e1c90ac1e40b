//! What a node measures and drives: its plant.
//!
//! The core says when (`funnelnet_node::Output`), a [`Plant`] does it. [`Virtual`] is the node that
//! integrates its field and owns no pin; [`Sampled`] reads a converter and drives a duty cycle or a DAC, in
//! SI units. Whoever needs more implements [`Plant`].
#![no_std]
#![forbid(unsafe_code)]

mod actuator;
mod failure;
mod sampled;
mod sensor;

pub use actuator::{Actuator, ActuatorScale, Sink};
pub use failure::{BadScale, Failure};
pub use sampled::{Sampled, WithPlant};
pub use sensor::{Sensor, SensorScale, Source};

use funnelnet_law::field::State;
use funnelnet_node::{Configured, Model};

/// The plant of a node, as its app sees it. Nothing here waits: a sensor that takes longer than a small part
/// of a tick is read by a task of its own, and [`Plant::measure`] gives its latest value.
pub trait Plant {
    /// The plant's model.
    type Model: Model;

    /// What the core has to know: the field that predicts the plant, the limits of its actuators, and how
    /// long it may be blind.
    fn model(&self) -> Self::Model;

    /// The state of the plant now, state units, one value per component.
    ///
    /// # Errors
    /// Why there is none; the node then goes on with its prediction for a while.
    fn measure(&mut self) -> Result<State<f32>, Failure>;

    /// Drives the actuators with `u`, state units / s, one value per component, within the limits of the
    /// model.
    ///
    /// # Errors
    /// What has failed; the node then stops.
    fn actuate(&mut self, u: &[f32]) -> Result<(), Failure>;

    /// Puts the actuators in their safe position: at the start of the program, and whenever the node stops.
    ///
    /// # Errors
    /// What has failed; all the others are safe nevertheless.
    fn safe(&mut self) -> Result<(), Failure>;
}

/// No plant: the node integrates the field of its configuration.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Virtual;

impl Plant for Virtual {
    type Model = Configured;

    fn model(&self) -> Configured {
        Configured
    }

    /// Never asked for.
    fn measure(&mut self) -> Result<State<f32>, Failure> {
        Err(Failure::Components)
    }

    fn actuate(&mut self, _: &[f32]) -> Result<(), Failure> {
        Ok(())
    }

    fn safe(&mut self) -> Result<(), Failure> {
        Ok(())
    }
}
