//! A scenario's network in a test of your own: the node of the firmware, on a simulated bus, with fields and
//! plants that you write.

mod field;
mod network;
#[cfg(test)]
mod tests;
mod verdict;

pub use field::{NodeField, node_params};
pub use verdict::Verdict;

use crate::bus::Medium;
use crate::central::Central;
use crate::configure::{Unfit, central_configs};
use crate::engine::{Driven, NodeEvent, Plants};
use crate::judge::{Accounts, Evidence, Judge, Moment, Stop, checks, missed};
use crate::loopback::{LOOPBACK, Refused, accepted, can_bus, engine_of, ideal_bus, uart_bus, with_plant};
use crate::noise::Noise;
use crate::scenario::{BusModel, Coupling, NodeSpec, Scenario};
use funnelnet_law::field::VectorField;
use funnelnet_link::{Classic, Fd};
use funnelnet_node::{Fixed, Model, Observation, Params};
use funnelnet_plant::Plant;
use funnelnet_protocol::NodeConfig;
use funnelnet_protocol::config::ConfigError;
use network::Network;
use std::sync::Arc;

/// Makes the parameters of a node from its configuration.
type Make = Box<dyn Fn(&NodeConfig) -> Result<Params<f32, NodeField>, ConfigError>>;

/// A network that is not started yet: its nodes may get fields and plants.
pub struct Setup<'s> {
    scenario: &'s Scenario,
    /// By index; none for a node that is as the scenario says.
    makes: Vec<Option<Make>>,
    plants: Vec<Option<Box<dyn Driven>>>,
    /// The first id that something was said of, and that is not there.
    no_node: Option<u16>,
}

/// A network that runs.
pub struct Simulation<'s> {
    scenario: &'s Scenario,
    network: Box<dyn Network + 's>,
    judge: Judge<'s>,
    accounts: Accounts<'s>,
    /// Tick that comes next.
    next: u64,
    events: Vec<NodeEvent>,
    has_hosted_fields: bool,
    /// States and inputs of the tick, by index and then by component.
    x: Vec<f64>,
    u: Vec<f64>,
}

impl<'s> Simulation<'s> {
    /// Network of a scenario, with its nodes, fields and bus.
    ///
    /// # Errors
    /// See [`Refused`].
    pub fn new(scenario: &'s Scenario) -> Result<Self, Refused> {
        Self::setup(scenario).start()
    }

    /// Network of a scenario whose nodes first get fields or plants of your own.
    #[must_use]
    pub fn setup(scenario: &'s Scenario) -> Setup<'s> {
        let nodes = scenario.nodes.len();
        Setup {
            scenario,
            makes: (0..nodes).map(|_| None).collect(),
            plants: (0..nodes).map(|_| None).collect(),
            no_node: None,
        }
    }

    /// Runs the next tick of all nodes and gives its number, from 0 on; `None` after the last one of the
    /// scenario.
    pub fn step(&mut self) -> Option<u64> {
        let k = self.next;
        if k > self.scenario.time.ticks {
            return None;
        }
        self.next += 1;
        self.network.advance();
        if self.has_hosted_fields {
            // What each node will ask for first at the next tick.
            self.scenario.announce(self.scenario.time.at_s(k + 1), &self.network.states());
        }
        let (seen, presence) = (self.network.observations(), self.network.presence(k));
        self.x.clear();
        self.x.extend(seen.iter().map(|seen| f64::from(seen.x)));
        self.u.clear();
        self.u.extend(seen.iter().map(|seen| f64::from(seen.u)));
        self.judge.tick(&Moment { k, part: 0, x: &self.x, u: &self.u, presence: &presence }, None);
        self.accounts.tick(k, seen, &presence, self.judge.psi());
        self.events.extend(self.network.take_events());
        Some(k)
    }

    /// Runs all ticks that are left, and judges.
    #[must_use]
    pub fn run(mut self) -> Verdict {
        while self.step().is_some() {}
        self.verdict()
    }

    /// Judges the ticks so far; a run that is not complete does not hold.
    #[must_use]
    pub fn verdict(self) -> Verdict {
        let scenario = self.scenario;
        let stops: Vec<_> = self.events.iter().filter_map(|event| Stop::of(event, scenario)).collect();
        let mut accounts = self.accounts.finish();
        for (account, report) in accounts.iter_mut().zip(self.network.reports()) {
            account.report = report.map(|report| (report.max_ratio, report.counters));
        }
        let all = scenario.time.ticks + 1;
        let early = (self.next < all).then(|| format!("after {} of {all} ticks", self.next));
        let (unheard, silent) = match early {
            // Nobody knows who would still have been heard.
            Some(_) => (Vec::new(), Vec::new()),
            None => self.network.unheard_and_silent(&scenario.graph),
        };
        let findings = self.judge.finish();
        let contradictions = missed(scenario, self.network.missed());
        let evidence = Evidence {
            findings: &findings,
            accounts: &accounts,
            stops: &stops,
            absences: &[],
            unheard: &unheard,
            silent: &silent,
            contradictions: &contradictions,
            reference: None,
            ended_early: early.as_deref(),
        };
        let checks = checks(scenario, &evidence);
        Verdict { findings, checks, stops }
    }

    /// Observations of the node with this id at the last tick, component by component; empty for an id that
    /// is not there.
    #[must_use]
    pub fn node(&self, id: u16) -> &[Observation<f32>] {
        let components = self.scenario.components();
        let first = index_of(id).map_or(usize::MAX, |index| index.saturating_mul(components));
        let seen = self.network.observations();
        seen.get(first..first.saturating_add(components)).unwrap_or_default()
    }

    /// Events that nodes reported so far.
    #[must_use]
    pub fn events(&self) -> &[NodeEvent] {
        &self.events
    }
}

impl<'s> Setup<'s> {
    /// Gives the node with this id a vector field in place of the scenario's, as `funnelnet_node::Fixed` does
    /// on a board.
    ///
    /// An id that is not in the scenario is refused by [`Self::start`].
    #[must_use]
    pub fn field(self, id: u16, field: impl VectorField<f32> + Clone + 'static) -> Self {
        self.with(id, move |config| made(config, &Fixed(field.clone())), None)
    }

