//! Couplings in whole networks: what each of them keeps.
#![allow(clippy::unwrap_used, reason = "helpers of tests, which clippy does not know as such")]

use sim_host::emergent::EmergentTrajectory;
use sim_host::run::{Fidelity, Outcome};
use sim_host::scenario::{Coupling, Edge, Gain, Graph, Scenario};
use system_tests::{heterogeneous, run, scenario};

#[test]
fn edge_wise_inputs_add_up_to_zero() {
    // No dynamics of their own: the sum of all states moves by the rounding of f32 and nothing else.
    let still = (1..=5).map(|id| format!("node.{id}.dynamics={{kind='affine'}}"));
    let sets =
        ["coupling.kind=edge-wise", "time.duration=10s", "coupling.funnel.end=1e-3"].map(str::to_owned);
    let sets: Vec<_> = sets.into_iter().chain(still).collect();
    let sets: Vec<_> = sets.iter().map(String::as_str).collect();
    let outcome = run(&scenario("five-agents.toml", &sets), Fidelity::Loopback);
    for row in &outcome.rows {
        // Two edges at each node of the ring: each input is the sum of two, rounded once, at most 4e3 here.
        let largest = row.u.iter().fold(0.0f64, |most, u| most.max(u.abs()));
        let inputs: f64 = row.u.iter().sum();
        assert!(
            inputs.abs() <= 5.0 * largest * f64::from(f32::EPSILON),
            "t = {}: {inputs} of {largest}",
            row.t
        );
        let sum: f64 = row.x.iter().sum();
        assert!((sum - 2.5).abs() < 5e-6, "t = {}: {sum}", row.t);
    }
    assert!(outcome.last.iter().all(|x| (x - 0.5).abs() < 2e-3), "{:?}", outcome.last);
}

/// The largest distance of a node to `xi` from 10 s on.
fn distance(scenario: &Scenario) -> f64 {
    let outcome = run(scenario, Fidelity::Loopback);
    let late = outcome.rows.iter().filter(|row| row.t > 10.0);
    let apart = late.flat_map(|row| row.x.iter().map(|x| (x - row.xi[0]).abs()));
    apart.fold(0.0, f64::max)
}

/// The largest distance of the emergent dynamics of two scenarios over 20 s.
fn apart(one: &Scenario, other: &Scenario) -> f64 {
    let [mut one, mut other] = [one, other].map(|scenario| EmergentTrajectory::new(scenario).unwrap());
    let at = |k: u32| 0.1 * f64::from(k);
    (0..200).map(|k| (one.advance(at(k))[0] - other.advance(at(k))[0]).abs()).fold(0.0, f64::max)
}

#[test]
fn each_coupling_has_emergent_dynamics_of_its_own() {
    let with = |sets: &[&str]| scenario("five-agents.toml", sets);
    let (node_wise, edge_wise) = (with(&[]), with(&["coupling.kind=edge-wise"]));
    let central = with(&["coupling.kind=weakly-centralised", "node.2.funnel={factor=2}"]);
    let pairs = [(&node_wise, &edge_wise), (&node_wise, &central), (&edge_wise, &central)];
    // More than what the couplings are followed by, below.
    for (one, other) in pairs {
        assert!(apart(one, other) > 0.2, "{}", apart(one, other));
    }
    assert_eq!(apart(&node_wise, &with(&["coupling.kind=element-wise"])), 0.0);
    assert_eq!(apart(&node_wise, &with(&["coupling.kind=max-gain"])), 0.0);
    let linear = with(&["coupling.kind=linear", "coupling.gain={kind='linear',slope=5}"]);
    assert!(apart(&edge_wise, &linear) < 1e-9);
}

#[test]
fn each_coupling_follows_the_emergent_dynamics_of_its_own() {
    let narrow = "coupling.funnel={kind='exponential',start=40,end=0.02,rate=1}";
    let linear = "coupling.gain={kind='linear',slope=2000}";
    let mut different = scenario("five-agents.toml", &["coupling.kind=linear", linear]);
    different.nodes[1].gain = Gain::Linear { slope: 500.0 };
    for scenario in [
        scenario("five-agents.toml", &[narrow]),
        scenario("five-agents.toml", &[narrow, "coupling.kind=element-wise"]),
        scenario("five-agents.toml", &[narrow, "coupling.kind=edge-wise"]),
        scenario(
            "five-agents.toml",
            &[narrow, "coupling.kind=weakly-centralised", "node.2.funnel={factor=2}"],
        ),
        scenario("five-agents.toml", &["coupling.kind=linear", linear]),
        different,
    ] {
        let found = distance(&scenario);
        assert!(found < 0.06, "{}: {found}", scenario.coupling.kind());
    }
    for kind in ["none", "lambda-tracker"] {
        let sets = [&format!("coupling.kind={kind}"), linear, "coupling.eta=1"];
        let sets = if kind == "none" { &sets[..1] } else { &sets[..] };
        assert!(EmergentTrajectory::new(&scenario("five-agents.toml", sets)).is_none());
    }
}

