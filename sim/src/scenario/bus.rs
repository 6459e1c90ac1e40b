//! `[bus]` and `[[link]]`: what carries the states, and what lies between it and one receiver of one sender.

use super::diagnostic::{Diagnostic, Problem};
use super::duration::format_duration;
use super::graph::Graph;
use super::model::TimeSpec;
use super::reader::{Log, Range, Section, integer, number, ready};
use super::tree::{Item, Value};
use crate::bus::uart::MOST_LINES;
use funnelnet_can_bus::{BitRate, Timing};
use funnelnet_law::Coupling;
use funnelnet_node::neighbour::{WINDOW_AHEAD, WINDOW_BACK};

/// Bit rate of CAN where none is said, and the fastest one of classic CAN and of the arbitration of CAN FD, bit/s.
pub(super) const DEFAULT_BITRATE: u32 = 1_000_000;
/// Slowest rate of CAN, bit/s.
pub(super) const SLOWEST_BITRATE: u32 = 10_000;
/// Rate of the data of CAN FD where none is said, as the boards have it, and the fastest one, bit/s.
pub(super) const DEFAULT_DATA_BITRATE: u32 = 2_000_000;
pub(super) const FASTEST_DATA_BITRATE: u32 = 8_000_000;
/// A second in nanoseconds.
const SECOND_NS: u32 = 1_000_000_000;
/// Where in a bit a controller reads its level, per mille of it: what CiA recommends, and what the boards have for the data of CAN FD.
pub(super) const SAMPLE_PER_MILLE: u32 = 875;
pub(super) const DATA_SAMPLE_PER_MILLE: u32 = 750;
/// Rates of a serial line, bit/s.
pub(super) const BAUDS: (u64, u64) = (1_200, 10_000_000);
/// Bytes that the driver of a serial line holds: as many as the boards' drivers do where none is said.
pub(super) const DEFAULT_RECEIVE_BUFFER: u32 = 512;
pub(super) const LARGEST_RECEIVE_BUFFER: u64 = 65_536;
/// Largest share of disturbed bits: no frame has a chance above it.
pub(super) const MOST_BIT_ERRORS: f64 = 0.1;

/// Where in a bit its level can be read.
pub(super) const SAMPLE_POINT: Range = Range::between(0.001, 0.999, "of a bit");

/// Model of the bus that carries the states.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum BusModel {
    /// No arbitration and no capacity; loss, latency and jitter only.
    #[default]
    Ideal,
    /// Classic CAN.
    Can,
    /// CAN FD.
    CanFd,
    /// Serial lines.
    Uart,
}

impl BusModel {
    /// Its name in a scenario.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Ideal => "ideal",
            Self::Can => "can",
            Self::CanFd => "can-fd",
            Self::Uart => "uart",
        }
    }

    /// Whether it is a CAN bus, of either format.
    #[must_use]
    pub fn is_can(self) -> bool {
        matches!(self, Self::Can | Self::CanFd)
    }
}

/// Wiring of the serial lines.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Wiring {
    /// One for each edge, from node to node.
    #[default]
    Lines,
    /// One for each node, to a hub that hands states on to neighbours.
    Hub,
}

/// How frames get lost: in runs, by the model of Gilbert (1960) and Elliott (1963). There is a good and a bad state, each with its own
/// probability of a loss, and after each frame the state may change.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Loss {
    /// Probability that a frame is lost in the good state, in which it begins.
    pub good: f64,
    /// Probability of a loss in the bad state.
    pub bad: f64,
    /// Probability that the bad state follows the good one.
    pub to_bad: f64,
    /// Probability that the good state follows the bad one.
    pub to_good: f64,
}

impl Default for Loss {
    fn default() -> Self {
        Self::NONE
    }
}

impl Loss {
    /// Nothing is lost.
    pub const NONE: Self = Self::independent(0.0);

    /// Each frame is lost by itself, with this probability (0 to 1).
    #[must_use]
    pub const fn independent(probability: f64) -> Self {
        Self { good: probability, bad: 1.0, to_bad: 0.0, to_good: 1.0 }
    }

    /// Whether nothing is lost.
    #[must_use]
    pub fn is_none(&self) -> bool {
        self.good == 0.0 && (self.to_bad == 0.0 || self.bad == 0.0)
    }

    /// Whether losses come in runs.
    #[must_use]
    pub fn is_in_bursts(&self) -> bool {
        self.to_bad > 0.0
    }