    /// Gives the node with this id a plant, the same that a board has: the node samples and drives it, and
    /// its model is the node's field.
    #[must_use]
    pub fn plant<P: Plant + 'static>(self, id: u16, plant: P) -> Self
    where
        P::Model: 'static,
        <P::Model as Model>::Field: 'static,
    {
        let model = plant.model();
        self.with(id, move |config| made(config, &model), Some(Box::new(plant)))
    }

    fn with(
        mut self,
        id: u16,
        make: impl Fn(&NodeConfig) -> Result<Params<f32, NodeField>, ConfigError> + 'static,
        plant: Option<Box<dyn Driven>>,
    ) -> Self {
        let index = index_of(id).unwrap_or(usize::MAX);
        match (self.makes.get_mut(index), self.plants.get_mut(index)) {
            (Some(own), Some(driven)) => {
                *own = Some(Box::new(make));
                *driven = plant;
            }
            _ => self.no_node = self.no_node.or(Some(id)),
        }
        self
    }

    /// Starts all nodes.
    ///
    /// # Errors
    /// See [`Refused`].
    pub fn start(self) -> Result<Simulation<'s>, Refused> {
        let scenario = self.scenario;
        if let Some(id) = self.no_node {
            return Err(Refused::NoNode { id, last: scenario.nodes.len() });
        }
        let mut network = self.network()?;
        network.start();
        let (judge, accounts) = (Judge::new(scenario), Accounts::new(scenario));
        let (events, x, u) = (Vec::new(), Vec::new(), Vec::new());
        let has_hosted_fields = scenario.has_hosted_fields();
        Ok(Simulation { scenario, network, judge, accounts, next: 0, events, has_hosted_fields, x, u })
    }

    fn network(self) -> Result<Box<dyn Network + 's>, Refused> {
        let scenario = self.scenario;
        if scenario.coupling == Coupling::WeaklyCentralised {
            return self.central();
        }
        match scenario.bus.model {
            BusModel::Ideal => self.on(ideal_bus(scenario)),
            BusModel::Can => self.on(can_bus::<Classic>(scenario)?),
            BusModel::CanFd => self.on(can_bus::<Fd>(scenario)?),
            BusModel::Uart => self.on(uart_bus(scenario)),
        }
    }

    /// One loop over all nodes, which is none for nodes with fields or plants of their own.
    fn central(self) -> Result<Box<dyn Network + 's>, Refused> {
        let scenario = self.scenario;
        if self.makes.iter().any(Option::is_some) || scenario.has_hosted_fields() {
            return Err(Refused::Unfit(Unfit::NotLocal));
        }
        let params = accepted(&central_configs(scenario, LOOPBACK)?, scenario)?;
        Ok(Box::new(Central::new(params, &scenario.graph, Noise::of(scenario))))
    }

    fn on<M: Medium + 's>(self, medium: M) -> Result<Box<dyn Network + 's>, Refused> {
        let engine = engine_of(self.scenario, medium, |configs, scenario| self.params(configs, scenario))?;
        Ok(Box::new(engine.with_plants(Plants::new(self.plants))))
    }

    /// What the nodes make of their configurations.
    fn params(
        &self,
        configs: &[NodeConfig],
        scenario: &Scenario,
    ) -> Result<Vec<Params<f32, NodeField>>, Refused> {
        let params = |(index, (config, spec)): (usize, (&NodeConfig, &NodeSpec))| {
            let params = match self.makes.get(index) {
                Some(Some(make)) => make(config),
                _ => node_params(config, spec),
            };
            let params = params.and_then(|params| with_plant(params, scenario, index));
            params.map_err(|error| Refused::Configuration { node: config.id, error })
        };
        configs.iter().zip(&scenario.nodes).enumerate().map(params).collect()
    }
}

/// The parameters of a node with a model of its own.
fn made<M: Model>(config: &NodeConfig, model: &M) -> Result<Params<f32, NodeField>, ConfigError>
where
    M::Field: 'static,
{
    Params::of_model(config, &AsField(model))
}

/// A model whose field is any field.
struct AsField<'a, M>(&'a M);

impl<M: Model> Model for AsField<'_, M>
where
    M::Field: 'static,
{
    type Field = NodeField;

    fn field(&self, config: &NodeConfig, tick: f64) -> Result<NodeField, ConfigError> {
        Ok(NodeField::Own(Arc::new(self.0.field(config, tick)?)))
    }

    fn plant(&self) -> Option<funnelnet_node::PlantSetup> {
        self.0.plant()
    }
}

/// Index of the node with this id; ids are 1, 2, ... in the order of the nodes.
fn index_of(id: u16) -> Option<usize> {
    usize::from(id).checked_sub(1)
}
