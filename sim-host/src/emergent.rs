//! The emergent trajectory `xi` of a scenario (paper, eq. (emer)), in f64, from the mean of the initial states.

use crate::scenario::{GainSpec, Scenario};
use funnel_core::emergent::{Agent, field, runge_kutta};
use funnel_core::gain::{BuiltinGain, Logarithmic, Reciprocal};

/// Longest integration step, s: far below every time constant that a scenario can excite at its tick.
const LONGEST_STEP: f64 = 0.002;

/// `xi` at the times `k * interval` (s) for `k` in `0..count`; `None` where a gain has no emergent dynamics here.
pub fn trajectory(scenario: &Scenario, interval: f64, count: usize) -> Option<Vec<f64>> {
    let gains: Vec<_> = scenario.nodes.iter().map(|node| gain(&node.gain)).collect::<Option<_>>()?;
    let mut network = Network { scenario, gains, agents: Vec::new(), guess: 0.0 };
    let states = scenario.initial_states();
    let mut xi = states.iter().sum::<f64>() / states.len() as f64;
    let substeps = (interval / LONGEST_STEP).ceil().max(1.0);
    let step = interval / substeps;
    let mut trajectory = Vec::with_capacity(count);
    for k in 0..count {
        trajectory.push(xi);
        for substep in 0..substeps as u64 {
            let t = k as f64 * interval + substep as f64 * step;
            xi = runge_kutta(t, xi, step, |t, x| network.field(t, x));
        }
    }
    Some(trajectory)
}

struct Network<'a> {
    scenario: &'a Scenario,
    gains: Vec<BuiltinGain<f64>>,
    /// Kept between evaluations for its memory only.
    agents: Vec<Agent<f64, BuiltinGain<f64>>>,
    /// The last value, from which the next search starts.
    guess: f64,
}

impl Network<'_> {
    /// `f_em(t, xi)`. The funnels enter by their ratios only, so their widest is scaled to one: a funnel that tends to
    /// zero leaves the emergent dynamics as they are (paper, remark on time-invariant emergent dynamics).
    fn field(&mut self, t: f64, xi: f64) -> f64 {
        let widest = self.scenario.widest_funnel(t);
        self.agents.clear();
        self.agents.extend(self.scenario.nodes.iter().zip(&self.gains).map(|(node, &gain)| Agent {
            psi: if widest > 0.0 { node.funnel.width(t) / widest } else { node.funnel.factor() },
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
        GainSpec::LocallyLinear { .. } | GainSpec::Median { .. } | GainSpec::Linear { .. } => None,
    }
}
