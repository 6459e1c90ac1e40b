//! From a scenario to what each node is told: SI and f64 to SI and f32, the form that travels.

use crate::sampled::Bounds;
#[cfg(feature = "large")]
use crate::scenario::LargeScenario;
use crate::scenario::{
    Affine, Coupling, Dynamics, Edge, LARGEST_RUN, NodeSpec, SafetySpec, Scenario, TimeSpec,
};
#[cfg(feature = "large")]
use funnelnet_law::Breach;
use funnelnet_law::program::Operation;
use funnelnet_protocol::NodeConfig;
use funnelnet_protocol::config::{
    EdgeConfig, Field, HeardLimits, Limits, MAX_COMPONENTS, MAX_NEIGHBOURS, MAX_SINES, Program, Sine,
    TickSource, TimeRules, Tuning,
};
use std::fmt;

/// States beyond this are refused by every node, state units.
const STATE_LIMIT: f32 = 1e9;
/// Drive of the nodes of a run: what makes them tick.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Drive {
    /// Source of the nodes' ticks.
    pub tick_source: TickSource,
    /// Ticks between telemetry frames; 0 is none.
    pub telemetry_every: u32,
    /// Whether nothing can happen to their frames but what the scenario says.
    pub is_simulated: bool,
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
    /// An expression names an input from outside.
    Input {
        /// Id of the node.
        node: u16,
        /// Name of the input.
        name: String,
    },
    /// The program around the simulation computes its field.
    Hosted {
        /// Id of the node.
        node: u16,
    },
}

impl fmt::Display for Unfit {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::TooMuch { node, what, limit } => {
                write!(f, "node {node}: too many {what}; a node takes at most {limit}")
            }
            Self::Input { node, name } => write!(
                f,
                "node {node}: its field names the input '{name}', which a real node does not know: inputs from files are for simulation \
                 and reference; run it with sim-host run --on loopback"
            ),
            Self::Hosted { node } => write!(
                f,
                "node {node}: its field is computed by the program around the simulation, which a real node does not have; \
                 simulate it, or write the field as an expression"
            ),
            Self::NotLocal => f.write_str(
                "weakly-centralised coupling cannot run on nodes: each would have to know the gains of all others within the \
                 same tick; run it with sim-host run --on loopback",
            ),
        }
    }
}

impl std::error::Error for Unfit {}

/// One configuration per node, by index.
///
/// # Errors
/// A node has more sinusoids or neighbours, or a longer tick, than a configuration has room for, or the
/// coupling is not for nodes.
pub fn node_configs(scenario: &Scenario, drive: Drive) -> Result<Vec<NodeConfig>, Unfit> {
    configs(scenario, drive, bounds(scenario, drive))
}

/// What events stage in the nodes, by index: a whole configuration of each, also where nothing is staged; none where no event
/// sets anything. The bounds are those of [`node_configs`], and hold before and after.
///
/// # Errors
/// As [`node_configs`].
pub fn staged_configs(scenario: &Scenario, drive: Drive) -> Result<Option<Vec<NodeConfig>>, Unfit> {
    let staged = scenario.as_staged();
    staged.map(|staged| configs(&staged, drive, bounds(scenario, drive))).transpose()
}

fn bounds(scenario: &Scenario, drive: Drive) -> Bounds {
    match drive.is_simulated {
        true => Bounds::of(scenario),
        false => Bounds::of_disturbed(scenario),
    }
}

fn configs(scenario: &Scenario, drive: Drive, bounds: Bounds) -> Result<Vec<NodeConfig>, Unfit> {
    let too_long = Unfit::TooMuch { node: 1, what: "nanoseconds in a tick", limit: u32::MAX as usize };
    let time @ TimeSpec { tick_ns, round, .. } = scenario.time;
    let tick_ns = u32::try_from(tick_ns / u64::from(round)).map_err(|_| too_long)?;
    let coupling = scenario.coupling.on_node(|value| value as f32).ok_or(Unfit::NotLocal)?;
    let edges = edge_counts(scenario);
    let config = |(index, node): (usize, &NodeSpec)| {
        let too_much = |what, limit| Unfit::TooMuch { node: node.id, what, limit };
        if let Some(name) = named_input(&node.dynamics).filter(|_| !drive.is_simulated) {
            return Err(Unfit::Input { node: node.id, name: name.to_owned() });
        }
        if node.dynamics.hosted().is_some() && !drive.is_simulated {
            return Err(Unfit::Hosted { node: node.id });
        }
        let state = node.state.iter().map(|&x| x as f32);
        let neighbours = scenario.graph.edges.iter().filter_map(|edge| seen_from(index, edge, &edges));
        Ok(NodeConfig {
            id: u8::try_from(node.id).map_err(|_| too_much("nodes before it", LARGEST_RUN))?,
            tick_ns,
            tick_source: drive.tick_source,
            initial_state: collect(state).ok_or(too_much("components", MAX_COMPONENTS))?,
            state_limit: STATE_LIMIT,
            field: field(node).ok_or(too_much("sinusoids or components", MAX_SINES))?,
            coupling,
            gain: node.gain.map(|value| value as f32),
            funnel: node.funnel.map(|value| value as f32),
            on_breach: scenario.on_breach.map(|value| value as f32),
            neighbours: collect(neighbours).ok_or(too_much("neighbours", MAX_NEIGHBOURS))?,
            extrapolate_ticks: bounds.extrapolate,
            telemetry_every: drive.telemetry_every,
            lost_neighbours: scenario.safety.lost_neighbours,
            holdover_ns: scenario.safety.holdover_ns.unwrap_or(0),
            tuning: Tuning {
                damping: node.damping as f32,
                guard: scenario.guard as f32,
                round,
                input_limit: bounds.input.unwrap_or(0.0) as f32,
                slope_limit: bounds.slope.unwrap_or(0.0) as f32,
                slow_start: time.start.ticks(),
            },
            program: program(&node.dynamics),
            limits: limits(node),
            heard: heard(&scenario.safety),
            time: TimeRules::NONE,
        })
    };
    scenario.nodes.iter().enumerate().map(config).collect()
}

