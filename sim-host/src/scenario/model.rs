//! A scenario, fully resolved: every node with its own dynamics, gain and funnel, in SI units and f64.

use funnel_core::math;
use std::path::PathBuf;

use super::graph::Graph;

/// Everything that a run depends on.
#[derive(Clone, Debug, PartialEq)]
pub struct Scenario {
    /// Title; the file's name where it gives none.
    pub title: String,
    /// The root of every random stream.
    pub seed: u64,
    /// Tick and duration.
    pub time: TimeSpec,
    /// Who hears whom.
    pub graph: Graph,
    /// The coupling law.
    pub coupling: CouplingKind,
    /// One per node; index i has id i + 1.
    pub nodes: Vec<NodeSpec>,
    /// The bus between the nodes.
    pub bus: BusSpec,
    /// What must hold at the end.
    pub expect: Expect,
    /// The file that it came from, as named by the user.
    pub path: PathBuf,
}

impl Scenario {
    /// The initial states, by index (state units).
    #[must_use]
    pub fn initial_states(&self) -> Vec<f64> {
        self.nodes.iter().map(|node| node.state).collect()
    }

    /// The widest funnel at time `t` (s), over the nodes (state units).
    #[must_use]
    pub fn widest_funnel(&self, t: f64) -> f64 {
        self.nodes.iter().map(|node| node.funnel.width(t)).fold(0.0, f64::max)
    }

    /// The paper's bound on `|x_i - x_j|` while every `|nu_i| < psi_i <= widest` (state units):
    /// `2 sqrt(N) / lambda2 * widest`; 0 for a single node.
    #[must_use]
    pub fn sync_bound(&self, widest: f64) -> f64 {
        match self.nodes.len() {
            0 | 1 => 0.0,
            n => 2.0 * (n as f64).sqrt() / self.graph.lambda2() * widest,
        }
    }
}

/// The network tick and how many of them are run.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct TimeSpec {
    /// Network tick T in nanoseconds, above zero.
    pub tick_ns: u64,
    /// Number of ticks, above zero; the run ends at `ticks * tick_ns`.
    pub ticks: u64,
}

impl TimeSpec {
    /// T in seconds.
    #[must_use]
    pub fn tick_s(&self) -> f64 {
        self.tick_ns as f64 * 1e-9
    }

    /// The end of the run in seconds.
    #[must_use]
    pub fn end_s(&self) -> f64 {
        self.ticks as f64 * self.tick_ns as f64 * 1e-9
    }
}

/// How the diffusive terms become inputs.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum CouplingKind {
    /// The paper's law: `u_i = mu_i(nu_i / psi_i)`.
    NodeWise,
    /// One funnel per edge.
    EdgeWise,
    /// Vector states, component by component.
    ElementWise,
    /// Vector states, the largest gain for all components.
    MaxGain,
    /// The largest gain over all nodes.
    WeaklyCentralised,
    /// `u_i = k nu_i`.
    Linear,
    /// A linear gain that grows while the error is large.
    LambdaTracker,
    /// No coupling.
    None,
}

/// One node.
#[derive(Clone, Debug, PartialEq)]
pub struct NodeSpec {
    /// The index in `Scenario::nodes` plus one; more than a run takes where the scenario can only be checked.
    pub id: u16,
    /// Initial state (state units).
    pub state: f64,
    /// The node's own vector field.
    pub dynamics: Affine,
    /// Its gain.
    pub gain: GainSpec,
    /// Its funnel.
    pub funnel: FunnelSpec,
}

/// `f(t, x) = slope x + offset + sum amplitude sin(frequency t + phase)`, in state units per second.
#[derive(Clone, Debug, PartialEq)]
pub struct Affine {
    /// 1/s.
    pub slope: f64,
    /// State units / s.
    pub offset: f64,
    /// The sines, in the order of the file.
    pub sines: Vec<Sine>,
}

impl Affine {
    /// `f(t, x) - slope x`, the part that does not depend on the state (state units / s).
    #[must_use]
    pub fn forcing(&self, t: f64) -> f64 {
        self.offset + self.sines.iter().map(|sine| sine.value(t)).sum::<f64>()
    }

    /// `f(t, x)` (state units / s).
    #[must_use]
    pub fn value(&self, t: f64, x: f64) -> f64 {
        self.slope * x + self.forcing(t)
    }

    /// The partial derivative of `f` by time (state units / s^2).
    #[must_use]
    pub fn rate_of_forcing(&self, t: f64) -> f64 {
        let rate = |sine: &Sine| sine.amplitude * sine.frequency * math::cos(sine.frequency * t + sine.phase);
        self.sines.iter().map(rate).sum()
    }
}

/// `amplitude sin(frequency t + phase)`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Sine {
    /// State units / s.
    pub amplitude: f64,
    /// rad/s.
    pub frequency: f64,
    /// rad.
    pub phase: f64,
}

