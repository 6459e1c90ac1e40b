//! One node of the network that is followed.

use super::Bounds;
use crate::extremes::{larger, largest};
use crate::scenario::{Coupling, NodeSpec, Scenario};
use funnelnet_law::floor::Floor;
use funnelnet_law::funnel::{Guard, Widths};
use funnelnet_law::gain::{Gain, GainFunction};
use funnelnet_law::law::LambdaTracker;
use funnelnet_law::law::max_gain::{self, Term};
use funnelnet_law::law::node_wise::{Constants, Memory, NodeWise, THETA};
use funnelnet_law::start::{PARTS, Pace};

/// By how much a floor has to be above a funnel so that the f32 of a node, which rounds elsewhere, is above
/// it as well.
const SURELY: f64 = 1.05;

/// One component.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Part {
    pub x: f64,
    /// Its change over the last tick.
    pub dx: f64,
    /// Its field, in the middle of the last step.
    pub f: f64,
    /// What the diffusive term is.
    pub truth: f64,
    /// What the node believes that it is, and its change.
    pub nu: f64,
    pub dnu: f64,
    /// Whether they do not follow from those of the last tick.
    pub is_disturbed: bool,
    u: f64,
    /// What its edges ask for, with edge-wise coupling (state units / s).
    pushed: f64,
    /// Its gain, with a lambda-tracker (1/s).
    k: f64,
    /// The right side of (*), with weakly-centralised coupling (state units).
    r: f64,
    pub memory: Memory<f64>,
}

/// A node.
pub(super) struct Member<'s> {
    node: &'s NodeSpec,
    coupling: Coupling<f64>,
    tick: f64,
    /// Steps of the field in a tick.
    round: u8,
    pace: Pace,
    guard: Guard<f64>,
    /// The largest `|u|` (state units / s).
    limit: f64,
    law: NodeWise<f64, Gain<f64>>,
    tracker: Option<LambdaTracker<f64>>,
    /// The largest gain of all nodes, with weakly-centralised coupling (1/s times state units).
    common: f64,
    floor: Floor<f64>,
    pub parts: Vec<Part>,
    /// The largest `|x|` that it sees.
    seen: f64,
    /// The funnel that it keeps, at least (state units).
    kept: f64,
    /// The widest floor of its edges, with edge-wise coupling (state units).
    edge_floor: f64,
    /// The state half a tick on.
    middle: Vec<f64>,
}

impl<'s> Member<'s> {
    pub fn new(scenario: &Scenario, node: &'s NodeSpec, degree: f64, bounds: Bounds) -> Self {
        let tick = scenario.time.tick_s();
        let gain = node.gain.prepared();
        // A tracker starts from the slope of its linear gain.
        let part = |&x: &f64| Part { x, k: gain.apply(1.0), ..Part::default() };
        Self {
            node,
            coupling: scenario.coupling,
            tick,
            law: NodeWise::with(gain, tick, degree, Constants::damped_by(node.damping)),
            tracker: match scenario.coupling {
                Coupling::LambdaTracker { eta } => Some(LambdaTracker::new(eta, tick)),
                _ => None,
            },
            common: 0.0,
            guard: match scenario.time.start.slow_ticks() {
                0 => Guard::new(scenario.guard),
                ticks => Guard::grown_over(scenario.guard, ticks),
            },
            round: scenario.time.round,
            pace: Pace::default(),
            limit: bounds.input.unwrap_or(f64::INFINITY),
            floor: Floor::of_f32(degree, tick),
            parts: node.state.iter().map(part).collect(),
            seen: 0.0,
            kept: 0.0,
            edge_floor: 0.0,
            middle: vec![0.0; node.state.len()],
        }
    }

    /// Of a new tick nothing is known yet but its pace.
    pub fn begin(&mut self, pace: Pace) {
        (self.seen, self.edge_floor) = (0.0, 0.0);
        if pace != self.pace {
            if self.pace == Pace::Slow {
                self.parts.iter_mut().for_each(|part| part.dx *= f64::from(PARTS));
            }
            self.parts.iter_mut().for_each(|part| part.memory.disturb());
            self.law.keep_pace(pace);
            self.pace = pace;
        }
        for part in &mut self.parts {
            (part.truth, part.nu, part.dnu, part.pushed) = (0.0, 0.0, 0.0, 0.0);
            self.seen = larger(self.seen, part.x.abs());
        }
    }

    /// What a neighbour really is.
    pub fn hears_truth(&mut self, component: usize, weight: f64, other: Part) {
        let part = &mut self.parts[component];
        part.truth += weight * (other.x - part.x);
        part.nu += weight * (other.x - part.x);
        part.dnu += weight * (other.dx - part.dx);
        self.seen = larger(self.seen, other.x.abs());
    }

    /// The same of one of its edges, with the input that it asks for (state units / s) and its floor (state
    /// units).
    pub fn takes_edge(&mut self, component: usize, nu: f64, u: f64, floor: f64) {
        let part = &mut self.parts[component];
        part.pushed += u;
        part.truth = larger(part.truth, nu.abs());
        self.edge_floor = larger(self.edge_floor, floor);
    }

    /// Its funnel at `t` (s), before flooring (state units).
    pub fn width(&self, t: f64) -> f64 {
        self.node.funnel.width(t)
    }

    /// Whether rounding makes it keep a funnel that is clearly wider than the scenario's at `t` (s), and than
    /// `accepted` (state units).
    pub fn floors(&self, t: f64, accepted: f64) -> bool {
        self.kept > SURELY * larger(self.node.funnel.width(t), accepted)
    }