/// A configuration without edges for a prototype of nodes without a bus, by which a node validates and prepares it.
///
/// # Errors
/// As [`node_configs`].
#[cfg(feature = "large")]
pub(crate) fn alone_config(scenario: &LargeScenario, node: &NodeSpec) -> Result<NodeConfig, Unfit> {
    let too_much = |what, limit| Unfit::TooMuch { node: node.id, what, limit };
    let tick_ns = u32::try_from(scenario.time.tick_ns)
        .map_err(|_| too_much("nanoseconds in a tick", u32::MAX as usize))?;
    Ok(NodeConfig {
        id: 1,
        tick_ns,
        tick_source: TickSource::Timer,
        initial_state: collect(node.state.iter().map(|&x| x as f32))
            .ok_or(too_much("components", MAX_COMPONENTS))?,
        state_limit: STATE_LIMIT,
        field: field(node).ok_or(too_much("sinusoids or components", MAX_SINES))?,
        coupling: scenario.coupling.on_node(|value| value as f32).ok_or(Unfit::NotLocal)?,
        gain: node.gain.map(|value| value as f32),
        funnel: node.funnel.map(|value| value as f32),
        on_breach: Breach::Ride,
        neighbours: heapless::Vec::new(),
        extrapolate_ticks: Bounds::NONE.extrapolate,
        telemetry_every: 0,
        lost_neighbours: 0,
        holdover_ns: 0,
        tuning: Tuning {
            damping: node.damping as f32,
            guard: scenario.guard as f32,
            round: 1,
            input_limit: scenario.u_max.unwrap_or(0.0) as f32,
            slope_limit: 0.0,
            slow_start: 0,
        },
        program: program(&node.dynamics),
        limits: limits(node),
        heard: HeardLimits::NONE,
        time: TimeRules::NONE,
    })
}

fn heard(safety: &SafetySpec) -> HeardLimits {
    HeardLimits {
        limit: safety.heard_limit.unwrap_or(0.0) as f32,
        rate: safety.heard_rate.unwrap_or(0.0) as f32,
        drop_after: safety.drop_after,
    }
}

fn limits(node: &NodeSpec) -> Limits {
    node.limits
        .map_or(Limits::default(), |limits| Limits { low: limits.low as f32, high: limits.high as f32 })
}

/// Configurations for weakly centralised coupling, which is simulated with the parameters of node-wise
/// coupling.
///
/// # Errors
/// As [`node_configs`].
pub fn central_configs(scenario: &Scenario, drive: Drive) -> Result<Vec<NodeConfig>, Unfit> {
    let scenario = Scenario { coupling: Coupling::NodeWise, ..scenario.clone() };
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

/// Nodes that accept the frames of each node, by index: its neighbours.
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

/// The first input from outside that an expression names.
fn named_input(dynamics: &Dynamics) -> Option<&str> {
    let expression = dynamics.expression()?;
    let mut inputs = expression.program.operations().filter_map(|operation| match operation {
        Operation::Input(index) => expression.inputs.get(usize::from(index)),
        _ => None,
    });
    inputs.next().map(|series| series.name.as_str())
}

/// The program of an expression as it travels.
fn program(dynamics: &Dynamics) -> Program<f32> {
    match dynamics {
        Dynamics::Affine(_) | Dynamics::Hosted(_) => Program::none(),
        Dynamics::Expression(expression) => Program {
            code: expression.program.code.clone(),
            constants: expression.program.constants.iter().map(|&constant| constant as f32).collect(),
        },
    }
}

/// The vector field as it travels; `None` where there is no room for it. Beside a program it is its sinusoids
/// and nothing more.
fn field(node: &NodeSpec) -> Option<Field<f32>> {
    match &node.dynamics {
        Dynamics::Affine(affine) => affine_field(affine, &affine.sines),
        // The node gets it by another way.
        Dynamics::Hosted(_) => {
            let offset = vec![0.0; node.state.len()];
            affine_field(&Affine { slope: vec![0.0], offset, sines: Vec::new() }, &[])
        }
        Dynamics::Expression(expression) => {
            let offset = vec![0.0; expression.text.len()];
            affine_field(&Affine { slope: vec![0.0], offset, sines: Vec::new() }, &expression.waves)
        }
    }
}

/// A sine as it travels.
pub(crate) fn wave(sine: &crate::scenario::Sine) -> Sine<f32> {
    Sine {
        component: sine.component,
        amplitude: sine.amplitude as f32,
        frequency: sine.frequency,
        phase: sine.phase,
    }
}

fn affine_field(field: &Affine, sines: &[crate::scenario::Sine]) -> Option<Field<f32>> {
    let sines = sines.iter().map(wave);
    Some(Field {
        slope: collect(field.slope.iter().map(|&slope| slope as f32))?,
        offset: collect(field.offset.iter().map(|&offset| offset as f32))?,
        sines: collect(sines)?,
    })
}
