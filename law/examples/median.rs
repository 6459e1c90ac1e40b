//! Five agents find the median of their values, whatever the outliers say:
//! `cargo run -p funnelnet-law --example median`.

use funnelnet_law::funnel::{SampledFunnel, Shape};
use funnelnet_law::gain::Median;
use funnelnet_law::law::node_wise::{Memory, NodeWise, THETA};

/// Tick period, s.
const TICK: f64 = 0.01;
/// What each agent holds: median 1.2, mean 180.92.
const VALUES: [f64; 5] = [1.1, 1.2, -100.0, 1.3, 1001.0];
/// How far the result may be from the median, state units / s.
const ETA: f64 = 0.02;

fn main() {
    // (27), beta_bound: eps < 2 / (N + 1) for equal funnels.
    let gain = Median { eta: ETA, eps: 0.3 }.reciprocal();
    let law = NodeWise::new(gain, TICK, 2.0);
    let shape = Shape::Exponential { start: 20.0, end: 0.0, rate: 0.5 };
    let funnel = SampledFunnel::<f64>::new(&shape.into(), TICK, THETA);
    let (mut x, mut dx, mut memory) = ([0.0; 5], [0.0; 5], [Memory::default(); 5]);
    for k in 0..4000 {
        let nu = |v: &[f64; 5], i: usize| v[(i + 1) % 5] + v[(i + 4) % 5] - 2.0 * v[i];
        let step = |i: usize| law.step(&mut memory[i], nu(&x, i), nu(&dx, i), funnel.widths(k)).u;
        let u: Vec<f64> = (0..5).map(step).collect();
        for i in 0..5 {
            // (28), dms, in an Euler step.
            dx[i] = TICK * (VALUES[i] - x[i] + u[i]);
            x[i] += dx[i];
        }
    }
    println!("after 40 s all are at {x:.4?}; the median of {VALUES:?} is 1.2");
    assert!(x.iter().all(|x| (x - 1.2).abs() < ETA), "{x:?}");
}

#[test]
fn the_median_is_found_among_outliers() {
    main();
}
