//! The closed loop in the states themselves, for every coupling.
//!
//! A state outside its funnel can be written down here, and a solver's iterates go there. So `mu` goes on
//! beyond [`EDGE`] on its tangent: increasing still, and never used by a solution, since a step that ends
//! there is refused, unless the input is at a limit there. Digits of `nu / psi` are lost as the funnel
//! narrows; the node-wise law of scalar states has better unknowns (`coordinates.rs`).

use super::coordinates::LOCAL_SHARE;
use super::error::ReferenceError;
use super::options::ReferenceOptions;
use super::problem::{CoupledProblem, announce, kinks, next_of, width};
use super::unknowns::{Seen, Unknowns};
use crate::extremes::{larger, largest};
use funnelnet_law::{Coupling, Gain, GainFunction};

/// The ratio up to which `mu` is itself.
const EDGE: f64 = 1.0 - 1e-7;
/// Step of a difference quotient, relative to the unknowns.
const QUOTIENT: f64 = 1e-7;
/// Steps through the first instants of a funnel that is infinite at t = 0, and the longest that they are, s.
const OPENING_STEPS: usize = 200;
const OPENING: f64 = 1e-3;
/// The largest gain of a lambda-tracker, as in the law (1/s).
const STEEPEST: f64 = 1e30;

/// The unknowns are the states, by node and then by component, and with a lambda-tracker their gains.
pub(super) struct States<'a> {
    problem: &'a CoupledProblem,
}

impl<'a> States<'a> {
    pub(super) fn new(problem: &'a CoupledProblem) -> Self {
        Self { problem }
    }

    fn tracks(&self) -> bool {
        matches!(self.problem.coupling, Coupling::LambdaTracker { .. })
    }

    /// `sum_j alpha_ij (x_j - x_i)`, by differences so that nearly equal states keep their digits.
    fn diffuse(&self, x: &[f64]) -> Vec<f64> {
        let mut nu = vec![0.0; x.len()];
        self.over_edges(x, |at, term| nu[at] += term);
        nu
    }

    /// Calls with the place of a component of a node and the term of one of its edges.
    fn over_edges(&self, x: &[f64], mut each: impl FnMut(usize, f64)) {
        let n = self.problem.components;
        for &(i, j, weight) in &self.problem.edges {
            for component in 0..n {
                let (a, b) = (i * n + component, j * n + component);
                let term = weight * (x[b] - x[a]);
                each(a, term);
                each(b, -term);
            }
        }
    }

    /// Diffusive terms as they are judged, ratios and inputs at `(t, y)`.
    fn terms(&self, t: f64, y: &[f64]) -> Seen {
        let (problem, n) = (self.problem, self.problem.components);
        let x = &y[..self.entries()];
        let psi: Vec<f64> = (0..x.len()).map(|at| width(&problem.funnels[at / n], t)).collect();
        let mut nu = self.diffuse(x);
        let ratio = |nu: &[f64]| -> Vec<f64> { nu.iter().zip(&psi).map(|(nu, psi)| nu / psi).collect() };
        let gain = |at: usize| &problem.gains[at / n];
        let s = ratio(&nu);
        let mut u: Vec<f64> = match problem.coupling {
            Coupling::NodeWise | Coupling::ElementWise | Coupling::Linear => {
                (0..x.len()).map(|at| push(gain(at), s[at], nu[at])).collect()
            }
            Coupling::MaxGain => {
                let of_node = |at: usize| largest(0.0, s[at / n * n..][..n].iter().map(|s| s.abs()));
                (0..x.len()).map(|at| slope_of_chord(gain(at), of_node(at)) * s[at]).collect()
            }
            Coupling::WeaklyCentralised => {
                let common = largest(0.0, (0..x.len()).map(|at| slope_of_chord(gain(at), s[at].abs())));
                s.iter().map(|s| common * s).collect()
            }
            Coupling::LambdaTracker { .. } => nu.iter().zip(&y[x.len()..]).map(|(nu, k)| k * nu).collect(),
            Coupling::EdgeWise => {
                let (mut u, mut worst) = (vec![0.0; x.len()], vec![0.0f64; x.len()]);
                self.over_edges(x, |at, term| {
                    u[at] += push(gain(at), term / psi[at], term);
                    if term.abs() > worst[at].abs() {
                        worst[at] = term;
                    }
                });
                // What the funnels are about.
                nu = worst;
                u
            }
            Coupling::None => vec![0.0; x.len()],
        };
        for (at, u) in u.iter_mut().enumerate() {
            if let Some((low, high)) = problem.limits[at / n] {
                *u = u.max(low).min(high);
            }
        }
        Seen { x: x.to_vec(), ratio: ratio(&nu), nu, psi, u, sigma: 0.0 }
    }

