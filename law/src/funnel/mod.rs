//! Performance funnels `psi(t)`: as a designer draws them, in continuous time, and as a node evaluates them,
//! tick by tick.

mod guard;
mod sampled;

pub use guard::{GROWN_AFTER, Guard};
pub use sampled::{SampledFunnel, Transient, Widths};

use crate::math::{self, Real, larger};
use core::fmt;

/// Normalised funnel `psibar(t)`, state units, with which a schedule goes on.
///
/// ```
/// use funnelnet_law::funnel::Normalised;
/// let psibar = Normalised::Exponential { start: 3.0, end: 1.0, rate: 1.0 };
/// assert_eq!(psibar.width(0.0), 3.0);
/// ```
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub enum Normalised<F> {
    /// The same width for ever.
    Constant {
        /// Width, above zero.
        width: F,
    },
    /// `(start - end) * exp(-rate * t) + end`, with the same `t = 0` as everything else.
    Exponential {
        /// Width at `t = 0`, above zero.
        start: F,
        /// Width in the limit, zero or more.
        end: F,
        /// 1/s, above zero.
        rate: F,
    },
}

/// The shape of a performance funnel, state units.
///
/// Append-only: it travels (funnelnet-protocol), so that nothing is renumbered.
/// Exhaustive on purpose: node and scenario match it, and a new variant shall not compile until both know it.
///
/// ```
/// use funnelnet_law::funnel::{Funnel, Shape};
/// // Agreement at t = 2 s, not before and not later.
/// let funnel: Funnel<f64> = Shape::FiniteTime { start: 5.0, at_ns: 2_000_000_000, power: 1.0 }.into();
/// assert_eq!((funnel.width(1.0), funnel.width(3.0)), (2.5, 0.0));
/// ```
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub enum Shape<F> {
    /// `(start - end) * exp(-rate * t) + end`.
    Exponential {
        /// Width at `t = 0`, above zero.
        start: F,
        /// Width in the limit, zero or more; zero gives asymptotic synchronisation.
        end: F,
        /// 1/s, above zero.
        rate: F,
    },
    /// The same width for ever.
    Constant {
        /// Width, above zero.
        width: F,
    },
    /// `scale / t`, infinite at `t = 0`.
    ReciprocalTime {
        /// State units * s, above zero.
        scale: F,
    },
    /// `start * (1 - t / at)^power`, and zero from `at` on.
    FiniteTime {
        /// Width at `t = 0`, above zero.
        start: F,
        /// When it closes, ns.
        at_ns: u64,
        /// 1, above zero.
        power: F,
    },
    /// `eps * psibar(t)` from `at` on; before, the exponential that joins `start` to it (paper, theorem on
    /// emergent behaviour).
    Schedule {
        /// Width at `t = 0`, above zero.
        start: F,
        /// The paper's `t_1`, ns.
        at_ns: u64,
        /// The paper's epsilon, above zero.
        eps: F,
        /// `psibar`.
        then: Normalised<F>,
    },
}

/// A performance funnel `factor * shape`.
///
/// ```
/// use funnelnet_law::funnel::{Funnel, Shape};
/// // Twice as wide as the others' funnel: this agent leads.
/// let shape = Shape::Exponential { start: 40.0, end: 2.0, rate: 1.0 };
/// let funnel = Funnel { factor: 2.0, shape };
/// assert_eq!(funnel.width(0.0), 80.0);
/// assert!((funnel.width(20.0) - 4.0).abs() < 1e-6);
/// ```
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct Funnel<F> {
    /// The paper's `r_i`, above zero: multiplies the whole funnel.
    pub factor: F,
    /// Shape of the funnel, before it is multiplied.
    pub shape: Shape<F>,
}

impl<F: Copy> Normalised<F> {
    /// The same funnel with numbers of another type, each changed by `convert`.
    #[must_use]
    pub fn map<G>(self, convert: impl Fn(F) -> G) -> Normalised<G> {
        match self {
            Self::Constant { width } => Normalised::Constant { width: convert(width) },
            Self::Exponential { start, end, rate } => {
                Normalised::Exponential { start: convert(start), end: convert(end), rate: convert(rate) }
            }
        }
    }
}

impl<F> From<Shape<F>> for Funnel<F>
where
    F: Real,
{
    fn from(shape: Shape<F>) -> Self {
        Self { factor: F::ONE, shape }
    }
}

