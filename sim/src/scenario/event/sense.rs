//! What only the whole scenario shows of its events: an event that lies outside the run, or that changes nothing, is refused.

use super::course::{Change, Course};
use super::spell::let_go;
use super::{ActuatorFault, Detail, EventKind, EventSpec, Lie, SensorFault, Targets};
use crate::scenario::diagnostic::Problem;
use crate::scenario::reader::Log;
use crate::scenario::tree::{Item, Value};
use crate::scenario::{BusModel, Coupling, Expect, Graph, TimeSpec, format_duration};
use std::collections::BTreeSet;

/// The last tick at which a node may come. It learns the tick from a SYNC, which carries 24 bits of it, and takes one that is
/// less than half of their range ahead.
pub(in crate::scenario) const LAST_JOIN: u64 = (1 << 23) - 1;

/// Most events, and most nodes and links that they change in all: more would take longer than the run.
pub(in crate::scenario) const MOST_EVENTS: usize = 1_000;
const MOST_CHANGES: usize = 1_000_000;

/// Most ticks after which a state may be said once more: each of them is kept until then.
pub(in crate::scenario) const OLDEST: u64 = 100_000;

/// What events are looked at with.
pub(in crate::scenario) struct Setting<'a> {
    pub time: &'a TimeSpec,
    pub graph: &'a Graph,
    pub coupling: Coupling<f64>,
    pub bus: BusModel,
    /// Whether nodes have clocks of their own.
    pub clocks: bool,
    /// Whether a time master keeps them together.
    pub sync: bool,
    pub root: &'a Item,
    pub log: &'a Log,
}

/// Puts `events`, and those that `draw` adds to them, in the order of time, and reports what is wrong with them and with `expect.recovered_within`.
pub(in crate::scenario) fn make_sense(
    events: Vec<EventSpec>,
    expect: &Expect,
    setting: &Setting<'_>,
    draw: impl FnOnce(&[EventSpec]) -> Vec<EventSpec>,
) -> Vec<EventSpec> {
    let items: &[Item] = match setting.root.get("event").map(|item| &item.value) {
        Some(Value::Array(items)) => items,
        _ => &[],
    };
    let mut placed: Vec<(EventSpec, &Item)> = events.into_iter().zip(items).collect();
    // Stable: what happens at the same time happens in the order of the file.
    placed.sort_by_key(|(event, _)| event.at_ns);
    let (mut events, items): (Vec<EventSpec>, Vec<&Item>) = placed.into_iter().unzip();
    if let Some(event) = items.first().filter(|_| setting.coupling == Coupling::WeaklyCentralised) {
        let allowed =
            "must not be there with weakly-centralised coupling, which is simulated without nodes and links";
        setting.log.report(event.diagnostic(Problem::Value, allowed));
        return events;
    }
    let of_buses = events.iter().zip(&items).find(|(event, _)| !event.kind.is_of_nodes());
    if let Some((_, event)) = of_buses.filter(|_| setting.bus == BusModel::Uart) {
        let allowed = "must not be there with this bus.model: but for sensor, actuator and set, events happen on the ideal bus and on CAN, so far";
        setting.log.report(event.diagnostic(Problem::Value, allowed));
        return events;
    }
    if let Some(item) = items.get(MOST_EVENTS) {
        let allowed = format!("is one event too many: a scenario takes {MOST_EVENTS}");
        setting.log.report(item.diagnostic(Problem::Value, allowed));
        return events;
    }
    let mut changes = 0;
    for (event, item) in events.iter().zip(&items) {
        changes += setting.of_the_graph(event, item);
        if changes > MOST_CHANGES {
            let allowed =
                format!("events change {MOST_CHANGES} nodes and links at most, up to and with this one more");
            setting.log.report(item.diagnostic(Problem::Value, allowed));
            return events;
        }
    }
    setting.end(&mut events, &items);
    events.iter().zip(&items).for_each(|(event, item)| setting.in_the_run(event, item));
    setting.frames(&events, &items);
    setting.plants(&events, &items);
    let course = Course::of(&events, setting.graph);
    setting.walk(&events, &items, &course);
    events.extend(draw(&events));
    events.sort_by_key(|event| event.at_ns);
    setting.recovery(&events, expect, &Course::of(&events, setting.graph));
    events
}

/// Why no node of a scenario can have a plant that fails, if none can.
pub(in crate::scenario) fn no_plants(time: &TimeSpec) -> Option<&'static str> {
    if !time.start.is_none() {
        return Some("must not be there with time.slow_start: a plant has its own time");
    }
    (time.round > 1)
        .then_some("must not be there with time.round: no node measures between two rounds, so far")
}

