//! Plots of real runs. With `GALLERY=folder` in the environment they are left there to be looked at.

use super::*;
use crate::record::Row;
use crate::reference::examples::{five_agents, narrow_path, ring};
use crate::reference::{Funnel, Gain, ReferenceProblem, solve};

/// The emergent vector field: the root `h` of `sum_i psi_i mu_i^-1(h - f_i(t, xi)) = 0`.
fn emergent(problem: &ReferenceProblem, t: f64, xi: f64) -> f64 {
    let fields: Vec<f64> = problem.fields.iter().map(|f| f.value(t, xi)).collect();
    let sum = |h: f64| -> f64 {
        let term = |i: usize| problem.funnels[i].width(t) * problem.gains[i].inverse(h - fields[i]);
        (0..fields.len()).map(term).sum()
    };
    let (mut low, mut high) = (-1e4, 1e4);
    for _ in 0..60 {
        let middle = 0.5 * (low + high);
        if sum(middle) < 0.0 { low = middle } else { high = middle }
    }
    0.5 * (low + high)
}

fn trace(title: &str, problem: &ReferenceProblem, end: f64, rows: usize) -> Trace {
    let times: Vec<f64> = (0..=rows).map(|k| end * k as f64 / rows as f64).collect();
    let solution = solve(problem, &times, &Default::default()).unwrap();
    let mut xi = problem.x0.iter().sum::<f64>() / problem.x0.len() as f64;
    let mut trace = Trace::new(title);
    let step = end / rows as f64;
    for (k, &t) in times.iter().enumerate() {
        let row = |table| solution.row(table, k).to_vec();
        let (x, nu, psi) = (row(&solution.x), row(&solution.nu), row(&solution.psi));
        trace.push(&Row {
            t,
            x,
            nu,
            psi,
            u: row(&solution.u),
            xi: vec![xi],
            blended: vec![0.5 * xi],
            ..Row::default()
        });
        let half = xi + 0.5 * step * emergent(problem, t, xi);
        xi += step * emergent(problem, t + 0.5 * step, half);
    }
    trace
}

fn keep(name: &str, svg: &str) {
    if let Some(folder) = std::env::var_os("GALLERY") {
        std::fs::write(std::path::Path::new(&folder).join(name), svg).unwrap();
    }
}

/// Both plots of a run.
fn draw(name: &str, trace: &Trace) -> (String, String) {
    let (states, funnels) = (states_svg(trace).unwrap(), funnels_svg(trace).unwrap());
    keep(&format!("{name}-states.svg"), &states);
    keep(&format!("{name}-funnels.svg"), &funnels);
    (states, funnels)
}

/// Points of all polylines of a drawing, the longest first.
fn lengths(svg: &str) -> Vec<usize> {
    let points = svg.split("points=\"").skip(1).filter_map(|rest| rest.split('"').next());
    let mut lengths: Vec<usize> = points.map(|p| p.split_whitespace().count()).collect();
    lengths.sort_by(|a, b| b.cmp(a));
    lengths
}

#[test]
fn five_agents_are_drawn_whole_and_thin() {
    let problem = five_agents(ring(5), 2.0);
    let (states, funnels) = draw("five", &trace("Five heterogeneous agents on a ring", &problem, 20.0, 8000));
    for label in ["node 1", "node 5", "emergent", "blended", "time t in s", "state x in state units"] {
        assert!(states.contains(label), "{label}");
    }
    assert_eq!(funnels.matches("largest |").count(), 5);
    assert!(lengths(&states)[4] > 1500 && lengths(&states)[0] <= thin::POINTS, "{:?}", lengths(&states));
    assert!(!states.contains("NaN") && !funnels.contains("NaN"));
}

#[test]
fn narrow_funnels_get_a_logarithmic_axis() {
    let (_, wide) = draw("five-narrow", &trace("0.02 + 38 exp(-t)", &five_agents(ring(5), 0.02), 20.0, 2000));
    assert!(wide.contains("0.01"));
    let (_, path) = draw("path", &trace("Path of 11, 1200 exp(-t)", &narrow_path(), 30.0, 2000));
    assert!(path.contains("1e\u{2212}11"), "decades down to the end of the funnel");
    assert_eq!(path.matches("largest |").count(), 11);
}

#[test]
fn a_crowd_is_drawn_alike_and_the_twelve_nearest_to_the_boundary_have_panels() {
    let mut problem = five_agents(ring(5), 2.0);
    problem.x0 = (0..30).map(|i| f64::from(i % 7)).collect();
    problem.edges = ring(30);
    problem.fields = (0..30).map(|i| problem.fields[i % 5].clone()).collect();
    problem.gains = vec![Gain::Reciprocal { scale: 1.0 }; 30];
    problem.funnels = vec![Funnel::Constant { width: 20.0, factor: 1.0 }; 30];
    let (states, funnels) = draw("crowd", &trace("Thirty agents", &problem, 5.0, 500));
    assert!(states.contains("30 nodes") && !states.contains("node 1"));
    assert!(funnels.contains("the 12 of 30 nodes nearest to the boundary"));
    assert_eq!(funnels.matches("largest |").count(), 12);
}

#[test]
fn nothing_to_show_is_an_error() {
    assert!(states_svg(&Trace::new("empty")).is_err());
    let mut single = Trace::new("one row");
    single.push(&Row { x: vec![1.0], nu: vec![0.0], psi: vec![1.0], ..Row::default() });
    assert!(funnels_svg(&single).is_err());
}
