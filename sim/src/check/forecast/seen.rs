//! What the emergent motion asks of each node, and how much it contracts.

use super::forcing::Forcing;
use super::motion::{Motion, value};
use super::relative_widths;
use crate::check::widths::Widths;
use crate::extremes::{beyond, larger, largest};
use crate::scenario::{Dynamics, NodeSpec, Scenario};
use funnelnet_law::emergent::{Agent, contraction, partial_by_time, partials_by_field};
use funnelnet_law::floor::Floor;
use funnelnet_law::gain::{Gain, GainFunction};
use funnelnet_law::law::node_wise::{G, THETA};

/// How far the rounding of `nu` moves it on graphs of many nodes, in units of `funnelnet_law::floor` (5 ulp
/// at degree 2).
const ROUNDING: f64 = 2.5;
/// Relative distance of two rates that differ by rounding only.
const ROUNDED: f64 = 1e-12;

/// One node along the emergent motion.
#[derive(Clone, Copy, Debug)]
pub(in crate::check) struct NodeSeen {
    /// The largest `|f_em - f_i|` (state units / s).
    pub input: f64,
    /// The smallest `1 - |s_i|`, `s_i = mu_i^-1(f_em - f_i)`, and when (s).
    pub margin: f64,
    pub margin_at: f64,
    /// The narrowest funnel that one exchange per tick can hold: the largest
    /// `(1 - 2 g) theta c T^2 d |d/dt (f_em - f_i)| / (1 - |s_i|)` (state units).
    pub floor: f64,
    /// The largest share of the kept funnel that this takes up, when (s), and how wide the funnel is then
    /// (state units).
    pub taken: f64,
    pub taken_at: f64,
    pub taken_of: f64,
    /// The largest share of the kept funnel that the excess itself is.
    pub excess: f64,
    /// The largest predicted `|nu| / psi`, the sum of the steady ratio and the excess.
    pub ratio: f64,
}

/// A node at the floor of its funnel.
#[derive(Clone, Copy, Debug)]
pub(in crate::check) struct AtFloor {
    pub index: usize,
    /// `1 - |s_i|`.
    pub margin: f64,
    /// What the rounding of `nu` takes of it.
    pub needed: f64,
    /// s.
    pub t: f64,
}

/// Everything that is seen along the motion.
pub(super) struct Seen {
    pub nodes: Vec<NodeSeen>,
    /// Where each node floors its funnel with the largest input that it has by then (state units).
    pub resolution: Vec<f64>,
    /// The steepest `df_i / dx` (1/s).
    pub steepest: f64,
    pub slope_largest: f64,
    pub slope_largest_at: f64,
    pub slope_mean: f64,
    pub at_floor: Option<AtFloor>,
}

