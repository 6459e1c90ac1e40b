//! From a configuration in SI units to what the hot path needs: validated once, converted once.
//!
//! The ranges are wide enough for any bench and narrow enough that no product in the law can overflow an f32
//! (`tests/law.rs` sweeps their corners).

use crate::plant::PlantSetup;
use funnelnet_law::collect::collect;
use funnelnet_law::field::{AffineSines, State};
use funnelnet_law::floor::Floor;
use funnelnet_law::funnel::Funnel;
use funnelnet_law::gain::{self, BuiltinGain, Linear, LocallyLinear, Logarithmic, Reciprocal};
use funnelnet_law::law::node_wise::{NodeWise, THETA};
use funnelnet_law::law::{Coupling, EdgeWise, LambdaTracker};
use funnelnet_law::math::Real;
use funnelnet_protocol::config::{
    BreachPolicy, ConfigError, ConfigField, CouplingConfig, FieldConfig, FunnelConfig, FunnelShape,
    GainConfig, MAX_COMPONENTS, MAX_NEIGHBOURS, NodeConfig, NormalisedShape, TickSource,
};
use funnelnet_protocol::message::NodeId;

/// Largest state, input and funnel scale, state units.
pub const LARGEST: f64 = 1e9;
/// Smallest positive scale.
pub const SMALLEST: f64 = 1e-9;
/// Largest edge weight and weighted degree.
pub const LARGEST_WEIGHT: f64 = 1e6;
/// Largest slope of a field (1/s), frequency (rad/s) and rate of a funnel (1/s).
pub const LARGEST_RATE: f64 = 1e6;
/// Largest phase of a sinusoid, rad.
pub const LARGEST_PHASE: f64 = 1e6;
/// Shortest tick period, ns.
pub const SHORTEST_TICK_NS: u32 = 10_000;

/// What a node needs for a run beside its edges, validated with them. `F` is the node's number type, `V` its vector field, `G` its gain.
///
/// The edges stay in the configuration until [`Node`](crate::Node) makes its table of them, in place: 126 of them are 4.5 KiB, and each copy is
/// stack.
#[derive(Clone, Debug)]
pub struct Params<F, V = AffineSines<F>, G = BuiltinGain<F>> {
    /// Own id.
    pub id: NodeId,
    /// Tick period, ns.
    pub tick_ns: u64,
    /// Tick period `T`, s.
    pub tick: F,
    /// What makes the node tick.
    pub tick_source: TickSource,
    /// Initial state, state units, 1 to 8 components.
    pub initial_state: State<F>,
    /// States beyond this are refused, state units.
    pub state_limit: F,
    /// Own vector field.
    pub field: V,
    /// Which law makes inputs.
    pub coupling: Coupling<F>,
    /// Gain and step (*) of the node.
    pub law: NodeWise<F, G>,
    /// Funnel.
    pub funnel: Funnel<F>,
    /// What rounding leaves of the funnel.
    pub floor: Floor<F>,
    /// What to do outside the funnel.
    pub on_breach: OnBreach<F>,
    /// Ticks for which a silent neighbour is extrapolated before its edge is dropped.
    pub extrapolate_ticks: u32,
    /// The plant; a virtual node has none.
    pub plant: Option<PlantSetup>,
    /// So many neighbours lost at the same time stop the node; 0 never does.
    pub lost_neighbours: u8,
    /// How long a running node goes on without a SYNC that it waits for, ns; `None`: for ever.
    pub holdover_ns: Option<u64>,
}

/// A breach policy, prepared.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum OnBreach<F> {
    /// See [`BreachPolicy::Ride`].
    Ride,
    /// See [`BreachPolicy::Reopen`].
    Reopen {
        /// Width over `|nu|` right after.
        margin: F,
        /// `exp(-rate T)`.
        decay: F,
        /// `exp(-rate theta T)`.
        partial_decay: F,
    },
    /// See [`BreachPolicy::Stop`].
    Stop,
}

impl<F: Real> Params<F> {
    /// Validates `config`.
    ///
    /// # Errors
    /// The first value outside its range, by name, with what is allowed.
    pub fn new(config: &NodeConfig) -> Result<Self, ConfigError> {
        Self::with_field(config, |tick| affine_field(config, tick))
    }
}

/// Validates the field of `config` and prepares it for tick period `tick` (s).
///
/// # Errors
/// The first value outside its range, by name, with what is allowed.
pub fn affine_field<F: Real>(config: &NodeConfig, tick: f64) -> Result<AffineSines<F>, ConfigError> {
    check_components(config)?;
    check_field(&config.field).map(|field| AffineSines::new(field, tick))
}