impl Sine {
    /// The value at time `t` (s).
    #[must_use]
    pub fn value(&self, t: f64) -> f64 {
        self.amplitude * math::sin(self.frequency * t + self.phase)
    }
}

/// The gain `mu(s) = gamma(|s|) s`, s in (-1, 1), in state units / s.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum GainSpec {
    /// `scale s / (1 - |s|)`.
    Reciprocal {
        /// State units / s, above zero.
        scale: f64,
    },
    /// `-scale ln(1 - |s|) sign(s)`.
    Logarithmic {
        /// State units / s, above zero.
        scale: f64,
    },
    /// The paper's locally linear gain.
    LocallyLinear {
        /// The paper's `M_f` (state units / s), above zero.
        bound: f64,
    },
    /// The paper's gain for the distributed median.
    Median {
        /// The paper's eta, above zero.
        eta: f64,
        /// The paper's epsilon, above zero.
        eps: f64,
    },
    /// A linear gain, for comparison.
    Linear {
        /// 1/s, above zero.
        slope: f64,
    },
}

/// The funnel `psi(t)` in state units. `factor` is the paper's `r_i` and multiplies the whole funnel.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum FunnelSpec {
    /// `factor ((start - end) exp(-rate t) + end)`.
    Exponential {
        /// State units, above zero.
        start: f64,
        /// State units, zero or more.
        end: f64,
        /// 1/s, above zero.
        rate: f64,
        /// Above zero.
        factor: f64,
    },
    /// `factor width`.
    Constant {
        /// State units, above zero.
        width: f64,
        /// Above zero.
        factor: f64,
    },
    /// `factor scale / t`, infinite at the start.
    ReciprocalTime {
        /// State units times s, above zero.
        scale: f64,
        /// Above zero.
        factor: f64,
    },
    /// `factor start (1 - t / at)^power`, zero from `at` on.
    FiniteTime {
        /// State units, above zero.
        start: f64,
        /// When the funnel closes, in nanoseconds.
        at_ns: u64,
        /// Above zero.
        power: f64,
        /// Above zero.
        factor: f64,
    },
}

impl FunnelSpec {
    /// `psi(t)` for t >= 0 in seconds (state units).
    #[must_use]
    pub fn width(&self, t: f64) -> f64 {
        match *self {
            Self::Exponential { start, end, rate, factor } => {
                factor * ((start - end) * math::exp(-rate * t) + end)
            }
            Self::Constant { width, factor } => factor * width,
            Self::ReciprocalTime { scale, factor } => factor * scale / t,
            Self::FiniteTime { start, at_ns, power, factor } => {
                factor * start * math::pow((1.0 - t / (at_ns as f64 * 1e-9)).max(0.0), power)
            }
        }
    }

    /// The derivative of [`Self::width`] by time, for t > 0 in seconds (state units / s).
    #[must_use]
    pub fn slope(&self, t: f64) -> f64 {
        match *self {
            Self::Exponential { start, end, rate, factor } => {
                -factor * rate * (start - end) * math::exp(-rate * t)
            }
            Self::Constant { .. } => 0.0,
            Self::ReciprocalTime { scale, factor } => -factor * scale / (t * t),
            Self::FiniteTime { start, at_ns, power, factor } => {
                let at = at_ns as f64 * 1e-9;
                let rest = 1.0 - t / at;
                if rest > 0.0 { -factor * start * power / at * math::pow(rest, power - 1.0) } else { 0.0 }
            }
        }
    }

    /// The multiplier of the whole funnel.
    #[must_use]
    pub fn factor(&self) -> f64 {
        match *self {
            Self::Exponential { factor, .. }
            | Self::Constant { factor, .. }
            | Self::ReciprocalTime { factor, .. }
            | Self::FiniteTime { factor, .. } => factor,
        }
    }
}

/// What carries the states.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum BusModel {
    /// No arbitration and no capacity; loss, latency and jitter only.
    Ideal,
    /// Classic CAN.
    Can,
    /// CAN FD.
    CanFd,
    /// Point-to-point serial links.
    Uart,
}

/// The bus.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct BusSpec {
    /// Its kind.
    pub model: BusModel,
    /// Probability from 0 to 1 that a receiver misses a frame, independent for every receiver.
    pub loss: f64,
    /// Delay of every frame in nanoseconds.
    pub latency_ns: u64,
    /// Width of the additional random delay in nanoseconds.
    pub jitter_ns: u64,
}

/// Limits that the run must stay below; `None` is not checked.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Expect {
    /// The largest `|nu| / psi` over all nodes and ticks.
    pub funnel_ratio: Option<f64>,
    /// `max x - min x` at the end (state units).
    pub final_spread: Option<f64>,
    /// Largest distance of a node to the emergent dynamics at the end (state units).
    pub emergent_error: Option<f64>,
    /// Largest distance of a node to the blended dynamics at the end (state units).
    pub blended_error: Option<f64>,
    /// Largest distance to the continuous-time reference over nodes and time (state units).
    pub reference_error: Option<f64>,
}
