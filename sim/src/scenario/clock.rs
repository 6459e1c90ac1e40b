//! `[clock]`, `clock` of `[[node]]`, and `[sync]`: clocks of nodes that are not right, and what keeps them together.

use super::diagnostic::{Diagnostic, Problem};
use super::duration::{format_duration, parse_duration};
use super::reader::{Range, Section, duration_ns, integer};
use super::tree::{Item, Value};
use super::{BusModel, BusSpec, Coupling, EventKind, EventSpec, LARGEST_RUN};
use crate::random::{self, Purpose};
use crate::scenario::reader::Log;

/// The largest drift, ppm: far beyond any crystal.
const MOST_DRIFT: f64 = 1000.0;
/// The largest wander, ppm in a second.
const MOST_WANDER: f64 = 10.0;
/// The furthest jump, ns: a second.
const MOST_JUMP_NS: i64 = 1_000_000_000;
/// Time between SYNC where none is said, and the longest one, ns.
pub(super) const PERIOD_NS: u64 = 100_000_000;
pub(super) const LONGEST_PERIOD_NS: u64 = 10_000_000_000;

pub(super) const DRIFT: Range = Range::between(-MOST_DRIFT, MOST_DRIFT, "ppm").on_host();
pub(super) const WIDTH: Range = Range::between(0.0, MOST_DRIFT, "ppm").on_host();
pub(super) const WANDER: Range = Range::between(0.0, MOST_WANDER, "ppm in a second").on_host();

/// The clock of a node.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct ClockSpec {
    /// Time by which it is ahead at the start, ns.
    pub offset_ns: i64,
    /// Rate by which it is too fast, parts in a billion.
    pub drift_ppb: i64,
    /// Standard deviation of the change of that in a second, parts in a billion.
    pub wander_ppb: u64,
    /// True time (ns from the start of the run) and how far it jumps then (ns).
    pub jumps: Vec<(u64, i64)>,
    /// The same, and how much too fast it is from then on (parts in a billion).
    pub drifts: Vec<(u64, i64)>,
}

/// SYNC that keeps the clocks together.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct SyncSpec {
    /// Time from one SYNC to the next, ns.
    pub period_ns: u64,
    /// Ids of the nodes that may be time master.
    pub masters: Vec<u16>,
}

/// Clocks by index, none where all are right and no SYNC keeps them, and SYNC.
pub(super) type Clocks = (Vec<ClockSpec>, Option<SyncSpec>);

/// Reads the sections; `nodes` is the largest id.
pub(super) fn read(file: &mut Section<'_>, nodes: u64, seed: u64, tick_ns: u64) -> Clocks {
    let count = usize::try_from(nodes).unwrap_or(0).min(LARGEST_RUN);
    let common = file.section("clock").map(|section| read_common(section, tick_ns));
    let sync = file.section("sync").and_then(|section| read_sync(section, nodes, tick_ns));
    let log = file.log();
    let own: Vec<_> = file
        .array("node")
        .iter()
        .filter_map(|item| Some((index_of(item, count)?, item.get("clock")?)))
        .collect();
    if common.is_none() && own.is_empty() && sync.is_none() {
        return (Vec::new(), None);
    }
    let common = common.unwrap_or_default();
    let mut clocks: Vec<_> = (0..count).map(|index| common.drawn(seed, index)).collect();
    for (index, item) in own {
        if let (Some(clock), Some(section)) = (clocks.get_mut(index), Section::open(item, log)) {
            read_own(section, clock, tick_ns);
        }
    }
    (clocks, sync)
}

fn index_of(node: &Item, count: usize) -> Option<usize> {
    match node.get("id")?.value {
        Value::Integer(id) => usize::try_from(id).ok()?.checked_sub(1).filter(|&index| index < count),
        _ => None,
    }
}

/// What `[clock]` says: how far clocks may be off.
#[derive(Default)]
struct Common {
    offset_ns: u64,
    drift_ppb: u64,
    wander_ppb: u64,
}

