//! The network of a scenario in this program: its nodes, and the bus between them.

use crate::bus::Medium;
use crate::bus::can::{CanBus, LinkNoise, OnWire, most_errors};
use crate::bus::ideal::{IdealBus, IdealParams};
use crate::bus::links::Payload;
use crate::bus::uart::UartBus;
use crate::configure::{Drive, Unfit, listeners, node_configs, staged_configs};
use crate::engine::{self, Clocks, Commits, Engine, Lies, SimField, SimNode, World};
use crate::noise::Noise;
use crate::random::{self, Purpose};
use crate::scenario::{NodeSpec, Scenario};
use crate::simulation::{NodeField, node_params};
use funnelnet_can_bus::BitErrors;
use funnelnet_law::field::VectorField;
use funnelnet_node::{Node, Params};
use funnelnet_protocol::NodeConfig;
use funnelnet_protocol::config::{ConfigError, TickSource};
use funnelnet_protocol::message::NodeId;
use rand_pcg::rand_core::Rng as _;
use std::fmt;

/// Drive of nodes in this program.
pub const LOOPBACK: Drive = Drive { tick_source: TickSource::Timer, telemetry_every: 0, is_simulated: true };
/// Drive of nodes in this program that come during a run: only SYNC tells them the tick.
const JOINING: Drive = Drive { tick_source: TickSource::Sync, telemetry_every: 0, is_simulated: true };

/// Why no network can be made of a scenario.
#[derive(Clone, Debug, PartialEq)]
#[non_exhaustive]
pub enum Refused {
    /// It asks for more than a node can be told.
    Unfit(Unfit),
    /// A node refuses its configuration.
    Configuration {
        /// Id of the node.
        node: u8,
        /// Its reason.
        error: ConfigError,
    },
    /// Something was said of a node that is not there.
    NoNode {
        /// Its id.
        id: u16,
        /// The largest that there is; they begin with 1.
        last: usize,
    },
    /// The bus cannot be as it asks for.
    Bus(String),
}

impl fmt::Display for Refused {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Unfit(unfit) => unfit.fmt(f),
            Self::Configuration { node, error } => {
                write!(f, "node {node} refused its configuration: {error}")
            }
            Self::NoNode { id, last } => write!(f, "node {id}: there is none; ids are 1 to {last} here"),
            Self::Bus(reason) => f.write_str(reason),
        }
    }
}

impl std::error::Error for Refused {}

impl From<Unfit> for Refused {
    fn from(unfit: Unfit) -> Self {
        Self::Unfit(unfit)
    }
}

/// The nodes of a scenario on an ideal bus, not started yet.
///
/// # Errors
/// See [`Refused`].
pub fn engine(scenario: &Scenario) -> Result<Engine, Refused> {
    engine_on(scenario, ideal_bus(scenario))
}

/// The same on a medium.
///
/// # Errors
/// See [`Refused`].
pub fn engine_on<M: Medium>(scenario: &Scenario, medium: M) -> Result<Engine<M>, Refused> {
    engine_of(scenario, medium, params)
}

/// Why SYNC is not simulated on any bus.
const SYNC_NEEDS_CAN: &str = "[sync] needs bus.model = \"can\" or \"can-fd\" in a simulation, where all hear a SYNC at the same time; a bench with clock = \"own\" \
                              has it on serial lines, too";

