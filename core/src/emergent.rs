//! Emergent dynamics: what the network does as one (paper, Section "Emergent behavior under funnel coupling").

use crate::gain::Gain;
use crate::math::Real;
use crate::root;

/// One agent as the emergent vector field sees it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Agent<F, G> {
    /// `psi_i(t)`, state units, positive.
    pub psi: F,
    /// `f_i(t, xi)`, state units / s.
    pub f: F,
    /// Gain.
    pub gain: G,
}

/// The emergent vector field `h`: the one root of `H(h) = sum_i psi_i mu_i^-1(h - f_i)` (paper, eq. (alg)).
///
/// Safeguarded Newton between `min f_i` and `max f_i` (paper, eq. (hminmax)), starting at `guess` where that lies between.
/// O(N) per evaluation. Zero for no agents.
pub fn field<F: Real, G: Gain<F>>(agents: &[Agent<F, G>], guess: F) -> F {
    let Some(first) = agents.first() else { return F::ZERO };
    let (low, high) = agents.iter().fold((first.f, first.f), |(low, high), a| (low.min(a.f), high.max(a.f)));
    let start = if guess >= low && guess <= high { guess } else { (low + high) * F::HALF };
    root::increasing(low, high, start, |h| h_and_slope(agents, h))
}

fn h_and_slope<F: Real, G: Gain<F>>(agents: &[Agent<F, G>], h: F) -> (F, F) {
    agents.iter().fold((F::ZERO, F::ZERO), |(value, slope), agent| {
        let (inverse, inverse_slope) = agent.gain.inverse_with_slope(h - agent.f);
        (value + agent.psi * inverse, slope + agent.psi * inverse_slope)
    })
}

/// One classical Runge-Kutta step of `xdot = f(t, x)` from `t` to `t + step` (both s).
pub fn runge_kutta<F: Real>(t: F, x: F, step: F, mut f: impl FnMut(F, F) -> F) -> F {
    let half = step * F::HALF;
    let k1 = f(t, x);
    let k2 = f(t + half, x + half * k1);
    let k3 = f(t + half, x + half * k2);
    let k4 = f(t + step, x + step * k3);
    x + step / F::from_u32(6) * (k1 + F::TWO * (k2 + k3) + k4)
}
