//! A node's configuration as it travels: SI units, plain values. `funnelnet_node::params` validates it, once.
//!
//! Postcard, append-only: new enum variants and fields go to the end, and nothing is renumbered.

use core::fmt;
use heapless::Vec;
use serde::{Deserialize, Serialize, Serializer};

use crate::message::NodeId;

pub use funnelnet_law::field::{Field, MAX_COMPONENTS, MAX_MATRIX, MAX_SINES, Sine, State, scalar};
pub use funnelnet_law::funnel::{Funnel, Normalised, Shape};
pub use funnelnet_law::program::{MAX_CONSTANTS, MAX_OPERATIONS, Program};
pub use funnelnet_law::{Breach, Coupling, Gain};

/// Most neighbours of a node: every other id, so that a node can be the hub of the largest star. With vector
/// states it is the most for neighbours times components.
pub const MAX_NEIGHBOURS: usize = 126;
/// Source of a node's ticks.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum TickSource {
    /// The node's own timer.
    Timer,
    /// One tick per SYNC frame.
    Sync,
}

/// One edge of the graph, seen from the node.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct EdgeConfig {
    /// The neighbour, 1 to 127.
    pub id: u8,
    /// `alpha_ij`.
    pub weight: f32,
    /// Number of edges that the neighbour has; only edge-wise coupling uses it.
    pub edges: u8,
}

/// What whoever knows the whole network tells a node about the law. A zero is what was not said, with the
/// default beside it; so a stored configuration of wire version 1 reads as one in which nothing was said.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Tuning {
    /// `c` of (**), 1 to 8; 2.2.
    pub damping: f32,
    /// The law runs in `(1 - guard) psi`, 0 to 0.9, grown from zero at tick 0; 0.
    pub guard: f32,
    /// Ticks in a round, 1 to 100: the law decides once in so many, the node's own field is integrated tick
    /// by tick; 1.
    pub round: u8,
    /// The largest `|u|`, state units / s, fed back; without bound.
    pub input_limit: f32,
    /// The largest slope by which a silent neighbour is extrapolated, state units / s; without bound.
    pub slope_limit: f32,
    /// Ticks of the network that a slow start lasts, eight times as many to the node, 0 to 1,000; none.
    pub slow_start: u16,
}

impl Tuning {
    /// Ticks in a round.
    #[must_use]
    pub const fn ticks_in_round(&self) -> u8 {
        if self.round == 0 { 1 } else { self.round }
    }
}

/// Limits of a node's actuator, both zero where they are not given.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Limits {
    /// The lowest input, state units / s, zero or less.
    pub low: f32,
    /// The highest input, state units / s, zero or more.
    pub high: f32,
}

impl Limits {
    /// Whether nothing is said.
    #[must_use]
    pub fn is_none(&self) -> bool {
        self.low == 0.0 && self.high == 0.0
    }
}

/// Limits of what a node takes of a neighbour's states. A zero is what was not said.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub struct HeardLimits {
    /// The largest `|x|` that is taken, state units; as for its own state.
    pub limit: f32,
    /// The largest change from one value that is taken to the next, state units / s; without bound.
    pub rate: f32,
    /// So many values in a row that are not taken bar the edge, until its neighbour starts anew; 0 never do.
    pub drop_after: u8,
}

impl HeardLimits {
    /// None: nothing is said.
    pub const NONE: Self = Self { limit: 0.0, rate: 0.0, drop_after: 0 };

    /// Whether nothing is said.
    #[must_use]
    pub fn is_none(&self) -> bool {
        self.limit == 0.0 && self.rate == 0.0 && self.drop_after == 0
    }
}

/// How nodes that tick by their timers keep one time, by SYNC of time masters. All zero where they keep none.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct TimeRules {
    /// Nodes that may be time master: bit `id % 8` of byte `id / 8`.
    pub masters: [u8; MASTER_BYTES],
    /// Time from one SYNC to the next, us.
    pub period_us: u32,
    /// How far the stamp of a SYNC may be from the instant at which it was on the wire, us. 0 is said of the
    /// stamps of CAN controllers.
    pub jitter_us: u32,
}

/// Bytes of a set of ids.
pub const MASTER_BYTES: usize = 16;

impl TimeRules {
    /// None: nothing is said.
    pub const NONE: Self = Self { masters: [0; MASTER_BYTES], period_us: 0, jitter_us: 0 };
    /// Bytes of them, where they are said.
    pub(crate) const BYTES: usize = MASTER_BYTES + 8;

    /// Whether nothing is said.
    #[must_use]
    pub fn is_none(&self) -> bool {
        *self == Self::NONE
    }

