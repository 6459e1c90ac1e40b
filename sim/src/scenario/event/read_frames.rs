//! The keys of events that happen to frames: they get lost, wait, are read wrong, or are false.

use super::read::{groups, index, indices, kept, link, one_of};
use super::{Detail, Lie, Targets};
use crate::scenario::Loss;
use crate::scenario::agents::STATE;
use crate::scenario::bus::{MOST_BIT_ERRORS, read_loss};
use crate::scenario::diagnostic::Problem;
use crate::scenario::reader::{Range, Section};

/// What a lie may be (state units), as a state may.
pub(in crate::scenario) const SAID: Range = STATE;
/// Slope of a lie (state units / s).
pub(in crate::scenario) const SLOPE: Range = Range::any("state units / s");

/// The largest 11-bit identifier.
pub(in crate::scenario) const LARGEST_ID: u64 = 0x7FF;

/// `link`, `groups`, `node` or `nodes`; without any of them all links.
pub(super) fn of_frames(section: &mut Section<'_>, nodes: u64) -> Option<Targets> {
    let of_nodes = one_of(section, "node", "nodes")?;
    let of_links = one_of(section, "link", "groups")?;
    if let (Some(_), Some((_, item))) = (&of_nodes, &of_links) {
        let allowed = "must not be there beside node or nodes";
        section.log().report(item.diagnostic(Problem::Value, allowed));
        return None;
    }
    match (of_nodes, of_links) {
        (Some(("node", item)), _) => {
            kept(section, index(item, nodes).map(|index| vec![index])).map(Targets::Nodes)
        }
        (Some((_, item)), _) => kept(section, indices(item, nodes)).map(Targets::Nodes),
        (None, Some(("link", item))) => kept(section, link(item, nodes)),
        (None, Some((_, item))) => kept(section, groups(item, nodes)),
        (None, None) => Some(Targets::AllLinks),
    }
}

/// `for`; without it what happens goes on to the end of the run.
pub(super) fn lies_for(section: &mut Section<'_>) -> u64 {
    match section.take("for") {
        Some(_) => section.duration("for", None),
        None => u64::MAX,
    }
}

/// `loss`, as a bus has it.
pub(super) fn loss(section: &mut Section<'_>) -> Detail {
    let allowed = "must be the probability that a frame is lost, or { good, bad, to_bad, to_good }";
    if section.need("loss", allowed).is_none() {
        return Detail::Loss(Loss::NONE);
    }
    Detail::Loss(read_loss(section))
}

/// `probability`.
pub(super) fn corrupt(section: &mut Section<'_>) -> Detail {
    Detail::Corrupt(section.number("probability", None, Range::positive_probability()))
}

/// `bit_errors`.
pub(super) fn bit_errors(section: &mut Section<'_>) -> Detail {
    let share = section.number("bit_errors", None, Range::between(1e-9, MOST_BIT_ERRORS, "of the bits"));
    Detail::BitErrors((share * 1e9).round() as u32)
}

/// `id`, of what is sent without end; without it the one that wins against all others.
pub(super) fn babble(section: &mut Section<'_>) -> Detail {
    Detail::Babble(section.integer("id", Some(0), (0, LARGEST_ID), "an 11-bit identifier") as u16)
}

/// What a node says: one of `constant`, `ramp` and `offset`.
pub(super) fn liar(section: &mut Section<'_>) -> Detail {
    Detail::Lie(lie(section))
}

/// The same, and `as`: in whose name.
pub(super) fn impostor(section: &mut Section<'_>, nodes: u64) -> Detail {
    let allowed = format!("must be the id of the node in whose name it speaks, 1 to {nodes}");
    let item = section.need("as", &allowed);
    let name = item.and_then(|item| kept(section, index(item, nodes))).unwrap_or(0);
    Detail::Impostor { name, lie: lie(section) }
}

fn lie(section: &mut Section<'_>) -> Lie {
    let constant = section.optional_number("constant", SAID);
    let ramp = section.optional_number("ramp", SLOPE);
    let offset = section.optional_number("offset", SAID);
    match (constant, ramp, offset) {
        (Some(value), None, None) => Lie::Constant(value),
        (None, Some(slope), None) => Lie::Ramp(slope),
        (None, None, Some(offset)) => Lie::Offset(offset),
        _ => {
            let allowed = "must be what is said for a state, as 3.0; or ramp, its slope per s; or offset, how far it is from the state; one of them";
            section.missing("constant", allowed);
            Lie::Constant(0.0)
        }
    }
}

/// `age`: how old the states are that are said once more.
pub(super) fn old(section: &mut Section<'_>) -> Detail {
    let is_there = section.need("age", "must be how old the states are that it says once more, as \"100ms\"");
    Detail::Age(if is_there.is_some() { section.duration("age", None) } else { 0 })
}
