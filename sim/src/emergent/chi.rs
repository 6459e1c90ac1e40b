//! The emergent dynamics without a root finder (paper, (23), chi): `chi = h` is integrated along with `xi`.
//!
//! An independent check of [`EmergentTrajectory`](super::EmergentTrajectory). The equation says `dH/dt = 0`,
//! so that an error of `chi` stays: with `xi' = chi` and `e = chi - f_em(t, xi)`,
//! `e' = -e d/dt ln(sum_j psi_j (mu_j^-1)')` to first order. The paper has `df_em/dxi` in addition there,
//! which the `chi` in `d/dt f_em(t, xi)` takes away again. Hence the small tolerance, and the funnels scaled
//! by their widest: with funnels that tend to zero, `e` would grow as they shrink.

use super::agents::Agents;
use super::{STEPS_PER_CONSTANT, fastest, follows_the_paper, start};
use crate::extremes::{larger, smaller};
use crate::scenario::Scenario;
use funnelnet_law::emergent::{contraction, partial_by_time, partials_by_field};

/// Largest estimated error of a step, relative to `1 + |xi|` and `1 + |chi|`.
const TOLERANCE: f64 = 1e-11;
/// First and longest step, s, unless the fields ask for a shorter one.
const LONGEST_STEP: f64 = 0.01;
/// A step that is accepted whatever its error, s: `chi` jumps where a funnel closes.
const SHORTEST_STEP: f64 = 1e-9;

/// `xi` and `chi`.
type Pair = [f64; 2];

/// `(xi, chi)` with `xi' = chi`, `chi' = g(t, chi, xi)`, by Runge-Kutta steps of controlled length.
pub struct ChiTrajectory<'a> {
    agents: Agents<'a>,
    t: f64,
    state: Pair,
    step: f64,
    /// A step resolves the fields: where a ripple turns whole times in half a step, the estimate of its error
    /// is zero.
    longest: f64,
}

impl<'a> ChiTrajectory<'a> {
    /// Starts at the mean of the initial states, with `chi = h + offset` (state units / s; the paper's is
    /// zero); `None` for vector states, and where the coupling is not the paper's.
    pub fn new(scenario: &'a Scenario, offset: f64) -> Option<Self> {
        let mut agents = Agents::new(scenario).filter(|_| follows_the_paper(scenario.coupling))?;
        let &[xi] = start(scenario).as_slice() else { return None };
        let chi = agents.field(0.0, xi) + offset;
        let longest = smaller(LONGEST_STEP, 1.0 / (STEPS_PER_CONSTANT * fastest(scenario)));
        Some(Self { agents, t: 0.0, state: [xi, chi], step: longest, longest })
    }

    /// `(xi, chi)` at time `t` (s), which must not decrease from call to call (state units, state units / s).
    pub fn advance(&mut self, t: f64) -> (f64, f64) {
        while self.t < t {
            let rest = t - self.t;
            let step = self.step.min(rest);
            let (next, error) = self.doubled(step);
            // What is not a number is no better with a shorter step, and is passed on.
            let rejected = error > TOLERANCE && step > SHORTEST_STEP;
            if !rejected {
                // The last step ends at `t` itself, not beside it by a rounding.
                self.t = if step == rest { t } else { self.t + step };
                self.state = next;
            }
            // The error of a step is of fifth order.
            let factor = 0.9 * funnelnet_law::math::pow(TOLERANCE / error.max(1e-30), 0.2);
            self.step = (step * factor.clamp(0.2, 2.0)).clamp(SHORTEST_STEP, self.longest.max(SHORTEST_STEP));
        }
        let [xi, chi] = self.state;
        (xi, chi)
    }

    /// Two half steps, improved by what one whole step differs from them, and the relative size of that
    /// difference.
    fn doubled(&mut self, step: f64) -> (Pair, f64) {
        let half = 0.5 * step;
        let whole = self.runge_kutta(self.t, self.state, step);
        let middle = self.runge_kutta(self.t, self.state, half);
        let fine = self.runge_kutta(self.t + half, middle, half);
        let difference = [0, 1].map(|k| (fine[k] - whole[k]) / 15.0);
        let error = [0, 1].map(|k| difference[k].abs() / (1.0 + fine[k].abs()));
        ([0, 1].map(|k| fine[k] + difference[k]), larger(error[0], error[1]))
    }

