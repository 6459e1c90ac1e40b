//! The sampled law itself, in f64, for the whole network: what a run on `loopback` does but for the rounding
//! of f32.
//!
//! The emergent dynamics say what happens once the states have come together. Everything before, and
//! everything that the bus does, is found by following the law. That is cheap for small networks and short
//! runs; else only the start is followed.

mod bounds;
mod bus;
mod edges;
mod member;
mod window;

use crate::extremes::{beyond, extremes, larger, largest};
use crate::scenario::{Coupling, FloorSpec, LARGEST_RUN, Scenario};
use bounds::Bend;
pub(crate) use bounds::Bounds;
#[cfg(feature = "check")]
pub(crate) use bounds::undisturbed;
use bus::Bus;
use edges::Edges;
use funnelnet_node::params;
use member::Member;
pub(crate) use window::Watched;

/// What is followed at least, s, as long as it is cheap.
pub(crate) const START: f64 = 0.1;
/// Work that is spent, in edges and ticks; it depends on the scenario only, so that `check` says the same on
/// every machine.
const WORK: usize = 25_000_000;
/// Work of one component of a node, and of an end of an edge where the bus loses or delays, beside that of an
/// edge.
const NODE_WORK: usize = 20;
const EAR_WORK: usize = 4;
/// Funnels from which on the states are called lost.
const LOST: f64 = 100.0;

/// The largest `|nu| / psi` of a part of the run.
#[derive(Clone, Copy, Debug)]
#[cfg_attr(not(feature = "check"), expect(dead_code, reason = "only `check` says where and when"))]
pub(crate) struct Worst {
    pub ratio: f64,
    /// Index.
    pub node: usize,
    /// s.
    pub t: f64,
}

impl Worst {
    const NONE: Self = Self { ratio: 0.0, node: 0, t: 0.0 };

    fn note(&mut self, ratio: f64, node: usize, t: f64) {
        if beyond(ratio, self.ratio) {
            *self = Self { ratio, node, t };
        }
    }
}

/// What the law does.
#[derive(Clone, Debug)]
#[cfg_attr(not(feature = "check"), expect(dead_code, reason = "only `check` says how far it was followed"))]
pub(crate) struct Followed {
    /// Up to when, s.
    pub until: f64,
    /// Whether that is the end of the run.
    pub whole: bool,
    /// Over the first 0.1 s.
    pub start: Worst,
    pub worst: Worst,
    /// The largest `|u|` (state units / s).
    pub input: f64,
    /// The largest `|x'|` (state units / s).
    pub slope: f64,
    /// The largest `|f|` (state units / s).
    pub field: f64,
    /// The largest `|x|` (state units).
    pub far: f64,
    /// Root mean square of the second derivative of the mean state, once the states have come together (state
    /// units / s^2).
    pub bend: f64,
    /// When the states ran away, s.
    pub lost: Option<f64>,
    /// When a node is first outside its funnel (s).
    pub left: Option<f64>,
    /// The first node that floors its funnel where the scenario accepts no floor so wide, and when (s).
    pub floored: Option<(usize, f64)>,
    /// By index and then by component (state units).
    pub last: Vec<f64>,
    /// The parts of the run for which the scenario has expectations of their own, in its order.
    pub windows: Vec<Watched>,
}

/// How far the law is followed, beside what is affordable.
#[derive(Clone, Copy, PartialEq)]
enum Until {
    End,
    /// To the first breach: all that a trial needs to know.
    Breach,
}

/// Whether the law of a scenario can be followed here.
fn known(scenario: &Scenario) -> bool {
    // What both ends believe of an edge is one thing only where everything comes in time.
    let at_both_ends = Bus::is_perfect(scenario) && scenario.time.start.is_none();
    let law = scenario.coupling != Coupling::EdgeWise || at_both_ends;
    law && scenario.nodes.len() <= LARGEST_RUN
}

/// Whether the law promises that diffusive terms stay in their funnels. A baseline does not.
pub(super) fn promises(scenario: &Scenario) -> bool {
    scenario.coupling.keeps_funnels() && scenario.nodes.iter().all(|node| node.gain.keeps_funnels())
}

/// Ticks that are followed: all of them where that is cheap.
fn affordable(scenario: &Scenario, work: usize) -> u64 {
    let ears = if Bus::is_perfect(scenario) { 1 } else { 2 * EAR_WORK };
    let a_tick =
        scenario.components() * (NODE_WORK * scenario.nodes.len() + ears * scenario.graph.edges.len());
    scenario.time.ticks.min((work / a_tick.max(1)) as u64)
}

/// Follows the law; `None` where it is not known here.
#[cfg(feature = "check")]
pub(crate) fn follow(scenario: &Scenario, degrees: &[f64]) -> Option<Followed> {
    follow_for(scenario, degrees, Bounds::of(scenario), WORK)
}

/// The same up to the first breach.
#[cfg(feature = "check")]
pub(crate) fn follow_to_breach(scenario: &Scenario, degrees: &[f64]) -> Option<Followed> {
    follow_until(scenario, degrees, Bounds::of(scenario), WORK, Until::Breach)
}

/// Whether following a whole run takes no more than so many hundredths of what is spent on one.
#[cfg(feature = "check")]
pub(crate) fn is_cheap(scenario: &Scenario, hundredths: usize) -> bool {
    affordable(scenario, WORK / 100 * hundredths) == scenario.time.ticks
}

/// Whether everything comes at once and as it was sent.
#[cfg(feature = "check")]
pub(crate) fn hears_perfectly(scenario: &Scenario) -> bool {
    Bus::is_perfect(scenario)
}

fn follow_for(scenario: &Scenario, degrees: &[f64], bounds: Bounds, work: usize) -> Option<Followed> {
    follow_until(scenario, degrees, bounds, work, Until::End)
}