impl<F: Real, V> Params<F, V> {
    /// Validates `config`, with a vector field of the user's own, built from `T` in s, in place of its.
    ///
    /// # Errors
    /// The first value outside its range, by name, with what is allowed.
    pub fn with_field(
        config: &NodeConfig,
        field: impl FnOnce(f64) -> Result<V, ConfigError>,
    ) -> Result<Self, ConfigError> {
        let gain = check_gain(&config.gain)?;
        check_gain_of_coupling(&config.gain, &config.coupling)?;
        Self::with_field_and_gain(config, field, gain)
    }
}

impl<F: Real, V, G: funnelnet_law::Gain<F>> Params<F, V, G> {
    /// Validates `config`, with a vector field (built from `T` in s) and a gain of the user's own in place of its. The node is
    /// virtual until it is given a plant.
    ///
    /// # Errors
    /// The first value outside its range, by name, with what is allowed.
    pub fn with_field_and_gain(
        config: &NodeConfig,
        field: impl FnOnce(f64) -> Result<V, ConfigError>,
        gain: G,
    ) -> Result<Self, ConfigError> {
        let id = check_id(ConfigField::Id, 0, config.id)?;
        let tick_ns = config.tick_ns;
        check(ConfigField::Tick, 0, f64::from(tick_ns), f64::from(SHORTEST_TICK_NS), f64::from(u32::MAX))?;
        let limit = f64::from(config.state_limit);
        check(ConfigField::StateLimit, 0, limit, SMALLEST, LARGEST)?;
        check_components(config)?;
        for (index, &x) in config.initial_state.iter().enumerate() {
            check(ConfigField::InitialState, index, f64::from(x), -limit, limit)?;
        }
        check_funnel(&config.funnel)?;
        let tick = f64::from(tick_ns) * 1e-9;
        let degree = check_neighbours(config, id)?;
        Ok(Self {
            id,
            tick_ns: u64::from(tick_ns),
            tick: F::from_f64(tick),
            tick_source: config.tick_source,
            initial_state: collect(config.initial_state.iter().map(|&x| F::from_f32(x))),
            state_limit: F::from_f64(limit),
            field: field(tick)?,
            coupling: check_coupling(&config.coupling, tick)?,
            law: NodeWise::new(gain, tick, degree),
            funnel: Funnel::new(&config.funnel, tick, THETA),
            floor: Floor::new(degree, tick),
            on_breach: check_policy(&config.on_breach, &config.coupling, tick)?,
            extrapolate_ticks: config.extrapolate_ticks.into(),
            plant: None,
            lost_neighbours: config.lost_neighbours,
            holdover_ns: check_holdover(config)?,
        })
    }

    /// The node measures and drives this plant.
    ///
    /// # Errors
    /// The plant has another number of components than the state.
    pub fn with_plant(mut self, plant: PlantSetup) -> Result<Self, ConfigError> {
        self.set_plant(plant).map(|()| self)
    }

    pub(crate) fn set_plant(&mut self, plant: PlantSetup) -> Result<(), ConfigError> {
        let components = plant.inputs.len() as f64;
        check(ConfigField::Components, 0, self.initial_state.len() as f64, components, components)?;
        self.plant = Some(plant);
        Ok(())
    }
}

fn check(field: ConfigField, index: usize, found: f64, low: f64, high: f64) -> Result<(), ConfigError> {
    // Most values travel as f32, where 1e-9 is a little less. Written so that NaN is outside.
    if found >= f64::from(low as f32) && found <= high {
        Ok(())
    } else {
        Err(ConfigError::OutOfRange { field, index: index as u8, found, low, high })
    }
}

fn check_id(field: ConfigField, index: usize, id: u8) -> Result<NodeId, ConfigError> {
    let (low, high) = (1.0, f64::from(NodeId::MAX));
    NodeId::new(id).ok_or(ConfigError::OutOfRange {
        field,
        index: index as u8,
        found: f64::from(id),
        low,
        high,
    })
}

/// A tick has to fit in. Only a node that ticks by SYNC can miss one.
fn check_holdover(config: &NodeConfig) -> Result<Option<u64>, ConfigError> {
    let holdover_ns = config.holdover_ns;
    if holdover_ns == 0 {
        return Ok(None);
    }
    check(ConfigField::Holdover, 0, holdover_ns as f64, f64::from(config.tick_ns), 1e18)?;
    Ok((config.tick_source == TickSource::Sync).then_some(holdover_ns))
}

