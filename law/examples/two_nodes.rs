//! Two agents that drift apart at 2 state units / s stay inside their funnel:
//! `cargo run -p funnelnet-law --example two_nodes`.

use funnelnet_law::funnel::{SampledFunnel, Shape};
use funnelnet_law::gain::Reciprocal;
use funnelnet_law::law::node_wise::{Memory, NodeWise, THETA};

/// Tick period, s.
const TICK: f64 = 0.001;
/// The agents' own fields, state units / s.
const DRIFT: [f64; 2] = [1.0, -1.0];

fn main() {
    let shape = Shape::Exponential { start: 4.0, end: 0.02, rate: 1.0 };
    let funnel = SampledFunnel::<f64>::new(&shape.into(), TICK, THETA);
    let law = NodeWise::new(Reciprocal { scale: 1.0 }, TICK, 1.0);
    let (mut x, mut dx, mut memory) = ([3.0, 0.0], [0.0; 2], [Memory::default(); 2]);
    let mut worst = 0.0_f64;
    for k in 0..10_000 {
        let psi = funnel.widths(k);
        let u = [0, 1].map(|i| law.step(&mut memory[i], x[1 - i] - x[i], dx[1 - i] - dx[i], psi).u);
        worst = worst.max((x[1] - x[0]).abs() / psi.now);
        for i in 0..2 {
            dx[i] = TICK * (DRIFT[i] + u[i]);
            x[i] += dx[i];
        }
    }
    let apart = (x[1] - x[0]).abs();
    println!("after 10 s {apart:.4} apart; largest |nu| / psi {worst:.3}");
    assert!(apart < 0.02, "left the funnel at the end: {apart}");
    assert!(worst < 1.0, "left the funnel on the way: {worst}");
}

#[test]
fn two_nodes_stay_inside_their_funnel() {
    main();
}
