//! From a scenario to what each node is told: SI and f64 to SI and f32, the form that travels.

use crate::scenario::{
    Affine, BreachSpec, CouplingKind, Edge, FunnelSpec, GainSpec, LARGEST_RUN, NodeSpec, NormalisedSpec,
    Scenario,
};
use funnelnet_protocol::NodeConfig;
use funnelnet_protocol::config::{
    BreachPolicy, CouplingConfig, EdgeConfig, FieldConfig, FunnelConfig, FunnelShape, GainConfig,
    MAX_COMPONENTS, MAX_NEIGHBOURS, MAX_SINES, NormalisedShape, SineConfig, TickSource,
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
pub enum Unfit {
    /// More of something than a configuration has room for.
    TooMuch {
        /// Id of the node.
        node: u16,
        /// What there is too much of.
        what: &'static str,
        /// Most that a node takes.
        limit: usize,
    },
    /// The coupling is none that a node can compute from what its neighbours send.
    NotLocal,
}

impl fmt::Display for Unfit {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::TooMuch { node, what, limit } => {
                write!(f, "node {node}: too many {what}; a node takes at most {limit}")
            }
            Self::NotLocal => f.write_str(
                "weakly-centralised coupling cannot run on nodes: each would have to know the gains of all others within the \
                 same tick; run it with --on loopback",
            ),
        }
    }
}

impl std::error::Error for Unfit {}

/// One configuration per node, by index.
///
/// # Errors
/// A node has more sinusoids or neighbours, or a longer tick, than a configuration has room for, or the coupling is not for
/// nodes.
pub fn node_configs(scenario: &Scenario, drive: Drive) -> Result<Vec<NodeConfig>, Unfit> {
    let too_long = Unfit::TooMuch { node: 1, what: "nanoseconds in a tick", limit: u32::MAX as usize };
    let tick_ns = u32::try_from(scenario.time.tick_ns).map_err(|_| too_long)?;
    let coupling = coupling(scenario.coupling).ok_or(Unfit::NotLocal)?;
    let edges = edge_counts(scenario);
    let config = |(index, node): (usize, &NodeSpec)| {
        let too_much = |what, limit| Unfit::TooMuch { node: node.id, what, limit };
        let state = node.state.iter().map(|&x| x as f32);
        let neighbours = scenario.graph.edges.iter().filter_map(|edge| seen_from(index, edge, &edges));
        Ok(NodeConfig {
            id: u8::try_from(node.id).map_err(|_| too_much("nodes before it", LARGEST_RUN))?,
            tick_ns,
            tick_source: drive.tick_source,
            initial_state: collect(state).ok_or(too_much("components", MAX_COMPONENTS))?,
            state_limit: STATE_LIMIT,
            field: field(&node.dynamics).ok_or(too_much("sinusoids or components", MAX_SINES))?,
            coupling,
            gain: gain(&node.gain),
            funnel: funnel(&node.funnel),
            on_breach: policy(scenario.on_breach),
            neighbours: collect(neighbours).ok_or(too_much("neighbours", MAX_NEIGHBOURS))?,
            extrapolate_ticks: EXTRAPOLATE_TICKS,
            telemetry_every: drive.telemetry_every,
            lost_neighbours: scenario.safety.lost_neighbours,
            holdover_ns: scenario.safety.holdover_ns.unwrap_or(0),
        })
    };
    scenario.nodes.iter().enumerate().map(config).collect()
}

/// The same for weakly-centralised coupling, which is simulated with the parameters of node-wise coupling.
///
/// # Errors
/// As [`node_configs`].
pub fn central_configs(scenario: &Scenario, drive: Drive) -> Result<Vec<NodeConfig>, Unfit> {
    let scenario = Scenario { coupling: CouplingKind::NodeWise, ..scenario.clone() };
    node_configs(&scenario, drive)
}

