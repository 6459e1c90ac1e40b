//! The emergent vector field: bounds (paper, eq. (hminmax)), residual, and the exact cases.
#![allow(clippy::unwrap_used)]

use funnel_core::emergent::{Agent, field, runge_kutta};
use funnel_core::gain::{BuiltinGain, Gain, Logarithmic, Reciprocal};
use proptest::prelude::*;

fn agent() -> impl Strategy<Value = Agent<f64, BuiltinGain<f64>>> {
    (0.001f64..1000.0, -100.0f64..100.0, 0.01f64..100.0, any::<bool>()).prop_map(
        |(psi, f, scale, reciprocal)| Agent {
            psi,
            f,
            gain: match reciprocal {
                true => BuiltinGain::Reciprocal(Reciprocal { scale }),
                false => BuiltinGain::Logarithmic(Logarithmic { scale }),
            },
        },
    )
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(2000))]
    #[test]
    fn h_is_the_root_and_lies_between_the_fields(
        agents in proptest::collection::vec(agent(), 1..50), guess in -200.0f64..200.0,
    ) {
        let h = field(&agents, guess);
        let total: f64 = agents.iter().map(|a| a.psi).sum();
        let residual: f64 = agents.iter().map(|a| a.psi * a.gain.inverse(h - a.f)).sum();
        let low = agents.iter().map(|a| a.f).fold(f64::INFINITY, f64::min);
        let high = agents.iter().map(|a| a.f).fold(f64::NEG_INFINITY, f64::max);
        prop_assert!(h >= low && h <= high);
        // H is steepest where all agents sit: its rounding is that of h times its slope.
        let slope: f64 = agents.iter().map(|a| a.psi * a.gain.inverse_slope(h - a.f)).sum();
        prop_assert!(residual.abs() <= 1e-13 * total + 1e-14 * slope * h.abs().max(1.0), "{residual:e} of {total:e}");
    }
}

#[test]
fn two_equal_agents_meet_in_the_middle() {
    let gain = Reciprocal { scale: 1.0 };
    let agents = [Agent { psi: 2.0, f: -3.0, gain }, Agent { psi: 2.0, f: 7.0, gain }];
    assert!((field(&agents, 100.0) - 2.0_f64).abs() < 1e-14);
    assert_eq!(field::<f64, Reciprocal<f64>>(&[], 1.0), 0.0);
}

#[test]
fn a_wide_funnel_leads() {
    // Paper, Section "Electing a leader": h tends to the field of the agent with by far the largest funnel.
    let gain = Reciprocal { scale: 1.0 };
    let agents = [Agent { psi: 1e6, f: -3.0, gain }, Agent { psi: 1.0, f: 7.0, gain }];
    assert!((field(&agents, 0.0) + 3.0_f64).abs() < 1e-5);
}

#[test]
fn runge_kutta_is_of_fourth_order() {
    let solve = |steps: u32| {
        let step = 1.0 / f64::from(steps);
        (0..steps).fold(1.0, |x, k| runge_kutta(f64::from(k) * step, x, step, |t, x| -x + t))
    };
    let exact = 2.0 * funnel_core::math::exp(-1.0);
    let ratio = (solve(10) - exact).abs() / (solve(20) - exact).abs();
    assert!(ratio > 14.0 && ratio < 18.0, "{ratio}");
}
