//! The emergent vector field against the paper's exact procedures, in arithmetic of 31 digits.
//!
//! Example 1 (reciprocal gain, equal funnels) and Example 2 (logarithmic gain, any funnels) sort the fields
//! and, bracket by bracket, solve a polynomial. Nothing here calls the root finder of the crate.
#![allow(clippy::unwrap_used)]

mod exact;

use exact::Double;
use funnelnet_law::emergent::{Agent, field};
use funnelnet_law::gain::{Logarithmic, Reciprocal};
use funnelnet_law::math::exp10;
use nalgebra::DMatrix;
use proptest::prelude::*;

/// Largest distance to the exact solution, relative to the larger of `|h|` and the spread of the fields.
const BAR: f64 = 1e-14;

/// Fields of 1 to `most` agents, sorted, state units / s: spread over a range, or in two clusters, over nine
/// decades.
fn fields(most: usize) -> impl Strategy<Value = Vec<f64>> {
    let shape = (-6.0f64..6.0, prop_oneof![Just(0.0), -1e3f64..1e3], any::<bool>());
    (proptest::collection::vec(-1.0f64..1.0, 1..=most), shape).prop_map(
        |(units, (decade, centre, clustered))| {
            let place = |unit: f64| if clustered { unit.signum() + 1e-3 * unit } else { unit };
            let mut fields: Vec<f64> = units.iter().map(|&u| centre + exp10(decade) * place(u)).collect();
            fields.sort_by(f64::total_cmp);
            fields
        },
    )
}

/// Funnel widths of as many agents: all equal, two widths, or any over six decades (state units).
fn widths(count: usize) -> impl Strategy<Value = Vec<f64>> {
    prop_oneof![
        (1e-3f64..1e3).prop_map(move |psi| vec![psi; count]),
        proptest::collection::vec(prop_oneof![Just(0.1), Just(0.3)], count),
        proptest::collection::vec((-3.0f64..3.0).prop_map(exp10), count),
    ]
}

/// The distance of `h` to `exact`, in units of the bar's reference.
fn error(h: f64, exact: Double, fields: &[f64]) -> f64 {
    let spread = fields.last().unwrap() - fields.first().unwrap();
    let reference = exact.nearest().abs().max(spread);
    let distance = (Double::from(h) - exact).nearest().abs();
    if distance == 0.0 { 0.0 } else { distance / reference }
}

/// The index `j` of the bracket `[f_j, f_j+1]` that holds the root of `value(j, h)`; `None` where all fields
/// are equal.
fn bracket(fields: &[f64], value: impl Fn(usize, Double) -> Double) -> Option<usize> {
    if fields.first() == fields.last() {
        return None;
    }
    (0..fields.len() - 1).find(|&j| {
        value(j, Double::from(fields[j])) <= Double::ZERO
            && value(j, Double::from(fields[j + 1])) >= Double::ZERO
    })
}

/// The left side of the paper's (21), ex:1 for bracket `j`, at `h`.
fn rational(fields: &[f64], j: usize, h: Double) -> Double {
    let term = |(k, &f): (usize, &f64)| {
        let u = h - Double::from(f);
        u / if k <= j { Double::ONE + u } else { Double::ONE - u }
    };
    fields.iter().enumerate().map(term).sum()
}

/// Example 1: bisection of the rational equation of the bracket, down to 1e-18 of it.
fn example_1(fields: &[f64]) -> Double {
    let Some(j) = bracket(fields, |j, h| rational(fields, j, h)) else { return Double::from(fields[0]) };
    let (mut low, mut high) = (Double::from(fields[j]), Double::from(fields[j + 1]));
    for _ in 0..60 {
        let middle = (low + high).half();
        if rational(fields, j, middle) < Double::ZERO { low = middle } else { high = middle }
    }
    (low + high).half()
}

/// Example 1 for few agents: the roots of the polynomial of each bracket, as eigenvalues of its companion
/// matrix; `None` where no bracket has a real root. In f64, so good to some 1e-8 only.
fn example_1_by_eigenvalues(fields: &[f64]) -> Option<f64> {
    let margin = 1e-7;
    for j in 0..fields.len().saturating_sub(1) {
        let origin = 0.5 * (fields[j] + fields[j + 1]);
        let shifted: Vec<f64> = fields.iter().map(|f| f - origin).collect();
        let (low, high) = (shifted[j] - margin, shifted[j + 1] + margin);
        let roots = eigenvalues(&polynomial(&shifted, j));
        if let Some(root) = roots.into_iter().find(|root| (low..=high).contains(root)) {
            return Some(origin + root);
        }
    }
    None
}

