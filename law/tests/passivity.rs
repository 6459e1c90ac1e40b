//! Theorem 1 of law.md and what it becomes for (**), checked on the law as it runs: random graphs, gains over
//! 12 decades, and funnels that are drawn anew for every node at every tick.
#![allow(clippy::unwrap_used)]

use funnelnet_law::funnel::Widths;
use funnelnet_law::gain::Gain;
use funnelnet_law::law::node_wise::{Constants, Memory, NodeWise};
use funnelnet_law::math::{cos, exp10};
use proptest::prelude::*;

const TICK: f64 = 1e-3;
const TICKS: usize = 200;

/// A network, and the funnels of its nodes tick by tick.
#[derive(Debug)]
struct Trial {
    weights: Vec<Vec<f64>>,
    gains: Vec<Gain<f64>>,
    states: Vec<f64>,
    widths: Vec<Vec<f64>>,
}

fn decade(low: f64, high: f64) -> impl Strategy<Value = f64> {
    (low..high).prop_map(exp10)
}

fn gain() -> impl Strategy<Value = Gain<f64>> {
    (decade(-6.0, 6.0), 0..4).prop_map(|(scale, kind)| match kind {
        0 => Gain::Reciprocal { scale },
        1 => Gain::Algebraic { scale },
        2 => Gain::Logarithmic { scale },
        _ => Gain::Linear { slope: scale },
    })
}

fn trial() -> impl Strategy<Value = Trial> {
    (2usize..8).prop_flat_map(|n| {
        let parents = proptest::collection::vec((0.0f64..1.0, decade(-1.0, 1.0)), n);
        let extra = proptest::collection::vec((0..n, 0..n, decade(-1.0, 1.0)), 0..2 * n);
        let gains = proptest::collection::vec(gain(), n);
        let states = proptest::collection::vec(-10.0f64..10.0, n);
        let widths = proptest::collection::vec(proptest::collection::vec(decade(-3.0, 2.0), n), TICKS);
        (parents, extra, gains, states, widths).prop_map(move |(parents, extra, gains, states, widths)| {
            let mut weights = vec![vec![0.0; n]; n];
            let tree = parents.iter().enumerate().skip(1);
            let tree = tree.map(|(i, &(share, w))| (i, (share * i as f64) as usize, w));
            for (i, j, w) in tree.chain(extra).filter(|(i, j, _)| i != j) {
                (weights[i][j], weights[j][i]) = (w, w);
            }
            Trial { weights, gains, states, widths }
        })
    })
}

/// `sum_j alpha_ij (v_j - v_i)` at every node.
fn diffusive(weights: &[Vec<f64>], v: &[f64]) -> Vec<f64> {
    let at = |i: usize| weights[i].iter().zip(v).map(|(w, x)| w * (x - v[i])).sum();
    (0..v.len()).map(at).collect()
}

fn degree(trial: &Trial, i: usize) -> f64 {
    trial.weights[i].iter().sum()
}

/// `v' L v`.
fn quadratic(trial: &Trial, v: &[f64]) -> f64 {
    let of = |i: usize| (0..i).map(move |j| trial.weights[i][j] * (v[i] - v[j]) * (v[i] - v[j]));
    (0..v.len()).flat_map(of).sum()
}

/// Runs the law without own dynamics, and shows each tick the states and inputs.
fn run(trial: &Trial, constants: Constants, mut seen: impl FnMut(&[f64], &[f64])) {
    let n = trial.states.len();
    let law = |i: usize| NodeWise::with(trial.gains[i].prepared(), TICK, degree(trial, i), constants);
    let laws: Vec<_> = (0..n).map(law).collect();
    let (mut x, mut dx) = (trial.states.clone(), vec![0.0; n]);
    let mut memory = vec![Memory::default(); n];
    for widths in &trial.widths {
        let (nu, dnu) = (diffusive(&trial.weights, &x), diffusive(&trial.weights, &dx));
        let input = |i: usize| {
            let psi = Widths { now: widths[i], ahead: widths[i] };
            laws[i].step(&mut memory[i], nu[i], dnu[i], psi).u
        };
        let u: Vec<f64> = (0..n).map(input).collect();
        dx = u.iter().map(|u| TICK * u).collect();
        x.iter_mut().zip(&dx).for_each(|(x, dx)| *x += dx);
        seen(&x, &u);
    }
}

/// `|v|_S^2`, `S = B - T L / 2`.
fn damping(trial: &Trial, constants: Constants, v: &[f64]) -> f64 {
    let share = constants.theta * constants.damping * TICK;
    let diagonal: f64 = (0..v.len()).map(|i| share * degree(trial, i) * v[i] * v[i]).sum();
    diagonal - TICK / 2.0 * quadratic(trial, v)
}

