//! Where `xi` starts: at the mean of the initial states that the inputs of the coupling leave alone.
//!
//! A coupling has weights for which its inputs add up to zero, so that the mean by these weights moves by the
//! fields only. The nodes meet at that mean where their fields are zero, and `xi` has to start there, or it
//! is beside them for ever:
//!
//! | coupling | adds up to zero | mean by | exact |
//! |---|---|---|---|
//! | edge-wise | `sum u_i` | 1 | yes |
//! | linear | `sum nu_i = sum u_i / k_i` | `1 / k_i` | yes |
//! | weakly centralised | `G sum nu_i = sum psi_i u_i` | `psi_i(0)` | where all funnels have one shape, `psi_i = r_i psi(t)` |
//! | the paper's law | `sum psi_i mu_i^-1(u_i)`, of which no mean is kept | 1 | with two nodes of one gain and one funnel |
//!
//! Funnels of different shapes move the weights: their mean changes by `sum_i w_i' (x_i - mean)` while the
//! states are apart, and by nothing once they have met. For the paper's law the theorem on emergent behaviour
//! starts `xi` at the plain mean of the states after the transient,
//! `xi(t_1 + tau) = (1/N) sum_i x_i(t_1 + tau)`, and the remark below it says that this value is hard to
//! identify: it depends on the graph and on the funnels before `t_1`, and is known to lie between the
//! smallest and the largest initial state. The plain mean of the initial states stands for it here.

use super::AFTER_START;
use crate::extremes::largest;
use crate::scenario::{Coupling, NodeSpec, Scenario};

/// The initial `xi`, by component (state units).
pub(crate) fn start(scenario: &Scenario) -> Vec<f64> {
    let weights: Vec<f64> = scenario.nodes.iter().map(|node| weight(scenario.coupling, node)).collect();
    mean(scenario, &weights)
}

/// The plain mean of the initial states, where the blended dynamics start, by component (state units).
pub(crate) fn plain_mean(scenario: &Scenario) -> Vec<f64> {
    mean(scenario, &vec![1.0; scenario.nodes.len()])
}

/// The weight of a node's initial state, up to a factor that all nodes share.
fn weight(coupling: Coupling<f64>, node: &NodeSpec) -> f64 {
    match (coupling, &node.gain) {
        (Coupling::Linear, gain) => 1.0 / gain.slope_at_zero(),
        (Coupling::WeaklyCentralised, _) => node.funnel.width(AFTER_START),
        _ => 1.0,
    }
}

fn mean(scenario: &Scenario, weights: &[f64]) -> Vec<f64> {
    // By the largest, so that equal weights are 1 and give the bits of the plain mean.
    let scale = largest(0.0, weights.iter().copied());
    let total: f64 = weights.iter().map(|weight| weight / scale).sum();
    let of = |component: usize| {
        let states = scenario.nodes.iter().map(|node| node.state[component]);
        states.zip(weights).map(|(x, weight)| weight / scale * x).sum::<f64>() / total
    };
    (0..scenario.components()).map(of).collect()
}

#[cfg(test)]
mod tests {
    use super::super::EmergentTrajectory;
    use super::*;
    use crate::Simulation;
    use crate::emergent::Predictor;
    use crate::scenario::Override;
    use funnelnet_law::math;
    use std::path::Path;

    /// Five nodes with one field for all, `2 - 3 sin(t)`, in a ring.
    fn ring(coupling: &str, sets: &[&str]) -> Scenario {
        let text = format!(
            r#"
version = 1
time = {{ tick = "1ms", duration = "8s" }}
graph = {{ kind = "ring", nodes = 5 }}
coupling = {{ {coupling} }}
agent = {{ dynamics = {{ kind = "affine", offset = 2.0, sines = [{{ amplitude = -3.0, frequency = 1.0 }}] }} }}
node = [
    {{ id = 1, state = 3.5 }}, {{ id = 2, state = -2.0 }}, {{ id = 3, state = 6.1 }}, {{ id = 4, state = 0.4 }},
    {{ id = 5, state = -4.7 }},
]
"#
        );
        let sets: Vec<_> = sets.iter().map(|set| Override::parse(set).unwrap()).collect();
        Scenario::parse(&text, Path::new("ring.toml"), &sets).unwrap()
    }

    /// Where the nodes meet, where `xi` ends, and where it would from the plain mean.
    fn met(scenario: &Scenario) -> (f64, f64, f64) {
        let last = Simulation::new(scenario).unwrap().run().findings.last;
        let (low, high) = crate::extremes::extremes(last.iter().copied());
        assert!(high - low < 2e-3, "they have not met: {last:?}");
        let end = scenario.time.end_s();
        let xi = EmergentTrajectory::new(scenario).unwrap().advance(end)[0];
        assert_eq!(Predictor::new(scenario).advance(end).xi, [xi]);
        let common = 2.0 * end - 3.0 * (1.0 - math::cos(end));
        (0.5 * (low + high), xi, plain_mean(scenario)[0] + common)
    }