    /// The ids of the nodes that may be time master, with 0 where the set has it.
    pub fn masters(&self) -> impl Iterator<Item = u8> {
        let bytes = self.masters;
        (0..=NodeId::MAX)
            .filter(move |id| bytes.get(usize::from(id / 8)).is_some_and(|byte| byte >> (id % 8) & 1 == 1))
    }

    /// The same with one master more.
    #[must_use]
    pub fn with_master(mut self, id: NodeId) -> Self {
        if let Some(byte) = self.masters.get_mut(usize::from(id.get() / 8)) {
            *byte |= 1 << (id.get() % 8);
        }
        self
    }

    /// As they travel: the set, the period, the jitter.
    fn bytes(&self) -> [u8; Self::BYTES] {
        let numbers = [self.period_us, self.jitter_us].map(u32::to_le_bytes);
        let all = self.masters.iter().chain(numbers.as_flattened());
        let mut bytes = [0; Self::BYTES];
        bytes.iter_mut().zip(all).for_each(|(to, from)| *to = *from);
        bytes
    }
}

impl Serialize for TimeRules {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        self.bytes().serialize(serializer)
    }
}

/// Everything that a node is told before it starts. Read by [`NodeConfig::read`], where it is to stay.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct NodeConfig {
    /// Own id, 1 to 127.
    pub id: u8,
    /// Tick period `T`, nanoseconds.
    pub tick_ns: u32,
    /// Source of the node's ticks.
    pub tick_source: TickSource,
    /// Initial state, state units; its length is the number of components.
    pub initial_state: State<f32>,
    /// States beyond this are refused, state units.
    pub state_limit: f32,
    /// Own vector field.
    pub field: Field<f32>,
    /// Coupling.
    pub coupling: Coupling<f32>,
    /// Gain.
    pub gain: Gain<f32>,
    /// Funnel.
    pub funnel: Funnel<f32>,
    /// Policy outside the funnel.
    pub on_breach: Breach<f32>,
    /// Edges.
    pub neighbours: Vec<EdgeConfig, MAX_NEIGHBOURS>,
    /// Ticks for which a silent neighbour is extrapolated before its edge is dropped.
    pub extrapolate_ticks: u8,
    /// Ticks between telemetry frames; 0 is none.
    pub telemetry_every: u32,
    /// So many neighbours that were heard and are silent at the same time stop the node; 0 never does.
    pub lost_neighbours: u8,
    /// With SYNC as tick source, a running node that has heard none for so long stops, ns; 0 never does.
    pub holdover_ns: u64,
    /// The law's own numbers.
    pub tuning: Tuning,
    /// Own vector field where it is an expression: the whole of it, which reads the sinusoids of `field` by
    /// their index. Slope and offset are zero then.
    pub program: Program<f32>,
    /// Limits of the input.
    pub limits: Limits,
    /// Limits of what is heard. Where nothing is said it is not written, so that a configuration without them
    /// has the bytes that it had before there were any.
    #[serde(skip_serializing_if = "HeardLimits::is_none")]
    pub heard: HeardLimits,
    /// How it keeps time with others; as for what is heard, not written where nothing is said.
    #[serde(skip_serializing_if = "TimeRules::is_none")]
    pub time: TimeRules,
}

impl NodeConfig {
    /// Period of its law and of its frames, ns: a round.
    #[must_use]
    pub fn period_ns(&self) -> u64 {
        u64::from(self.tick_ns) * u64::from(self.tuning.ticks_in_round())
    }
}

macro_rules! fields {
    ($($name:ident = $text:literal,)*) => {
        /// Value of a configuration that an error is about.
        #[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
        #[allow(missing_docs)] // the text beside each name is its documentation
        pub enum ConfigField { $($name,)* }

        impl ConfigField {
            /// Its name, as in a scenario file.
            pub const fn name(self) -> &'static str {
                match self { $(Self::$name => $text,)* }
            }
        }
    };
}

