//! The solver against itself, against another method in other coordinates, and against known limits.

use super::examples::{complete, five_agents, narrow_path, path, ring, star};
use super::*;
use crate::scenario::Affine;
use funnelnet_law::funnel::{Funnel, Shape};
use funnelnet_law::math;
use funnelnet_law::{Gain, GainFunction};

fn times(end: f64, rows: usize) -> Vec<f64> {
    (0..=rows).map(|k| end * k as f64 / rows as f64).collect()
}

fn at_tolerance(problem: &ReferenceProblem, end: f64, rows: usize, tolerance: f64) -> ReferenceSolution {
    let options = ReferenceOptions { tolerance, ..ReferenceOptions::default() };
    solve(problem, &times(end, rows), &options).unwrap()
}

fn distance(a: &[f64], b: &[f64]) -> f64 {
    assert_eq!(a.len(), b.len());
    a.iter().zip(b).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max)
}

/// The closed loop in the states themselves, straight from its definition.
fn plain(problem: &ReferenceProblem, t: f64, x: &[f64]) -> Vec<f64> {
    let mut nu = vec![0.0; x.len()];
    for &(i, j, weight) in &problem.edges {
        nu[i] += weight * (x[j] - x[i]);
        nu[j] += weight * (x[i] - x[j]);
    }
    let rate = |i: usize| {
        problem.fields[i].value(t, x[i]) + problem.gains[i].apply(nu[i] / problem.funnels[i].width(t))
    };
    (0..x.len()).map(rate).collect()
}

/// The classical Runge-Kutta method in the states: explicit, so `step` must resolve the stiffness.
fn runge_kutta(problem: &ReferenceProblem, end: f64, rows: usize, step: f64) -> Vec<f64> {
    let add =
        |x: &[f64], k: &[f64], h: f64| -> Vec<f64> { x.iter().zip(k).map(|(x, k)| x + h * k).collect() };
    let steps = (end / rows as f64 / step).round() as usize;
    let mut x = problem.x0.clone();
    let mut all = x.clone();
    for row in 0..rows {
        for k in 0..steps {
            let t = end * row as f64 / rows as f64 + k as f64 * step;
            let a = plain(problem, t, &x);
            let b = plain(problem, t + 0.5 * step, &add(&x, &a, 0.5 * step));
            let c = plain(problem, t + 0.5 * step, &add(&x, &b, 0.5 * step));
            let d = plain(problem, t + step, &add(&x, &c, step));
            for i in 0..x.len() {
                x[i] += step / 6.0 * (a[i] + 2.0 * b[i] + 2.0 * c[i] + d[i]);
            }
        }
        all.extend_from_slice(&x);
    }
    all
}

#[test]
fn five_agents_keep_the_tolerance_on_every_graph() {
    for end in [2.0, 0.02] {
        for edges in [ring(5), path(5), star(5), complete(5)] {
            let problem = five_agents(edges, end);
            let solution = at_tolerance(&problem, 20.0, 2000, 1e-9);
            let halved = at_tolerance(&problem, 20.0, 2000, 0.5e-9);
            let finer = at_tolerance(&problem, 20.0, 2000, 1e-11);
            assert!(distance(&solution.x, &halved.x) < 1.5e-8);
            assert!(distance(&solution.x, &finer.x) < 1.5e-8, "{}", distance(&solution.x, &finer.x));
            assert!((0.93..0.96).contains(&solution.max_ratio), "{}", solution.max_ratio);
            assert!(solution.max_defect < 1e-8);
            assert_eq!((solution.times.len(), solution.resolved_until), (2001, 20.0));
        }
    }
}

#[test]
fn another_method_in_other_coordinates_agrees() {
    let mut mixed = five_agents(path(5), 2.0);
    mixed.edges = vec![(0, 1, 0.5), (1, 2, 2.0), (2, 3, 1.0), (4, 3, 3.0), (1, 0, 0.25)];
    mixed.gains[1] = Gain::Logarithmic { scale: 2.0 };
    mixed.gains[3] = Gain::Reciprocal { scale: 3.0 };
    mixed.funnels[2] = Funnel { factor: 2.0, shape: Shape::Constant { width: 30.0 } };
    let cases = [
        (five_agents(star(5), 2.0), 20.0, 1e-4),
        (five_agents(ring(5), 0.02), 8.0, 1e-5),
        (mixed, 10.0, 1e-4),
    ];
    for (problem, end, step) in cases {
        let solution = at_tolerance(&problem, end, 100, 1e-9);
        let other = runge_kutta(&problem, end, 100, step);
        assert!(distance(&solution.x, &other) < 2e-8, "{}", distance(&solution.x, &other));
    }
}

