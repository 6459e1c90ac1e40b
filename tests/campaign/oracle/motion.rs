//! A state goes from tick to tick by its own field and the input that it was seen to have, and by nothing else.

use super::Broken;
use super::commits::Adoptions;
use funnelnet_node::Event;
use sim_host::engine::NodeEvent;
use sim_host::judge::Moment;
use sim_host::presence::Presence;
use sim_host::scenario::Scenario;

/// What f32 may make of field and input, as a part of them, and of a state.
const ROUNDING: f64 = 1e-4;
const ROUNDING_OF_STATE: f64 = 1e-6;

/// States and inputs of the tick before.
pub(super) struct Motion<'a> {
    scenario: &'a Scenario,
    x: Vec<f64>,
    u: Vec<f64>,
    ran: Vec<bool>,
    /// It was off, and has not spoken since: until then it goes where its neighbours are.
    comes: Vec<bool>,
}

impl<'a> Motion<'a> {
    pub(super) fn of(scenario: &'a Scenario) -> Self {
        let nodes = scenario.nodes.len();
        Self { scenario, x: Vec::new(), u: Vec::new(), ran: vec![false; nodes], comes: vec![false; nodes] }
    }

    /// Whether a node is where its field and its input have brought it.
    pub(super) fn tick(
        &mut self,
        moment: &Moment<'_>,
        told: &[NodeEvent],
        adoptions: &Adoptions<'_>,
    ) -> Result<(), Broken> {
        let components = self.scenario.components();
        // What nodes with clocks of their own are is seen between two ticks, and a plant does as it likes.
        let is_watched = |index: usize| self.scenario.clocks.is_empty() && !self.scenario.has_plant(index);
        for index in (0..self.ran.len()).filter(|&index| is_watched(index)) {
            let runs = moment.presence.get(index) == Some(&Presence::Ran);
            let spoke =
                told.iter().any(|told| told.node == index && matches!(told.event, Event::Joins { .. }));
            let states = index * components..(index + 1) * components;
            if runs && self.ran[index] && !self.comes[index] && !spoke {
                let due = self.next(index, moment.k - 1, adoptions);
                let is_near = |(x, &(due, room)): (&f64, &(f64, f64))| (x - due).abs() <= room;
                if !moment.x[states].iter().zip(&due).all(is_near) {
                    return Err(Broken::Moved(moment.k, index));
                }
            }
            self.comes[index] =
                !spoke && (self.comes[index] || moment.presence.get(index) == Some(&Presence::Off));
            self.ran[index] = runs;
        }
        (self.x, self.u) = (moment.x.to_vec(), moment.u.to_vec());
        Ok(())
    }

    /// States of the tick after `k`, and what rounding may do to them: a step of the midpoint rule for each part of a round.
    fn next(&self, index: usize, k: u64, adoptions: &Adoptions<'_>) -> Vec<(f64, f64)> {
        let (scenario, components) = (self.scenario, self.scenario.components());
        let states = index * components..(index + 1) * components;
        let (mut x, u) = (self.x[states.clone()].to_vec(), &self.u[states]);
        let Some(node) = adoptions.node_at(index, k) else { return Vec::new() };
        let parts = scenario.time.round;
        let step = scenario.time.period_s(k) / f64::from(parts);
        let mut moved = vec![0.0; components];
        for part in 0..parts {
            let t = scenario.time.at_s(k) + f64::from(part) * step;
            let slope = |t: f64, x: &[f64], component| node.dynamics.component(component, t, x);
            let half =
                |(component, &at): (usize, &f64)| at + 0.5 * step * (slope(t, &x, component) + u[component]);
            let middle: Vec<f64> = x.iter().enumerate().map(half).collect();
            for component in 0..components {
                let f = slope(t + 0.5 * step, &middle, component);
                x[component] += step * (f + u[component]);
                moved[component] += step * (f.abs() + u[component].abs());
            }
        }
        let room = |(x, moved): (f64, f64)| (x, ROUNDING * moved + ROUNDING_OF_STATE * (1.0 + x.abs()));
        x.into_iter().zip(moved).map(room).collect()
    }
}
