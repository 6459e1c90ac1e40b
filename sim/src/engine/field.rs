//! The vector field of a simulated node: the one that it is configured with, and the inputs from outside that
//! a real node would not know.

use crate::scenario::{NodeSpec, Series};
use funnelnet_law::field::{Inputs, PreparedField, VectorField};
use funnelnet_node::params::field_with_inputs;
use funnelnet_node::{Node, Params};
use funnelnet_protocol::NodeConfig;
use funnelnet_protocol::config::ConfigError;
use std::sync::Arc;

/// Inputs from outside as a node samples them.
#[derive(Clone, Debug)]
pub struct Outside {
    series: Arc<[Series]>,
    tick_ns: u64,
}

impl Inputs<f32> for Outside {
    fn value(&self, index: usize, half_ticks: u64) -> f32 {
        let t = half_ticks.saturating_mul(self.tick_ns) as f64 / 2e9;
        self.series.get(index).map_or(0.0, |series| series.at(t) as f32)
    }
}

/// The vector field of a simulated node.
pub type SimField = PreparedField<f32, Outside>;
/// A simulated node.
pub type SimNode = Node<f32, SimField>;

/// What a simulated node makes of its configuration.
///
/// # Errors
/// As a real node refuses it.
pub fn params(config: &NodeConfig, spec: &NodeSpec) -> Result<Params<f32, SimField>, ConfigError> {
    params_as(config, spec, |field| field)
}

/// The same where its field is one of several kinds.
///
/// # Errors
/// As a real node refuses it.
pub fn params_as<V: VectorField<f32>>(
    config: &NodeConfig,
    spec: &NodeSpec,
    kind: impl FnOnce(SimField) -> V,
) -> Result<Params<f32, V>, ConfigError> {
    let series: Arc<[Series]> =
        spec.dynamics.expression().map_or_else(|| [].into(), |expression| expression.inputs.clone());
    let count = series.len();
    let outside = Outside { series, tick_ns: config.tick_ns.into() };
    Params::with_field(config, |tick| field_with_inputs(config, tick, count, outside).map(kind))
}
