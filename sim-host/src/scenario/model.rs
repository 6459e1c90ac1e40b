//! A scenario, fully resolved: every node with its own dynamics, gain and funnel, in SI units and f64.

use funnelnet_law::{Real, math};
use std::path::PathBuf;

use super::affine::Affine;
use super::graph::Graph;
use crate::extremes::largest;

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
    /// The narrowest funnel that is asked for.
    pub floor: FloorSpec,
    /// What a node does outside its funnel.
    pub on_breach: BreachSpec,
    /// One per node; index i has id i + 1.
    pub nodes: Vec<NodeSpec>,
    /// The unit of the states, for who reads a picture.
    pub unit: Option<String>,
    /// The bus between the nodes.
    pub bus: BusSpec,
    /// What stops a node, beside its own state and funnel.
    pub safety: SafetySpec,
    /// What must hold at the end.
    pub expect: Expect,
    /// The file that it came from, as named by the user.
    pub path: PathBuf,
    /// The text that gives it again, with the values of the command line in it.
    pub as_run: String,
}

impl Scenario {
    /// Components of a state, 1 to 8; every node has as many.
    #[must_use]
    pub fn components(&self) -> usize {
        self.nodes.first().map_or(1, |node| node.state.len())
    }

    /// The initial states, by index and then by component (state units).
    #[must_use]
    pub fn initial_states(&self) -> Vec<f64> {
        self.nodes.iter().flat_map(|node| node.state.iter().copied()).collect()
    }

    /// The widest funnel at time `t` (s), over the nodes (state units).
    #[must_use]
    pub fn widest_funnel(&self, t: f64) -> f64 {
        largest(0.0, self.nodes.iter().map(|node| node.funnel.width(t)))
    }

    /// The bound on `|x_i - x_j|`, component by component, while every diffusive term is inside funnels of at most `widest`
    /// (state units); 0 for a single node. With edge-wise coupling every edge keeps `alpha_ij |x_i - x_j| < psi`, which adds up
    /// along the shortest way; else it is the paper's `2 sqrt(N) / lambda2 * widest`.
    #[must_use]
    pub fn sync_bound(&self, widest: f64) -> f64 {
        match (self.nodes.len(), self.coupling) {
            (0 | 1, _) => 0.0,
            (_, CouplingKind::EdgeWise) => widest * self.graph.resistive_diameter(),
            (n, _) => 2.0 * (n as f64).sqrt() / self.graph.lambda2() * widest,
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

    /// The time of tick `k` in seconds: the f64 nearest to it, up to 2^53 ns.
    #[must_use]
    pub fn at_s(&self, k: u64) -> f64 {
        k.saturating_mul(self.tick_ns) as f64 / 1e9
    }

    /// The end of the run in seconds.
    #[must_use]
    pub fn end_s(&self) -> f64 {
        self.ticks as f64 * self.tick_ns as f64 * 1e-9
    }
}

/// How the diffusive terms become inputs.
#[derive(Clone, Copy, Debug, PartialEq)]
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
    LambdaTracker {
        /// Errors below this leave the gain as it is (state units).
        eta: f64,
    },
    /// No coupling.
    None,
}

impl CouplingKind {
    /// Its name in a scenario.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::NodeWise => "node-wise",
            Self::EdgeWise => "edge-wise",
            Self::ElementWise => "element-wise",
            Self::MaxGain => "max-gain",
            Self::WeaklyCentralised => "weakly-centralised",
            Self::Linear => "linear",
            Self::LambdaTracker { .. } => "lambda-tracker",
            Self::None => "none",
        }
    }

    /// Whether the law is one that keeps diffusive terms inside funnels, rather than a baseline to compare with.
    #[must_use]
    pub fn keeps_funnels(self) -> bool {
        !matches!(self, Self::Linear | Self::LambdaTracker { .. } | Self::None)
    }
}

/// What a node does when its diffusive term leaves the funnel (LAW.md 5).
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum BreachSpec {
    /// Goes on.
    Ride,
    /// Stops with a safe output and a fault.
    Stop,
    /// Widens its own funnel, and lets the added width decay.
    Reopen {
        /// The ratio right after is one over this; above 1.
        margin: f64,
        /// 1/s, above zero.
        rate: f64,
    },
}

/// The narrowest funnel that the designer asks for. Nodes may keep a wider one than the scenario's down there, and are judged by it.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub enum FloorSpec {
    /// The funnel itself: a node that floors it fails the run.
    #[default]
    None,
    /// So wide (state units).
    Width(f64),
    /// What the f32 of a node resolves.
    F32,
}

/// What stops a node, beside its own state and funnel.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct SafetySpec {
    /// So many neighbours lost at the same time; 0 never does.
    pub lost_neighbours: u8,
    /// So long without SYNC, ns, where the nodes tick by it.
    pub holdover_ns: Option<u64>,
}

/// One node.
#[derive(Clone, Debug, PartialEq)]
pub struct NodeSpec {
    /// The index in `Scenario::nodes` plus one; more than a run takes where the scenario can only be checked.
    pub id: u16,
    /// Initial state, by component (state units).
    pub state: Vec<f64>,
    /// The node's own vector field.
    pub dynamics: Affine,
    /// Its gain.
    pub gain: GainSpec,
    /// Its funnel.
    pub funnel: FunnelSpec,
    /// Standard deviation of what is added to each state as it is sent (state units).
    pub noise: f64,
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
    /// `u = slope nu` whatever the funnel is, for comparison.
    Linear {
        /// 1/s, above zero.
        slope: f64,
    },
}

