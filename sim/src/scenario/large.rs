//! A scenario with `bus.model = "none"`: up to a million nodes without a wire (docs/notes/2026-11-29-large.md).
#![allow(clippy::neg_cmp_op_on_partial_ord, reason = "what is not a number is outside")]

use super::agents::{self, Population};
use super::coupling::{self, Defaults};
use super::graph::Graph;
use super::inputs::{self, InputFile};
use super::model::{Expect, FloorSpec, NodeSpec, TimeSpec};
use super::random::{Kept, Random};
use super::reader::{Log, Section};
use super::tree::{Item, Value};
use super::{
    DEFAULT_SEED, Diagnostics, Override, Problem, Source, damping, default_title, expect, need_section,
    network, read_time, tree, whole_ticks, written,
};
use crate::number_format::significant;
use funnelnet_law::{Breach, Coupling};
use std::borrow::Cow;
use std::path::{Path, PathBuf};

/// The model of the bus that is none.
const NONE: &str = "none";
/// Couplings that remember nothing of an edge and need no word from outside.
const COUPLINGS: [Coupling<f64>; 4] =
    [Coupling::NodeWise, Coupling::ElementWise, Coupling::Linear, Coupling::None];

/// A scenario without a bus, resolved and validated. Nodes are made when they are asked for.
#[derive(Clone, Debug)]
pub struct LargeScenario {
    /// Title; the file's name where it gives none.
    pub title: String,
    /// The root of every random stream.
    pub seed: u64,
    /// Tick and duration, without rounds and without a slow start.
    pub time: TimeSpec,
    /// Graph: who hears whom.
    pub graph: Graph,
    /// The coupling law: node-wise, element-wise, linear or none.
    pub coupling: Coupling<f64>,
    /// The narrowest funnel that is asked for.
    pub floor: FloorSpec,
    /// The law runs in `(1 - guard) psi`, once that has grown from nothing.
    pub guard: f64,
    /// The largest `|u|` that a node may ask for (state units / s), where the designer says.
    pub u_max: Option<f64>,
    /// The unit of the states.
    pub unit: Option<String>,
    /// Expectations of the run: those that are not refused.
    pub expect: Expect,
    /// The file that it came from, as named by the user.
    pub path: PathBuf,
    /// The text that gives it again, with the values of the command line in it.
    pub as_run: String,
    /// The files that it names there.
    pub input_files: Vec<InputFile>,
    /// All nodes but those of `own`.
    common: Option<NodeSpec>,
    /// By index, ascending.
    own: Vec<(usize, Kept, NodeSpec)>,
    random: Random,
}

impl LargeScenario {
    /// Number of nodes.
    #[must_use]
    pub fn nodes(&self) -> usize {
        self.graph.nodes
    }

    /// Specifications before anything is drawn: at first that of the nodes that no `[[node]]` changes.
    pub fn prototypes(&self) -> impl Iterator<Item = &NodeSpec> {
        self.common.iter().chain(self.own.iter().map(|(.., node)| node))
    }

    /// Place of a node's prototype among [`Self::prototypes`], and what of it is not drawn.
    #[must_use]
    pub fn prototype_of(&self, index: usize) -> (usize, Kept) {
        let before = usize::from(self.common.is_some());
        match self.own.binary_search_by_key(&index, |(index, ..)| *index) {
            Ok(at) => (at + before, self.own.get(at).map_or(Kept::default(), |(_, kept, _)| *kept)),
            Err(_) => (0, Kept::default()),
        }
    }

    /// What is drawn for each node.
    #[must_use]
    pub fn random(&self) -> &Random {
        &self.random
    }

    /// Gives each node with its index, in order. Its `id` there means nothing: ids are indices plus one.
    pub fn for_each_node(&self, mut take: impl FnMut(usize, usize, &NodeSpec)) {
        let prototypes: Vec<_> = self.prototypes().collect();
        let is_drawn = self.random != Random::default();
        for index in 0..self.nodes() {
            let (at, kept) = self.prototype_of(index);
            let Some(prototype) = prototypes.get(at) else { continue };
            let mut node = Cow::Borrowed(*prototype);
            if is_drawn {
                self.random.apply(self.seed, index, kept, node.to_mut());
            }
            take(index, at, &node);
        }
    }
}

