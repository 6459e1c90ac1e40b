//! The elected leader (paper, Section "Electing a leader by designing psi"): its deviation from its free
//! motion falls with the factor K by which its funnel is wider, and stays below `mu(4 / K)`, for a field that
//! contracts by nearly 1/s.

use funnelnet_law::emergent::runge_kutta;
use funnelnet_law::gain::{GainFunction, Reciprocal};
use sim_host::run::Fidelity;
use system_tests::{run, scenario};

/// Largest distance of node 1 to its own field left alone, over the run.
fn deviation(name: &str) -> f64 {
    let scenario = scenario(name, &[]);
    let leader = &scenario.nodes[0].dynamics;
    let (mut t, mut free, mut worst) = (0.0, scenario.initial_states()[0], 0.0f64);
    for row in run(&scenario, Fidelity::Loopback).rows {
        if row.t > t {
            free = runge_kutta(t, free, row.t - t, |t, x| leader.value(t, x));
        }
        t = row.t;
        worst = worst.max((row.x[0] - free).abs());
    }
    worst
}

#[test]
fn a_leader_hardly_notices_the_others() {
    let mu = Reciprocal { scale: 1.0 };
    for (name, factor, limit) in
        [("leader-10.toml", 10.0, 0.4), ("leader.toml", 100.0, 0.04), ("leader-1000.toml", 1000.0, 0.004)]
    {
        let found = deviation(name);
        let bound: f64 = mu.apply(4.0 / factor);
        assert!(found < limit && found < bound, "{name}: {found}, below {limit} and mu(4/K) = {bound}");
        assert!(found > limit / 4.0, "{name}: {found}: does it still follow the factor?");
    }
}
