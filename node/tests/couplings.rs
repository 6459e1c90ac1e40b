//! Couplings, vector states, breach policies and announced weights, on nodes that hear each other in memory.
#![allow(clippy::unwrap_used, clippy::panic, reason = "helpers of tests, which clippy does not know as such")]

use funnelnet_law::VectorField;
use funnelnet_law::gain::{Gain, GainFunction, Reciprocal};
use funnelnet_law::law::max_gain::{self, Term};
use funnelnet_law::law::node_wise::{Memory, NodeWise};
use funnelnet_node::{Action, Event, Node, Params, Phase};
use funnelnet_protocol::config::{
    Breach, ConfigError, ConfigField, Coupling, EdgeConfig, Field, NodeConfig, Shape, Sine, TickSource,
    scalar,
};
use funnelnet_protocol::message::{Command, FaultCode, Message, NodeId, Target, TickStamp};
use proptest::prelude::*;

const TICK_NS: u32 = 1_000_000;

/// A node of a ring of `n`, at rest in a constant funnel.
fn config(id: usize, n: usize, state: &[f32]) -> NodeConfig {
    let around = if n > 2 { vec![id + 1, id + n - 1] } else { vec![id + 1] };
    // A weight that both ends compute alike.
    let neighbours = around.iter().map(|&j| {
        let other = j % n;
        EdgeConfig { id: other as u8 + 1, weight: 0.5 + ((id + other) % 3) as f32, edges: around.len() as u8 }
    });
    NodeConfig::builder(id as u8 + 1, TICK_NS)
        .tick_source(TickSource::Sync)
        .state(state.iter().copied())
        .state_limit(1e6)
        .funnel(Shape::Constant { width: 20.0 })
        .edges(neighbours)
        .extrapolate_ticks(3)
        .build()
        .unwrap()
}

/// Nodes that hear all of each other's frames at once.
struct Net {
    nodes: Vec<Node>,
    tick: u32,
    events: Vec<(u8, Event)>,
    frames: Vec<Message>,
}

impl Net {
    fn start(configs: &[NodeConfig]) -> Self {
        let node = |config: &NodeConfig| Node::new(Params::new(config).unwrap(), &config.neighbours);
        let nodes = configs.iter().map(node).collect();
        let mut net = Self { nodes, tick: 0, events: Vec::new(), frames: Vec::new() };
        net.tell(Message::Ctrl { target: Target::All, command: Command::Start, arg: 0, at_tick: 0 });
        net
    }

    fn tell(&mut self, message: Message) {
        for node in &mut self.nodes {
            // A node that has stopped refuses, as it should.
            let _ = node.on_message(&message, 0);
        }
        let mut frames = Vec::new();
        for node in &mut self.nodes {
            while let Some(action) = node.poll(0) {
                match action {
                    Action::Send(message) => frames.push(message),
                    Action::Report(event) => self.events.push((node.id().get(), event)),
                    Action::Safe | Action::Sample | Action::Actuate => {}
                }
            }
        }
        for frame in &frames {
            for node in self.nodes.iter_mut().filter(|node| node.id() != source(frame)) {
                let _ = node.on_message(frame, 0);
            }
        }
        self.frames.extend(frames);
    }

    fn run(&mut self, ticks: u32) {
        for _ in 0..ticks {
            let previous_tick = TickStamp::low(self.tick.wrapping_sub(1), 24);
            self.tell(Message::Sync { source: None, previous_tick, phase_us: 0 });
            self.tick += 1;
        }
    }

    fn states(&self) -> Vec<Vec<f32>> {
        self.nodes.iter().map(|node| node.state().collect()).collect()
    }
}

fn source(message: &Message) -> NodeId {
    match *message {
        Message::State { source, .. } | Message::Fault { source, .. } | Message::Edge { source, .. } => {
            source
        }
        _ => panic!("no node says {message:?}"),
    }
}