#[test]
fn rows_obey_the_law() {
    let problem = five_agents(ring(5), 0.02);
    let solution = at_tolerance(&problem, 20.0, 500, 1e-9);
    for k in 0..solution.times.len() {
        let row = |table| solution.row(table, k);
        for i in 0..5 {
            let (nu, psi, u) = (row(&solution.nu)[i], row(&solution.psi)[i], row(&solution.u)[i]);
            let x = row(&solution.x);
            assert_eq!(psi, problem.funnels[i].width(solution.times[k]));
            assert!(((x[(i + 1) % 5] + x[(i + 4) % 5] - 2.0 * x[i]) - nu).abs() < 1e-8 * psi + 1e-13);
            assert!((problem.gains[i].apply(nu / psi) - u).abs() < 1e-12 * (1.0 + u * u));
        }
    }
}

/// `psi = 1200 e^-t` down to 1.1e-10, where `nu` computed from `x` has no digits left.
#[test]
fn an_asymptotic_funnel_is_resolved_to_its_end() {
    let problem = narrow_path();
    let solution = at_tolerance(&problem, 30.0, 3000, 1e-9);
    let last = solution.row(&solution.x, 3000);
    let spread = last.iter().fold(f64::MIN, |a, x| a.max(*x)) - last.iter().fold(f64::MAX, |a, x| a.min(*x));
    assert!(spread > 1e-10 && spread < 1e-9, "{spread}");
    assert!(solution.max_ratio < 0.9985, "{}", solution.max_ratio);
    assert!(distance(&solution.x, &at_tolerance(&problem, 30.0, 3000, 1e-11).x) < 2e-8 * 300.0);
    // The emergent dynamics' equilibrium: equal funnels, so sum_i (xi - f_i*) / (1 + |xi - f_i*|) = 0.
    let sum = |xi: f64| -> f64 {
        problem
            .fields
            .iter()
            .map(|f| Gain::Reciprocal { scale: 1.0 }.inverse(xi - f.affine().unwrap().offset()))
            .sum()
    };
    let (mut low, mut high) = (-560.0, 560.0);
    for _ in 0..80 {
        let middle = 0.5 * (low + high);
        if sum(middle) < 0.0 { low = middle } else { high = middle }
    }
    assert!((last[0] - low).abs() < 1e-9, "{} {low}", last[0]);
}

#[test]
fn the_end_of_f64_is_the_end_of_the_run_and_is_said() {
    let problem = narrow_path();
    let far = at_tolerance(&problem, 690.0, 100, 1e-9);
    assert!(far.psi[far.psi.len() - 1] < 1e-296);
    let error = solve(&problem, &times(800.0, 800), &ReferenceOptions::default()).unwrap_err();
    let text = error.to_string();
    let ReferenceError::Unresolved { at, psi, ratio, partial, .. } = error else { panic!("{text}") };
    assert!((700.0..710.0).contains(&at) && psi < 1e-300 && ratio < 1.0, "{text}");
    assert!(text.contains("cannot be resolved beyond t = 70"), "{text}");
    assert_eq!(partial.resolved_until, at);
    assert_eq!(partial.times.len(), at as usize + 1);
    assert_eq!(partial.x.len(), partial.times.len() * 11);
}

/// With a logarithmic gain and inputs 500 times its scale, `1 - |s|` is `e^-500`: reached within less than a
/// rounding error of the time.
#[test]
fn a_boundary_layer_thinner_than_f64_is_said() {
    let mut problem = narrow_path();
    problem.gains = vec![Gain::Logarithmic { scale: 1.0 }; 11];
    let error = solve(&problem, &times(30.0, 30), &ReferenceOptions::default()).unwrap_err();
    assert!(
        matches!(error, ReferenceError::Unresolved { at, ratio, .. } if at < 1.0 && ratio < 1.0),
        "{error}"
    );
}

#[test]
fn a_start_at_the_very_edge_is_followed() {
    for margin in [1e-3, 1e-9, 1e-14] {
        let mut problem = five_agents(path(5), 2.0);
        problem.funnels =
            vec![Funnel { factor: 1.0, shape: Shape::Constant { width: 13.8 * (1.0 + margin) } }; 5];
        let solution = at_tolerance(&problem, 1.0, 100, 1e-9);
        assert!(solution.max_ratio < 1.0 && solution.max_ratio > 1.0 - 2.0 * margin, "{margin}");
        let finer = at_tolerance(&problem, 1.0, 100, 1e-11);
        assert!(distance(&solution.x, &finer.x) < 1e-8, "{margin}: {}", distance(&solution.x, &finer.x));
    }
}

