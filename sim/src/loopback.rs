//! The network of a scenario in this program: its nodes, and the bus between them.

use crate::bus::Medium;
use crate::bus::can::{CanBus, LinkNoise, OnWire};
use crate::bus::ideal::{IdealBus, IdealParams};
use crate::bus::links::Payload;
use crate::bus::uart::UartBus;
use crate::configure::{Drive, Unfit, listeners, node_configs};
use crate::engine::{self, Clocks, Engine, SimField, SimNode, World};
use crate::noise::Noise;
use crate::random::{self, Purpose};
use crate::scenario::{NodeSpec, Scenario};
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
pub const JOINING: Drive = Drive { tick_source: TickSource::Sync, telemetry_every: 0, is_simulated: true };

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
    /// There are more nodes than can run, or something was said of one that is not there.
    Nodes {
        /// The largest id.
        asked: usize,
        /// The largest that there may be.
        most: usize,
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
            Self::Nodes { asked, most } => write!(f, "node {asked}: ids are 1 to {most} here"),
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

/// The nodes of a scenario on an ideal bus, with its events, not started yet.
///
/// # Errors
/// See [`Refused`].
pub fn engine(scenario: &Scenario) -> Result<Engine, Refused> {
    engine_on(scenario, ideal_bus(scenario))
}

/// The same on any medium: a scenario refuses events on one that makes none.
///
/// # Errors
/// See [`Refused`].
pub fn engine_on<M: Medium>(scenario: &Scenario, medium: M) -> Result<Engine<M>, Refused> {
    let engine = Engine::new(nodes(scenario, LOOPBACK)?, medium);
    let engine = engine.with_noise(Noise::of(scenario)).with_compute(compute(scenario));
    if scenario.events.is_empty() {
        return Ok(engine.with_clocks(Clocks::of(scenario)));
    }
    Ok(engine.with_world(world(scenario, nodes(scenario, JOINING)?)))
}

/// The events of a scenario, whose nodes are as `fresh` after power-on.
#[must_use]
pub fn world<V: VectorField<f32> + Clone>(scenario: &Scenario, fresh: Vec<Node<f32, V>>) -> World<V> {
    let course = scenario.course().on_clock(&scenario.time);
    World::new(&course, scenario.time.tick_ns, listeners(scenario), fresh)
}

/// The nodes of a scenario, configured.
///
/// # Errors
/// See [`Refused`].
pub fn nodes(scenario: &Scenario, drive: Drive) -> Result<Vec<SimNode>, Refused> {
    let configs = node_configs(scenario, drive)?;
    let params = accepted(&configs, scenario)?.into_iter();
    Ok(params.zip(&configs).map(|(params, config)| Node::new(params, &config.neighbours)).collect())
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

/// Time that each node takes from its tick to its frames, ns, by index.
#[must_use]
pub fn compute(scenario: &Scenario) -> Vec<u64> {
    scenario.nodes.iter().map(|node| node.compute_ns).collect()
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
    IdealBus::new(params, scenario.seed, listeners).with_links(scenario.seed, &scenario.links)
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
    let errors = BitErrors::on_the_bus(spec.bit_errors, move || stream.next_u64())
        .map_err(|error| Refused::Bus(error.to_string()))?;
    let configs = node_configs(scenario, LOOPBACK)?;
    let ids: Vec<NodeId> = configs.iter().filter_map(|config| NodeId::new(config.id)).collect();
    let noise = LinkNoise::new(errors, ids.len(), seed, &scenario.links);
    let masters = scenario.sync.iter().flat_map(|sync| &sync.masters);
    let masters: Vec<NodeId> = masters.filter_map(|&id| NodeId::new(u8::try_from(id).ok()?)).collect();
    let bus = CanBus::with_masters(timing, noise, (&ids, &listeners(scenario)), &masters);
    Ok(bus.with_loss(seed, spec.loss).with_links(seed, &scenario.links))
}

/// The serial lines of a scenario.
#[must_use]
pub fn uart_bus(scenario: &Scenario) -> UartBus {
    UartBus::new(&scenario.bus, listeners(scenario), scenario.seed, &scenario.links)
}
