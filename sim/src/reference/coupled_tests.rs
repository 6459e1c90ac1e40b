//! Every gain, funnel and coupling against the classical Runge-Kutta method with a small fixed step, on
//! right-hand sides that are written once more, straight from the paper.

use super::examples::{five_agents, path, ring};
use super::*;
use crate::scenario::{Affine, Dynamics, Sine};
use funnelnet_law::funnel::{Funnel, Normalised, Shape};
use funnelnet_law::math;
use funnelnet_law::{Coupling, Gain, GainFunction};

/// The largest distance of two solutions that passes.
const AGREES: f64 = 1e-6;

fn scalar(coupling: Coupling<f64>) -> CoupledProblem {
    let ReferenceProblem { x0, edges, fields, gains, funnels } = five_agents(ring(5), 2.0);
    let limits = vec![None; 5];
    CoupledProblem { coupling, components: 1, x0, edges, fields, gains, funnels, limits }
}

/// Five different oscillators.
fn vector(coupling: Coupling<f64>) -> CoupledProblem {
    let field = |i: usize| {
        let turn = 1.5 + 0.3 * i as f64;
        let sine = Sine { component: 1, amplitude: 3.0, frequency: 1.0, phase: 0.3 * i as f64 };
        let offset = vec![0.2 * i as f64, -0.5];
        Dynamics::from(Affine { slope: vec![-0.2, turn, -turn, -0.3], offset, sines: vec![sine] })
    };
    CoupledProblem {
        coupling,
        components: 2,
        x0: vec![2.0, 0.0, -1.0, 3.0, 0.5, -2.0, -3.0, -1.0, 1.0, 1.0],
        edges: vec![(0, 1, 1.0), (1, 2, 2.0), (2, 3, 0.5), (3, 4, 1.0), (4, 0, 1.0)],
        fields: (0..5).map(field).collect(),
        gains: vec![Gain::Reciprocal { scale: 1.0 }; 5],
        funnels: vec![
            Funnel { factor: 1.0, shape: Shape::Exponential { start: 20.0, end: 0.5, rate: 1.0 } };
            5
        ],
        limits: vec![None; 5],
    }
}

/// The inputs, from the paper's formulas; `y` has the gains of a lambda-tracker behind the states.
fn inputs(problem: &CoupledProblem, t: f64, y: &[f64]) -> Vec<f64> {
    let (n, count) = (problem.components, problem.fields.len());
    let at = |i: usize, c: usize| y[i * n + c];
    let weight = |i: usize, j: usize| -> f64 {
        let joins = |&&(a, b, _): &&(usize, usize, f64)| (a, b) == (i, j) || (a, b) == (j, i);
        problem.edges.iter().filter(joins).map(|edge| edge.2).sum()
    };
    let nu = |i: usize, c: usize| -> f64 { (0..count).map(|j| weight(i, j) * (at(j, c) - at(i, c))).sum() };
    let psi = |i: usize| problem.funnels[i].width(t);
    // mu(s) = gamma(|s|) s.
    let gamma = |i: usize, s: f64| {
        if s == 0.0 { problem.gains[i].slope_at_zero() } else { problem.gains[i].apply(s) / s }
    };
    let size = |i: usize| (0..n).map(|c| nu(i, c).abs() / psi(i)).fold(0.0, f64::max);
    let input = |i: usize, c: usize| match problem.coupling {
        // Beyond the funnel there is none but at a limit.
        Coupling::NodeWise | Coupling::ElementWise if nu(i, c).abs() >= psi(i) => nu(i, c) * f64::INFINITY,
        Coupling::NodeWise | Coupling::ElementWise => problem.gains[i].apply(nu(i, c) / psi(i)),
        Coupling::Linear => problem.gains[i].slope_at_zero() * nu(i, c),
        Coupling::MaxGain => gamma(i, size(i)) * nu(i, c) / psi(i),
        Coupling::WeaklyCentralised => {
            let common = (0..count).map(|j| gamma(j, size(j))).fold(0.0, f64::max);
            common * nu(i, c) / psi(i)
        }
        Coupling::EdgeWise => {
            let edge = |j: usize| problem.gains[i].apply(weight(i, j) * (at(j, c) - at(i, c)) / psi(i));
            (0..count).filter(|&j| weight(i, j) > 0.0).map(edge).sum()
        }
        Coupling::LambdaTracker { .. } => y[count * n + i * n + c] * nu(i, c),
        Coupling::None => 0.0,
    };
    let limited = |i: usize, u: f64| problem.limits[i].map_or(u, |(low, high)| u.clamp(low, high));
    (0..count * n).map(|k| limited(k / n, input(k / n, k % n))).collect()
}

