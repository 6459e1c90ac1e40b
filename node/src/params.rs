//! From a configuration in SI units to what the hot path needs: validated once, converted once.
//!
//! The ranges are wide enough for any bench and narrow enough that no product in the law can overflow an f32
//! (`tests/law.rs` sweeps their corners).

use crate::plant::{InputRange, PlantSetup};
use crate::time::largest_jitter;
use funnelnet_law::collect::collect;
use funnelnet_law::field::{AffineSines, Inputs, NoInputs, PreparedField, State, Stride, VectorField};
use funnelnet_law::floor::Floor;
use funnelnet_law::funnel::{GROWN_AFTER, Guard, SampledFunnel, Widths};
use funnelnet_law::gain::GainFunction;
use funnelnet_law::law::node_wise::{Constants, NodeWise, THETA};
use funnelnet_law::law::{EdgeWise, LambdaTracker, Law};
use funnelnet_law::math::Real;
use funnelnet_law::program::Part;
use funnelnet_law::start::{PARTS, Pace, SlowStart};
use funnelnet_protocol::config::{
    Breach, ConfigError, ConfigField, Coupling, Field, Funnel, Gain, HeardLimits, Limits, MAX_COMPONENTS,
    MAX_NEIGHBOURS, NodeConfig, Normalised, Shape, TickSource, TimeRules, Tuning,
};
use funnelnet_protocol::message::NodeId;

pub use funnelnet_law::range::{
    DAMPING, LARGEST, LARGEST_PHASE, LARGEST_RATE, LARGEST_WEIGHT, LONGEST_ROUND, LONGEST_SLOW_START,
    SHORTEST_TICK_NS, SMALLEST, WIDEST_GUARD,
};

/// Longest time from one SYNC of a time master to the next, unless a tick is longer, us.
const LONGEST_SYNC_PERIOD_US: f64 = 1e7;
/// Largest jitter of the stamps of SYNC, us.
const LARGEST_SYNC_JITTER_US: f64 = 1e6;

/// Ticks for which a newcomer waits at most: neighbours that are apart come together in a second or never.
pub const NEWCOMER_PATIENCE: u16 = 500;

/// Parameters of a node for a run, apart from its edges, with which they are validated. `F` is the node's
/// number type, `V` its vector field, `G` its gain.
///
/// The edges stay in the configuration until [`Node`](crate::Node) makes its table of them, in place: 126 of
/// them are 4.5 KiB, and each copy is stack.
#[derive(Clone, Debug)]
pub struct Params<F, V = PreparedField<F>, G = Gain<F>> {
    /// Id of the node.
    pub id: NodeId,
    /// Period of the law, ns: a round of one tick or more.
    pub tick_ns: u64,
    /// Tick period `T`, s, of the own field.
    pub tick: F,
    /// Ticks in a round.
    pub round: u8,
    /// The slow start. With one, the field is prepared for an eighth of a tick.
    pub start: SlowStart,
    /// Source of the node's ticks.
    pub tick_source: TickSource,
    /// Initial state, state units, 1 to 8 components.
    pub initial_state: State<F>,
    /// States beyond this are refused, state units.
    pub state_limit: F,
    /// Own vector field.
    pub field: V,
    /// Law that makes the inputs.
    pub coupling: Law<F>,
    /// Gain and step (**) of the node.
    pub law: NodeWise<F, G>,
    /// Funnel.
    pub funnel: SampledFunnel<F>,
    /// Part of the funnel at its edge that the law leaves alone.
    pub guard: Guard<F>,
    /// The largest `|u|`, state units / s.
    pub input_limit: F,
    /// Limits of the actuator, where they are given.
    pub limits: Option<InputRange>,
    /// The largest change of an extrapolated neighbour in a round, state units.
    pub slope_limit: F,
    /// Limits of what is taken of neighbours' states.
    pub heard: HeardRange<F>,
    /// Floor of the funnel, below which rounding leaves nothing of it.
    pub floor: Floor<F>,
    /// Policy outside the funnel.
    pub on_breach: OnBreach<F>,
    /// Ticks for which a silent neighbour is extrapolated before its edge is dropped.
    pub extrapolate_ticks: u32,
    /// Ticks for which a newcomer without a plant that could speak waits for a time at which it moves no
    /// neighbour's term by much (law.md 9).
    pub newcomer_patience: u16,
    /// The plant; a virtual node has none.
    pub plant: Option<PlantSetup>,
    /// Number of neighbours that stop the node when they are lost at the same time; 0: none does.
    pub lost_neighbours: u8,
    /// Time for which a running node goes on without the SYNC that it waits for, ns; `None`: for ever.
    pub holdover_ns: Option<u64>,
}