    fn runge_kutta(&mut self, t: f64, y: Pair, step: f64) -> Pair {
        let half = 0.5 * step;
        let ahead = |slope: Pair, step: f64| [0, 1].map(|k| y[k] + step * slope[k]);
        let k1 = self.field(t, y);
        let k2 = self.field(t + half, ahead(k1, half));
        let k3 = self.field(t + half, ahead(k2, half));
        let k4 = self.field(t + step, ahead(k3, step));
        [0, 1].map(|k| y[k] + step / 6.0 * (k1[k] + 2.0 * (k2[k] + k3[k]) + k4[k]))
    }

    /// The right side of (23), chi, for funnels scaled by their widest.
    fn field(&mut self, t: f64, [xi, chi]: Pair) -> Pair {
        self.agents.place(t, xi);
        let agents = &self.agents.placed;
        let forcing = self.agents.scenario.nodes.iter().map(|node| node.dynamics.rate(t, xi));
        let by_fields: f64 =
            partials_by_field(agents, chi).zip(forcing).map(|(weight, rate)| weight * rate).sum();
        let by_state = contraction(agents, chi, self.agents.slopes(t, xi)) * chi;
        [chi, by_fields + by_state + partial_by_time(agents, chi, self.agents.psi_rates(t))]
    }
}

#[cfg(test)]
mod tests {
    use super::super::EmergentTrajectory;
    use super::super::tests::five_agents;
    use super::*;
    use funnelnet_law::GainFunction;

    /// Largest distance of both `xi` over 20 s, and of `chi` to the field at the end.
    fn distance(sets: &[&str]) -> (f64, f64) {
        let scenario = five_agents(sets);
        let mut by_root = EmergentTrajectory::new(&scenario).unwrap();
        let mut by_chi = ChiTrajectory::new(&scenario, 0.0).unwrap();
        let mut worst: f64 = 0.0;
        for k in 0..=2000 {
            let t = 0.01 * f64::from(k);
            worst = worst.max((by_root.advance(t)[0] - by_chi.advance(t).0).abs());
        }
        let (xi, chi) = by_chi.advance(20.0);
        (worst, (by_chi.agents.field(20.0, xi) - chi).abs())
    }

    #[test]
    fn example_3_by_root_and_by_chi() {
        let (worst, last) = distance(&[]);
        assert!(worst < 1e-6 && last < 1e-6, "{worst:e} {last:e}");
    }

    #[test]
    fn funnels_that_differ_in_factor_rate_and_kind() {
        let sets = [
            "node.1.funnel={factor=3.0}",
            "node.2.funnel={rate=0.3}",
            "node.3.funnel={rate=2.0,factor=0.4}",
            "node.4.funnel={kind='finite-time',start=50.0,at='25s',power=2.0}",
            "node.5.funnel={kind='constant',width=20.0}",
        ];
        let (worst, last) = distance(&sets);
        assert!(worst < 1e-6 && last < 1e-6, "{worst:e} {last:e}");
    }

    #[test]
    fn other_gains() {
        let sets = [
            "node.2.gain={kind='logarithmic',scale=2.0}",
            "node.3.gain={kind='locally-linear',bound=3.0}",
            "node.4.gain={scale=0.5}",
            "node.5.funnel={rate=0.5}",
        ];
        let (worst, last) = distance(&sets);
        assert!(worst < 1e-6 && last < 1e-6, "{worst:e} {last:e}");
    }

    #[test]
    fn an_error_of_chi_stays() {
        // Eq. (chi) is dH/dt = 0, so H keeps whatever value it starts with, and chi is off by about H / sum
        // psi_j (mu_j^-1)': bounded, not forgotten.
        let scenario = five_agents(&[]);
        let mut by_chi = ChiTrajectory::new(&scenario, 0.1).unwrap();
        let h = |by_chi: &mut ChiTrajectory<'_>| -> f64 {
            let [xi, chi] = by_chi.state;
            by_chi.agents.place(by_chi.t, xi);
            by_chi.agents.placed.iter().map(|agent| agent.psi * agent.gain.inverse(chi - agent.f)).sum()
        };
        let before = h(&mut by_chi);
        assert!(before > 0.01);
        by_chi.advance(20.0);
        let after = h(&mut by_chi);
        assert!((after - before).abs() < 1e-6, "{before} {after}");
    }
}
