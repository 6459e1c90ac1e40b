//! The scenario file: TOML to a plain, fully resolved and validated model.
//!
//! Reading goes in steps, each of which stops where it found mistakes: the syntax, then every key by itself,
//! then what only the whole shows (the graph, the number of ticks, the start inside the funnel).

mod affine;
mod agents;
mod bus;
mod clock;
mod components;
mod coupling;
mod csv_line;
mod damping;
mod diagnostic;
mod duration;
mod dynamics;
mod event;
mod expect;
mod expression;
mod faults;
mod graph;
mod graph_file;
mod host_field;
mod initial;
mod inputs;
mod large;
mod model;
mod network;
mod overrides;
pub mod random;
pub mod reader;
mod safety;
#[cfg(feature = "check")]
pub mod schema;
#[cfg(feature = "spectrum")]
mod sparse_spectrum;
#[cfg(feature = "spectrum")]
mod spectrum;
mod staged;
mod steepest;
mod topology;
pub mod tree;
mod written;

use crate::printable::printable;
use funnelnet_law::start::SlowStart;
use funnelnet_node::params;
use std::io::Read;
use std::path::{Path, PathBuf};

pub use affine::Affine;
pub use bus::{BusModel, BusSpec, LinkSettings, LinkSpec, Loss, Wiring};
pub use clock::{ClockSpec, SyncSpec};
pub use diagnostic::{Diagnostic, Diagnostics, Problem};
pub use duration::{format_duration, parse_duration};
pub use dynamics::Dynamics;
pub(crate) use event::on_engine;
pub use event::{
    Absence, ActuatorFault, Change, ClockChange, Course, Detail, Disturbance, Does, EventKind, EventSpec,
    Harm, Lie, NewValue, NoisySpell, SensorFault, Spell, Step, Targets,
};
/// One sinusoid of a field.
pub type Sine = funnelnet_law::field::Sine<f64>;
pub use expression::{Expression, ExpressionError};
pub use funnelnet_law::funnel::{Normalised, Shape};
pub use funnelnet_law::{Breach, Coupling, Funnel, Gain};
pub use graph::{Edge, Graph};
pub use host_field::{HostField, Hosted};
pub use initial::initial_ratios;
pub use inputs::{InputFile, Series};
#[cfg(feature = "check")]
pub(crate) use large::starts as large_starts;
pub use large::{AnyScenario, LargeScenario};
pub use model::{
    Expect, FinalValue, FloorSpec, InputLimits, NodeSpec, SafetySpec, Scenario, Stoppable, TimeSpec, Window,
};
pub use overrides::Override;
#[cfg(feature = "spectrum")]
pub use sparse_spectrum::Estimate;
pub use staged::Staged;
pub use written::FIRST_LINE;

use agents::Agents;
use coupling::Defaults;
use reader::{Log, Section};
use tree::{Item, Place};

/// The most nodes of a run: ids are 7 bits on the wire, and 0 means all (protocol/README.md). A larger scenario can be checked.
pub const LARGEST_RUN: usize = funnelnet_protocol::NodeId::MAX as usize;

/// Node-ticks that a run may have: about two weeks at a million per second.
const MAX_NODE_TICKS: u64 = 1 << 40;

impl Scenario {
    /// Reads and checks a scenario file, with `overrides` from the command line put in first. `-` is standard input.
    ///
    /// # Errors
    /// Everything that was found to be wrong, with file, line and column.
    pub fn load(path: &Path, overrides: &[Override]) -> Result<Self, Diagnostics> {
        Source::read(path)?.scenario(overrides)
    }

    /// The same for a text that is already in memory; `path` is only named in messages.
    ///
    /// # Errors
    /// Everything that was found to be wrong, with file, line and column.
    pub fn parse(text: &str, path: &Path, overrides: &[Override]) -> Result<Self, Diagnostics> {
        let mut root = tree::parse_file(text, &path.display().to_string())?;
        for value in overrides {
            value.apply(&mut root)?;
        }
        let files = inputs::Files::beside(path);
        let scenario = resolve(&root, path, &files)?;
        let input_files = files.copies();
        if let tree::Value::Table(table) = &mut root.value {
            files.name_copies(table);
        }
        let is_unchanged = overrides.is_empty() && input_files.is_empty();
        let as_run = written::as_run(text, root, &scenario.title, is_unchanged);
        Ok(Self { as_run, input_files, ..scenario })
    }
}

/// Most bytes of a file: 2,000 nodes with all that they can have take less than a MiB.
const LARGEST_FILE: u64 = 8 << 20;
/// How messages name a scenario that comes through standard input.
const STANDARD_INPUT: &str = "standard input";

