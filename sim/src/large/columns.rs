//! Numbers of all nodes that never change during a run, and how they are made of a scenario.

use super::kinds::{FunnelPair, Kind, Kinds, Shared};
use crate::configure::{alone_config, wave};
use crate::engine;
use crate::loopback::Refused;
use crate::scenario::{Coupling, Dynamics, FloorSpec, Graph, LargeScenario, NodeSpec};
use funnelnet_law::Gain;
use funnelnet_law::field::Phasor;
use funnelnet_law::floor::Floor;
use funnelnet_law::funnel::SampledFunnel;
use funnelnet_law::law::node_wise::{Constants, NodeWise};
use funnelnet_node::InputRange;
use std::collections::BTreeMap;

/// Numbers of one node.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Own {
    pub slope: f32,
    pub offset: f32,
    /// Its first edge, and how many it has.
    pub first: u32,
    pub edges: u32,
    /// Place of its kind.
    pub kind: u32,
}

/// All nodes, by index.
#[derive(Clone, Debug)]
pub(super) struct Columns {
    pub own: Vec<Own>,
    /// Initial states, state units.
    pub initial: Vec<f32>,
    /// Neighbours by index, node by node, ascending.
    pub neighbours: Vec<u32>,
    /// Weights of the same edges; none where all are alike.
    pub weights: Vec<f64>,
    /// That of all of them.
    pub weight: f64,
    /// Sines, node by node; where the ones of a node begin, and at the end their number. None without sines.
    pub phasors: Vec<Phasor<f32>>,
    pub phasor_starts: Vec<u32>,
}

/// Everything that a run is made of.
pub(super) struct Made {
    pub columns: Columns,
    pub kinds: Kinds,
    pub funnels: Vec<FunnelPair>,
    pub shared: Shared,
}

impl Columns {
    /// Sines of a node.
    pub fn phasors(&self, index: usize) -> &[Phasor<f32>] {
        match self.phasor_starts.get(index..index + 2) {
            Some(&[from, to]) => self.phasors.get(from as usize..to as usize).unwrap_or(&[]),
            _ => &[],
        }
    }
}

/// What nodes of one prototype share, whatever their degree.
struct Prototype {
    gain: Gain<f32>,
    constants: Constants,
    funnel: usize,
    limits: Option<InputRange>,
    expression: Option<usize>,
}

/// Makes everything of a scenario.
pub(super) fn make(scenario: &LargeScenario) -> Result<Made, Refused> {
    let mut columns = edges_of(&scenario.graph);
    let period = f64::from(period_ns(scenario)?) * 1e-9;
    let (prototypes, funnels, shared) = prototypes(scenario)?;
    let degrees = degrees(&columns);
    let (mut kinds, mut known) = (Vec::new(), BTreeMap::new());
    let has_sines = scenario.prototypes().any(|node| sines(node) > 0);
    scenario.for_each_node(|index, at, node| {
        let (Some(own), Some(prototype)) = (columns.own.get_mut(index), prototypes.get(at)) else { return };
        if let Dynamics::Affine(field) = &node.dynamics {
            (own.slope, own.offset) = (field.slope() as f32, field.offset() as f32);
            columns.phasors.extend(field.sines.iter().map(|sine| Phasor::new(&wave(sine), period)));
        }
        if has_sines {
            columns.phasor_starts.push(columns.phasors.len() as u32);
        }
        columns.initial.push(node.state.first().copied().unwrap_or(0.0) as f32);
        let degree = degrees.get(index).copied().unwrap_or(0.0);
        own.kind = *known.entry((at, degree.to_bits())).or_insert_with(|| {
            kinds.push(kind(prototype, degree, period));
            (kinds.len() - 1) as u32
        });
    });
    if has_sines {
        columns.phasor_starts.insert(0, 0);
    }
    Ok(Made { columns, kinds: Kinds::new(kinds), funnels, shared })
}

fn period_ns(scenario: &LargeScenario) -> Result<u32, Refused> {
    let too_long =
        crate::configure::Unfit::TooMuch { node: 1, what: "nanoseconds in a tick", limit: u32::MAX as usize };
    u32::try_from(scenario.time.tick_ns).map_err(|_| too_long.into())
}

