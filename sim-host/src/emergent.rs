//! What the network does as one: the emergent trajectory `xi` of a scenario (paper, eq. (emer)), in f64, from the mean of the
//! initial states, and the blended dynamics beside it.
//!
//! What the inputs of a coupling add up to gives its emergent field `h`, component by component:
//!
//! | coupling | adds up to zero | `h` |
//! |---|---|---|
//! | node-wise, element-wise, and maximum gain for scalar states | `nu_i = psi_i mu_i^-1(u_i)` | paper, eq. (alg) |
//! | linear | `nu_i = u_i / k_i` | the average with weights `1 / k_i` |
//! | edge-wise | `u_i` | the average |
//! | weakly centralised | `nu_i = psi_i u_i / G` | the average with weights `psi_i` |
//!
//! Maximum gain ties the components of a vector together, and the gains of lambda-trackers depend on their past: neither has an `h`
//! that is found here.

mod agents;
mod blended;
mod chi;
mod predictor;

pub use blended::BlendedTrajectory;
pub use chi::ChiTrajectory;
pub use predictor::{Contraction, Prediction, Predictor};

use crate::scenario::{CouplingKind, GainSpec, NodeSpec, Scenario};
use agents::Agents;
use funnel_core::emergent::contraction;
use funnel_core::gain::{BuiltinGain, Gain, Linear, LocallyLinear, Logarithmic, Reciprocal, median};

/// Longest integration step, s.
const LONGEST_STEP: f64 = 0.002;
/// Steps per shortest time constant of the fields; the method is stable from 0.36 on.
const STEPS_PER_CONSTANT: f64 = 4.0;

/// A step that resolves every slope and frequency of the fields, but no shorter than the tick, which resolves them for the
/// nodes.
fn longest_step(scenario: &Scenario) -> f64 {
    let rates = scenario.nodes.iter().flat_map(|node| {
        let sines = node.dynamics.sines.iter().map(|sine| sine.frequency.abs());
        sines.chain([node.dynamics.lipschitz()])
    });
    let fastest = rates.fold(0.0, f64::max);
    (1.0 / (STEPS_PER_CONSTANT * fastest)).max(scenario.time.tick_s()).min(LONGEST_STEP)
}

/// Equal steps from `from` to `to` (s), none longer than `longest`: where each begins, and how long it is.
fn steps(from: f64, to: f64, longest: f64) -> impl Iterator<Item = (f64, f64)> {
    let span = to - from;
    let count = (span / longest - 1e-9).ceil().max(1.0);
    let step = span / count;
    (0..(if span > 0.0 { count as u64 } else { 0 })).map(move |index| (from + index as f64 * step, step))
}

/// The mean of the initial states, by component (state units).
fn mean_state(scenario: &Scenario) -> Vec<f64> {
    let count = scenario.nodes.len().max(1) as f64;
    let mean =
        |component| scenario.nodes.iter().map(|node: &NodeSpec| node.state[component]).sum::<f64>() / count;
    (0..scenario.components()).map(mean).collect()
}

/// One classical Runge-Kutta step of `x' = f(t, x)` from `t` over `step` (both s), for all components at once.
fn runge_kutta(t: f64, x: &[f64], step: f64, mut f: impl FnMut(f64, &[f64]) -> Vec<f64>) -> Vec<f64> {
    let half = step * 0.5;
    let ahead = |by: f64, k: &[f64]| x.iter().zip(k).map(|(x, k)| x + by * k).collect::<Vec<_>>();
    let k1 = f(t, x);
    let k2 = f(t + half, &ahead(half, &k1));
    let k3 = f(t + half, &ahead(half, &k2));
    let k4 = f(t + step, &ahead(step, &k3));
    let next = |(c, x): (usize, &f64)| x + step / 6.0 * (k1[c] + 2.0 * (k2[c] + k3[c]) + k4[c]);
    x.iter().enumerate().map(next).collect()
}

/// The emergent dynamics of a scenario, integrated step by step.
pub struct EmergentTrajectory<'a> {
    agents: Agents<'a>,
    t: f64,
    /// By component.
    xi: Vec<f64>,
    longest_step: f64,
}

impl<'a> EmergentTrajectory<'a> {
    /// Starts at the mean of the initial states; `None` where a coupling has no emergent dynamics here.
    pub fn new(scenario: &'a Scenario) -> Option<Self> {
        let (agents, longest_step) = (Agents::new(scenario)?, longest_step(scenario));
        Some(Self { agents, t: 0.0, xi: mean_state(scenario), longest_step })
    }