/// The coefficients, lowest first, of `sum_k (h - f_k) prod_{l != k} d_l(h)` with the denominators `d_l` of
/// (21), ex:1.
fn polynomial(fields: &[f64], j: usize) -> Vec<f64> {
    let times = |p: &[f64], (constant, slope): (f64, f64)| {
        let mut product = vec![0.0; p.len() + 1];
        for (k, c) in p.iter().enumerate() {
            product[k] += c * constant;
            product[k + 1] += c * slope;
        }
        product
    };
    let denominator = |l: usize| if l <= j { (1.0 - fields[l], 1.0) } else { (1.0 + fields[l], -1.0) };
    let mut sum = vec![0.0; fields.len() + 1];
    for k in 0..fields.len() {
        let others = (0..fields.len()).filter(|&l| l != k).map(denominator);
        let term = others.fold(vec![-fields[k], 1.0], |p, d| times(&p, d));
        sum.iter_mut().zip(term).for_each(|(s, t)| *s += t);
    }
    sum
}

/// The real roots of a polynomial, lowest coefficient first.
fn eigenvalues(coefficients: &[f64]) -> Vec<f64> {
    let largest = coefficients.iter().fold(0.0f64, |m, c| m.max(c.abs()));
    let degree = coefficients.iter().rposition(|c| c.abs() > 1e-13 * largest).unwrap();
    let companion = DMatrix::from_fn(degree, degree, |row, column| {
        let shift = if row == column + 1 { 1.0 } else { 0.0 };
        if column == degree - 1 { shift - coefficients[row] / coefficients[degree] } else { shift }
    });
    let roots = companion.complex_eigenvalues();
    roots.iter().filter(|root| root.im.abs() < 1e-6).map(|root| root.re).collect()
}

/// Example 2: the polynomial `a y^2 + d y - b = 0` of the bracket, `y = e^(h - f_j)` or `e^(h - f_j+1)`,
/// whichever cannot overflow.
fn example_2(fields: &[f64], psi: &[f64]) -> Double {
    let value = |j: usize, h: Double| -> Double {
        let term = |(k, (&f, &psi)): (usize, (&f64, &f64))| {
            let u = h - Double::from(f);
            Double::from(psi) * if k <= j { Double::ONE - (-u).exp() } else { u.exp() - Double::ONE }
        };
        fields.iter().zip(psi).enumerate().map(term).sum()
    };
    let Some(j) = bracket(fields, value) else { return Double::from(fields[0]) };
    let (below, above) = (Double::from(fields[j]), Double::from(fields[j + 1]));
    let psi_of = |range: core::ops::Range<usize>| range.map(|k| Double::from(psi[k])).sum::<Double>();
    let weighted = |range: core::ops::Range<usize>, anchor: Double| -> Double {
        let distance = |k: usize| anchor - Double::from(fields[k]);
        let away = |k: usize| if k <= j { -distance(k) } else { distance(k) };
        range.map(|k| Double::from(psi[k]) * away(k).exp()).sum()
    };
    let d = psi_of(0..j + 1) - psi_of(j + 1..fields.len());
    let (a, b) = (weighted(j + 1..fields.len(), above), weighted(0..j + 1, below));
    let gap = above - below;
    if d == Double::ZERO {
        return (below + above + (b / a).ln()).half();
    }
    let product = a * b * (-gap).exp();
    let root = (d * d + product + product + product + product).sqrt();
    if d > Double::ZERO { below + ((b + b) / (d + root)).ln() } else { above - ((a + a) / (root - d)).ln() }
}

fn agents<G: Copy>(fields: &[f64], psi: &[f64], gain: G) -> Vec<Agent<f64, G>> {
    fields.iter().zip(psi).map(|(&f, &psi)| Agent { psi, f, gain }).collect()
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(10_000))]

    #[test]
    fn example_1_equal_funnels_reciprocal_gain(fields in fields(50), psi in 1e-3f64..1e3, guess in -1e3f64..1e3) {
        let psi = vec![psi; fields.len()];
        let h = field(&agents(&fields, &psi, Reciprocal { scale: 1.0 }), guess);
        let error = error(h, example_1(&fields), &fields);
        prop_assert!(error <= BAR, "{error:e}");
    }

    #[test]
    fn example_2_any_funnels_logarithmic_gain(
        (fields, psi) in fields(50).prop_flat_map(|f| (Just(f.clone()), widths(f.len()))), guess in -1e3f64..1e3,
    ) {
        let h = field(&agents(&fields, &psi, Logarithmic { scale: 1.0 }), guess);
        let error = error(h, example_2(&fields, &psi), &fields);
        prop_assert!(error <= BAR, "{error:e}");
    }

    #[test]
    fn the_rational_equation_and_the_polynomial_have_the_same_root(units in proptest::collection::vec(-2.0f64..2.0, 2..6)) {
        let mut fields = units;
        fields.sort_by(f64::total_cmp);
        let root = example_1_by_eigenvalues(&fields).unwrap();
        prop_assert!((root - example_1(&fields).nearest()).abs() < 1e-5, "{root}");
    }
}