impl Setting<'_> {
    /// Reports at `key` of an event, or at the event where it has no such key.
    fn report(&self, item: &Item, key: &str, allowed: String) {
        let at = item.get(key).unwrap_or(item);
        self.log.report(at.diagnostic(Problem::Value, allowed));
    }

    fn end_ns(&self) -> u64 {
        self.time.end_ns()
    }

    fn in_the_run(&self, event: &EventSpec, item: &Item) {
        let end = format_duration(self.end_ns());
        let back_ns = event.at_ns.saturating_add(event.lasts_ns);
        let comes = matches!(event.kind, EventKind::Join | EventKind::Bounce);
        if event.at_ns > self.end_ns() {
            self.report(item, "at", format!("must not be later than the end of the run, {end}"));
        } else if back_ns > self.end_ns() {
            let allowed = match event.kind {
                EventKind::Bounce => {
                    format!("must bring the node back by the end of the run, {end}; a crash does not")
                }
                _ => format!("must be over by the end of the run, {end}"),
            };
            self.report(item, if item.get("for").is_some() { "for" } else { "at" }, allowed);
        } else if comes && self.time.first_tick(back_ns) > LAST_JOIN {
            let last = format_duration(self.time.at_ns(LAST_JOIN));
            let allowed = format!("no node can come later than {last}: a SYNC tells it 24 bits of the tick");
            self.report(item, "at", allowed);
        }
    }

    /// The links of an event are edges. Gives how many nodes or links it has.
    fn of_the_graph(&self, event: &EventSpec, item: &Item) -> usize {
        let links = if event.kind.is_of_frames() {
            event.targets.frames(self.graph)
        } else {
            event.targets.links(self.graph)
        };
        let count = event.targets.nodes().len() + links.len();
        let needs_links = event.kind.is_of_presence() || event.kind.is_of_frames();
        if !links.is_empty() || count > 0 && !event.kind.is_of_frames() || !needs_links {
            return count;
        }
        match &event.targets {
            Targets::Link(a, _) => {
                let near: Vec<_> =
                    self.graph.neighbours(*a).iter().map(|(other, _)| (other + 1).to_string()).collect();
                let allowed =
                    format!("must be an edge of the graph; node {} has edges to {}", a + 1, near.join(", "));
                self.report(item, "link", allowed);
            }
            Targets::Groups(_) => self.report(
                item,
                "groups",
                "must have an edge of the graph from one group to another".to_owned(),
            ),
            _ => self.report(item, "kind", "needs a link, and the graph has none there".to_owned()),
        }
        0
    }

    /// What goes on to the end of the run ends there; frames that nobody lets go would be a partition.
    fn end(&self, events: &mut [EventSpec], items: &[&Item]) {
        let let_go = let_go(events, self.graph);
        let mut last = vec![0; events.len()];
        for (&(event, _), &end) in &let_go {
            last[event] = end.max(last[event]);
        }
        let held: BTreeSet<_> = let_go.into_iter().map(|((_, link), end)| (link, end)).collect();
        for (index, (event, item)) in events.iter_mut().zip(items).enumerate() {
            let left = self.end_ns().saturating_sub(event.at_ns);
            match event.kind {
                EventKind::Hold if last[index] == u64::MAX => {
                    self.report(item, "kind", "needs for, or a release of all its links later".to_owned());
                    event.lasts_ns = left;
                }
                EventKind::Hold => event.lasts_ns = last[index].saturating_sub(event.at_ns),
                EventKind::Release => {
                    let mut links = event.targets.frames(self.graph).into_iter();
                    if !links.any(|link| held.contains(&(link, event.at_ns))) {
                        let allowed = "changes nothing: no frame is held on its links then".to_owned();
                        self.report(item, "kind", allowed);
                    }
                }
                _ if event.lasts_ns == u64::MAX => event.lasts_ns = left,
                _ => {}
            }
        }
    }

    /// Events of frames change something, on a bus that can do that.
    fn frames(&self, events: &[EventSpec], items: &[&Item]) {
        for (event, item) in events.iter().zip(items) {
            match (event.kind, &event.detail) {
                (kind, _) if kind.is_of_wires() && !self.bus.is_can() => {
                    let allowed = "needs bus.model = \"can\" or \"can-fd\", which have a wire";
                    self.report(item, "kind", allowed.to_owned());
                }
                (EventKind::Burst, Detail::Loss(loss)) if loss.is_none() => {
                    self.report(item, "loss", "must lose something".to_owned());
                }
                (EventKind::Liar | EventKind::Impostor, Detail::Lie(lie) | Detail::Impostor { lie, .. })
                    if *lie == Lie::Offset(0.0) && event.kind == EventKind::Liar =>
                {
                    self.report(item, "offset", "must not be zero: that is no lie".to_owned());
                }
                (EventKind::Impostor, Detail::Impostor { name, .. })
                    if event.targets.nodes().contains(name) =>
                {
                    let allowed = format!("must be another node: node {} speaks for itself", name + 1);
                    self.report(item, "as", allowed);
                }
                (EventKind::Replayer, Detail::Age(age))
                | (EventKind::Sensor, Detail::Sensor(SensorFault::Age(age)))
                    if *age < self.time.tick_ns || *age / self.time.tick_ns > OLDEST =>
                {
                    let [low, high] = [1, OLDEST].map(|ticks| format_duration(ticks * self.time.tick_ns));
                    self.report(item, "age", format!("must be from {low} to {high}: 1 to {OLDEST} ticks"));
                }
                _ => {}
            }
        }
    }

    /// Events of plants change something, in a scenario whose nodes can have plants.
    fn plants(&self, events: &[EventSpec], items: &[&Item]) {
        let of_plants = |(event, _): &(&EventSpec, &&Item)| event.kind.is_of_plants();
        for (event, item) in events.iter().zip(items).filter(of_plants) {
            if let Some(why) = no_plants(self.time) {
                self.report(item, "kind", why.to_owned());
            }
            match event.detail {
                Detail::Sensor(SensorFault::Gives(Lie::Offset(0.0))) => {
                    self.report(item, "offset", "must not be zero: that is no fault".to_owned());
                }
                Detail::Actuator(ActuatorFault::Part(1.0)) => {
                    self.report(item, "effectiveness", "must be below 1: that is no fault".to_owned());
                }
                _ => {}
            }
        }
    }

    /// Goes through the run, and reports events that change nothing.
    fn walk(&self, events: &[EventSpec], items: &[&Item], course: &Course) {
        // When each node went off; `None` while it is on.
        let mut off: Vec<Option<u64>> =
            (0..self.graph.nodes).map(|node| course.begins_absent(node).then_some(0)).collect();
        let (mut cut, mut idle) = (BTreeSet::new(), vec![true; events.len()]);
        for step in course.steps() {
            let Some(item) = items.get(step.event) else { continue };
            let (key, at) =
                (if item.get("node").is_some() { "node" } else { "nodes" }, format_duration(step.at_ns));
            let changes = match step.change {
                Change::Off { node, .. } => match off[node].replace(step.at_ns) {
                    None => true,
                    Some(since) => {
                        let since = format_duration(since);
                        self.report(item, key, format!("node {} is off at {at}, since {since}", node + 1));
                        return;
                    }
                },
                Change::On { node } => {
                    if off[node].take().is_none() {
                        self.report(item, key, format!("node {} is on at {at}, and cannot come", node + 1));
                        return;
                    }
                    if step.at_ns == 0 && course.begins_absent(node) {
                        self.report(
                            item,
                            "at",
                            "must be later than 0s: until it joins, a node is absent".to_owned(),
                        );
                        return;
                    }
                    true
                }
                Change::Cut(a, b) => cut.insert((a, b)),
                Change::Mend(a, b) => cut.remove(&(a, b)),
            };
            if let Some(idle) = idle.get_mut(step.event) {
                *idle &= !changes;
            }
        }
        for ((event, item), _) in events.iter().zip(items).zip(&idle).filter(|(_, idle)| **idle) {
            if !event.kind.is_of_presence() || event.targets.links(self.graph).is_empty() {
                continue;
            }
            let state = if event.kind == EventKind::Repair { "not cut" } else { "cut" };
            let at = format_duration(event.at_ns);
            self.report(item, "kind", format!("changes nothing: its links are {state} at {at} already"));
        }
    }

    /// `expect.recovered_within` needs events that end, and time to be judged after them.
    fn recovery(&self, events: &[EventSpec], expect: &Expect, course: &Course) {
        let Some(within) = expect.recovered_within_ns else { return };
        let key = self.root.get("expect").and_then(|expect| expect.get("recovered_within"));
        let Some(item) = key else { return };
        let refuse = |allowed: String| self.log.report(item.diagnostic(Problem::Value, allowed));
        let ends: Option<Vec<u64>> =
            course.disturbances(events).iter().map(|disturbance| disturbance.end_ns).collect();
        match ends.map(|ends| ends.into_iter().max()) {
            None => refuse("must not be there while a partition is never repaired".to_owned()),
            Some(None) => refuse("must not be there without an [[event]] to recover from".to_owned()),
            Some(Some(last)) if last.saturating_add(within) > self.end_ns() => {
                let left = format_duration(self.end_ns().saturating_sub(last));
                refuse(format!("must not be longer than what the run has after its last event, {left}"));
            }
            Some(Some(_)) => {}
        }
    }
}