/// A scenario of either kind.
#[derive(Clone, Debug)]
pub enum AnyScenario {
    /// With a bus that carries the states.
    Wired(Box<super::Scenario>),
    /// With none.
    Large(Box<LargeScenario>),
}

impl AnyScenario {
    /// Title; the file's name where it gives none.
    #[must_use]
    pub fn title(&self) -> &str {
        match self {
            Self::Wired(scenario) => &scenario.title,
            Self::Large(scenario) => &scenario.title,
        }
    }

    /// The text that gives it again, with the values of the command line in it.
    #[must_use]
    pub fn as_run(&self) -> &str {
        match self {
            Self::Wired(scenario) => &scenario.as_run,
            Self::Large(scenario) => &scenario.as_run,
        }
    }

    /// The files that it names there.
    #[must_use]
    pub fn input_files(&self) -> &[InputFile] {
        match self {
            Self::Wired(scenario) => &scenario.input_files,
            Self::Large(scenario) => &scenario.input_files,
        }
    }

    /// Steps of all nodes in the whole run.
    #[must_use]
    pub fn node_steps(&self) -> u64 {
        let (time, nodes) = match self {
            Self::Wired(scenario) => (&scenario.time, scenario.nodes.len()),
            Self::Large(scenario) => (&scenario.time, scenario.nodes()),
        };
        time.steps().saturating_mul(nodes as u64)
    }
}

impl Source {
    /// The scenario, of whichever kind its `bus.model` says, with `overrides` put in first.
    ///
    /// # Errors
    /// Everything that was found to be wrong, with file, line and column.
    pub fn any_scenario(&self, overrides: &[Override]) -> Result<AnyScenario, Diagnostics> {
        let mut root = tree::parse_file(&self.text, &self.path.display().to_string())?;
        for value in overrides {
            value.apply(&mut root)?;
        }
        if !is_large(&root) {
            return self.scenario(overrides).map(|scenario| AnyScenario::Wired(Box::new(scenario)));
        }
        let files = inputs::Files::beside(&self.path);
        let scenario = resolve(&root, &self.path, &files)?;
        let input_files = files.copies();
        if let Value::Table(table) = &mut root.value {
            files.name_copies(table);
        }
        let is_unchanged = overrides.is_empty() && input_files.is_empty();
        let as_run = written::as_run(&self.text, root, &scenario.title, is_unchanged);
        Ok(AnyScenario::Large(Box::new(LargeScenario { as_run, input_files, ..scenario })))
    }
}

/// Whether the tree asks for a run without a bus.
pub(super) fn is_large(root: &Item) -> bool {
    model(root).is_some_and(|item| item.text() == Some(NONE))
}

fn model(root: &Item) -> Option<&Item> {
    root.get("bus").and_then(|bus| bus.get("model"))
}

/// Refuses such a scenario where a bus is needed.
pub(super) fn refuse(root: &Item, log: &Log) {
    if let Some(item) = model(root).filter(|_| is_large(root)) {
        let allowed = "is for `run`, `check` and `sweep` only; here a bus has to carry the states";
        log.report(item.diagnostic(Problem::Value, allowed));
    }
}

