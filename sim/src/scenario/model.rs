//! A scenario, fully resolved: every node with its own dynamics, gain and funnel, in SI units and f64.

use funnelnet_law::start::{PARTS, SlowStart};
use funnelnet_law::{Breach, Coupling, Funnel, Gain};
use std::path::PathBuf;

use super::bus::{BusSpec, LinkSpec};
use super::clock::{ClockSpec, SyncSpec};
use super::dynamics::Dynamics;
use super::event::{Course, EventSpec};
use super::graph::Graph;
use super::inputs::InputFile;
use super::staged::Staged;
use crate::extremes::largest;

/// Everything that a run depends on.
#[derive(Clone, Debug, PartialEq)]
pub struct Scenario {
    /// Title; the file's name where it gives none.
    pub title: String,
    /// The root of every random stream.
    pub seed: u64,
    /// Tick and duration.
    pub time: TimeSpec,
    /// Graph: who hears whom.
    pub graph: Graph,
    /// The coupling law.
    pub coupling: Coupling<f64>,
    /// The narrowest funnel that is asked for.
    pub floor: FloorSpec,
    /// Policy of a node outside its funnel.
    pub on_breach: Breach<f64>,
    /// The law runs in `(1 - guard) psi`, once that has grown from nothing.
    pub guard: f64,
    /// The largest `|u|` that a node may ask for (state units / s), where the designer says.
    pub u_max: Option<f64>,
    /// One per node; index i has id i + 1.
    pub nodes: Vec<NodeSpec>,
    /// The unit of the states, for who reads a picture.
    pub unit: Option<String>,
    /// The bus between the nodes.
    pub bus: BusSpec,
    /// Links between the bus and single receivers.
    pub links: Vec<LinkSpec>,
    /// Events of nodes and links, in the order of time.
    pub events: Vec<EventSpec>,
    /// The shortest time for which `[faults]` may have a node off, whatever the seed is, ns; none where it draws no bounce.
    pub shortest_bounce_ns: Option<u64>,
    /// What events set while nodes run, by index; empty where they set nothing.
    pub staged: Vec<Option<Staged>>,
    /// The clocks of the nodes, by index; none where all are right.
    pub clocks: Vec<ClockSpec>,
    /// SYNC that keeps the clocks together.
    pub sync: Option<SyncSpec>,
    /// Causes that stop a node, beside its own state and funnel.
    pub safety: SafetySpec,
    /// Expectations of the run.
    pub expect: Expect,
    /// The file that it came from, as named by the user.
    pub path: PathBuf,
    /// The text that gives it again, with the values of the command line in it.
    pub as_run: String,
    /// The files that it names there.
    pub input_files: Vec<InputFile>,
}

impl Scenario {
    /// Whether the program around the simulation computes the field of a node: what comes of it is not the
    /// firmware's.
    #[must_use]
    pub fn has_hosted_fields(&self) -> bool {
        self.nodes.iter().any(|node| node.dynamics.hosted().is_some())
    }

    /// Tells the host's fields that all nodes will be asked at `t` (s) and the states `x`, by index and then
    /// by component.
    pub fn announce(&self, t: f64, x: &[f64]) {
        self.nodes
            .iter()
            .filter_map(|node| node.dynamics.hosted())
            .for_each(|hosted| hosted.field().announce(t, x));
    }

    /// The same where all nodes are asked at one state, by component.
    pub fn announce_one(&self, t: f64, x: &[f64]) {
        if self.has_hosted_fields() {
            self.announce(t, &x.repeat(self.nodes.len()));
        }
    }

    /// Components of a state, 1 to 8; every node has as many.
    #[must_use]
    pub fn components(&self) -> usize {
        self.nodes.first().map_or(1, |node| node.state.len())
    }

    /// Whether no event takes a node or a link away: what events there are happen to clocks and frames.
    #[must_use]
    pub fn stays_whole(&self) -> bool {
        !self.events.iter().any(|event| event.kind.is_of_presence())
    }

    /// The same without events, and without what they set.
    #[must_use]
    pub fn without_events(&self) -> Self {
        Self { events: Vec::new(), shortest_bounce_ns: None, staged: Vec::new(), ..self.clone() }
    }