impl Common {
    /// The clock of a node, drawn within it.
    fn drawn(&self, seed: u64, index: usize) -> ClockSpec {
        let mut stream = random::stream(seed, Purpose::Clock, index as u64);
        let mut within = |width: u64| {
            let n = usize::try_from(2 * width + 1).unwrap_or(usize::MAX);
            random::below(&mut stream, n) as i64 - width as i64
        };
        let (drift_ppb, offset_ns) = (within(self.drift_ppb), within(self.offset_ns));
        ClockSpec { offset_ns, drift_ppb, wander_ppb: self.wander_ppb, ..ClockSpec::default() }
    }
}

fn read_common(mut section: Section<'_>, tick_ns: u64) -> Common {
    let offset_ns = section.value("offset", 0, |item| {
        let offset = duration_ns(item, true)?;
        shorter_than_a_tick(item, offset, tick_ns).map(|()| offset)
    });
    let drift = section.number("drift_ppm", Some(0.0), WIDTH);
    let wander = section.number("wander", Some(0.0), WANDER);
    section.finish();
    Common { offset_ns, drift_ppb: ppb(drift).unsigned_abs(), wander_ppb: ppb(wander).unsigned_abs() }
}

/// The clock of one node: what it says is not drawn.
fn read_own(mut section: Section<'_>, clock: &mut ClockSpec, tick_ns: u64) {
    clock.offset_ns = section.value("offset", clock.offset_ns, |item| {
        let offset = signed_ns(item)?;
        shorter_than_a_tick(item, offset.unsigned_abs(), tick_ns).map(|()| offset)
    });
    if let Some(drift) = section.optional_number("drift_ppm", DRIFT) {
        clock.drift_ppb = ppb(drift);
    }
    if let Some(wander) = section.optional_number("wander", WANDER) {
        clock.wander_ppb = ppb(wander).unsigned_abs();
    }
    let log = section.log();
    clock.jumps = section.array("jumps").iter().filter_map(|item| read_jump(item, log)).collect();
    section.finish();
}

fn read_jump(item: &Item, log: &Log) -> Option<(u64, i64)> {
    let mut section = Section::open(item, log)?;
    section.need("at", "must be a duration from the start, as \"5s\"")?;
    let at = section.duration("at", Some(0));
    section.need("by", "must be how far the clock jumps, as \"300us\" or \"-300us\"")?;
    let by = section.value("by", 0, read_by);
    section.finish();
    Some((at, by))
}

/// How far a clock jumps, ns.
pub(super) fn read_by(item: &Item) -> Result<i64, Box<Diagnostic>> {
    match signed_ns(item)? {
        by if by.abs() <= MOST_JUMP_NS => Ok(by),
        _ => Err(item.diagnostic(Problem::Value, "must be a second at most, forwards or backwards")),
    }
}

fn read_sync(mut section: Section<'_>, nodes: u64, tick_ns: u64) -> Option<SyncSpec> {
    let limits = (tick_ns, LONGEST_PERIOD_NS.max(tick_ns));
    let period_ns = match section.take("period") {
        Some(_) => section.duration_within("period", limits, "from a tick to ten seconds between SYNC"),
        None => PERIOD_NS.max(tick_ns),
    };
    let masters = section.value("masters", vec![1], |item| read_masters(item, nodes));
    let off = section.value("off", false, |item| match item.value {
        Value::Bool(off) => Ok(off),
        _ => Err(item.diagnostic(Problem::Value, "must be true or false")),
    });
    section.finish();
    (!off).then_some(SyncSpec { period_ns, masters })
}

fn read_masters(item: &Item, nodes: u64) -> Result<Vec<u16>, Box<Diagnostic>> {
    let allowed =
        || item.diagnostic(Problem::Value, "must be an array of ids of nodes, at least one, each once");
    let Value::Array(items) = &item.value else { return Err(allowed()) };
    let ids: Result<Vec<u64>, _> =
        items.iter().map(|item| integer(item, (1, nodes), "[graph] nodes")).collect();
    let mut ids: Vec<u16> = ids?.into_iter().filter_map(|id| u16::try_from(id).ok()).collect();
    ids.sort_unstable();
    if ids.is_empty() || ids.windows(2).any(|pair| pair[0] == pair[1]) {
        return Err(allowed());
    }
    Ok(ids)
}

