//! Lies of which a second form of the rule ([`super::model`]) tells when they cost the edge: then, no earlier and no later.

use super::Broken;
use super::model::{Fate, Listener, said};
use funnelnet_law::field::VectorField;
use funnelnet_node::Node;
use funnelnet_node::neighbour::Presence as Known;
use funnelnet_protocol::NodeId;
use sim_host::judge::Moment;
use sim_host::presence::Presence;
use sim_host::scenario::{BusModel, Detail, EventKind, EventSpec, Lie, Scenario};

/// An edge that was dropped.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Dropped {
    /// Who dropped it.
    pub(super) node: usize,
    pub(super) other: usize,
    /// The tick at which it was told.
    pub(super) at: u64,
}

/// A lie that begins, and who hears it.
pub(super) struct Watch {
    liar: usize,
    lie: Lie,
    /// The first and the last state that is false, by its tick: it goes out a tick before.
    from: u64,
    to: u64,
    /// When it began, s.
    at_s: f64,
    /// Ticks that a state may be under way beside the one that it has.
    delay: u64,
    first: Option<f64>,
    hear: Vec<Hearer>,
}

/// A neighbour that hears a liar.
struct Hearer {
    node: usize,
    listener: Listener,
    /// When the edge has to be gone.
    due: Option<u64>,
}

/// The lies of which it is known what becomes: nothing else happens meanwhile, and every frame comes.
pub(super) fn watches(scenario: &Scenario) -> Vec<Watch> {
    let safety = &scenario.safety;
    let is_plain = (safety.heard_rate.is_some() || safety.heard_limit.is_some())
        && scenario.bus.model == BusModel::Ideal
        && scenario.bus.loss.is_none()
        && scenario.links.is_empty()
        && scenario.clocks.is_empty()
        && scenario.components() == 1
        && scenario.time.start.is_none();
    if !is_plain {
        return Vec::new();
    }
    let delay = (scenario.bus.latency_ns + scenario.bus.jitter_ns).div_ceil(scenario.time.tick_ns);
    let watch = |(at, event): (usize, &EventSpec)| {
        let Detail::Lie(lie) = event.detail else { return None };
        let &[liar] = event.targets.nodes() else { return None };
        let (from, to) =
            (scenario.time.first_tick(event.at_ns) + 1, scenario.time.first_tick(event.end_ns()));
        let at_s = event.at_ns as f64 * 1e-9;
        // The edge is known again before, and nobody goes until it is dropped.
        let (begin, end) = (event.at_ns.saturating_sub(20_000_000), event.end_ns());
        let is_apart =
            |(other, it): (usize, &EventSpec)| other == at || it.end_ns() < begin || it.at_ns > end;
        let is_alone = scenario.events.iter().enumerate().all(is_apart);
        is_alone.then(|| Watch { liar, lie, from, to, at_s, delay, first: None, hear: Vec::new() })
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
    /// Takes a tick, and the edges that were dropped so far. Gives how many had to be dropped by now, and were.
    pub(super) fn tick<V: VectorField<f32> + Clone>(
        &mut self,
        scenario: &Scenario,
        moment: &Moment<'_>,
        nodes: &[Node<f32, V>],
        dropped: &[Dropped],
    ) -> Result<u64, Broken> {
        let k = moment.k;
        let state = |index: usize| {
            let ran = moment.presence.get(index) == Some(&Presence::Ran);
            moment.x.get(index).copied().filter(|_| ran)
        };
        let Some(x) = state(self.liar) else {
            self.hear.clear();
            return Ok(0);
        };
        if k + 1 == self.from {
            self.hear = hearers(scenario, self.liar, nodes)
                .filter(|&node| state(node).is_some())
                .map(|node| Hearer { node, listener: Listener::of((k, x)), due: None })
                .collect();
        }
        if (self.from..=self.to).contains(&k) {
            let first = *self.first.get_or_insert(x);
            let t = scenario.time.at_s(k - 1) - self.at_s;
            let noise =
                scenario.nodes.get(self.liar).map_or(0.0, |node| super::heard::DEVIATIONS * node.noise);
            self.say(scenario, (k, said(self.lie, first, x, t)), noise);
        }
        self.judge(k, &|node| state(node).is_some(), nodes, dropped)
    }

    /// Has all hear a state.
    fn say(&mut self, scenario: &Scenario, (k, x): (u64, f64), noise: f64) {
        let delay = self.delay;
        self.hear.retain_mut(|hearer| {
            if hearer.due.is_some() {
                return true;
            }
            match hearer.listener.hears((k, x), &scenario.safety, scenario.time.tick_s(), noise) {
                Fate::Goes => true,
                Fate::Unknown => false,
                Fate::Bars => {
                    hearer.due = Some(k + delay);
                    true
                }
            }
        });
    }

    /// Whether all have dropped the edge that had to, and nobody else.
    fn judge<V: VectorField<f32> + Clone>(
        &mut self,
        k: u64,
        is_there: &impl Fn(usize) -> bool,
        nodes: &[Node<f32, V>],
        dropped: &[Dropped],
    ) -> Result<u64, Broken> {
        let (liar, from) = (self.liar, self.from);
        let mut noticed = 0;
        for &Hearer { node, due, .. } in self.hear.iter().filter(|hearer| is_there(hearer.node)) {
            let told =
                dropped.iter().find(|edge| (edge.node, edge.other) == (node, liar) && edge.at + 1 >= from);
            match due {
                Some(due) if k >= due => {
                    if told.is_none() || !bars(nodes, node, liar) {
                        return Err(Broken::Unnoticed(k, node, liar));
                    }
                    noticed += 1;
                }
                // A state of the next tick may have been heard already.
                None if told.is_some_and(|told| told.at < k) => return Err(Broken::Wronged(k, node, liar)),
                _ => {}
            }
        }
        self.hear.retain(|hearer| hearer.due.is_none_or(|due| k < due) && is_there(hearer.node));
        if k > self.to {
            self.hear.retain(|hearer| hearer.due.is_some());
        }
        Ok(noticed)
    }
}

/// Whether a node bars another one.
pub(super) fn bars<V: VectorField<f32> + Clone>(nodes: &[Node<f32, V>], node: usize, other: usize) -> bool {
    let id = u8::try_from(other + 1).ok().and_then(NodeId::new);
    id.zip(nodes.get(node)).is_some_and(|(id, node)| node.neighbour_is_barred(id) == Some(true))
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