/// How much the function of theorem 1, as (**) has it (docs/book/src/theory.md), grows at most in a tick,
/// over its size: `V = x' L x / T + |(p + r) u - r u1|_S^2 + r^2 |u|_S^2`.
fn growth(trial: &Trial, constants: Constants) -> f64 {
    let root = |x: f64| x.max(0.0).sqrt();
    let (low, high) = (root(1.0 - 6.0 * constants.g), root(1.0 + 2.0 * constants.g));
    let (p, r) = ((high + low) / 2.0, (high - low) / 2.0);
    let (mut tick, mut first, mut last, mut worst) = (0, f64::NAN, f64::INFINITY, 0.0f64);
    let mut before: Vec<f64> = Vec::new();
    run(trial, constants, |x, u| {
        // At the first two ticks there is no look back yet.
        if tick >= 2 {
            let mixed: Vec<f64> = u.iter().zip(&before).map(|(u, u1)| (p + r) * u - r * u1).collect();
            let inputs = damping(trial, constants, &mixed) + r * r * damping(trial, constants, u);
            let value = quadratic(trial, x) / TICK + inputs;
            if tick == 2 {
                first = value;
            }
            // What rounding does, to states that came from far away.
            let allowed = last * (1.0 + 1e-9) + 1e-12 * first;
            worst = worst.max((value - allowed) / value);
            last = value;
        }
        before.clear();
        before.extend_from_slice(u);
        tick += 1;
    });
    worst
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(300))]

    /// Whatever the funnels do.
    #[test]
    fn the_function_of_theorem_1_never_grows_with_a_look_back_or_without(trial in trial()) {
        for g in [0.0, 0.1, 1.0 / 6.0] {
            let worst = growth(&trial, Constants { g, ..Constants::default() });
            prop_assert!(worst <= 0.0, "{worst} at g = {g}");
        }
    }

    /// From the very start, where the memory is empty: the states stay where they began.
    #[test]
    fn with_a_look_back_no_run_grows(trial in trial()) {
        let (most, late) = halves(&trial, Constants::default());
        // The first inputs are found without a memory, and throw the states apart once.
        prop_assert!(most <= 16.0 * quadratic(&trial, &trial.states), "{most}");
        prop_assert!(late <= most * (1.0 + 1e-9), "{late} after {most}");
    }
}

/// The largest `x' L x` in either half of a run.
fn halves(trial: &Trial, constants: Constants) -> (f64, f64) {
    let (mut tick, mut halves) = (0, [0.0f64; 2]);
    run(trial, constants, |x, _| {
        let half = &mut halves[usize::from(tick >= TICKS / 2)];
        *half = half.max(quadratic(trial, x));
        tick += 1;
    });
    halves.into()
}

#[test]
fn with_too_long_a_look_back_a_run_grows() {
    // So the test above can fail: a path of eight with steep gains, g = 0.5.
    let near = |i: usize, j: usize| if i.abs_diff(j) == 1 { 1.0 } else { 0.0 };
    let trial = Trial {
        weights: (0..8).map(|i| (0..8).map(|j| near(i, j)).collect()).collect(),
        gains: vec![Gain::Linear { slope: 1e6 }; 8],
        states: (0..8).map(f64::from).collect(),
        widths: vec![vec![1.0; 8]; TICKS],
    };
    let (most, late) = halves(&trial, Constants { g: 0.5, ..Constants::default() });
    assert!(late > 100.0 * most, "{late} after {most}");
    let (most, late) = halves(&trial, Constants::default());
    assert!(late < 0.1 * most, "{late} after {most}");
}

/// `Re G / T` of (**) along an eigenvector of `D^-1 L` with eigenvalue `lambda`, per unit of degree, at
/// frequency `w`, found from the equation itself:
/// `q = nu + dnu / 2 + g (dnu - dnu') + b (u' + 2 g (u' - u'')) - b u` for `u = e^iwk`.
fn passivity(g: f64, c: f64, lambda: f64, w: f64) -> f64 {
    // x[k+1] = x[k] + T u[k], so x = T u / (z - 1), with z = e^iw; dx = x (1 - 1/z).
    let multiply = |a: (f64, f64), b: (f64, f64)| (a.0 * b.0 - a.1 * b.1, a.0 * b.1 + a.1 * b.0);
    let sine = |w: f64| cos(w - core::f64::consts::FRAC_PI_2);
    let back = (cos(w), -sine(w));
    let (dr, di) = (cos(w) - 1.0, sine(w));
    let size = dr * dr + di * di;
    let x = (dr / size, -di / size);
    let change = multiply(x, (1.0 - back.0, -back.1));
    let second = multiply(change, (1.0 - back.0, -back.1));
    let b = c / 2.0;
    let look = multiply(back, (1.0 - back.0, -back.1));
    -lambda * (x.0 + change.0 / 2.0 + g * second.0) + b * (back.0 + 2.0 * g * look.0 - 1.0)
}

#[test]
fn the_linear_part_is_positive_real_up_to_a_sixth() {
    // It maps u to q = psi mu^-1(u); what feeds back is -q, so the linear part must take energy: -Re >= 0.
    let worst = |g: f64, c: f64| {
        let grid = (1..2000).map(|i| f64::from(i) * core::f64::consts::PI / 2000.0);
        let of = |w: f64| (0..=40).map(move |i| -passivity(g, c, f64::from(i) / 20.0, w));
        grid.flat_map(of).fold(f64::MAX, f64::min)
    };
    for g in [0.0, 0.1, 1.0 / 6.0] {
        assert!(worst(g, 2.2) >= -1e-9 && worst(g, 2.0) >= -1e-9, "{g}: {} {}", worst(g, 2.2), worst(g, 2.0));
    }
    assert!(worst(0.2, 2.2) < -1e-3, "{}", worst(0.2, 2.2));
    assert!(worst(0.0, 1.9) < -1e-3, "c below the largest eigenvalue: {}", worst(0.0, 1.9));
}