    /// Share of the frames that is lost in the long run.
    #[must_use]
    pub fn mean(&self) -> f64 {
        if !self.is_in_bursts() {
            return self.good;
        }
        let bad = self.to_bad / (self.to_bad + self.to_good);
        self.bad * bad + self.good * (1.0 - bad)
    }
}

/// The bus.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct BusSpec {
    /// Its kind.
    pub model: BusModel,
    /// Loss of frames, at each receiver by itself.
    pub loss: Loss,
    /// Delay of every frame in nanoseconds.
    pub latency_ns: u64,
    /// Width of the additional random delay in nanoseconds.
    pub jitter_ns: u64,
    /// Bit rate, bit/s; of the arbitration in CAN FD.
    pub bitrate: u32,
    /// Bit rate of the data of CAN FD, bit/s.
    pub data_bitrate: u32,
    /// Sample point of a bit on CAN, per mille of it.
    pub sample_per_mille: u32,
    /// Sample point in the data of CAN FD, per mille of a bit.
    pub data_sample_per_mille: u32,
    /// Disturbed bits among a billion, on CAN and on serial lines.
    pub bit_errors: u32,
    /// Wiring of the serial lines.
    pub wiring: Wiring,
    /// Bytes that the driver of a serial line holds for a node that computes.
    pub receive_buffer: u32,
}

impl Default for BusSpec {
    fn default() -> Self {
        Self {
            model: BusModel::Ideal,
            loss: Loss::NONE,
            latency_ns: 0,
            jitter_ns: 0,
            bitrate: DEFAULT_BITRATE,
            data_bitrate: DEFAULT_DATA_BITRATE,
            sample_per_mille: SAMPLE_PER_MILLE,
            data_sample_per_mille: DATA_SAMPLE_PER_MILLE,
            bit_errors: 0,
            wiring: Wiring::Lines,
            receive_buffer: DEFAULT_RECEIVE_BUFFER,
        }
    }
}

/// What a link does to the frames of one node on their way to another, after what the bus does.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct LinkSettings {
    /// Loss of frames.
    pub loss: Loss,
    /// Delay of each, ns.
    pub latency_ns: u64,
    /// Width of the additional random delay, ns.
    pub jitter_ns: u64,
    /// Probability that a frame comes after the next one.
    pub reorder: f64,
    /// Probability that a frame comes twice.
    pub duplicate: f64,
    /// Probability that the receiver reads a bit of a frame wrong.
    pub corrupt: f64,
}

/// A link in one direction.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LinkSpec {
    /// Index of the sender.
    pub from: usize,
    /// Index of the receiver.
    pub to: usize,
    /// Settings of the link.
    pub settings: LinkSettings,
}

/// A link with where it was written.
pub(super) struct Link<'a> {
    spec: LinkSpec,
    item: &'a Item,
}

pub(super) fn read(file: &mut Section<'_>) -> BusSpec {
    let mut bus = BusSpec::default();
    let models = [BusModel::Ideal, BusModel::Can, BusModel::CanFd, BusModel::Uart];
    let models = models.map(|model| ready(model.name(), model));
    let Some(mut section) = file.section("bus") else { return bus };
    let Some(model) = section.choice("model", &models, Some(BusModel::Ideal)) else { return bus };
    bus.model = model;
    match model {
        BusModel::Ideal => {
            bus.loss = read_loss(&mut section);
            bus.latency_ns = section.duration("latency", Some(0));
            bus.jitter_ns = section.duration("jitter", Some(0));
        }
        BusModel::Can | BusModel::CanFd => read_can(&mut section, &mut bus),
        BusModel::Uart => {
            bus.bitrate = section.integer("bitrate", Some(DEFAULT_BITRATE.into()), BAUDS, "bit/s") as u32;
            let wirings = [ready("lines", Wiring::Lines), ready("hub", Wiring::Hub)];
            bus.wiring = section.choice("wiring", &wirings, Some(Wiring::Lines)).unwrap_or_default();
            let bytes = (1, LARGEST_RECEIVE_BUFFER);
            bus.receive_buffer =
                section.integer("receive_buffer", Some(DEFAULT_RECEIVE_BUFFER.into()), bytes, "bytes") as u32;
            bus.bit_errors = read_bit_errors(&mut section);
            bus.loss = read_loss(&mut section);
        }
    }
    section.finish();
    bus
}