fn ring(states: &[&[f32]], change: impl Fn(usize, &mut NodeConfig)) -> Vec<NodeConfig> {
    let one = |(id, state): (usize, &&[f32])| {
        let mut config = config(id, states.len(), state);
        change(id, &mut config);
        config
    };
    states.iter().enumerate().map(one).collect()
}

#[test]
fn element_wise_components_are_scalar_networks_of_their_own() {
    let both = ring(&[&[1.0, -3.0], &[2.0, 5.0], &[-4.0, 0.5]], |_, _| {});
    let mut vector = Net::start(&both);
    vector.run(500);
    for component in 0..2 {
        let one = ring(&[&[1.0, -3.0], &[2.0, 5.0], &[-4.0, 0.5]], |_, config| {
            config.initial_state = scalar(config.initial_state[component]);
            config.field = Field::scalar(0.0, 0.0, []);
        });
        let mut alone = Net::start(&one);
        alone.run(500);
        // Bit for bit: the floor, which takes the largest component, is far away here.
        let of_vector: Vec<_> = vector.states().iter().map(|state| state[component]).collect();
        assert_eq!(of_vector, alone.states().concat());
    }
}

#[test]
fn a_matrix_and_sines_of_one_component_enter_where_they_belong() {
    // x' = y, y' = -x + 0.1 sin(0): a rotation by one radian in a second.
    let mut config = config(0, 2, &[1.0, 0.0]);
    config.neighbours.clear();
    config.coupling = Coupling::None;
    config.field.slope = [0.0, 1.0, -1.0, 0.0].into_iter().collect();
    config.field.sines.push(Sine { component: 1, amplitude: 0.1, frequency: 0.0, phase: 0.0 }).unwrap();
    let mut net = Net::start(&[config]);
    net.run(1000);
    let [x, y] = net.states()[0][..] else { panic!() };
    let (cos, sin) = (funnelnet_law::math::cos(1.0) as f32, funnelnet_law::math::sin(1.0) as f32);
    assert!((x - cos).abs() < 1e-5 && (y + sin).abs() < 1e-5, "{x} {y}");
}

proptest! {
    #[test]
    fn maximum_gain_is_the_papers_law_at_the_end_of_the_step(
        nu in proptest::collection::vec(-30.0f64..30.0, 1..8), u in proptest::collection::vec(-5.0f64..5.0, 8),
        psi in 0.01f64..50.0, scale in 0.1f64..10.0,
    ) {
        // psi s + b u = r with u = gamma(|s|_inf) s.
        let law = NodeWise::new(Reciprocal { scale }, 1e-3, 2.0);
        let b = 0.5 * 2.2 * 1e-3 * 2.0;
        let term = |(&nu, &u): (&f64, &f64)| {
            let mut memory = Memory::default();
            memory.feed_back(u);
            Term { nu, dnu: 0.1 * nu, u: 0.0, memory }
        };
        let mut terms: Vec<_> = nu.iter().zip(&u).map(term).collect();
        max_gain::step(&law, &mut terms, funnelnet_law::funnel::Widths { now: psi, ahead: psi });
        let longest = terms.iter().fold(0.0f64, |most, term| most.max(term.u.abs()));
        let s = law.gain.inverse(longest);
        for (term, (&nu, &last)) in terms.iter().zip(nu.iter().zip(&u)) {
            let r = 1.05 * nu + b * last;
            let left = psi * s * term.u / longest + b * term.u;
            prop_assert!((left - r).abs() < 1e-12 * (1.0 + r.abs()), "{left} {r}");
        }
    }
}

#[test]
fn maximum_gain_of_one_component_is_the_node_wise_law() {
    let states: [&[f32]; 4] = [&[1.0], &[2.0], &[-4.0], &[7.0]];
    let mut node_wise = Net::start(&ring(&states, |_, _| {}));
    let mut max_gain = Net::start(&ring(&states, |_, config| config.coupling = Coupling::MaxGain));
    node_wise.run(2000);
    max_gain.run(2000);
    for (a, b) in node_wise.states().concat().iter().zip(max_gain.states().concat()) {
        assert!((a - b).abs() < 2e-6, "{a} {b}");
    }
}

