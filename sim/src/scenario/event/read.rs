//! The keys of `[[event]]`, each by itself.

use super::read_frames::{babble, bit_errors, corrupt, impostor, liar, lies_for, loss, of_frames, old};
use super::read_plants::{actuator, sensor};
use super::read_set;
use super::{ClockChange, Detail, EventKind, EventSpec, Targets};
use crate::scenario::Diagnostic;
use crate::scenario::clock::{DRIFT, ppb, read_by};
use crate::scenario::diagnostic::Problem;
use crate::scenario::reader::{Choice, Log, Section, integer, ready};
use crate::scenario::tree::{Item, Value};

/// Time for which a bounced node is off where the scenario does not say, ns.
const BOUNCE_NS: u64 = 100_000_000;

const KINDS: [Choice<EventKind>; 22] = [
    ready("crash", EventKind::Crash),
    ready("bounce", EventKind::Bounce),
    ready("join", EventKind::Join),
    ready("leave", EventKind::Leave),
    ready("partition", EventKind::Partition),
    ready("repair", EventKind::Repair),
    ready("clock", EventKind::Clock),
    ready("sync-loss", EventKind::SyncLoss),
    ready("burst", EventKind::Burst),
    ready("corrupt", EventKind::Corrupt),
    ready("hold", EventKind::Hold),
    ready("release", EventKind::Release),
    ready("noise", EventKind::Noise),
    ready("cut", EventKind::Cut),
    ready("short", EventKind::Short),
    ready("babble", EventKind::Babble),
    ready("liar", EventKind::Liar),
    ready("replayer", EventKind::Replayer),
    ready("impostor", EventKind::Impostor),
    ready("sensor", EventKind::Sensor),
    ready("actuator", EventKind::Actuator),
    ready("set", EventKind::Set),
];

/// Reads all events, in the order of the file; `nodes` is the largest id.
pub(in crate::scenario) fn read(file: &mut Section<'_>, nodes: u64) -> Vec<EventSpec> {
    let log = file.log();
    file.array("event").iter().enumerate().filter_map(|placed| event(placed, nodes, log)).collect()
}

fn event((place, item): (usize, &Item), nodes: u64, log: &Log) -> Option<EventSpec> {
    let mut section = Section::open(item, log)?;
    let at_ns = match section.need("at", "must be a duration from the start, as \"5s\"") {
        Some(_) => section.duration("at", Some(0)),
        None => 0,
    };
    // Without a kind nobody knows which keys there may be.
    let kind = section.choice("kind", &KINDS, None)?;
    let mut detail = Detail::None;
    let (targets, lasts_ns) = match kind {
        EventKind::Bounce => (of_nodes(&mut section, nodes), lasts(&mut section)),
        EventKind::Clock => {
            detail = Detail::Clock(change_of_clock(&mut section));
            (of_nodes(&mut section, nodes), 0)
        }
        EventKind::SyncLoss => {
            let lasts_ns = lasts_as(&mut section, "must be how long SYNC do not go out, as \"2s\"");
            (of_masters(&mut section, nodes), lasts_ns)
        }
        EventKind::Crash | EventKind::Leave | EventKind::Join => (of_nodes(&mut section, nodes), 0),
        EventKind::Partition | EventKind::Repair => (of_links(&mut section, nodes, kind), 0),
        EventKind::Burst | EventKind::Corrupt => {
            let lasts_ns = lasts_as(&mut section, "must be how long that goes on, as \"200ms\"");
            detail = if kind == EventKind::Burst { loss(&mut section) } else { corrupt(&mut section) };
            (of_frames(&mut section, nodes), lasts_ns)
        }
        EventKind::Hold => {
            let lasts_ns = lies_for(&mut section);
            (of_frames(&mut section, nodes), lasts_ns)
        }
        EventKind::Release => (of_frames(&mut section, nodes), 0),
        EventKind::Noise => {
            let lasts_ns = lasts_as(&mut section, "must be how long that goes on, as \"200ms\"");
            detail = bit_errors(&mut section);
            (Some(Targets::Bus), lasts_ns)
        }
        EventKind::Short => {
            let lasts_ns = lasts_as(&mut section, "must be how long that goes on, as \"2ms\"");
            (Some(Targets::Bus), lasts_ns)
        }
        EventKind::Cut | EventKind::Babble => {
            let lasts_ns = lies_for(&mut section);
            if kind == EventKind::Babble {
                detail = babble(&mut section);
            }
            (of_nodes(&mut section, nodes), lasts_ns)
        }
        EventKind::Liar | EventKind::Replayer | EventKind::Impostor => {
            let lasts_ns = lies_for(&mut section);
            detail = match kind {
                EventKind::Liar => liar(&mut section),
                EventKind::Impostor => impostor(&mut section, nodes),
                _ => old(&mut section),
            };
            (of_nodes(&mut section, nodes), lasts_ns)
        }
        EventKind::Set => {
            detail = read_set::new_value(&mut section, place);
            (read_set::of_all_or_some(&mut section, nodes), 0)
        }
        EventKind::Sensor | EventKind::Actuator => {
            let lasts_ns = lies_for(&mut section);
            detail = if kind == EventKind::Sensor { sensor(&mut section) } else { actuator(&mut section) };
            (of_nodes(&mut section, nodes), lasts_ns)
        }
    };
    section.finish();
    Some(EventSpec { at_ns, kind, targets: targets?, lasts_ns, detail })
}