/// The number of components, and what has to fit it.
fn check_components(config: &NodeConfig) -> Result<(), ConfigError> {
    let n = config.initial_state.len();
    let whole =
        |field, found: usize, low: usize, high: usize| check(field, 0, found as f64, low as f64, high as f64);
    whole(ConfigField::Components, n, 1, MAX_COMPONENTS)?;
    whole(ConfigField::Entries, config.neighbours.len() * n, 0, MAX_NEIGHBOURS)?;
    whole(ConfigField::Offsets, config.field.offset.len(), n, n)?;
    if config.field.slope.len() != 1 {
        whole(ConfigField::Matrix, config.field.slope.len(), n * n, n * n)?;
    }
    for (index, sine) in config.field.sines.iter().enumerate() {
        check(ConfigField::SineComponent, index, f64::from(sine.component), 0.0, (n - 1) as f64)?;
    }
    Ok(())
}

fn check_field(field: &FieldConfig) -> Result<&FieldConfig, ConfigError> {
    for (index, &slope) in field.slope.iter().enumerate() {
        check(ConfigField::Slope, index, f64::from(slope), -LARGEST_RATE, LARGEST_RATE)?;
    }
    for (index, &offset) in field.offset.iter().enumerate() {
        check(ConfigField::Offset, index, f64::from(offset), -LARGEST, LARGEST)?;
    }
    for (index, sine) in field.sines.iter().enumerate() {
        check(ConfigField::SineAmplitude, index, f64::from(sine.amplitude), -LARGEST, LARGEST)?;
        check(ConfigField::SineFrequency, index, sine.frequency, -LARGEST_RATE, LARGEST_RATE)?;
        check(ConfigField::SinePhase, index, sine.phase, -LARGEST_PHASE, LARGEST_PHASE)?;
    }
    Ok(field)
}

fn check_gain<F: Real>(gain: &GainConfig) -> Result<BuiltinGain<F>, ConfigError> {
    let positive =
        |field, value: f32| check(field, 0, f64::from(value), SMALLEST, LARGEST).map(|()| F::from_f32(value));
    Ok(match *gain {
        GainConfig::Reciprocal { scale } => {
            BuiltinGain::Reciprocal(Reciprocal { scale: positive(ConfigField::GainScale, scale)? })
        }
        GainConfig::Logarithmic { scale } => {
            BuiltinGain::Logarithmic(Logarithmic { scale: positive(ConfigField::GainScale, scale)? })
        }
        GainConfig::LocallyLinear { bound } => {
            BuiltinGain::LocallyLinear(LocallyLinear { bound: positive(ConfigField::GainBound, bound)? })
        }
        GainConfig::Median { eta, eps } => {
            let eta = positive(ConfigField::GainEta, eta)?;
            check(ConfigField::GainEps, 0, f64::from(eps), SMALLEST, 0.9999)?;
            let gain = gain::median(eta, F::from_f32(eps));
            // The scale that the two come to; beyond, a square in the closed form overflows an f32.
            check(ConfigField::GainScale, 0, gain.scale.to_f64(), 0.0, LARGEST)?;
            BuiltinGain::Reciprocal(gain)
        }
        GainConfig::Linear { slope } => {
            BuiltinGain::Linear(Linear { slope: positive(ConfigField::GainSlope, slope)? })
        }
    })
}

/// A tracker starts from a linear gain, and funnels that are not node-wise need a gain that grows without bound.
fn check_gain_of_coupling(gain: &GainConfig, coupling: &CouplingConfig) -> Result<(), ConfigError> {
    let linear = matches!(gain, GainConfig::Linear { .. });
    let fits = match coupling {
        CouplingConfig::NodeWise | CouplingConfig::None => true,
        CouplingConfig::MaxGain | CouplingConfig::EdgeWise => !linear,
        CouplingConfig::LambdaTracker { .. } => linear,
    };
    if fits { Ok(()) } else { Err(ConfigError::GainOfCoupling) }
}

fn check_coupling<F: Real>(coupling: &CouplingConfig, tick: f64) -> Result<Coupling<F>, ConfigError> {
    Ok(match *coupling {
        CouplingConfig::NodeWise => Coupling::NodeWise,
        CouplingConfig::MaxGain => Coupling::MaxGain,
        CouplingConfig::EdgeWise => Coupling::EdgeWise(EdgeWise::new(tick, THETA)),
        CouplingConfig::LambdaTracker { eta } => {
            check(ConfigField::Eta, 0, f64::from(eta), 0.0, LARGEST)?;
            Coupling::LambdaTracker(LambdaTracker::new(F::from_f32(eta), tick))
        }
        CouplingConfig::None => Coupling::None,
    })
}

