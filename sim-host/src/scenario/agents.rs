//! Nodes: `[agent]` and `[coupling]` give the defaults, `[[node]]` overrides them per id.
//!
//! An override is merged over the default key by key. One that names another `kind` starts afresh, since the
//! keys of one kind mean nothing to another.

use std::collections::BTreeMap;

use funnel_core::params;
use funnel_protocol::config::MAX_SINES;

use super::coupling::{Coupling, read_funnel, read_gain};
use super::diagnostic::Problem;
use super::model::{Affine, NodeSpec, Sine};
use super::reader::{Log, Range, Section, integer, later, number, ready};
use super::tree::{Item, Place, Value};

const STATE: Range = Range::any("state units").or_vector();

/// What one `[agent]` or `[[node]]` table says.
#[derive(Clone, Copy, Default)]
struct Given<'a> {
    state: Option<&'a Item>,
    dynamics: Option<&'a Item>,
    gain: Option<&'a Item>,
    funnel: Option<&'a Item>,
}

/// The nodes, and where each one's initial state (or else its funnel) was written.
pub(super) fn read<'a>(
    root: &mut Section<'a>,
    coupling: &Coupling<'a>,
    count: u64,
) -> (Vec<NodeSpec>, Vec<Place>) {
    let log = root.log();
    let defaults = read_agent(root, coupling);
    let overrides = read_overrides(root, count);
    let lacks = |id: &u64| overrides.get(id).is_none_or(|given| given.dynamics.is_none());
    let without = (1..=count).find(|id| defaults.dynamics.is_none() && lacks(id));
    if let Some(id) = without {
        let allowed = format!("node {id} has none of its own; as {{ kind = \"affine\", slope = -1.0 }}");
        let problem = Problem::MissingKey { section: "[agent]".to_owned() };
        log.report(root.place().diagnostic(problem, "agent.dynamics", allowed));
    }
    let node = |id| read_node(id, &defaults, overrides.get(&u64::from(id)), root.place(), log);
    (1..=u16::try_from(count).unwrap_or(u16::MAX)).filter_map(node).unzip()
}

fn read_agent<'a>(root: &mut Section<'a>, coupling: &Coupling<'a>) -> Given<'a> {
    let mut given = Given { gain: coupling.gain, funnel: coupling.funnel, ..Given::default() };
    if let Some(mut agent) = root.section("agent") {
        let log = agent.log();
        given.state = agent.take("state");
        given.dynamics = agent.take("dynamics");
        agent.finish();
        given.state.and_then(|item| read_state(item, log));
        given.dynamics.and_then(|item| read_dynamics(item, log));
    }
    given
}

fn read_overrides<'a>(root: &mut Section<'a>, count: u64) -> BTreeMap<u64, Given<'a>> {
    let log = root.log();
    let mut all = BTreeMap::new();
    for item in root.array("node") {
        let Some(mut section) = Section::open(item, log) else { continue };
        let id = section.need("id", "must be the id of the node that it changes");
        let given = Given {
            state: section.take("state"),
            dynamics: section.take("dynamics"),
            gain: section.take("gain"),
            funnel: section.take("funnel"),
        };
        section.finish();
        let Some(id) = id else { continue };
        match integer(id, (1, count), "[graph] nodes") {
            Ok(number) if all.insert(number, given).is_some() => {
                log.report(id.diagnostic(Problem::Value, "must be unique: an earlier [[node]] has this id"));
            }
            Ok(_) => {}
            Err(diagnostic) => log.report(diagnostic),
        }
    }
    all
}

fn read_node(
    id: u16,
    defaults: &Given<'_>,
    given: Option<&Given<'_>>,
    root: &Place,
    log: &Log,
) -> Option<(NodeSpec, Place)> {
    let given = given.copied().unwrap_or_default();
    let state = given.state.or(defaults.state);
    let dynamics = merged(defaults.dynamics, given.dynamics);
    let gain = merged(defaults.gain, given.gain);
    let funnel = merged(defaults.funnel, given.funnel);
    let place = state.map(|item| &item.place).or(funnel.as_ref().map(|item| &item.place));
    let place = place.unwrap_or(root).clone();
    let node = NodeSpec {
        id,
        state: state.map_or(Some(0.0), |item| read_state(item, log))?,
        dynamics: read_dynamics(&dynamics?, log)?,
        gain: read_gain(&gain?, log)?,
        funnel: read_funnel(&funnel?, log)?,
    };
    Some((node, place))
}

/// `over` merged over `base`, key by key; `over` alone where it names another kind.
fn merged(base: Option<&Item>, over: Option<&Item>) -> Option<Item> {
    let (Some(base), Some(over)) = (base, over) else { return over.or(base).cloned() };
    let (Value::Table(low), Value::Table(high)) = (&base.value, &over.value) else {
        return Some(over.clone());
    };
    let kind = |item: &Item| item.get("kind").map(|kind| kind.raw.clone());
    if kind(over).is_some() && kind(over) != kind(base) {
        return Some(over.clone());
    }
    let mut table = low.clone();
    table.extend(high.iter().map(|(key, item)| (key.clone(), item.clone())));
    Some(Item { value: Value::Table(table), ..over.clone() })
}

fn read_state(item: &Item, log: &Log) -> Option<f64> {
    number(item, STATE).map_err(|diagnostic| log.report(diagnostic)).ok()
}

fn read_dynamics(item: &Item, log: &Log) -> Option<Affine> {
    let mut section = Section::open(item, log)?;
    section.choice("kind", &[ready("affine", ()), later("expression", ())], None)?;
    let affine = Affine {
        slope: section.number("slope", Some(0.0), Range::any("1/s").up_to(params::LARGEST_RATE).or_vector()),
        offset: section.number("offset", Some(0.0), Range::any("state units per second").or_vector()),
        sines: section.array("sines").iter().filter_map(|item| read_sine(item, log)).collect(),
    };
    if let Some(surplus) = section.array("sines").get(MAX_SINES) {
        let allowed = format!("must not be there: a node takes at most {MAX_SINES} sines");
        log.report(surplus.diagnostic(Problem::Value, allowed));
    }
    section.finish();
    Some(affine)
}

fn read_sine(item: &Item, log: &Log) -> Option<Sine> {
    let mut section = Section::open(item, log)?;
    let sine = Sine {
        amplitude: section.number("amplitude", None, Range::any("state units per second").or_vector()),
        frequency: section.number(
            "frequency",
            None,
            Range::non_negative("rad/s").up_to(params::LARGEST_RATE),
        ),
        phase: section.number("phase", Some(0.0), Range::any("rad").up_to(params::LARGEST_PHASE).or_vector()),
    };
    section.finish();
    Some(sine)
}
