//! What a run is judged by: the true states of all nodes, and the funnel of the scenario
//! (docs/notes/2026-11-28-verdicts.md).
//!
//! A node believes what it hears. On a bus that delivers nothing it believes that its diffusive term is zero,
//! and in a funnel that it has widened for itself that it is inside. So neither enters here: the terms are
//! those of the states at equal true time, over the edges of the scenario, and the funnel is the scenario's,
//! not narrower than the floor that the scenario accepts.

mod account;
mod by_event;
mod checks;
mod counters;
mod recovery;
mod reference;
mod truth;
mod windows;

pub use account::Accounts;
pub use by_event::{EventFigures, Recovered};
pub use checks::{AbsenceSummary, Account, Check, Evidence, Stop, checks, missed};
pub use counters::CounterSummary;
pub use recovery::DuringEvents;
pub use reference::ReferenceSummary;
pub use windows::WindowFigures;

use crate::extremes::{larger, largest, smallest};
use crate::presence::Presence;
use crate::scenario::{Coupling, FloorSpec, Scenario};
use by_event::ByEvent;
use funnelnet_law::floor::Floor;
use recovery::Recovery;
use truth::Truth;
use windows::Windows;

/// What is known of the network at a tick, by index and then by component.
#[derive(Clone, Copy, Debug)]
pub struct Moment<'a> {
    /// The tick.
    pub k: u64,
    /// Steps of the nodes' own fields since then: 0 but between two ticks of a network that decides in
    /// rounds.
    pub part: u8,
    /// States, state units; those of nodes that are not known are not looked at.
    pub x: &'a [f64],
    /// Inputs that were applied, state units / s.
    pub u: &'a [f64],
    /// By index.
    pub presence: &'a [Presence],
}

/// Figures of the judge over a whole run.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Findings {
    /// The largest `|nu| / psi`; NaN where one was not a number.
    pub max_ratio: f64,
    /// Node-ticks with `|nu| >= psi`, or with a term that is not a number; per component.
    pub breaches: u64,
    /// Node-ticks of which the term is not known, since a state in it is not; per component.
    pub unknown: u64,
    /// Node-ticks of nodes without a neighbour that is there: there is no term to be judged; per component.
    pub uncoupled: u64,
    /// Node-ticks that were judged; per component.
    pub judged: u64,
    /// First tick with a breach, and the index of its node.
    pub first_breach: Option<(u64, usize)>,
    /// The largest `max x - min x` at any tick, state units; none where two nodes were never known at one
    /// tick.
    pub max_spread: Option<f64>,
    /// The same at the last tick; none where one of the nodes that are on is not known there, or is alone.
    pub final_spread: Option<f64>,
    /// The largest `|u|`, state units / s; none where no node ran a tick.
    pub max_input: Option<f64>,
    /// What was found at ticks that events disturb, and is not in the figures above; none where nothing is
    /// expected of the recovery.
    pub during_events: Option<DuringEvents>,
    /// Longest time from the end of an event to the last tick outside, s; none where it is not asked for or
    /// not known.
    pub recovered_s: Option<f64>,
    /// By event of the scenario, in the order of time.
    pub events: Vec<EventFigures>,
    /// States at the end, by index and then by component; NaN where one is not known.
    pub last: Vec<f64>,
    /// Nodes that an event keeps off, by index.
    pub off: Vec<bool>,
    /// By window of the scenario, in its order.
    pub windows: Vec<WindowFigures>,
    /// The same figures of each node, by index and then by component.
    pub worst: Vec<Worst>,
}

/// Figures of one component of one node.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Worst {
    /// Its largest `|nu| / psi`; NaN where one was not a number.
    pub max_ratio: f64,
    /// Ticks with `|nu| >= psi`, or with a term that is not a number.
    pub breaches: u64,
    /// Ticks of which the term is not known.
    pub unknown: u64,
    /// Ticks without a neighbour that was there.
    pub uncoupled: u64,
    /// Ticks that were judged.
    pub judged: u64,
}

impl Worst {
    /// Takes the ratio of a tick, where it is known, and says whether it is a breach.
    pub fn take(&mut self, ratio: Option<f64>) -> bool {
        let Some(ratio) = ratio else {
            self.unknown += 1;
            return false;
        };
        // Not a number is outside.
        let breach = ratio.is_nan() || ratio >= 1.0;
        self.max_ratio = larger(self.max_ratio, ratio);
        self.breaches += u64::from(breach);
        self.judged += 1;
        breach
    }
}

/// Judges a run tick by tick.
pub struct Judge<'a> {
    scenario: &'a Scenario,
    truth: Truth,
    /// What the f32 of each node resolves, by index; with edge-wise coupling that of its steepest edge.
    floors: Vec<Floor<f64>>,
    windows: Windows<'a>,
    recovery: Option<Recovery>,
    by_event: Option<ByEvent>,
    findings: Findings,
    /// Of the last tick, by index and then by component: true terms, NaN where they are not known.
    terms: Vec<f64>,
    /// The funnels that they are judged by.
    psi: Vec<f64>,
}

