//! The motion of the whole: emergent dynamics, blended dynamics, and the two of the escape estimate.

use super::forcing::Forcing;
use super::{Grid, relative_widths};
use crate::check::widths::Widths;
use crate::emergent;
use crate::extremes::{larger, largest, smallest};
use crate::scenario::{Affine, Dynamics, Scenario};
use funnelnet_law::emergent::{Agent, field};
use funnelnet_law::gain::Gain;
use funnelnet_law::math;

/// A motion beyond this is not followed any further (state units).
const FAR: f64 = 1e12;

/// What the nodes do as one.
pub(super) struct Motion {
    pub grid: Grid,
    /// One per step (state units).
    pub xi: Vec<f64>,
    /// `f_em(t, xi)`, one per step (state units / s).
    pub velocity: Vec<f64>,
    /// The blended dynamics at the end (state units).
    pub blended: f64,
    /// The largest of the paper's `|chi|`, (5), uplowdyn (state units).
    pub reach: f64,
    /// See `Forecast::largest_state`.
    pub largest_state: f64,
}

/// Start, middle and end of a step.
type Instants = [Vec<f64>; 3];

/// What the fields of a step are made of.
struct Fields<'s> {
    scenario: &'s Scenario,
    gains: &'s [Gain<f64>],
    /// Times of the instants, s.
    times: [f64; 3],
    forcing: Instants,
    widths: Instants,
    agents: Vec<Agent<f64, Gain<f64>>>,
    guess: f64,
}

impl Fields<'_> {
    fn each(&self, instant: usize, x: f64) -> impl Iterator<Item = f64> {
        let (fields, t) = (self.scenario.nodes.iter().zip(&self.forcing[instant]), self.times[instant]);
        fields.map(move |(node, forcing)| value(&node.dynamics, *forcing, t, x))
    }

    /// The mean of the fields, which is the blended vector field (state units / s).
    fn mean(&self, instant: usize, x: f64) -> f64 {
        self.each(instant, x).sum::<f64>() / self.scenario.nodes.len() as f64
    }

    /// `f_em` (state units / s).
    fn emergent(&mut self, instant: usize, xi: f64) -> f64 {
        let mut agents = std::mem::take(&mut self.agents);
        agents.clear();
        let parts = self.each(instant, xi).zip(&self.widths[instant]).zip(self.gains);
        agents.extend(parts.map(|((f, &psi), &gain)| Agent { psi, f, gain }));
        self.guess = field(&agents, self.guess);
        self.agents = agents;
        self.guess
    }

    fn highest(&self, instant: usize, x: f64) -> f64 {
        largest(f64::NEG_INFINITY, self.each(instant, x))
    }

    fn lowest(&self, instant: usize, x: f64) -> f64 {
        smallest(f64::INFINITY, self.each(instant, x))
    }
}

/// `f(t, x)` where the part that does not depend on the state is known.
pub(super) fn value(dynamics: &Dynamics, forcing: f64, t: f64, x: f64) -> f64 {
    match dynamics {
        Dynamics::Affine(affine) => affine.slope() * x + forcing,
        Dynamics::Expression(_) | Dynamics::Hosted(_) => dynamics.value(t, x),
    }
}

/// One classical Runge-Kutta step of `xdot = f(instant, x)`.
fn step(x: f64, h: f64, mut f: impl FnMut(usize, f64) -> f64) -> f64 {
    let k1 = f(0, x);
    let k2 = f(1, x + 0.5 * h * k1);
    let k3 = f(1, x + 0.5 * h * k2);
    let k4 = f(2, x + h * k3);
    x + h / 6.0 * (k1 + 2.0 * (k2 + k3) + k4)
}