fn sines(node: &NodeSpec) -> usize {
    node.dynamics.affine().map_or(0, |field| field.sines.len())
}

fn kind(prototype: &Prototype, degree: f64, period: f64) -> Kind<Gain<f32>> {
    Kind {
        law: NodeWise::with(prototype.gain, period, degree, prototype.constants),
        floor: Floor::new(degree, period),
        judged_floor: Floor::of_f32(degree, period),
        funnel: prototype.funnel,
        limits: prototype.limits,
        expression: prototype.expression,
    }
}

/// The prototypes as a node takes them: it is the node that validates and prepares them.
fn prototypes(scenario: &LargeScenario) -> Result<(Vec<Prototype>, Vec<FunnelPair>, Shared), Refused> {
    let (mut all, mut funnels, mut expressions) = (Vec::new(), Vec::new(), Vec::new());
    // By their words: an f64 is no key.
    let mut known_funnels = BTreeMap::new();
    let mut shared = None;
    for node in scenario.prototypes() {
        let config = alone_config(scenario, node)?;
        let params = engine::params(&config, node)
            .map_err(|error| Refused::Configuration { node: config.id, error })?;
        let funnel = *known_funnels.entry(format!("{:?}", node.funnel)).or_insert_with(|| {
            let sampled: SampledFunnel<f32> = params.funnel;
            funnels.push(FunnelPair { sampled, drawn: node.funnel });
            funnels.len() - 1
        });
        let expression = node.dynamics.expression().map(|_| {
            expressions.push(params.field.clone());
            expressions.len() - 1
        });
        all.push(Prototype {
            gain: params.law.gain,
            constants: Constants::damped_by(config.tuning.damping.into()),
            funnel,
            limits: params.limits,
            expression,
        });
        shared.get_or_insert(Shared {
            tick: params.tick,
            guard: params.guard,
            input_limit: params.input_limit,
            state_limit: params.state_limit,
            is_coupled: scenario.coupling != Coupling::None,
            accepts_f32: scenario.floor == FloorSpec::F32,
            expressions: Vec::new(),
        });
    }
    let shared = shared.ok_or_else(|| Refused::Bus("there is no node".to_owned()))?;
    Ok((all, funnels, Shared { expressions, ..shared }))
}

/// The table of edges, node by node, with the neighbours of each in the order in which a node has them.
fn edges_of(graph: &Graph) -> Columns {
    let mut own = vec![Own::default(); graph.nodes];
    for edge in &graph.edges {
        own[edge.a].edges += 1;
        own[edge.b].edges += 1;
    }
    let mut first = 0;
    for own in &mut own {
        own.first = first;
        first += own.edges;
    }
    let mut filled = vec![0u32; graph.nodes];
    let mut neighbours = vec![0; first as usize];
    let weight = graph.edges.first().map_or(1.0, |edge| edge.weight);
    let is_even = graph.edges.iter().all(|edge| edge.weight == weight);
    let mut weights = vec![0.0; if is_even { 0 } else { first as usize }];
    // Sorted by both ends, so that each node gets the lower neighbours first, and all ascending.
    for edge in &graph.edges {
        for (from, to) in [(edge.a, edge.b), (edge.b, edge.a)] {
            let place = (own[from].first + filled[from]) as usize;
            filled[from] += 1;
            neighbours[place] = to as u32;
            if let Some(slot) = weights.get_mut(place) {
                *slot = edge.weight;
            }
        }
    }
    let initial = Vec::with_capacity(graph.nodes);
    Columns { own, initial, neighbours, weights, weight, phasors: Vec::new(), phasor_starts: Vec::new() }
}

/// Weighted degrees as a node adds them up, of weights in f32.
fn degrees(columns: &Columns) -> Vec<f64> {
    let degree = |own: &Own| {
        let range = own.first as usize..(own.first + own.edges) as usize;
        let told = |weight: f64| f64::from(weight as f32);
        match columns.weights.get(range) {
            Some(weights) if !weights.is_empty() => {
                weights.iter().map(|&weight| told(weight)).fold(0.0, |a, b| a + b)
            }
            _ => (0..own.edges).fold(0.0, |sum, _| sum + told(columns.weight)),
        }
    };
    columns.own.iter().map(degree).collect()
}
