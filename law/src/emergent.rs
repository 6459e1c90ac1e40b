//! Emergent dynamics: what the network does as one (paper, Section "Emergent behavior under funnel
//! coupling").

use crate::gain::GainFunction;
use crate::math::Real;
use crate::root;

/// One agent as the emergent vector field sees it.
///
/// ```
/// use funnelnet_law::emergent::{Agent, field};
/// use funnelnet_law::gain::Median;
/// // Five agents with a median gain and equal funnels move with the median of their fields, whatever the outlier does.
/// let gain = Median { eta: 0.01, eps: 0.1 };
/// let agents = [1.0, 1.1, 1.2, 1.3, 1000.0].map(|f| Agent { psi: 1.0, f, gain });
/// assert!((field(&agents, 0.0) - 1.2_f64).abs() < 0.01);
/// ```
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Agent<F, G> {
    /// `psi_i(t)`, state units, positive.
    pub psi: F,
    /// `f_i(t, xi)`, state units / s.
    pub f: F,
    /// Gain.
    pub gain: G,
}

/// The emergent vector field `h`: the one root of `H(h) = sum_i psi_i mu_i^-1(h - f_i)` (paper, (19), alg).
///
/// Safeguarded Newton between `min f_i` and `max f_i` (paper, (20), hminmax), starting at `guess` where that
/// lies between. O(N) per evaluation, within some roundings of the larger of `|h|` and the spread of the
/// fields. Zero for no agents.
#[must_use]
pub fn field<F: Real, G: GainFunction<F>>(agents: &[Agent<F, G>], guess: F) -> F {
    let Some(first) = agents.first() else { return F::ZERO };
    let (low, high) = agents.iter().fold((first.f, first.f), |(low, high), a| (low.min(a.f), high.max(a.f)));
    let start = if guess >= low && guess <= high { guess } else { (low + high) * F::HALF };
    root::increasing(low, high, start, |h| h_and_slope(agents, h))
}

/// `dh/df_i = psi_i (mu_i^-1)'(h - f_i) / sum_j psi_j (mu_j^-1)'(h - f_j)` at the root `h`, by index (paper,
/// Section "Numerical integration"). Not negative, and their sum is 1.
pub fn partials_by_field<F: Real, G: GainFunction<F>>(
    agents: &[Agent<F, G>],
    h: F,
) -> impl Iterator<Item = F> {
    let lift = lift(agents, h);
    let total = total_steepness(agents, h, lift);
    agents.iter().map(move |agent| steepness(agent, h, lift) / total)
}

/// `dh/dt = - sum_j psi_j' mu_j^-1(h - f_j) / sum_j psi_j (mu_j^-1)'(h - f_j)` with the fields held (state
/// units / s^2; paper, Section "Numerical integration").
///
/// `psi_rates` are the `psi_j'` by index, state units / s. Zero, but for rounding, where all `psi_j' / psi_j`
/// are equal.
#[must_use]
pub fn partial_by_time<F: Real, G: GainFunction<F>>(
    agents: &[Agent<F, G>],
    h: F,
    psi_rates: impl IntoIterator<Item = F>,
) -> F {
    let lift = lift(agents, h);
    let moved = agents
        .iter()
        .zip(psi_rates)
        .fold(F::ZERO, |sum, (agent, rate)| sum + rate * agent.gain.inverse(h - agent.f));
    // Zero stays zero where the factor overflows.
    let lifted = if moved == F::ZERO { moved } else { moved * lift.exp() };
    -lifted / total_steepness(agents, h, lift)
}