    /// The states at `t` from those at 0, by the classical Runge-Kutta method: for the first instants of a
    /// funnel that is infinite at 0.
    fn opened(&self, t: f64, shift: f64) -> Vec<f64> {
        let add =
            |y: &[f64], k: &[f64], h: f64| -> Vec<f64> { y.iter().zip(k).map(|(y, k)| y + h * k).collect() };
        let mut y: Vec<f64> = self.problem.x0.iter().map(|x| x + shift).collect();
        if self.tracks() {
            let n = self.problem.components;
            y.extend((0..self.entries()).map(|at| self.problem.gains[at / n].slope_at_zero()));
        }
        let rate = |t: f64, y: &[f64]| {
            let mut out = vec![0.0; y.len()];
            self.derivative(t, y, &mut out);
            out
        };
        let h = t / OPENING_STEPS as f64;
        for k in (0..OPENING_STEPS).filter(|_| t > 0.0) {
            let at = k as f64 * h;
            let a = rate(at, &y);
            let b = rate(at + 0.5 * h, &add(&y, &a, 0.5 * h));
            let c = rate(at + 0.5 * h, &add(&y, &b, 0.5 * h));
            let d = rate(at + h, &add(&y, &c, h));
            for (y, (((a, b), c), d)) in y.iter_mut().zip(a.iter().zip(&b).zip(&c).zip(&d)) {
                *y += h / 6.0 * (a + 2.0 * (b + c) + d);
            }
        }
        y
    }

    /// Where funnels that are infinite at t = 0 have come down to some ten times what they have to hold; 0
    /// where there is none, s.
    pub(super) fn opening(&self) -> f64 {
        let problem = self.problem;
        let most = 1.0 + largest(0.0, self.diffuse(&problem.x0).iter().map(|nu| nu.abs()));
        let open = problem.funnels.iter().filter(|funnel| funnel.width(0.0).is_infinite());
        // `width` falls as 1 / t.
        let ends = open.map(|funnel| (0.1 * funnel.width(1.0) / most).min(OPENING));
        let first = ends.fold(f64::INFINITY, f64::min);
        if first.is_finite() { first } else { 0.0 }
    }

    /// The states where it ends, for other unknowns to go on from.
    pub(super) fn states_after_opening(&self, shift: f64) -> Vec<f64> {
        let mut y = self.opened(self.opening(), shift);
        y.truncate(self.entries());
        y
    }
}

/// `mu(s)`, on its tangent beyond the edge; a linear gain takes `nu` itself.
fn push(gain: &Gain<f64>, s: f64, nu: f64) -> f64 {
    if !gain.keeps_funnels() {
        return gain.apply(nu);
    }
    let beyond = s.abs() - EDGE;
    if beyond > 0.0 {
        let last = gain.apply(EDGE);
        return (last + beyond / gain.inverse_slope(last)).copysign(s);
    }
    gain.apply(s)
}

/// `gamma(s) = mu(s) / s` for `s >= 0`.
fn slope_of_chord(gain: &Gain<f64>, s: f64) -> f64 {
    if s > 0.0 { push(gain, s, s) / s } else { gain.slope_at_zero() }
}

