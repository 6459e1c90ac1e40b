//! The emergent vector field: bounds (paper, (20), hminmax), residual, partial derivatives, and cases with a
//! known root.
#![allow(clippy::unwrap_used)]

use funnelnet_law::emergent::{Agent, contraction, field, partial_by_time, partials_by_field, runge_kutta};
use funnelnet_law::gain::{Gain, GainFunction, Logarithmic, Reciprocal};
use proptest::prelude::*;

type AnyAgent = Agent<f64, Gain<f64>>;

fn agent() -> impl Strategy<Value = AnyAgent> {
    (0.001f64..1000.0, -100.0f64..100.0, 0.01f64..100.0, 0u8..4).prop_map(|(psi, f, scale, kind)| Agent {
        psi,
        f,
        gain: match kind {
            0 => Gain::Reciprocal { scale },
            1 => Gain::Logarithmic { scale },
            2 => Gain::LocallyLinear { bound: scale },
            _ => Gain::Linear { slope: scale },
        },
    })
}

/// A smooth network: no gain far steeper than the fields are apart, so that finite differences have digits.
fn smooth_agents() -> impl Strategy<Value = Vec<AnyAgent>> {
    let smooth = agent().prop_map(|agent| {
        let scale = 0.5 + agent.psi.min(5.0);
        let gain = agent.gain.map(|_| scale);
        Agent { psi: 0.1 + agent.psi / 100.0, f: agent.f / 10.0, gain }
    });
    proptest::collection::vec(smooth, 1..50)
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(10_000))]
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

    #[test]
    fn weights_sum_to_one_and_contraction_lies_between_the_slopes(
        agents in proptest::collection::vec(agent(), 1..50), slopes in proptest::collection::vec(-10.0f64..10.0, 50),
    ) {
        let h = field(&agents, 0.0);
        let weights: Vec<f64> = partials_by_field(&agents, h).collect();
        prop_assert_eq!(weights.len(), agents.len());
        prop_assert!(weights.iter().all(|weight| *weight >= 0.0));
        prop_assert!((weights.iter().sum::<f64>() - 1.0).abs() < 1e-14);
        let slopes = &slopes[..agents.len()];
        let rate = contraction(&agents, h, slopes.iter().copied());
        let low = slopes.iter().copied().fold(f64::INFINITY, f64::min);
        let high = slopes.iter().copied().fold(f64::NEG_INFINITY, f64::max);
        prop_assert!(rate >= low - 1e-13 && rate <= high + 1e-13, "{low} {rate} {high}");
    }

    #[test]
    fn partials_are_the_limits_of_differences(
        agents in smooth_agents(), index in 0usize..50, rates in proptest::collection::vec(-1.0f64..1.0, 50),
    ) {
        const STEP: f64 = 1e-5;
        let h = field(&agents, 0.0);
        let moved = |change: &dyn Fn(usize, &mut AnyAgent)| {
            let mut moved = agents.clone();
            moved.iter_mut().enumerate().for_each(|(i, agent)| change(i, agent));
            field(&moved, h)
        };
        let index = index % agents.len();
        let by_field = |step: f64| moved(&|i, agent| if i == index { agent.f += step });
        let difference = (by_field(STEP) - by_field(-STEP)) / (2.0 * STEP);
        let partial = partials_by_field(&agents, h).nth(index).unwrap();
        prop_assert!((partial - difference).abs() < 1e-4, "{partial} {difference}");

        let rate = |i: usize| rates[i] * agents[i].psi;
        let by_time = |step: f64| moved(&|i, agent| agent.psi += step * rate(i));
        let difference = (by_time(STEP) - by_time(-STEP)) / (2.0 * STEP);
        let partial = partial_by_time(&agents, h, (0..agents.len()).map(rate));
        prop_assert!((partial - difference).abs() < 1e-4 * (1.0 + partial.abs()), "{partial} {difference}");

        let along = |step: f64| moved(&|i, agent| agent.f += step * rates[i]);
        let difference = (along(STEP) - along(-STEP)) / (2.0 * STEP);
        let partial = contraction(&agents, h, rates.iter().copied());
        prop_assert!((partial - difference).abs() < 1e-4, "{partial} {difference}");
    }
}

#[test]
fn a_common_funnel_drops_out() {
    // Paper, remark on time-invariant emergent dynamics: psi_i = r_i psi.
    let gain = Logarithmic { scale: 2.0 };
    let agents = [(1.0, 0.5), (2.0, -3.0), (0.7, 8.0)].map(|(psi, f)| Agent { psi, f, gain });
    let h: f64 = field(&agents, 0.0);
    let rates = agents.map(|agent| -3.0 * agent.psi);
    assert!(partial_by_time(&agents, h, rates).abs() < 1e-13);
    assert!(partial_by_time(&agents, h, [-3.0, 0.0, 0.0]).abs() > 0.1);
}

#[test]
fn two_groups_far_apart_meet_where_their_gaps_are_equal() {
    // 4,000 constants of the gain lie between them: every gap underflows, and they balance where
    // 2 e^-(h + 2000) = (1 + 1) e^-(2000 - h), and each group has one half of the weight.
    let gain = Logarithmic { scale: 1.0 };
    let agents = [(2.0, -2000.0), (1.0, 2000.0), (1.0, 2000.0)].map(|(psi, f)| Agent { psi, f, gain });
    let h: f64 = field(&agents, 1234.5);
    assert!(h.abs() < 1e-12, "{h:e}");
    let weights: Vec<f64> = partials_by_field(&agents, h).collect();
    assert!(weights.iter().zip([0.5, 0.25, 0.25]).all(|(weight, exact)| (weight - exact).abs() < 1e-12));
    assert_eq!(partial_by_time(&agents, h, [0.0; 3]), 0.0);
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
    let exact = 2.0 * funnelnet_law::math::exp(-1.0);
    let ratio = (solve(10) - exact).abs() / (solve(20) - exact).abs();
    assert!(ratio > 14.0 && ratio < 18.0, "{ratio}");
}