fn read_can(section: &mut Section<'_>, bus: &mut BusSpec) {
    let limits = (SLOWEST_BITRATE.into(), DEFAULT_BITRATE.into());
    bus.bitrate = section.integer("bitrate", Some(limits.1), limits, "bit/s") as u32;
    bus.sample_per_mille = section.value("sample_point", SAMPLE_PER_MILLE, read_sample_point);
    if bus.model == BusModel::CanFd {
        let limits = (SLOWEST_BITRATE.into(), FASTEST_DATA_BITRATE.into());
        bus.data_bitrate =
            section.integer("data_bitrate", Some(DEFAULT_DATA_BITRATE.into()), limits, "bit/s") as u32;
        bus.data_sample_per_mille =
            section.value("data_sample_point", DATA_SAMPLE_PER_MILLE, read_sample_point);
    }
    bus.bit_errors = read_bit_errors(section);
    bus.loss = read_loss(section);
}

/// Parts in a billion.
fn read_bit_errors(section: &mut Section<'_>) -> u32 {
    let share = section.number("bit_errors", Some(0.0), Range::between(0.0, MOST_BIT_ERRORS, "of the bits"));
    (share * 1e9).round() as u32
}

fn read_sample_point(item: &Item) -> Result<u32, Box<Diagnostic>> {
    let point = number(item, SAMPLE_POINT)?;
    let per_mille = (point * 1e3).round();
    if (point * 1e3 - per_mille).abs() > 1e-6 {
        return Err(item.diagnostic(Problem::Value, "must be a whole number of thousandths of a bit"));
    }
    Ok(per_mille as u32)
}

/// `loss`: a probability, or the four of [`Loss`].
pub(super) fn read_loss(section: &mut Section<'_>) -> Loss {
    let log = section.log();
    section.value("loss", Loss::NONE, |item| match item.value {
        Value::Table(_) => Ok(read_bursts(item, log).unwrap_or_default()),
        Value::Integer(_) | Value::Float(_) => number(item, Range::probability()).map(Loss::independent),
        _ => Err(Range::probability().mismatch(item, ", or { good, bad, to_bad, to_good }")),
    })
}

fn read_bursts(item: &Item, log: &Log) -> Option<Loss> {
    let mut section = Section::open(item, log)?;
    let loss = Loss {
        good: section.number("good", Some(0.0), Range::probability()),
        bad: section.number("bad", Some(1.0), Range::probability()),
        to_bad: section.number("to_bad", None, Range::positive_probability()),
        to_good: section.number("to_good", None, Range::positive_probability()),
    };
    section.finish();
    Some(loss)
}

/// Reads `[[link]]`, each by itself; `nodes` is the largest id.
pub(super) fn read_links<'a>(file: &mut Section<'a>, nodes: u64) -> Vec<Link<'a>> {
    let log = file.log();
    file.array("link").iter().flat_map(|item| read_link(item, nodes, log).into_iter().flatten()).collect()
}

/// One link in each direction that it has.
fn read_link<'a>(item: &'a Item, nodes: u64, log: &'a Log) -> Option<Vec<Link<'a>>> {
    let mut section = Section::open(item, log)?;
    let directions = read_directions(&mut section, nodes);
    let settings = LinkSettings {
        loss: read_loss(&mut section),
        latency_ns: section.duration("latency", Some(0)),
        jitter_ns: section.duration("jitter", Some(0)),
        reorder: section.number("reorder", Some(0.0), Range::probability()),
        duplicate: section.number("duplicate", Some(0.0), Range::probability()),
        corrupt: section.number("corrupt", Some(0.0), Range::probability()),
    };
    section.finish();
    if settings == LinkSettings::default() {
        let keys = ["loss", "latency", "jitter", "reorder", "duplicate", "corrupt"];
        if keys.iter().all(|key| item.get(key).is_none()) {
            let allowed = "must do something: loss, latency, jitter, reorder, duplicate or corrupt";
            log.report(item.diagnostic(Problem::Value, allowed));
        }
    }
    let link = |(from, to)| Link { spec: LinkSpec { from, to, settings }, item };
    Some(directions?.into_iter().map(link).collect())
}

