//! What a log holds, before anything is replayed: whether it can be one of this scenario and this node.

use super::reader::LogReader;
use super::{Entry, says};
use crate::bus::table::node_of;
use crate::can::AnyFormat;
use crate::run::RunError;
use crate::scenario::Scenario;
use funnelnet_can_bus::{Id, response};
use funnelnet_protocol::message::{Command, Message};
use std::collections::BTreeMap;
use std::path::Path;

/// Data bytes of a plain state of one component (protocol/README.md).
const BYTES: u32 = 5;

/// What drives the ticks of the nodes of a log.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Drive {
    /// A simulated bus: all nodes tick at the same known times.
    Simulated,
    /// A host that says START, and SYNC for each tick.
    Host,
    /// A host says START, and each node ticks by its own clock.
    OwnClock,
}

/// What a log holds of the bus that a node is on.
#[derive(Debug)]
pub struct Survey {
    /// The interface.
    pub interface: String,
    /// Whether its frames are those of CAN FD.
    pub fd: bool,
    pub drive: Drive,
}

/// What was seen on one interface.
#[derive(Debug, Default)]
struct Seen {
    fd: bool,
    start: bool,
    sync: bool,
    /// By node: line of its first frame.
    nodes: BTreeMap<u8, usize>,
    /// By node and component: the first state that was said, with its line.
    first: BTreeMap<(u8, u8), (f32, usize)>,
}

/// Looks through the log for node `id`.
///
/// # Errors
/// It cannot be read, or is none of this scenario and node.
pub fn survey(path: &Path, scenario: &Scenario, id: u8) -> Result<Survey, RunError> {
    let mut log = LogReader::open(path)?;
    let mut buses: BTreeMap<String, Seen> = BTreeMap::new();
    while let Some(entry) = log.next()? {
        let Entry { interface, .. } = &entry;
        match buses.get_mut(interface) {
            Some(seen) => seen.take(&entry),
            None => buses.entry(interface.clone()).or_default().take(&entry),
        }
    }
    // Where a host relays its frames to other buses, they come there later.
    let own = buses.into_iter().filter_map(|(name, seen)| Some((*seen.nodes.get(&id)?, name, seen)));
    let Some((_, interface, seen)) = own.min_by_key(|(line, ..)| *line) else {
        return Err(RunError::bad_input(format!("{}: no frame of node {id} is in it", path.display())));
    };
    fits(path, &seen, scenario, id)?;
    let drive = match (seen.start, seen.sync) {
        (_, true) => Drive::Host,
        (true, false) => Drive::OwnClock,
        (false, false) => Drive::Simulated,
    };
    Ok(Survey { interface, fd: seen.fd, drive })
}

impl Seen {
    fn take(&mut self, entry: &Entry) {
        let Some((raw, bytes)) = entry.real_time() else { return };
        self.fd |= entry.record.fd.is_some();
        for message in says(&mut AnyFormat::new(self.fd), raw, bytes).into_iter().flatten() {
            match message {
                Message::Ctrl { command: Command::Start, .. } => self.start = true,
                Message::Sync { .. } => self.sync = true,
                Message::State { source, component, x, .. } => {
                    self.first.entry((source.get(), component.get())).or_insert((x, entry.line));
                }
                _ => {}
            }
        }
        if let Some(node) = node_of(Id::Base(raw)).filter(|_| raw >> 7 > 0) {
            self.nodes.entry(node).or_insert(entry.line);
        }
    }
}

/// Refuses a log whose nodes, or whose first states, are not those of the scenario.
fn fits(path: &Path, seen: &Seen, scenario: &Scenario, id: u8) -> Result<(), RunError> {
    let not = |why: String| {
        RunError::bad_input(format!(
            "{}: not a log of this scenario, its seed and its settings: {why}",
            path.display()
        ))
    };
    let nodes = scenario.nodes.len();
    if let Some((other, line)) = seen.nodes.iter().find(|(other, _)| usize::from(**other) > nodes) {
        return Err(not(format!("line {line} is of node {other}, and the scenario has {nodes} nodes")));
    }
    if let Some(other) = silent(seen, scenario, id) {
        return Err(not(format!("node {other} says nothing in it")));
    }
    let components = scenario.components();
    if let Some(((node, component), (_, line))) =
        seen.first.iter().find(|((_, component), _)| usize::from(*component) >= components)
    {
        return Err(not(format!(
            "line {line} is component {component} of node {node}, and states have {components} in the scenario"
        )));
    }
    for (&(node, component), &(x, line)) in &seen.first {
        let Some(spec) = scenario.nodes.get(usize::from(node) - 1).filter(|spec| spec.noise == 0.0) else {
            continue;
        };
        let wanted = spec.state.get(usize::from(component)).map_or(f32::NAN, |&x| x as f32);
        // What the node itself begins with is found by its replay.
        if node != id && wanted.to_bits() != x.to_bits() {
            return Err(not(format!(
                "node {node} begins with x = {x} in line {line}, and with {wanted} in the scenario (tick 0, component {component})"
            )));
        }
    }
    Ok(())
}

/// A node that should be in the log, and is not: a neighbour; in a simulation any node, unless the bus has no
/// room for all.
fn silent(seen: &Seen, scenario: &Scenario, id: u8) -> Option<u8> {
    let is_silent = |other: &u8| !seen.nodes.contains_key(other);
    let neighbours = scenario.graph.neighbours(usize::from(id) - 1);
    let mut neighbours = neighbours.into_iter().filter_map(|(index, _)| u8::try_from(index + 1).ok());
    if seen.start || seen.sync {
        return neighbours.find(is_silent);
    }
    let bits = u64::from(response::longest_classic(Id::Base(0), BYTES));
    let states = (scenario.nodes.len() * scenario.components()) as u64;
    let needed_ns =
        states.saturating_mul(bits).saturating_mul(1_000_000_000) / u64::from(scenario.bus.bitrate.max(1));
    let nodes = u8::try_from(scenario.nodes.len()).unwrap_or(u8::MAX);
    (1..=nodes).find(is_silent).filter(|_| needed_ns < scenario.time.tick_ns)
}