/// The text of a scenario file that has been read and is not made sense of yet: several scenarios can be made of it.
#[derive(Clone, Debug)]
pub struct Source {
    /// The text.
    pub text: String,
    /// The file as messages name it.
    pub path: PathBuf,
}

impl Source {
    /// Reads a scenario file; `-` is standard input.
    ///
    /// # Errors
    /// It cannot be read, or is no UTF-8.
    pub fn read(path: &Path) -> Result<Self, Diagnostics> {
        let (text, path) = match is_standard_input(path) {
            true => (read_standard_input()?, Path::new(STANDARD_INPUT)),
            false => (read_text(path)?, path),
        };
        Ok(Self { text, path: path.to_owned() })
    }

    /// The scenario, with `overrides` put in first.
    ///
    /// # Errors
    /// Everything that was found to be wrong, with file, line and column.
    pub fn scenario(&self, overrides: &[Override]) -> Result<Scenario, Diagnostics> {
        Scenario::parse(&self.text, &self.path, overrides)
    }

    /// The seed that the text names, or the default one. Where it is none the reader of the scenario says so.
    #[must_use]
    pub fn seed(&self) -> u64 {
        let root = tree::parse_file(&self.text, "").ok();
        match root.as_ref().and_then(|root| root.get("seed")).map(|item| &item.value) {
            Some(tree::Value::Integer(seed)) => u64::try_from(*seed).unwrap_or(DEFAULT_SEED),
            _ => DEFAULT_SEED,
        }
    }
}

/// Where a scenario names none.
const DEFAULT_SEED: u64 = 1;

/// Whether a path means standard input.
#[must_use]
pub fn is_standard_input(path: &Path) -> bool {
    path == Path::new("-")
}

fn read_standard_input() -> Result<String, Diagnostics> {
    read_all(std::io::stdin().lock(), STANDARD_INPUT, LARGEST_FILE)
}

/// The text of a file.
///
/// # Errors
/// It cannot be read, or is no UTF-8.
pub fn read_text(path: &Path) -> Result<String, Diagnostics> {
    read_text_up_to(path, LARGEST_FILE)
}

/// The same of a file of at most so many bytes.
fn read_text_up_to(path: &Path, most: u64) -> Result<String, Diagnostics> {
    let name = path.display().to_string();
    match std::fs::File::open(path) {
        Ok(file) => read_all(file, &name, most),
        Err(error) => Err(unreadable(&error, &name)),
    }
}

fn unreadable(error: &std::io::Error, name: &str) -> Diagnostics {
    Place::whole(name).diagnostic(Problem::Whole, "", format!("cannot be read: {error}")).into()
}

/// The text of what may be anything: a device or a pipe can go on for ever.
fn read_all(source: impl Read, name: &str, most: u64) -> Result<String, Diagnostics> {
    let refuse = |why: String| Diagnostics::from(Place::whole(name).diagnostic(Problem::Whole, "", why));
    let mut bytes = Vec::new();
    source.take(most + 1).read_to_end(&mut bytes).map_err(|error| unreadable(&error, name))?;
    if bytes.len() as u64 > most {
        let what = if most == LARGEST_FILE { "scenario" } else { "graph" };
        return Err(refuse(format!("is no {what}: it has more than {} MiB", most >> 20)));
    }
    String::from_utf8(bytes).map_err(|error| {
        let at = error.utf8_error().valid_up_to();
        refuse(format!("must be UTF-8 text, and is not at byte {at}"))
    })
}