/// `between`, both directions; or `from` and `to`, one.
fn read_directions(section: &mut Section<'_>, nodes: u64) -> Option<Vec<(usize, usize)>> {
    let log = section.log();
    let id = |item: &Item| {
        let id = integer(item, (1, nodes), "the id of a node of the graph");
        id.map(|id| id as usize - 1).map_err(|diagnostic| log.report(diagnostic)).ok()
    };
    let [between, from, to] = ["between", "from", "to"].map(|key| section.take(key));
    match (between, from, to) {
        (None, Some(from), Some(to)) => Some(vec![(id(from)?, id(to)?)]),
        (Some(between), None, None) => match &between.value {
            Value::Array(ids) if ids.len() == 2 => {
                let (a, b) = (id(ids.first()?)?, id(ids.get(1)?)?);
                Some(vec![(a, b), (b, a)])
            }
            _ => {
                log.report(
                    between.diagnostic(Problem::Value, "must be the ids of two neighbours, as [1, 2]"),
                );
                None
            }
        },
        (Some(_), Some(other), _) | (Some(_), _, Some(other)) => {
            let allowed = "must not be there beside between: a link has both directions, or from and to";
            log.report(other.diagnostic(Problem::Value, allowed));
            None
        }
        (None, None, None) => {
            section.missing("between", "must be the ids of two neighbours, as [1, 2]; or from and to");
            None
        }
        (None, from, _) => {
            let missing = if from.is_some() { "to" } else { "from" };
            section.missing(missing, &format!("must be the id of a node, 1 to {nodes}"));
            None
        }
    }
}