fields! {
    Id = "id",
    Tick = "time.tick (ns)",
    InitialState = "state",
    StateLimit = "state limit",
    Slope = "dynamics.slope",
    Offset = "dynamics.offset",
    SineAmplitude = "dynamics.sines.amplitude",
    SineFrequency = "dynamics.sines.frequency",
    SinePhase = "dynamics.sines.phase",
    GainScale = "gain.scale",
    FunnelFactor = "funnel.factor",
    FunnelStart = "funnel.start",
    FunnelEnd = "funnel.end",
    FunnelRate = "funnel.rate",
    FunnelWidth = "funnel.width",
    NeighbourId = "neighbour id",
    Weight = "graph weight",
    Degree = "degree (sum of weights)",
    GainBound = "gain.bound",
    GainEta = "gain.eta",
    GainEps = "gain.eps",
    FunnelScale = "funnel.scale",
    FunnelAt = "funnel.at (ns)",
    FunnelPower = "funnel.power",
    Components = "state (number of components)",
    Matrix = "dynamics.slope (number of entries)",
    Offsets = "dynamics.offset (number of components)",
    SineComponent = "dynamics.sines (component)",
    Entries = "neighbours times components",
    GainSlope = "gain.slope",
    FunnelEps = "funnel.eps",
    Eta = "coupling.eta",
    BreachMargin = "coupling.on_breach.margin",
    BreachRate = "coupling.on_breach.rate",
    NeighbourEdges = "edges of a neighbour",
    Holdover = "safety.holdover (ns)",
    Damping = "coupling.damping",
    Guard = "coupling.guard",
    Round = "time.round (ticks)",
    InputLimit = "coupling.u_max",
    SlopeLimit = "slope limit",
    SlowStart = "time.slow_start (ticks)",
    Operation = "dynamics.f (operation)",
    ProgramConstant = "dynamics.f (constant)",
    ProgramState = "dynamics.f (component of the state)",
    ProgramWave = "dynamics.f (sinusoid)",
    ProgramInput = "dynamics.f (input from outside)",
    ProgramStack = "dynamics.f (values on the stack)",
    ProgramComponents = "dynamics.f (number of components)",
    FieldAtStart = "dynamics.f at the start",
    LimitLow = "limits.low",
    LimitHigh = "limits.high",
    HeardLimit = "safety.heard_limit",
    HeardRate = "safety.heard_rate",
    SyncMasters = "sync.masters",
    SyncPeriod = "sync.period (us)",
    SyncJitter = "jitter of SYNC (us)",
}

/// Why a node refuses a configuration.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[non_exhaustive]
pub enum ConfigError {
    /// A value is outside its range (or not a number).
    OutOfRange {
        /// Which value.
        field: ConfigField,
        /// Its index, where there are several (sine, neighbour).
        index: u8,
        /// What was found.
        found: f64,
        /// Smallest allowed value.
        low: f64,
        /// Largest allowed value.
        high: f64,
    },
    /// A neighbour is listed twice.
    DuplicateNeighbour {
        /// Which.
        id: u8,
    },
    /// A node cannot be its own neighbour.
    OwnNeighbour {
        /// Its id.
        id: u8,
    },
    /// The node is running; stop it first.
    Running,
    /// The bytes are not a configuration of this wire version.
    Malformed,
    /// This coupling needs a linear gain, and this gain no funnel coupling.
    GainOfCoupling,
    /// The two ends of an edge share its funnel: with edge-wise coupling none can reopen it alone.
    PolicyOfCoupling,
    /// The request before it is not answered yet.
    Busy,
    /// No node can compute this coupling from what its neighbours send.
    NotLocal,
    /// Time masters keep timers together, and this node ticks by SYNC.
    TimeOfTicks,
}

impl fmt::Display for ConfigError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match *self {
            Self::OutOfRange { field, index, found, low, high } => {
                write!(f, "{} = {found}", field.name())?;
                if index > 0 {
                    write!(f, " (entry {})", u16::from(index) + 1)?;
                }
                write!(f, ": allowed are {low} to {high}")
            }
            Self::DuplicateNeighbour { id } => write!(f, "neighbour {id} is listed twice"),
            Self::OwnNeighbour { id } => write!(f, "node {id} lists itself as a neighbour"),
            Self::Running => write!(f, "the node is running: stop it before configuring"),
            Self::Malformed => {
                write!(f, "the bytes are not a configuration of wire version {}", crate::WIRE_VERSION)
            }
            Self::GainOfCoupling => {
                write!(
                    f,
                    "a lambda-tracker needs a linear gain; edge-wise and max-gain coupling need a funnel's gain"
                )
            }
            Self::NotLocal => f.write_str(
                "no node can run weakly-centralised coupling: it would have to know the gains of all others",
            ),
            Self::TimeOfTicks => f.write_str(
                "time masters are for nodes that tick by their timers, and this one ticks by SYNC",
            ),
            Self::Busy => f.write_str("the node has not answered the request before yet: ask again"),
            Self::PolicyOfCoupling => {
                write!(f, "with edge-wise coupling a node cannot reopen a funnel alone: ride on, or stop")
            }
        }
    }
}

impl core::error::Error for ConfigError {}