/// The tree to the model.
fn resolve(root: &Item, path: &Path, files: &inputs::Files) -> Result<Scenario, Diagnostics> {
    let log = Log::default();
    let unread = || Diagnostics::from(root.place.diagnostic(Problem::Whole, "", "cannot be made sense of"));
    large::refuse(root, &log);
    log.checkpoint()?;
    let Some(mut file) = Section::open(root, &log) else { return Err(unread()) };
    file.integer("version", None, (1, 1), "the version of this format; write version = 1");
    let title = file.text("title").unwrap_or_else(|| default_title(path));
    let seed = file.integer("seed", Some(DEFAULT_SEED), (0, u64::MAX), "");
    let time = need_section(&mut file, "time").map(read_time);
    let network = need_section(&mut file, "graph").and_then(|section| {
        let why = "and a run takes 127 at most, without bus.model = \"none\"";
        network::read(section, (network::MOST_WIRED, why), files)
    });
    let coupling = need_section(&mut file, "coupling").and_then(coupling::read);
    let Agents { mut nodes, places, unit, damping } = match (&network, &coupling) {
        (Some(network), Some(coupling)) if network.nodes > 0 => {
            let end = time.as_ref().map_or(0.0, |time| time.duration_ns as f64 / 1e9);
            agents::read(&mut file, coupling, network.nodes, files, end, seed)
        }
        _ => {
            file.take("agent");
            file.take("node");
            Agents::default()
        }
    };
    let bus = bus::read(&mut file);
    let nodes_asked = network.as_ref().map_or(0, |network| network.nodes);
    let links = bus::read_links(&mut file, nodes_asked);
    let events = event::read(&mut file, nodes_asked);
    let faults = faults::read(&mut file, root);
    let round_ns = time.as_ref().map_or(1, Time::round_ns);
    let clocks = clock::read(&mut file, nodes_asked, seed, round_ns);
    let safety = safety::read(&mut file, time.as_ref().map_or(1, Time::round_ns));
    let mut expect = expect::read(&mut file, nodes_asked);
    file.finish();
    log.checkpoint()?;
    let (Some(time), Some(network), Some(coupling)) = (time, network, coupling) else {
        return Err(unread());
    };
    let time = whole_ticks(&time, network.nodes, &log);
    expect::in_ticks(&mut expect, &time, root.get("expect"), &log);
    let graph = network::build(&network, seed, &log);
    damping::resolve(&mut nodes, &damping, &graph, coupling.kind, &log);
    bus::fresh(&bus, &time, root, &log);
    bus::whole_bits(&bus, root, &log);
    bus::enough_lines(&bus, &graph, root, &log);
    bus::no_bus(coupling.kind, root, &log);
    no_slow_start(coupling.kind, root, &log);
    safety::make_sense(&safety, coupling.kind, &nodes, (root, &log));
    quick_enough(&nodes, &time, root, &log);
    let links = bus::of_graph(&links, &graph, &bus, &time, &log);
    let components = nodes.first().map_or(1, |node: &NodeSpec| node.state.len());
    network::room(&graph, components, &network, &log);
    log.checkpoint()?;
    let setting = event::Setting {
        time: &time,
        graph: &graph,
        coupling: coupling.kind,
        bus: bus.model,
        clocks: !clocks.0.is_empty(),
        sync: clocks.1.is_some(),
        root,
        log: &log,
    };
    let events = event::make_sense(events, &expect, &setting, |named| match &faults {
        Some(faults) => faults::draw(faults, named, &expect, seed, &setting),
        None => Vec::new(),
    });
    clock::make_sense(&clocks, &bus, (coupling.kind, &events), (root, &log));
    log.checkpoint()?;
    let path = path.to_owned();
    let (clocks, sync) = clocks;
    let Defaults { kind: coupling, on_breach, floor, guard, u_max, .. } = coupling;
    let scenario = Scenario {
        title,
        seed,
        time,
        graph,
        coupling,
        floor,
        on_breach,
        guard,
        u_max,
        nodes,
        unit,
        bus,
        links,
        events,
        shortest_bounce_ns: faults.as_ref().and_then(|faults| faults.shortest_bounce_ns()),
        staged: Vec::new(),
        clocks,
        sync,
        safety,
        expect,
        path,
        as_run: String::new(),
        input_files: Vec::new(),
    };
    initial::check(&scenario, &places)?;
    let staged = staged::read(&scenario, root, files)?;
    Ok(Scenario { staged, ..scenario })
}

/// A node has computed before its next tick is due.
fn quick_enough(nodes: &[NodeSpec], time: &TimeSpec, root: &Item, log: &Log) {
    let step_ns = time.tick_ns / u64::from(time.round);
    if nodes.iter().all(|node| node.compute_ns < step_ns) {
        return;
    }
    let of_nodes = match root.get("node").map(|item| &item.value) {
        Some(tree::Value::Array(items)) => items.as_slice(),
        _ => &[],
    };
    let written = root.get("agent").into_iter().chain(of_nodes).filter_map(|item| item.get("compute"));
    for item in written.filter(|item| reader::duration_ns(item, true).is_ok_and(|ns| ns >= step_ns)) {
        let allowed = format!("must be shorter than the tick, {}", format_duration(step_ns));
        log.report(item.diagnostic(Problem::Value, allowed));
    }
}

fn default_title(path: &Path) -> String {
    path.file_stem()
        .map_or_else(|| "scenario".to_owned(), |stem| printable(&stem.to_string_lossy()).into_owned())
}

fn need_section<'a>(file: &mut Section<'a>, key: &'static str) -> Option<Section<'a>> {
    file.need(key, &format!("must be a section [{key}]"))?;
    file.section(key)
}

/// `[time]` before it is known to be whole.
struct Time<'a> {
    tick_ns: u64,
    /// Ticks in a round.
    round: u8,
    slow_start_ns: u64,
    slow_start: Option<&'a Item>,
    duration_ns: u64,
    duration: Option<&'a Item>,
    place: &'a Place,
}