fn follow_until(
    scenario: &Scenario,
    degrees: &[f64],
    bounds: Bounds,
    work: usize,
    until: Until,
) -> Option<Followed> {
    if !known(scenario) {
        return None;
    }
    let ticks = affordable(scenario, work);
    let mut network = Network::new(scenario, degrees, bounds);
    let mut bend = Bend::new(scenario, ticks);
    let mut followed = Followed {
        until: scenario.time.at_s(ticks),
        whole: ticks == scenario.time.ticks,
        start: Worst::NONE,
        worst: Worst::NONE,
        input: 0.0,
        slope: 0.0,
        field: 0.0,
        far: 0.0,
        bend: 0.0,
        lost: None,
        left: None,
        floored: None,
        last: Vec::new(),
        windows: scenario.expect.windows.iter().map(Watched::new).collect(),
    };
    for k in 0..=ticks {
        let t = scenario.time.at_s(k);
        network.listen(k);
        network.judge(k, t, &mut followed);
        // The inputs of the last tick move no state that is looked at.
        let enough = until == Until::Breach && followed.left.is_some();
        if followed.lost.is_some() || enough || k == ticks {
            break;
        }
        network.advance(k, &mut followed);
        bend.note(k, network.states());
    }
    followed.bend = bend.rms();
    followed.last = network.states().collect();
    Some(followed)
}

/// All nodes and what is between them.
struct Network<'s> {
    scenario: &'s Scenario,
    members: Vec<Member<'s>>,
    bus: Bus<'s>,
    /// Where the coupling is edge-wise.
    edges: Option<Edges>,
    /// The narrowest funnel that the designer asks for (state units).
    asked: f64,
}

impl<'s> Network<'s> {
    fn new(scenario: &'s Scenario, degrees: &[f64], bounds: Bounds) -> Self {
        let members = scenario.nodes.iter().zip(degrees);
        let asked = match scenario.floor {
            FloorSpec::Width(width) => width,
            FloorSpec::None | FloorSpec::F32 => 0.0,
        };
        Self {
            scenario,
            members: members.map(|(node, &degree)| Member::new(scenario, node, degree, bounds)).collect(),
            bus: Bus::new(scenario, bounds),
            edges: (scenario.coupling == Coupling::EdgeWise).then(|| Edges::new(scenario)).flatten(),
            asked,
        }
    }

    fn states(&self) -> impl Iterator<Item = f64> {
        self.members.iter().flat_map(|member| member.parts.iter().map(|part| part.x))
    }

    /// Diffusive terms, true ones and those that nodes believe in.
    fn listen(&mut self, k: u64) {
        let start = self.scenario.time.start;
        let stretches = k > 0 && k == u64::from(start.slow_ticks());
        self.members.iter_mut().for_each(|member| member.begin(start.pace(k as u32)));
        if let Some(edges) = &mut self.edges {
            return edges.carry(k, self.scenario.time.at_s(k), &mut self.members);
        }
        if stretches {
            self.bus.stretch();
        }
        let edges = &self.scenario.graph.edges;
        for edge in edges {
            for component in 0..self.scenario.components() {
                let (a, b) = (self.members[edge.a].parts[component], self.members[edge.b].parts[component]);
                self.members[edge.a].hears_truth(component, edge.weight, b);
                self.members[edge.b].hears_truth(component, edge.weight, a);
            }
        }
        self.bus.carry(k, &mut self.members);
    }

    fn judge(&mut self, k: u64, t: f64, followed: &mut Followed) {
        let mut most = 0.0;
        for (index, member) in self.members.iter_mut().enumerate() {
            let ratio = member.ratio(t, self.asked);
            followed.worst.note(ratio, index, t);
            most = larger(most, ratio);
            let inside = ratio < 1.0;
            if !inside && followed.left.is_none() {
                followed.left = Some(t);
            }
            if t <= START {
                followed.start.note(ratio, index, t);
            }
            // A run is judged by the same (docs/scenarios.md, "floor").
            let accepts_any = self.scenario.floor == FloorSpec::F32;
            if !accepts_any && followed.floored.is_none() && member.floors(t, self.asked) {
                followed.floored = Some((index, t));
            }
        }
        for window in followed.windows.iter_mut().filter(|window| window.is_open(k)) {
            window.note(t, most, &self.members);
        }
        let (low, high) = extremes(self.states());
        // A baseline may be far from a funnel that it is only compared with.
        let near = followed.worst.ratio < LOST || !promises(self.scenario);
        let far = larger(low.abs(), high.abs());
        followed.far = larger(followed.far, far);
        let within = far <= params::LARGEST && near;
        if !within {
            followed.lost = Some(t);
        }
    }

    fn advance(&mut self, k: u64, followed: &mut Followed) {
        let (t, tick) = (self.scenario.time.at_s(k), self.scenario.time.period_s(k));
        if self.scenario.coupling == Coupling::WeaklyCentralised {
            let gain = largest(0.0, self.members.iter_mut().map(|member| member.own_gain(k, t)));
            self.members.iter_mut().for_each(|member| member.takes_common(gain));
        }
        for member in &mut self.members {
            let input = member.advance(k, t);
            followed.input = larger(followed.input, input);
            for window in followed.windows.iter_mut().filter(|window| window.is_open(k)) {
                window.input = larger(window.input, input);
            }
            let moved = largest(0.0, member.parts.iter().map(|part| part.dx.abs()));
            followed.slope = larger(followed.slope, moved / tick);
            followed.field =
                larger(followed.field, largest(0.0, member.parts.iter().map(|part| part.f.abs())));
        }
    }
}

#[cfg(test)]
mod tests;
