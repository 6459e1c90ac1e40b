//! Assumption 3 (funnel) holds for the gains of this crate over their whole range, and the check finds what
//! is wrong with others.
#![allow(clippy::unwrap_used, clippy::panic, reason = "helpers of tests, which clippy does not know as such")]

use funnelnet_law::gain::{
    Constants, Gain, GainFunction, LocallyLinear, Logarithmic, Median, Reciprocal, Solution, Violation,
    check, newton,
};
use funnelnet_law::math::Real;
use funnelnet_law::range::{LARGEST, SMALLEST};

fn holds<F: Real>(gain: impl GainFunction<F> + core::fmt::Debug) -> Constants<F> {
    check(&gain).unwrap_or_else(|violation| panic!("{gain:?}: {violation}"))
}

fn every_scale_holds<F: Real>() {
    for exponent in -9..=9 {
        let scale = F::from_f64(funnelnet_law::math::exp10(f64::from(exponent)));
        assert_eq!(holds(Reciprocal { scale }).half, scale);
        assert!((holds(Logarithmic { scale }).lowest - scale).abs() <= F::EPSILON * scale);
        let lowest = F::from_u32(4) * scale;
        assert!((holds(LocallyLinear { bound: scale }).lowest - lowest).abs() <= F::EPSILON * lowest);
        for kind in Gain::KINDS.iter().filter(|kind| kind.keeps_funnels && kind.parameters.len() == 1) {
            let gain = (kind.build)([scale, F::ZERO]);
            let found = holds(gain);
            assert!((found.lowest - gain.slope_at_zero()).abs() <= F::EPSILON * found.lowest, "{gain:?}");
        }
    }
    for eta in [SMALLEST, 0.01, LARGEST] {
        for eps in [1e-6, 0.05, 0.9999] {
            holds(Median { eta: F::from_f64(eta), eps: F::from_f64(eps) });
        }
    }
}

#[test]
fn gains_of_this_crate_hold_in_single_precision() {
    every_scale_holds::<f32>();
}

#[test]
fn gains_of_this_crate_hold_in_double_precision() {
    every_scale_holds::<f64>();
}

/// A gain made of functions, to break one at a time.
struct Made {
    inverse: fn(f64) -> f64,
    slope: fn(f64) -> f64,
    apply: fn(f64) -> f64,
    solve: fn(&Made, f64, f64, f64) -> Solution<f64>,
}

impl GainFunction<f64> for Made {
    fn inverse(&self, u: f64) -> f64 {
        (self.inverse)(u)
    }
    fn inverse_slope(&self, u: f64) -> f64 {
        (self.slope)(u)
    }
    fn apply(&self, s: f64) -> f64 {
        (self.apply)(s)
    }
    fn solve(&self, psi: f64, b: f64, r: f64) -> Solution<f64> {
        (self.solve)(self, psi, b, r)
    }
}

/// `mu(s) = s / (1 - |s|)`.
const GOOD: Made = Made {
    inverse: |u| u / (1.0 + u.abs()),
    slope: |u| 1.0 / ((1.0 + u.abs()) * (1.0 + u.abs())),
    apply: |s| s / (1.0 - s.abs()),
    solve: |gain, psi, b, r| newton(gain, psi, b, r),
};

macro_rules! fails {
    ($gain:expr, $pattern:pat $(if $guard:expr)?) => {
        let found = check(&$gain).map(|_| ());
        assert!(matches!(found, Err($pattern) $(if $guard)?), "{found:?}");
    };
}

#[test]
fn a_good_one_holds_with_the_constants_of_its_formula() {
    let constants = check(&GOOD).unwrap();
    assert_eq!((constants.lowest, constants.half), (1.0, 1.0));
    assert!(constants.round_trip < 1e-15 && constants.round_trip > 0.0, "{:e}", constants.round_trip);
    assert!(constants.residual < 1e-14 && constants.residual > 0.0, "{:e}", constants.residual);
}

#[test]
fn slow_and_fast_growth_hold() {
    // Slower than a logarithm: mu = sign(s) ln(1 - ln(1 - |s|)).
    let slow = Made {
        inverse: |u| (-Real::exp_m1(-Real::exp_m1(u.abs()))).copysign(u),
        slope: |u| Real::exp(u.abs() - Real::exp_m1(u.abs())),
        apply: |s| Real::ln_1p(-Real::ln_1p(-s.abs())).copysign(s),
        ..GOOD
    };
    check(&slow).unwrap();
    // mu = s / (1 - |s|)^8 by its inverse: at 1e18 still 0.6 % below 1. mu^-1 by Newton in the gap.
    let fast =
        Made { inverse: fast_inverse, slope: fast_slope, apply: |s| s / power8(1.0 - s.abs()), ..GOOD };
    check(&fast).unwrap();
}

fn power8(x: f64) -> f64 {
    let fourth = x * x * x * x;
    fourth * fourth
}

fn fast_inverse(u: f64) -> f64 {
    let size = u.abs();
    // s = |u| (1 - s)^8, increasing in s.
    let residual = |s: f64| (s - size * power8(1.0 - s), 1.0 + 8.0 * size * power8(1.0 - s) / (1.0 - s));
    funnelnet_law::root::increasing(0.0, 1.0, 0.5, residual).copysign(u)
}