    const GAIN: &str = "gain = { kind = 'reciprocal', scale = 1.0 }";
    const FUNNEL: &str = "funnel = { kind = 'exponential', start = 40.0, end = 0.002, rate = 2.0 }";

    fn linear(sets: &[&str]) -> Scenario {
        ring(&format!("kind = 'linear', gain = {{ kind = 'linear', slope = 20.0 }}, {FUNNEL}"), sets)
    }

    fn central(sets: &[&str]) -> Scenario {
        ring(&format!("kind = 'weakly-centralised', {GAIN}, {FUNNEL}"), sets)
    }

    #[test]
    fn linear_coupling_meets_at_the_mean_by_the_reciprocal_gains() {
        let gains = ["node.1.gain={slope=4.0}", "node.2.gain={slope=100.0}", "node.5.gain={slope=7.0}"];
        // The sampled law moves the mean by T b_i u_i(0), which is of second order in the tick.
        let (met, xi, plain) = met(&linear(&[&gains[..], &["time.tick=250us"]].concat()));
        assert!((met - xi).abs() < 5e-4, "{met} {xi}");
        assert!((met - plain).abs() > 0.3, "{met} {plain}");
    }

    #[test]
    fn weakly_centralised_coupling_meets_at_the_mean_by_the_funnels() {
        let (met, xi, plain) = met(&central(&["node.1.funnel={factor=3.0}", "node.3.funnel={factor=0.8}"]));
        assert!((met - xi).abs() < 5e-3, "{met} {xi}");
        assert!((met - plain).abs() > 0.5, "{met} {plain}");
    }

    #[test]
    fn edge_wise_coupling_meets_at_the_plain_mean() {
        let (met, xi, plain) = met(&ring(&format!("kind = 'edge-wise', {GAIN}, {FUNNEL}"), &[]));
        assert!((met - xi).abs() < 5e-4, "{met} {xi}");
        assert!((xi - plain).abs() < 1e-9, "{xi} {plain}");
    }

    #[test]
    fn funnels_of_different_shapes_start_xi_nearer_than_the_plain_mean_does() {
        // The weights move away from psi_i(0) while the states come together, so that the start is not exact.
        let (met, xi, plain) = met(&central(&["node.1.funnel={factor=3.0}", "node.2.funnel={rate=1.8}"]));
        assert!((met - xi).abs() < 0.5 * (met - plain).abs(), "{met} {xi} {plain}");
    }

    #[test]
    fn two_nodes_of_one_gain_and_one_funnel_meet_at_the_plain_mean() {
        let pair = ["graph.nodes=2", "graph.kind=path", "node=[{id=1,state=3.5},{id=2,state=-2.0}]"];
        let (met, xi, plain) = met(&ring(&format!("kind = 'node-wise', {GAIN}, {FUNNEL}"), &pair));
        assert!((met - xi).abs() < 5e-4 && (xi - plain).abs() < 1e-9, "{met} {xi} {plain}");
    }

    #[test]
    fn every_component_has_the_weights_of_its_node() {
        let states = "node=[{id=1,state=[1,-2],gain={slope=5}},{id=2,state=[4,4]},{id=3,state=[0,1]},{id=4,state=[0,1]},{id=5,state=[0,1]}]";
        // Weights 4, 1, 1, 1, 1.
        let xi = start(&linear(&[states]));
        assert!((xi[0] - 8.0 / 8.0).abs() < 1e-15 && (xi[1] + 1.0 / 8.0).abs() < 1e-15, "{xi:?}");
    }

    #[test]
    fn a_funnel_that_is_infinite_at_the_start_has_a_weight() {
        let infinite = "coupling.funnel={kind='reciprocal-time',scale=1.0}";
        let scenario = central(&[infinite, "node.2.funnel={factor=2.0}"]);
        assert!((start(&scenario)[0] - (3.3 - 2.0) / 6.0).abs() < 1e-12, "{:?}", start(&scenario));
    }

    #[test]
    fn equal_weights_give_the_bits_of_the_plain_mean() {
        for scenario in
            [linear(&[]), central(&[]), ring(&format!("kind = 'node-wise', {GAIN}, {FUNNEL}"), &[])]
        {
            assert_eq!(start(&scenario)[0].to_bits(), plain_mean(&scenario)[0].to_bits());
        }
    }
}
