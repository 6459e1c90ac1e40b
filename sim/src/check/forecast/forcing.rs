//! The parts of all affine fields that do not depend on the state, at equally spaced times: sines by
//! rotation, not one by one.

use crate::scenario::{Affine, Scenario, Sine};
use funnelnet_law::math;

/// One sine on its way round.
struct Phasor {
    node: usize,
    amplitude: f64,
    frequency: f64,
    sin: f64,
    cos: f64,
    /// Sine and cosine of the angle of one step.
    turn: (f64, f64),
}

/// `f_i(t, x) - slope_i x` and its derivative by time, by index; nothing for an expression, which has no such
/// part.
pub(super) struct Forcing {
    offsets: Vec<f64>,
    phasors: Vec<Phasor>,
    /// State units / s.
    pub value: Vec<f64>,
    /// State units / s^2.
    pub rate: Vec<f64>,
}

impl Forcing {
    /// Begins at t = 0; `step` in s.
    pub fn new(scenario: &Scenario, step: f64) -> Self {
        let nodes = scenario.nodes.iter().enumerate();
        let phasors = nodes.flat_map(|(node, spec)| {
            spec.dynamics.affine().into_iter().flat_map(|field| &field.sines).map(move |sine: &Sine| {
                let angle = sine.frequency * step;
                Phasor {
                    node,
                    amplitude: sine.amplitude,
                    frequency: sine.frequency,
                    sin: math::sin(sine.phase),
                    cos: math::cos(sine.phase),
                    turn: (math::sin(angle), math::cos(angle)),
                }
            })
        });
        let count = scenario.nodes.len();
        let mut forcing = Self {
            offsets: scenario
                .nodes
                .iter()
                .map(|node| node.dynamics.affine().map_or(0.0, Affine::offset))
                .collect(),
            phasors: phasors.collect(),
            value: vec![0.0; count],
            rate: vec![0.0; count],
        };
        forcing.add_up();
        forcing
    }

    /// Goes on by one step.
    pub fn advance(&mut self) {
        for phasor in &mut self.phasors {
            let (sin, cos) = phasor.turn;
            (phasor.sin, phasor.cos) =
                (phasor.sin * cos + phasor.cos * sin, phasor.cos * cos - phasor.sin * sin);
        }
        self.add_up();
    }

    fn add_up(&mut self) {
        self.value.copy_from_slice(&self.offsets);
        self.rate.fill(0.0);
        for phasor in &self.phasors {
            self.value[phasor.node] += phasor.amplitude * phasor.sin;
            self.rate[phasor.node] += phasor.amplitude * phasor.frequency * phasor.cos;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::path::Path;

    #[test]
    fn rotation_gives_the_sines() {
        let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../scenarios/five-agents.toml");
        let scenario = Scenario::load(&path, &[]).unwrap();
        let mut forcing = Forcing::new(&scenario, 0.004);
        for _ in 0..5_000 {
            forcing.advance();
        }
        for (index, node) in scenario.nodes.iter().enumerate() {
            let affine = node.dynamics.affine().unwrap();
            assert!((forcing.value[index] - affine.forcing(20.0)).abs() < 1e-9);
            assert!((forcing.rate[index] - affine.rate_of_forcing(20.0)).abs() < 1e-8);
        }
    }
}