/// `for`, which has to be there.
fn lasts_as(section: &mut Section<'_>, allowed: &str) -> u64 {
    if section.need("for", allowed).is_some() { section.duration("for", None) } else { 0 }
}

/// `by`, `drift_ppm`, or both.
fn change_of_clock(section: &mut Section<'_>) -> ClockChange {
    let by_ns = section.value("by", 0, read_by);
    let drift_ppb = section.optional_number("drift_ppm", DRIFT).map(ppb);
    if by_ns == 0 && drift_ppb.is_none() {
        section.missing("by", "must be how far the clock jumps, as \"300us\" or \"-300us\"; or drift_ppm, its drift from then on");
    }
    ClockChange { by_ns, drift_ppb }
}

/// `node` or `nodes`; without either all that may be time master.
fn of_masters(section: &mut Section<'_>, nodes: u64) -> Option<Targets> {
    let ids = match one_of(section, "node", "nodes")? {
        Some(("node", item)) => index(item, nodes).map(|index| vec![index]),
        Some((_, item)) => indices(item, nodes),
        None => return Some(Targets::Masters),
    };
    kept(section, ids).map(Targets::Nodes)
}

fn lasts(section: &mut Section<'_>) -> u64 {
    match section.take("for") {
        Some(_) => section.duration("for", None),
        None => BOUNCE_NS,
    }
}

/// `node` or `nodes`.
pub(super) fn of_nodes(section: &mut Section<'_>, nodes: u64) -> Option<Targets> {
    let ids = match one_of(section, "node", "nodes")? {
        Some(("node", item)) => index(item, nodes).map(|index| vec![index]),
        Some((_, item)) => indices(item, nodes),
        None => {
            section.missing(
                "node",
                &format!("must be the id of a node, 1 to {nodes}; or nodes, an array of ids"),
            );
            return None;
        }
    };
    kept(section, ids).map(Targets::Nodes)
}

/// `link` or `groups`; a repair without either is of all links.
fn of_links(section: &mut Section<'_>, nodes: u64, kind: EventKind) -> Option<Targets> {
    let targets = match one_of(section, "link", "groups")? {
        Some(("link", item)) => link(item, nodes),
        Some((_, item)) => groups(item, nodes),
        None if kind == EventKind::Repair => return Some(Targets::AllLinks),
        None => {
            section.missing(
                "groups",
                "must be two or more arrays of node ids, as [[1, 2], [3]]; or link, the ids of two neighbours",
            );
            return None;
        }
    };
    kept(section, targets)
}

/// The one of two keys that is there; `None`, reported, where both are.
pub(super) fn one_of<'a>(
    section: &mut Section<'a>,
    first: &'static str,
    second: &'static str,
) -> Option<Option<(&'static str, &'a Item)>> {
    match (section.take(first), section.take(second)) {
        (Some(_), Some(item)) => {
            let allowed = format!("must not be there beside {first}");
            section.log().report(item.diagnostic(Problem::Value, allowed));
            None
        }
        (Some(item), None) => Some(Some((first, item))),
        (None, Some(item)) => Some(Some((second, item))),
        (None, None) => Some(None),
    }
}

/// What was read, or `None`, reported.
pub(super) fn kept<T>(section: &Section<'_>, read: Result<T, Box<Diagnostic>>) -> Option<T> {
    read.map_err(|diagnostic| section.log().report(diagnostic)).ok()
}

pub(super) fn index(item: &Item, nodes: u64) -> Result<usize, Box<Diagnostic>> {
    integer(item, (1, nodes), "the id of a node of the graph").map(|id| id as usize - 1)
}

/// One or more ids, each once.
pub(super) fn indices(item: &Item, nodes: u64) -> Result<Vec<usize>, Box<Diagnostic>> {
    let refuse = |allowed: String| Err(item.diagnostic(Problem::Value, allowed));
    let Value::Array(items) = &item.value else {
        return refuse(format!("must be an array of node ids from 1 to {nodes}"));
    };
    let mut found: Vec<usize> = Vec::new();
    for item in items {
        let index = index(item, nodes)?;
        if found.contains(&index) {
            return refuse(format!("must name each node once, and names node {} twice", index + 1));
        }
        found.push(index);
    }
    if found.is_empty() { refuse("must name a node".to_owned()) } else { Ok(found) }
}

pub(super) fn link(item: &Item, nodes: u64) -> Result<Targets, Box<Diagnostic>> {
    match indices(item, nodes)?.as_slice() {
        &[a, b] => Ok(Targets::Link(a, b)),
        _ => Err(item.diagnostic(Problem::Value, "must be the ids of two neighbours, as [1, 2]")),
    }
}

pub(super) fn groups(item: &Item, nodes: u64) -> Result<Targets, Box<Diagnostic>> {
    let refuse = |allowed: String| Err(item.diagnostic(Problem::Value, allowed));
    let Value::Array(items) = &item.value else {
        return refuse("must be two or more arrays of node ids, as [[1, 2], [3]]".to_owned());
    };
    let groups: Vec<Vec<usize>> =
        items.iter().map(|group| indices(group, nodes)).collect::<Result<_, _>>()?;
    let mut seen: Vec<usize> = Vec::new();
    for &node in groups.iter().flatten() {
        if seen.contains(&node) {
            return refuse(format!("must have each node in one group, and has node {} in two", node + 1));
        }
        seen.push(node);
    }
    if groups.len() < 2 {
        refuse("must be two groups or more".to_owned())
    } else {
        Ok(Targets::Groups(groups))
    }
}