fn check_policy<F: Real>(
    policy: &BreachPolicy,
    coupling: &CouplingConfig,
    tick: f64,
) -> Result<OnBreach<F>, ConfigError> {
    Ok(match *policy {
        BreachPolicy::Ride => OnBreach::Ride,
        // The other end of an edge would not know of it.
        BreachPolicy::Reopen { .. } if *coupling == CouplingConfig::EdgeWise => {
            return Err(ConfigError::PolicyOfCoupling);
        }
        BreachPolicy::Reopen { margin, rate } => {
            check(ConfigField::BreachMargin, 0, f64::from(margin), 1.001, LARGEST)?;
            check(ConfigField::BreachRate, 0, f64::from(rate), 0.0, LARGEST_RATE)?;
            let decay = |share: f64| F::from_f64(Real::exp(-f64::from(rate) * share * tick));
            OnBreach::Reopen { margin: F::from_f32(margin), decay: decay(1.0), partial_decay: decay(THETA) }
        }
        BreachPolicy::Stop => OnBreach::Stop,
    })
}

fn check_funnel(funnel: &FunnelConfig) -> Result<(), ConfigError> {
    check(ConfigField::FunnelFactor, 0, f64::from(funnel.factor), SMALLEST, LARGEST)?;
    match funnel.shape {
        FunnelShape::Exponential { start, end, rate } => {
            check(ConfigField::FunnelStart, 0, f64::from(start), SMALLEST, LARGEST)?;
            check(ConfigField::FunnelEnd, 0, f64::from(end), 0.0, LARGEST)?;
            check(ConfigField::FunnelRate, 0, f64::from(rate), 0.0, LARGEST_RATE)
        }
        FunnelShape::Constant { width } => {
            check(ConfigField::FunnelWidth, 0, f64::from(width), SMALLEST, LARGEST)
        }
        FunnelShape::ReciprocalTime { scale } => {
            check(ConfigField::FunnelScale, 0, f64::from(scale), SMALLEST, LARGEST)
        }
        FunnelShape::FiniteTime { start, at_ns, power } => {
            check(ConfigField::FunnelStart, 0, f64::from(start), SMALLEST, LARGEST)?;
            check(ConfigField::FunnelAt, 0, at_ns as f64, 1.0, 1e18)?;
            check(ConfigField::FunnelPower, 0, f64::from(power), 0.09, 10.1)
        }
        FunnelShape::Schedule { start, at_ns, eps, then } => {
            check(ConfigField::FunnelStart, 0, f64::from(start), SMALLEST, LARGEST)?;
            check(ConfigField::FunnelAt, 0, at_ns as f64, 1.0, 1e18)?;
            check(ConfigField::FunnelEps, 0, f64::from(eps), SMALLEST, 1.0)?;
            match then {
                NormalisedShape::Constant { width } => {
                    check(ConfigField::FunnelWidth, 0, f64::from(width), SMALLEST, LARGEST)
                }
                NormalisedShape::Exponential { start, end, rate } => {
                    check(ConfigField::FunnelStart, 1, f64::from(start), SMALLEST, LARGEST)?;
                    check(ConfigField::FunnelEnd, 1, f64::from(end), 0.0, LARGEST)?;
                    check(ConfigField::FunnelRate, 1, f64::from(rate), 0.0, LARGEST_RATE)
                }
            }
        }
    }
}

/// The weighted degree `d`.
fn check_neighbours(config: &NodeConfig, own: NodeId) -> Result<f64, ConfigError> {
    let mut listed = [false; NodeId::MAX as usize + 1];
    let mut degree = 0.0;
    for (index, edge) in config.neighbours.iter().enumerate() {
        let id = check_id(ConfigField::NeighbourId, index, edge.id)?;
        if id == own {
            return Err(ConfigError::OwnNeighbour { id: edge.id });
        }
        let weight = f64::from(edge.weight);
        check(ConfigField::Weight, index, weight, SMALLEST, LARGEST_WEIGHT)?;
        if config.coupling == CouplingConfig::EdgeWise {
            check(ConfigField::NeighbourEdges, index, f64::from(edge.edges), 1.0, MAX_NEIGHBOURS as f64)?;
        }
        let listed = listed.get_mut(usize::from(edge.id));
        if listed.is_none_or(|listed| core::mem::replace(listed, true)) {
            return Err(ConfigError::DuplicateNeighbour { id: edge.id });
        }
        degree += weight;
    }
    check(ConfigField::Degree, 0, degree, 0.0, LARGEST_WEIGHT)?;
    Ok(degree)
}
