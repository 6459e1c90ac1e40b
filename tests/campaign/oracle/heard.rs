//! Limits of what is heard: who is honest and slow enough is taken, who lies beyond them is not, and who starts anew is heard again.

use super::Broken;
use super::lies::{Dropped, Watch, bars, watches};
use funnelnet_law::field::VectorField;
use funnelnet_node::{Event, Node, Phase};
use sim_host::engine::NodeEvent;
use sim_host::judge::Moment;
use sim_host::presence::Presence;
use sim_host::scenario::{BusModel, Detail, EventKind, EventSpec, Scenario, SyncSpec};

/// Standard deviations of noise that nobody sees in these runs.
pub(super) const DEVIATIONS: f64 = 7.0;
/// The longest time for which a silent neighbour is extrapolated, ticks: who is silent for longer may be anywhere after it.
const EXTRAPOLATED: u64 = 120;
/// Ticks after which a stamp comes again, less the two by which a state may be ahead, and some to spare.
const ALIASED: u64 = 250;
/// Ticks after which a node that was silent is heard again.
const HEARD: u64 = 20;

/// What is watched of a run with limits.
pub(super) struct Heard<'a> {
    scenario: &'a Scenario,
    nodes: Vec<Watched>,
    /// What arrives is what was said, and of the tick that it was said at.
    is_sound: bool,
    /// States at the tick before, by index; none of who was not there.
    last: Vec<Option<f64>>,
    lies: Vec<Watch>,
    dropped: Vec<Dropped>,
    /// Edges that are barred of which nothing has been told yet: node and neighbour.
    untold: Vec<(usize, usize)>,
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
    /// Ticks for which nobody has heard it, though it runs.
    unheard: u64,
    /// When it was heard again after so long a silence that it may be anywhere.
    is_back: Option<u64>,
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
        let is_sound = !bits_flip && !is_held;
        // Who restarts says so, in one frame.
        let may_miss = !keeps_frames(scenario);
        let watched = |index: usize| {
            let is_short = may_miss
                && absences.iter().any(|absence| {
                    let ticks = absence.to_tick.map_or(u64::MAX, |to| to - absence.from_tick);
                    absence.node == index && ticks <= EXTRAPOLATED + 1
                });
            let lies = scenario.events.iter().any(|event| is_false(event, index));
            Watched {
                is_honest: is_sound && !is_short && !lies,
                listens: false,
                speaks: true,
                is_beyond: false,
                unheard: 0,
                is_back: None,
            }
        };
        Self {
            scenario,
            nodes: (0..scenario.nodes.len()).map(watched).collect(),
            is_sound,
            last: vec![None; scenario.nodes.len()],
            lies: watches(scenario),
            dropped: Vec::new(),
            untold: Vec::new(),
            noticed: 0,
        }
    }

    /// Whether an edge was dropped.
    pub(super) fn has_barred(&self) -> bool {
        !self.dropped.is_empty()
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
        are_joined: impl Fn(usize, usize) -> bool,
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
            self.noticed += watch.tick(self.scenario, moment, nodes, &self.dropped)?;
        }
        self.says_what_it_drops(moment.k, nodes)?;
        self.count_silence(moment.k, are_joined);
        for (index, last) in self.last.iter_mut().enumerate() {
            *last = state(index);
        }
        Ok(())
    }

    /// Nobody bars a neighbour without a word, which with a clock of its own comes a tick later. One that has come and knows no tick yet
    /// says it when it does.
    fn says_what_it_drops<V: VectorField<f32> + Clone>(
        &mut self,
        k: u64,
        nodes: &[Node<f32, V>],
    ) -> Result<(), Broken> {
        let is_told =
            |(node, other)| self.dropped.iter().any(|edge| (edge.node, edge.other) == (node, other));
        let ends = self.scenario.graph.edges.iter().flat_map(|edge| [(edge.a, edge.b), (edge.b, edge.a)]);
        let untold: Vec<_> = ends
            .filter(|&(node, other)| {
                self.nodes[node].speaks && bars(nodes, node, other) && !is_told((node, other))
            })
            .collect();
        if let Some(&(node, other)) = untold.iter().find(|edge| self.untold.contains(edge)) {
            return Err(Broken::Wronged(k, node, other));
        }
        self.untold = untold;
        Ok(())
    }

    /// Takes note of nodes that are cut off from all others.
    fn count_silence(&mut self, k: u64, are_joined: impl Fn(usize, usize) -> bool) {
        for (index, watched) in self.nodes.iter_mut().enumerate() {
            let is_heard =
                self.scenario.graph.neighbours(index).iter().any(|&(other, _)| are_joined(index, other));
            if is_heard && watched.unheard > EXTRAPOLATED + 2 {
                watched.is_back = Some(k);
            }
            watched.unheard = if is_heard { 0 } else { watched.unheard + 1 };
        }
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
            self.dropped.push(Dropped { node: told.node, other, at: k });
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
            for (index, _) in self.scenario.graph.neighbours(other) {
                if bars(nodes, index, other) && runs(index) && are_joined(index, other) {
                    return Err(Broken::StillBarred(index, other));
                }
            }
            renewed += 1;
        }
        Ok(renewed)
    }

    /// Whether a node that neighbours have barred was off after its last lie, or silent for long, and has been on for long since.
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
        let is_told = keeps_frames(self.scenario);
        let was_off = last.is_some_and(|absence| {
            let Some(to) = absence.to_tick else { return false };
            let listens = 500 + 2 * EXTRAPOLATED;
            absence.from_tick >= false_until
                && (is_told || to - absence.from_tick > EXTRAPOLATED + 2)
                && to + listens < time.ticks
        });
        let was_silent = self.nodes[node]
            .is_back
            .is_some_and(|back| back >= false_until + EXTRAPOLATED + 2 && back + HEARD < time.ticks);
        (was_off || was_silent)
            && self.is_sound
            && self.nodes[node].speaks
            && !self.nodes[node].is_beyond
            && self.dropped.iter().any(|edge| edge.other == node)
    }
}

/// Whether every frame comes, and in order: what a node says once is heard.
fn keeps_frames(scenario: &Scenario) -> bool {
    let loses = |event: &EventSpec| {
        matches!(
            event.kind,
            EventKind::Partition
                | EventKind::Repair
                | EventKind::Burst
                | EventKind::Hold
                | EventKind::Corrupt
        )
    };
    scenario.bus.model == BusModel::Ideal
        && scenario.bus.loss.is_none()
        && scenario.bus.jitter_ns == 0
        && scenario.links.is_empty()
        && !scenario.events.iter().any(loses)
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
