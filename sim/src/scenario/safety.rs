//! `[safety]`: what stops a node, beside its own state and funnel.

use super::model::SafetySpec;
use super::reader::Section;
use funnelnet_protocol::config::MAX_NEIGHBOURS;

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
    section.finish();
    // Within 0 to 126.
    SafetySpec { lost_neighbours: u8::try_from(lost).unwrap_or(u8::MAX), holdover_ns: holdover }
}