impl Time<'_> {
    fn round_ns(&self) -> u64 {
        self.tick_ns.saturating_mul(self.round.into())
    }
}

fn read_time(mut section: Section<'_>) -> Time<'_> {
    let ticks = (u64::from(params::SHORTEST_TICK_NS), u64::from(u32::MAX));
    let tick_ns = section.duration_within("tick", ticks, "to suit a node");
    let time = Time {
        tick_ns,
        round: section.value("round", 1, |item| read_round(item, tick_ns)),
        slow_start_ns: section.duration("slow_start", Some(0)),
        slow_start: section.take("slow_start"),
        duration_ns: section.duration("duration", None),
        duration: section.take("duration"),
        place: section.place(),
    };
    section.finish();
    time
}

/// Ticks in a round, which is written as a duration.
fn read_round(item: &Item, tick_ns: u64) -> Result<u8, Box<Diagnostic>> {
    let round_ns = reader::duration_ns(item, false)?;
    let most = u64::from(params::LONGEST_ROUND);
    let ticks = (round_ns % tick_ns == 0).then_some(round_ns / tick_ns).filter(|ticks| *ticks <= most);
    ticks.and_then(|ticks| u8::try_from(ticks).ok()).ok_or_else(|| {
        let tick = format_duration(tick_ns);
        item.diagnostic(Problem::Value, format!("must be a whole number of ticks of {tick}, 1 to {most}"))
    })
}

fn whole_ticks(time: &Time<'_>, nodes: u64, log: &Log) -> TimeSpec {
    let tick_ns = time.round_ns();
    let name = if time.round == 1 { "ticks" } else { "rounds" };
    let (ticks, rest) = (time.duration_ns / tick_ns, time.duration_ns % tick_ns);
    let report = |allowed: String, hint: String| {
        let mut diagnostic = match time.duration {
            Some(item) => item.diagnostic(Problem::Value, allowed),
            None => time.place.diagnostic(Problem::Whole, "time.duration", allowed),
        };
        diagnostic.hint = Some(hint);
        log.report(diagnostic);
    };
    if rest != 0 {
        let allowed = format!("must be a whole number of {name} of {}", format_duration(tick_ns));
        let below = ticks.saturating_mul(tick_ns);
        let near = if rest * 2 < tick_ns && ticks > 0 { below } else { below.saturating_add(tick_ns) };
        report(allowed, format!("\"{}\" would do", format_duration(near)));
    } else if ticks.saturating_mul(nodes) > MAX_NODE_TICKS {
        let allowed =
            format!("{ticks} ticks of {nodes} nodes are more than 2^40 node-ticks, which would take days");
        report(allowed, "shorten it, or lengthen the tick".to_owned());
    } else if ticks > u64::from(u32::MAX) {
        let allowed = format!("{ticks} ticks are more than a node counts, which is 2^32 - 1");
        report(allowed, "shorten it, or lengthen the tick".to_owned());
    }
    let start = slow_start(time, ticks, log);
    TimeSpec { tick_ns, ticks: ticks.saturating_add(start.behind().into()), round: time.round, start }
}

/// The slow start of a run of so many `ticks` of network time.
fn slow_start(time: &Time<'_>, ticks: u64, log: &Log) -> SlowStart {
    let (tick_ns, most) = (time.round_ns(), u64::from(params::LONGEST_SLOW_START).min(ticks));
    let name = if time.round == 1 { "ticks" } else { "rounds" };
    let whole = time.slow_start_ns.is_multiple_of(tick_ns).then_some(time.slow_start_ns / tick_ns);
    let fits = whole.filter(|&ticks| ticks <= most).and_then(|ticks| u16::try_from(ticks).ok());
    if let (None, Some(item)) = (fits, time.slow_start) {
        let tick = format_duration(tick_ns);
        let allowed =
            format!("must be a whole number of {name} of {tick}, up to {most} and the end of the run");
        log.report(item.diagnostic(Problem::Value, allowed));
    }
    SlowStart::new(fits.unwrap_or(0))
}

/// A tracker has no funnel to be kept at its start, and weakly centralised coupling no nodes that start.
fn no_slow_start(coupling: Coupling<f64>, root: &Item, log: &Log) {
    let item = root.get("time").and_then(|section| section.get("slow_start"));
    if let (Some(item), Coupling::LambdaTracker { .. } | Coupling::WeaklyCentralised) = (item, coupling) {
        let allowed = format!("is not for {} coupling; leave it out", coupling.kind());
        log.report(item.diagnostic(Problem::Value, allowed));
    }
}

#[cfg(test)]
mod tests;
