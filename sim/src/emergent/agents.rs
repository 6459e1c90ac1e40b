//! The agents of a scenario, as the emergent vector field sees them.

use super::{AFTER_START, gain};
use crate::scenario::{Coupling, NodeSpec, Scenario};
use funnelnet_law::emergent::{Agent, field};
use funnelnet_law::gain::Gain;

/// Agents whose funnels are scaled so that the widest is one. The funnels enter the emergent dynamics by
/// their ratios only, so a funnel that tends to zero leaves them as they are (paper, remark on time-invariant
/// emergent dynamics).
pub(super) struct Agents<'a> {
    pub(super) scenario: &'a Scenario,
    gains: Vec<Gain<f64>>,
    /// As of the last [`Self::place`].
    pub(super) placed: Vec<Agent<f64, Gain<f64>>>,
    /// The last value of the field, from which the next search starts, by component.
    pub(super) guess: Vec<f64>,
}

impl<'a> Agents<'a> {
    /// `None` where a coupling has no emergent dynamics here.
    pub(super) fn new(scenario: &'a Scenario) -> Option<Self> {
        let gains = scenario.nodes.iter().map(|node| gain(node, scenario.coupling, scenario.components()));
        let gains = gains.collect::<Option<_>>()?;
        Some(Self { scenario, gains, placed: Vec::new(), guess: vec![0.0; scenario.components()] })
    }

    /// Puts all agents at time `t` (s) and the scalar state `xi`.
    pub(super) fn place(&mut self, t: f64, xi: f64) {
        self.place_component(0, t, &[xi]);
    }

    fn place_component(&mut self, component: usize, t: f64, xi: &[f64]) {
        let t_funnel = t.max(AFTER_START);
        let widest = self.scenario.widest_funnel(t_funnel);
        self.scenario.announce_one(t, xi);
        self.placed.clear();
        self.placed.extend(self.scenario.nodes.iter().zip(&self.gains).map(|(node, &gain)| Agent {
            psi: weight(self.scenario.coupling, node, t_funnel, widest),
            f: node.dynamics.component(component, t, xi),
            gain,
        }));
    }

    /// `f_em(t, xi)` of a scalar state, with the agents left there (state units / s).
    pub(super) fn field(&mut self, t: f64, xi: f64) -> f64 {
        self.fields(t, &[xi]).first().copied().unwrap_or(0.0)
    }

    /// `f_em(t, xi)`, by component (state units / s).
    pub(super) fn fields(&mut self, t: f64, xi: &[f64]) -> Vec<f64> {
        for component in 0..xi.len() {
            self.place_component(component, t, xi);
            self.guess[component] = field(&self.placed, self.guess[component]);
        }
        self.guess.clone()
    }

    /// The derivatives of the scaled funnels at time `t`, by index (1/s): zero where all funnels shrink
    /// alike.
    pub(super) fn psi_rates(&self, t: f64) -> impl Iterator<Item = f64> {
        let t = t.max(AFTER_START);
        let width = |node: &NodeSpec| node.funnel.width(t);
        let widest = self.scenario.nodes.iter().max_by(|a, b| width(a).total_cmp(&width(b)));
        let (scale, shrinking) = widest.map_or((0.0, 0.0), |node| (width(node), node.funnel.slope(t)));
        self.scenario.nodes.iter().map(move |node| match node.funnel.width(t) {
            psi if psi > 0.0 => psi / scale * (node.funnel.slope(t) / psi - shrinking / scale),
            _ => 0.0,
        })
    }

    /// The `df_i/dx` at time `t` (s) and the scalar state `xi`, by index (1/s).
    pub(super) fn slopes(&self, t: f64, xi: f64) -> impl Iterator<Item = f64> {
        self.scenario.nodes.iter().map(move |node| node.dynamics.slope(t, xi))
    }
}

/// What stands before `mu_i^-1` in the sum that is zero.
fn weight(coupling: Coupling<f64>, node: &NodeSpec, t: f64, widest: f64) -> f64 {
    let averaged = matches!(coupling, Coupling::EdgeWise | Coupling::Linear);
    if averaged {
        1.0
    } else if widest > 0.0 {
        node.funnel.width(t) / widest
    } else {
        node.funnel.factor
    }
}
