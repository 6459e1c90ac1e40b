//! The blended dynamics of a scenario (paper, (4), blend): the plain average of the fields, which a linear
//! high-gain coupling follows and funnel coupling in general does not.

use super::grid::{Grid, Walk};
use super::start::plain_mean;
use crate::scenario::Scenario;

/// The blended dynamics, integrated step by step from the mean of the initial states.
pub struct BlendedTrajectory<'a> {
    scenario: &'a Scenario,
    walk: Walk,
}

impl<'a> BlendedTrajectory<'a> {
    /// Starts at the mean of the initial states.
    pub fn new(scenario: &'a Scenario) -> Self {
        Self { scenario, walk: Walk::new(Grid::of(scenario), plain_mean(scenario)) }
    }

    /// The state at time `t` (s), which must not decrease from call to call, by component (state units).
    pub fn advance(&mut self, t: f64) -> &[f64] {
        let nodes = &self.scenario.nodes;
        let count = nodes.len() as f64;
        let mean = |component, t, x: &[f64]| {
            nodes.iter().map(|node| node.dynamics.component(component, t, x)).sum::<f64>() / count
        };
        let field = |t: f64, x: &[f64]| {
            self.scenario.announce_one(t, x);
            (0..x.len()).map(|component| mean(component, t, x)).collect()
        };
        while self.walk.step(t, field) {}
        self.walk.look(t, field);
        &self.walk.x
    }

    /// Why the steps do not resolve the fields, where they do not: the states are then no prediction.
    pub fn unresolved(&self) -> Option<&str> {
        self.walk.grid.unresolved.as_deref()
    }
}