impl<'a> Judge<'a> {
    /// Judge of a run of `scenario`.
    #[must_use]
    pub fn new(scenario: &'a Scenario) -> Self {
        let entries = scenario.nodes.len() * scenario.components();
        let recovery = Recovery::of(scenario);
        let during_events = recovery.as_ref().map(|_| DuringEvents::default());
        let worst = vec![Worst::default(); entries];
        Self {
            scenario,
            truth: Truth::of(scenario),
            floors: floors(scenario),
            windows: Windows::of(scenario),
            recovery,
            by_event: ByEvent::of(scenario),
            findings: Findings { worst, during_events, ..Findings::default() },
            terms: vec![f64::NAN; entries],
            psi: vec![f64::NAN; entries],
        }
    }

    /// Judges a tick. `reference` has the continuous-time states at it, where there are some.
    pub fn tick(&mut self, moment: &Moment<'_>, reference: Option<&[f64]>) {
        self.truth.terms(moment.x, moment.presence, &mut self.terms);
        self.widths(moment);
        let disturbed = self.recovery.as_ref().is_some_and(|recovery| recovery.is_disturbed(moment.k));
        let ratios = self.ratios(moment);
        match self.findings.during_events.as_mut().filter(|_| disturbed) {
            Some(during) => during.take(ratios),
            None => self.findings.take(moment.k, ratios),
        }
        if let Some(recovery) = &mut self.recovery {
            recovery.tick(moment.k, (ratios.judged > 0).then_some(ratios.breaches > 0));
        }
        if let Some(by_event) = &mut self.by_event {
            by_event.tick(moment.k, ratios);
        }
        let spread = spread(moment, self.scenario.components());
        let input = input(moment, self.scenario.components());
        raise(&mut self.findings.max_input, input);
        raise(&mut self.findings.max_spread, spread);
        let ratio = (ratios.judged > 0).then_some(ratios.largest);
        self.windows.tick(moment, ratio, spread, input, reference);
        if (moment.k, moment.part) == (self.scenario.time.ticks, 0) {
            self.end(moment);
        }
    }

    /// Takes a tick, which has been judged, as the last one.
    pub fn end(&mut self, moment: &Moment<'_>) {
        let whole = moment.presence.iter().all(|presence| presence.is_known() || *presence == Presence::Off);
        self.findings.final_spread = spread(moment, self.scenario.components()).filter(|_| whole);
        self.findings.last = self.known(moment);
        let components = self.scenario.components();
        let off = moment.presence.iter().map(|presence| *presence == Presence::Off);
        self.findings.off = off.flat_map(|off| std::iter::repeat_n(off, components)).collect();
    }

    /// The true diffusive terms of the last tick, by index and then by component, state units; NaN where one
    /// is not known.
    #[must_use]
    pub fn terms(&self) -> &[f64] {
        &self.terms
    }

    /// The funnels that they were judged by, state units.
    #[must_use]
    pub fn psi(&self) -> &[f64] {
        &self.psi
    }

    /// Figures of all ticks that were judged.
    #[must_use]
    pub fn finish(self) -> Findings {
        let recovered_s = self.recovery.and_then(Recovery::finish);
        let events = self.by_event.map_or_else(Vec::new, ByEvent::finish);
        Findings { windows: self.windows.finish(), recovered_s, events, ..self.findings }
    }

    fn known(&self, moment: &Moment<'_>) -> Vec<f64> {
        let components = self.scenario.components();
        let value = |(at, &x): (usize, &f64)| if is_known(moment, at / components) { x } else { f64::NAN };
        moment.x.iter().enumerate().map(value).collect()
    }

    /// The scenario's funnels at the tick, not narrower than the accepted floor.
    fn widths(&mut self, moment: &Moment<'_>) {
        let (t, components) =
            (self.scenario.time.part_at_s(moment.k, moment.part), self.scenario.components());
        let nodes = (0..self.scenario.nodes.len()).map_while(|index| self.scenario.node_at(index, moment.k));
        for (index, node) in nodes.enumerate() {
            let width = node.funnel.width(t);
            let floor = match self.scenario.floor {
                FloorSpec::None => 0.0,
                FloorSpec::Width(width) => width,
                FloorSpec::F32 if is_off(moment, index) => 0.0,
                FloorSpec::F32 => self.resolution(moment, index),
            };
            let slots = self.psi.iter_mut().skip(index * components).take(components);
            slots.for_each(|slot| *slot = larger(width, floor));
        }
    }

    /// The floor that the f32 node of `index` needs at the tick, by true states.
    fn resolution(&self, moment: &Moment<'_>, index: usize) -> f64 {
        let components = self.scenario.components();
        let of = |index: usize| moment.x.iter().skip(index * components).take(components);
        let near = self.truth.neighbours(index).iter().map(|&(other, _)| other).chain([index]);
        let state = near
            .filter(|&near| is_known(moment, near))
            .flat_map(of)
            .fold(0.0f64, |most, x| most.max(x.abs()));
        let inputs = moment.u.iter().skip(index * components).take(components);
        let input = inputs.fold(0.0f64, |most, u| most.max(u.abs()));
        self.floors[index].width(state, input)
    }

