//! Configurations that are staged before the start and adopted at a tick, as events of kind `set` ask for them.
//!
//! They are read as if the file had the new values in place of the old ones, so that the same ranges hold for both. A node
//! adopts one in a run (protocol/README.md, "Commit").

use super::diagnostic::{Diagnostic, Diagnostics, Problem};
use super::dynamics::Dynamics;
use super::event::{Detail, EventSpec, NewValue, Targets};
use super::inputs::Files;
use super::model::{NodeSpec, Scenario};
use super::overrides::put;
use super::reader::{Log, Section};
use super::tree::{Item, Table, Value};
use super::{agents, coupling, damping, format_duration};
use std::collections::BTreeMap;

/// What can be set while nodes run: in the file, and in the table of one node.
pub(super) const SETTABLE: [(&str, &str); 5] = [
    ("coupling.funnel", "funnel"),
    ("coupling.gain", "gain"),
    ("coupling.damping", "damping"),
    ("agent.dynamics", "dynamics"),
    ("agent.limits", "limits"),
];
/// The same for messages.
pub(super) const ALLOWED: &str = "one of coupling.funnel, coupling.gain, coupling.damping, agent.dynamics, agent.limits, or a key in one of them";

/// What a node is configured with from a tick on.
#[derive(Clone, Debug, PartialEq)]
pub struct Staged {
    /// The first tick with it.
    pub tick: u64,
    /// All of it; of its initial state nothing is used.
    pub node: NodeSpec,
}

/// Whether a key can be set while nodes run.
pub(super) fn is_settable(key: &str) -> bool {
    rest_of(key).is_some()
}

/// What a node's own table calls the first part of a key, and the parts after it.
fn rest_of(key: &str) -> Option<(&'static str, &str)> {
    SETTABLE.into_iter().find_map(|(name, own)| {
        let rest = key.strip_prefix(name)?;
        (rest.is_empty() || rest.starts_with('.') && !rest.contains("..") && !rest.ends_with('.'))
            .then_some((own, rest))
    })
}

impl Scenario {
    /// The node with this index as it shall be configured at tick `k`.
    #[must_use]
    pub fn node_at(&self, index: usize, k: u64) -> Option<&NodeSpec> {
        match self.staged.get(index) {
            Some(Some(staged)) if k >= staged.tick => Some(&staged.node),
            _ => self.nodes.get(index),
        }
    }

    /// The vector field of the node with this index at tick `k`. One that the program around the simulation has put there
    /// stays.
    #[must_use]
    pub fn field_at(&self, index: usize, k: u64) -> Option<&Dynamics> {
        let first = &self.nodes.get(index)?.dynamics;
        if first.hosted().is_some() { Some(first) } else { Some(&self.node_at(index, k)?.dynamics) }
    }

    /// The scenario whose nodes are, from the start, what they are at the end of the run. None where no event sets
    /// anything.
    #[must_use]
    pub fn as_staged(&self) -> Option<Self> {
        if self.staged.iter().all(Option::is_none) {
            return None;
        }
        let node = |(now, staged): (&NodeSpec, &Option<Staged>)| {
            let mut next = staged.as_ref().map_or(now, |staged| &staged.node).clone();
            // A field that the program around the simulation has put there stays its own.
            if now.dynamics.hosted().is_some() {
                next.dynamics = now.dynamics.clone();
            }
            next
        };
        Some(Self { nodes: self.nodes.iter().zip(&self.staged).map(node).collect(), ..self.clone() })
    }