impl<F: Copy> Funnel<F> {
    /// The same funnel with numbers of another type, each changed by `convert`.
    #[must_use]
    pub fn map<G>(self, convert: impl Fn(F) -> G) -> Funnel<G> {
        let shape = match self.shape {
            Shape::Exponential { start, end, rate } => {
                Shape::Exponential { start: convert(start), end: convert(end), rate: convert(rate) }
            }
            Shape::Constant { width } => Shape::Constant { width: convert(width) },
            Shape::ReciprocalTime { scale } => Shape::ReciprocalTime { scale: convert(scale) },
            Shape::FiniteTime { start, at_ns, power } => {
                Shape::FiniteTime { start: convert(start), at_ns, power: convert(power) }
            }
            Shape::Schedule { start, at_ns, eps, then } => {
                Shape::Schedule { start: convert(start), at_ns, eps: convert(eps), then: then.map(&convert) }
            }
        };
        Funnel { factor: convert(self.factor), shape }
    }
}

impl<F> Shape<F> {
    /// Names of all shapes, in the order of the wire.
    pub const KINDS: [&'static str; 5] =
        ["exponential", "constant", "reciprocal-time", "finite-time", "schedule"];

    /// Name of the shape, as in a scenario.
    #[must_use]
    pub fn kind(&self) -> &'static str {
        let index = match self {
            Self::Exponential { .. } => 0,
            Self::Constant { .. } => 1,
            Self::ReciprocalTime { .. } => 2,
            Self::FiniteTime { .. } => 3,
            Self::Schedule { .. } => 4,
        };
        Self::KINDS[index]
    }
}

impl Normalised<f64> {
    /// `psibar(t)` for `t >= 0` in seconds (state units).
    #[must_use]
    pub fn width(&self, t: f64) -> f64 {
        match *self {
            Self::Constant { width } => width,
            Self::Exponential { start, end, rate } => between(start, end, rate * t),
        }
    }

    /// The derivative of [`Self::width`] by time (state units / s).
    #[must_use]
    pub fn slope(&self, t: f64) -> f64 {
        match *self {
            Self::Constant { .. } => 0.0,
            Self::Exponential { start, end, rate } => -rate * (start - end) * math::exp(-rate * t),
        }
    }
}

impl Funnel<f64> {
    /// `psi(t)` for `t >= 0` in seconds (state units).
    #[must_use]
    pub fn width(&self, t: f64) -> f64 {
        let factor = self.factor;
        match self.shape {
            Shape::Exponential { start, end, rate } => factor * between(start, end, rate * t),
            Shape::Constant { width } => factor * width,
            Shape::ReciprocalTime { scale } => factor * scale / t,
            Shape::FiniteTime { start, at_ns, power } => {
                factor * start * math::pow((1.0 - t / (at_ns as f64 * 1e-9)).max(0.0), power)
            }
            Shape::Schedule { start, at_ns, eps, then } => {
                let at = at_ns as f64 * 1e-9;
                if t >= at {
                    return factor * eps * then.width(t);
                }
                factor * start * math::exp(-t / at * math::ln(start / joined(eps, then, at)))
            }
        }
    }

    /// The derivative of [`Self::width`] by time, for `t > 0` in seconds (state units / s).
    #[must_use]
    pub fn slope(&self, t: f64) -> f64 {
        let factor = self.factor;
        match self.shape {
            Shape::Exponential { start, end, rate } => -factor * rate * (start - end) * math::exp(-rate * t),
            Shape::Constant { .. } => 0.0,
            Shape::ReciprocalTime { scale } => -factor * scale / (t * t),
            Shape::FiniteTime { start, at_ns, power } => {
                let at = at_ns as f64 * 1e-9;
                let rest = 1.0 - t / at;
                if rest > 0.0 { -factor * start * power / at * math::pow(rest, power - 1.0) } else { 0.0 }
            }
            Shape::Schedule { at_ns, eps, then, .. } => {
                let at = at_ns as f64 * 1e-9;
                if t >= at {
                    return factor * eps * then.slope(t);
                }
                -self.width(t) / at * math::ln(self.width(0.0) / (factor * joined(eps, then, at)))
            }
        }
    }
}