    /// The largest `|nu| / psi`; the funnel is the scenario's, or what the node and the designer do not go
    /// below.
    pub fn ratio(&mut self, t: f64, asked: f64) -> f64 {
        let input = largest(0.0, self.parts.iter().map(|part| part.u.abs()));
        self.kept = match self.coupling {
            Coupling::EdgeWise => self.edge_floor,
            _ => self.floor.width(self.seen, input),
        };
        let psi = larger(larger(self.node.funnel.width(t), self.kept), asked);
        largest(0.0, self.parts.iter().map(|part| part.truth.abs() / psi))
    }

    /// Length of a tick (s), and the part of it that the funnel of the law is ahead.
    fn stride(&self) -> (f64, f64) {
        match self.pace {
            Pace::Slow => (self.tick / f64::from(PARTS), 1.0),
            Pace::Damped => (self.tick, 1.0),
            Pace::Usual => (self.tick, THETA),
        }
    }

    /// The funnel that the law keeps at tick `k`, at `t` (s).
    fn psi(&self, k: u64, t: f64) -> Widths<f64> {
        let (period, theta) = self.stride();
        let psi = Widths { now: self.width(t), ahead: self.width(t + theta * period) }.floored(self.kept);
        // As a node, which counts its ticks in 32 bits.
        self.guard.of(k as u32, psi)
    }

    /// Weakly-centralised coupling: the gain `|u| / |s|` that the node would use by itself (1/s times state
    /// units).
    pub fn own_gain(&mut self, k: u64, t: f64) -> f64 {
        let (psi, gain, b) = (self.psi(k, t), self.law.gain, self.law.b());
        let of = |part: &mut Part| {
            if k == 0 {
                part.u = gain.solve(psi.ahead, b, part.nu).u;
            }
            part.r = part.nu + THETA * part.dnu + b * part.u;
            let solution = gain.solve(psi.ahead, b, part.r);
            if solution.s == 0.0 { gain.inverse_slope(0.0).recip() } else { (solution.u / solution.s).abs() }
        };
        largest(0.0, self.parts.iter_mut().map(of))
    }

    /// Weakly-centralised coupling: the largest of these gains.
    pub fn takes_common(&mut self, gain: f64) {
        self.common = gain;
    }

    /// The inputs of a tick at time `t` (s), and one midpoint step; gives the largest `|u|`.
    pub fn advance(&mut self, k: u64, t: f64) -> f64 {
        let psi = self.psi(k, t);
        self.ask(psi);
        for part in &mut self.parts {
            let bounded = part.u.clamp(-self.limit, self.limit);
            let applied = self.node.limits.map_or(bounded, |limits| bounded.clamp(limits.low, limits.high));
            // NaN stays what it is.
            if applied != part.u && !part.u.is_nan() {
                part.u = applied;
                part.memory.feed_back(applied);
            }
        }
        // `dx` holds the state before, until it is the change.
        self.parts.iter_mut().for_each(|part| part.dx = part.x);
        let step = self.stride().0 / f64::from(self.round);
        for part in 0..self.round {
            self.step(t + f64::from(part) * step, step);
        }
        self.parts.iter_mut().for_each(|part| part.dx = part.x - part.dx);
        largest(0.0, self.parts.iter().map(|part| part.u.abs()))
    }

    /// The input of every component, before it is bounded.
    fn ask(&mut self, psi: Widths<f64>) {
        match self.coupling {
            Coupling::EdgeWise => self.parts.iter_mut().for_each(|part| part.u = part.pushed),
            Coupling::None => {}
            Coupling::WeaklyCentralised => {
                let scale = psi.ahead / self.common + self.law.b();
                self.parts.iter_mut().for_each(|part| part.u = part.r / scale);
            }
            Coupling::LambdaTracker { .. } => {
                let Some(tracker) = self.tracker else { return };
                for part in &mut self.parts {
                    part.u = tracker.step(&self.law, &mut part.memory, &mut part.k, part.nu, part.dnu);
                }
            }
            Coupling::MaxGain if self.parts.len() > 1 => {
                let term = |part: &Part| Term { nu: part.nu, dnu: part.dnu, u: part.u, memory: part.memory };
                let mut terms: Vec<_> = self.parts.iter().map(term).collect();
                max_gain::step(&self.law, &mut terms, psi);
                for (part, term) in self.parts.iter_mut().zip(&terms) {
                    (part.u, part.memory) = (term.u, term.memory);
                }
            }
            _ => {
                for part in &mut self.parts {
                    part.u = self.law.step(&mut part.memory, part.nu, part.dnu, psi).u;
                }
            }
        }
    }

    fn step(&mut self, t: f64, tick: f64) {
        let (field, half) = (&self.node.dynamics, 0.5 * tick);
        // Room for the largest state.
        let mut now = [0.0; funnelnet_law::field::MAX_COMPONENTS];
        now.iter_mut().zip(&self.parts).for_each(|(slot, part)| *slot = part.x);
        let now = &now[..self.parts.len().min(funnelnet_law::field::MAX_COMPONENTS)];
        for (component, part) in self.parts.iter().enumerate() {
            self.middle[component] = part.x + half * (field.component(component, t, now) + part.u);
        }
        for (component, part) in self.parts.iter_mut().enumerate() {
            part.f = field.component(component, t + half, &self.middle);
            part.x += tick * (part.f + part.u);
        }
    }
}