    /// The first tick for which nothing is predicted: what is set there changes how the network moves as a whole. Equal
    /// funnels in place of equal funnels do not.
    #[must_use]
    pub fn predicted_to(&self) -> Option<u64> {
        let next = self.as_staged()?;
        let equal_funnels =
            |nodes: &[NodeSpec]| nodes.windows(2).all(|pair| pair[0].funnel == pair[1].funnel);
        let only_funnel = self.nodes.iter().zip(&next.nodes).all(|(now, next)| {
            let now = NodeSpec { funnel: next.funnel, damping: next.damping, ..now.clone() };
            now == *next
        });
        // Between two ticks at which something is set funnels differ.
        let ticks: Vec<_> =
            self.staged.iter().map(|staged| staged.as_ref().map(|staged| staged.tick)).collect();
        let at_once = ticks.windows(2).all(|pair| pair[0] == pair[1]);
        if at_once && only_funnel && equal_funnels(&self.nodes) && equal_funnels(&next.nodes) {
            return None;
        }
        self.staged.iter().flatten().map(|staged| staged.tick).min()
    }
}

/// What events set, by index of the node; empty where they set nothing.
pub(super) fn read(
    scenario: &Scenario,
    root: &Item,
    files: &Files,
) -> Result<Vec<Option<Staged>>, Diagnostics> {
    let mut ticks: BTreeMap<u64, Vec<(&EventSpec, &NewValue)>> = BTreeMap::new();
    for event in &scenario.events {
        if let Detail::Set(new) = &event.detail {
            ticks.entry(scenario.time.first_tick(event.at_ns)).or_default().push((event, new));
        }
    }
    if ticks.is_empty() {
        return Ok(Vec::new());
    }
    let mut staged: Vec<Option<Staged>> = vec![None; scenario.nodes.len()];
    for (tick, events) in ticks {
        let nodes = nodes_with(&events, scenario, root, files)?;
        for (event, new) in &events {
            let written = written(root, new)?;
            let targets = targets(event, scenario);
            sound(tick, &targets, &nodes, (scenario, &staged), (root, written))?;
        }
        for index in events.iter().flat_map(|(event, _)| targets(event, scenario)) {
            staged[index] = Some(Staged { tick, node: nodes[index].clone() });
        }
    }
    Ok(staged)
}

/// The nodes that an event names, by index.
fn targets(event: &EventSpec, scenario: &Scenario) -> Vec<usize> {
    match &event.targets {
        Targets::AllNodes => (0..scenario.nodes.len()).collect(),
        targets => targets.nodes().to_vec(),
    }
}

/// The event as written.
fn written<'a>(root: &'a Item, new: &NewValue) -> Result<&'a Item, Box<Diagnostic>> {
    let items = match root.get("event").map(|item| &item.value) {
        Some(Value::Array(items)) => items.as_slice(),
        _ => &[],
    };
    items
        .get(new.place)
        .ok_or_else(|| root.place.diagnostic(Problem::Whole, "event", "cannot be made sense of"))
}

/// All nodes, with what these events set.
fn nodes_with(
    events: &[(&EventSpec, &NewValue)],
    scenario: &Scenario,
    root: &Item,
    files: &Files,
) -> Result<Vec<NodeSpec>, Diagnostics> {
    let mut tree = root.clone();
    for (event, new) in events {
        set(&mut tree, event, new, written(root, new)?)?;
    }
    let log = Log::default();
    let unread =
        || Diagnostics::from(root.place.diagnostic(Problem::Whole, "event", "cannot be made sense of"));
    let mut file = Section::open(&tree, &log).ok_or_else(unread)?;
    let coupling = super::need_section(&mut file, "coupling").and_then(coupling::read);
    log.checkpoint()?;
    let coupling = coupling.ok_or_else(unread)?;
    let (count, end) = (scenario.nodes.len() as u64, scenario.time.end_s());
    let agents::Agents { mut nodes, damping, .. } =
        agents::read(&mut file, &coupling, count, files, end, scenario.seed);
    log.checkpoint()?;
    damping::resolve(&mut nodes, &damping, &scenario.graph, coupling.kind, &log);
    log.checkpoint()?;
    if nodes.len() == scenario.nodes.len() { Ok(nodes) } else { Err(unread()) }
}

