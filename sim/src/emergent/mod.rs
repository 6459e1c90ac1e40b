//! What the network does as one: the emergent trajectory `xi` of a scenario (paper, (18), emer), in f64, from
//! the mean of the initial states that the coupling conserves, and the blended dynamics beside it.
//!
//! What the inputs of a coupling add up to gives its emergent field `h`, component by component:
//!
//! | coupling | adds up to zero | `h` |
//! |---|---|---|
//! | node-wise, element-wise, and maximum gain for scalar states | `nu_i = psi_i mu_i^-1(u_i)` | paper, (19), alg |
//! | linear | `nu_i = u_i / k_i` | the average with weights `1 / k_i` |
//! | edge-wise | `u_i` | the average |
//! | weakly centralised | `nu_i = psi_i u_i / G` | the average with weights `psi_i` |
//!
//! `start` says what that means for the initial value. Maximum gain ties the components of a vector together,
//! and the gains of lambda-trackers depend on their past: neither has an `h` that is found here.

mod agents;
mod blended;
mod chi;
mod grid;
mod predictor;
mod start;

pub(crate) use grid::{STEPS_PER_CONSTANT, fastest, outgrown};
#[cfg(feature = "check")]
pub(crate) use start::plain_mean;
pub(crate) use start::start;

pub use blended::BlendedTrajectory;
pub use chi::ChiTrajectory;
pub use predictor::{Contraction, Prediction, Predictor};

use crate::scenario::{Coupling, NodeSpec, Scenario};
use agents::Agents;
use funnelnet_law::emergent::contraction;
use funnelnet_law::gain::{Gain, GainFunction};
use grid::{Grid, Walk};

/// An instant just after the start, where a funnel that is infinite at t = 0 has a width, in s.
const AFTER_START: f64 = 1e-9;

/// One classical Runge-Kutta step of `x' = f(t, x)` from `t` over `step` (both s), for all components at
/// once.
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
    walk: Walk,
}

impl<'a> EmergentTrajectory<'a> {
    /// Starts at the mean of the initial states that the coupling conserves; `None` where a coupling has no
    /// emergent dynamics here.
    pub fn new(scenario: &'a Scenario) -> Option<Self> {
        let agents = Agents::new(scenario)?;
        Some(Self { agents, walk: Walk::new(Grid::of(scenario), start::start(scenario)) })
    }

    /// `xi` at time `t` (s), which must not decrease from call to call, by component (state units).
    pub fn advance(&mut self, t: f64) -> &[f64] {
        while self.step(t) {}
        self.aside(|agents, walk| walk.look(t, |t, x| agents.fields(t, x)));
        &self.walk.x
    }

    /// Goes on by one step, unless that would lead beyond `until` (s). The points that it leads to are the
    /// same whatever else is asked.
    pub(super) fn step(&mut self, until: f64) -> bool {
        let agents = &mut self.agents;
        self.walk.step(until, |t, x| agents.fields(t, x))
    }

    /// Why the steps do not resolve the fields, where they do not: `xi` is then no prediction.
    pub fn unresolved(&self) -> Option<&str> {
        self.walk.grid.unresolved.as_deref()
    }

    /// The ratios `s_i = mu_i^-1(f_em - f_i)` that hold the nodes together at the time of the last
    /// [`Self::advance`], by index: what `nu_i / psi_i` settles to under a narrow funnel. Empty for vector
    /// states, and where the coupling is not one of diffusive terms in funnels.
    pub fn steady_ratios(&mut self) -> impl Iterator<Item = f64> {
        let common = match follows_the_paper(self.agents.scenario.coupling) {
            true => self.common(),
            false => None,
        };
        let placed = &self.agents.placed;
        common
            .into_iter()
            .flat_map(move |common| placed.iter().map(move |agent| agent.gain.inverse(common - agent.f)))
    }

    /// `df_em/dxi` at the time of the last [`Self::advance`] (1/s): negative where the emergent dynamics
    /// contract. `None` for vector states.
    pub fn contraction(&mut self) -> Option<f64> {
        let common = self.common()?;
        let &[xi] = self.walk.x.as_slice() else { return None };
        Some(contraction(&self.agents.placed, common, self.agents.slopes(self.walk.t, xi)))
    }

    /// The field at the time of the last [`Self::advance`], with the agents left there (state units / s);
    /// `None` for vector states.
    fn common(&mut self) -> Option<f64> {
        let (&[xi], t) = (self.walk.x.as_slice(), self.walk.t) else { return None };
        Some(self.aside(|agents, _| agents.field(t, xi)))
    }

    /// Does something that leaves no trace in the steps to come: each search for a root begins at the last
    /// one that was found.
    fn aside<R>(&mut self, f: impl FnOnce(&mut Agents<'a>, &mut Walk) -> R) -> R {
        let guess = self.agents.guess.clone();
        let result = f(&mut self.agents, &mut self.walk);
        self.agents.guess = guess;
        result
    }
}

/// Whether scalar states follow the paper's law.
fn follows_the_paper(coupling: Coupling<f64>) -> bool {
    matches!(coupling, Coupling::NodeWise | Coupling::ElementWise | Coupling::MaxGain)
}

/// The gain as it enters that sum; `None` where there is no such sum.
fn gain(node: &NodeSpec, coupling: Coupling<f64>, components: usize) -> Option<Gain<f64>> {
    match coupling {
        Coupling::EdgeWise | Coupling::WeaklyCentralised => Some(Gain::Linear { slope: 1.0 }),
        Coupling::LambdaTracker { .. } | Coupling::None => None,
        Coupling::MaxGain if components > 1 => None,
        Coupling::Linear => Some(node.gain.prepared()),
        // The weights are scaled funnels, which do not enter where a gain is linear.
        _ if !node.gain.keeps_funnels() => None,
        _ => Some(node.gain.prepared()),
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