fn rate(problem: &CoupledProblem, t: f64, y: &[f64]) -> Vec<f64> {
    let (n, size) = (problem.components, problem.x0.len());
    let u = inputs(problem, t, y);
    let mut out: Vec<f64> =
        (0..size).map(|k| problem.fields[k / n].component(k % n, t, &y[k / n * n..][..n]) + u[k]).collect();
    if let Coupling::LambdaTracker { eta } = problem.coupling {
        out.extend((0..size).map(|k| {
            let nu = u[k] / y[size + k];
            if nu.abs() > eta { nu.abs() * (nu.abs() - eta) } else { 0.0 }
        }));
    }
    out
}

/// Rows of states at equal distances, by steps of `step` (s).
fn runge_kutta(problem: &CoupledProblem, end: f64, rows: usize, step: f64) -> Vec<f64> {
    let add =
        |y: &[f64], k: &[f64], h: f64| -> Vec<f64> { y.iter().zip(k).map(|(y, k)| y + h * k).collect() };
    let size = problem.x0.len();
    let mut y = problem.x0.clone();
    if let Coupling::LambdaTracker { .. } = problem.coupling {
        y.extend((0..size).map(|k| problem.gains[k / problem.components].slope_at_zero()));
    }
    let steps = (end / rows as f64 / step).round() as usize;
    let mut all = y[..size].to_vec();
    for row in 0..rows {
        for k in 0..steps {
            let t = end * row as f64 / rows as f64 + k as f64 * step;
            let a = rate(problem, t, &y);
            let b = rate(problem, t + 0.5 * step, &add(&y, &a, 0.5 * step));
            let c = rate(problem, t + 0.5 * step, &add(&y, &b, 0.5 * step));
            let d = rate(problem, t + step, &add(&y, &c, step));
            for i in 0..y.len() {
                y[i] += step / 6.0 * (a[i] + 2.0 * b[i] + 2.0 * c[i] + d[i]);
            }
        }
        all.extend_from_slice(&y[..size]);
    }
    all
}

fn solved(problem: &CoupledProblem, end: f64, rows: usize) -> ReferenceSolution {
    let times: Vec<f64> = (0..=rows).map(|k| end * k as f64 / rows as f64).collect();
    let solution =
        solve_coupled(problem, &times, &ReferenceOptions::default(), &mut |_| ControlFlow::Continue(()));
    solution.unwrap_or_else(|error| panic!("{:?}: {error}", problem.coupling))
}

fn apart(a: &[f64], b: &[f64]) -> f64 {
    assert_eq!(a.len(), b.len());
    a.iter().zip(b).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max)
}

fn agree(problem: &CoupledProblem, end: f64, step: f64, what: &str) {
    let (solution, other) = (solved(problem, end, 20), runge_kutta(problem, end, 20, step));
    let apart = apart(&solution.x, &other);
    let estimate = solution.estimate.unwrap();
    println!("{what}: {apart:e}, estimate {estimate:?}, ratio {}", solution.max_ratio);
    assert!(apart < AGREES, "{what}: {apart:e}");
    assert!(estimate.resolved(), "{what}: {estimate:?}");
}

#[test]
fn every_coupling_agrees_with_another_method() {
    for coupling in [Coupling::NodeWise, Coupling::EdgeWise, Coupling::WeaklyCentralised, Coupling::None] {
        agree(&scalar(coupling), 2.0, 2e-4, coupling.kind());
    }
    for coupling in
        [Coupling::ElementWise, Coupling::MaxGain, Coupling::EdgeWise, Coupling::WeaklyCentralised]
    {
        agree(&vector(coupling), 2.0, 2e-4, &format!("vector {}", coupling.kind()));
    }
    for coupling in [Coupling::Linear, Coupling::LambdaTracker { eta: 0.5 }] {
        let mut problem = scalar(coupling);
        problem.gains = vec![Gain::Linear { slope: 3.0 }; 5];
        agree(&problem, 2.0, 2e-4, coupling.kind());
    }
}