impl Motion {
    /// From the same start as the emergent trajectory of a run.
    pub fn of(scenario: &Scenario, widths: &Widths, gains: &[Gain<f64>]) -> Self {
        let mut grid = Grid::of(scenario);
        let states = scenario.initial_states();
        let mut forcing = Forcing::new(scenario, 0.5 * grid.step);
        let mut fields = Fields {
            scenario,
            gains,
            times: [0.0; 3],
            forcing: [forcing.value.clone(), Vec::new(), forcing.value.clone()],
            widths: Instants::default(),
            agents: Vec::new(),
            guess: 0.0,
        };
        relative_widths(scenario, widths, 0.0, &mut fields.widths[2]);
        let mut alone = Alone::of(scenario, grid.step);
        let start = |mean: Vec<f64>| mean.first().copied().unwrap_or(0.0);
        let (mut x, mut blended) = (start(emergent::start(scenario)), start(emergent::plain_mean(scenario)));
        let (mut low, mut high) = crate::extremes::extremes(states.iter().copied());
        let mut reach = larger(low.abs(), high.abs());
        let mut largest_state = reach;
        let (mut xi, mut velocity) = (vec![x], Vec::new());
        for k in 0..grid.steps {
            next_instants(&mut fields, &mut forcing, widths, grid.at(k), grid.step);
            velocity.push(fields.emergent(0, x));
            x = step(x, grid.step, |instant, x| fields.emergent(instant, x));
            blended = step(blended, grid.step, |instant, x| fields.mean(instant, x));
            high = step(high, grid.step, |instant, x| fields.highest(instant, x));
            low = step(low, grid.step, |instant, x| fields.lowest(instant, x));
            reach = largest(reach, [high.abs(), low.abs()]);
            largest_state = largest(largest_state, [x.abs(), alone.advance(&fields.forcing[1])]);
            xi.push(x);
            if x.is_nan() || x.abs() >= FAR {
                grid.steps = k + 1;
                break;
            }
        }
        fields.forcing.swap(0, 2);
        fields.widths.swap(0, 2);
        fields.times[0] = fields.times[2];
        velocity.push(fields.emergent(0, x));
        Self { grid, xi, velocity, blended, reach, largest_state }
    }
}

/// The end of the last step becomes the start of the next.
fn next_instants(fields: &mut Fields<'_>, forcing: &mut Forcing, widths: &Widths, t: f64, step: f64) {
    fields.forcing.swap(0, 2);
    fields.widths.swap(0, 2);
    fields.times = [t, t + 0.5 * step, t + step];
    for (instant, t) in [(1, t + 0.5 * step), (2, t + step)] {
        forcing.advance();
        fields.forcing[instant].clone_from(&forcing.value);
        relative_widths(fields.scenario, widths, t, &mut fields.widths[instant]);
    }
}

/// The affine nodes that stay bounded when left to themselves, followed exactly in their linear part and with
/// the middle's forcing.
struct Alone {
    /// Index, state, and what the state and the forcing are multiplied by in one step.
    nodes: Vec<(usize, f64, f64, f64)>,
}

impl Alone {
    fn of(scenario: &Scenario, step: f64) -> Self {
        let factors = |field: &Affine| {
            let z = field.slope() * step;
            (math::exp(z), step * growth(z))
        };
        let nodes = scenario.nodes.iter().enumerate();
        let node = |(index, node): (usize, &crate::scenario::NodeSpec)| {
            let stable = node.dynamics.affine().filter(|affine| affine.slope() < 0.0)?;
            let (decay, gain) = factors(stable);
            Some((index, node.state[0], decay, gain))
        };
        Self { nodes: nodes.filter_map(node).collect() }
    }

    /// One step on; the largest `|x|` (state units).
    fn advance(&mut self, forcing: &[f64]) -> f64 {
        let mut most = 0.0;
        for (index, x, decay, gain) in &mut self.nodes {
            *x = *x * *decay + *gain * forcing[*index];
            most = larger(most, x.abs());
        }
        most
    }
}

/// `(e^z - 1) / z`.
fn growth(z: f64) -> f64 {
    if z.abs() < 1e-12 { 1.0 } else { math::exp_m1(z) / z }
}
