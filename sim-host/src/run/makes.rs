//! Which events of a scenario a host can make on nodes that are not in its program (docs/book/src/faults.md).
//!
//! An event is made whole or not at all. What belongs together is made together: a node that is not taken off does not
//! come, and a link that is not cut is not mended.

use crate::configure::listeners;
use crate::engine::Scene;
use crate::scenario::{Detail, EventKind, EventSpec, Scenario, Targets};
use std::collections::BTreeSet;

/// How the nodes of a scenario are reached, by index.
#[derive(Clone, Debug, Default)]
pub(super) struct Reach {
    /// They tick by clocks of their own.
    pub own_clock: bool,
    /// Time masters among them tell the tick by SYNC, which this program carries.
    pub has_masters: bool,
    /// Nodes whose states travel on CAN.
    pub on_can: BTreeSet<usize>,
    /// Lines from node to node, the lower index first.
    pub wires: BTreeSet<(usize, usize)>,
    /// Nodes that are known to keep nothing that is staged in them.
    pub forgetful: BTreeSet<usize>,
}

/// An event that is not made.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Skipped {
    pub event: EventSpec,
    /// The rest of a sentence about it.
    pub why: &'static str,
}

const ON_ITS_OWN_WAY: &str = "states travel without this program, on CAN or on a line from node to node";
const OWN_CLOCK: &str = "no node that ticks by its own clock is taken off or brought back without [sync]: nobody could tell it the tick";

impl Reach {
    /// The events of a scenario that are made, and those that are not; both in their order.
    pub fn divide(&self, scenario: &Scenario) -> (Vec<EventSpec>, Vec<Skipped>) {
        let mut why: Vec<Option<&'static str>> =
            scenario.events.iter().map(|event| self.why_not(event, scenario)).collect();
        leave_nodes_whole(&scenario.events, &mut why);
        leave_links_whole(scenario, &mut why);
        leave_sets_whole(&scenario.events, &mut why);
        let (mut made, mut skipped) = (Vec::new(), Vec::new());
        for (event, why) in scenario.events.iter().cloned().zip(why) {
            match why {
                None => made.push(event),
                Some(why) => skipped.push(Skipped { event, why }),
            }
        }
        (made, skipped)
    }

    /// Who is on and which links are cut, where events change that.
    pub fn scene(&self, scenario: &Scenario) -> Option<Scene> {
        let mut listeners = listeners(scenario);
        for (from, list) in listeners.iter_mut().enumerate() {
            list.retain(|&to| !self.wires.contains(&(from.min(to), from.max(to))));
        }
        let course = scenario.course().on_clock(&scenario.time);
        (!scenario.stays_whole()).then(|| Scene::new(&course, scenario.time.tick_ns, listeners))
    }

