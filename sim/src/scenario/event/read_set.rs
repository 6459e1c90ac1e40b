//! The keys of an event that sets something: which key of the scenario gets which value, on which nodes.

use super::read::{index, indices, kept, one_of};
use super::{Detail, NewValue, Targets};
use crate::scenario::diagnostic::Problem;
use crate::scenario::reader::Section;
use crate::scenario::staged::{ALLOWED, is_settable};
use crate::scenario::written::inline;

/// `node` or `nodes`; without either all nodes.
pub(super) fn of_all_or_some(section: &mut Section<'_>, nodes: u64) -> Option<Targets> {
    let ids = match one_of(section, "node", "nodes")? {
        Some(("node", item)) => index(item, nodes).map(|index| vec![index]),
        Some((_, item)) => indices(item, nodes),
        None => return Some(Targets::AllNodes),
    };
    kept(section, ids).map(Targets::Nodes)
}

/// `key` and `value`. The value is read with all that the scenario says beside it.
pub(super) fn new_value(section: &mut Section<'_>, place: usize) -> Detail {
    let key = section.need("key", &format!("must be {ALLOWED}, as \"coupling.funnel.end\""));
    let value = section.need("value", "must be what the key gets, as 0.5");
    if let Some(item) = key.filter(|item| !item.text().is_some_and(is_settable)) {
        let allowed = format!("must be {ALLOWED}: nothing else changes while nodes run");
        section.log().report(item.diagnostic(Problem::Value, allowed));
    }
    let key = key.and_then(|item| item.text()).unwrap_or_default().to_owned();
    let (value, toml) = value.map(|item| (item.raw.clone(), inline(&item.value))).unwrap_or_default();
    Detail::Set(NewValue { key, value, toml, place })
}
