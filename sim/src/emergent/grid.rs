//! Steps in time that resolve what forces a motion, however long the tick is, and a motion that goes by them.

use super::runge_kutta;
use crate::extremes::{larger, largest, smaller};
use crate::number_format::significant;
use crate::scenario::{NodeSpec, Scenario};

/// Longest integration step, s.
const LONGEST_STEP: f64 = 0.002;
/// Steps per shortest time constant or radian of the fields: the method is then off by some 1e-6 in one of
/// them.
pub(crate) const STEPS_PER_CONSTANT: f64 = 8.0;
/// Most steps times nodes; a prediction may always take as many steps as the run has ticks, which cost more
/// (5e6 took 5 s in a build for tests).
const NODE_STEPS: f64 = 5e6;
/// Part of a step by which two times may differ and be the same.
const NEAR: f64 = 1e-6;

/// The fastest slope (1/s) or frequency (rad/s) of all fields. A sine without amplitude forces nothing.
pub(crate) fn fastest(scenario: &Scenario) -> f64 {
    let rates = |node: &NodeSpec| larger(node.dynamics.steepness(), node.dynamics.fastest_sine());
    largest(0.0, scenario.nodes.iter().map(rates))
}

/// What the steps are off by beside a state of size one, and what a prediction may be: both as the reference
/// has them.
const ERROR: f64 = 1e-9;
const ALLOWED: f64 = 1e-3;

/// Whether errors that have grown by `e^growth` leave nothing of a motion whose states are up to `size`
/// (state units).
pub(crate) fn outgrown(growth: f64, size: f64) -> bool {
    // Written so that what is not a number is outgrown.
    let kept = ERROR * funnelnet_law::math::exp(growth) <= ALLOWED * larger(1.0, size);
    !kept
}

/// Equal steps over a run.
#[derive(Clone, Debug)]
pub(super) struct Grid {
    /// s.
    pub step: f64,
    /// Why the steps do not resolve the fields, where they do not.
    pub unresolved: Option<String>,
}

impl Grid {
    /// Steps that resolve every slope and frequency of the fields. The tick has no part in it: a ripple that
    /// turns whole times per tick would look like a constant.
    pub fn of(scenario: &Scenario) -> Self {
        let most = (NODE_STEPS / scenario.nodes.len().max(1) as f64).max(scenario.time.ticks as f64);
        Self::within(scenario, most)
    }

    fn within(scenario: &Scenario, most: f64) -> Self {
        let (end, fastest) = (scenario.time.end_s(), fastest(scenario));
        let resolving = end * STEPS_PER_CONSTANT * fastest;
        let wanted = largest(1.0, [(end / LONGEST_STEP - NEAR).ceil(), (resolving - NEAR).ceil()]);
        let steps = smaller(wanted, most.floor());
        // Written so that what is not a number is not resolved.
        let resolved = resolving <= steps * (1.0 + NEAR);
        let why = || {
            format!(
                "the fields turn or change by {} a second, which {} steps would resolve; {} were made",
                significant(fastest, 4),
                significant(resolving.ceil(), 4),
                significant(steps, 4)
            )
        };
        Self { step: end / steps, unresolved: (!resolved).then(why) }
    }

    /// The time of a point of the grid, s.
    fn at(&self, index: u64) -> f64 {
        index as f64 * self.step
    }
}

/// A state that goes from point to point of a grid, and from the last of them to any time before the next.
/// What is asked for in between leaves no trace: the points have the same bits whatever is asked.
#[derive(Clone, Debug)]
pub(super) struct Walk {
    pub grid: Grid,
    index: u64,
    /// At the last point, by component.
    point: Vec<f64>,
    /// The time that was asked for last, s, and the state there.
    pub t: f64,
    pub x: Vec<f64>,
}

impl Walk {
    /// Begins at t = 0.
    pub fn new(grid: Grid, x: Vec<f64>) -> Self {
        Self { grid, index: 0, point: x.clone(), t: 0.0, x }
    }

    /// Goes on to the next point of the grid, unless it is later than `until` (s).
    pub fn step(&mut self, until: f64, f: impl FnMut(f64, &[f64]) -> Vec<f64>) -> bool {
        let next = self.grid.at(self.index + 1);
        if next > until + NEAR * self.grid.step {
            return false;
        }
        self.point = runge_kutta(self.grid.at(self.index), &self.point, self.grid.step, f);
        self.index += 1;
        (self.t, self.x) = (next, self.point.clone());
        true
    }

    /// Looks ahead from the last point to `t` (s), which is before the next.
    pub fn look(&mut self, t: f64, f: impl FnMut(f64, &[f64]) -> Vec<f64>) {
        let from = self.grid.at(self.index);
        self.t = t;
        self.x = match t - from > NEAR * self.grid.step {
            true => runge_kutta(from, &self.point, t - from, f),
            false => self.point.clone(),
        };
    }
}

#[cfg(test)]
mod tests {
    use super::super::tests::five_agents;
    use super::*;

    #[test]
    fn the_step_resolves_the_fields_whatever_the_tick_is() {
        let ripple = "node.1.dynamics={kind='affine',slope=-1.0,sines=[{amplitude=1.0,frequency=3000.0}]}";
        for tick in ["time.tick=1ms", "time.tick=20ms", "time.tick=200ms"] {
            let grid = Grid::of(&five_agents(&[ripple, tick]));
            assert!((grid.step - 1.0 / 24_000.0).abs() < 1e-9, "{}", grid.step);
            assert_eq!(grid.unresolved, None);
        }
        let idle = "node.1.dynamics={kind='affine',slope=-1.0,sines=[{amplitude=0.0,frequency=3000.0}]}";
        assert_eq!(Grid::of(&five_agents(&[idle])).step, LONGEST_STEP);
    }

    #[test]
    fn steps_that_are_too_few_are_said_to_be() {
        let scenario = five_agents(&[]);
        // 20 s at 10 rad/s.
        assert_eq!(Grid::within(&scenario, 1600.0).unresolved, None);
        let why = Grid::within(&scenario, 1599.0).unresolved.unwrap();
        assert!(why.contains("10 a second, which 1600 steps would resolve; 1599 were made"), "{why}");
    }

    #[test]
    fn what_is_asked_in_between_leaves_no_trace() {
        let walk = || Walk::new(Grid { step: 0.01, unresolved: None }, vec![1.0]);
        let f = |t: f64, x: &[f64]| vec![t - x[0] * x[0]];
        let (mut asked, mut alone) = (walk(), walk());
        for k in 1..=100 {
            let t = 0.013 * f64::from(k);
            while asked.step(t, f) {}
            asked.look(t, f);
        }
        while alone.step(1.3, f) {}
        assert_eq!(asked.point[0].to_bits(), alone.point[0].to_bits());
        assert_eq!(asked.index, 130);
        assert_eq!((asked.t, asked.x[0].to_bits()), (1.3, alone.point[0].to_bits()));
    }
}