    /// Why an event cannot be made by itself, if it cannot.
    fn why_not(&self, event: &EventSpec, scenario: &Scenario) -> Option<&'static str> {
        let own_ways = || event.targets.nodes().iter().any(|&node| self.has_own_way(node));
        let wired = || event.targets.nodes().iter().any(|&node| self.is_wired(node));
        let links = || event.targets.frames(&scenario.graph);
        match event.kind {
            EventKind::Crash | EventKind::Bounce | EventKind::Leave | EventKind::Join
                if self.own_clock && !self.has_masters =>
            {
                Some(OWN_CLOCK)
            }
            EventKind::Crash | EventKind::Bounce | EventKind::Leave | EventKind::Join => {
                wired().then_some("a node with lines to others passes on what it is told")
            }
            EventKind::Partition | EventKind::Burst | EventKind::Hold => {
                links().iter().any(|&link| !self.is_relayed(link)).then_some(ON_ITS_OWN_WAY)
            }
            // That of what they end.
            EventKind::Repair | EventKind::Release => None,
            EventKind::Corrupt => Some(
                "a serial line has a checksum, by which a wrong bit is a lost frame; the simulated bus has none",
            ),
            EventKind::Liar | EventKind::Replayer => own_ways().then_some(ON_ITS_OWN_WAY),
            EventKind::Impostor => {
                (own_ways() || self.is_heard_on_can(event, scenario)).then_some(ON_ITS_OWN_WAY)
            }
            EventKind::Clock => Some("a node's clock is its own"),
            EventKind::SyncLoss if self.has_masters => self
                .hears_a_master(event, scenario)
                .then_some("SYNC travels without this program, on CAN or on a line from node to node"),
            EventKind::SyncLoss if self.own_clock => Some("without [sync] there is no SYNC to lose"),
            EventKind::SyncLoss => Some("nodes tick by this program's SYNC, and would stand still"),
            EventKind::Noise | EventKind::Cut | EventKind::Short | EventKind::Babble => {
                Some("it happens to the wire of a bus, which this program does not have in its hands")
            }
            EventKind::Sensor | EventKind::Actuator => Some("it happens in the node"),
            EventKind::Set => self.is_forgotten(event).then_some(
                "a process without storage keeps nothing that is staged in it: give it storage = \"FILE\" in the bench file",
            ),
        }
    }

    /// Whether a node that it sets something on has nothing to keep that in until the tick.
    fn is_forgotten(&self, event: &EventSpec) -> bool {
        match &event.targets {
            Targets::AllNodes => !self.forgetful.is_empty(),
            targets => targets.nodes().iter().any(|node| self.forgetful.contains(node)),
        }
    }

    /// Whether a node's states reach a neighbour without this program.
    fn has_own_way(&self, node: usize) -> bool {
        self.on_can.contains(&node) || self.is_wired(node)
    }

    /// Whether somebody hears the SYNC of a master of this event without this program.
    fn hears_a_master(&self, event: &EventSpec, scenario: &Scenario) -> bool {
        let masters = scenario.sync.iter().flat_map(|sync| &sync.masters).map(|&id| usize::from(id) - 1);
        let all = event.targets == Targets::Masters;
        let mut named = masters.filter(|master| all || event.targets.nodes().contains(master));
        named.any(|master| self.has_own_way(master))
    }

    /// Whether the one whose name is taken, or a neighbour of who takes it, is on CAN: all on that bus would hear a false frame, or none.
    fn is_heard_on_can(&self, event: &EventSpec, scenario: &Scenario) -> bool {
        let name = match &event.detail {
            Detail::Impostor { name, .. } => Some(*name),
            _ => None,
        };
        let hear = |&node: &usize| scenario.graph.neighbours(node).into_iter().map(|(other, _)| other);
        let mut hearers = event.targets.nodes().iter().flat_map(hear).chain(name);
        hearers.any(|node| self.on_can.contains(&node))
    }

    fn is_wired(&self, node: usize) -> bool {
        self.wires.iter().any(|&(a, b)| node == a || node == b)
    }

    /// Whether the frames of a link pass this program, and nobody else hears them.
    fn is_relayed(&self, (a, b): (usize, usize)) -> bool {
        !self.wires.contains(&(a, b)) && !self.on_can.contains(&a) && !self.on_can.contains(&b)
    }
}