/// Puts what an event sets into the tree: for all nodes where `--set` would put it, else into the table of each node.
fn set(tree: &mut Item, event: &EventSpec, new: &NewValue, written: &Item) -> Result<(), Box<Diagnostic>> {
    let (Some(value), Some((own, rest))) = (written.get("value"), rest_of(&new.key)) else { return Ok(()) };
    let keys: Vec<String> = match &event.targets {
        Targets::Nodes(nodes) => nodes.iter().map(|node| format!("node.{}.{own}{rest}", node + 1)).collect(),
        _ => vec![new.key.clone()],
    };
    for key in keys {
        let path: Vec<String> = key.split('.').map(str::to_owned).collect();
        put(tree, &path, &value.place, |key| renamed(value, key))?;
    }
    Ok(())
}

/// The same value under another key: messages name it as if it stood there.
fn renamed(item: &Item, path: &str) -> Item {
    let value = match &item.value {
        Value::Table(table) => Value::Table(Table::from_iter(
            table.iter().map(|(key, item)| (key.clone(), renamed(item, &format!("{path}.{key}")))),
        )),
        Value::Array(items) => Value::Array(
            items.iter().enumerate().map(|(n, item)| renamed(item, &format!("{path}[{n}]"))).collect(),
        ),
        value => value.clone(),
    };
    Item { value, path: path.to_owned(), ..item.clone() }
}

/// A node adopts one configuration in a run, after its start, and it is another one than it has.
fn sound(
    tick: u64,
    targets: &[usize],
    next: &[NodeSpec],
    (scenario, staged): (&Scenario, &[Option<Staged>]),
    (root, written): (&Item, &Item),
) -> Result<(), Box<Diagnostic>> {
    let refuse = |key: &str, allowed: String| {
        Err(written.get(key).unwrap_or(written).diagnostic(Problem::Value, allowed))
    };
    if tick == 0 {
        return refuse(
            "at",
            "must be later than 0s: what holds from the start stands in its own section".to_owned(),
        );
    }
    if let Some((index, before)) =
        targets.iter().find_map(|&index| Some((index, staged.get(index)?.as_ref()?)))
    {
        let before = format_duration(scenario.time.at_ns(before.tick));
        let allowed = format!(
            "node {} is set at {before} already: nothing is staged in a node that runs, so that it adopts one configuration in a run",
            index + 1
        );
        return refuse("at", allowed);
    }
    if targets.iter().all(|&index| next[index] == scenario.nodes[index]) {
        return refuse("value", "changes nothing: its nodes have that from the start".to_owned());
    }
    let has_other_field = |index: usize| next[index].dynamics != scenario.nodes[index].dynamics;
    if let Some(index) = targets.iter().find(|&&index| has_other_field(index) && scenario.has_plant(index)) {
        let allowed = format!(
            "must not be there for node {}, which an event of kind sensor or actuator gives a plant: that goes on as it is",
            index + 1
        );
        return refuse("key", allowed);
    }
    // Whatever the seed draws.
    if may_draw_plants(root) && targets.iter().any(|&index| has_other_field(index)) {
        let allowed = "must not be there beside [faults] of kind sensor or actuator, which give nodes a plant: that goes on as it is";
        return refuse("key", allowed.to_owned());
    }
    let components = scenario.components();
    if targets.iter().any(|&index| next[index].state.len() != components) {
        return refuse(
            "value",
            format!("must leave the states of nodes as they are: they have {components} components"),
        );
    }
    Ok(())
}

/// Whether `[faults]` may have the sensor or the actuator of a node fail.
fn may_draw_plants(root: &Item) -> bool {
    let kinds = root.get("faults").and_then(|faults| faults.get("kinds")).map(|kinds| &kinds.value);
    let Some(Value::Array(kinds)) = kinds else { return false };
    kinds.iter().filter_map(Item::text).any(|kind| matches!(kind, "sensor" | "actuator"))
}