/// Walks along the motion once more.
pub(super) fn along(
    motion: &Motion,
    scenario: &Scenario,
    widths: &Widths,
    gains: &[Gain<f64>],
    degrees: &[f64],
) -> Seen {
    let tick = scenario.time.tick_s();
    let floors: Vec<Floor<f64>> = degrees.iter().map(|&degree| Floor::of_f32(degree, tick)).collect();
    let state = motion.largest_state;
    let nothing = NodeSeen {
        input: 0.0,
        margin: 1.0,
        margin_at: 0.0,
        floor: 0.0,
        taken: 0.0,
        taken_at: 0.0,
        taken_of: f64::INFINITY,
        excess: 0.0,
        ratio: 0.0,
    };
    let mut seen = Seen {
        nodes: vec![nothing; scenario.nodes.len()],
        resolution: floors.iter().map(|floor| floor.width(state, 0.0)).collect(),
        steepest: f64::NEG_INFINITY,
        slope_largest: f64::NEG_INFINITY,
        slope_largest_at: 0.0,
        slope_mean: 0.0,
        at_floor: None,
    };
    let excess = Excess::new(scenario, degrees);
    let mut forcing = Forcing::new(scenario, motion.grid.step);
    let (mut relative, mut rates, mut agents) = (Vec::new(), Vec::new(), Vec::new());
    for (k, (&xi, &velocity)) in motion.xi.iter().zip(&motion.velocity).enumerate() {
        let t = motion.grid.at(k);
        let nodes = scenario.nodes.iter().map(|node| &node.dynamics);
        let slopes: Vec<_> = nodes.clone().map(|field| field.slope(t, xi)).collect();
        seen.steepest = largest(seen.steepest, slopes.iter().copied());
        rates.clear();
        let by_time = nodes.clone().zip(&forcing.rate).map(|(field, rate)| match field {
            Dynamics::Affine(_) => *rate,
            Dynamics::Expression(_) | Dynamics::Hosted(_) => field.rate(t, xi),
        });
        rates.extend(slopes.iter().zip(by_time).map(|(slope, rate)| slope * velocity + rate));
        relative_widths(scenario, widths, t, &mut relative);
        agents.clear();
        let fields = nodes.zip(&forcing.value).map(|(field, forcing)| value(field, *forcing, t, xi));
        agents.extend(fields.zip(&relative).zip(gains).map(|((f, &psi), &gain)| Agent { psi, f, gain }));
        seen.contracts(contraction(&agents, velocity, slopes.iter().copied()), t);
        let inputs: Vec<_> = agents.iter().map(|agent| velocity - agent.f).collect();
        let common = excess.common(&agents, velocity, &rates, t.max(1e-9));
        let kept: Vec<_> =
            widths.at(t).zip(&seen.resolution).map(|(psi, floor)| larger(psi, *floor)).collect();
        for (index, node) in seen.nodes.iter_mut().enumerate() {
            let margin = node.settles(inputs[index], &gains[index], t);
            node.holds(excess.per_drift[index] * apart(common, rates[index]), margin, kept[index], t);
        }
        for ((floor, node), width) in floors.iter().zip(&seen.nodes).zip(&mut seen.resolution) {
            *width = floor.width(state, node.input);
        }
        seen.floored(&inputs, widths, gains, (&floors, state), t);
        forcing.advance();
    }
    seen.slope_mean /= motion.xi.len() as f64;
    seen
}

impl Seen {
    fn contracts(&mut self, slope: f64, t: f64) {
        self.slope_mean += slope;
        if beyond(slope, self.slope_largest) {
            (self.slope_largest, self.slope_largest_at) = (slope, t);
        }
    }

    /// The tightest node whose funnel is at its floor.
    fn floored(
        &mut self,
        inputs: &[f64],
        widths: &Widths,
        gains: &[Gain<f64>],
        (floors, state): (&[Floor<f64>], f64),
        t: f64,
    ) {
        let closed: Vec<_> = widths.at(t).zip(&self.resolution).map(|(psi, floor)| psi <= *floor).collect();
        for (index, _) in closed.iter().enumerate().filter(|(_, closed)| **closed) {
            let needed = ROUNDING * floors[index].unit(state, inputs[index].abs()) / self.resolution[index];
            let margin = 1.0 - gains[index].inverse(inputs[index]).abs();
            if self.at_floor.is_none_or(|before| beyond(-margin / needed, -before.margin / before.needed)) {
                self.at_floor = Some(AtFloor { index, margin, needed, t });
            }
        }
    }
}

impl NodeSeen {
    /// An excess (state units) in the margin that a funnel of width `kept` (state units) leaves at `t` (s).
    fn holds(&mut self, excess: f64, margin: f64, kept: f64, t: f64) {
        // No excess fits no margin at all.
        let floor = if excess == 0.0 { 0.0 } else { excess / margin };
        self.floor = larger(self.floor, floor);
        self.excess = larger(self.excess, excess / kept);
        self.ratio = larger(self.ratio, 1.0 - margin + excess / kept);
        // One that is infinite has room for anything that is a number.
        let taken = if kept.is_infinite() && !floor.is_nan() { 0.0 } else { floor / kept };
        if beyond(taken, self.taken) {
            (self.taken, self.taken_at) = (taken, t);
            self.taken_of = kept;
        }
    }

