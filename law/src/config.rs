//! The vocabulary of the law: fields, gains, funnels and couplings in SI units, as plain values.
//!
//! Append-only: new variants and fields go to the end, and nothing is renumbered, since they travel.

use heapless::Vec;
#[cfg(feature = "serde")]
use serde::{Deserialize, Serialize};

/// Most sinusoids in a node's own vector field, over all components.
pub const MAX_SINES: usize = 8;
/// Most components of a state.
pub const MAX_COMPONENTS: usize = 8;
/// Most entries of the matrix of a field.
pub const MAX_MATRIX: usize = MAX_COMPONENTS * MAX_COMPONENTS;

/// One value per component of a state.
pub type StateConfig = Vec<f32, MAX_COMPONENTS>;

/// The state of a node with one component, state units.
pub fn scalar(x: f32) -> StateConfig {
    [x].into_iter().collect()
}

/// One sinusoid of a vector field: `amplitude * sin(frequency * t + phase)`.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "serde", derive(Serialize, Deserialize))]
pub struct SineConfig {
    /// The component that it drives, from 0.
    pub component: u8,
    /// State units / s.
    pub amplitude: f32,
    /// rad/s. f64, since its error grows with the length of the run.
    pub frequency: f64,
    /// rad.
    pub phase: f64,
}

/// The node's own vector field `f(t, x) = slope * x + offset + sum of sines`, for a state of n components.
#[derive(Clone, Debug, PartialEq)]
#[cfg_attr(feature = "serde", derive(Serialize))]
pub struct FieldConfig {
    /// 1/s: one number for all components, or n times n, row by row.
    pub slope: Vec<f32, MAX_MATRIX>,
    /// State units / s, n numbers.
    pub offset: StateConfig,
    /// Sinusoids.
    pub sines: Vec<SineConfig, MAX_SINES>,
}

impl FieldConfig {
    /// The field of a state with one component: 1/s, state units / s.
    pub fn scalar(slope: f32, offset: f32, sines: impl IntoIterator<Item = SineConfig>) -> Self {
        let slope = [slope].into_iter().collect();
        Self { slope, offset: scalar(offset), sines: sines.into_iter().take(MAX_SINES).collect() }
    }
}

/// How diffusive terms become inputs (docs/notes/2026-11-23-whole-paper.md).
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "serde", derive(Serialize, Deserialize))]
pub enum CouplingConfig {
    /// The paper's law, component by component.
    NodeWise,
    /// The paper's maximum gain, for vector states.
    MaxGain,
    /// One funnel per edge.
    EdgeWise,
    /// `u = k nu` with a `k` that grows while `|nu| > eta`, from the slope of the (linear) gain on.
    LambdaTracker {
        /// State units.
        eta: f32,
    },
    /// No input at all.
    None,
}

/// What a node does when its diffusive term leaves the funnel (LAW.md 5).
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "serde", derive(Serialize, Deserialize))]
pub enum BreachPolicy {
    /// Goes on with the same law.
    Ride,
    /// Widens its own funnel until the ratio is `1 / margin`, and lets that decay.
    Reopen {
        /// Above 1.
        margin: f32,
        /// How fast the added width decays, 1/s.
        rate: f32,
    },
    /// Stops with a safe output and a fault.
    Stop,
}

/// Gain `mu(s)`, state units / s, for `s` in (-1, 1).
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "serde", derive(Serialize, Deserialize))]
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
    /// `u = slope * nu` whatever the funnel is: the high-gain coupling that funnels are compared with.
    Linear {
        /// 1/s.
        slope: f32,
    },
}

/// What a schedule goes on with: a normalised funnel `psibar`, state units.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "serde", derive(Serialize, Deserialize))]
pub enum NormalisedShape {
    /// The same width for ever.
    Constant {
        /// Width.
        width: f32,
    },
    /// `(start - end) * exp(-rate * t) + end`, with the same `t = 0` as everything else.
    Exponential {
        /// Width at `t = 0`.
        start: f32,
        /// Width in the limit.
        end: f32,
        /// 1/s.
        rate: f32,
    },
}

/// Shape of a performance funnel, state units.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "serde", derive(Serialize, Deserialize))]
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
    /// `eps * psibar(t)` from `at` on; before, the exponential that joins `start` to it (paper, theorem on emergent behaviour).
    Schedule {
        /// Width at `t = 0`.
        start: f32,
        /// The paper's `t_1`, ns.
        at_ns: u64,
        /// 1.
        eps: f32,
        /// `psibar`.
        then: NormalisedShape,
    },
}

/// A performance funnel `factor * shape`.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "serde", derive(Serialize, Deserialize))]
pub struct FunnelConfig {
    /// The paper's `r_i`.
    pub factor: f32,
    /// Shape.
    pub shape: FunnelShape,
}