    /// `xi` at time `t` (s), which must not decrease from call to call, by component (state units).
    pub fn advance(&mut self, t: f64) -> &[f64] {
        for (from, step) in steps(self.t, t, self.longest_step) {
            self.xi = runge_kutta(from, &self.xi, step, |t, x| self.agents.fields(t, x));
        }
        self.t = t;
        &self.xi
    }

    /// The ratios `s_i = mu_i^-1(f_em - f_i)` that hold the nodes together at the time of the last [`Self::advance`], by
    /// index: what `nu_i / psi_i` settles to under a narrow funnel. Empty for vector states, and where the coupling is not one of
    /// diffusive terms in funnels.
    pub fn steady_ratios(&mut self) -> impl Iterator<Item = f64> {
        let common = match self.xi.as_slice() {
            &[xi] if follows_the_paper(self.agents.scenario.coupling) => Some(self.agents.field(self.t, xi)),
            _ => None,
        };
        let placed = &self.agents.placed;
        common
            .into_iter()
            .flat_map(move |common| placed.iter().map(move |agent| agent.gain.inverse(common - agent.f)))
    }

    /// `df_em/dxi` at the time of the last [`Self::advance`] (1/s): negative where the emergent dynamics contract. `None` for
    /// vector states.
    pub fn contraction(&mut self) -> Option<f64> {
        let &[xi] = self.xi.as_slice() else { return None };
        let common = self.agents.field(self.t, xi);
        Some(contraction(&self.agents.placed, common, self.agents.slopes()))
    }
}

/// Whether scalar states follow the paper's law.
fn follows_the_paper(coupling: CouplingKind) -> bool {
    matches!(coupling, CouplingKind::NodeWise | CouplingKind::ElementWise | CouplingKind::MaxGain)
}

/// The gain as it enters that sum; `None` where there is no such sum.
fn gain(node: &NodeSpec, coupling: CouplingKind, components: usize) -> Option<BuiltinGain<f64>> {
    match coupling {
        CouplingKind::EdgeWise | CouplingKind::WeaklyCentralised => {
            Some(BuiltinGain::Linear(Linear { slope: 1.0 }))
        }
        CouplingKind::LambdaTracker { .. } | CouplingKind::None => None,
        CouplingKind::MaxGain if components > 1 => None,
        CouplingKind::Linear => Some(own_gain(&node.gain)),
        // The weights are scaled funnels, which do not enter where a gain is linear.
        _ if matches!(node.gain, GainSpec::Linear { .. }) => None,
        _ => Some(own_gain(&node.gain)),
    }
}

pub(crate) fn own_gain(spec: &GainSpec) -> BuiltinGain<f64> {
    match *spec {
        GainSpec::Reciprocal { scale } => BuiltinGain::Reciprocal(Reciprocal { scale }),
        GainSpec::Logarithmic { scale } => BuiltinGain::Logarithmic(Logarithmic { scale }),
        GainSpec::LocallyLinear { bound } => BuiltinGain::LocallyLinear(LocallyLinear { bound }),
        GainSpec::Median { eta, eps } => BuiltinGain::Reciprocal(median(eta, eps)),
        GainSpec::Linear { slope } => BuiltinGain::Linear(Linear { slope }),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scenario::Override;
    use std::path::Path;

    /// Example 3, with values replaced.
    pub(super) fn five_agents(sets: &[&str]) -> Scenario {
        let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../scenarios/five-agents.toml");
        let sets: Vec<_> = sets.iter().map(|set| Override::parse(set).unwrap()).collect();
        Scenario::load(&path, &sets).unwrap()
    }

    #[test]
    fn fast_fields_are_resolved() {
        let fast = (1..=5).map(|id| format!("node.{id}.dynamics={{kind='affine',slope=-3000,offset=6000}}"));
        let sets: Vec<_> = fast.chain(["time.tick=100us".to_owned()]).collect();
        let scenario = five_agents(&sets.iter().map(String::as_str).collect::<Vec<_>>());
        let xi = EmergentTrajectory::new(&scenario).unwrap().advance(0.5)[0];
        assert!((xi - 2.0).abs() < 1e-9, "{xi}");
        let blended = BlendedTrajectory::new(&scenario).advance(0.5)[0];
        assert!((blended - 2.0).abs() < 1e-9, "{blended}");
    }
}
