//! `[faults]`: events by chance, drawn from the seed. What is drawn becomes events like those that a scenario names.

use super::bus::MOST_BIT_ERRORS;
use super::clock::read_by;
use super::diagnostic::Problem;
use super::duration::format_duration;
use super::event::{
    ActuatorFault, ClockChange, Detail, EventKind, EventSpec, LAST_JOIN, Lie, MOST_EVENTS, OLDEST,
    SensorFault, Setting, Targets, no_plants,
};
use super::reader::{Log, Range, Section};
use super::tree::{Item, Value};
use super::{Coupling, Expect, Loss};
use crate::random::{self, Purpose};
use funnelnet_law::math;
use rand_pcg::Pcg64;
use std::cell::Cell;
use std::collections::BTreeMap;

/// Events per second.
pub(super) const RATE: Range = Range::between(1e-6, 1e3, "1/s");
/// Bit errors of a bus in a drawn spell of noise.
pub(super) const BIT_ERRORS: Range = Range::between(1e-9, MOST_BIT_ERRORS, "of the bits");
/// How far a drawn liar is from its state.
pub(super) const OFFSET: Range = Range::any("state units");
/// Part of its input that a drawn actuator does.
pub(super) const EFFECTIVENESS: Range = Range::between(0.0, 1.0, "of the input");

/// Kinds that come to an end by themselves, or that the network makes up for, by name.
pub(super) const KINDS: [EventKind; 15] = [
    EventKind::Bounce,
    EventKind::Partition,
    EventKind::Burst,
    EventKind::Corrupt,
    EventKind::Hold,
    EventKind::Noise,
    EventKind::Cut,
    EventKind::Short,
    EventKind::Babble,
    EventKind::Liar,
    EventKind::Replayer,
    EventKind::Sensor,
    EventKind::Actuator,
    EventKind::Clock,
    EventKind::SyncLoss,
];
/// How far a drawn clock jumps where the scenario does not say, ns.
const JUMP_NS: i64 = 300_000;

/// What is drawn.
pub(super) struct FaultsSpec<'a> {
    rate: f64,
    kinds: Vec<EventKind>,
    from_ns: u64,
    to_ns: Option<u64>,
    /// The shortest and the longest, ns.
    lasts_ns: (u64, u64),
    loss: f64,
    probability: f64,
    bit_errors: f64,
    offset: f64,
    age_ns: u64,
    effectiveness: f64,
    jump_ns: i64,
    item: &'a Item,
}

impl FaultsSpec<'_> {
    /// The shortest time for which it may have a node off, ns; none where it draws no bounce.
    pub(super) fn shortest_bounce_ns(&self) -> Option<u64> {
        self.kinds.contains(&EventKind::Bounce).then_some(self.lasts_ns.0)
    }
}

/// Reads `[faults]`; none where there is none.
pub(super) fn read<'a>(file: &mut Section<'a>, root: &'a Item) -> Option<FaultsSpec<'a>> {
    let mut section = file.section("faults")?;
    let item = root.get("faults")?;
    let log = section.log();
    let spec = FaultsSpec {
        rate: section.number("rate", None, RATE),
        kinds: read_kinds(&mut section, log),
        from_ns: section.duration("from", Some(0)),
        to_ns: section.take("to").is_some().then(|| section.duration("to", None)),
        lasts_ns: (
            section.duration("shortest", Some(10_000_000)).max(1),
            section.duration("longest", Some(200_000_000)).max(1),
        ),
        loss: section.number("loss", Some(1.0), Range::positive_probability()),
        probability: section.number("probability", Some(0.1), Range::positive_probability()),
        bit_errors: section.number("bit_errors", Some(1e-3), BIT_ERRORS),
        offset: section.number("offset", Some(1.0), OFFSET),
        age_ns: section.duration("age", Some(100_000_000)).max(1),
        effectiveness: section.number("effectiveness", Some(0.0), EFFECTIVENESS),
        jump_ns: section.value("jump", JUMP_NS, read_by),
        item,
    };
    section.finish();
    Some(spec)
}

fn read_kinds(section: &mut Section<'_>, log: &Log) -> Vec<EventKind> {
    let names = KINDS.map(EventKind::name).join(", ");
    let allowed = format!("must be an array of kinds of events, each once, of {names}");
    let Some(item) = section.need("kinds", &allowed) else { return Vec::new() };
    let kind = |item: &Item| KINDS.into_iter().find(|kind| Some(kind.name()) == item.text());
    let kinds: Option<Vec<EventKind>> = match &item.value {
        Value::Array(items) => items.iter().map(kind).collect(),
        _ => None,
    };
    let is_once = |kinds: &Vec<EventKind>| (1..kinds.len()).all(|at| !kinds[..at].contains(&kinds[at]));
    kinds.filter(|kinds| !kinds.is_empty() && is_once(kinds)).unwrap_or_else(|| {
        log.report(item.diagnostic(Problem::Value, allowed));
        Vec::new()
    })
}

