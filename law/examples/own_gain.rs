//! A gain of one's own, checked against Assumption 3 and run:
//! `cargo run -p funnelnet-law --example own_gain`.

use funnelnet_law::GainFunction;
use funnelnet_law::funnel::Widths;
use funnelnet_law::gain::{Violation, check};
use funnelnet_law::law::node_wise::{Memory, NodeWise};

/// `mu(s) = 2 artanh(s) = ln((1 + s) / (1 - s))`, state units / s; its inverse is `tanh(u / 2)`.
struct Artanh;

impl GainFunction<f64> for Artanh {
    fn inverse(&self, u: f64) -> f64 {
        let grown = funnelnet_law::math::exp_m1(-u.abs());
        (-grown / (2.0 + grown)).copysign(u)
    }

    fn inverse_slope(&self, u: f64) -> f64 {
        let e = funnelnet_law::math::exp(-u.abs());
        2.0 * e / ((1.0 + e) * (1.0 + e))
    }

    fn apply(&self, s: f64) -> f64 {
        let size = s.abs();
        let ln_1p = funnelnet_law::math::ln_1p;
        (ln_1p(size) - ln_1p(-size)).copysign(s)
    }
}

fn main() -> Result<(), Violation<f64>> {
    let found = check(&Artanh)?;
    println!("a gain: gamma(0) = {}, residual of (*) at most {:.1e}", found.lowest, found.residual);
    assert_eq!(found.lowest, 2.0);
    let law = NodeWise::new(Artanh, 0.01, 2.0);
    let widths = Widths { now: 1.0, ahead: 1.0 };
    let solution = law.step(&mut Memory::default(), 0.9, 0.0, widths);
    println!("nu = 0.9 in a funnel of 1: u = {:.3}, aiming at a ratio of {:.3}", solution.u, solution.s);
    assert!((solution.u - Artanh.apply(solution.s)).abs() < 1e-9);
    Ok(())
}

#[test]
fn an_own_gain_passes_and_runs() -> Result<(), Violation<f64>> {
    main()
}
