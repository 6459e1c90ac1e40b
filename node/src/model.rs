//! What a node is beside its configuration: its vector field, and what it has to know of its plant.

use crate::params::{Params, prepared_field};
use crate::plant::PlantSetup;
use funnelnet_law::field::{PreparedField, VectorField};
use funnelnet_protocol::NodeConfig;
use funnelnet_protocol::config::ConfigError;

/// Makes the vector field of a node from its configuration. Users implement it for a field of their own or
/// for a plant.
pub trait Model {
    /// The vector field.
    type Field: VectorField<f32>;

    /// The field for tick period `tick` (s). With a plant it is the model that predicts the plant's next
    /// state without input.
    ///
    /// # Errors
    /// Checks `config.field`; a model that takes nothing from it need not look.
    fn field(&self, config: &NodeConfig, tick: f64) -> Result<Self::Field, ConfigError>;

    /// Facts of the plant; a *virtual* node has none and integrates its field.
    fn plant(&self) -> Option<PlantSetup> {
        None
    }
}

/// The model that the configuration describes, an affine field with sinusoids or an expression, and no plant.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Configured;

impl Model for Configured {
    type Field = PreparedField<f32>;

    fn field(&self, config: &NodeConfig, tick: f64) -> Result<Self::Field, ConfigError> {
        prepared_field(config, tick)
    }
}

/// A field that takes nothing from the configuration, and no plant.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Fixed<V>(pub V);

impl<V: VectorField<f32> + Clone> Model for Fixed<V> {
    type Field = V;

    fn field(&self, _: &NodeConfig, _: f64) -> Result<V, ConfigError> {
        Ok(self.0.clone())
    }
}

impl<V: VectorField<f32>> Params<f32, V> {
    /// Validates `config`, with the field and the plant of `model`.
    ///
    /// # Errors
    /// The first value outside its range, by name, with what is allowed; a plant with another number of
    /// components.
    pub fn of_model<M: Model<Field = V>>(config: &NodeConfig, model: &M) -> Result<Self, ConfigError> {
        let mut params = Self::with_field(config, |tick| model.field(config, tick));
        // In place, since a copy of it is some kilobytes of stack.
        if let (Ok(made), Some(plant)) = (&mut params, model.plant()) {
            made.set_plant(plant)?;
        }
        params
    }
}
