//! What the emergent motion asks of each node, and how much it contracts.

use super::forcing::Forcing;
use super::motion::Motion;
use super::relative_widths;
use crate::check::widths::Widths;
use crate::extremes::{beyond, larger};
use crate::scenario::{Graph, Scenario};
use funnelnet_law::emergent::{Agent, contraction};
use funnelnet_law::floor::Floor;
use funnelnet_law::gain::{Gain, GainFunction};

/// How far the rounding of `nu` moves it on graphs of many nodes, in units of `funnelnet_law::floor` (5 ulp at degree 2).
const ROUNDING: f64 = 2.5;
/// Edge-steps up to which neighbours are compared one by one.
const EDGE_STEPS: usize = 50_000_000;

/// One node along the emergent motion.
#[derive(Clone, Copy, Debug)]
pub(in crate::check) struct NodeSeen {
    /// The largest `|f_em - f_i|` (state units / s).
    pub input: f64,
    /// The smallest `1 - |s_i|`, `s_i = mu_i^-1(f_em - f_i)`, and when (s).
    pub margin: f64,
    pub margin_at: f64,
    /// The largest `T^2 d max|d/dt (f_i - f_j)|`: the narrowest funnel that one exchange per tick can hold (state units).
    pub floor: f64,
    /// The largest share of the kept funnel that this takes up, when (s), and how wide the funnel is then (state units).
    pub taken: f64,
    pub taken_at: f64,
    pub taken_of: f64,
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
    };
    let mut seen = Seen {
        nodes: vec![nothing; scenario.nodes.len()],
        resolution: floors.iter().map(|floor| floor.width(state, 0.0)).collect(),
        slope_largest: f64::NEG_INFINITY,
        slope_largest_at: 0.0,
        slope_mean: 0.0,
        at_floor: None,
    };
    let slopes: Vec<_> = scenario.nodes.iter().map(|node| node.dynamics.slope()).collect();
    let compare = Compare::new(&scenario.graph, motion.grid.steps);
    let mut forcing = Forcing::new(scenario, motion.grid.step);
    let (mut relative, mut rates, mut apart, mut agents) = (Vec::new(), Vec::new(), Vec::new(), Vec::new());
    for (k, (&xi, &velocity)) in motion.xi.iter().zip(&motion.velocity).enumerate() {
        let t = motion.grid.at(k);
        rates.clear();
        rates.extend(slopes.iter().zip(&forcing.rate).map(|(slope, rate)| slope * velocity + rate));
        compare.apart(&rates, &mut apart);
        for (index, psi) in widths.at(t).enumerate() {
            let floor = tick * tick * degrees[index] * apart[index];
            seen.nodes[index].holds(floor, larger(psi, seen.resolution[index]), t);
        }
        relative_widths(scenario, widths, t, &mut relative);
        agents.clear();
        let fields = slopes.iter().zip(&forcing.value).map(|(slope, forcing)| slope * xi + forcing);
        agents.extend(fields.zip(&relative).zip(gains).map(|((f, &psi), &gain)| Agent { psi, f, gain }));
        seen.contracts(contraction(&agents, velocity, slopes.iter().copied()), t);
        let inputs: Vec<_> = agents.iter().map(|agent| velocity - agent.f).collect();
        for (node, (input, gain)) in seen.nodes.iter_mut().zip(inputs.iter().zip(gains)) {
            node.settles(*input, gain, t);
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
    fn holds(&mut self, floor: f64, kept: f64, t: f64) {
        self.floor = larger(self.floor, floor);
        if beyond(floor / kept, self.taken) {
            (self.taken, self.taken_at) = (floor / kept, t);
            self.taken_of = kept;
        }
    }

    fn settles(&mut self, input: f64, gain: &Gain<f64>, t: f64) {
        self.input = larger(self.input, input.abs());
        let margin = 1.0 - gain.inverse(input).abs();
        if beyond(-margin, -self.margin) {
            (self.margin, self.margin_at) = (margin, t);
        }
    }
}

/// How fast neighbours drift apart.
enum Compare<'g> {
    Neighbours(&'g Graph),
    /// With everyone instead of neighbours only, which is exact on a complete graph and an upper bound on a dense one.
    Everyone,
}

impl<'g> Compare<'g> {
    fn new(graph: &'g Graph, steps: usize) -> Self {
        match graph.edges.len().saturating_mul(steps) <= EDGE_STEPS {
            true => Self::Neighbours(graph),
            false => Self::Everyone,
        }
    }

    /// The largest `|rate_i - rate_j|` over the neighbours j, by index.
    fn apart(&self, rates: &[f64], apart: &mut Vec<f64>) {
        apart.clear();
        match self {
            Self::Neighbours(graph) => {
                apart.resize(rates.len(), 0.0);
                for edge in &graph.edges {
                    let distance = (rates[edge.a] - rates[edge.b]).abs();
                    apart[edge.a] = larger(distance, apart[edge.a]);
                    apart[edge.b] = larger(distance, apart[edge.b]);
                }
            }
            Self::Everyone => {
                let (low, high) = crate::check::extremes(rates.iter().copied());
                apart.extend(rates.iter().map(|rate| larger(high - rate, rate - low)));
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scenario::Edge;

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
        };
        for (t, input) in [(1.0, 2.0), (2.0, f64::NAN), (3.0, 5.0)] {
            node.settles(input, &gain, t);
            node.holds(input, 10.0, t);
        }
        assert!(node.margin.is_nan() && node.input.is_nan() && node.taken.is_nan() && node.floor.is_nan());
        assert_eq!((node.margin_at, node.taken_at), (2.0, 2.0));
    }

    #[test]
    fn a_slope_that_is_not_a_number_is_the_largest_of_all() {
        let mut seen = Seen {
            nodes: Vec::new(),
            resolution: Vec::new(),
            slope_largest: f64::NEG_INFINITY,
            slope_largest_at: 0.0,
            slope_mean: 0.0,
            at_floor: None,
        };
        [-1.0, f64::NAN, 3.0].into_iter().zip(0u8..).for_each(|(slope, t)| seen.contracts(slope, t.into()));
        assert!(seen.slope_largest.is_nan() && seen.slope_largest_at == 1.0 && seen.slope_mean.is_nan());
    }

    #[test]
    fn on_a_complete_graph_everyone_is_a_neighbour() {
        let ends = (0..7).flat_map(|a| (a + 1..7).map(move |b| (a, b)));
        let edges = ends.map(|(a, b)| Edge { a, b, weight: 1.0 }).collect();
        let graph = Graph { nodes: 7, edges };
        let rates = [3.0, -1.0, 4.0, 1.0, -5.0, 9.0, 2.0];
        let (mut exact, mut bound) = (Vec::new(), Vec::new());
        Compare::new(&graph, 1).apart(&rates, &mut exact);
        Compare::Everyone.apart(&rates, &mut bound);
        assert_eq!(exact, bound);
        assert_eq!(exact[..2], [8.0, 10.0]);
    }

    #[test]
    fn neighbours_are_compared_where_that_is_affordable() {
        let graph = Graph { nodes: 2, edges: vec![Edge { a: 0, b: 1, weight: 1.0 }] };
        assert!(matches!(Compare::new(&graph, EDGE_STEPS), Compare::Neighbours(_)));
        assert!(matches!(Compare::new(&graph, EDGE_STEPS + 1), Compare::Everyone));
    }
}