/// What a schedule goes on with: a normalised funnel `psibar(t)` in state units.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum NormalisedSpec {
    /// `width`.
    Constant {
        /// State units, above zero.
        width: f64,
    },
    /// `(start - end) exp(-rate t) + end`, from the same t = 0 as everything else.
    Exponential {
        /// State units, above zero.
        start: f64,
        /// State units, zero or more.
        end: f64,
        /// 1/s, above zero.
        rate: f64,
    },
}

impl NormalisedSpec {
    /// `psibar(t)` for t >= 0 in seconds (state units).
    #[must_use]
    pub fn width(&self, t: f64) -> f64 {
        match *self {
            Self::Constant { width } => width,
            Self::Exponential { start, end, rate } => between(start, end, rate * t),
        }
    }

    /// The derivative of [`Self::width`] by time (state units / s).
    fn slope(&self, t: f64) -> f64 {
        match *self {
            Self::Constant { .. } => 0.0,
            Self::Exponential { start, end, rate } => -rate * (start - end) * math::exp(-rate * t),
        }
    }
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
    /// `factor eps psibar(t)` from `at` on, and before the exponential that joins `factor start` to it (paper, theorem on
    /// emergent behaviour).
    Schedule {
        /// State units, above zero.
        start: f64,
        /// The paper's `t_1`, in nanoseconds.
        at_ns: u64,
        /// The paper's epsilon, above zero.
        eps: f64,
        /// `psibar`.
        then: NormalisedSpec,
        /// Above zero.
        factor: f64,
    },
}

/// `(start - end) exp(-decay) + end`. Where it widens as a sum of two terms that are zero or more: the difference would cancel, to zero for a
/// start below an ulp of the end.
pub(crate) fn between(start: f64, end: f64, decay: f64) -> f64 {
    if end > start {
        start * math::exp(-decay) - end * math::exp_m1(-decay)
    } else {
        (start - end) * math::exp(-decay) + end
    }
}

/// `eps psibar(at)`, where the parts of a schedule join (state units); as on a node, what has closed by then has a width still.
fn joined(eps: f64, then: NormalisedSpec, at: f64) -> f64 {
    (eps * then.width(at)).max(f64::TINY)
}

impl FunnelSpec {
    /// `psi(t)` for t >= 0 in seconds (state units).
    #[must_use]
    pub fn width(&self, t: f64) -> f64 {
        match *self {
            Self::Exponential { start, end, rate, factor } => factor * between(start, end, rate * t),
            Self::Constant { width, factor } => factor * width,
            Self::ReciprocalTime { scale, factor } => factor * scale / t,
            Self::FiniteTime { start, at_ns, power, factor } => {
                factor * start * math::pow((1.0 - t / (at_ns as f64 * 1e-9)).max(0.0), power)
            }
            Self::Schedule { start, at_ns, eps, then, factor } => {
                let at = at_ns as f64 * 1e-9;
                if t >= at {
                    return factor * eps * then.width(t);
                }
                factor * start * math::exp(-t / at * math::ln(start / joined(eps, then, at)))
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
            Self::Schedule { at_ns, eps, then, factor, .. } => {
                let at = at_ns as f64 * 1e-9;
                if t >= at {
                    return factor * eps * then.slope(t);
                }
                -self.width(t) / at * math::ln(self.width(0.0) / (factor * joined(eps, then, at)))
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
            | Self::FiniteTime { factor, .. }
            | Self::Schedule { factor, .. } => factor,
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
#[derive(Clone, Debug, Default, PartialEq)]
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
    /// Where every component of every node ends.
    pub final_value: Option<FinalValue>,
    /// The largest `|u|` over all nodes and ticks (state units / s).
    pub max_input: Option<f64>,
    /// Nodes that may stop by themselves.
    pub stopped: Stoppable,
    /// Limits for a part of the run.
    pub windows: Vec<Window>,
}

/// Nodes that may stop by themselves without failing the run.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Stoppable {
    /// Those with these ids.
    Ids(Vec<u16>),
    /// Each.
    Any,
}

impl Default for Stoppable {
    fn default() -> Self {
        Self::Ids(Vec::new())
    }
}

/// Limits for a part of the run, both ends included; `None` is not checked.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Window {
    /// Its first tick.
    pub from_tick: u64,
    /// Its last tick.
    pub to_tick: u64,
    /// The largest `|nu| / psi`.
    pub funnel_ratio: Option<f64>,
    /// The largest `max x - min x` (state units).
    pub spread: Option<f64>,
    /// The largest distance of a node to the emergent dynamics (state units).
    pub emergent_error: Option<f64>,
    /// The largest distance of a node to the continuous-time reference (state units).
    pub reference_error: Option<f64>,
    /// The largest `|u|` (state units / s).
    pub max_input: Option<f64>,
}

impl Expect {
    /// Whether nothing at all is expected.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        let figures = [
            self.funnel_ratio,
            self.final_spread,
            self.emergent_error,
            self.blended_error,
            self.reference_error,
            self.max_input,
        ];
        figures.iter().all(Option::is_none) && self.final_value.is_none() && self.windows.is_empty()
    }

    /// Whether the distance to the emergent dynamics is limited anywhere.
    #[must_use]
    pub fn asks_for_emergent(&self) -> bool {
        self.emergent_error.is_some() || self.windows.iter().any(|window| window.emergent_error.is_some())
    }

    /// Whether the distance to the reference is limited anywhere.
    #[must_use]
    pub fn asks_for_reference(&self) -> bool {
        self.reference_error.is_some() || self.windows.iter().any(|window| window.reference_error.is_some())
    }
}

/// Where all states end, and how near to it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FinalValue {
    /// State units.
    pub is: f64,
    /// Largest distance, above zero (state units).
    pub within: f64,
}