fn resolve(root: &Item, path: &Path, files: &inputs::Files) -> Result<LargeScenario, Diagnostics> {
    let log = Log::default();
    let unread = || Diagnostics::from(root.place.diagnostic(Problem::Whole, "", "cannot be made sense of"));
    refuse_what_needs_a_bus(root, &log);
    log.checkpoint()?;
    let Some(mut file) = Section::open(root, &log) else { return Err(unread()) };
    file.integer("version", None, (1, 1), "the version of this format; write version = 1");
    let title = file.text("title").unwrap_or_else(|| default_title(path));
    let seed = file.integer("seed", Some(DEFAULT_SEED), (0, u64::MAX), "");
    let time = need_section(&mut file, "time").map(read_time);
    let network = need_section(&mut file, "graph").and_then(|section| {
        network::read(section, (network::MAX_NODES, "and a run with a bus takes 127 at most"), files)
    });
    let coupling = need_section(&mut file, "coupling").and_then(coupling::read);
    let population = match (&network, &coupling) {
        (Some(network), Some(coupling)) if network.nodes > 0 => {
            let end = time.as_ref().map_or(0.0, |time| time.duration_ns as f64 / 1e9);
            agents::read_population(&mut file, coupling, network.nodes, files, end)
        }
        _ => {
            file.take("agent");
            file.take("node");
            Population::default()
        }
    };
    read_bus(&mut file);
    let mut expect = expect::read(&mut file, network.as_ref().map_or(0, |network| network.nodes));
    file.finish();
    log.checkpoint()?;
    let (Some(time), Some(network), Some(coupling)) = (time, network, coupling) else {
        return Err(unread());
    };
    let time = whole_ticks(&time, network.nodes, &log);
    expect::in_ticks(&mut expect, &time, root.get("expect"), &log);
    supported(&coupling, root, &log);
    let graph = network::build(&network, seed, &log);
    log.checkpoint()?;
    let Population { mut common, own, unit, random, damping: said } = population;
    let mut nodes: Vec<NodeSpec> = common.take().into_iter().collect();
    let has_common = !nodes.is_empty();
    nodes.extend(own.iter().map(|(.., node)| node.clone()));
    damping::resolve(&mut nodes, &said, &graph, coupling.kind, &log);
    if let Some(item) = root.get("agent").filter(|_| nodes.iter().any(|node| node.state.len() > 1)) {
        let at = item.get("state").unwrap_or(item);
        log.report(at.diagnostic(
            Problem::Value,
            "must be one number with bus.model = \"none\", which takes states of one component",
        ));
    }
    log.checkpoint()?;
    let mut nodes = nodes.into_iter();
    let common = if has_common { nodes.next() } else { None };
    let own = own.into_iter().zip(nodes).map(|((index, kept, _), node)| (index, kept, node)).collect();
    let scenario = LargeScenario {
        title,
        seed,
        time,
        graph,
        coupling: coupling.kind,
        floor: coupling.floor,
        guard: coupling.guard,
        u_max: coupling.u_max,
        unit,
        expect,
        path: path.to_owned(),
        as_run: String::new(),
        input_files: Vec::new(),
        common,
        own,
        random,
    };
    starts_inside(&scenario, root)?;
    Ok(scenario)
}

/// `[bus]` has its model and nothing else.
fn read_bus(file: &mut Section<'_>) {
    if let Some(mut section) = file.section("bus") {
        section.take("model");
        section.finish();
    }
}

/// Sections that say what happens to frames, clocks and nodes.
const SECTIONS: [&str; 6] = ["link", "event", "faults", "clock", "sync", "safety"];
/// Keys that cannot work, and why.
const KEYS: [(&str, &str, &str); 10] = [
    ("time", "round", "frames are never late"),
    ("time", "slow_start", "the law runs from its start as it is"),
    ("agent", "noise", "neighbours see the states themselves"),
    ("agent", "compute", "computing takes no time"),
    ("expect", "emergent_error", "the emergent dynamics are not computed"),
    ("expect", "blended_error", "the blended dynamics are not computed"),
    ("expect", "reference_error", "there is no reference of so many nodes"),
    ("expect", "recovered_within", "there are no events"),
    ("expect", "stopped", "a run ends where a node would stop"),
    ("expect", "window", "figures are of the whole run"),
];

