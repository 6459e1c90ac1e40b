//! What a node is told to stay within while the network is disturbed: found from the run that is not (law.md
//! 9).

use super::{Followed, WORK, follow_for, promises};
use crate::extremes::{larger, smaller};
use crate::scenario::{BusModel, Coupling, Loss, NodeSpec, Scenario};
use funnelnet_node::params;

/// The largest input of a disturbed network over that of the undisturbed one: 4 is too little to come back
/// from far away.
const INPUT: f64 = 12.0;
/// The same of the slope by which a silent neighbour is extrapolated.
const SLOPE: f64 = 1.2;
/// Ticks for which a silent neighbour is extrapolated.
const EXTRAPOLATE: (u8, u8) = (10, 120);
/// The part of a run that counts as its start, where the mean state bends.
const START: u64 = 10;

/// Bounds of a node.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Bounds {
    /// The largest `|u|` (state units / s).
    pub input: Option<f64>,
    /// The largest slope by which a silent neighbour is extrapolated (state units / s).
    pub slope: Option<f64>,
    /// For how many ticks that goes on.
    pub extrapolate: u8,
}

impl Bounds {
    /// Those of a network of which nothing is known.
    pub const NONE: Self = Self { input: None, slope: None, extrapolate: EXTRAPOLATE.0 };

    /// Those of a scenario. An ideal bus that loses nothing, and no event, need none, and where the whole run
    /// cannot be followed there is none: a bound must never clip what the law does undisturbed.
    pub fn of(scenario: &Scenario) -> Self {
        let is_ideal = scenario.bus.model == BusModel::Ideal;
        let is_calm = scenario.bus.loss.is_none() && scenario.links.is_empty() && scenario.events.is_empty();
        if is_ideal && is_calm {
            return Self { input: scenario.u_max, ..Self::NONE };
        }
        Self::of_disturbed(scenario)
    }

    /// The same for a network that something else may disturb: a real bus, or events. Where events set something they clip neither
    /// what the law does before nor what it does after.
    pub fn of_disturbed(scenario: &Scenario) -> Self {
        let end = scenario.time.end_s();
        let width =
            |nodes: &[NodeSpec]| nodes.iter().map(|node| node.funnel.width(end)).fold(f64::INFINITY, smaller);
        let Some(after) = scenario.as_staged() else { return Self::within(scenario, width(&scenario.nodes)) };
        let narrowest = smaller(width(&scenario.nodes), width(&after.nodes));
        // In the funnels of the beginning: states may begin outside the others, and from there nothing can be followed.
        let node = |(now, next): (&NodeSpec, NodeSpec)| NodeSpec { funnel: now.funnel, ..next };
        let nodes = scenario.nodes.iter().zip(after.nodes).map(node).collect();
        let after = Self::within(&Scenario { nodes, ..scenario.clone() }, narrowest);
        Self::within(scenario, narrowest).or_wider(after)
    }

    /// Bounds that hold where either of both does. What is not known of one is that of the other.
    fn or_wider(self, other: Self) -> Self {
        let wider = |a: Option<f64>, b: Option<f64>| a.zip(b).map(|(a, b)| larger(a, b)).or(a).or(b);
        Self {
            input: wider(self.input, other.input),
            slope: wider(self.slope, other.slope),
            extrapolate: self.extrapolate.min(other.extrapolate),
        }
    }

    /// Bounds of a run as it begins, whose narrowest funnel is `narrowest` (state units).
    fn within(scenario: &Scenario, narrowest: f64) -> Self {
        let told = Self { input: scenario.u_max, ..Self::NONE };
        let Some(followed) = undisturbed(scenario) else { return told };
        let ticks = (narrowest / followed.bend).sqrt() / scenario.time.tick_s();
        // Who shall stop for neighbours that are lost must not be long in the dark about them.
        let (low, longest) = EXTRAPOLATE;
        let high = if scenario.safety.lost_neighbours == 0 { longest } else { low };
        Self {
            input: told.input.or(Some(INPUT * followed.input).filter(in_range)),
            slope: Some(SLOPE * followed.slope).filter(in_range),
            // A mean that does not bend allows any time.
            extrapolate: if ticks.is_nan() { high } else { ticks.clamp(low.into(), high.into()) as u8 },
        }
    }
}

/// The whole run without loss, events and bounds, where it can be followed and keeps its states together.
pub(crate) fn undisturbed(scenario: &Scenario) -> Option<Followed> {
    let is_vector = scenario.components() > 1;
    let is_tried = match scenario.coupling {
        // Nobody has tried what a bound does there.
        Coupling::EdgeWise | Coupling::WeaklyCentralised => false,
        Coupling::MaxGain => !is_vector,
        _ => promises(scenario),
    };
    if !is_tried {
        return None;
    }
    let mut calm = scenario.clone();
    (calm.bus.loss, calm.u_max, calm.events, calm.links) = (Loss::NONE, None, Vec::new(), Vec::new());
    let followed = follow_for(&calm, &scenario.graph.degrees(), Bounds::NONE, WORK)?;
    (followed.whole && followed.lost.is_none()).then_some(followed)
}

/// Whether a node takes it for a bound; what is larger or smaller bounds nothing.
fn in_range(value: &f64) -> bool {
    (params::SMALLEST..=params::LARGEST).contains(value)
}

/// How much the mean state bends.
pub(super) struct Bend {
    from: u64,
    tick: f64,
    components: usize,
    nodes: f64,
    /// The last two means of each component.
    last: Vec<[f64; 2]>,
    squares: f64,
    count: u64,
}

impl Bend {
    pub fn new(scenario: &Scenario, ticks: u64) -> Self {
        let components = scenario.components();
        Self {
            from: (ticks / START).max(scenario.time.start.end().into()),
            tick: scenario.time.tick_s(),
            components,
            nodes: scenario.nodes.len() as f64,
            last: vec![[0.0; 2]; components],
            squares: 0.0,
            count: 0,
        }
    }

    /// Takes the states after tick `k`, node by node.
    pub fn note(&mut self, k: u64, states: impl Iterator<Item = f64>) {
        let mut sums = vec![0.0; self.components];
        states.enumerate().for_each(|(index, x)| sums[index % self.components] += x);
        for (sum, [older, old]) in sums.into_iter().zip(&mut self.last) {
            let mean = sum / self.nodes;
            if k >= self.from.max(2) {
                let second = (mean - 2.0 * *old + *older) / (self.tick * self.tick);
                self.squares += second * second;
                self.count += 1;
            }
            (*older, *old) = (*old, mean);
        }
    }

    /// Its root mean square (state units / s^2).
    pub fn rms(&self) -> f64 {
        (self.squares / self.count.max(1) as f64).sqrt()
    }
}
