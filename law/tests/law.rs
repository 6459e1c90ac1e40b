//! The implicit law (*) of law.md 3: residual, bounds, and no overflow at the corners of what a configuration
//! allows.
#![allow(clippy::unwrap_used, clippy::expect_used)]

use funnelnet_law::gain::{
    Gain, GainFunction, LocallyLinear, Logarithmic, Median, Reciprocal, Solution, newton,
};
use funnelnet_law::range::{LARGEST, LARGEST_WEIGHT, SHORTEST_TICK_NS, SMALLEST};
use proptest::prelude::*;

/// Residual of (*), relative to its largest term, in f64.
fn residual(gain: &impl GainFunction<f64>, psi: f64, b: f64, r: f64, u: f64) -> f64 {
    let left = psi * gain.inverse(u) + b * u;
    (left - r).abs() / r.abs().max(1e-300)
}

fn decades(low: i32, high: i32) -> impl Strategy<Value = f64> {
    (f64::from(low)..f64::from(high)).prop_map(funnelnet_law::math::exp10)
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(20_000))]

    #[test]
    fn closed_form_solves_the_law(
        psi in decades(-12, 6), b in decades(-12, 3), kappa in decades(-6, 6), r in decades(-12, 6), sign: bool,
    ) {
        let r = if sign { r } else { -r };
        let gain = Reciprocal { scale: kappa };
        let Solution { u, s } = gain.solve(psi, b, r);
        prop_assert!(residual(&gain, psi, b, r, u) < 2e-15, "{:e}", residual(&gain, psi, b, r, u));
        prop_assert!(s.abs() <= 1.0 && s * r >= 0.0);
        prop_assert!((s - gain.inverse(u)).abs() <= 1e-14 * s.abs());
    }

    #[test]
    fn newton_agrees_with_the_closed_form(
        psi in decades(-9, 3), b in decades(-9, 1), kappa in decades(-3, 3), r in decades(-9, 3),
    ) {
        let gain = Reciprocal { scale: kappa };
        let exact = gain.solve(psi, b, r).u;
        let found = newton(&gain, psi, b, r).u;
        // Where `mu^-1` is flat, rounding of the left side moves its root by far more than it is itself.
        let rounding = 4.0 * f64::EPSILON * r / (psi * gain.inverse_slope(exact) + b);
        prop_assert!((found - exact).abs() <= 1e-13 * exact + rounding, "{found:e} for {exact:e}");
    }

    #[test]
    fn newton_solves_the_logarithmic_gain(
        psi in decades(-9, 3), b in decades(-9, 1), kappa in decades(-3, 3), r in decades(-9, 3),
    ) {
        let gain = Logarithmic { scale: kappa };
        let u = gain.solve(psi, b, r).u;
        prop_assert!(residual(&gain, psi, b, r, u) < 1e-13, "{:e}", residual(&gain, psi, b, r, u));
    }

    #[test]
    fn the_locally_linear_gain_solves_the_law(
        psi in decades(-12, 6), b in decades(-12, 3), bound in decades(-1, 6), r in decades(-12, 6),
    ) {
        let gain = LocallyLinear { bound };
        let Solution { u, s } = gain.solve(psi, b, r);
        // In s, where the equation is well conditioned: psi s + b mu(s) = r with mu computed from 1 - s.
        let left = psi * s + b * u;
        prop_assert!((left - r).abs() <= 1e-13 * r, "{left:e} for {r:e}");
        prop_assert!((gain.inverse(u) - s).abs() <= 1e-13 * s, "{} for {s}", gain.inverse(u));
        prop_assert!(s <= 1.0 && s > 0.0);
    }

    #[test]
    fn the_median_gain_meets_the_papers_bound(eta in decades(-4, 2), eps in decades(-4, -1), more in 1.0f64..100.0) {
        let gain = Median { eta, eps };
        prop_assert!(gain.inverse(eta) >= 1.0 - eps - 1e-15);
        prop_assert!(gain.inverse(eta * more) >= 1.0 - eps - 1e-15);
        prop_assert!(gain.inverse(-eta) <= -1.0 + eps + 1e-15);
        prop_assert!(gain.inverse(0.9 * eta) < 1.0 - eps);
    }

    #[test]
    fn single_precision_is_near_double(
        psi in decades(-6, 3), b in decades(-6, 0), kappa in decades(-3, 3), r in decades(-6, 3),
    ) {
        let [psi, b, kappa, r] = [psi, b, kappa, r].map(|x| x as f32);
        let found = Reciprocal { scale: kappa }.solve(psi, b, r);
        let [psi, b, kappa, r] = [psi, b, kappa, r].map(f64::from);
        let exact = Reciprocal { scale: kappa }.solve(psi, b, r);
        prop_assert!((f64::from(found.u) - exact.u).abs() <= 1e-4 * exact.u);
        prop_assert!((f64::from(found.s) - exact.s).abs() <= 5e-7 * exact.s);
    }

    #[test]
    fn the_input_grows_with_the_diffusive_term(psi in decades(-6, 3), b in decades(-6, 0), r in decades(-6, 3)) {
        let gain = Reciprocal { scale: 1.0 };
        prop_assert!(gain.solve(psi, b, r * 1.001).u > gain.solve(psi, b, r).u);
        prop_assert_eq!(gain.solve(psi, b, -r).u, -gain.solve(psi, b, r).u);
    }

    #[test]
    fn gains_invert(scale in decades(-3, 3), s in -0.999f64..0.999) {
        for kind in Gain::KINDS.iter().filter(|kind| kind.keeps_funnels) {
            let gain = (kind.build)([scale, 0.05]);
            prop_assert!((gain.inverse(gain.apply(s)) - s).abs() < 1e-12);
            let (u, step) = (gain.apply(s), gain.slope_at_zero() * 1e-6);
            let slope = (gain.inverse(u + step) - gain.inverse(u - step)) / (2.0 * step);
            prop_assert!((gain.inverse_slope(u) - slope).abs() <= 1e-3 * slope + 1e-9 / gain.slope_at_zero());
        }
    }
}

#[test]
fn no_corner_of_the_allowed_ranges_overflows_single_precision() {
    // r is at most four times the degree times the largest state, and b = theta c T d grows with the same
    // degree.
    let mut seen = 0;
    for degree in [SMALLEST, 1.0, LARGEST_WEIGHT] {
        for tick in [f64::from(SHORTEST_TICK_NS) * 1e-9, 1e-3, f64::from(u32::MAX) * 1e-9] {
            for psi in [1e-30, SMALLEST, 1.0, LARGEST * LARGEST] {
                for scale in [SMALLEST, 1.0, LARGEST] {
                    for state in [0.0, 1e-30, 1.0, LARGEST] {
                        let [psi, b, scale, r] =
                            [psi, 1.25 * tick * degree, scale, 4.0 * degree * state].map(|x| x as f32);
                        for kind in Gain::KINDS.iter().filter(|kind| kind.keeps_funnels) {
                            let gain = (kind.build)([scale, 0.05]);
                            assert_bounded(gain.solve(psi, b, r), [psi, b, scale, r]);
                        }
                        seen += 1;
                    }
                }
            }
        }
    }
    assert_eq!(seen, 432);
}

fn assert_bounded(solution: Solution<f32>, input: [f32; 4]) {
    let Solution { u, s } = solution;
    assert!(
        u.is_finite() && s.is_finite() && s.abs() <= 1.0,
        "psi, b, scale, r = {input:?}: u = {u}, s = {s}"
    );
}
