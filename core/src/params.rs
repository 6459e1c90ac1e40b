//! From a configuration in SI units to what the hot path needs: validated once, converted once.
//!
//! The ranges are wide enough for any bench and narrow enough that no product in the law can overflow an f32
//! (`tests/law.rs` sweeps their corners).

use crate::field::AffineSines;
use crate::funnel::Funnel;
use crate::gain::{self, BuiltinGain, LocallyLinear, Logarithmic, Reciprocal};
use crate::law::node_wise::{NodeWise, THETA};
use crate::math::Real;
use crate::neighbour::Neighbours;
use funnel_protocol::config::{
    ConfigError, ConfigField, FieldConfig, FunnelConfig, FunnelShape, GainConfig, NodeConfig, TickSource,
};
use funnel_protocol::message::NodeId;

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
/// Width, in units of the last place of the largest state, below which a funnel is not resolved (LAW.md 4, and
/// docs/notes/2026-11-23-first-light.md for why it does not depend on the degree).
pub const FLOOR_ULPS: f64 = 256.0;

/// What a node needs for a run, validated. `F` is the node's number type, `V` its vector field, `G` its gain.
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
    /// Initial state, state units.
    pub initial_state: F,
    /// States beyond this are refused, state units.
    pub state_limit: F,
    /// Own vector field.
    pub field: V,
    /// Coupling law.
    pub law: NodeWise<F, G>,
    /// Funnel.
    pub funnel: Funnel<F>,
    /// Funnel floor per unit of the largest `|x|`: `FLOOR_ULPS * epsilon * factor`, so that floored funnels
    /// keep their ratios, and with them the emergent dynamics.
    pub floor_per_state: F,
    /// Neighbour table, nobody heard yet.
    pub neighbours: Neighbours<F>,
}

impl<F: Real> Params<F> {
    /// Validates `config`.
    ///
    /// # Errors
    /// The first value outside its range, by name, with what is allowed.
    pub fn new(config: &NodeConfig) -> Result<Self, ConfigError> {
        let field = check_field(&config.field)?;
        let gain = check_gain(&config.gain)?;
        Self::with_field_and_gain(config, |tick| AffineSines::new(field, tick), gain)
    }
}

impl<F: Real, V, G: crate::Gain<F>> Params<F, V, G> {
    /// Validates `config`, with a vector field (built from `T` in s) and a gain of the user's own in place of its.
    ///
    /// # Errors
    /// The first value outside its range, by name, with what is allowed.
    pub fn with_field_and_gain(
        config: &NodeConfig,
        field: impl FnOnce(f64) -> V,
        gain: G,
    ) -> Result<Self, ConfigError> {
        let id = check_id(ConfigField::Id, 0, config.id)?;
        let tick_ns = config.tick_ns;
        check(ConfigField::Tick, 0, f64::from(tick_ns), f64::from(SHORTEST_TICK_NS), f64::from(u32::MAX))?;
        let limit = f64::from(config.state_limit);
        check(ConfigField::StateLimit, 0, limit, SMALLEST, LARGEST)?;
        check(ConfigField::InitialState, 0, f64::from(config.initial_state), -limit, limit)?;
        check_funnel(&config.funnel)?;
        let tick = f64::from(tick_ns) * 1e-9;
        let (neighbours, degree) = check_neighbours(config, id)?;
        Ok(Self {
            id,
            tick_ns: u64::from(tick_ns),
            tick: F::from_f64(tick),
            tick_source: config.tick_source,
            initial_state: F::from_f32(config.initial_state),
            state_limit: F::from_f64(limit),
            field: field(tick),
            law: NodeWise::new(gain, tick, degree),
            funnel: Funnel::new(&config.funnel, tick, THETA),
            floor_per_state: F::from_f64(FLOOR_ULPS * f64::from(config.funnel.factor)) * F::EPSILON,
            neighbours,
        })
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

fn check_field(field: &FieldConfig) -> Result<&FieldConfig, ConfigError> {
    check(ConfigField::Slope, 0, f64::from(field.slope), -LARGEST_RATE, LARGEST_RATE)?;
    check(ConfigField::Offset, 0, f64::from(field.offset), -LARGEST, LARGEST)?;
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
            BuiltinGain::Reciprocal(gain::median(eta, F::from_f32(eps)))
        }
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
    }
}

/// The neighbour table and the weighted degree `d`.
fn check_neighbours<F: Real>(config: &NodeConfig, own: NodeId) -> Result<(Neighbours<F>, f64), ConfigError> {
    let mut neighbours = Neighbours::new(u32::from(config.extrapolate_ticks));
    let mut degree = 0.0;
    for (index, edge) in config.neighbours.iter().enumerate() {
        let id = check_id(ConfigField::NeighbourId, index, edge.id)?;
        if id == own {
            return Err(ConfigError::OwnNeighbour { id: edge.id });
        }
        let weight = f64::from(edge.weight);
        check(ConfigField::Weight, index, weight, SMALLEST, LARGEST_WEIGHT)?;
        if !neighbours.add(id, F::from_f32(edge.weight)) {
            return Err(ConfigError::DuplicateNeighbour { id: edge.id });
        }
        degree += weight;
    }
    check(ConfigField::Degree, 0, degree, 0.0, LARGEST_WEIGHT)?;
    Ok((neighbours, degree))
}