/// The number of edges of each node, by index.
fn edge_counts(scenario: &Scenario) -> Vec<u8> {
    let mut counts = vec![0u8; scenario.nodes.len()];
    for end in scenario.graph.edges.iter().flat_map(|edge| [edge.a, edge.b]) {
        if let Some(count) = counts.get_mut(end) {
            *count = count.saturating_add(1);
        }
    }
    counts
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

fn seen_from(index: usize, edge: &Edge, counts: &[u8]) -> Option<EdgeConfig> {
    let other = match index {
        _ if index == edge.a => edge.b,
        _ if index == edge.b => edge.a,
        _ => return None,
    };
    let id = u8::try_from(other + 1).ok()?;
    Some(EdgeConfig { id, weight: edge.weight as f32, edges: counts.get(other).copied()? })
}

fn collect<T, const N: usize>(items: impl Iterator<Item = T>) -> Option<heapless::Vec<T, N>> {
    let mut collected = heapless::Vec::new();
    for item in items {
        collected.push(item).ok()?;
    }
    Some(collected)
}

/// The coupling as it travels; `None` for the one that no node can run.
fn coupling(kind: CouplingKind) -> Option<CouplingConfig> {
    match kind {
        CouplingKind::NodeWise | CouplingKind::ElementWise | CouplingKind::Linear => {
            Some(CouplingConfig::NodeWise)
        }
        CouplingKind::EdgeWise => Some(CouplingConfig::EdgeWise),
        CouplingKind::MaxGain => Some(CouplingConfig::MaxGain),
        CouplingKind::LambdaTracker { eta } => Some(CouplingConfig::LambdaTracker { eta: eta as f32 }),
        CouplingKind::None => Some(CouplingConfig::None),
        CouplingKind::WeaklyCentralised => None,
    }
}

fn policy(policy: BreachSpec) -> BreachPolicy {
    match policy {
        BreachSpec::Ride => BreachPolicy::Ride,
        BreachSpec::Stop => BreachPolicy::Stop,
        BreachSpec::Reopen { margin, rate } => {
            BreachPolicy::Reopen { margin: margin as f32, rate: rate as f32 }
        }
    }
}

/// The vector field as it travels; `None` where there is no room for it.
fn field(field: &Affine) -> Option<FieldConfig> {
    let sines = field.sines.iter().map(|sine| SineConfig {
        component: sine.component as u8,
        amplitude: sine.amplitude as f32,
        frequency: sine.frequency,
        phase: sine.phase,
    });
    Some(FieldConfig {
        slope: collect(field.slope.iter().map(|&slope| slope as f32))?,
        offset: collect(field.offset.iter().map(|&offset| offset as f32))?,
        sines: collect(sines)?,
    })
}

/// The gain as it travels.
fn gain(gain: &GainSpec) -> GainConfig {
    match *gain {
        GainSpec::Reciprocal { scale } => GainConfig::Reciprocal { scale: scale as f32 },
        GainSpec::Logarithmic { scale } => GainConfig::Logarithmic { scale: scale as f32 },
        GainSpec::LocallyLinear { bound } => GainConfig::LocallyLinear { bound: bound as f32 },
        GainSpec::Median { eta, eps } => GainConfig::Median { eta: eta as f32, eps: eps as f32 },
        GainSpec::Linear { slope } => GainConfig::Linear { slope: slope as f32 },
    }
}

/// The funnel as it travels.
fn funnel(funnel: &FunnelSpec) -> FunnelConfig {
    let shape = match *funnel {
        FunnelSpec::Exponential { start, end, rate, .. } => {
            let [start, end, rate] = [start, end, rate].map(|value| value as f32);
            FunnelShape::Exponential { start, end, rate }
        }
        FunnelSpec::Constant { width, .. } => FunnelShape::Constant { width: width as f32 },
        FunnelSpec::ReciprocalTime { scale, .. } => FunnelShape::ReciprocalTime { scale: scale as f32 },
        FunnelSpec::FiniteTime { start, at_ns, power, .. } => {
            FunnelShape::FiniteTime { start: start as f32, at_ns, power: power as f32 }
        }
        FunnelSpec::Schedule { start, at_ns, eps, then, .. } => {
            FunnelShape::Schedule { start: start as f32, at_ns, eps: eps as f32, then: normalised(then) }
        }
    };
    FunnelConfig { factor: funnel.factor() as f32, shape }
}

fn normalised(shape: NormalisedSpec) -> NormalisedShape {
    match shape {
        NormalisedSpec::Constant { width } => NormalisedShape::Constant { width: width as f32 },
        NormalisedSpec::Exponential { start, end, rate } => {
            let [start, end, rate] = [start, end, rate].map(|value| value as f32);
            NormalisedShape::Exponential { start, end, rate }
        }
    }
}
