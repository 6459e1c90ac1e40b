//! Slow start (law.md 7): network time passes in eighths of a tick at first, and tick numbers count on.
#![allow(clippy::unwrap_used)]

use funnelnet_node::params::LONGEST_SLOW_START;
use funnelnet_node::{InputRange, Node, Params, PlantSetup};
use funnelnet_protocol::config::{
    ConfigError, ConfigField, Coupling, EdgeConfig, Field, Gain, NodeConfig, Shape, Sine, Tuning,
};
use funnelnet_protocol::message::{Command, Component, Message, NodeId, Target, TickStamp};

const MS: u32 = 1_000_000;

fn config(slow_start: u16, round: u8) -> NodeConfig {
    let sine = Sine { component: 0, amplitude: 10.0, frequency: 30.0, phase: 0.3 };
    NodeConfig::builder(1, MS)
        .state([0.5])
        .field(Field::scalar(-1.0, 2.0, [sine]))
        .funnel(Shape::Exponential { start: 4.0, end: 1.0, rate: 50.0 })
        .tuning(Tuning { slow_start, round, ..Tuning::default() })
        .build()
        .unwrap()
}

/// State and funnel of a node without edges at each of so many ticks.
fn alone(config: &NodeConfig, ticks: u32) -> Vec<(f32, f32)> {
    let mut node = Node::new(Params::<f32>::new(config).unwrap(), &config.neighbours);
    let start = Message::Ctrl { target: Target::All, command: Command::Start, arg: 0, at_tick: 0 };
    node.on_message(&start, 0).unwrap();
    let period = config.period_ns();
    let seen = |k: u32| {
        let now = (u64::from(k) + 1) * period;
        while node.poll(now).is_some() {}
        let seen = node.observations()[0];
        assert_eq!(seen.tick, k, "tick numbers count on");
        (seen.x, seen.psi)
    };
    (0..ticks).map(seen).collect()
}

#[test]
fn time_passes_in_eighths_first_and_then_as_ever() {
    for (round, error) in [(1, 1e-6), (3, 1e-6)] {
        let (usual, slow) = (alone(&config(0, round), 60), alone(&config(10, round), 130));
        for (k, &(x, psi)) in usual.iter().enumerate() {
            // 80 ticks for the first ten, then one for one.
            let (slow_x, slow_psi) = slow[if k < 10 { 8 * k } else { k + 70 }];
            // The midpoint steps of an eighth are more exact.
            assert!((slow_x - x).abs() < 2e-4, "round {round}, tick {k}: {slow_x} {x}");
            assert!((slow_psi - psi).abs() < error * psi, "round {round}, tick {k}: {slow_psi} {psi}");
        }
    }
}

#[test]
fn in_between_the_funnel_is_that_of_the_eighth() {
    let slow = alone(&config(10, 1), 80);
    for (k, &(_, psi)) in slow.iter().enumerate() {
        let t = k as f64 * 1e-3 / 8.0;
        let asked = 3.0 * funnelnet_law::math::exp(-50.0 * t) + 1.0;
        assert!((f64::from(psi) - asked).abs() < 1e-5, "{k}: {psi} {asked}");
    }
}

#[test]
fn the_law_is_damped_more_until_ten_times_as_long() {
    // A pair; the neighbour stays at 1. What the node asks for depends on theta, c and T by b alone while
    // nothing changes.
    let config = |slow_start| {
        let edge = EdgeConfig::new(2, 1.0);
        let tuning = Tuning { slow_start, ..Tuning::default() };
        NodeConfig::builder(1, MS)
            .field(Field::scalar(0.0, 0.0, []))
            .gain(Gain::Reciprocal { scale: 1.0 })
            .funnel(Shape::Constant { width: 2.0 })
            .edges([edge])
            .tuning(tuning)
            .build()
            .unwrap()
    };
    let inputs = |slow_start: u16| {
        let config = config(slow_start);
        let mut node = Node::new(Params::<f64>::new(&config).unwrap(), &config.neighbours);
        let start = Message::Ctrl { target: Target::All, command: Command::Start, arg: 0, at_tick: 0 };
        node.on_message(&start, 0).unwrap();
        let mut inputs = Vec::new();
        for k in 0..60 {
            let source = NodeId::new(2).unwrap();
            let tick = TickStamp::low(k, 8);
            let state = Message::State { source, component: Component::FIRST, tick, x: 1.0 };
            node.on_message(&state, 0).unwrap();
            while node.poll((u64::from(k) + 1) * u64::from(MS)).is_some() {}
            inputs.push(node.observations()[0].u);
        }
        inputs
    };
    // The first tick: `psi s + b u = nu + b u0`, where `psi s + b u0 = nu`, s = u / (1 + u).
    let first = |b: f64| {
        let solve = |r: f64| {
            let (mut low, mut high) = (0.0, 1e3);
            for _ in 0..200 {
                let u = 0.5 * (low + high);
                if 2.0 * u / (1.0 + u) + b * u < r { low = u } else { high = u }
            }
            low
        };
        solve(1.0 + b * solve(1.0))
    };
    let close = |found: f64, expected: f64| assert!((found - expected).abs() < 1e-6, "{found} {expected}");
    close(inputs(0)[0], first(1.1e-3));
    close(inputs(2)[0], first(1.65e-3 / 8.0));
    // Later both do the same but for how they have begun: 16 slow ticks, 18 damped ones, 14 behind.
    let (usual, slow) = (inputs(0)[59 - 14], inputs(2)[59]);
    assert!((usual - slow).abs() < 1e-4, "{usual} {slow}");
}

#[test]
fn what_has_no_slow_start_refuses_it() {
    let refused = |found| {
        let field = ConfigField::SlowStart;
        ConfigError::OutOfRange { field, index: 0, found, low: 0.0, high: 0.0 }
    };
    let plant = PlantSetup::new([InputRange::new(-1.0, 1.0).unwrap()], 2);
    let found = Params::<f32>::new(&config(3, 1)).unwrap().with_plant(plant.clone());
    assert_eq!(found.err(), Some(refused(3.0)), "a plant has its own time");
    assert!(Params::<f32>::new(&config(0, 1)).unwrap().with_plant(plant).is_ok());
    let tracker = |slow_start| NodeConfig {
        coupling: Coupling::LambdaTracker { eta: 0.1 },
        gain: Gain::Linear { slope: 1.0 },
        ..config(slow_start, 1)
    };
    assert_eq!(Params::<f32>::new(&tracker(3)).err(), Some(refused(3.0)));
    assert!(Params::<f32>::new(&tracker(0)).is_ok());
    let most = LONGEST_SLOW_START;
    assert!(Params::<f32>::new(&config(most, 1)).is_ok());
    assert!(Params::<f32>::new(&config(most + 1, 1)).is_err());
}