    /// The ratios of a tick; a node that is off has none.
    fn ratios(&mut self, moment: &Moment<'_>) -> Ratios {
        let components = self.scenario.components();
        let mut found = Ratios::default();
        let terms = self.terms.iter().zip(&self.psi).zip(&mut self.findings.worst);
        for (at, ((nu, psi), worst)) in terms.enumerate() {
            let index = at / components;
            if is_off(moment, index) {
                continue;
            }
            if !self.truth.is_coupled(index, moment.presence) {
                self.findings.uncoupled += 1;
                worst.uncoupled += 1;
                continue;
            }
            if !self.truth.is_known(index, moment.presence) {
                self.findings.unknown += 1;
                worst.take(None);
                continue;
            }
            found.judged += 1;
            // Zero in a funnel that has closed is inside it by no more than any other value is.
            let ratio = if *nu == 0.0 && *psi == 0.0 { 1.0 } else { nu.abs() / psi };
            found.largest = larger(found.largest, ratio);
            if worst.take(Some(ratio)) {
                found.breaches += 1;
                found.first.get_or_insert(index);
            }
        }
        found
    }
}

/// What the terms of a tick came to.
#[derive(Clone, Copy, Debug, Default)]
struct Ratios {
    /// The largest `|nu| / psi`; NaN where one was not a number.
    largest: f64,
    /// Terms that were judged.
    judged: u64,
    /// Terms that were outside.
    breaches: u64,
    /// Index of the first node that was outside.
    first: Option<usize>,
}

impl Findings {
    /// Takes the ratios of a tick that no event disturbs.
    fn take(&mut self, k: u64, ratios: Ratios) {
        self.judged += ratios.judged;
        self.breaches += ratios.breaches;
        self.max_ratio = larger(self.max_ratio, ratios.largest);
        self.first_breach = self.first_breach.or(ratios.first.map(|index| (k, index)));
    }
}

impl DuringEvents {
    /// Takes the ratios of a tick that events disturb.
    fn take(&mut self, ratios: Ratios) {
        self.judged += ratios.judged;
        self.breaches += ratios.breaches;
        self.max_ratio = larger(self.max_ratio, ratios.largest);
    }
}

/// The floors of the nodes, by index.
fn floors(scenario: &Scenario) -> Vec<Floor<f64>> {
    let graph = &scenario.graph;
    let mut degrees = graph.degrees();
    if scenario.coupling == Coupling::EdgeWise {
        // Both ends of an edge floor it by what both know: half its stiffness `alpha_ij (n_i + n_j)`.
        let count =
            |index: usize| graph.edges.iter().filter(|edge| edge.a == index || edge.b == index).count();
        let counts: Vec<_> = (0..graph.nodes).map(count).collect();
        degrees.fill(0.0);
        for edge in &graph.edges {
            let stiffness = 0.5 * edge.weight * (counts[edge.a] + counts[edge.b]) as f64;
            degrees[edge.a] = larger(degrees[edge.a], stiffness);
            degrees[edge.b] = larger(degrees[edge.b], stiffness);
        }
    }
    degrees.into_iter().map(|degree| Floor::of_f32(degree, scenario.time.tick_s())).collect()
}

fn is_known(moment: &Moment<'_>, index: usize) -> bool {
    moment.presence.get(index).is_some_and(|presence| presence.is_known())
}

fn is_off(moment: &Moment<'_>, index: usize) -> bool {
    moment.presence.get(index) == Some(&Presence::Off)
}

/// Takes a value as the largest so far, where it is known.
fn raise(largest: &mut Option<f64>, value: Option<f64>) {
    if let Some(value) = value {
        *largest = Some(largest.map_or(value, |most| larger(most, value)));
    }
}

/// `max x - min x` over the nodes that are known, of the component in which they are farthest apart; `None`
/// where fewer than two are known: one alone is in step with nobody.
fn spread(moment: &Moment<'_>, components: usize) -> Option<f64> {
    let apart = |component: usize| {
        let states = || {
            let states = moment.x.iter().skip(component).step_by(components);
            states.enumerate().filter(|&(index, _)| is_known(moment, index)).map(|(_, &x)| x)
        };
        largest(f64::NEG_INFINITY, states()) - smallest(f64::INFINITY, states())
    };
    let known = moment.presence.iter().filter(|presence| presence.is_known()).count();
    (known > 1).then(|| largest(0.0, (0..components).map(apart)))
}

/// The largest input that nodes have applied at the tick; `None` where none has run it.
fn input(moment: &Moment<'_>, components: usize) -> Option<f64> {
    let ran = |&(at, _): &(usize, &f64)| moment.presence.get(at / components) == Some(&Presence::Ran);
    moment.u.iter().enumerate().filter(ran).map(|(_, u)| u.abs()).reduce(larger)
}

#[cfg(test)]
mod tests;