impl Unknowns for States<'_> {
    fn size(&self) -> usize {
        self.entries() * if self.tracks() { 2 } else { 1 }
    }

    fn entries(&self) -> usize {
        self.problem.x0.len()
    }

    fn start(&self, shift: f64) -> Result<(f64, Vec<f64>), ReferenceError> {
        let y = self.opened(0.0, shift);
        let seen = self.terms(0.0, &y);
        let kept = (0..seen.ratio.len()).filter(|at| !self.problem.may_leave(at / self.problem.components));
        let worst = kept.max_by(|&i, &j| seen.ratio[i].abs().total_cmp(&seen.ratio[j].abs()));
        if let Some(worst) = worst.filter(|&worst| seen.ratio[worst].abs() >= EDGE) {
            let (nu, psi, ratio) = (seen.nu[worst].abs(), seen.psi[worst], seen.ratio[worst].abs());
            let node = worst / self.problem.components;
            return Err(ReferenceError::OutsideAtStart { node, nu, psi, ratio });
        }
        let t = self.opening();
        Ok((t, if t > 0.0 { self.opened(t, shift) } else { y }))
    }

    fn before_start(&self, t: f64, shift: f64) -> Seen {
        self.terms(t, &self.opened(t, shift))
    }

    fn derivative(&self, t: f64, y: &[f64], out: &mut [f64]) {
        let (problem, n) = (self.problem, self.problem.components);
        let seen = self.terms(t, y);
        announce(&problem.fields, t, &y[..self.entries()]);
        for (node, field) in problem.fields.iter().enumerate() {
            let x = &y[node * n..][..n];
            for component in 0..n {
                let at = node * n + component;
                out[at] = field.component(component, t, x) + seen.u[at];
            }
        }
        if let Coupling::LambdaTracker { eta } = problem.coupling {
            let (states, gains) = y.split_at(self.entries());
            for (at, (nu, k)) in self.diffuse(states).iter().zip(gains).enumerate() {
                let grows = nu.abs() * (nu.abs() - eta).max(0.0);
                out[states.len() + at] = if *k < STEEPEST { grows } else { 0.0 };
            }
        }
    }

    /// A difference quotient: kinks of maxima have no derivative, and Newton's method needs no more.
    fn derivative_times(&self, t: f64, y: &[f64], v: &[f64], out: &mut [f64]) {
        let size = largest(0.0, v.iter().map(|v| v.abs()));
        if size == 0.0 {
            out.fill(0.0);
            return;
        }
        let moved = v.iter().zip(y).filter(|(v, _)| **v != 0.0).map(|(_, y)| y.abs());
        let h = QUOTIENT * larger(1.0, largest(0.0, moved)) / size;
        let shifted = |h: f64| -> Vec<f64> { y.iter().zip(v).map(|(y, v)| y + h * v).collect() };
        let mut below = vec![0.0; y.len()];
        self.derivative(t, &shifted(h), out);
        self.derivative(t, &shifted(-h), &mut below);
        out.iter_mut().zip(below).for_each(|(out, below)| *out = (*out - below) / (2.0 * h));
    }

    fn seen(&self, t: f64, y: &[f64]) -> Seen {
        self.terms(t, y)
    }

    fn refuses(&self, seen: &Seen) -> Option<String> {
        let kept = seen
            .ratio
            .iter()
            .enumerate()
            .filter(|(at, _)| !self.problem.may_leave(at / self.problem.components));
        let most = largest(0.0, kept.map(|(_, s)| s.abs()));
        let inside = most < EDGE;
        (!inside)
            .then(|| format!("a diffusive term is {most} of its funnel, closer than states in f64 can tell"))
    }

    fn tolerances(&self, options: &ReferenceOptions, _: f64, _: &[f64]) -> (f64, Vec<f64>) {
        let tolerance = options.tolerance * LOCAL_SHARE;
        (tolerance, vec![tolerance; self.size()])
    }

    fn widest(&self, _: f64) -> f64 {
        f64::INFINITY
    }

    fn next_kink(&self, t: f64) -> Option<f64> {
        next_of(kinks(&self.problem.funnels), t)
    }
}
