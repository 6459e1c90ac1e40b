//! Vector fields of one's own: three logistic growths with different capacities agree, and follow the
//! emergent dynamics. `cargo run -p funnelnet-law --example own_field`.

use funnelnet_law::VectorField;
use funnelnet_law::emergent::{Agent, field, runge_kutta};
use funnelnet_law::field::midpoint_step;
use funnelnet_law::funnel::{SampledFunnel, Shape};
use funnelnet_law::gain::Reciprocal;
use funnelnet_law::law::node_wise::{Memory, NodeWise, THETA};

/// `f(x) = x (1 - x / capacity)`, state units / s.
struct Logistic {
    capacity: f64,
}

impl VectorField<f64> for Logistic {
    fn at(&self, _half_ticks: u64, x: f64) -> f64 {
        x * (1.0 - x / self.capacity)
    }
}

const TICK: f64 = 0.001;
const GAIN: Reciprocal<f64> = Reciprocal { scale: 1.0 };

fn main() {
    let agents = [1.0, 2.0, 4.0].map(|capacity| Logistic { capacity });
    let funnel = SampledFunnel::<f64>::new(&Shape::Constant { width: 0.01 }.into(), TICK, THETA);
    let law = NodeWise::new(GAIN, TICK, 2.0);
    let (mut x, mut dx, mut carry) = ([0.5; 3], [0.0; 3], [0.0; 3]);
    let (mut memory, mut xi) = ([Memory::default(); 3], 0.5);
    for k in 0..20_000 {
        // On the complete graph nu_i = sum_j x_j - 3 x_i.
        let nu = |v: &[f64; 3], i: usize| v.iter().sum::<f64>() - 3.0 * v[i];
        let u = [0, 1, 2].map(|i| law.step(&mut memory[i], nu(&x, i), nu(&dx, i), funnel.widths(k)).u);
        let before = x;
        for i in 0..3 {
            midpoint_step(&agents[i], TICK, u64::from(k), &mut x[i], &mut carry[i], u[i]);
            dx[i] = x[i] - before[i];
        }
        let h =
            |_, xi| field(&agents.each_ref().map(|a| Agent { psi: 1.0, f: a.at(0, xi), gain: GAIN }), 0.0);
        xi = runge_kutta(0.0, xi, TICK, h);
    }
    println!("agents end at {x:.3?}, the emergent dynamics at {xi:.3}");
    assert!(x.iter().all(|x| (x - xi).abs() < 0.01));
}

#[test]
fn own_fields_follow_the_emergent_dynamics() {
    main();
}
