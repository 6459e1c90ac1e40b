//! Convergence of the sampled laws to the continuous ones in T, in f64 and with perfect exchange: second
//! order (law.md 3).
//!
//! What they converge to is the paper's formula, `u = mu(nu / psi)`, integrated by Runge-Kutta with a step so
//! small that it is stable.
#![allow(clippy::unwrap_used)]

use funnelnet_law::VectorField;
use funnelnet_law::field::{AffineSines, midpoint_step};
use funnelnet_law::field::{Field, Sine};
use funnelnet_law::funnel::SampledFunnel;
use funnelnet_law::funnel::{Funnel, Shape};
use funnelnet_law::gain::{GainFunction, Reciprocal};
use funnelnet_law::law::edge_wise::{EdgeTerm, EdgeWise};
use funnelnet_law::law::node_wise::{Constants, Memory, NodeWise, THETA};

const NODES: usize = 5;
const DURATION: f64 = 8.0;
const SAMPLE: f64 = 0.004;
const GAIN: Reciprocal<f64> = Reciprocal { scale: 1.0 };
const START: [f64; NODES] = [3.0, -2.0, 5.0, 0.0, -4.0];

#[derive(Clone, Copy, Debug)]
enum Coupling {
    NodeWise,
    EdgeWise,
}

fn field(i: usize, tick: f64) -> AffineSines<f64> {
    let part = |seed: f64| funnelnet_law::math::sin(seed * (i as f64 + 1.0));
    let sine = |amplitude: f64, frequency, phase| Sine {
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
    AffineSines::new(&Field::scalar(slope, 0.0, sines), tick)
}

/// psi = 2 + 38 exp(-t), prepared for a tick.
fn funnel(tick: f64) -> SampledFunnel<f64> {
    let shape = Shape::Exponential { start: 40.0, end: 2.0, rate: 1.0 };
    SampledFunnel::new(&Funnel { factor: 1.0, shape }, tick, THETA)
}

/// The neighbours on the ring.
fn around(i: usize) -> [usize; 2] {
    [(i + 1) % NODES, (i + NODES - 1) % NODES]
}

/// States every `SAMPLE` seconds on a ring, by the sampled law.
fn sampled(coupling: Coupling, tick: f64) -> Vec<[f64; NODES]> {
    let funnel = funnel(tick);
    let (node_wise, edge_wise) = (NodeWise::new(GAIN, tick, 2.0), EdgeWise::new(tick, Constants::default()));
    let fields: Vec<_> = (0..NODES).map(|i| field(i, tick)).collect();
    let (mut x, mut carry, mut dx) = (START, [0.0; NODES], [0.0; NODES]);
    let mut memory = [Memory::default(); NODES];
    let mut ends = [[Memory::default(); 2]; NODES];
    let stride = (SAMPLE / tick).round() as u32;
    let mut samples = Vec::new();
    for k in 0..(DURATION / tick).round() as u32 {
        if k.is_multiple_of(stride) {
            samples.push(x);
        }
        let (now, change) = (x, dx);
        for i in 0..NODES {
            let difference = |v: &[f64; NODES], j: usize| v[j] - v[i];
            let u = match coupling {
                Coupling::NodeWise => {
                    let sum = |v| around(i).iter().map(|&j| difference(v, j)).sum::<f64>();
                    node_wise.step(&mut memory[i], sum(&now), sum(&change), funnel.widths(k)).u
                }
                Coupling::EdgeWise => {
                    let edge = |(&j, memory): (&usize, &mut Memory<f64>)| {
                        let (nu, dnu) = (difference(&now, j), difference(&change, j));
                        let term = EdgeTerm { nu, dnu, stiffness: 4.0 };
                        edge_wise.step(&GAIN, memory, &term, funnel.widths(k))
                    };
                    around(i).iter().zip(&mut ends[i]).map(edge).sum()
                }
            };
            midpoint_step(&fields[i], tick, u64::from(k), &mut x[i], &mut carry[i], u);
            dx[i] = x[i] - now[i];
        }
    }
    samples
}

/// The same by the continuous law and Runge-Kutta steps of a sixteenth of a millisecond.
fn continuous(coupling: Coupling) -> Vec<[f64; NODES]> {
    let step = 0.000_062_5;
    // Half steps are the ticks of a field and of a funnel for half the step.
    let fields: Vec<_> = (0..NODES).map(|i| field(i, step)).collect();
    let funnel = funnel(step / 2.0);
    let rate = |half_steps: u32, x: &[f64; NODES]| -> [f64; NODES] {
        let psi = funnel.widths(half_steps).now;
        std::array::from_fn(|i| {
            let terms = around(i).map(|j| x[j] - x[i]);
            let u = match coupling {
                Coupling::NodeWise => GAIN.apply((terms[0] + terms[1]) / psi),
                Coupling::EdgeWise => GAIN.apply(terms[0] / psi) + GAIN.apply(terms[1] / psi),
            };
            fields[i].at(u64::from(half_steps), x[i]) + u
        })
    };
    let along = |x: &[f64; NODES], k: &[f64; NODES], h: f64| -> [f64; NODES] {
        std::array::from_fn(|i| x[i] + h * k[i])
    };
    let mut x = START;
    let mut samples = Vec::new();
    let stride = (SAMPLE / step).round() as u32;
    for n in 0..(DURATION / step).round() as u32 {
        if n.is_multiple_of(stride) {
            samples.push(x);
        }
        let k1 = rate(2 * n, &x);
        let k2 = rate(2 * n + 1, &along(&x, &k1, step / 2.0));
        let k3 = rate(2 * n + 1, &along(&x, &k2, step / 2.0));
        let k4 = rate(2 * n + 2, &along(&x, &k3, step));
        x = std::array::from_fn(|i| x[i] + step / 6.0 * (k1[i] + 2.0 * (k2[i] + k3[i]) + k4[i]));
    }
    samples
}

fn error(a: &[[f64; NODES]], b: &[[f64; NODES]]) -> f64 {
    assert_eq!(a.len(), b.len());
    a.iter().zip(b).flat_map(|(a, b)| a.iter().zip(b).map(|(a, b)| (a - b).abs())).fold(0.0, f64::max)
}

fn assert_second_order(coupling: Coupling) {
    let exact = continuous(coupling);
    let errors = [0.004, 0.002, 0.001].map(|tick| error(&sampled(coupling, tick), &exact));
    println!("{coupling:?}, errors at 4, 2, 1 ms: {errors:?}");
    assert!(errors[0] / errors[1] >= 3.5 && errors[1] / errors[2] >= 3.5, "{errors:?}");
    assert!(errors[2] > 1e-7, "an error this small says that nothing was compared: {errors:?}");
}

#[test]
fn halving_the_tick_quarters_the_error() {
    assert_second_order(Coupling::NodeWise);
}

#[test]
fn edge_by_edge_too() {
    assert_second_order(Coupling::EdgeWise);
}
