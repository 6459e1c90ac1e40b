//! The emergent trajectory `xi` of a scenario (paper, eq. (emer)), in f64, from the mean of the initial states.

use crate::scenario::{GainSpec, Scenario};
use funnel_core::emergent::{Agent, field, runge_kutta};
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
    xi: f64,
    longest_step: f64,
    /// Kept between evaluations for its memory only.
    agents: Vec<Agent<f64, BuiltinGain<f64>>>,
    /// The last value of the field, from which the next search starts.
    guess: f64,
}

impl<'a> EmergentTrajectory<'a> {
    /// Starts at the mean of the initial states; `None` where a gain has no emergent dynamics here.
    pub fn new(scenario: &'a Scenario) -> Option<Self> {
        let gains: Vec<_> = scenario.nodes.iter().map(|node| gain(&node.gain)).collect::<Option<_>>()?;
        let states = scenario.initial_states();
        let xi = states.iter().sum::<f64>() / states.len().max(1) as f64;
        let longest_step = longest_step(scenario);
        Some(Self { scenario, gains, t: 0.0, xi, longest_step, agents: Vec::new(), guess: 0.0 })
    }

    /// `xi` at time `t` (s), which must not decrease from call to call (state units).
    pub fn advance(&mut self, t: f64) -> f64 {
        let span = t - self.t;
        let steps = (span / self.longest_step - 1e-9).ceil().max(1.0);
        let step = span / steps;
        for index in 0..(if span > 0.0 { steps as u64 } else { 0 }) {
            let from = self.t + index as f64 * step;
            self.xi = runge_kutta(from, self.xi, step, |t, x| self.field(t, x));
        }
        self.t = t;
        self.xi
    }

    /// The ratios `s_i = mu_i^-1(f_em - f_i)` that hold the nodes together at the time of the last [`Self::advance`], by
    /// index: what `nu_i / psi_i` settles to under a narrow funnel.
    pub fn steady_ratios(&mut self) -> impl Iterator<Item = f64> {
        let common = self.field(self.t, self.xi);
        self.agents.iter().map(move |agent| agent.gain.inverse(common - agent.f))
    }

    /// `f_em(t, xi)`. The funnels enter by their ratios only, so their widest is scaled to one: a funnel that tends to
    /// zero leaves the emergent dynamics as they are (paper, remark on time-invariant emergent dynamics).
    fn field(&mut self, t: f64, xi: f64) -> f64 {
        // Just after the start, where a funnel that is infinite at t = 0 has a width.
        let t_funnel = t.max(1e-9);
        let widest = self.scenario.widest_funnel(t_funnel);
        self.agents.clear();
        self.agents.extend(self.scenario.nodes.iter().zip(&self.gains).map(|(node, &gain)| Agent {
            psi: if widest > 0.0 { node.funnel.width(t_funnel) / widest } else { node.funnel.factor() },
            f: node.dynamics.value(t, xi),
            gain,
        }));
        self.guess = field(&self.agents, self.guess);
        self.guess
    }
}

fn gain(spec: &GainSpec) -> Option<BuiltinGain<f64>> {
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

    #[test]
    fn fast_fields_are_resolved() {
        let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../scenarios/five-agents.toml");
        let fast = (1..=5).map(|id| format!("node.{id}.dynamics={{kind='affine',slope=-3000,offset=6000}}"));
        let sets: Vec<_> = fast.chain(["time.tick=100us".to_owned()]).collect();
        let sets: Vec<_> = sets.iter().map(|set| Override::parse(set).unwrap()).collect();
        let scenario = Scenario::load(&path, &sets).unwrap();
        let xi = EmergentTrajectory::new(&scenario).unwrap().advance(0.5);
        assert!((xi - 2.0).abs() < 1e-9, "{xi}");
    }
}
