//! The emergent trajectory `xi` of a scenario (paper, eq. (emer)), in f64, from the mean of the initial states.

use crate::scenario::{GainSpec, Scenario};
use funnel_core::emergent::{Agent, field, runge_kutta};
use funnel_core::gain::{BuiltinGain, LocallyLinear, Logarithmic, Reciprocal, median};

/// Longest integration step, s: far below every time constant that a scenario can excite at its tick.
const LONGEST_STEP: f64 = 0.002;

/// The emergent dynamics of a scenario, integrated step by step.
pub struct EmergentTrajectory<'a> {
    scenario: &'a Scenario,
    gains: Vec<BuiltinGain<f64>>,
    t: f64,
    xi: f64,
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
        Some(Self { scenario, gains, t: 0.0, xi, agents: Vec::new(), guess: 0.0 })
    }

    /// `xi` at time `t` (s), which must not decrease from call to call (state units).
    pub fn advance(&mut self, t: f64) -> f64 {
        let span = t - self.t;
        let steps = (span / LONGEST_STEP - 1e-9).ceil().max(1.0);
        let step = span / steps;
        for index in 0..(if span > 0.0 { steps as u64 } else { 0 }) {
            let from = self.t + index as f64 * step;
            self.xi = runge_kutta(from, self.xi, step, |t, x| self.field(t, x));
        }
        self.t = t;
        self.xi
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