/// `df_em/dxi = sum_i dh/df_i df_i/dx` at the root `h` (1/s): the emergent dynamics contract where it is
/// negative (paper, (22), contractive_emer). `slopes` are the `df_i/dx` by index, 1/s; it lies between the
/// smallest and the largest of them.
///
/// ```
/// use funnelnet_law::emergent::{Agent, contraction, field};
/// use funnelnet_law::gain::Reciprocal;
/// // One unstable agent of three (slope +1), held by two stable ones (slope -3): together they contract.
/// let agents = [0.0, 0.1, -0.1].map(|f| Agent { psi: 1.0, f, gain: Reciprocal { scale: 1.0 } });
/// let h = field(&agents, 0.0_f64);
/// assert!(contraction(&agents, h, [1.0, -3.0, -3.0]) < 0.0);
/// ```
#[must_use]
pub fn contraction<F: Real, G: GainFunction<F>>(
    agents: &[Agent<F, G>],
    h: F,
    slopes: impl IntoIterator<Item = F>,
) -> F {
    partials_by_field(agents, h).zip(slopes).fold(F::ZERO, |sum, (weight, slope)| sum + weight * slope)
}

/// `H` and its slope, or both times the same positive factor, which moves no root.
///
/// Far from its field an agent adds nearly `psi_i` or `-psi_i`. Where these cancel, as with equal funnels on
/// both sides, the root depends on what is missing to 1; so the whole `psi_i` are summed exactly, apart from
/// the gaps.
fn h_and_slope<F: Real, G: GainFunction<F>>(agents: &[Agent<F, G>], h: F) -> (F, F) {
    let lift = lift(agents, h);
    let (mut whole, mut rest, mut slope) = (ExactSum::default(), F::ZERO, F::ZERO);
    for agent in agents {
        let u = h - agent.f;
        let (inverse, near_slope) = agent.gain.inverse_with_slope(u);
        if inverse.abs() <= F::HALF {
            rest += agent.psi * inverse;
            slope += agent.psi * near_slope;
        } else {
            let (gap, far_slope) = agent.gain.gap_with_slope(u, lift);
            let psi = agent.psi.copysign(u);
            whole.add(psi);
            rest += -(psi * gap);
            slope += agent.psi * far_slope;
        }
    }
    if lift == F::ZERO || whole.high + whole.low == F::ZERO {
        return (whole.high + rest + whole.low, slope);
    }
    let fall = (-lift).exp();
    (whole.high + rest * fall + whole.low, slope * fall)
}

/// `psi_i (mu_i^-1)'(h - f_i) e^lift`.
fn steepness<F: Real, G: GainFunction<F>>(agent: &Agent<F, G>, h: F, lift: F) -> F {
    agent.psi * agent.gain.gap_with_slope(h - agent.f, lift).1
}

fn total_steepness<F: Real, G: GainFunction<F>>(agents: &[Agent<F, G>], h: F, lift: F) -> F {
    agents.iter().fold(F::ZERO, |total, agent| total + steepness(agent, h, lift))
}

/// The smallest decay of all agents at `h`: without it, the gaps of logarithmic gains would all underflow
/// between two groups. Zero where an agent is near its field.
fn lift<F: Real, G: GainFunction<F>>(agents: &[Agent<F, G>], h: F) -> F {
    let decays = agents.iter().map(|agent| agent.gain.decay(h - agent.f));
    let smallest = decays.reduce(F::min).unwrap_or(F::ZERO);
    if smallest > F::ONE { smallest } else { F::ZERO }
}

/// A sum and its rounding error (D. E. Knuth, The Art of Computer Programming 2, 4.2.2).
#[derive(Default)]
struct ExactSum<F> {
    high: F,
    low: F,
}

impl<F: Real> ExactSum<F> {
    fn add(&mut self, term: F) {
        let sum = self.high + term;
        let part = sum - self.high;
        self.low += (self.high - (sum - part)) + (term - part);
        self.high = sum;
    }
}

/// One classical Runge-Kutta step of `xdot = f(t, x)` from `t` to `t + step` (both s).
#[must_use]
pub fn runge_kutta<F: Real>(t: F, x: F, step: F, mut f: impl FnMut(F, F) -> F) -> F {
    let half = step * F::HALF;
    let k1 = f(t, x);
    let k2 = f(t + half, x + half * k1);
    let k3 = f(t + half, x + half * k2);
    let k4 = f(t + step, x + step * k3);
    x + step / F::from_u32(6) * (k1 + F::TWO * (k2 + k3) + k4)
}