/// `x' = f + G nu / psi` with the paper's `G = max_j gamma_j(|nu_j| / psi_j)` as it stands, by Euler steps of
/// `step` (s).
fn weakly_centralised(scenario: &Scenario, step: f64) -> Vec<f64> {
    let mut x = scenario.initial_states();
    let steps = (scenario.time.end_s() / step).round() as u64;
    for k in 0..steps {
        let t = k as f64 * step;
        let nu = scenario.graph.diffusive_terms(&x);
        let psi: Vec<f64> = scenario.nodes.iter().map(|node| node.funnel.width(t)).collect();
        let gamma = |i: usize| {
            let s = nu[i].abs() / psi[i];
            match scenario.nodes[i].gain {
                Gain::Reciprocal { scale } => scale / (1.0 - s),
                Gain::Logarithmic { scale } if s > 0.0 => -scale * funnelnet_law::math::ln(1.0 - s) / s,
                Gain::Logarithmic { scale } => scale,
                _ => f64::NAN,
            }
        };
        let largest = (0..x.len()).map(gamma).fold(0.0, f64::max);
        for (i, node) in scenario.nodes.iter().enumerate() {
            x[i] += step * (node.dynamics.value(t, x[i]) + largest * nu[i] / psi[i]);
        }
    }
    x
}

fn final_states(scenario: &Scenario) -> (Outcome, Vec<f64>) {
    let outcome = run(scenario, Fidelity::Loopback);
    let last = outcome.last.clone();
    (outcome, last)
}

#[test]
fn weakly_centralised_coupling_is_the_one_of_the_paper() {
    let mut scenario = heterogeneous("1s");
    scenario.coupling = Coupling::WeaklyCentralised;
    let (outcome, found) = final_states(&scenario);
    let exact = weakly_centralised(&scenario, 1e-6);
    let error = found.iter().zip(&exact).map(|(x, y)| (x - y).abs()).fold(0.0, f64::max);
    assert!(error < 2e-3, "{error}: {found:?}, {exact:?}");
    assert!(outcome.max_ratio < 1.0 && outcome.bus.is_some_and(|bus| bus.sent == 0));
    // Node-wise gains lead elsewhere.
    let (_, node_wise) = final_states(&heterogeneous("1s"));
    let apart = node_wise.iter().zip(&exact).map(|(x, y)| (x - y).abs()).fold(0.0, f64::max);
    assert!(apart > 20.0 * error.max(1e-4), "{apart} and {error}");
}

#[test]
fn diffusive_terms_add_up_to_zero_whatever_the_coupling() {
    for kind in [Coupling::NodeWise, Coupling::EdgeWise, Coupling::WeaklyCentralised] {
        let sets = ["time.duration=10s", "coupling.funnel.end=0.02"];
        let mut scenario = scenario("five-agents.toml", &sets);
        scenario.coupling = kind;
        scenario.nodes.truncate(2);
        scenario.graph = Graph { nodes: 2, edges: vec![Edge { a: 0, b: 1, weight: 1.0 }] };
        for row in run(&scenario, Fidelity::Loopback).rows {
            // A node that used of its state what it does not send would see more than the other one does.
            assert_eq!(row.nu[0], -row.nu[1], "{kind:?} at {}", row.t);
        }
    }
}

#[test]
fn a_breach_stops_a_node_that_shall_stop() {
    // A funnel that the tick cannot hold.
    let sets = [
        "coupling.funnel.end=1e-4",
        "coupling.funnel.rate=20",
        "coupling.on_breach=stop",
        "time.duration=1s",
    ];
    let mut stopping = scenario("five-agents.toml", &sets);
    let outcome = run(&stopping, Fidelity::Loopback);
    assert!(
        outcome.counters.iter().any(|counters| counters.ticks < 1000 && counters.breaches == 1),
        "{:?}",
        outcome.counters
    );
    let summary = outcome.judge(&stopping, Fidelity::Loopback);
    let counts = outcome.counters.iter().zip(1u16..);
    let short: Vec<_> = counts.filter(|(counters, _)| counters.ticks < 1000).map(|(_, id)| id).collect();
    assert_eq!(summary.stopped, short);
    // One tick each, however long they have been standing still since.
    let counted: u32 = outcome.counters.iter().map(|counters| counters.breaches).sum();
    assert_eq!(outcome.believed.map(|believed| believed.breaches), Some(u64::from(counted)));
    // Standing still is no way back inside: a node that has stopped is judged on.
    assert!(outcome.breaches > u64::from(counted), "{}", outcome.breaches);
    stopping.on_breach = sim_host::scenario::Breach::Ride;
    let outcome = run(&stopping, Fidelity::Loopback);
    assert!(outcome.counters.iter().all(|counters| counters.ticks == 1001), "{:?}", outcome.counters);
}

#[test]
fn noise_reaches_the_neighbours_and_not_the_node() {
    let sets = ["coupling.kind=none", "time.duration=1s"];
    let silent = run(&scenario("five-agents.toml", &sets), Fidelity::Loopback);
    let noisy =
        run(&scenario("five-agents.toml", &[&sets[..], &["agent.noise=0.1"]].concat()), Fidelity::Loopback);
    // Without coupling the states do not know of the noise; the diffusive terms do.
    assert_eq!(silent.hash, noisy.hash);
    let terms = silent.rows.iter().zip(&noisy.rows);
    let differences: Vec<f64> =
        terms.flat_map(|(a, b)| a.nu.iter().zip(&b.nu).map(|(a, b)| a - b).collect::<Vec<_>>()).collect();
    let variance = differences.iter().map(|d| d * d).sum::<f64>() / differences.len() as f64;
    // Two neighbours on a ring: 2 * 0.1^2.
    assert!((variance / 0.02 - 1.0).abs() < 0.1, "{variance}");
}