/// Draws the events. Nodes and links that `named` events take away are left to those.
pub(super) fn draw(
    spec: &FaultsSpec<'_>,
    named: &[EventSpec],
    expect: &Expect,
    seed: u64,
    setting: &Setting<'_>,
) -> Vec<EventSpec> {
    let end = setting.time.end_ns();
    let last = end.saturating_sub(expect.recovered_within_ns.unwrap_or(0));
    let to = spec.to_ns.unwrap_or(last);
    if !is_sound(spec, to, last, setting) {
        return Vec::new();
    }
    let mut chance = Chance {
        spec,
        named,
        setting,
        stream: random::stream(seed, Purpose::Faults, 0),
        nodes: vec![0; setting.graph.nodes],
        links: BTreeMap::new(),
    };
    let mut at = spec.from_ns as f64;
    let mut events = Vec::new();
    loop {
        // Times between events of a Poisson process.
        at += -math::ln(1.0 - random::uniform(&mut chance.stream)) / spec.rate * 1e9;
        if at >= to as f64 || events.len() >= MOST_EVENTS - 2 {
            return events;
        }
        events.extend(chance.event(at as u64, to));
    }
}

/// Whether what is asked for can be drawn; reported if not.
fn is_sound(spec: &FaultsSpec<'_>, to: u64, last: u64, setting: &Setting<'_>) -> bool {
    let (item, sound) = (spec.item, Cell::new(true));
    let refuse = |key: &str, allowed: String| {
        sound.set(false);
        setting.log.report(item.get(key).unwrap_or(item).diagnostic(Problem::Value, allowed));
    };
    if setting.coupling == Coupling::WeaklyCentralised {
        refuse(
            "",
            "must not be there with weakly-centralised coupling, which is simulated without nodes".to_owned(),
        );
    }
    let of_plants = |kind: &EventKind| kind.is_of_plants();
    if setting.bus == super::BusModel::Uart && !spec.kinds.iter().all(of_plants) {
        let allowed = "must not be there with this bus.model: but for sensor and actuator, events happen on the ideal bus and on CAN";
        refuse("", allowed.to_owned());
    }
    if let Some(why) = no_plants(setting.time).filter(|_| spec.kinds.iter().any(of_plants)) {
        refuse("kinds", format!("sensor and actuator {why}"));
    }
    // Whatever the seed draws.
    if let Some(kind) = spec.kinds.iter().find(|kind| kind.is_of_plants()).filter(|_| setting.clocks) {
        let beside = "beside [clock], [sync] or a clock of a [[node]]: a plant keeps the true time";
        refuse("kinds", format!("must be without {} {beside}", kind.name()));
    }
    if spec.kinds.contains(&EventKind::Bounce) && setting.clocks && !setting.sync {
        let why = "a node that comes learns the tick from a time master";
        refuse("kinds", format!("must be without bounce beside clocks and no [sync]: {why}"));
    }
    if spec.kinds.contains(&EventKind::Clock) && !setting.clocks {
        refuse(
            "kinds",
            "must be without clock, which needs [clock] or [sync]: without them all nodes share one"
                .to_owned(),
        );
    }
    if spec.kinds.contains(&EventKind::SyncLoss) && !setting.sync {
        refuse("kinds", "must be without sync-loss, which needs [sync]".to_owned());
    }
    if spec.kinds.contains(&EventKind::Clock) && spec.jump_ns == 0 {
        refuse("jump", "must not be zero: that is no fault".to_owned());
    }
    if spec.kinds.contains(&EventKind::Actuator) && spec.effectiveness >= 1.0 {
        refuse("effectiveness", "must be below 1: that is no fault".to_owned());
    }
    if let Some(kind) = spec.kinds.iter().find(|kind| kind.is_of_wires() && !setting.bus.is_can()) {
        let needs = "which needs bus.model = \"can\" or \"can-fd\"";
        refuse("kinds", format!("must be without {}, {needs}", kind.name()));
    }
    let is_off = |kind: &EventKind| matches!(kind, EventKind::Liar | EventKind::Sensor);
    if spec.kinds.iter().any(is_off) && spec.offset == 0.0 {
        refuse("offset", "must not be zero: that is no lie, and no fault".to_owned());
    }
    let (shortest, longest) = spec.lasts_ns;
    if shortest > longest {
        refuse("shortest", format!("must not be longer than longest, {}", format_duration(longest)));
    }
    let ticks = spec.age_ns / setting.time.tick_ns;
    if !(1..=OLDEST).contains(&ticks) {
        let [low, high] = [1, OLDEST].map(|ticks| format_duration(ticks * setting.time.tick_ns));
        refuse("age", format!("must be from {low} to {high}: 1 to {OLDEST} ticks"));
    }
    if to > last {
        refuse(
            "to",
            format!("must leave time for expect.recovered_within: {} at the latest", format_duration(last)),
        );
    }
    if spec.from_ns >= to {
        refuse("from", format!("must be before the last event may end, {}", format_duration(to)));
    }
    sound.get()
}