#[test]
fn limits_of_inputs_agree_with_another_method() {
    // Without funnels, which limited inputs may leave.
    let mut problem = scalar(Coupling::Linear);
    problem.gains = vec![Gain::Linear { slope: 3.0 }; 5];
    let free = solved(&problem, 2.0, 20);
    assert!(free.u.iter().any(|u| !(-4.0..=6.0).contains(u)), "nothing is limited");
    problem.limits = vec![Some((-4.0, 6.0)); 5];
    agree(&problem, 2.0, 2e-4, "limits");
}

/// Inputs that are too weak for their funnels, which are left and come back to.
#[test]
fn limits_beyond_the_funnel_agree_with_another_method() {
    for (coupling, vectors) in [(Coupling::NodeWise, false), (Coupling::ElementWise, true)] {
        let mut problem = if vectors { vector(coupling) } else { scalar(coupling) };
        let shape = Shape::Exponential { start: 40.0, end: 1.0, rate: 2.0 };
        problem.funnels = vec![Funnel { factor: 1.0, shape }; 5];
        // What leaves the funnel of these scalars and keeps those vectors at a limit for a while.
        let (low, high) = if vectors { (-0.3, 0.3) } else { (-2.0, 3.0) };
        problem.limits = vec![Some((low, high)); 5];
        let limited = solved(&problem, 3.0, 300);
        let at_limit = limited.u.iter().filter(|u| **u == low || **u == high).count();
        let (share, most) = (at_limit as f64 / limited.u.len() as f64, limited.max_ratio);
        println!("{coupling:?}: at a limit {share}, ratio {most}");
        assert!((0.05..0.95).contains(&share) && (vectors || most > 1.0), "{coupling:?}: {share} {most}");
        agree(&problem, 3.0, 2e-5, &format!("limits and funnel, {coupling:?}"));
    }
}

#[test]
fn a_node_without_limits_stays_in_its_funnel_beside_those_that_have_some() {
    let mut problem = scalar(Coupling::NodeWise);
    problem.limits = vec![Some((-2.0, 3.0)); 5];
    problem.limits[1] = None;
    let solution = solved(&problem, 2.0, 100);
    assert!(solution.nu.iter().zip(&solution.psi).skip(1).step_by(5).all(|(nu, psi)| nu.abs() < *psi));
    // Sums over edges have no such limit, and a step beyond the edge is refused.
    problem.coupling = Coupling::EdgeWise;
    let shape = Shape::Exponential { start: 40.0, end: 0.5, rate: 2.0 };
    problem.funnels = vec![Funnel { factor: 1.0, shape }; 5];
    let error =
        solve_coupled(
            &problem,
            &[0.0, 4.0],
            &ReferenceOptions::default(),
            &mut |_| ControlFlow::Continue(()),
        );
    assert!(matches!(error, Err(ReferenceError::Unresolved { .. })), "{error:?}");
}

#[test]
fn every_gain_agrees_with_another_method() {
    for gain in [
        Gain::Reciprocal { scale: 3.0 },
        Gain::Logarithmic { scale: 8.0 },
        Gain::Algebraic { scale: 5.0 },
        Gain::LocallyLinear { bound: 12.0 },
        Gain::Median { eta: 10.0, eps: 0.2 },
    ] {
        let mut problem = scalar(Coupling::NodeWise);
        problem.gains = vec![gain.prepared(); 5];
        agree(&problem, 2.0, 1e-4, &format!("{gain:?}"));
        // The same in the states, whatever unknowns the law has.
        problem.coupling = Coupling::EdgeWise;
        problem.edges = path(2);
        problem.fields.truncate(2);
        problem.gains.truncate(2);
        problem.funnels.truncate(2);
        problem.x0.truncate(2);
        problem.limits.truncate(2);
        agree(&problem, 2.0, 1e-4, &format!("edge-wise {gain:?}"));
    }
}