    /// Whether every node says its own state, as far as it knows it.
    #[must_use]
    pub fn is_honest(&self) -> bool {
        !self.events.iter().any(|event| event.kind.is_of_lies())
    }

    /// Whether an event has the sensor or the actuator of the node with this index fail: in simulation it has a plant then, which is its field.
    #[must_use]
    pub fn has_plant(&self, index: usize) -> bool {
        let of_it = |event: &EventSpec| event.kind.is_of_plants() && event.targets.nodes().contains(&index);
        self.events.iter().any(of_it)
    }

    /// Course of its events, step by step.
    #[must_use]
    pub fn course(&self) -> Course {
        Course::of(&self.events, &self.graph)
    }

    /// The initial states, by index and then by component (state units).
    #[must_use]
    pub fn initial_states(&self) -> Vec<f64> {
        self.nodes.iter().flat_map(|node| node.state.iter().copied()).collect()
    }

    /// The widest funnel at time `t` (s), over the nodes (state units).
    #[must_use]
    pub fn widest_funnel(&self, t: f64) -> f64 {
        largest(0.0, self.nodes.iter().map(|node| node.funnel.width(t)))
    }

    /// The bound on `|x_i - x_j|`, component by component, while every diffusive term is inside funnels of at most `widest`
    /// (state units); 0 for a single node. With edge-wise coupling every edge keeps `alpha_ij |x_i - x_j| < psi`, which adds up
    /// along the shortest way; else it is the paper's `2 sqrt(N) / lambda2 * widest`.
    #[cfg(feature = "spectrum")]
    #[must_use]
    pub fn sync_bound(&self, widest: f64) -> f64 {
        match (self.nodes.len(), self.coupling) {
            (0 | 1, _) => 0.0,
            (_, Coupling::EdgeWise) => widest * self.graph.resistive_diameter(),
            (n, _) => 2.0 * (n as f64).sqrt() / self.graph.lambda2() * widest,
        }
    }
}

/// The network tick and how many of them are run. Where the law decides once in a round of several ticks, all that counts ticks, here and
/// on the wire, counts rounds (law.md 5): a tick of the network is a round.
///
/// Time is that of the network. With a slow start (law.md 7) it passes more slowly than the nodes' clocks at first: `on_clock` and `from_clock` are about theirs.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct TimeSpec {
    /// Network tick T in nanoseconds, above zero: a whole round.
    pub tick_ns: u64,
    /// Number of them, above zero, those of a slow start among them.
    pub ticks: u64,
    /// Ticks in a round, 1 to 100: steps in which a node integrates its own field.
    pub round: u8,
    /// In each of its first ticks an eighth of a tick passes; none as a rule.
    pub start: SlowStart,
}

impl TimeSpec {
    /// Ticks of so many ns that the law decides at, all alike.
    #[must_use]
    pub fn plain(tick_ns: u64, ticks: u64) -> Self {
        Self { tick_ns, ticks, round: 1, start: SlowStart::default() }
    }

    /// The time of tick `k`, ns, an eighth of one left out.
    #[must_use]
    pub fn at_ns(&self, k: u64) -> u64 {
        let eighths = u128::from(self.start.eighths(k)) * u128::from(self.tick_ns);
        u64::try_from(eighths / u128::from(PARTS)).unwrap_or(u64::MAX)
    }

    /// The end of the run, ns.
    #[must_use]
    pub fn end_ns(&self) -> u64 {
        self.at_ns(self.ticks)
    }

    /// Time from tick `k` to the next one, s.
    #[must_use]
    pub fn period_s(&self, k: u64) -> f64 {
        if k < self.start.slow_ticks().into() { self.tick_s() / f64::from(PARTS) } else { self.tick_s() }
    }

    /// Tick in which the time `ns` is, and what is left of it there, in parts of a nanosecond of the clock.
    fn split(&self, ns: u64) -> (u64, u64) {
        let slow = u64::from(self.start.slow_ticks());
        let on_clock = ns.saturating_mul(PARTS.into());
        if on_clock < slow.saturating_mul(self.tick_ns) {
            return (on_clock / self.tick_ns, on_clock % self.tick_ns);
        }
        (ns / self.tick_ns + u64::from(self.start.behind()), ns % self.tick_ns)
    }

