//! Fields that the program around the simulation computes: the nodes and the reference move by them as they do by
//! the scenario's own, and no configuration of a real node takes them.
#![allow(clippy::unwrap_used, clippy::panic, reason = "test helpers")]

use funnelnet_protocol::config::TickSource;
use funnelnet_sim::configure::{Drive, Unfit, node_configs};
use funnelnet_sim::extremes::largest;
use funnelnet_sim::scenario::{Dynamics, HostField, Hosted, Override};
use funnelnet_sim::{Scenario, Simulation};
use std::path::Path;
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Arc, Mutex};

fn scenario(sets: &[&str]) -> Scenario {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../scenarios/five-agents.toml");
    let sets: Vec<_> = sets.iter().map(|set| Override::parse(set).unwrap()).collect();
    Scenario::load(&path, &sets).unwrap()
}

/// The field of a scenario, computed by the host.
struct Same(Dynamics);

impl HostField for Same {
    fn component(&self, component: usize, t: f64, x: &[f64]) -> f64 {
        self.0.component(component, t, x)
    }
}

fn host(scenario: &Scenario, field: impl Fn(&Dynamics) -> Arc<dyn HostField>) -> Scenario {
    let mut hosted = scenario.clone();
    for node in &mut hosted.nodes {
        node.dynamics = Dynamics::Hosted(Hosted::new(field(&node.dynamics), &node.state, 1.0));
    }
    hosted
}

fn states(scenario: &Scenario) -> Vec<f32> {
    let mut simulation = Simulation::new(scenario).unwrap();
    let mut states = Vec::new();
    while simulation.step().is_some() {
        states.extend((1..=5).map(|id| simulation.node(id)[0].x));
    }
    states
}

fn apart(a: &[f32], b: &[f32]) -> f64 {
    assert_eq!(a.len(), b.len());
    largest(0.0, a.iter().zip(b).map(|(a, b)| f64::from((a - b).abs())))
}

#[test]
fn nodes_move_by_a_hosted_field_as_by_their_own() {
    let own = scenario(&["time.duration=500ms"]);
    let hosted = host(&own, |field| Arc::new(Same(field.clone())));
    let (expected, found) = (states(&own), states(&hosted));
    // Sines of another precision; the motion is the same.
    assert!(apart(&expected, &found) < 1e-4, "{}", apart(&expected, &found));
    struct Still;
    impl HostField for Still {
        fn component(&self, _: usize, _: f64, _: &[f64]) -> f64 {
            0.0
        }
    }
    let still = host(&own, |_| Arc::new(Still));
    assert!(apart(&expected, &states(&still)) > 0.1);
}

#[test]
fn a_real_node_does_not_take_it() {
    let own = scenario(&[]);
    let real = Drive { tick_source: TickSource::Timer, telemetry_every: 0, is_simulated: false };
    assert!(node_configs(&own, real).is_ok());
    let hosted = host(&own, |field| Arc::new(Same(field.clone())));
    let refused = node_configs(&hosted, real).unwrap_err();
    assert_eq!(refused, Unfit::Hosted { node: 1 });
    assert!(
        refused.to_string().contains("node 1: its field is computed by the program around the simulation")
    );
}

#[test]
fn weakly_centralised_coupling_refuses_it() {
    let own = scenario(&[
        "coupling={kind='weakly-centralised',gain={kind='reciprocal',scale=1.0},funnel={kind='constant',width=100.0}}",
        "expect={}",
    ]);
    assert!(Simulation::new(&own).is_ok());
    let hosted = host(&own, |field| Arc::new(Same(field.clone())));
    assert!(Simulation::new(&hosted).is_err());
}

/// What is announced before a tick is what each node asks for first at it, at the announced time.
#[test]
fn what_is_announced_is_asked_for() {
    #[derive(Default)]
    struct Told {
        announced: Mutex<Vec<(f64, Vec<f64>)>>,
        met: AtomicU64,
    }
    struct Listens(Arc<Told>, usize);
    impl HostField for Listens {
        fn component(&self, _: usize, t: f64, x: &[f64]) -> f64 {
            let announced = self.0.announced.lock().unwrap();
            if announced.iter().any(|(at, all)| *at == t && all[self.1] == x[0]) {
                self.0.met.fetch_add(1, Ordering::Relaxed);
            }
            -x[0]
        }
        fn announce(&self, t: f64, x: &[f64]) {
            *self.0.announced.lock().unwrap() = vec![(t, x.to_vec())];
        }
    }
    let own = scenario(&["time.duration=100ms"]);
    let told = Arc::new(Told::default());
    let mut hosted = own.clone();
    for (index, node) in hosted.nodes.iter_mut().enumerate() {
        let field = Arc::new(Listens(Arc::clone(&told), index));
        node.dynamics = Dynamics::Hosted(Hosted::new(field, &node.state, 1.0));
    }
    let _ = states(&hosted);
    // 101 ticks of five nodes; the first is asked for before anything is announced.
    assert_eq!(told.met.load(Ordering::Relaxed), 100 * 5);
}
