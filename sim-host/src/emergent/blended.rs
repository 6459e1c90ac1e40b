//! The blended dynamics of a scenario (paper, eq. (blend)): the plain average of the fields, which a linear high-gain coupling
//! follows and funnel coupling in general does not.

use super::{longest_step, runge_kutta, steps};
use crate::scenario::Scenario;

/// The blended dynamics, integrated step by step from the mean of the initial states.
pub struct BlendedTrajectory<'a> {
    scenario: &'a Scenario,
    t: f64,
    /// By component.
    x: Vec<f64>,
    longest_step: f64,
}

impl<'a> BlendedTrajectory<'a> {
    /// Starts at the mean of the initial states.
    pub fn new(scenario: &'a Scenario) -> Self {
        Self { scenario, t: 0.0, x: super::mean_state(scenario), longest_step: longest_step(scenario) }
    }

    /// The state at time `t` (s), which must not decrease from call to call, by component (state units).
    pub fn advance(&mut self, t: f64) -> &[f64] {
        let nodes = &self.scenario.nodes;
        let count = nodes.len() as f64;
        let mean = |component, t, x: &[f64]| {
            nodes.iter().map(|node| node.dynamics.component(component, t, x)).sum::<f64>() / count
        };
        let field = |t: f64, x: &[f64]| (0..x.len()).map(|component| mean(component, t, x)).collect();
        for (from, step) in steps(self.t, t, self.longest_step) {
            self.x = runge_kutta(from, &self.x, step, field);
        }
        self.t = t;
        &self.x
    }
}