#[test]
fn a_lone_node_follows_its_own_field() {
    let problem = ReferenceProblem {
        x0: vec![1.0],
        edges: Vec::new(),
        fields: vec![Affine::scalar(-1.0, 3.0, Vec::new()).into()],
        gains: vec![Gain::Reciprocal { scale: 1.0 }],
        funnels: vec![Funnel { factor: 1.0, shape: Shape::Constant { width: 1.0 } }],
    };
    let solution = at_tolerance(&problem, 3.0, 30, 1e-9);
    let exact: Vec<f64> = solution.times.iter().map(|&t| 3.0 - 2.0 * math::exp(-t)).collect();
    assert!(distance(&solution.x, &exact) < 1e-8);
}

#[test]
fn a_start_outside_the_funnel_is_refused_with_how_far() {
    let mut problem = five_agents(ring(5), 2.0);
    problem.x0[4] = -60.0;
    let error = solve(&problem, &[0.0], &ReferenceOptions::default()).unwrap_err();
    assert!(matches!(error, ReferenceError::OutsideAtStart { node: 4, psi: 40.0, .. }), "{error}");
    assert!(error.to_string().contains("is 3.09"), "{error}");
}

#[test]
fn malformed_problems_are_refused() {
    let good = five_agents(ring(5), 2.0);
    let refused = |change: fn(&mut ReferenceProblem)| {
        let mut problem = good.clone();
        change(&mut problem);
        solve(&problem, &[0.0, 1.0], &ReferenceOptions::default()).unwrap_err().to_string()
    };
    assert!(refused(|p| p.x0.clear()).contains("x0 has 0 entries"));
    assert!(refused(|p| p.gains.truncate(4)).contains("gains has 4 entries where 5"));
    assert!(refused(|p| p.x0[1] = f64::NAN).contains("x0 of node index 1 is NaN"));
    assert!(refused(|p| p.edges[0].2 = -1.0).contains("edge weight of node index 0 is -1"));
    assert!(refused(|p| p.edges[0].1 = 9).contains("edge end"));
    assert!(refused(|p| p.edges.truncate(3)).contains("no path joins node index 0 and node index 4"));
    assert!(refused(|p| p.gains[0] = Gain::Reciprocal { scale: 0.0 }).contains("gain scale"));
    assert!(
        refused(|p| p.funnels[0] = Funnel { factor: 1.0, shape: Shape::Constant { width: 0.0 } })
            .contains("funnel width")
    );
    let wrong_times = solve(&good, &[1.0, 0.5], &ReferenceOptions::default()).unwrap_err();
    assert!(matches!(wrong_times, ReferenceError::Times { index: 1, .. }));
    let loose = ReferenceOptions { tolerance: 1.0, ..ReferenceOptions::default() };
    assert!(matches!(solve(&good, &[1.0], &loose), Err(ReferenceError::Tolerance(_))));
}

#[test]
fn a_run_can_be_watched_given_up_and_limited() {
    let problem = five_agents(ring(5), 2.0);
    let options = ReferenceOptions::default();
    let mut stop = |t: f64| if t > 0.5 { ControlFlow::Break(()) } else { ControlFlow::Continue(()) };
    let error = solve_with(&problem, &[20.0], &options, &mut stop).unwrap_err();
    assert!(matches!(error, ReferenceError::Cancelled { at, .. } if (0.5..0.6).contains(&at)));
    let short = ReferenceOptions { max_steps: 100, ..options };
    let error = solve(&problem, &times(20.0, 20), &short).unwrap_err();
    assert!(error.to_string().contains("100 steps were not enough"), "{error}");
}

/// The cost by size: `cargo test --release -p sim-host cost_by_size -- --ignored --nocapture`.
#[test]
#[ignore = "a measurement"]
fn cost_by_size() {
    for (nodes, end, tolerance) in [(11, 20.0, 1e-9), (127, 20.0, 1e-9), (127, 20.0, 1e-7), (1000, 1.0, 1e-6)]
    {
        let five = five_agents(ring(5), 2.0);
        let mut problem = ReferenceProblem {
            x0: (0..nodes).map(|i| five.x0[i % 5]).collect(),
            edges: ring(nodes),
            fields: (0..nodes).map(|i| five.fields[i % 5].clone()).collect(),
            gains: vec![five.gains[0]; nodes],
            funnels: vec![five.funnels[0]; nodes],
        };
        problem.edges.extend((0..nodes).map(|i| (i, (i + 4) % nodes, 1.0)));
        for (i, field) in problem.fields.iter_mut().enumerate() {
            let field = field.affine_mut().unwrap();
            field.sines[1].phase += i as f64;
            field.sines[2].phase += 1.7 * i as f64;
        }
        let start = std::time::Instant::now();
        let solution = at_tolerance(&problem, end, 20_000, tolerance);
        let (steps, wall) = (solution.steps, start.elapsed().as_secs_f64());
        println!("{nodes} nodes, {end} s, tolerance {tolerance:e}: {steps} steps, {wall:.1} s");
    }
}
