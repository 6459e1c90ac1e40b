//! Economic dispatch (scenarios/economic-dispatch.toml): what the network finds, against the optimum of the same numbers.

use sim_host::run::Fidelity;
use system_tests::{run, scenario};

/// A generator with the cost `a p^2 + b p`, and the demand at its node.
struct Generator {
    a: f64,
    b: f64,
    demand: f64,
}

impl Generator {
    /// What it supplies at the price `lambda`.
    fn supply(&self, lambda: f64) -> f64 {
        (lambda - self.b) / (2.0 * self.a)
    }

    fn cost(&self, supply: f64) -> f64 {
        (self.a * supply + self.b) * supply
    }
}

#[test]
fn the_network_meets_the_demand_at_the_least_cost() {
    let scenario = scenario("economic-dispatch.toml", &[]);
    // lambda' = d - (lambda - b) / (2 a), and the price starts at b, where nothing is supplied.
    let generators = scenario.nodes.iter().map(|node| {
        let a = -0.5 / node.dynamics.slope();
        let b = node.state[0];
        Generator { a, b, demand: node.dynamics.offset() - b / (2.0 * a) }
    });
    let generators: Vec<Generator> = generators.collect();
    let sum = |of: &dyn Fn(&Generator) -> f64| generators.iter().map(of).sum::<f64>();
    let demand = sum(&|g| g.demand);
    let price = (demand + sum(&|g| g.b / (2.0 * g.a))) / sum(&|g| 0.5 / g.a);
    let least = sum(&|g| g.cost(g.supply(price)));
    assert!((sum(&|g| g.supply(price)) - demand).abs() < 1e-9 * demand);

    let prices = run(&scenario, Fidelity::Loopback).last;
    let supplies: Vec<f64> = generators.iter().zip(&prices).map(|(g, &price)| g.supply(price)).collect();
    let cost: f64 = generators.iter().zip(&supplies).map(|(g, &supply)| g.cost(supply)).sum();
    let balance = supplies.iter().sum::<f64>() - demand;
    assert!((cost / least - 1.0).abs() < 1e-4, "cost {cost}, least {least}");
    assert!(balance.abs() < 1e-3, "supply less demand: {balance}");
}
