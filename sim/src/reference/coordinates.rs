//! The closed loop in the coordinates (mean of the states, coupling inputs).
//!
//! In the states themselves the problem loses its digits as the funnel narrows: `nu / psi` is a small
//! difference of large numbers over a small one, and a Newton iterate or a rounding error can leave the
//! funnel, where the law is not defined. Here the unknowns are `m = mean(x)` and `u_i = mu_i(nu_i / psi_i)`,
//! and
//!
//! ```text
//! nu_i = psi_i mu_i^-1(u_i),        x = m - L^+ nu,        w_i = f_i(t, x_i) + u_i,
//! m'   = mean(w),
//! (mu_i^-1)'(u_i) u_i' = (1/psi_i) sum_j alpha_ij (w_j - w_i)
//!                        - (psi_i'/psi_i) mu_i^-1(u_i) - beta sigma.
//! ```
//!
//! Any real `u` is inside the funnel, so every iterate and every accepted state is; and `psi -> 0` is an
//! ordinary singular perturbation, the limit being the emergent dynamics. The last term is 0 in the exact
//! solution, where `sigma = sum_j nu_j / sum_j psi_j = 0`; it damps the rounding and truncation errors that
//! would otherwise stay in `sum_j nu_j` while `psi` shrinks below them.

use std::cell::RefCell;

use super::error::ReferenceError;
use super::network::Network;
use super::options::ReferenceOptions;
use super::problem::{
    CoupledProblem, ReferenceProblem, announce, announce_slopes, curvature, inverse, kinks, next_of, slope,
    width,
};
use super::states::States;
use super::unknowns::{Seen, Unknowns};
use crate::extremes::largest;
use funnelnet_law::{Coupling, Gain, GainFunction};

/// Below this relative tolerance rounding errors in the right-hand side stall the step control.
const FINEST: f64 = 2e-13;
/// Local error per step over the error asked for: errors of many steps add up (measured: 10 to 170 times the
/// local tolerance on Example 3 of the paper over 20 s).
pub(super) const LOCAL_SHARE: f64 = 1.0 / 30.0;
/// The largest `|sum nu| / sum psi` that passes for a solution.
const DEFECT: f64 = 1e-5;

/// The right-hand side, its derivative, and the way to and from states.
pub(super) struct System<'a> {
    pub(super) problem: &'a ReferenceProblem,
    pub(super) network: Network,
    /// What [`derivative_times`](Self::derivative_times) needs at a point; asked for once per column.
    point: RefCell<Point>,
}

/// Everything at one `(t, y)`.
#[derive(Default, Clone)]
pub(super) struct Point {
    t: f64,
    y: Vec<f64>,
    /// `psi_i`, in state units.
    pub(super) psi: Vec<f64>,
    /// `nu_i / psi_i`, in (-1, 1).
    pub(super) ratio: Vec<f64>,
    /// `nu_i`, in state units.
    pub(super) nu: Vec<f64>,
    /// `x_i`, in state units.
    pub(super) x: Vec<f64>,
    /// `sum nu / sum psi`.
    pub(super) sigma: f64,
    slope: Vec<f64>,
    beta: f64,
    ratio_rate: Vec<f64>,
    mean_rate: f64,
}

impl<'a> System<'a> {
    pub(super) fn new(problem: &'a ReferenceProblem) -> Self {
        let network = Network::new(problem.x0.len(), &problem.edges);
        Self { problem, network, point: RefCell::default() }
    }

    /// The same loop in its states, for the first instants of a funnel that is infinite at t = 0.
    fn as_states(&self) -> CoupledProblem {
        let ReferenceProblem { x0, edges, fields, gains, funnels } = self.problem.clone();
        let limits = vec![None; x0.len()];
        CoupledProblem {
            coupling: Coupling::NodeWise,
            components: 1,
            x0,
            edges,
            fields,
            gains,
            funnels,
            limits,
        }
    }

    /// Everything at `(t, y)`.
    pub(super) fn at(&self, t: f64, y: &[f64]) -> Point {
        let problem = self.problem;
        let (mean, u) = (y[0], &y[1..]);
        let psi: Vec<f64> = problem.funnels.iter().map(|f| width(f, t)).collect();
        let ratio: Vec<f64> = u.iter().zip(&problem.gains).map(|(&u, gain)| inverse(gain, u)).collect();
        let slope = u.iter().zip(&problem.gains).map(|(&u, gain)| gain.inverse_slope(u)).collect();
        let nu: Vec<f64> = ratio.iter().zip(&psi).map(|(s, psi)| s * psi).collect();
        let mut x = vec![0.0; u.len()];
        self.network.deviations(&nu, &mut x);
        x.iter_mut().for_each(|x| *x += mean);
        let sigma = nu.iter().sum::<f64>() / psi.iter().sum::<f64>();
        let mut point = Point { t, y: y.to_vec(), psi, ratio, nu, x, sigma, slope, ..Point::default() };
        self.rates(&mut point);
        point
    }