/// A medium and nodes, with all that a scenario has beside them: noise, times of computing, and clocks or events. `params` is what the nodes of a scenario make of
/// their configurations; events ask for that more than once.
///
/// # Errors
/// See [`Refused`].
pub fn engine_of<M: Medium, V: VectorField<f32> + Clone>(
    scenario: &Scenario,
    medium: M,
    params: impl Fn(&[NodeConfig], &Scenario) -> Result<Vec<Params<f32, V>>, Refused>,
) -> Result<Engine<M, V>, Refused> {
    if scenario.sync.is_some() && !scenario.bus.model.is_can() {
        return Err(Refused::Bus(SYNC_NEEDS_CAN.to_owned()));
    }
    let nodes = |drive: Drive| made(&node_configs(scenario, drive)?, scenario, &params);
    let compute = scenario.nodes.iter().map(|node| node.compute_ns).collect();
    let engine = Engine::new(nodes(LOOPBACK)?, medium).with_noise(Noise::of(scenario)).with_compute(compute);
    let engine = engine.with_lies(Lies::of(scenario)).with_malfunctions(scenario);
    let engine = engine.with_commits(commits(scenario, &params)?);
    // Events of clocks are part of those.
    let engine = engine.with_clocks(Clocks::of(scenario));
    // A plant goes on where no node is left that ticks.
    let has_plants = (0..scenario.nodes.len()).any(|index| scenario.has_plant(index));
    if scenario.stays_whole() && !has_plants {
        return Ok(engine);
    }
    let course = scenario.course().on_clock(&scenario.time);
    let world = World::new(&course, scenario.time.tick_ns, listeners(scenario), nodes(JOINING)?);
    Ok(engine.with_world(world))
}

/// What is staged in the nodes of a scenario; none where no event sets anything.
fn commits<V: VectorField<f32> + Clone>(
    scenario: &Scenario,
    params: impl Fn(&[NodeConfig], &Scenario) -> Result<Vec<Params<f32, V>>, Refused>,
) -> Result<Option<Commits<V>>, Refused> {
    let Some(staged) = scenario.as_staged() else { return Ok(None) };
    let of = |drive| Ok::<_, Refused>(staged_configs(scenario, drive)?.unwrap_or_default());
    let (configs, joining) = (of(LOOPBACK)?, of(JOINING)?);
    let next = params(&configs, &staged)?.into_iter().zip(&configs);
    let fresh = made(&joining, &staged, &params)?;
    let mut commits = Commits::new(scenario.nodes.len());
    for (index, ((params, config), fresh)) in next.zip(fresh).enumerate() {
        // A run has as many ticks as a node counts.
        let tick = scenario.staged.get(index).and_then(|staged| u32::try_from(staged.as_ref()?.tick).ok());
        if let Some(tick) = tick {
            commits.stage(index, tick, (config, params), fresh);
        }
    }
    Ok(Some(commits))
}

/// Nodes of these configurations.
fn made<V: VectorField<f32>>(
    configs: &[NodeConfig],
    scenario: &Scenario,
    params: impl Fn(&[NodeConfig], &Scenario) -> Result<Vec<Params<f32, V>>, Refused>,
) -> Result<Vec<Node<f32, V>>, Refused> {
    let params = params(configs, scenario)?.into_iter();
    Ok(params.zip(configs).map(|(params, config)| Node::new(params, &config.neighbours)).collect())
}

/// The nodes of a scenario, configured.
///
/// # Errors
/// See [`Refused`].
pub fn nodes(scenario: &Scenario, drive: Drive) -> Result<Vec<SimNode>, Refused> {
    made(&node_configs(scenario, drive)?, scenario, params)
}

fn params(configs: &[NodeConfig], scenario: &Scenario) -> Result<Vec<Params<f32, SimField>>, Refused> {
    let params = accepted(configs, scenario)?.into_iter().enumerate();
    let with_plants = |((index, params), config): ((usize, Params<f32, SimField>), &NodeConfig)| {
        with_plant(params, scenario, index).map_err(|error| Refused::Configuration { node: config.id, error })
    };
    params.zip(configs).map(with_plants).collect()
}

/// The parameters of a node, with its field for a plant where an event has its sensor or its actuator fail and it has none of its own.
pub(crate) fn with_plant<V: VectorField<f32>>(
    params: Params<f32, V>,
    scenario: &Scenario,
    index: usize,
) -> Result<Params<f32, V>, ConfigError> {
    if params.plant.is_some() || !scenario.has_plant(index) {
        return Ok(params);
    }
    params.with_plant(engine::setup_of_own_field(scenario.components()))
}