/// What takes a node off and what brings it back is made together.
fn leave_nodes_whole(events: &[EventSpec], why: &mut [Option<&'static str>]) {
    let mut skipped = BTreeSet::new();
    loop {
        let before = skipped.len();
        for (event, why) in events.iter().zip(why.iter_mut()).filter(|(event, _)| event.kind.is_of_presence())
        {
            let nodes = event.targets.nodes();
            if why.is_none() && nodes.iter().any(|node| skipped.contains(node)) {
                *why = Some("another event that takes its node off or brings it back is skipped");
            }
            if why.is_some() {
                skipped.extend(nodes.iter().copied());
            }
        }
        if skipped.len() == before {
            return;
        }
    }
}

/// What is set at one tick makes one configuration of each node, and what is judged is that of all of them.
fn leave_sets_whole(events: &[EventSpec], why: &mut [Option<&'static str>]) {
    let sets = || events.iter().enumerate().filter(|(_, event)| event.kind == EventKind::Set);
    if sets().all(|(index, _)| why.get(index).is_none_or(Option::is_none)) {
        return;
    }
    for (index, _) in sets() {
        if let Some(why @ None) = why.get_mut(index) {
            *why = Some("another event that sets something is skipped");
        }
    }
}

/// A link is mended where it was cut, and let go where it was held.
fn leave_links_whole(scenario: &Scenario, why: &mut [Option<&'static str>]) {
    let (mut cut, mut held) = (BTreeSet::new(), BTreeSet::new());
    for (event, why) in scenario.events.iter().zip(why) {
        let links = event.targets.frames(&scenario.graph);
        let touched = match event.kind {
            EventKind::Partition | EventKind::Repair => &mut cut,
            EventKind::Hold | EventKind::Release => &mut held,
            _ => continue,
        };
        if matches!(event.kind, EventKind::Partition | EventKind::Hold) {
            touched.extend(links.into_iter().filter(|_| why.is_none()));
        } else {
            // It may name more links than those: they are whole, and stay so.
            let ends = links.iter().any(|link| touched.contains(link));
            *why = (!ends).then_some("what it ends is skipped");
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::path::Path;

    const RING: &str = "version = 1\ntime = { tick = '1ms', duration = '1s' }\ngraph = { kind = 'ring', nodes = 5 }\nagent = { dynamics = { kind = 'affine' } }\n\
                        coupling = { kind = 'node-wise', gain = { kind = 'reciprocal', scale = 1.0 }, funnel = { kind = 'constant', width = 2.0 } }";

    fn ring(events: &str) -> Scenario {
        Scenario::parse(&format!("event = [{events}]\n{RING}"), Path::new("ring.toml"), &[]).unwrap()
    }

    /// The kinds of the events that are made, and of those that are not.
    fn kinds(reach: &Reach, events: &str) -> (Vec<&'static str>, Vec<&'static str>) {
        let (made, skipped) = reach.divide(&ring(events));
        let name = |event: &EventSpec| event.kind.name();
        (made.iter().map(name).collect(), skipped.iter().map(|skipped| name(&skipped.event)).collect())
    }

    #[test]
    fn where_all_frames_pass_all_is_made_but_what_happens_in_nodes_and_to_wrong_bits() {
        let events = "{ at = '1ms', kind = 'crash', node = 1 }, { at = '2ms', kind = 'partition', link = [3, 4] }, \
                      { at = '3ms', kind = 'corrupt', probability = 0.1, for = '1ms' }, { at = '4ms', kind = 'join', node = 1 }, \
                      { at = '5ms', kind = 'liar', node = 2, constant = 3.0 }, { at = '6ms', kind = 'sensor', node = 2, offset = 1.0 }, \
                      { at = '7ms', kind = 'repair' }, { at = '8ms', kind = 'hold', for = '5ms' }";
        let made = ["crash", "partition", "join", "liar", "repair", "hold"];
        assert_eq!(kinds(&Reach::default(), events), (made.into(), vec!["corrupt", "sensor"]));
    }

    #[test]
    fn what_a_node_is_taken_off_and_brought_back_by_is_made_together() {
        let reach = Reach { wires: [(3, 4)].into(), ..Reach::default() };
        // Node 5 cannot be switched, so nodes 1 and 5 stay on; then node 1 cannot come, and neither can node 2 with it.
        let events = "{ at = '1ms', kind = 'crash', node = 2 }, { at = '1ms', kind = 'crash', nodes = [1, 5] }, \
                      { at = '2ms', kind = 'join', nodes = [1, 2] }, { at = '3ms', kind = 'crash', node = 3 }";
        assert_eq!(kinds(&reach, events), (vec!["crash"], vec!["crash", "crash", "join"]));
    }

    #[test]
    fn a_link_that_is_not_cut_is_not_mended_and_one_that_is_cut_is() {
        let reach = Reach { wires: [(0, 1)].into(), ..Reach::default() };
        let events = "{ at = '1ms', kind = 'partition', link = [1, 2] }, { at = '2ms', kind = 'repair', link = [1, 2] }, \
                      { at = '3ms', kind = 'partition', link = [3, 4] }, { at = '4ms', kind = 'repair' }";
        assert_eq!(kinds(&reach, events), (vec!["partition", "repair"], vec!["partition", "repair"]));
    }

    #[test]
    fn an_impostor_is_made_where_no_bus_carries_its_frame_to_others() {
        let event = "{ at = '1ms', kind = 'impostor', node = 1, as = 3, offset = 1.0 }";
        let made = |on_can: &[usize]| {
            kinds(&Reach { on_can: on_can.iter().copied().collect(), ..Reach::default() }, event).0
        };
        assert_eq!(made(&[]), ["impostor"]);
        // The one whose name it is, and a neighbour.
        assert!(made(&[2]).is_empty() && made(&[1]).is_empty() && made(&[0]).is_empty());
        assert_eq!(made(&[3]), ["impostor"]);
    }

    #[test]
    fn what_is_set_is_made_together_and_not_on_nodes_without_storage() {
        let set = |at: &str, rest: &str| {
            format!("{{ at = '{at}', kind = 'set', key = 'coupling.funnel.width', value = 1.0{rest} }}")
        };
        let reach = Reach { forgetful: [1].into(), ..Reach::default() };
        let all_kinds = |reach: &Reach, events: &[String]| kinds(reach, &events.join(", "));
        let (one, other) = (set("1ms", ", nodes = [1, 3]"), set("2ms", ", node = 2"));
        assert_eq!(all_kinds(&reach, std::slice::from_ref(&one)).0, ["set"]);
        assert_eq!(all_kinds(&reach, &[one, other]).1, ["set", "set"]);
        assert_eq!(all_kinds(&reach, &[set("1ms", "")]).1, ["set"]);
        // On CAN, on wires and with clocks of their own, too.
        let anywhere =
            Reach { own_clock: true, on_can: [1, 2].into(), wires: [(3, 4)].into(), ..Reach::default() };
        assert_eq!(all_kinds(&anywhere, &[set("1ms", "")]).0, ["set"]);
    }

    #[test]
    fn a_node_with_a_clock_of_its_own_is_switched_where_somebody_tells_it_the_tick() {
        let reach = Reach { own_clock: true, ..Reach::default() };
        let events = "{ at = '1ms', kind = 'bounce', node = 1 }, { at = '2ms', kind = 'burst', loss = 1.0, for = '9ms' }";
        assert_eq!(kinds(&reach, events), (vec!["burst"], vec!["bounce"]));
        let reach = Reach { has_masters: true, ..reach };
        assert_eq!(kinds(&reach, events), (vec!["bounce", "burst"], vec![]));
    }

    #[test]
    fn sync_is_kept_back_where_all_of_it_passes() {
        let event = |node: &str| format!("{{ at = '1ms', kind = 'sync-loss', for = '1ms'{node} }}");
        let made = |reach: &Reach, node: &str| {
            let text = format!("event = [{}]\nsync = {{ masters = [1, 2] }}\n{RING}", event(node));
            let scenario = Scenario::parse(&text, Path::new("ring.toml"), &[]).unwrap();
            !reach.divide(&scenario).0.is_empty()
        };
        let own = Reach { own_clock: true, has_masters: true, ..Reach::default() };
        assert!(made(&own, "") && made(&own, ", node = 2"));
        assert!(!made(&Reach::default(), ""), "the host's SYNC are ticks");
        let on_can = Reach { on_can: [1].into(), ..own };
        assert!(made(&on_can, ", node = 1") && !made(&on_can, ", node = 2") && !made(&on_can, ""));
    }
}