#[test]
fn edge_wise_inputs_cancel_so_the_mean_stays_and_all_agree_on_it() {
    let states: [&[f32]; 4] = [&[1.0], &[2.0], &[-4.0], &[7.5]];
    let mut net = Net::start(&ring(&states, |_, config| config.coupling = Coupling::EdgeWise));
    net.run(20_000);
    let states = net.states().concat();
    // Each tick rounds a state once, and compensation carries that on: after 20,000 ticks the mean has moved
    // by no more than a few ulp.
    let mean: f64 = states.iter().map(|&x| f64::from(x)).sum::<f64>() / 4.0;
    assert!((mean - 1.625).abs() < 2e-6, "{mean}");
    assert!(states.iter().all(|x| (x - 1.625).abs() < 0.1), "{states:?}");
}

#[test]
fn edge_wise_inputs_of_the_two_ends_are_opposite_bit_for_bit() {
    let mut net = Net::start(&ring(&[&[3.1], &[-4.7]], |_, config| config.coupling = Coupling::EdgeWise));
    for _ in 0..500 {
        net.run(1);
        let inputs: Vec<_> = net.nodes.iter().map(|node| node.observations()[0].u).collect();
        assert_eq!(inputs[0].to_bits(), (-inputs[1]).to_bits());
    }
    assert!(net.nodes[0].observations()[0].u != 0.0);
}

#[test]
fn edge_wise_inputs_cancel_where_the_resolution_floors_the_funnel() {
    // States of different sizes, so that each end has another neighbour of another size.
    let states: [&[f32]; 5] = [&[1000.0], &[1.0], &[-3.0], &[5.0], &[2000.0]];
    let mut net = Net::start(&ring(&states, |_, config| {
        config.coupling = Coupling::EdgeWise;
        config.funnel.shape = Shape::Constant { width: 1e-9 };
    }));
    net.run(1);
    let sum: f64 = net.nodes.iter().map(|node| f64::from(node.observations()[0].u)).sum();
    let largest = net.nodes.iter().map(|node| node.observations()[0].u.abs()).fold(0.0, f32::max);
    assert_eq!(net.nodes[1].counters().floored, 1);
    assert!(sum.abs() < 1e-6 * f64::from(largest), "{sum} beside {largest}");
}

#[test]
fn a_linear_gain_pulls_with_its_slope_and_a_tracker_with_a_growing_one() {
    let linear = Gain::Linear { slope: 3.0 };
    let mut net = Net::start(&ring(&[&[0.0], &[0.01]], |_, config| config.gain = linear));
    net.run(1);
    // nu = 0.01 times the weight 1.5; k nu, but for (b k)^2: the first step is implicit too, and b = theta c
    // T d.
    let implicit = 1.0 + 1.1 * 1e-3 * 1.5 * 3.0;
    let expected = |nu: f32| 3.0 * nu * (2.0 * implicit - 1.0) / (implicit * implicit);
    let u = net.nodes[0].observations()[0].u;
    assert!((u - expected(0.015)).abs() < 1e-7 && (u - 0.045).abs() < 2e-6, "{u}");
    let tracker = |_: usize, config: &mut NodeConfig| {
        (config.coupling, config.gain) = (Coupling::LambdaTracker { eta: 0.5 }, linear);
    };
    let mut net = Net::start(&ring(&[&[0.0], &[10.0]], tracker));
    net.run(3000);
    let states = net.states().concat();
    // Its gain has grown: with the slope alone exp(-2 * 1.5 * 3 * 3 s) would not be left of the distance.
    assert!((states[1] - states[0]).abs() < 1e-3, "{states:?}");
    let mut quiet = Net::start(&ring(&[&[0.0], &[0.2]], tracker));
    quiet.run(1);
    // Inside the dead zone the gain stays as it is.
    assert!((quiet.nodes[0].observations()[0].u - expected(0.3)).abs() < 1e-6);
}