    fn rates(&self, p: &mut Point) {
        let problem = self.problem;
        announce(&problem.fields, p.t, &p.x);
        let u = &p.y[1..];
        let push = |i: usize| problem.fields[i].value(p.t, p.x[i]) + u[i];
        let push: Vec<f64> = (0..u.len()).map(push).collect();
        p.mean_rate = push.iter().sum::<f64>() / push.len() as f64;
        p.beta = self.damping(p);
        p.ratio_rate = vec![0.0; u.len()];
        self.network.diffuse(&push, &mut p.ratio_rate);
        for (i, rate) in p.ratio_rate.iter_mut().enumerate() {
            let narrowing = slope(&problem.funnels[i], p.t) / p.psi[i];
            *rate = *rate / p.psi[i] - narrowing * p.ratio[i] - p.beta * p.sigma;
        }
    }

    /// `beta`: as fast as the coupling itself damps disagreement, and faster than any funnel narrows.
    fn damping(&self, p: &Point) -> f64 {
        let problem = self.problem;
        let strength = |i: usize| {
            self.network.degrees[i] * problem.gains[i].slope_at_zero()
                + 2.0 * slope(&problem.funnels[i], p.t).abs()
        };
        (0..p.psi.len()).map(strength).sum::<f64>() / p.psi.iter().sum::<f64>()
    }
    /// The unknowns that give these states at `t` (s).
    fn unknowns(&self, t: f64, x: &[f64]) -> (Vec<f64>, Vec<f64>, Vec<f64>) {
        let problem = self.problem;
        let mut nu = vec![0.0; self.network.nodes()];
        self.network.diffuse(x, &mut nu);
        let ratio: Vec<f64> = nu.iter().zip(&problem.funnels).map(|(nu, f)| nu / width(f, t)).collect();
        let mean = x.iter().sum::<f64>() / x.len() as f64;
        let inputs = ratio.iter().zip(&problem.gains).map(|(&s, gain)| gain.apply(s));
        (std::iter::once(mean).chain(inputs).collect(), nu, ratio)
    }
}

