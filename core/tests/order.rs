//! Convergence of the sampled law in T, in f64 and with perfect exchange: second order (LAW.md 3).
#![allow(clippy::unwrap_used)]

use funnel_core::field::{AffineSines, midpoint_step};
use funnel_core::funnel::Funnel;
use funnel_core::gain::Reciprocal;
use funnel_core::law::node_wise::{Memory, NodeWise, THETA};
use funnel_protocol::config::{FieldConfig, FunnelConfig, FunnelShape, SineConfig};

const NODES: usize = 5;
const DURATION: f64 = 8.0;
const SAMPLE: f64 = 0.004;

fn field(i: usize, tick: f64) -> AffineSines<f64> {
    let part = |seed: f64| funnel_core::math::sin(seed * (i as f64 + 1.0));
    let sine = |amplitude: f64, frequency, phase| SineConfig {
        component: 0,
        amplitude: amplitude as f32,
        frequency,
        phase,
    };
    let sines = [
        sine(10.0, 1.0, 0.0),
        sine(10.0 * part(1.3), 0.1, part(2.1)),
        sine(10.0 * part(0.7), 10.0, part(3.7)),
    ];
    let slope = (-1.0 + 0.3 * part(5.0)) as f32;
    AffineSines::new(&FieldConfig::scalar(slope, 0.0, sines), tick)
}

/// States every `SAMPLE` seconds on a ring, psi = 2 + 38 exp(-t).
fn run(tick: f64) -> Vec<[f64; NODES]> {
    let config =
        FunnelConfig { factor: 1.0, shape: FunnelShape::Exponential { start: 40.0, end: 2.0, rate: 1.0 } };
    let funnel = Funnel::<f64>::new(&config, tick, THETA);
    let law = NodeWise::new(Reciprocal { scale: 1.0 }, tick, 2.0);
    let fields: Vec<_> = (0..NODES).map(|i| field(i, tick)).collect();
    let (mut x, mut carry, mut dx) = ([3.0, -2.0, 5.0, 0.0, -4.0], [0.0; NODES], [0.0; NODES]);
    let mut memory = [Memory::default(); NODES];
    let stride = (SAMPLE / tick).round() as u32;
    let mut samples = Vec::new();
    for k in 0..(DURATION / tick).round() as u32 {
        if k.is_multiple_of(stride) {
            samples.push(x);
        }
        let (now, change) = (x, dx);
        let difference =
            |v: &[f64; NODES], i: usize| v[(i + 1) % NODES] + v[(i + NODES - 1) % NODES] - 2.0 * v[i];
        for i in 0..NODES {
            let (nu, dnu) = (difference(&now, i), difference(&change, i));
            let u = law.step(&mut memory[i], nu, dnu, funnel.widths(k)).u;
            midpoint_step(&fields[i], tick, k, &mut x[i], &mut carry[i], u);
            dx[i] = x[i] - now[i];
        }
    }
    samples
}

fn error(a: &[[f64; NODES]], b: &[[f64; NODES]]) -> f64 {
    assert_eq!(a.len(), b.len());
    a.iter().zip(b).flat_map(|(a, b)| a.iter().zip(b).map(|(a, b)| (a - b).abs())).fold(0.0, f64::max)
}

#[test]
fn halving_the_tick_quarters_the_error() {
    let exact = run(0.000_062_5);
    let errors = [0.004, 0.002, 0.001].map(|tick| error(&run(tick), &exact));
    println!("errors at 4, 2, 1 ms: {errors:?}");
    assert!(errors[0] / errors[1] >= 3.5 && errors[1] / errors[2] >= 3.5, "{errors:?}");
    assert!(errors[2] > 1e-7, "an error this small says that nothing was compared: {errors:?}");
}
