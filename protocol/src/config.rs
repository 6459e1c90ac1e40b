//! A node's configuration as it travels: SI units, plain values. `funnel_core::params` validates it, once.
//!
//! Postcard, append-only: new enum variants and fields go to the end, and nothing is renumbered.

use core::fmt;
use heapless::Vec;
use serde::{Deserialize, Serialize};

/// Most neighbours of a node: every other id, so that a node can be the hub of the largest star.
pub const MAX_NEIGHBOURS: usize = 126;
/// Most sinusoids in a node's own vector field.
pub const MAX_SINES: usize = 8;

/// What makes a node tick.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum TickSource {
    /// The node's own timer.
    Timer,
    /// One tick per SYNC frame.
    Sync,
}

/// One sinusoid of a vector field: `amplitude * sin(frequency * t + phase)`.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct SineConfig {
    /// State units / s.
    pub amplitude: f32,
    /// rad/s. f64, since its error grows with the length of the run.
    pub frequency: f64,
    /// rad.
    pub phase: f64,
}

/// The node's own vector field `f(t, x) = slope * x + offset + sum of sines`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct FieldConfig {
    /// 1/s.
    pub slope: f32,
    /// State units / s.
    pub offset: f32,
    /// Sinusoids.
    pub sines: Vec<SineConfig, MAX_SINES>,
}

/// Gain `mu(s)`, state units / s, for `s` in (-1, 1).
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub enum GainConfig {
    /// `scale * s / (1 - |s|)`.
    Reciprocal {
        /// State units / s.
        scale: f32,
    },
    /// `-scale * ln(1 - |s|) * sign(s)`.
    Logarithmic {
        /// State units / s.
        scale: f32,
    },
    /// `4 bound s` for `|s| < 1/2`, steeper beyond.
    LocallyLinear {
        /// The paper's `M_f`, state units / s.
        bound: f32,
    },
    /// `mu^-1(s) >= 1 - eps` for `s >= eta`.
    Median {
        /// State units / s.
        eta: f32,
        /// 1.
        eps: f32,
    },
}

/// Shape of a performance funnel, state units.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub enum FunnelShape {
    /// `(start - end) * exp(-rate * t) + end`.
    Exponential {
        /// Width at `t = 0`.
        start: f32,
        /// Width in the limit; zero gives asymptotic synchronisation.
        end: f32,
        /// 1/s.
        rate: f32,
    },
    /// The same width for ever.
    Constant {
        /// Width.
        width: f32,
    },
    /// `scale / t`, infinite at `t = 0`.
    ReciprocalTime {
        /// State units * s.
        scale: f32,
    },
    /// `start * (1 - t / at)^power`, and zero from `at` on.
    FiniteTime {
        /// Width at `t = 0`.
        start: f32,
        /// When it closes, ns.
        at_ns: u64,
        /// 1.
        power: f32,
    },
}

/// A performance funnel `factor * shape`.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct FunnelConfig {
    /// The paper's `r_i`.
    pub factor: f32,
    /// Shape.
    pub shape: FunnelShape,
}

/// One edge of the graph, seen from the node.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct EdgeConfig {
    /// The neighbour, 1 to 127.
    pub id: u8,
    /// `alpha_ij`.
    pub weight: f32,
}

/// Everything that a node is told before it starts.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct NodeConfig {
    /// Own id, 1 to 127.
    pub id: u8,
    /// Tick period `T`, nanoseconds.
    pub tick_ns: u32,
    /// What makes the node tick.
    pub tick_source: TickSource,
    /// Initial state, state units.
    pub initial_state: f32,
    /// States beyond this are refused, state units.
    pub state_limit: f32,
    /// Own vector field.
    pub field: FieldConfig,
    /// Gain.
    pub gain: GainConfig,
    /// Funnel.
    pub funnel: FunnelConfig,
    /// Edges.
    pub neighbours: Vec<EdgeConfig, MAX_NEIGHBOURS>,
    /// Ticks for which a silent neighbour is extrapolated before its edge is dropped.
    pub extrapolate_ticks: u8,
    /// Ticks between telemetry frames; 0 is none.
    pub telemetry_every: u32,
}

macro_rules! fields {
    ($($name:ident = $text:literal,)*) => {
        /// Which value of a configuration an error is about.
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
}

/// Why a node refuses a configuration.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
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
        }
    }
}

impl core::error::Error for ConfigError {}
