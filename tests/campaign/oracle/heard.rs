//! Limits of what is heard: who is honest and slow enough is taken, who lies beyond them is not, and who starts anew is heard again.

use super::Broken;
use super::model::{Fate, Listener, said};
use funnelnet_law::field::VectorField;
use funnelnet_node::neighbour::Presence as Known;
use funnelnet_node::{Event, Node, Phase};
use funnelnet_protocol::NodeId;
use sim_host::engine::NodeEvent;
use sim_host::judge::Moment;
use sim_host::presence::Presence;
use sim_host::scenario::{BusModel, Detail, EventKind, EventSpec, Lie, Scenario, SyncSpec};

/// Standard deviations of noise that nobody sees in these runs.
const DEVIATIONS: f64 = 7.0;
/// The longest time for which a silent neighbour is extrapolated, ticks: who restarts within it is not seen to.
const EXTRAPOLATED: u64 = 120;
/// Ticks after which a stamp comes again, less the two by which a state may be ahead, and some to spare.
const ALIASED: u64 = 250;
/// Ticks from a state that costs an edge to the word of its neighbour, and what a delay may add.
const WORD: u64 = 3;

/// What is watched of a run with limits.
pub(super) struct Heard<'a> {
    scenario: &'a Scenario,
    nodes: Vec<Watched>,
    /// States at the tick before, by index; none of who was not there.
    last: Vec<Option<f64>>,
    lies: Vec<Watch>,
    /// Edges that were dropped: node and neighbour.
    barred: Vec<(usize, usize)>,
    noticed: u64,
}

/// What is known of a node as a neighbour.
#[derive(Clone, Copy, Debug)]
struct Watched {
    /// It says its own state at all times, as far as events go, and restarts so that all can see it.
    is_honest: bool,
    /// It runs, and has not spoken since it came.
    listens: bool,
    /// It has spoken since it was off: one to which nobody tells the time never does.
    speaks: bool,
    /// It was once faster, or farther away, than neighbours take.
    is_beyond: bool,
}

/// A lie that begins, and who hears it.
struct Watch {
    liar: usize,
    lie: Lie,
    from: u64,
    to: u64,
    first: Option<f64>,
    /// Neighbours, and when the edge has to be gone.
    hear: Vec<(usize, Listener, Option<u64>)>,
}

impl<'a> Heard<'a> {
    pub(super) fn of(scenario: &'a Scenario) -> Self {
        let absences = scenario.course().absences(&scenario.time);
        let bits_flip = scenario.bus.model == BusModel::Ideal
            && (scenario.events.iter().any(|event| event.kind == EventKind::Corrupt)
                || scenario.links.iter().any(|link| link.settings.corrupt > 0.0));
        // A stamp has eight bits: of what was held for so long some looks new, and is taken for what it was not.
        let is_held = scenario.events.iter().any(|event| {
            let ticks = event.lasts_ns / scenario.time.tick_ns;
            event.kind == EventKind::Hold && (ticks >= ALIASED || event.lasts_ns == 0)
        });
        let watched = |index: usize| {
            let is_short = absences.iter().any(|absence| {
                let ticks = absence.to_tick.map_or(u64::MAX, |to| to - absence.from_tick);
                absence.node == index && ticks <= EXTRAPOLATED + 1
            });
            let lies = scenario.events.iter().any(|event| is_false(event, index));
            Watched {
                is_honest: !bits_flip && !is_held && !is_short && !lies,
                listens: false,
                speaks: true,
                is_beyond: false,
            }
        };
        let limited = scenario.safety.heard_rate.is_some() || scenario.safety.heard_limit.is_some();
        Self {
            scenario,
            nodes: (0..scenario.nodes.len()).map(watched).collect(),
            last: vec![None; scenario.nodes.len()],
            lies: if limited { watches(scenario) } else { Vec::new() },
            barred: Vec::new(),
            noticed: 0,
        }
    }

    /// Whether an edge was dropped.
    pub(super) fn has_barred(&self) -> bool {
        !self.barred.is_empty()
    }

    /// Whether there are limits that somebody had to keep.
    pub(super) fn is_judged(&self) -> bool {
        let is_kept = |node: &Watched| node.is_honest && !node.is_beyond;
        self.scenario.safety.heard_rate.is_some() && self.nodes.iter().any(is_kept)
    }

    /// Edges to liars that had to be dropped, and were.
    pub(super) fn noticed(&self) -> u64 {
        self.noticed
    }