    /// The first tick at or after the time `ns`: what happens at the time of a tick happens before it.
    #[must_use]
    pub fn first_tick(&self, ns: u64) -> u64 {
        let (tick, rest) = self.split(ns);
        tick + u64::from(rest != 0)
    }

    /// The last tick at or before the time `ns`.
    #[must_use]
    pub fn last_tick(&self, ns: u64) -> u64 {
        self.split(ns).0
    }

    /// What the nodes' clocks show at the time `ns`, ns from tick 0 on.
    #[must_use]
    pub fn on_clock(&self, ns: u64) -> u64 {
        let (tick, rest) = self.split(ns);
        tick.saturating_mul(self.tick_ns).saturating_add(rest)
    }

    /// The time at which the nodes' clocks show `ns`, ns.
    #[must_use]
    pub fn from_clock(&self, ns: u64) -> u64 {
        let (tick, rest) = (ns / self.tick_ns, ns % self.tick_ns);
        let slow = tick < self.start.slow_ticks().into();
        self.at_ns(tick).saturating_add(if slow { rest / u64::from(PARTS) } else { rest })
    }

    /// A step of a node's own field in seconds.
    #[must_use]
    pub fn step_s(&self) -> f64 {
        self.tick_s() / f64::from(self.round)
    }

    /// T in seconds.
    #[must_use]
    pub fn tick_s(&self) -> f64 {
        self.tick_ns as f64 * 1e-9
    }

    /// The time of tick `k` in seconds: the f64 nearest to it, up to 2^53 ns.
    #[must_use]
    pub fn at_s(&self, k: u64) -> f64 {
        if self.start.is_none() {
            return k.saturating_mul(self.tick_ns) as f64 / 1e9;
        }
        self.start.eighths(k).saturating_mul(self.tick_ns) as f64 / (f64::from(PARTS) * 1e9)
    }

    /// The time of a step of the nodes' own fields in seconds: the one number `part` after tick `k`.
    #[must_use]
    pub fn part_at_s(&self, k: u64, part: u8) -> f64 {
        let step_ns = self.tick_ns / u64::from(self.round.max(1));
        if self.start.is_none() {
            let ns = k.saturating_mul(self.tick_ns).saturating_add(step_ns * u64::from(part));
            return ns as f64 / 1e9;
        }
        let eighths = if k < self.start.slow_ticks().into() { 1 } else { u64::from(PARTS) };
        let ns = self.start.eighths(k).saturating_mul(self.tick_ns);
        ns.saturating_add(eighths * step_ns * u64::from(part)) as f64 / (f64::from(PARTS) * 1e9)
    }

    /// Steps of the nodes' own fields in the whole run.
    #[must_use]
    pub fn steps(&self) -> u64 {
        self.ticks.saturating_mul(self.round.into())
    }

    /// The tick in which step `n` begins, and the number of the step in it.
    #[must_use]
    pub fn tick_of_step(&self, n: u64) -> (u64, u8) {
        let round = u64::from(self.round.max(1));
        (n / round, (n % round) as u8)
    }

    /// The end of the run in seconds.
    #[must_use]
    pub fn end_s(&self) -> f64 {
        (self.ticks - u64::from(self.start.behind())) as f64 * self.tick_ns as f64 * 1e-9
    }
}

/// The narrowest funnel that the designer asks for. Nodes may keep a wider one than the scenario's down there, and are judged by it.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub enum FloorSpec {
    /// The funnel itself: a node that floors it fails the run.
    #[default]
    None,
    /// So wide (state units).
    Width(f64),
    /// What the f32 of a node resolves.
    F32,
}

/// Causes that stop a node, beside its own state and funnel, and limits of what it takes of its neighbours.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct SafetySpec {
    /// Number of neighbours lost at the same time that stop a node; 0: none does.
    pub lost_neighbours: u8,
    /// Time without SYNC that stops a node which ticks by it, ns.
    pub holdover_ns: Option<u64>,
    /// The largest `|x|` that a node takes of a neighbour, state units.
    pub heard_limit: Option<f64>,
    /// The largest change of a neighbour's state that a node takes, state units / s.
    pub heard_rate: Option<f64>,
    /// States in a row that were not taken, after which a node drops the edge; 0: it never does.
    pub drop_after: u8,
}