#[test]
fn the_first_tick_of_a_steep_gain_throws_no_state_away() {
    let (reciprocal, linear) = (Gain::Reciprocal { scale: 1e6 }, Gain::Linear { slope: 1e9 });
    for (coupling, gain) in [
        (Coupling::NodeWise, reciprocal),
        (Coupling::NodeWise, linear),
        (Coupling::MaxGain, reciprocal),
        (Coupling::EdgeWise, reciprocal),
        (Coupling::LambdaTracker { eta: 0.1 }, linear),
    ] {
        let states: [&[f32]; 4] = [&[1.0], &[-2.0], &[0.5], &[4.0]];
        let mut net =
            Net::start(&ring(&states, |_, config| (config.coupling, config.gain) = (coupling, gain)));
        net.run(2);
        // One beyond its limit would have stopped, and kept its state.
        assert!(net.nodes.iter().all(|node| node.phase() == Phase::Running), "{coupling:?}");
        let worst = net.states().concat().into_iter().fold(0.0, |worst: f32, x| worst.max(x.abs()));
        // An explicit step would move states by T mu(nu / psi), 1e3 and more.
        assert!(worst < 10.0, "{coupling:?}: {worst}");
    }
}

#[test]
fn without_coupling_nodes_hear_and_do_nothing() {
    let mut net = Net::start(&ring(&[&[0.0], &[5.0]], |_, config| config.coupling = Coupling::None));
    net.run(10);
    assert_eq!(net.states().concat(), [0.0, 5.0]);
    assert_eq!(net.nodes[0].observations()[0].nu, 7.5);
}

/// Two nodes that start outside their funnel.
fn outside(policy: Breach<f32>) -> Net {
    Net::start(&ring(&[&[0.0], &[20.0]], |_, config| config.on_breach = policy))
}

#[test]
fn reopen_widens_the_funnel_to_its_margin_and_lets_that_decay() {
    let mut net = outside(Breach::Reopen { margin: 2.0, rate: 1.0 });
    net.run(1);
    // nu = 30 in a funnel of 20 becomes one of 60 at ratio 1/2, where mu = 1.
    let seen = net.nodes[0].observations()[0];
    assert!(seen.ratio == 1.5 && (seen.u - 1.0).abs() < 1e-2, "{seen:?}");
    assert!(net.events.contains(&(1, Event::FunnelReopened { tick: 0, width: 60.0 })));
    net.run(999);
    let psi = net.nodes[0].observations()[0].psi;
    let expected = 20.0 + 40.0 * funnelnet_law::math::exp(-0.999) as f32;
    assert!((psi - expected).abs() < 1e-2, "{psi} {expected}");
    assert_eq!(net.nodes[0].counters().breaches, 1);
    assert_eq!(net.nodes[0].counters().reopened, 1);
}

#[test]
fn stop_gives_no_input_and_a_fault() {
    let mut net = outside(Breach::Stop);
    net.run(3);
    assert_eq!(net.states().concat(), [0.0, 20.0]);
    assert_eq!(net.nodes[0].phase(), Phase::Faulted(FaultCode::FUNNEL_LEFT));
    let faults = net
        .frames
        .iter()
        .filter(|frame| matches!(frame, Message::Fault { code: FaultCode::FUNNEL_LEFT, .. }));
    assert_eq!(faults.count(), 2);
    assert_eq!(net.nodes[0].observations()[0].u, 0.0);
}