/// What only the whole scenario shows.
pub(super) fn make_sense(
    (clocks, sync): &Clocks,
    bus: &BusSpec,
    (coupling, events): (Coupling<f64>, &[EventSpec]),
    (root, log): (&Item, &Log),
) {
    let refuse = |item: &Item, allowed: &str| log.report(item.diagnostic(Problem::Value, allowed));
    if let Some(item) = root.get("event") {
        events
            .iter()
            .filter_map(|event| useless(event, clocks, sync.as_ref()))
            .for_each(|allowed| refuse(item, &allowed));
    }
    let of_clocks = ["clock", "sync", "node"].into_iter().find_map(|key| root.get(key));
    let Some(item) = of_clocks.filter(|_| !clocks.is_empty()) else { return };
    if coupling == Coupling::WeaklyCentralised {
        refuse(item, "must not be there with weakly-centralised coupling, which is simulated without nodes");
    }
    if events.iter().any(|event| event.kind.is_of_plants()) {
        refuse(
            item,
            "must not be there beside an [[event]] of kind sensor or actuator, so far: a plant keeps the true time",
        );
    }
    // On the ideal bus it is for nodes with clocks of their own (a bench): the engine says so.
    let has_syncs = bus.model.is_can() || bus.model == BusModel::Ideal;
    if let (Some(item), Some(_), false) = (root.get("sync"), sync, has_syncs) {
        refuse(item, "needs bus.model = \"can\" or \"can-fd\", where all hear a SYNC at the same time");
    }
}

/// Why an event of clocks would change nothing, if it would not.
fn useless(event: &EventSpec, clocks: &[ClockSpec], sync: Option<&SyncSpec>) -> Option<String> {
    let is_master = |masters: &[u16], node: usize| masters.iter().any(|&id| usize::from(id) == node + 1);
    match (event.kind, sync) {
        (EventKind::Bounce | EventKind::Join, None) if !clocks.is_empty() => {
            let kind = event.kind.name();
            Some(format!(
                "of kind {kind} needs [sync] beside [clock]: a node that comes learns the tick from a time master"
            ))
        }
        (EventKind::Clock, _) if clocks.is_empty() => {
            Some("of kind clock needs [clock] or [sync]: without them all nodes share one clock".to_owned())
        }
        (EventKind::SyncLoss, None) => {
            Some("of kind sync-loss needs [sync]: without it there is none to lose".to_owned())
        }
        (EventKind::SyncLoss, Some(SyncSpec { masters, .. })) => {
            let other = event.targets.nodes().iter().find(|&&node| !is_master(masters, node))?;
            Some(format!("of kind sync-loss changes nothing: node {} is none of sync.masters", other + 1))
        }
        _ => None,
    }
}

pub(super) fn ppb(ppm: f64) -> i64 {
    if ppm.is_finite() { (ppm * 1000.0).round() as i64 } else { 0 }
}

fn shorter_than_a_tick(item: &Item, ns: u64, tick_ns: u64) -> Result<(), Box<Diagnostic>> {
    if ns < tick_ns {
        return Ok(());
    }
    let allowed = format!("must be shorter than a tick, {}", format_duration(tick_ns));
    Err(item.diagnostic(Problem::Value, allowed))
}

/// A duration that may be negative, ns.
fn signed_ns(item: &Item) -> Result<i64, Box<Diagnostic>> {
    let allowed = "must be a duration with a unit, as \"300us\" or \"-300us\"";
    let text = item.text().ok_or_else(|| item.diagnostic(Problem::Value, allowed))?.trim();
    let (sign, size) = text.strip_prefix('-').map_or((1, text), |size| (-1, size));
    let ns = parse_duration(size).map_err(|message| item.diagnostic(Problem::Value, message))?;
    i64::try_from(ns).map(|ns| sign * ns).map_err(|_| item.diagnostic(Problem::Value, allowed))
}