    /// The margin `1 - |s|` that an input (state units / s) leaves.
    fn settles(&mut self, input: f64, gain: &Gain<f64>, t: f64) -> f64 {
        self.input = larger(self.input, input.abs());
        let margin = 1.0 - gain.inverse(input).abs();
        if beyond(-margin, -self.margin) {
            (self.margin, self.margin_at) = (margin, t);
        }
        margin
    }
}

/// `|a - b|`; zero where that is but rounding.
fn apart(a: f64, b: f64) -> f64 {
    let distance = (a - b).abs();
    if distance <= ROUNDED * larger(a.abs(), b.abs()) { 0.0 } else { distance }
}

/// The excess over the steady ratio that one exchange per tick leaves (law.md 2, theorem 2).
struct Excess<'s> {
    scenario: &'s Scenario,
    /// `(1 - 2 g) theta c T^2 d_i` (s^2).
    per_drift: Vec<f64>,
    /// Whether all funnels are of one shape, which leaves the weights of the nodes as they are.
    one_shape: bool,
}

impl<'s> Excess<'s> {
    fn new(scenario: &'s Scenario, degrees: &[f64]) -> Self {
        let tick = scenario.time.tick_s();
        // The look back takes its part of the excess (law.md 3).
        let share = THETA * (1.0 - 2.0 * G) * tick * tick;
        let per_drift = |(degree, node): (&f64, &NodeSpec)| share * node.damping * degree;
        let shapes = scenario.nodes.windows(2).all(|pair| pair[0].funnel.shape == pair[1].funnel.shape);
        Self {
            scenario,
            per_drift: degrees.iter().zip(&scenario.nodes).map(per_drift).collect(),
            one_shape: shapes,
        }
    }

    /// The derivative of `f_em` by time along `xi`, for the `d/dt f_i` along `xi` (state units / s^2).
    fn common(&self, agents: &[Agent<f64, Gain<f64>>], field: f64, rates: &[f64], t: f64) -> f64 {
        let weighted = partials_by_field(agents, field).zip(rates).map(|(weight, rate)| weight * rate);
        let by_fields: f64 = weighted.sum();
        if self.one_shape {
            return by_fields;
        }
        // Relative, as the widths of the agents are.
        let nodes = self.scenario.nodes.iter().zip(agents);
        let moves = nodes.map(|(node, agent)| {
            let decay = node.funnel.slope(t) / node.funnel.width(t);
            if decay.is_finite() { decay * agent.psi } else { 0.0 }
        });
        by_fields + partial_by_time(agents, field, moves)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_margin_that_is_not_a_number_is_the_tightest_of_all() {
        let gain = Gain::Reciprocal { scale: 1.0 };
        let mut node = NodeSeen {
            input: 0.0,
            margin: 1.0,
            margin_at: 0.0,
            floor: 0.0,
            taken: 0.0,
            taken_at: 0.0,
            taken_of: f64::INFINITY,
            excess: 0.0,
            ratio: 0.0,
        };
        for (t, input) in [(1.0, 2.0), (2.0, f64::NAN), (3.0, 5.0)] {
            node.settles(input, &gain, t);
            node.holds(input, 1.0, 10.0, t);
        }
        assert!(node.margin.is_nan() && node.input.is_nan() && node.taken.is_nan() && node.floor.is_nan());
        assert_eq!((node.margin_at, node.taken_at), (2.0, 2.0));
    }

    #[test]
    fn a_slope_that_is_not_a_number_is_the_largest_of_all() {
        let mut seen = Seen {
            nodes: Vec::new(),
            resolution: Vec::new(),
            steepest: 0.0,
            slope_largest: f64::NEG_INFINITY,
            slope_largest_at: 0.0,
            slope_mean: 0.0,
            at_floor: None,
        };
        [-1.0, f64::NAN, 3.0].into_iter().zip(0u8..).for_each(|(slope, t)| seen.contracts(slope, t.into()));
        assert!(seen.slope_largest.is_nan() && seen.slope_largest_at == 1.0 && seen.slope_mean.is_nan());
    }
}