impl Funnel<f64> {
    /// The largest slope `|psi'|`, state units / s; infinite where there is none.
    #[must_use]
    pub fn steepest_slope(&self) -> f64 {
        match self.shape {
            Shape::Exponential { start, end, rate } => self.factor * rate * (start - end).abs(),
            Shape::Constant { .. } => 0.0,
            Shape::ReciprocalTime { .. } => f64::INFINITY,
            Shape::FiniteTime { start, at_ns, power } if power >= 1.0 => {
                self.factor * start * power / (at_ns as f64 * 1e-9)
            }
            Shape::FiniteTime { .. } => f64::INFINITY,
            // Each part is steepest at its beginning or, where it widens, at its end.
            Shape::Schedule { at_ns, .. } => {
                let at = at_ns as f64 * 1e-9;
                let before = at * (1.0 - f64::EPSILON);
                [before, at].iter().fold(self.slope(0.0).abs(), |most, &t| larger(most, self.slope(t).abs()))
            }
        }
    }

    /// The largest `|psi'| / psi` up to `end` (s), 1/s; infinite where there is none.
    ///
    /// That of an exponential funnel is at the start: `|psi'| / psi` falls with the exponential in it.
    ///
    /// ```
    /// use funnelnet_law::funnel::{Funnel, Shape};
    /// let funnel = Funnel::from(Shape::Exponential { start: 4.0, end: 1.0, rate: 2.0 });
    /// assert_eq!(funnel.steepest_decay(10.0), 1.5);
    /// ```
    #[must_use]
    pub fn steepest_decay(&self, end: f64) -> f64 {
        match self.shape {
            Shape::Exponential { start, end, rate } => rate * (start - end).abs() / start,
            Shape::Constant { .. } => 0.0,
            Shape::ReciprocalTime { .. } => f64::INFINITY,
            Shape::FiniteTime { at_ns, power, .. } => {
                let left = at_ns as f64 * 1e-9 - end;
                if left > 0.0 { power / left } else { f64::INFINITY }
            }
            // The rate of the first part is constant, that of the second one largest at its beginning.
            Shape::Schedule { at_ns, .. } => {
                let decay = |t: f64| self.slope(t).abs() / self.width(t);
                larger(decay(0.0), decay(at_ns as f64 * 1e-9))
            }
        }
    }

    /// Time at which a schedule joins its parts (s); one that widens first is widest there.
    #[must_use]
    pub fn join(&self) -> Option<f64> {
        match self.shape {
            Shape::Schedule { at_ns, .. } => Some(at_ns as f64 * 1e-9),
            _ => None,
        }
    }
}

/// `(start - end) exp(-decay) + end`. Where it widens as a sum of two terms that are zero or more: the
/// difference would cancel, to zero for a start below an ulp of the end.
fn between(start: f64, end: f64, decay: f64) -> f64 {
    if end > start {
        start * math::exp(-decay) - end * math::exp_m1(-decay)
    } else {
        (start - end) * math::exp(-decay) + end
    }
}

/// `eps psibar(at)`, where the parts of a schedule join (state units); as on a node, what has closed by then
/// has a width still.
fn joined(eps: f64, then: Normalised<f64>, at: f64) -> f64 {
    (eps * then.width(at)).max(f64::TINY)
}

/// Writes it as in a scenario: `{ kind = "constant", width = 1, factor = 2 }`.
impl<F: fmt::Display> fmt::Display for Funnel<F> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{{ kind = \"{}\"", self.shape.kind())?;
        match &self.shape {
            Shape::Exponential { start, end, rate } => {
                write!(f, ", start = {start}, end = {end}, rate = {rate}")?;
            }
            Shape::Constant { width } => write!(f, ", width = {width}")?,
            Shape::ReciprocalTime { scale } => write!(f, ", scale = {scale}")?,
            Shape::FiniteTime { start, at_ns, power } => {
                write!(f, ", start = {start}, at = \"{at_ns} ns\", power = {power}")?;
            }
            Shape::Schedule { start, at_ns, eps, then } => {
                write!(f, ", start = {start}, at = \"{at_ns} ns\", eps = {eps}, then = {then}")?;
            }
        }
        write!(f, ", factor = {} }}", self.factor)
    }
}

impl<F: fmt::Display> fmt::Display for Normalised<F> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Constant { width } => write!(f, "{{ kind = \"constant\", width = {width} }}"),
            Self::Exponential { start, end, rate } => {
                write!(f, "{{ kind = \"exponential\", start = {start}, end = {end}, rate = {rate} }}")
            }
        }
    }
}