/// What draws events, and who is taken away until when (ns).
struct Chance<'a> {
    spec: &'a FaultsSpec<'a>,
    named: &'a [EventSpec],
    setting: &'a Setting<'a>,
    stream: Pcg64,
    nodes: Vec<u64>,
    links: BTreeMap<(usize, usize), u64>,
}

impl Chance<'_> {
    /// One event, or a partition and its repair; none where it would not be over by `to`, or happens to who is away.
    fn event(&mut self, at_ns: u64, to: u64) -> Vec<EventSpec> {
        // All is drawn whatever becomes of it: what is left out moves nothing.
        let kind = self.spec.kinds[random::below(&mut self.stream, self.spec.kinds.len())];
        let (shortest, longest) = self.spec.lasts_ns;
        let lasts_ns = shortest + (random::uniform(&mut self.stream) * (longest - shortest) as f64) as u64;
        let node = random::below(&mut self.stream, self.setting.graph.nodes);
        let edges = &self.setting.graph.edges;
        let place = random::below(&mut self.stream, edges.len().max(1));
        let end = at_ns.saturating_add(lasts_ns);
        let Some(link) = edges.get(place).map(|edge| (edge.a, edge.b)).filter(|_| end <= to) else {
            return Vec::new();
        };
        let event = |kind, targets, detail| EventSpec { at_ns, kind, targets, lasts_ns, detail };
        let on_link = Targets::Link(link.0, link.1);
        let of_node = Targets::Nodes(vec![node]);
        let spec = self.spec;
        match kind {
            EventKind::Bounce if self.is_free_node(node, at_ns, end) => {
                self.nodes[node] = end;
                vec![event(kind, of_node, Detail::None)]
            }
            EventKind::Partition if self.is_free_link(link, at_ns) => {
                self.links.insert(link, end);
                let cut = EventSpec { lasts_ns: 0, ..event(kind, on_link.clone(), Detail::None) };
                vec![cut.clone(), EventSpec { at_ns: end, kind: EventKind::Repair, targets: on_link, ..cut }]
            }
            EventKind::Burst => vec![event(kind, on_link, Detail::Loss(Loss::independent(spec.loss)))],
            EventKind::Corrupt => vec![event(kind, on_link, Detail::Corrupt(spec.probability))],
            EventKind::Hold => vec![event(kind, on_link, Detail::None)],
            EventKind::Noise => {
                let per_billion = (spec.bit_errors * 1e9).round() as u32;
                vec![event(kind, Targets::Bus, Detail::BitErrors(per_billion))]
            }
            EventKind::Cut => vec![event(kind, of_node, Detail::None)],
            EventKind::Short => vec![event(kind, Targets::Bus, Detail::None)],
            EventKind::Babble => vec![event(kind, of_node, Detail::Babble(0))],
            EventKind::Liar => vec![event(kind, of_node, Detail::Lie(Lie::Offset(spec.offset)))],
            EventKind::Replayer => vec![event(kind, of_node, Detail::Age(spec.age_ns))],
            EventKind::Sensor => {
                let fault = SensorFault::Gives(Lie::Offset(spec.offset));
                vec![event(kind, of_node, Detail::Sensor(fault))]
            }
            EventKind::Clock => {
                let change = ClockChange { by_ns: spec.jump_ns, drift_ppb: None };
                vec![EventSpec { lasts_ns: 0, ..event(kind, of_node, Detail::Clock(change)) }]
            }
            EventKind::SyncLoss => vec![event(kind, Targets::Masters, Detail::None)],
            EventKind::Actuator => {
                vec![event(kind, of_node, Detail::Actuator(ActuatorFault::Part(spec.effectiveness)))]
            }
            _ => Vec::new(),
        }
    }

    fn is_free_node(&self, node: usize, at_ns: u64, end: u64) -> bool {
        let is_named =
            |event: &EventSpec| event.kind.is_of_presence() && event.targets.nodes().contains(&node);
        self.nodes[node] < at_ns
            && !self.named.iter().any(is_named)
            && self.setting.time.first_tick(end) <= LAST_JOIN
    }

    fn is_free_link(&self, link: (usize, usize), at_ns: u64) -> bool {
        let is_named = |event: &EventSpec| {
            event.kind.is_of_presence() && event.targets.links(self.setting.graph).contains(&link)
        };
        self.links.get(&link).is_none_or(|&until| until < at_ns) && !self.named.iter().any(is_named)
    }
}
