//! What the emergent dynamics predict, without running the nodes: first the motion of the whole, then what it
//! asks of each node.

mod forcing;
mod motion;
mod seen;

use super::widths::Widths;
use crate::emergent;
use crate::extremes::{larger, largest};
use crate::scenario::Scenario;
use funnelnet_law::gain::Gain;
use motion::Motion;
pub(super) use seen::{AtFloor, NodeSeen};

/// Node-steps that are spent on a prediction; it decides how many steps a large or long scenario gets, so
/// that `check` stays quick and its result depends on the scenario only.
const NODE_STEPS: usize = 2_000_000;
/// Most steps.
const MOST_STEPS: usize = 50_000;
/// Fewest steps.
const FEWEST_STEPS: f64 = 1_000.0;

/// Points in time that a prediction steps through.
#[derive(Clone, Copy, Debug)]
pub(super) struct Grid {
    /// Seconds.
    pub step: f64,
    pub steps: usize,
}

impl Grid {
    /// Steps that resolve the fields. The tick has no part in it: a ripple that turns whole times per tick
    /// would look like a constant. A run that is too long for them is looked at up to where they end.
    fn of(scenario: &Scenario) -> Self {
        let end = scenario.time.end_s();
        let resolving = end * emergent::STEPS_PER_CONSTANT * emergent::fastest(scenario);
        let steps = larger(FEWEST_STEPS, (resolving - 1e-9).ceil());
        let most = (NODE_STEPS / scenario.nodes.len().max(1)).min(MOST_STEPS);
        Self { step: end / steps, steps: (steps as usize).min(most) }
    }

    /// Whether the steps reach the end of the run.
    pub fn reaches(&self, scenario: &Scenario) -> bool {
        self.end() >= scenario.time.end_s() * (1.0 - 1e-9)
    }

    /// The time of a step, s.
    pub fn at(&self, index: usize) -> f64 {
        index as f64 * self.step
    }

    /// The end of what is looked at, s.
    pub fn end(&self) -> f64 {
        self.at(self.steps)
    }
}

/// What is expected of a run.
pub(super) struct Forecast {
    pub grid: Grid,
    /// The emergent trajectory, one per step (state units).
    pub xi: Vec<f64>,
    /// The blended dynamics at the end of the grid (state units).
    pub blended_end: f64,
    /// The bound that the escape estimate (Assumption 4) gives on every `|x_i|` up to the end of the grid
    /// (state units).
    pub reach: f64,
    /// Largest `|x|` of the initial states, of `xi`, and of the contracting nodes left to themselves (state
    /// units).
    pub largest_state: f64,
    /// The width at which a node floors its funnel, `funnelnet_law::floor`, by index (state units).
    pub resolution: Vec<f64>,
    /// By index.
    pub nodes: Vec<NodeSeen>,
    /// The steepest `df_i / dx` along `xi` (1/s).
    pub steepest: f64,
    /// `df_em / dxi` along `xi`: the largest, when (s), and the mean (1/s).
    pub slope_largest: f64,
    pub slope_largest_at: f64,
    pub slope_mean: f64,
    /// The tightest node while at the floor of its funnel; none where no funnel gets there.
    pub at_floor: Option<AtFloor>,
}

impl Forecast {
    pub fn of(scenario: &Scenario, widths: &Widths, degrees: &[f64]) -> Self {
        let gains = gains(scenario);
        let motion = Motion::of(scenario, widths, &gains);
        let seen = seen::along(&motion, scenario, widths, &gains, degrees);
        Self {
            grid: motion.grid,
            xi: motion.xi,
            blended_end: motion.blended,
            reach: motion.reach,
            largest_state: motion.largest_state,
            resolution: seen.resolution,
            nodes: seen.nodes,
            steepest: seen.steepest,
            slope_largest: seen.slope_largest,
            slope_largest_at: seen.slope_largest_at,
            slope_mean: seen.slope_mean,
            at_floor: seen.at_floor,
        }
    }

    /// `xi` at time `t` (s), between the steps on a straight line (state units).
    pub fn xi_at(&self, t: f64) -> f64 {
        let place = (t / self.grid.step).max(0.0);
        let before = (place as usize).min(self.xi.len().saturating_sub(1));
        let after = (before + 1).min(self.xi.len().saturating_sub(1));
        match (self.xi.get(before), self.xi.get(after)) {
            (Some(low), Some(high)) => low + (place - before as f64).min(1.0) * (high - low),
            _ => f64::NAN,
        }
    }

    /// `xi` at the end of the grid (state units).
    pub fn xi_end(&self) -> f64 {
        self.xi.last().copied().unwrap_or(0.0)
    }
}

/// The gains of the emergent dynamics, by index.
fn gains(scenario: &Scenario) -> Vec<Gain<f64>> {
    scenario.nodes.iter().map(|node| node.gain.prepared()).collect()
}

/// Relative widths `psi_i / max_j psi_j` at time `t` (s), which is all that the emergent dynamics depend on
/// (paper, remark on time-invariant emergent dynamics); the factors where all funnels are closed.
fn relative_widths(scenario: &Scenario, widths: &Widths, t: f64, relative: &mut Vec<f64>) {
    relative.clear();
    // Just after the start, where a funnel that is infinite at t = 0 has a width.
    relative.extend(widths.at(t.max(1e-9)));
    let widest = largest(0.0, relative.iter().copied());
    if widest > 0.0 {
        relative.iter_mut().for_each(|width| *width /= widest);
    } else {
        relative.clear();
        relative.extend(scenario.nodes.iter().map(|node| node.funnel.factor));
    }
}