/// Limits of what is taken of neighbours' states, prepared.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct HeardRange<F> {
    /// The largest `|x|`, state units.
    pub limit: F,
    /// The largest change in a round, state units.
    pub change: F,
    /// Values in a row, not taken, that bar an edge; 0: none do.
    pub drop_after: u8,
}

impl<F: Real> HeardRange<F> {
    /// Whether what a neighbour says is held against what it has said before.
    pub(crate) fn remembers(&self) -> bool {
        self.drop_after != 0 || self.change < F::WIDEST
    }
}

/// A breach policy, prepared.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum OnBreach<F> {
    /// See [`Breach::Ride`].
    Ride,
    /// See [`Breach::Reopen`].
    Reopen {
        /// Width over `|nu|` right after.
        margin: F,
        /// `exp(-rate T)`.
        decay: F,
        /// `exp(-rate theta T)`.
        partial_decay: F,
    },
    /// See [`Breach::Stop`].
    Stop,
}

impl<F: Real> Params<F> {
    /// Validates `config` and prepares it.
    ///
    /// # Errors
    /// The first value outside its range, by name, with what is allowed.
    pub fn new(config: &NodeConfig) -> Result<Self, ConfigError> {
        Self::with_field(config, |tick| prepared_field(config, tick))
    }
}

/// Validates the field of `config`, of whatever kind, and prepares it for tick period `tick` (s).
///
/// # Errors
/// The first value outside its range, by name, with what is allowed; a field that is not finite at the start.
pub fn prepared_field<F: Real>(config: &NodeConfig, tick: f64) -> Result<PreparedField<F>, ConfigError> {
    field_with_inputs(config, tick, 0, NoInputs)
}

/// Prepares the field for a simulation, where a program may name the first `count` of these inputs from
/// outside.
///
/// # Errors
/// As for [`prepared_field`].
pub fn field_with_inputs<F: Real, I: Inputs<F>>(
    config: &NodeConfig,
    tick: f64,
    count: usize,
    inputs: I,
) -> Result<PreparedField<F, I>, ConfigError> {
    check_components(config)?;
    let field = check_field(&config.field)?;
    if !config.program.is_empty() {
        check_program(config, count)?;
    }
    let prepared = PreparedField::with_inputs(field, &config.program, tick, inputs);
    check_finite_at_start(config, &prepared)?;
    Ok(prepared)
}

/// Prepares the affine part of the field with its sinusoids, and leaves a program aside.
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