    /// Takes a tick, and what nodes have told since the last one.
    pub(super) fn tick<V: VectorField<f32> + Clone>(
        &mut self,
        moment: &Moment<'_>,
        told: &[NodeEvent],
        nodes: &[Node<f32, V>],
    ) -> Result<(), Broken> {
        // The first component stands for all: those of a state are barred together.
        let components = self.scenario.components();
        let state = |index: usize| {
            let ran = moment.presence.get(index) == Some(&Presence::Ran);
            moment.x.get(index * components).copied().filter(|_| ran)
        };
        told.iter().for_each(|event| self.note_coming(event));
        // What they say at this tick may have been heard already.
        for index in 0..self.nodes.len() {
            self.measure(index, moment);
        }
        for event in told {
            self.take(event, moment.k)?;
        }
        for watch in &mut self.lies {
            watch.tick(self.scenario, moment, &state, nodes);
        }
        let barred = &self.barred;
        for watch in &mut self.lies {
            let liar = watch.liar;
            let mut done = Vec::new();
            for &(node, _, due) in
                watch.hear.iter().filter(|(_, _, due)| due.is_some_and(|due| moment.k >= due))
            {
                let is_there = moment.presence.get(node) == Some(&Presence::Ran);
                if is_there && due.is_some() && !barred.contains(&(node, liar)) {
                    return Err(Broken::Unnoticed(moment.k, node, liar));
                }
                self.noticed += u64::from(is_there);
                done.push(node);
            }
            watch.hear.retain(|(node, ..)| !done.contains(node));
        }
        for (index, last) in self.last.iter_mut().enumerate() {
            *last = state(index);
        }
        Ok(())
    }

    /// Takes note of a node that listens, and then speaks: where it comes is not from where it was.
    fn note_coming(&mut self, told: &NodeEvent) {
        match told.event {
            Event::Listens { .. } => self.nodes[told.node].listens = true,
            Event::Joins { .. } => {
                (self.nodes[told.node].listens, self.nodes[told.node].speaks) = (false, true);
                self.last[told.node] = None;
            }
            _ => {}
        }
    }

    fn take(&mut self, told: &NodeEvent, k: u64) -> Result<(), Broken> {
        let (other, is_fast) = match told.event {
            Event::TooFast { node, .. } => (node, true),
            // Farther away than the limit honest nodes may be.
            Event::Barred(node) => (node, self.scenario.safety.heard_limit.is_none()),
            _ => return Ok(()),
        };
        let other = usize::from(other.get()) - 1;
        if matches!(told.event, Event::Barred(_)) {
            self.barred.push((told.node, other));
        }
        let watched = self.nodes[other];
        if is_fast && watched.is_honest && !watched.is_beyond {
            return Err(Broken::Wronged(k, told.node, other));
        }
        Ok(())
    }

    /// How fast and how far away a node is that speaks.
    fn measure(&mut self, index: usize, moment: &Moment<'_>) {
        let Some(node) = self.scenario.nodes.get(index) else { return };
        let components = self.scenario.components();
        let states = moment.x.iter().skip(index * components).take(components);
        let noise = DEVIATIONS * node.noise;
        let safety = &self.scenario.safety;
        let is_far =
            safety.heard_limit.is_some_and(|limit| states.clone().any(|x| x.abs() + noise > 0.99 * limit));
        let change = self.last[index].zip(states.clone().next()).map(|(last, x)| (x - last).abs());
        // Other components may be faster.
        let is_known = components == 1;
        let is_fast = safety.heard_rate.zip(change).is_some_and(|(rate, change)| {
            !is_known || change + 2.0 * noise > 0.999 * rate * self.scenario.time.tick_s() - 1e-6
        });
        let watched = &mut self.nodes[index];
        watched.speaks &= moment.presence.get(index) != Some(&Presence::Off);
        watched.is_beyond |= !watched.listens && (is_fast || is_far);
    }

    /// Nobody bars who has started anew after its last lie, and has kept the limits. Gives how many have.
    pub(super) fn end<V: VectorField<f32> + Clone>(
        &self,
        nodes: &[Node<f32, V>],
        are_joined: impl Fn(usize, usize) -> bool,
    ) -> Result<u64, Broken> {
        let mut renewed = 0;
        // Who has stopped hears nobody any more.
        let runs = |index: usize| nodes.get(index).is_some_and(|node| node.phase() == Phase::Running);
        for other in (0..nodes.len()).filter(|&other| runs(other) && self.has_started_anew(other)) {
            let Some(id) = u8::try_from(other + 1).ok().and_then(NodeId::new) else { continue };
            for (index, _) in self.scenario.graph.neighbours(other) {
                let bars = nodes.get(index).and_then(|node| node.neighbour_is_barred(id)) == Some(true);
                if bars && runs(index) && are_joined(index, other) {
                    return Err(Broken::StillBarred(index, other));
                }
            }
            renewed += 1;
        }
        Ok(renewed)
    }