/// One node.
#[derive(Clone, Debug, PartialEq)]
pub struct NodeSpec {
    /// The index in `Scenario::nodes` plus one; more than a run takes where the scenario can only be checked.
    pub id: u16,
    /// Initial state, by component (state units).
    pub state: Vec<f64>,
    /// The node's own vector field.
    pub dynamics: Dynamics,
    /// Limits of its actuator, where they are given.
    pub limits: Option<InputLimits>,
    /// Its gain.
    pub gain: Gain<f64>,
    /// Its funnel.
    pub funnel: Funnel<f64>,
    /// `c` of (**).
    pub damping: f64,
    /// Standard deviation of what is added to each state as it is sent (state units).
    pub noise: f64,
    /// Time from its tick to its frames, ns.
    pub compute_ns: u64,
}

/// Limits of an input (state units / s).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct InputLimits {
    /// Zero or less.
    pub low: f64,
    /// Zero or more.
    pub high: f64,
}

/// Limits that the run must stay below; `None` is not checked.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Expect {
    /// The largest `|nu| / psi` over all nodes and ticks.
    pub funnel_ratio: Option<f64>,
    /// `max x - min x` at the end (state units).
    pub final_spread: Option<f64>,
    /// Largest distance of a node to the emergent dynamics at the end (state units).
    pub emergent_error: Option<f64>,
    /// Largest distance of a node to the blended dynamics at the end (state units).
    pub blended_error: Option<f64>,
    /// Largest distance to the continuous-time reference over nodes and time (state units).
    pub reference_error: Option<f64>,
    /// Value at which every component of every node ends.
    pub final_value: Option<FinalValue>,
    /// The largest `|u|` over all nodes and ticks (state units / s).
    pub max_input: Option<f64>,
    /// Time after the end of each event from which all nodes are inside their funnels again, ns.
    pub recovered_within_ns: Option<u64>,
    /// Nodes that may stop by themselves.
    pub stopped: Stoppable,
    /// Limits for a part of the run.
    pub windows: Vec<Window>,
}

/// Nodes that may stop by themselves without failing the run.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Stoppable {
    /// Those with these ids.
    Ids(Vec<u16>),
    /// Each.
    Any,
}

impl Default for Stoppable {
    fn default() -> Self {
        Self::Ids(Vec::new())
    }
}

/// Limits for a part of the run, both ends included; `None` is not checked.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Window {
    /// Its first tick.
    pub from_tick: u64,
    /// Its last tick.
    pub to_tick: u64,
    /// The largest `|nu| / psi`.
    pub funnel_ratio: Option<f64>,
    /// The largest `max x - min x` (state units).
    pub spread: Option<f64>,
    /// The largest distance of a node to the emergent dynamics (state units).
    pub emergent_error: Option<f64>,
    /// The largest distance of a node to the continuous-time reference (state units).
    pub reference_error: Option<f64>,
    /// The largest `|u|` (state units / s).
    pub max_input: Option<f64>,
}

impl Expect {
    /// Whether nothing at all is expected.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        let figures = [
            self.funnel_ratio,
            self.final_spread,
            self.emergent_error,
            self.blended_error,
            self.reference_error,
            self.max_input,
        ];
        let others =
            self.final_value.is_none() && self.recovered_within_ns.is_none() && self.windows.is_empty();
        others && figures.iter().all(Option::is_none)
    }

    /// Whether the distance to the emergent dynamics is limited anywhere.
    #[must_use]
    pub fn asks_for_emergent(&self) -> bool {
        self.emergent_error.is_some() || self.windows.iter().any(|window| window.emergent_error.is_some())
    }

    /// Whether the distance to the reference is limited anywhere.
    #[must_use]
    pub fn asks_for_reference(&self) -> bool {
        self.reference_error.is_some() || self.windows.iter().any(|window| window.reference_error.is_some())
    }
}

/// Value at which all states end, and how near to it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FinalValue {
    /// State units.
    pub is: f64,
    /// Largest distance, above zero (state units).
    pub within: f64,
}