#[test]
fn weights_are_announced_once_and_a_different_one_is_named() {
    let mut net = Net::start(&ring(&[&[0.0], &[1.0], &[2.0]], |_, _| {}));
    net.run(10);
    let told = net.frames.iter().filter(|frame| matches!(frame, Message::Edge { .. })).count();
    assert_eq!((told, net.nodes[0].counters().weights_differ), (6, 0));
    let mut net = Net::start(&ring(&[&[0.0], &[1.0], &[2.0]], |id, config| {
        if id == 1 {
            config.neighbours[0].weight = 9.0;
        }
    }));
    net.run(10);
    let named = |node: u8| Event::WeightsDiffer { node: NodeId::new(node).unwrap(), own: 9.0, theirs: 0.5 };
    assert!(net.events.contains(&(2, named(3))), "{:?}", net.events);
    assert_eq!(net.nodes.iter().map(|node| node.counters().weights_differ).sum::<u32>(), 2);
}

#[test]
fn what_does_not_fit_together_is_refused_by_name() {
    let refused = |change: fn(&mut NodeConfig)| {
        let mut config = config(0, 3, &[1.0, 2.0]);
        change(&mut config);
        Params::<f32>::new(&config).map(drop).unwrap_err()
    };
    let field = |error| match error {
        ConfigError::OutOfRange { field, .. } => field,
        other => panic!("{other}"),
    };
    assert_eq!(field(refused(|c| c.initial_state.clear())), ConfigField::Components);
    assert_eq!(field(refused(|c| c.field.slope = [1.0; 3].into_iter().collect())), ConfigField::Matrix);
    assert_eq!(field(refused(|c| c.field.offset = scalar(1.0))), ConfigField::Offsets);
    assert_eq!(
        field(refused(|c| {
            let sine = Sine { component: 2, amplitude: 1.0, frequency: 1.0, phase: 0.0 };
            c.field.sines.push(sine).unwrap();
        })),
        ConfigField::SineComponent
    );
    let crowd = |c: &mut NodeConfig| {
        c.neighbours = (2..66).map(|id| EdgeConfig { id, weight: 1.0, edges: 1 }).collect();
    };
    assert_eq!(field(refused(crowd)), ConfigField::Entries);
    let steep = |c: &mut NodeConfig| c.gain = Gain::Median { eta: 1e9, eps: 0.9 };
    assert_eq!(field(refused(steep)), ConfigField::GainScale);
    assert_eq!(refused(|c| c.coupling = Coupling::LambdaTracker { eta: 1.0 }), ConfigError::GainOfCoupling);
    assert_eq!(
        refused(|c| {
            c.coupling = Coupling::EdgeWise;
            c.on_breach = Breach::Reopen { margin: 2.0, rate: 1.0 };
        }),
        ConfigError::PolicyOfCoupling
    );
}

#[test]
fn a_users_scalar_field_serves_every_component() {
    struct Decay;
    impl VectorField<f32> for Decay {
        fn at(&self, _: u64, x: f32) -> f32 {
            -x
        }
    }
    let gain = Gain::Reciprocal { scale: 1.0 };
    let config = NodeConfig { neighbours: heapless::Vec::new(), ..config(0, 3, &[1.0, -2.0]) };
    let params = Params::with_field_and_gain(&config, |_| Ok(Decay), gain).unwrap();
    let mut node = Node::new(params, &config.neighbours);
    node.on_message(&Message::Ctrl { target: Target::All, command: Command::Start, arg: 0, at_tick: 0 }, 0)
        .unwrap();
    while node.poll(0).is_some() {}
    for k in 0..1000u32 {
        let previous_tick = TickStamp::low(k.wrapping_sub(1), 24);
        node.on_message(&Message::Sync { source: None, previous_tick, phase_us: 0 }, 0).unwrap();
        while node.poll(0).is_some() {}
    }
    let state: Vec<_> = node.state().collect();
    let decayed = funnelnet_law::math::exp(-1.0) as f32;
    assert!((state[0] - decayed).abs() < 1e-6 && (state[1] + 2.0 * decayed).abs() < 2e-6, "{state:?}");
}
