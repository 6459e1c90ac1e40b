//! What the network does as one: the emergent trajectory `xi` of a scenario (paper, eq. (emer)), in f64, from the mean of the
//! initial states, and the blended dynamics beside it.

mod agents;
mod blended;
mod chi;
mod predictor;

pub use blended::BlendedTrajectory;
pub use chi::ChiTrajectory;
pub use predictor::{Contraction, Prediction, Predictor};

use crate::scenario::{GainSpec, Scenario};
use agents::Agents;
use funnel_core::emergent::{contraction, runge_kutta};
use funnel_core::gain::{BuiltinGain, Gain, LocallyLinear, Logarithmic, Reciprocal, median};

/// Longest integration step, s.
const LONGEST_STEP: f64 = 0.002;
/// Steps per shortest time constant of the fields; the method is stable from 0.36 on.
const STEPS_PER_CONSTANT: f64 = 4.0;

/// A step that resolves every slope and frequency of the fields, but no shorter than the tick, which resolves them for the
/// nodes.
fn longest_step(scenario: &Scenario) -> f64 {
    let rates = scenario.nodes.iter().flat_map(|node| {
        let sines = node.dynamics.sines.iter().map(|sine| sine.frequency.abs());
        sines.chain([node.dynamics.slope.abs()])
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

/// The mean of the initial states (state units).
fn mean_state(scenario: &Scenario) -> f64 {
    let states = scenario.initial_states();
    states.iter().sum::<f64>() / states.len().max(1) as f64
}

/// The emergent dynamics of a scenario, integrated step by step.
pub struct EmergentTrajectory<'a> {
    agents: Agents<'a>,
    t: f64,
    xi: f64,
    longest_step: f64,
}

impl<'a> EmergentTrajectory<'a> {
    /// Starts at the mean of the initial states; `None` where a gain has no emergent dynamics here.
    pub fn new(scenario: &'a Scenario) -> Option<Self> {
        let (agents, longest_step) = (Agents::new(scenario)?, longest_step(scenario));
        Some(Self { agents, t: 0.0, xi: mean_state(scenario), longest_step })
    }

    /// `xi` at time `t` (s), which must not decrease from call to call (state units).
    pub fn advance(&mut self, t: f64) -> f64 {
        for (from, step) in steps(self.t, t, self.longest_step) {
            self.xi = runge_kutta(from, self.xi, step, |t, x| self.agents.field(t, x));
        }
        self.t = t;
        self.xi
    }

    /// The ratios `s_i = mu_i^-1(f_em - f_i)` that hold the nodes together at the time of the last [`Self::advance`], by
    /// index: what `nu_i / psi_i` settles to under a narrow funnel.
    pub fn steady_ratios(&mut self) -> impl Iterator<Item = f64> {
        let common = self.agents.field(self.t, self.xi);
        self.agents.placed.iter().map(move |agent| agent.gain.inverse(common - agent.f))
    }

    /// `df_em/dxi` at the time of the last [`Self::advance`] (1/s): negative where the emergent dynamics contract.
    pub fn contraction(&mut self) -> f64 {
        let common = self.agents.field(self.t, self.xi);
        contraction(&self.agents.placed, common, self.agents.slopes())
    }
}

pub(crate) fn gain(spec: &GainSpec) -> Option<BuiltinGain<f64>> {
    match *spec {
        GainSpec::Reciprocal { scale } => Some(BuiltinGain::Reciprocal(Reciprocal { scale })),
        GainSpec::Logarithmic { scale } => Some(BuiltinGain::Logarithmic(Logarithmic { scale })),
        GainSpec::LocallyLinear { bound } => Some(BuiltinGain::LocallyLinear(LocallyLinear { bound })),
        GainSpec::Median { eta, eps } => Some(BuiltinGain::Reciprocal(median(eta, eps))),
        GainSpec::Linear { .. } => None,
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
        let xi = EmergentTrajectory::new(&scenario).unwrap().advance(0.5);
        assert!((xi - 2.0).abs() < 1e-9, "{xi}");
        let blended = BlendedTrajectory::new(&scenario).advance(0.5);
        assert!((blended - 2.0).abs() < 1e-9, "{blended}");
    }
}
