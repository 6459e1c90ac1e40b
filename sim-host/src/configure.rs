//! From a scenario to what each node is told: SI and f64 to SI and f32, the form that travels.

use crate::scenario::{Edge, FunnelSpec, GainSpec, NodeSpec, Scenario};
use funnel_protocol::NodeConfig;
use funnel_protocol::config::{
    EdgeConfig, FieldConfig, FunnelConfig, FunnelShape, GainConfig, SineConfig, TickSource,
};
use std::fmt;

/// States beyond this are refused by every node, state units.
const STATE_LIMIT: f32 = 1e9;
/// Ticks for which a silent neighbour is extrapolated (LAW.md 5).
const EXTRAPOLATE_TICKS: u8 = 10;

/// How the nodes of a run are driven.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Drive {
    /// What makes them tick.
    pub tick_source: TickSource,
    /// Ticks between telemetry frames; 0 is none.
    pub telemetry_every: u32,
}

/// A scenario asks for more than a node can be told.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct TooMuch {
    /// Id of the node.
    pub node: u8,
    /// What there is too much of.
    pub what: &'static str,
    /// Most that a node takes.
    pub limit: usize,
}

impl fmt::Display for TooMuch {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "node {}: too many {}; a node takes at most {}", self.node, self.what, self.limit)
    }
}

impl std::error::Error for TooMuch {}

/// One configuration per node, by index.
///
/// # Errors
/// A node has more sinusoids or neighbours, or a longer tick, than a configuration has room for.
pub fn node_configs(scenario: &Scenario, drive: Drive) -> Result<Vec<NodeConfig>, TooMuch> {
    let tick_ns = u32::try_from(scenario.time.tick_ns).map_err(|_| TooMuch {
        node: 1,
        what: "nanoseconds in a tick",
        limit: u32::MAX as usize,
    })?;
    let config = |(index, node): (usize, &NodeSpec)| {
        let too_much = |what, limit| TooMuch { node: node.id, what, limit };
        let sines = node.dynamics.sines.iter().map(|sine| SineConfig {
            amplitude: sine.amplitude as f32,
            frequency: sine.frequency,
            phase: sine.phase,
        });
        let edges = scenario.graph.edges.iter().filter_map(|edge| seen_from(index, edge));
        Ok(NodeConfig {
            id: node.id,
            tick_ns,
            tick_source: drive.tick_source,
            initial_state: node.state[0] as f32,
            state_limit: STATE_LIMIT,
            field: FieldConfig {
                slope: node.dynamics.slope() as f32,
                offset: node.dynamics.offset() as f32,
                sines: collect(sines).ok_or(too_much("sinusoids", funnel_protocol::config::MAX_SINES))?,
            },
            gain: gain(&node.gain).ok_or(too_much("kinds of gain: this one", 0))?,
            funnel: funnel(&node.funnel).ok_or(too_much("kinds of funnel: this one", 0))?,
            neighbours: collect(edges)
                .ok_or(too_much("neighbours", funnel_protocol::config::MAX_NEIGHBOURS))?,
            extrapolate_ticks: EXTRAPOLATE_TICKS,
            telemetry_every: drive.telemetry_every,
        })
    };
    scenario.nodes.iter().enumerate().map(config).collect()
}

/// Who accepts the frames of each node, by index: its neighbours.
pub fn listeners(scenario: &Scenario) -> Vec<Vec<usize>> {
    let mut listeners = vec![Vec::new(); scenario.nodes.len()];
    for edge in &scenario.graph.edges {
        for (from, to) in [(edge.a, edge.b), (edge.b, edge.a)] {
            if let Some(list) = listeners.get_mut(from) {
                list.push(to);
            }
        }
    }
    for list in &mut listeners {
        list.sort_unstable();
    }
    listeners
}

fn seen_from(index: usize, edge: &Edge) -> Option<EdgeConfig> {
    let other = match index {
        _ if index == edge.a => edge.b,
        _ if index == edge.b => edge.a,
        _ => return None,
    };
    Some(EdgeConfig { id: u8::try_from(other + 1).ok()?, weight: edge.weight as f32 })
}

fn collect<T, const N: usize>(items: impl Iterator<Item = T>) -> Option<heapless::Vec<T, N>> {
    let mut collected = heapless::Vec::new();
    for item in items {
        collected.push(item).ok()?;
    }
    Some(collected)
}

/// The gain as it travels; `None` for the kinds that no node runs yet (the scenario reader refuses them first).
fn gain(gain: &GainSpec) -> Option<GainConfig> {
    match *gain {
        GainSpec::Reciprocal { scale } => Some(GainConfig::Reciprocal { scale: scale as f32 }),
        GainSpec::Logarithmic { scale } => Some(GainConfig::Logarithmic { scale: scale as f32 }),
        GainSpec::LocallyLinear { bound } => Some(GainConfig::LocallyLinear { bound: bound as f32 }),
        GainSpec::Median { eta, eps } => Some(GainConfig::Median { eta: eta as f32, eps: eps as f32 }),
        GainSpec::Linear { .. } => None,
    }
}

/// The funnel as it travels; `None` for the kinds that no node runs yet (the scenario reader refuses them first).
fn funnel(funnel: &FunnelSpec) -> Option<FunnelConfig> {
    match *funnel {
        FunnelSpec::Exponential { start, end, rate, factor } => {
            let [start, end, rate] = [start, end, rate].map(|value| value as f32);
            Some(FunnelConfig { factor: factor as f32, shape: FunnelShape::Exponential { start, end, rate } })
        }
        FunnelSpec::Constant { width, factor } => {
            Some(FunnelConfig { factor: factor as f32, shape: FunnelShape::Constant { width: width as f32 } })
        }
        FunnelSpec::ReciprocalTime { scale, factor } => Some(FunnelConfig {
            factor: factor as f32,
            shape: FunnelShape::ReciprocalTime { scale: scale as f32 },
        }),
        FunnelSpec::Schedule { .. } => None,
        FunnelSpec::FiniteTime { start, at_ns, power, factor } => Some(FunnelConfig {
            factor: factor as f32,
            shape: FunnelShape::FiniteTime { start: start as f32, at_ns, power: power as f32 },
        }),
    }
}
