//! The emergent trajectory `xi` of a scenario (paper, eq. (emer)), in f64, from the mean of the initial states.
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

use crate::scenario::{CouplingKind, GainSpec, NodeSpec, Scenario};
use funnel_core::emergent::{Agent, field};
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

/// The emergent dynamics of a scenario, integrated step by step.
pub struct EmergentTrajectory<'a> {
    scenario: &'a Scenario,
    gains: Vec<BuiltinGain<f64>>,
    t: f64,
    /// By component.
    xi: Vec<f64>,
    longest_step: f64,
    /// Kept between evaluations for its memory only.
    agents: Vec<Agent<f64, BuiltinGain<f64>>>,
    /// The last value of the field, from which the next search starts, by component.
    guess: Vec<f64>,
}

impl<'a> EmergentTrajectory<'a> {
    /// Starts at the mean of the initial states; `None` where a coupling has no emergent dynamics here.
    pub fn new(scenario: &'a Scenario) -> Option<Self> {
        let components = scenario.components();
        let gains = scenario.nodes.iter().map(|node| gain(node, scenario.coupling, components));
        let gains: Vec<_> = gains.collect::<Option<_>>()?;
        let count = scenario.nodes.len().max(1) as f64;
        let mean = |component| scenario.nodes.iter().map(|node| node.state[component]).sum::<f64>() / count;
        let xi = (0..components).map(mean).collect();
        let longest_step = longest_step(scenario);
        let guess = vec![0.0; components];
        Some(Self { scenario, gains, t: 0.0, xi, longest_step, agents: Vec::new(), guess })
    }

    /// `xi` at time `t` (s), which must not decrease from call to call, by component (state units).
    pub fn advance(&mut self, t: f64) -> &[f64] {
        let span = t - self.t;
        let steps = (span / self.longest_step - 1e-9).ceil().max(1.0);
        let step = span / steps;
        for index in 0..(if span > 0.0 { steps as u64 } else { 0 }) {
            let from = self.t + index as f64 * step;
            self.step(from, step);
        }
        self.t = t;
        &self.xi
    }

    /// One classical Runge-Kutta step from time `t` over `step` (both s).
    fn step(&mut self, t: f64, step: f64) {
        let half = step * 0.5;
        let ahead =
            |x: &[f64], by: f64, k: &[f64]| x.iter().zip(k).map(|(x, k)| x + by * k).collect::<Vec<_>>();
        let x = self.xi.clone();
        let k1 = self.field(t, &x);
        let k2 = self.field(t + half, &ahead(&x, half, &k1));
        let k3 = self.field(t + half, &ahead(&x, half, &k2));
        let k4 = self.field(t + step, &ahead(&x, step, &k3));
        for (c, xi) in self.xi.iter_mut().enumerate() {
            *xi = x[c] + step / 6.0 * (k1[c] + 2.0 * (k2[c] + k3[c]) + k4[c]);
        }
    }

    /// The ratios `s_i = mu_i^-1(f_em - f_i)` that hold the nodes together at the time of the last [`Self::advance`], by
    /// index: what `nu_i / psi_i` settles to under a narrow funnel. For scalar states.
    pub fn steady_ratios(&mut self) -> impl Iterator<Item = f64> {
        let xi = self.xi.clone();
        let common = self.field(self.t, &xi).first().copied().unwrap_or(0.0);
        self.agents.iter().map(move |agent| agent.gain.inverse(common - agent.f))
    }

    /// `f_em(t, xi)`, by component. The funnels enter by their ratios only, so their widest is scaled to one: a funnel that
    /// tends to zero leaves the emergent dynamics as they are (paper, remark on time-invariant emergent dynamics).
    fn field(&mut self, t: f64, xi: &[f64]) -> Vec<f64> {
        // Just after the start, where a funnel that is infinite at t = 0 has a width.
        let t_funnel = t.max(1e-9);
        let widest = self.scenario.widest_funnel(t_funnel);
        for component in 0..xi.len() {
            self.agents.clear();
            self.agents.extend(self.scenario.nodes.iter().zip(&self.gains).map(|(node, &gain)| Agent {
                psi: weight(self.scenario.coupling, node, t_funnel, widest),
                f: node.dynamics.component(component, t, xi),
                gain,
            }));
            self.guess[component] = field(&self.agents, self.guess[component]);
        }
        self.guess.clone()
    }
}

/// What stands before `mu_i^-1` in the sum that is zero.
fn weight(coupling: CouplingKind, node: &NodeSpec, t: f64, widest: f64) -> f64 {
    let averaged = matches!(coupling, CouplingKind::EdgeWise | CouplingKind::Linear);
    if averaged {
        1.0
    } else if widest > 0.0 {
        node.funnel.width(t) / widest
    } else {
        node.funnel.factor()
    }
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

fn own_gain(spec: &GainSpec) -> BuiltinGain<f64> {
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

    #[test]
    fn fast_fields_are_resolved() {
        let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../scenarios/five-agents.toml");
        let fast = (1..=5).map(|id| format!("node.{id}.dynamics={{kind='affine',slope=-3000,offset=6000}}"));
        let sets: Vec<_> = fast.chain(["time.tick=100us".to_owned()]).collect();
        let sets: Vec<_> = sets.iter().map(|set| Override::parse(set).unwrap()).collect();
        let scenario = Scenario::load(&path, &sets).unwrap();
        let xi = EmergentTrajectory::new(&scenario).unwrap().advance(0.5)[0];
        assert!((xi - 2.0).abs() < 1e-9, "{xi}");
    }
}