impl<F: Real, V, G: GainFunction<F>> Params<F, V, G> {
    /// Validates `config`, with a vector field (built from the time in s of two of its half ticks: `T`, or an
    /// eighth of it with a slow start) and a gain of the user's own in place of its. The node is virtual
    /// until it is given a plant.
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
        check_tuning(&config.tuning, &config.heard)?;
        check_time(config)?;
        let (tick, period) = (f64::from(tick_ns) * 1e-9, config.period_ns() as f64 * 1e-9);
        let start = check_start(&config.tuning, &config.coupling)?;
        let (shortest, grown_after) = match start.is_none() {
            true => (tick, GROWN_AFTER),
            false => (tick / f64::from(PARTS), start.slow_ticks()),
        };
        let constants = constants(&config.tuning);
        let degree = check_neighbours(config, id)?;
        Ok(Self {
            id,
            tick_ns: config.period_ns(),
            tick: F::from_f64(tick),
            round: config.tuning.ticks_in_round(),
            start,
            tick_source: config.tick_source,
            initial_state: collect(config.initial_state.iter().map(|&x| F::from_f32(x))),
            state_limit: F::from_f64(limit),
            field: field(shortest)?,
            coupling: check_coupling(&config.coupling, period, constants)?,
            law: NodeWise::with(gain, period, degree, constants),
            funnel: SampledFunnel::new(&config.funnel, period, THETA),
            guard: Guard::grown_over(config.tuning.guard.into(), grown_after),
            input_limit: limit_or_none(config.tuning.input_limit, 1.0),
            limits: check_limits(&config.limits)?,
            slope_limit: limit_or_none(config.tuning.slope_limit, period),
            heard: HeardRange {
                // As for the own state, or less.
                limit: limit_or_none::<F>(config.heard.limit, 1.0).min(F::from_f64(limit)),
                change: limit_or_none(config.heard.rate, period),
                drop_after: config.heard.drop_after,
            },
            floor: Floor::new(degree, period),
            on_breach: check_policy(&config.on_breach, &config.coupling, period)?,
            extrapolate_ticks: config.extrapolate_ticks.into(),
            newcomer_patience: NEWCOMER_PATIENCE,
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
        // A plant has its own time.
        check(ConfigField::SlowStart, 0, self.start.ticks().into(), 0.0, 0.0)?;
        self.plant = Some(plant);
        // What is measured does not follow from the inputs to the last digit (law.md 3).
        self.law.stop_looking_back();
        if let Law::EdgeWise(law) = &mut self.coupling {
            law.stop_looking_back();
        }
        Ok(())
    }
}

impl<F: Real, V, G: GainFunction<F>> Params<F, V, G> {
    /// Gives the laws the constants of a pace.
    #[cold]
    pub(crate) fn keep_pace(&mut self, pace: Pace) {
        self.law.keep_pace(pace);
        if let Law::EdgeWise(law) = &mut self.coupling {
            law.keep_pace(pace);
        }
    }

    /// The funnel at tick `k`.
    #[inline]
    pub(crate) fn widths(&self, k: u32) -> Widths<F> {
        if self.start.is_none() { self.funnel.widths(k) } else { self.widths_after_start(k) }
    }

    #[cold]
    fn widths_after_start(&self, k: u32) -> Widths<F> {
        let start = self.start;
        match start.pace(k) {
            Pace::Slow => self.funnel.widths_of_start(k, PARTS),
            Pace::Damped => self.funnel.widths_of_start(start.network_tick(k), 1),
            Pace::Usual => self.funnel.widths(start.network_tick(k)),
        }
    }

    /// The steps of the field in tick `k`, and the time of the first one in half ticks of the field.
    #[inline]
    pub(crate) fn steps(&self, k: u32) -> (Stride<F>, u64) {
        let steps = u64::from(self.round);
        match self.start.is_none() {
            true => (Stride { tick: self.tick, half: 1 }, (u64::from(k) * steps) << 1),
            false => self.steps_after_start(k),
        }
    }