/// Reports every key that says something about what is not there, by its name.
fn refuse_what_needs_a_bus(root: &Item, log: &Log) {
    let report = |item: &Item, why: &str| {
        let allowed = format!("must not be there with bus.model = \"none\": {why}");
        log.report(item.key_place.diagnostic(Problem::Whole, &item.path, allowed));
    };
    for item in SECTIONS.iter().filter_map(|name| root.get(name)) {
        report(item, "there is no wire, and nothing is lost, late or off");
    }
    if let Some(Value::Table(bus)) = root.get("bus").map(|item| &item.value) {
        bus.iter().filter(|(key, _)| *key != "model").for_each(|(_, item)| {
            report(item, "there is no wire, and nothing is lost, late or disturbed");
        });
    }
    for (section, key, why) in KEYS {
        root.get(section).and_then(|section| section.get(key)).into_iter().for_each(|item| report(item, why));
    }
    let nodes = match root.get("node").map(|item| &item.value) {
        Some(Value::Array(nodes)) => nodes.as_slice(),
        _ => &[],
    };
    for (key, why) in [
        ("noise", "neighbours see the states themselves"),
        ("compute", "computing takes no time"),
        ("clock", "all nodes share one clock"),
    ] {
        nodes.iter().filter_map(|node| node.get(key)).for_each(|item| report(item, why));
    }
}

/// Couplings and policies that are run without a bus.
fn supported(coupling: &Defaults<'_>, root: &Item, log: &Log) {
    let section = root.get("coupling");
    let report = |key: &str, allowed: &str| {
        if let Some(item) = section.and_then(|section| section.get(key)) {
            log.report(item.diagnostic(Problem::Value, allowed));
        }
    };
    if !COUPLINGS.contains(&coupling.kind) {
        let names = COUPLINGS.map(|coupling| coupling.kind()).join(", ");
        report("kind", &format!("must be one of {names} with bus.model = \"none\""));
    }
    if let FloorSpec::Width(_) = coupling.floor {
        report(
            "floor",
            "must be \"f32\" or left out with bus.model = \"none\": nodes floor their funnels at what f32 resolves, and no width is judged",
        );
    }
    if coupling.on_breach != Breach::Ride {
        report("on_breach", "must be ride with bus.model = \"none\": a run ends where a node would stop");
    }
}

/// The theorem's condition on the start, of which one node is named for all.
fn starts_inside(scenario: &LargeScenario, root: &Item) -> Result<(), Diagnostics> {
    if !scenario.coupling.keeps_funnels() {
        return Ok(());
    }
    let (outside, worst) = starts(scenario);
    if outside == 0 {
        return Ok(());
    }
    let (index, nu, psi) = worst;
    let place = root.get("agent").map_or(&root.place, |item| &item.place);
    let allowed = format!(
        "starts outside its funnel: |nu| = {} at t = 0 must be below psi(0) = {} (ratio {}); {outside} of {} nodes do, and this is the worst",
        significant(nu, 6),
        significant(psi, 6),
        significant(nu / psi, 6),
        scenario.nodes()
    );
    Err(place.diagnostic(Problem::Whole, &format!("node {}", index + 1), allowed).into())
}

/// Number of nodes that start outside, and of the worst one its index, `|nu|` and `psi` (state units).
pub(crate) fn starts(scenario: &LargeScenario) -> (usize, (usize, f64, f64)) {
    let mut states = vec![0.0; scenario.nodes()];
    let mut widths = states.clone();
    scenario.for_each_node(|index, _, node| {
        if let (Some(x), Some(psi)) = (states.get_mut(index), widths.get_mut(index)) {
            (*x, *psi) = (node.state.first().copied().unwrap_or(0.0), node.funnel.width(0.0));
        }
    });
    let terms = scenario.graph.diffusive_terms(&states);
    let (mut outside, mut worst) = (0, (0, 0.0, f64::INFINITY));
    for (index, (nu, psi)) in terms.iter().map(|nu| nu.abs()).zip(widths).enumerate() {
        // Written so that NaN is outside, and the worst.
        outside += usize::from(!(nu / psi < 1.0));
        if !(nu / psi <= worst.1 / worst.2) {
            worst = (index, nu, psi);
        }
    }
    (outside, worst)
}
