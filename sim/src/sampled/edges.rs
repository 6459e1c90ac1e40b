//! Edge-wise coupling: every edge has a funnel and a memory of its own. Both ends know the same, so that it
//! is followed once for both.

use super::member::Member;
use crate::extremes::larger;
use crate::scenario::Scenario;
use funnelnet_law::floor::Floor;
use funnelnet_law::funnel::{Guard, Widths};
use funnelnet_law::gain::Gain;
use funnelnet_law::law::EdgeWise;
use funnelnet_law::law::edge_wise::EdgeTerm;
use funnelnet_law::law::node_wise::{Constants, Memory, THETA};

/// One edge.
struct Pair {
    ends: (usize, usize),
    weight: f64,
    /// `alpha_ij (n_i + n_j)`.
    stiffness: f64,
    /// By component.
    memory: Vec<Memory<f64>>,
}

/// All edges of a network.
pub(super) struct Edges {
    law: EdgeWise<f64>,
    gain: Gain<f64>,
    guard: Guard<f64>,
    tick: f64,
    pairs: Vec<Pair>,
}

impl Edges {
    /// Gain, funnel and damping are those of every node.
    pub fn new(scenario: &Scenario) -> Option<Self> {
        let first = scenario.nodes.first()?;
        let tick = scenario.time.tick_s();
        let mut count = vec![0.0; scenario.nodes.len()];
        for edge in &scenario.graph.edges {
            count[edge.a] += 1.0;
            count[edge.b] += 1.0;
        }
        let pairs = scenario.graph.edges.iter().map(|edge| Pair {
            ends: (edge.a, edge.b),
            weight: edge.weight,
            stiffness: edge.weight * (count[edge.a] + count[edge.b]),
            memory: vec![Memory::default(); scenario.components()],
        });
        Some(Self {
            law: EdgeWise::new(tick, Constants::damped_by(first.damping)),
            gain: first.gain.prepared(),
            guard: Guard::new(scenario.guard),
            tick,
            pairs: pairs.collect(),
        })
    }

    /// The terms and inputs of tick `k` at `t` (s).
    pub fn carry(&mut self, k: u64, t: f64, members: &mut [Member<'_>]) {
        let floor = Floor::of_f32(0.5, self.tick);
        for pair in &mut self.pairs {
            let (a, b) = pair.ends;
            for (component, memory) in pair.memory.iter_mut().enumerate() {
                let (one, other) = (members[a].parts[component], members[b].parts[component]);
                let nu = pair.weight * (other.x - one.x);
                let term = EdgeTerm { nu, dnu: pair.weight * (other.dx - one.dx), stiffness: pair.stiffness };
                let input = memory.last_input().map_or(0.0, f64::abs);
                let kept = floor.times(pair.stiffness).width(larger(one.x.abs(), other.x.abs()), input);
                let psi = Widths { now: members[a].width(t), ahead: members[a].width(t + THETA * self.tick) };
                // As a node, which counts its ticks in 32 bits, and floors what the guard leaves.
                let psi = self.guard.of(k as u32, psi).floored(kept);
                let u = self.law.step(&self.gain, memory, &term, psi);
                members[a].takes_edge(component, nu, u, kept);
                members[b].takes_edge(component, -nu, -u, kept);
            }
        }
    }
}
