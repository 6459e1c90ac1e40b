//! Economic dispatch (scenarios/economic-dispatch.toml): what the network finds, against the optimum of the
//! same numbers.

#![allow(clippy::panic, reason = "helpers of tests, which clippy does not know as such")]

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
        let field = node.dynamics.affine().unwrap();
        let a = -0.5 / field.slope();
        let b = node.state[0];
        Generator { a, b, demand: field.offset() - b / (2.0 * a) }
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

/// `d - clamp((x - b)/(2 a), 0, most)` of a text.
struct Limited {
    demand: f64,
    b: f64,
    twice_a: f64,
    most: f64,
}

impl Limited {
    fn of(text: &str) -> Self {
        let numbers =
            text.split(|c: char| !(c.is_ascii_digit() || c == '.')).filter_map(|word| word.parse().ok());
        let numbers: Vec<f64> = numbers.collect();
        let [demand, b, twice_a, _, most] = numbers[..] else { panic!("{text}") };
        Self { demand, b, twice_a, most }
    }

    fn supply(&self, price: f64) -> f64 {
        ((price - self.b) / self.twice_a).clamp(0.0, self.most)
    }
}

#[test]
fn with_limits_the_network_finds_the_price_at_which_they_meet_the_demand() {
    let scenario = scenario("dispatch-limits.toml", &[]);
    let text = |node: &sim_host::scenario::NodeSpec| node.dynamics.expression().unwrap().text[0].clone();
    let generators: Vec<_> = scenario.nodes.iter().map(|node| Limited::of(&text(node))).collect();
    let missing = |price: f64| generators.iter().map(|g| g.demand - g.supply(price)).sum::<f64>();
    // By bisection: what is supplied grows with the price.
    let (mut low, mut high) = (0.0, 100.0);
    for _ in 0..100 {
        let middle = 0.5 * (low + high);
        if missing(middle) > 0.0 { low = middle } else { high = middle }
    }
    assert!((low - 12.4599).abs() < 1e-4, "{low}");
    assert_eq!(generators.iter().filter(|g| g.supply(low) == g.most).count(), 6);
    let prices = run(&scenario, Fidelity::Loopback).last;
    let lacks: f64 = generators.iter().zip(&prices).map(|(g, &price)| g.demand - g.supply(price)).sum();
    assert!(lacks.abs() < 1e-3, "{lacks}");
    assert!(prices.iter().all(|price| (price - low).abs() < 1e-3), "{prices:?}, not {low}");
}