    /// Whether a node that neighbours have barred was off for long enough after its last lie, and has been on for long since.
    fn has_started_anew(&self, node: usize) -> bool {
        let time = &self.scenario.time;
        // One that nobody can tell the time does not find back.
        let leads = |sync: &SyncSpec| sync.masters.iter().any(|&id| usize::from(id) == node + 1);
        if self.scenario.sync.as_ref().is_some_and(leads) {
            return false;
        }
        let false_until = self.scenario.events.iter().filter(|event| is_false(event, node));
        let false_until = false_until.map(|event| time.first_tick(event.end_ns())).max().unwrap_or(0);
        let last = self.scenario.course().absences(time).into_iter().rfind(|absence| absence.node == node);
        let is_long = last.is_some_and(|absence| {
            let Some(to) = absence.to_tick else { return false };
            let listens = 500 + 2 * EXTRAPOLATED;
            absence.from_tick >= false_until
                && to - absence.from_tick > EXTRAPOLATED + 2
                && to + listens < time.ticks
        });
        is_long
            && self.nodes[node].speaks
            && !self.nodes[node].is_beyond
            && self.barred.iter().any(|&(_, other)| other == node)
    }
}

/// Whether an event has a node say, or be said to say, what is not so.
fn is_false(event: &EventSpec, node: usize) -> bool {
    let of_it = event.targets.nodes().contains(&node);
    match (event.kind, &event.detail) {
        (EventKind::Liar | EventKind::Replayer | EventKind::Sensor, _) => of_it,
        (EventKind::Impostor, Detail::Impostor { name, .. }) => *name == node,
        _ => false,
    }
}

/// The lies of which it is known what becomes: nothing else happens meanwhile, and every frame comes.
fn watches(scenario: &Scenario) -> Vec<Watch> {
    let is_plain = scenario.bus.model == BusModel::Ideal
        && scenario.bus.loss.is_none()
        && scenario.links.is_empty()
        && scenario.clocks.is_empty()
        && scenario.components() == 1
        && scenario.time.start.is_none();
    if !is_plain {
        return Vec::new();
    }
    let watch = |(at, event): (usize, &EventSpec)| {
        let Detail::Lie(lie) = event.detail else { return None };
        let &[liar] = event.targets.nodes() else { return None };
        let (from, to) = (scenario.time.first_tick(event.at_ns), scenario.time.first_tick(event.end_ns()));
        // The edge is known again before, and nobody goes until it is dropped.
        let (begin, end) = (event.at_ns.saturating_sub(20_000_000), event.end_ns());
        let is_apart =
            |(other, it): (usize, &EventSpec)| other == at || it.end_ns() < begin || it.at_ns > end;
        let is_alone = scenario.events.iter().enumerate().all(is_apart);
        is_alone.then(|| Watch { liar, lie, from, to, first: None, hear: Vec::new() })
    };
    scenario
        .events
        .iter()
        .enumerate()
        .filter(|(_, event)| event.kind == EventKind::Liar)
        .filter_map(watch)
        .collect()
}

impl Watch {
    fn tick<V: VectorField<f32> + Clone>(
        &mut self,
        scenario: &Scenario,
        moment: &Moment<'_>,
        state: &impl Fn(usize) -> Option<f64>,
        nodes: &[Node<f32, V>],
    ) {
        let Some(x) = state(self.liar) else { return self.hear.clear() };
        if moment.k + 1 == self.from {
            self.hear = hearers(scenario, self.liar, nodes)
                .filter(|&node| state(node).is_some())
                .map(|node| (node, Listener::of((moment.k, x)), None))
                .collect();
        }
        if !(self.from..self.to).contains(&moment.k) {
            return;
        }
        let first = *self.first.get_or_insert(x);
        let t = (moment.k - self.from) as f64 * scenario.time.tick_s();
        let says = said(self.lie, first, x, t);
        let noise = scenario.nodes.get(self.liar).map_or(0.0, |node| DEVIATIONS * node.noise);
        self.hear.retain_mut(|(_, listener, due)| {
            if due.is_some() {
                return true;
            }
            match listener.hears((moment.k, says), &scenario.safety, scenario.time.tick_s(), noise) {
                Fate::Goes => true,
                Fate::Unknown => false,
                Fate::Bars => {
                    *due = Some(moment.k + WORD);
                    true
                }
            }
        });
    }
}

/// Neighbours that hear a node, and have not dropped its edge.
fn hearers<V: VectorField<f32> + Clone>(
    scenario: &Scenario,
    node: usize,
    nodes: &[Node<f32, V>],
) -> impl Iterator<Item = usize> {
    let id = u8::try_from(node + 1).ok().and_then(NodeId::new);
    scenario.graph.neighbours(node).into_iter().map(|(other, _)| other).filter(move |&other| {
        let (Some(id), Some(listener)) = (id, nodes.get(other)) else { return false };
        listener.neighbour_presence(id) == Some(Known::Known)
            && listener.neighbour_is_barred(id) == Some(false)
    })
}
