//! The vector field of a node in a simulation: the scenario's, or one that its user has written.

use crate::engine::{SimField, params_as};
use crate::scenario::{Hosted, NodeSpec};
use funnelnet_law::field::{State, VectorField};
use funnelnet_node::Params;
use funnelnet_protocol::NodeConfig;
use funnelnet_protocol::config::ConfigError;
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

/// A field of the host's as a node evaluates it: time and state widen to f64, and its rate narrows to f32.
struct Narrowed {
    hosted: Hosted,
    tick_ns: u64,
}

impl VectorField<f32> for Narrowed {
    fn at(&self, half_ticks: u64, x: f32) -> f32 {
        self.component(half_ticks, &[x], 0)
    }

    fn component(&self, half_ticks: u64, x: &[f32], index: usize) -> f32 {
        let t = half_ticks.saturating_mul(self.tick_ns) as f64 / 2e9;
        let wide: State<f64> = x.iter().map(|&x| f64::from(x)).collect();
        self.hosted.component(index, t, &wide) as f32
    }
}

/// Parameters of a node with the field that its scenario says, be it that of the program around the simulation.
///
/// # Errors
/// As a real node refuses its configuration.
pub fn node_params(config: &NodeConfig, spec: &NodeSpec) -> Result<Params<f32, NodeField>, ConfigError> {
    let Some(hosted) = spec.dynamics.hosted() else {
        return params_as(config, spec, |field| NodeField::Configured(Box::new(field)));
    };
    let field = Narrowed { hosted: hosted.clone(), tick_ns: config.tick_ns.into() };
    Params::with_field(config, |_| Ok(NodeField::Own(Arc::new(field))))
}