/// The nodes of a scenario some of whose fields the program around the simulation computes, on a medium.
///
/// # Errors
/// See [`Refused`].
pub fn engine_with_host<M: Medium>(scenario: &Scenario, medium: M) -> Result<Engine<M, NodeField>, Refused> {
    engine_of(scenario, medium, |configs, scenario| {
        let params = |(index, (config, spec)): (usize, (&NodeConfig, &NodeSpec))| {
            let params = node_params(config, spec).and_then(|params| with_plant(params, scenario, index));
            params.map_err(|error| Refused::Configuration { node: config.id, error })
        };
        configs.iter().zip(&scenario.nodes).enumerate().map(params).collect()
    })
}

/// Parameters that the nodes make of their configurations.
///
/// # Errors
/// [`Refused::Configuration`].
pub fn accepted(configs: &[NodeConfig], scenario: &Scenario) -> Result<Vec<Params<f32, SimField>>, Refused> {
    let params = |(config, spec): (&NodeConfig, &NodeSpec)| {
        engine::params(config, spec).map_err(|error| Refused::Configuration { node: config.id, error })
    };
    configs.iter().zip(&scenario.nodes).map(params).collect()
}

/// The scenario's bus without bit times.
#[must_use]
pub fn ideal_bus<P: Payload>(scenario: &Scenario) -> IdealBus<P> {
    ideal_bus_between(scenario, |_, _| true)
}

/// The same, where it carries the frames of one node to another only if `carries` says so, by index.
#[must_use]
pub fn ideal_bus_between<P: Payload>(
    scenario: &Scenario,
    carries: impl Fn(usize, usize) -> bool,
) -> IdealBus<P> {
    let mut listeners = listeners(scenario);
    for (from, list) in listeners.iter_mut().enumerate() {
        list.retain(|&to| carries(from, to));
    }
    let spec = &scenario.bus;
    let params = IdealParams { loss: spec.loss, latency_ns: spec.latency_ns, jitter_ns: spec.jitter_ns };
    IdealBus::new(params, scenario.seed, listeners).with_links(
        scenario.seed,
        &scenario.links,
        &scenario.spells(),
    )
}

/// The scenario's CAN bus, with as many bit errors as it asks for.
///
/// # Errors
/// See [`Refused`].
pub fn can_bus<F: OnWire>(
    scenario: &Scenario,
) -> Result<CanBus<impl funnelnet_can_bus::Noise + use<F>, F>, Refused> {
    let (spec, seed) = (&scenario.bus, scenario.seed);
    let timing = spec.timing().ok_or_else(|| Refused::Bus("a bus without bit rates".to_owned()))?;
    let mut stream = random::stream(seed, Purpose::BitErrors, 0);
    let (spells, noisy) = (scenario.spells(), scenario.noisy_spells());
    let errors = BitErrors::on_the_bus(most_errors(spec.bit_errors, &noisy), move || stream.next_u64())
        .map_err(|error| Refused::Bus(error.to_string()))?;
    let known = |id: u16| NodeId::new(u8::try_from(id).ok()?);
    let ids: Vec<NodeId> = scenario.nodes.iter().filter_map(|node| known(node.id)).collect();
    let noise = LinkNoise::new(errors, ids.len(), seed, &scenario.links).with_spells(
        seed,
        &spells,
        spec.bit_errors,
        noisy,
    );
    let masters = scenario.sync.iter().flat_map(|sync| &sync.masters);
    let masters: Vec<NodeId> = masters.filter_map(|&id| known(id)).collect();
    let bus = CanBus::with_masters(timing, noise, (&ids, &listeners(scenario)), &masters);
    Ok(bus
        .with_loss(seed, spec.loss)
        .with_links(seed, &scenario.links, &spells)
        .with_harms(&scenario.harms()))
}

/// The serial lines of a scenario.
#[must_use]
pub fn uart_bus(scenario: &Scenario) -> UartBus {
    UartBus::new(&scenario.bus, listeners(scenario), scenario.seed, &scenario.links)
}