#[test]
fn every_funnel_agrees_with_another_method() {
    let funnel = |shape| Funnel { factor: 1.0, shape };
    for (shape, end) in [
        (Shape::Constant { width: 40.0 }, 2.0),
        (Shape::ReciprocalTime { scale: 10.0 }, 4.0),
        (Shape::FiniteTime { start: 40.0, at_ns: 2_000_000_000, power: 1.5 }, 1.8),
        (
            Shape::Schedule {
                start: 40.0,
                at_ns: 1_000_000_000,
                eps: 0.1,
                then: Normalised::Constant { width: 10.0 },
            },
            2.0,
        ),
    ] {
        for coupling in [Coupling::NodeWise, Coupling::EdgeWise] {
            let mut problem = scalar(coupling);
            problem.funnels = vec![funnel(shape); 5];
            agree(&problem, end, 1e-4, &format!("{} {shape:?}", coupling.kind()));
        }
    }
}

/// After it has closed all states are one, which moves as the emergent dynamics: with equal funnels and
/// linear inputs their mean field.
#[test]
fn a_funnel_that_has_closed_leaves_the_emergent_motion() {
    let mut problem = scalar(Coupling::NodeWise);
    problem.fields =
        [1.0, 2.5, -4.0, 3.0, 0.5].map(|offset| Affine::scalar(-1.0, offset, Vec::new()).into()).to_vec();
    problem.gains = vec![Gain::LocallyLinear { bound: 20.0 }.prepared(); 5];
    problem.funnels = vec![funnel_closing(2_000_000_000, 2.0); 5];
    let solution = solved(&problem, 4.0, 40);
    let mean = problem.x0.iter().sum::<f64>() / 5.0;
    for (k, &t) in solution.times.iter().enumerate() {
        let exact = 0.6 + (mean - 0.6) * math::exp(-t);
        let row = solution.row(&solution.x, k);
        assert!((row.iter().sum::<f64>() / 5.0 - exact).abs() < AGREES, "{t}");
        assert!(t < 2.0 || row.iter().all(|x| (x - exact).abs() < AGREES), "{t}: {row:?} {exact}");
    }
}

fn funnel_closing(at_ns: u64, power: f64) -> Funnel<f64> {
    Funnel { factor: 1.0, shape: Shape::FiniteTime { start: 40.0, at_ns, power } }
}

#[test]
fn a_funnel_that_is_infinite_takes_any_start() {
    let mut problem = scalar(Coupling::NodeWise);
    problem.x0 = vec![3500.0, -2000.0, 6100.0, 400.0, -4700.0];
    problem.funnels = vec![Funnel { factor: 1.0, shape: Shape::ReciprocalTime { scale: 20.0 } }; 5];
    let solution = solved(&problem, 5.0, 50);
    assert_eq!(solution.row(&solution.x, 0), problem.x0);
    assert!(solution.max_ratio < 1.0 && solution.estimate.unwrap().resolved(), "{:?}", solution.estimate);
}

#[test]
fn states_too_near_the_edge_are_not_resolved() {
    let mut problem = scalar(Coupling::EdgeWise);
    let shape = Shape::Exponential { start: 40.0, end: 0.0, rate: 4.0 };
    problem.funnels = vec![Funnel { factor: 1.0, shape }; 5];
    problem.gains = vec![Gain::Logarithmic { scale: 0.01 }; 5];
    let error = solve_coupled(&problem, &[0.0, 10.0], &ReferenceOptions::default(), &mut |_| {
        ControlFlow::Continue(())
    });
    assert!(matches!(error, Err(ReferenceError::Unresolved { .. })), "{error:?}");
}

#[test]
fn malformed_couplings_are_refused() {
    let refused = |change: fn(&mut CoupledProblem)| {
        let mut problem = vector(Coupling::MaxGain);
        change(&mut problem);
        problem.validate().unwrap_err().to_string()
    };
    assert!(refused(|p| p.x0.truncate(9)).contains("x0 has 9 entries where 10"));
    assert!(refused(|p| p.limits.truncate(4)).contains("limits has 4 entries where 5"));
    assert!(refused(|p| p.x0[3] = f64::NAN).contains("x0 of node index 1 is NaN"));
}
