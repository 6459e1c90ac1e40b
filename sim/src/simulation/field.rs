//! The vector field of a node in a simulation: the scenario's, or one that its user has written.

use crate::engine::SimField;
use funnelnet_law::field::VectorField;
use std::sync::Arc;

/// A vector field of any kind.
#[derive(Clone)]
pub enum NodeField {
    /// As the scenario says.
    Configured(Box<SimField>),
    /// Of the user's own.
    Own(Arc<dyn VectorField<f32>>),
}

impl VectorField<f32> for NodeField {
    fn at(&self, half_ticks: u64, x: f32) -> f32 {
        match self {
            Self::Configured(field) => field.at(half_ticks, x),
            Self::Own(field) => field.at(half_ticks, x),
        }
    }

    fn component(&self, half_ticks: u64, x: &[f32], index: usize) -> f32 {
        match self {
            Self::Configured(field) => field.component(half_ticks, x, index),
            Self::Own(field) => field.component(half_ticks, x, index),
        }
    }
}