impl Unknowns for System<'_> {
    fn size(&self) -> usize {
        self.network.nodes() + 1
    }

    fn entries(&self) -> usize {
        self.network.nodes()
    }

    fn start(&self, shift: f64) -> Result<(f64, Vec<f64>), ReferenceError> {
        let problem = self.problem;
        let (mut y, nu, ratio) = self.unknowns(0.0, &problem.x0);
        let worst = (0..nu.len()).max_by(|&i, &j| ratio[i].abs().total_cmp(&ratio[j].abs())).unwrap_or(0);
        // Written so that what is not a number is outside.
        let inside = ratio[worst].abs() < 1.0;
        if !inside {
            let psi = problem.funnels[worst].width(0.0);
            let (nu, ratio) = (nu[worst].abs(), ratio[worst].abs());
            return Err(ReferenceError::OutsideAtStart { node: worst, nu, psi, ratio });
        }
        let states = self.as_states();
        let t = States::new(&states).opening();
        if t > 0.0 {
            let x = States::new(&states).states_after_opening(shift);
            return Ok((t, self.unknowns(t, &x).0));
        }
        y[0] += shift;
        Ok((t, y))
    }

    fn before_start(&self, t: f64, shift: f64) -> Seen {
        States::new(&self.as_states()).before_start(t, shift)
    }

    fn seen(&self, t: f64, y: &[f64]) -> Seen {
        let Point { psi, ratio, nu, x, sigma, .. } = self.at(t, y);
        Seen { psi, ratio, nu, x, sigma, u: y[1..].to_vec() }
    }

    fn refuses(&self, seen: &Seen) -> Option<String> {
        // Written so that what is not a number is a defect.
        let closes = seen.sigma.abs() <= DEFECT;
        (!closes).then(|| format!("the diffusive terms add up to {:e} psi instead of 0", seen.sigma))
    }

    /// An error `du` of an input is one of `psi du / mu'(s)` in `nu`, and at most `deviation_gain` times that
    /// in a state.
    fn tolerances(&self, options: &ReferenceOptions, t: f64, y: &[f64]) -> (f64, Vec<f64>) {
        let tolerance = options.tolerance * LOCAL_SHARE;
        let reach = self.network.deviation_gain().max(1e-3);
        let point = self.at(t, y);
        let scale = 1.0 + largest(0.0, point.x.iter().map(|x| x.abs()));
        let slack = |psi: f64| (scale / (psi * reach)).min(1.0);
        let relative = (tolerance * slack(self.widest(t) / 4.0)).max(FINEST);
        let input = |(gain, &psi): (&Gain<f64>, &f64)| {
            let wanted = tolerance * slack(psi);
            gain.slope_at_zero() * wanted.max(FINEST)
        };
        let inputs = self.problem.gains.iter().zip(&point.psi).map(input);
        (relative, std::iter::once(tolerance).chain(inputs).collect())
    }

    fn widest(&self, t: f64) -> f64 {
        largest(0.0, self.problem.funnels.iter().map(|f| width(f, t)))
    }

    fn next_kink(&self, t: f64) -> Option<f64> {
        next_of(kinks(&self.problem.funnels), t)
    }

    fn derivative(&self, t: f64, y: &[f64], out: &mut [f64]) {
        let point = self.at(t, y);
        out[0] = point.mean_rate;
        for (out, (rate, slope)) in out[1..].iter_mut().zip(point.ratio_rate.iter().zip(&point.slope)) {
            *out = rate / slope;
        }
    }

    /// Cheap for a `v` with few non-zero entries.
    fn derivative_times(&self, t: f64, y: &[f64], v: &[f64], out: &mut [f64]) {
        let mut cached = self.point.borrow_mut();
        if cached.t != t || cached.y != y {
            *cached = self.at(t, y);
        }
        let p = &*cached;
        let problem = self.problem;
        let nodes = p.psi.len();
        let nu: Vec<f64> = (0..nodes).map(|i| p.psi[i] * p.slope[i] * v[i + 1]).collect();
        let mut push = vec![0.0; nodes];
        self.network.deviations(&nu, &mut push);
        announce_slopes(&problem.fields, t, &p.x);
        for i in 0..nodes {
            push[i] = problem.fields[i].slope(t, p.x[i]) * (push[i] + v[0]) + v[i + 1];
        }
        out[0] = push.iter().sum::<f64>() / nodes as f64;
        let sigma = nu.iter().sum::<f64>() / p.psi.iter().sum::<f64>();
        self.network.diffuse(&push, &mut out[1..]);
        for i in 0..nodes {
            let narrowing = slope(&problem.funnels[i], t) / p.psi[i];
            let rate = out[i + 1] / p.psi[i] - narrowing * p.slope[i] * v[i + 1] - p.beta * sigma;
            let bend = p.ratio_rate[i] * curvature(&problem.gains[i], y[i + 1]) * v[i + 1];
            out[i + 1] = (rate - bend) / p.slope[i];
        }
    }
}

#[cfg(test)]
mod tests {
    use super::super::examples;
    use super::*;

    #[test]
    fn the_start_gives_the_initial_states_back() {
        let problem = examples::five_agents(examples::ring(5), 0.02);
        let system = System::new(&problem);
        let start = system.start(0.0).unwrap().1;
        let x = system.at(0.0, &start).x;
        assert!(x.iter().zip(&problem.x0).all(|(a, b)| (a - b).abs() < 1e-13), "{x:?}");
    }

    #[test]
    fn the_derivative_is_the_one_of_the_right_hand_side() {
        let mut problem = examples::five_agents(examples::star(5), 0.5);
        problem.gains[2] = funnelnet_law::Gain::Logarithmic { scale: 2.0 };
        let system = System::new(&problem);
        let y: Vec<f64> = vec![0.3, 4.0, -2.0, 0.7, 1.5, -9.0];
        for column in 0..system.size() {
            let mut v = vec![0.0; system.size()];
            v[column] = 1.0;
            let mut analytic = v.clone();
            system.derivative_times(1.3, &y, &v, &mut analytic);
            let shifted = |h: f64| {
                let mut at = y.clone();
                at[column] += h;
                let mut out = at.clone();
                system.derivative(1.3, &at, &mut out);
                out
            };
            let (above, below) = (shifted(1e-6), shifted(-1e-6));
            for i in 0..system.size() {
                let numeric = (above[i] - below[i]) / 2e-6;
                assert!((numeric - analytic[i]).abs() < 1e-6 * (1.0 + numeric.abs()), "{column} {i}");
            }
        }
    }
}