    #[cold]
    fn steps_after_start(&self, k: u32) -> (Stride<F>, u64) {
        let from = 2 * u64::from(self.round) * self.start.eighths(k.into());
        let stride = match self.start.pace(k) {
            Pace::Slow => Stride { tick: self.tick / F::from_u32(PARTS), half: 1 },
            Pace::Damped | Pace::Usual => Stride { tick: self.tick, half: PARTS.into() },
        };
        (stride, from)
    }
}

fn check(field: ConfigField, index: usize, found: f64, low: f64, high: f64) -> Result<(), ConfigError> {
    // Most values travel as f32, where 1e-9 is a little less, and 0.999 a little more. Written so that NaN is
    // outside.
    if found >= f64::from(low as f32) && (found <= high || found <= f64::from(high as f32)) {
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

/// The largest value, for so many seconds, and none where it is zero.
fn limit_or_none<F: Real>(limit: f32, seconds: f64) -> F {
    if limit == 0.0 { F::WIDEST } else { F::from_f64(f64::from(limit) * seconds) }
}

fn check_tuning(tuning: &Tuning, heard: &HeardLimits) -> Result<(), ConfigError> {
    let Tuning { damping, guard, round, input_limit, slope_limit, slow_start } = *tuning;
    let told = [
        (ConfigField::Damping, damping, DAMPING),
        (ConfigField::Guard, guard, (0.0, WIDEST_GUARD)),
        (ConfigField::Round, f32::from(round), (1.0, f64::from(LONGEST_ROUND))),
        (ConfigField::InputLimit, input_limit, (SMALLEST, LARGEST)),
        (ConfigField::SlopeLimit, slope_limit, (SMALLEST, LARGEST)),
        (ConfigField::SlowStart, f32::from(slow_start), (1.0, f64::from(LONGEST_SLOW_START))),
        (ConfigField::HeardLimit, heard.limit, (SMALLEST, LARGEST)),
        (ConfigField::HeardRate, heard.rate, (SMALLEST, LARGEST)),
    ];
    // A zero is what was not said.
    let mut said = told.into_iter().filter(|(_, value, _)| *value != 0.0);
    said.try_for_each(|(field, value, (low, high))| check(field, 0, value.into(), low, high))
}

/// Only timers can keep a time, and a period has ticks.
#[inline(never)]
fn check_time(config: &NodeConfig) -> Result<(), ConfigError> {
    let TimeRules { period_us, jitter_us, .. } = config.time;
    if config.time.is_none() {
        return Ok(());
    }
    if config.tick_source != TickSource::Timer {
        return Err(ConfigError::TimeOfTicks);
    }
    // One of them at least, and 0 is a host.
    let first = config.time.masters().next().unwrap_or(0);
    check(ConfigField::SyncMasters, 0, first.into(), 1.0, f64::from(NodeId::MAX))?;
    let tick_us = (config.period_ns() as f64 / 1e3).max(1.0);
    check(ConfigField::SyncPeriod, 0, period_us.into(), tick_us, LONGEST_SYNC_PERIOD_US.max(tick_us))?;
    // Beyond it a node would leave out SYNC that have come as they should.
    let largest = largest_jitter(u64::from(period_us) * 1_000, config.period_ns()) / 1_000;
    check(ConfigField::SyncJitter, 0, jitter_us.into(), 0.0, LARGEST_SYNC_JITTER_US.min(largest as f64))
}

/// A tracker has no funnel to be kept.
fn check_start(tuning: &Tuning, coupling: &Coupling<f32>) -> Result<SlowStart, ConfigError> {
    if let Coupling::LambdaTracker { .. } | Coupling::WeaklyCentralised = coupling {
        check(ConfigField::SlowStart, 0, tuning.slow_start.into(), 0.0, 0.0)?;
    }
    Ok(SlowStart::new(tuning.slow_start))
}

fn constants(tuning: &Tuning) -> Constants {
    if tuning.damping == 0.0 { Constants::default() } else { Constants::damped_by(tuning.damping.into()) }
}

/// A tick has to fit in. Only a node that ticks by SYNC can miss one.
fn check_holdover(config: &NodeConfig) -> Result<Option<u64>, ConfigError> {
    let holdover_ns = config.holdover_ns;
    if holdover_ns == 0 {
        return Ok(None);
    }
    check(ConfigField::Holdover, 0, holdover_ns as f64, config.period_ns() as f64, 1e18)?;
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

fn check_field(field: &Field<f32>) -> Result<&Field<f32>, ConfigError> {
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

/// A program is the whole field: nothing else may be left in the configuration for it to be taken for.
fn check_program(config: &NodeConfig, inputs: usize) -> Result<(), ConfigError> {
    let field = &config.field;
    check(ConfigField::Matrix, 0, field.slope.len() as f64, 1.0, 1.0)?;
    for &slope in &field.slope {
        check(ConfigField::Slope, 0, f64::from(slope), 0.0, 0.0)?;
    }
    for (index, &offset) in field.offset.iter().enumerate() {
        check(ConfigField::Offset, index, f64::from(offset), 0.0, 0.0)?;
    }
    let checked = config.program.check(config.initial_state.len(), field.sines.len(), inputs);
    checked.map_err(|bad| ConfigError::OutOfRange {
        field: program_field(bad.part),
        index: bad.at as u8,
        found: bad.found,
        low: bad.low,
        high: bad.high,
    })
}

/// The field that an error about a part of a program names.
fn program_field(part: Part) -> ConfigField {
    match part {
        Part::Constant | Part::Value => ConfigField::ProgramConstant,
        Part::State => ConfigField::ProgramState,
        Part::Wave => ConfigField::ProgramWave,
        Part::Input => ConfigField::ProgramInput,
        Part::Stack => ConfigField::ProgramStack,
        Part::Components => ConfigField::ProgramComponents,
        _ => ConfigField::Operation,
    }
}

/// A field that is not finite at the start would stop the node at its first tick.
fn check_finite_at_start<F: Real>(
    config: &NodeConfig,
    field: &impl VectorField<F>,
) -> Result<(), ConfigError> {
    let start: State<F> = collect(config.initial_state.iter().map(|&x| F::from_f32(x)));
    let largest = f64::from(f32::MAX);
    (0..start.len()).try_for_each(|index| {
        let found = field.component(0, &start, index).to_f64();
        check(ConfigField::FieldAtStart, index, found, -largest, largest)
    })
}

fn check_limits(limits: &Limits) -> Result<Option<InputRange>, ConfigError> {
    if limits.is_none() {
        return Ok(None);
    }
    let Limits { low, high } = *limits;
    check(ConfigField::LimitLow, 0, low.into(), -LARGEST, 0.0)?;
    check(ConfigField::LimitHigh, 0, high.into(), 0.0, LARGEST)?;
    Ok(InputRange::new(low, high).ok())
}

fn check_gain<F: Real>(gain: &Gain<f32>) -> Result<Gain<F>, ConfigError> {
    for (parameter, value) in gain.parameters() {
        let (low, high) = parameter.allowed.on_node();
        check(gain_field(parameter.name), 0, f64::from(value), low, high)?;
    }
    let prepared = gain.map(F::from_f32).prepared();
    // What the parameters come to together; beyond, a square in the closed form overflows an f32.
    for (parameter, value) in prepared.parameters() {
        check(gain_field(parameter.name), 0, value.to_f64(), 0.0, parameter.allowed.on_node().1)?;
    }
    Ok(prepared)
}

/// The field that an error about a gain's parameter names.
fn gain_field(parameter: &str) -> ConfigField {
    match parameter {
        "bound" => ConfigField::GainBound,
        "eta" => ConfigField::GainEta,
        "eps" => ConfigField::GainEps,
        "slope" => ConfigField::GainSlope,
        _ => ConfigField::GainScale,
    }
}

/// A tracker starts from a linear gain, and funnels that are not node-wise need a gain that grows without
/// bound.
fn check_gain_of_coupling(gain: &Gain<f32>, coupling: &Coupling<f32>) -> Result<(), ConfigError> {
    let linear = !gain.keeps_funnels();
    let fits = match coupling {
        Coupling::NodeWise | Coupling::ElementWise | Coupling::None | Coupling::WeaklyCentralised => true,
        Coupling::MaxGain | Coupling::EdgeWise => !linear,
        Coupling::Linear | Coupling::LambdaTracker { .. } => linear,
    };
    if fits { Ok(()) } else { Err(ConfigError::GainOfCoupling) }
}

fn check_coupling<F: Real>(
    coupling: &Coupling<f32>,
    tick: f64,
    constants: Constants,
) -> Result<Law<F>, ConfigError> {
    Ok(match *coupling {
        Coupling::NodeWise | Coupling::ElementWise | Coupling::Linear => Law::NodeWise,
        Coupling::MaxGain => Law::MaxGain,
        Coupling::EdgeWise => Law::EdgeWise(EdgeWise::new(tick, constants)),
        Coupling::LambdaTracker { eta } => {
            check(ConfigField::Eta, 0, f64::from(eta), 0.0, LARGEST)?;
            Law::LambdaTracker(LambdaTracker::new(F::from_f32(eta), tick))
        }
        Coupling::None => Law::None,
        Coupling::WeaklyCentralised => return Err(ConfigError::NotLocal),
    })
}

fn check_policy<F: Real>(
    policy: &Breach<f32>,
    coupling: &Coupling<f32>,
    tick: f64,
) -> Result<OnBreach<F>, ConfigError> {
    Ok(match *policy {
        Breach::Ride => OnBreach::Ride,
        // The other end of an edge would not know of it.
        Breach::Reopen { .. } if *coupling == Coupling::EdgeWise => {
            return Err(ConfigError::PolicyOfCoupling);
        }
        Breach::Reopen { margin, rate } => {
            check(ConfigField::BreachMargin, 0, f64::from(margin), 1.001, LARGEST)?;
            check(ConfigField::BreachRate, 0, f64::from(rate), 0.0, LARGEST_RATE)?;
            let decay = |share: f64| F::from_f64(Real::exp(-f64::from(rate) * share * tick));
            OnBreach::Reopen { margin: F::from_f32(margin), decay: decay(1.0), partial_decay: decay(THETA) }
        }
        Breach::Stop => OnBreach::Stop,
    })
}

fn check_funnel(funnel: &Funnel<f32>) -> Result<(), ConfigError> {
    check(ConfigField::FunnelFactor, 0, f64::from(funnel.factor), SMALLEST, LARGEST)?;
    match funnel.shape {
        Shape::Exponential { start, end, rate } => {
            check(ConfigField::FunnelStart, 0, f64::from(start), SMALLEST, LARGEST)?;
            check(ConfigField::FunnelEnd, 0, f64::from(end), 0.0, LARGEST)?;
            check(ConfigField::FunnelRate, 0, f64::from(rate), 0.0, LARGEST_RATE)
        }
        Shape::Constant { width } => check(ConfigField::FunnelWidth, 0, f64::from(width), SMALLEST, LARGEST),
        Shape::ReciprocalTime { scale } => {
            check(ConfigField::FunnelScale, 0, f64::from(scale), SMALLEST, LARGEST)
        }
        Shape::FiniteTime { start, at_ns, power } => {
            check(ConfigField::FunnelStart, 0, f64::from(start), SMALLEST, LARGEST)?;
            check(ConfigField::FunnelAt, 0, at_ns as f64, 1.0, 1e18)?;
            check(ConfigField::FunnelPower, 0, f64::from(power), 0.09, 10.1)
        }
        Shape::Schedule { start, at_ns, eps, then } => {
            check(ConfigField::FunnelStart, 0, f64::from(start), SMALLEST, LARGEST)?;
            check(ConfigField::FunnelAt, 0, at_ns as f64, 1.0, 1e18)?;
            check(ConfigField::FunnelEps, 0, f64::from(eps), SMALLEST, 1.0)?;
            match then {
                Normalised::Constant { width } => {
                    check(ConfigField::FunnelWidth, 0, f64::from(width), SMALLEST, LARGEST)
                }
                Normalised::Exponential { start, end, rate } => {
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
        if config.coupling == Coupling::EdgeWise {
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