fn fast_slope(u: f64) -> f64 {
    let gap = 1.0 - fast_inverse(u.abs());
    power8(gap) * gap / (gap + 8.0 * (1.0 - gap))
}

#[test]
fn what_is_not_zero_at_zero_fails() {
    fails!(Made { inverse: |u| (u + 1.0) / (2.0 + u.abs()), ..GOOD }, Violation::NotZero { s: 0.5 });
}

#[test]
fn an_even_one_fails() {
    fails!(Made { inverse: |u| u.abs() / (1.0 + u.abs()), ..GOOD }, Violation::NotOdd { .. });
}

#[test]
fn one_that_leaves_the_interval_fails_and_so_does_nan() {
    fails!(Made { inverse: |u| u, ..GOOD }, Violation::OutOfRange { u, .. } if u > 1.0);
    fails!(
        Made { inverse: |u| if u.abs() > 3.0 { f64::NAN } else { u / 4.0 }, ..GOOD },
        Violation::OutOfRange { .. }
    );
}

#[test]
fn a_decreasing_one_and_a_plateau_fail() {
    fails!(Made { inverse: |u| -u / (1.0 + u.abs()), ..GOOD }, Violation::NotIncreasing { .. });
    fails!(Made { inverse: |u| u / (1.0 + u * u), ..GOOD }, Violation::NotIncreasing { from, .. } if from < 1.3);
    fails!(
        Made { inverse: |u| (u / (1.0 + u.abs())).clamp(-0.75, 0.75), ..GOOD },
        Violation::NotIncreasing { s_from: 0.75, .. }
    );
}

#[test]
fn one_whose_limit_is_below_one_fails() {
    fails!(Made { inverse: |u| 0.9 * u / (1.0 + u.abs()), ..GOOD }, Violation::BelowOne { s, .. } if s < 0.9001);
}

#[test]
fn a_wrong_slope_fails() {
    fails!(
        Made { slope: |u| 1.1 / ((1.0 + u.abs()) * (1.0 + u.abs())), ..GOOD },
        Violation::WrongSlope { .. }
    );
    fails!(Made { slope: |u| 1.0 / (1.0 + u.abs()), ..GOOD }, Violation::WrongSlope { u, .. } if u > 1e-3);
    fails!(Made { slope: |_| 0.0, ..GOOD }, Violation::NoLowest { slope: 0.0 });
    fails!(Made { slope: |_| -1.0, ..GOOD }, Violation::NoLowest { .. });
}

#[test]
fn an_apply_that_is_not_the_inverse_fails() {
    fails!(Made { apply: |s| 1.001 * s / (1.0 - s.abs()), ..GOOD }, Violation::NotInverse { .. });
    fails!(Made { apply: |s| s.abs() / (1.0 - s.abs()), ..GOOD }, Violation::NotInverse { .. });
}

#[test]
fn a_falling_gamma_fails() {
    // mu = s^(1/2) / (1 - s) near zero would have an infinite gamma(0); this one falls after a finite one:
    // mu^-1(u) = u / (1 + |u|) with a dent, mu = piecewise linear up to s = 1/2 with slopes 2 and then 1/2.
    let dented = Made {
        inverse: |u| dent(u.abs()).copysign(u),
        slope: |u| {
            if u.abs() < 0.5 {
                0.5
            } else if u.abs() < 0.625 {
                2.0
            } else {
                0.5 / (0.375 + u.abs()) / (0.375 + u.abs())
            }
        },
        apply: |s| undent(s.abs()).copysign(s),
        ..GOOD
    };
    fails!(dented, Violation::GammaFalls { s, .. } if s > 0.24 && s < 0.5);
}

/// Slope 1/2 up to s = 1/4, slope 2 up to s = 1/2, then to 1 as the reciprocal of `u`.
fn dent(u: f64) -> f64 {
    if u < 0.5 {
        u / 2.0
    } else if u < 0.625 {
        0.25 + 2.0 * (u - 0.5)
    } else {
        1.0 - 0.5 / (0.375 + u)
    }
}

fn undent(s: f64) -> f64 {
    if s < 0.25 {
        2.0 * s
    } else if s < 0.5 {
        0.5 + (s - 0.25) / 2.0
    } else {
        0.5 / (1.0 - s) - 0.375
    }
}

#[test]
fn one_that_is_bounded_at_the_boundary_fails() {
    // mu = 2 s, clipped: a linear gain does not know the funnel.
    let linear = Made {
        inverse: |u| (u / 2.0).clamp(-1.0, 1.0),
        slope: |u| if u.abs() < 2.0 { 0.5 } else { 0.0 },
        apply: |s| 2.0 * s,
        ..GOOD
    };
    fails!(linear, Violation::Bounded { u, .. } if u < 2.0);
}

#[test]
fn a_solve_that_does_not_solve_fails() {
    let explicit = Made {
        solve: |gain, psi, _, r| {
            let s = (r / psi).clamp(-0.99, 0.99);
            Solution { u: gain.apply(s), s }
        },
        ..GOOD
    };
    fails!(explicit, Violation::NotSolved { .. });
    let no_ratio = Made { solve: |gain, psi, b, r| Solution { s: 0.0, ..newton(gain, psi, b, r) }, ..GOOD };
    fails!(no_ratio, Violation::NotSolved { residual, .. } if residual < 1e-12);
}