/// Links are edges, each direction is there once, and no frame is so late that it would pass for a new one. What is wrong is reported.
pub(super) fn of_graph(
    links: &[Link<'_>],
    graph: &Graph,
    bus: &BusSpec,
    time: &TimeSpec,
    log: &Log,
) -> Vec<LinkSpec> {
    let name = |from: usize, to: usize| format!("{} to {}", from + 1, to + 1);
    // What is wrong with the graph was reported: it has no edges then.
    let links = if graph.edges.is_empty() && graph.nodes > 1 { &[] } else { links };
    for (at, &Link { spec, item }) in links.iter().enumerate() {
        let LinkSpec { from, to, settings } = spec;
        if !graph.neighbours(from).iter().any(|&(other, _)| other == to) {
            let near: Vec<_> =
                graph.neighbours(from).iter().map(|(other, _)| (other + 1).to_string()).collect();
            let allowed =
                format!("must be an edge of the graph; node {} has edges to {}", from + 1, near.join(", "));
            let key = ["between", "to"].into_iter().find_map(|key| item.get(key));
            log.report(key.unwrap_or(item).diagnostic(Problem::Value, allowed));
        }
        let twice = links.iter().take(at).any(|other| (other.spec.from, other.spec.to) == (from, to));
        if twice {
            let allowed = format!(
                "must be the only one with this direction: an earlier [[link]] is from {}",
                name(from, to)
            );
            log.report(item.diagnostic(Problem::Value, allowed));
        }
        let delay = bus.latency_ns.saturating_add(bus.jitter_ns);
        let delay = delay.saturating_add(settings.latency_ns).saturating_add(settings.jitter_ns);
        if let Some(key) = item.get("latency").or_else(|| item.get("jitter")).filter(|_| delay > latest(time))
        {
            log.report(key.diagnostic(Problem::Value, too_late(time)));
        }
    }
    links.iter().map(|link| link.spec).collect()
}

/// The longest delay of a frame. It carries eight bits of its tick: one that is late by nearly 256 ticks would pass for a new one.
fn latest(time: &TimeSpec) -> u64 {
    time.tick_ns.saturating_mul(256 - u64::from(WINDOW_BACK + WINDOW_AHEAD))
}

fn too_late(time: &TimeSpec) -> String {
    let (most, tick) = (format_duration(latest(time)), format_duration(time.tick_ns));
    format!(
        "latency and jitter must not exceed {most} with a tick of {tick}: later frames would pass for new ones"
    )
}

/// Reports a bus that delays its frames for too long.
pub(super) fn fresh(bus: &BusSpec, time: &TimeSpec, root: &Item, log: &Log) {
    let section = root.get("bus");
    let key = section.and_then(|section| section.get("latency").or_else(|| section.get("jitter")));
    let delay = bus.latency_ns.saturating_add(bus.jitter_ns);
    if let Some(key) = key.filter(|_| delay > latest(time)) {
        log.report(key.diagnostic(Problem::Value, too_late(time)));
    }
}

/// The bits of the bus have whole nanoseconds, and so have their sample points.
pub(super) fn whole_bits(bus: &BusSpec, root: &Item, log: &Log) {
    let is_can = bus.model.is_can();
    let Some(section) = root.get("bus").filter(|_| is_can) else { return };
    let mut phases = vec![("bitrate", "sample_point", bus.bitrate, bus.sample_per_mille)];
    if bus.model == BusModel::CanFd {
        let data = ("data_bitrate", "data_sample_point", bus.data_bitrate, bus.data_sample_per_mille);
        phases.push(data);
    }
    for (rate_key, point_key, rate, point) in phases {
        let fits = |rate: &u32| BitRate::new(*rate, point).is_ok();
        let key = section.get(rate_key).or_else(|| section.get(point_key));
        let Some(key) = key.filter(|_| rate > 0 && !fits(&rate)) else { continue };
        let whole = (1..=SECOND_NS / SLOWEST_BITRATE)
            .filter(|ns| SECOND_NS.is_multiple_of(*ns))
            .map(|ns| SECOND_NS / ns);
        let in_range = whole.filter(|rate| (SLOWEST_BITRATE..=FASTEST_DATA_BITRATE).contains(rate));
        let nearest = in_range.filter(fits).min_by_key(|near| near.abs_diff(rate)).unwrap_or(DEFAULT_BITRATE);
        let allowed = format!(
            "a bit and its first {} % must have whole nanoseconds; the nearest rate that does is {nearest}",
            f64::from(point) / 10.0
        );
        log.report(key.diagnostic(Problem::Value, allowed));
    }
    let slower = bus.model == BusModel::CanFd && bus.data_bitrate < bus.bitrate;
    if let Some(key) = section.get("data_bitrate").or_else(|| section.get("bitrate")).filter(|_| slower) {
        let allowed = format!(
            "the data of CAN FD must not be slower than its arbitration: {} and {} bit/s",
            bus.data_bitrate, bus.bitrate
        );
        log.report(key.diagnostic(Problem::Value, allowed));
    }
}

impl BusSpec {
    /// Bit rates of CAN; `None` on another bus. The reader has refused what has none.
    #[must_use]
    pub fn timing(&self) -> Option<Timing> {
        let nominal = || BitRate::new(self.bitrate, self.sample_per_mille).ok();
        match self.model {
            BusModel::Can => nominal().map(Timing::classic),
            BusModel::CanFd => {
                let data = BitRate::new(self.data_bitrate, self.data_sample_per_mille).ok()?;
                Timing::fd(nominal()?, data).ok()
            }
            BusModel::Ideal | BusModel::Uart => None,
        }
    }
}

/// Reports a node with more neighbours than it has lines.
pub(super) fn enough_lines(bus: &BusSpec, graph: &Graph, root: &Item, log: &Log) {
    if bus.model != BusModel::Uart || bus.wiring == Wiring::Hub {
        return;
    }
    let crowded = (0..graph.nodes).map(|node| (node, graph.neighbours(node).len()));
    let crowded = crowded.into_iter().find(|&(_, lines)| lines > MOST_LINES);
    let key = root.get("bus").and_then(|section| section.get("wiring").or_else(|| section.get("model")));
    if let (Some((node, lines)), Some(key)) = (crowded, key) {
        let allowed = format!(
            "node {} has {lines} neighbours, and a node has {MOST_LINES} lines to neighbours at most; wiring = \"hub\" takes any number",
            node + 1
        );
        log.report(key.diagnostic(Problem::Value, allowed));
    }
}

/// Weakly-centralised coupling is simulated without a bus and without nodes, so that nothing of them can be asked for.
pub(super) fn no_bus(coupling: Coupling<f64>, root: &Item, log: &Log) {
    if coupling != Coupling::WeaklyCentralised {
        return;
    }
    let allowed = "must not be there with weakly-centralised coupling, which is simulated without a bus";
    if let Some(Value::Table(table)) = root.get("bus").map(|section| &section.value) {
        table
            .iter()
            .filter(|(key, _)| *key != "model")
            .for_each(|(_, item)| log.report(item.diagnostic(Problem::Value, allowed)));
    }
    if let Some(Value::Array(links)) = root.get("link").map(|section| &section.value) {
        links.iter().take(1).for_each(|item| log.report(item.diagnostic(Problem::Value, allowed)));
    }
    if let Some(item) = root.get("coupling").and_then(|section| section.get("u_max")) {
        let allowed = "must not be there with weakly-centralised coupling, which no node runs";
        log.report(item.diagnostic(Problem::Value, allowed));
    }
}
