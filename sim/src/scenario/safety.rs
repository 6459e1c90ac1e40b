//! `[safety]`: what stops a node, beside its own state and funnel, and what it takes of its neighbours.

use super::diagnostic::Problem;
use super::model::{NodeSpec, SafetySpec};
use super::reader::{Log, Range, Section};
use super::tree::Item;
use funnelnet_law::Coupling;
use funnelnet_law::range::{INPUT, STATE};
use funnelnet_protocol::config::MAX_NEIGHBOURS;

/// States in a row after which an edge is dropped, where there are limits of what is heard and nothing is said. To
/// wait for who is beyond them, and to believe it then, is worse than no limit (docs/notes/2026-11-29-heard.md).
const DROP_AFTER: u64 = 10;

/// Most states in a row after which an edge is dropped.
pub(super) const MOST_DOUBTS: u64 = u8::MAX as u64;

/// The longest holdover, ns: an hour.
pub(super) const LONGEST_HOLDOVER_NS: u64 = 3_600_000_000_000;

/// Reads the section; `tick_ns` has to fit into the holdover.
pub(super) fn read(file: &mut Section<'_>, tick_ns: u64) -> SafetySpec {
    let Some(mut section) = file.section("safety") else { return SafetySpec::default() };
    let most = MAX_NEIGHBOURS as u64;
    let lost =
        section.integer("lost_neighbours", Some(0), (0, most), "neighbours lost at once; 0 never stops");
    let limits = (tick_ns, LONGEST_HOLDOVER_NS.max(tick_ns));
    let holdover = section
        .take("holdover")
        .map(|_| section.duration_within("holdover", limits, "from a tick to an hour without SYNC"));
    let heard_limit = section.optional_number("heard_limit", Range::positive(STATE));
    let heard_rate = section.optional_number("heard_rate", Range::positive(INPUT));
    let is_limited = heard_limit.is_some() || heard_rate.is_some();
    let default = if is_limited { DROP_AFTER } else { 0 };
    let drop_after =
        section.integer("drop_after", Some(default), (0, MOST_DOUBTS), "states in a row; 0 never does");
    section.finish();
    // Both within a byte.
    let byte = |count| u8::try_from(count).unwrap_or(u8::MAX);
    SafetySpec {
        lost_neighbours: byte(lost),
        holdover_ns: holdover,
        heard_limit,
        heard_rate,
        drop_after: byte(drop_after),
    }
}

/// Refuses limits of what is heard that no node has, that do nothing, or that nobody keeps from the start.
pub(super) fn make_sense(
    safety: &SafetySpec,
    coupling: Coupling<f64>,
    nodes: &[NodeSpec],
    (root, log): (&Item, &Log),
) {
    let of = |key: &str| root.get("safety").and_then(|section| section.get(key));
    let SafetySpec { heard_limit, heard_rate, drop_after, .. } = *safety;
    if let (Some(item), Coupling::WeaklyCentralised) =
        (of("heard_limit").or_else(|| of("heard_rate")).or_else(|| of("drop_after")), coupling)
    {
        let allowed = format!("is not for {} coupling, which no node runs; leave it out", coupling.kind());
        log.report(item.diagnostic(Problem::Value, allowed));
    }
    if let (Some(item), None, None) = (of("drop_after").filter(|_| drop_after != 0), heard_limit, heard_rate)
    {
        let allowed = "does nothing without safety.heard_limit or safety.heard_rate; give one of them";
        log.report(item.diagnostic(Problem::Value, allowed.to_owned()));
    }
    let Some((item, limit)) = of("heard_limit").zip(heard_limit) else { return };
    let is_beyond = |node: &&NodeSpec| node.state.iter().any(|x| x.abs() > limit);
    if let Some(node) = nodes.iter().find(is_beyond) {
        let allowed =
            format!("must be at least the size of each initial state; node {} begins beyond", node.id);
        log.report(item.diagnostic(Problem::Value, allowed));
    }
}
