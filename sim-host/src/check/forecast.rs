//! Rough figures of the motion to come, from the mean of the fields (the paper's blended dynamics).

use funnel_core::{math, params};

use crate::scenario::{Affine, NodeSpec, Scenario};

/// Points in time that are looked at.
const SAMPLES: u64 = 5_000;

/// What is expected of a run, without running it.
pub(super) struct Forecast {
    /// Largest `|x|` of the initial states and of the mean dynamics (state units).
    pub largest_state: f64,
    /// Per node: the largest `|d/dt (f_i - f_j)|` over its neighbours j (state units / s^2).
    divergence: Vec<f64>,
    degree: Vec<f64>,
    factor: Vec<f64>,
    tick_s: f64,
}

impl Forecast {
    /// Takes every node to move with the mean of the fields, and its state to stay below that of the mean
    /// and of the nodes left to themselves.
    pub fn of(scenario: &Scenario) -> Self {
        let graph = &scenario.graph;
        let steps = scenario.time.ticks.min(SAMPLES);
        let h = scenario.time.end_s() / steps as f64;
        let states = scenario.initial_states();
        let mut mean = Motion::of_mean(scenario, &states);
        let mut alone = contracting(scenario);
        let mut largest_state = states.iter().map(|x| x.abs()).fold(0.0, f64::max);
        let mut divergence = vec![0.0f64; graph.nodes];
        for step in 0..steps {
            let t = step as f64 * h;
            let velocity = mean.velocity(t);
            let rate = |node: &NodeSpec| node.dynamics.slope() * velocity + node.dynamics.rate_of_forcing(t);
            let rates: Vec<_> = scenario.nodes.iter().map(rate).collect();
            for edge in &graph.edges {
                let apart = (rates[edge.a] - rates[edge.b]).abs();
                divergence[edge.a] = divergence[edge.a].max(apart);
                divergence[edge.b] = divergence[edge.b].max(apart);
            }
            for motion in alone.iter_mut().chain([&mut mean]) {
                motion.advance(t, h);
                largest_state = largest_state.max(motion.x.abs());
            }
        }
        let degree = (0..graph.nodes).map(|i| graph.degree(i)).collect();
        let factor = scenario.nodes.iter().map(|node| node.funnel.factor()).collect();
        Self { largest_state, divergence, degree, factor, tick_s: scenario.time.tick_s() }
    }

    /// The narrowest funnel that one exchange per tick can hold: `T^2 d max|d/dt (f_i - f_j)|` (state units).
    pub fn floor(&self, index: usize) -> f64 {
        self.tick_s * self.tick_s * self.degree[index] * self.divergence[index]
    }

    /// The width at which a node floors its funnel, as `funnel_core::params` has it (state units).
    pub fn resolution(&self, index: usize) -> f64 {
        params::FLOOR_ULPS * f64::from(f32::EPSILON) * self.factor[index] * self.largest_state
    }
}

/// A scalar affine system, followed exactly in its linear part and with the midpoint's forcing.
struct Motion<'s> {
    x: f64,
    slope: f64,
    fields: Vec<&'s Affine>,
}

impl<'s> Motion<'s> {
    /// The paper's blended dynamics: the mean field from the mean state.
    fn of_mean(scenario: &'s Scenario, states: &[f64]) -> Self {
        let fields: Vec<_> = scenario.nodes.iter().map(|node| &node.dynamics).collect();
        let count = fields.len() as f64;
        let slope = fields.iter().map(|field| field.slope()).sum::<f64>() / count;
        Self { x: states.iter().sum::<f64>() / count, slope, fields }
    }

    fn forcing(&self, t: f64) -> f64 {
        self.fields.iter().map(|field| field.forcing(t)).sum::<f64>() / self.fields.len() as f64
    }

    fn velocity(&self, t: f64) -> f64 {
        self.slope * self.x + self.forcing(t)
    }

    fn advance(&mut self, t: f64, h: f64) {
        let z = self.slope * h;
        self.x = self.x * math::exp(z) + h * growth(z) * self.forcing(t + 0.5 * h);
    }
}

/// The nodes that stay bounded when left to themselves.
fn contracting(scenario: &Scenario) -> Vec<Motion<'_>> {
    let stable = scenario.nodes.iter().filter(|node| node.dynamics.slope() < 0.0);
    stable
        .map(|node| Motion { x: node.state[0], slope: node.dynamics.slope(), fields: vec![&node.dynamics] })
        .collect()
}

/// `(e^z - 1) / z`.
fn growth(z: f64) -> f64 {
    if z.abs() < 1e-12 { 1.0 } else { math::exp_m1(z) / z }
}
