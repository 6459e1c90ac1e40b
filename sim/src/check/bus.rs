//! The bus against the tick: loss and delay, and what CAN takes for the states.

use serde_json::json;

use super::subject::Subject;
use super::{Finding, Status, figure, share};
use crate::bus::SIMULATED;
use crate::bus::table::{BusTable, IdentifierRow, LatencyRow, node_of};
use crate::scenario::{BusModel, LARGEST_RUN, Scenario, format_duration};
use funnelnet_can_bus::Id;
use funnelnet_can_bus::length::INTERMISSION;
use funnelnet_can_bus::response::{self, Stream};
use funnelnet_node::neighbour::WINDOW_BACK;
use funnelnet_node::params::LONGEST_ROUND;
use funnelnet_protocol::can::function;

/// Loss up to which `c` may stay as it is (law.md 4).
const HARMLESS_LOSS: f64 = 0.1;
/// `c` for a loss up to 20 %, and beyond.
const DAMPED: [(f64, f64); 2] = [(0.2, 3.0), (1.0, 4.0)];

/// Rounds that are long enough for every frame (law.md 5), as the setting where the run is a whole number of
/// them.
fn decide_less_often(found: Finding, status: Status, why: &str, subject: &Subject<'_>) -> Finding {
    let (bus, time) = (&subject.scenario.bus, subject.scenario.time);
    let step_ns = time.tick_ns / u64::from(time.round);
    let steps = time.ticks.saturating_mul(time.round.into());
    let needed = bus.latency_ns.saturating_add(bus.jitter_ns) / step_ns + 1;
    let whole = (needed..=u64::from(LONGEST_ROUND)).find(|round| steps.is_multiple_of(*round));
    match whole {
        Some(round) => {
            let round = format_duration(round.saturating_mul(step_ns));
            found
                .advise(
                    status,
                    format!("{why}; decide once in a round of {round}, by which every frame has come"),
                )
                .set("time.round", round)
        }
        None => {
            let tick = format_duration(needed.saturating_mul(step_ns));
            found.advise(status, format!("{why}; use a tick of {tick}, by which every frame has come"))
        }
    }
}

/// `c` that bounds what steep gains make of the loss.
fn needed_damping(subject: &Subject<'_>) -> f64 {
    let loss = subject.scenario.bus.loss.mean();
    DAMPED.into_iter().find(|(up_to, _)| loss <= *up_to).map_or(4.0, |(_, damping)| damping)
}

fn is_damped(subject: &Subject<'_>) -> bool {
    let needed = needed_damping(subject);
    subject.scenario.nodes.iter().all(|node| node.damping >= needed)
}

/// More damping, which bounds what steep gains make of a lossy bus.
fn damp(found: Finding, subject: &Subject<'_>) -> Finding {
    if is_damped(subject) {
        let advice = format!(
            "a narrow funnel is left now and then, whatever the damping; it is less so with a loss of {}",
            share(HARMLESS_LOSS)
        );
        // Nothing to be set: how much is lost is no matter of a designer's.
        return found.advise(Status::Warn, advice);
    }
    let damping = needed_damping(subject);
    let advice = format!(
        "a narrow funnel is left now and then, and steep gains run away; a damping of {damping} bounds them"
    );
    found.advise(Status::Warn, advice).set("coupling.damping", format!("{damping}"))
}

/// Data bytes of a plain frame of one component, or of an announced edge (protocol/README.md).
pub(super) const BYTES: u32 = 5;

/// What a CAN bus has to carry, by the response times of fixed priorities: all nodes say their states at the
/// begin of a tick, each in a frame for each component, and each may announce an edge beside them.
struct OnCan {
    table: BusTable,
    /// Share of a tick that the states take, without stuff bits and with as many as there can be.
    load: (f64, f64),
    /// Time from the tick to the end of the latest state, ns; none where it comes ever later.
    latest: Option<u64>,
    /// Longest frame, and the intermission in it, ns.
    frame_ns: u64,
    intermission_ns: u64,
}

fn on_can(scenario: &Scenario) -> Option<OnCan> {
    let bus = &scenario.bus;
    if bus.model != BusModel::Can {
        return None;
    }
    let timing = bus.timing()?;
    let tick_ns = scenario.time.tick_ns;
    let components = u8::try_from(scenario.components()).ok()?;
    let nodes = scenario.nodes.len();
    // More have no ids.
    if nodes > LARGEST_RUN {
        return None;
    }
    let states = nodes * usize::from(components);
    let bit = timing.nominal().bit_ns();
    let [frame_ns, shortest] = [response::longest_classic, response::shortest_classic]
        .map(|bits| u64::from(bits(Id::Base(0), BYTES)) * bit);
    let stream = Stream { time: frame_ns, period: tick_ns };
    // An edge is announced now and then: none of them comes in every tick, but one may be on its way.
    let rare = Stream { time: frame_ns, period: u64::MAX };
    let streams: Vec<Stream> = std::iter::repeat_n(stream, states).chain([rare]).collect();
    let worst: Vec<Option<u64>> = response::longest(&streams, timing).into_iter().take(states).collect();
    let intermission_ns = u64::from(INTERMISSION) * bit;
    // To the last bit, as the table of a run has it.
    let seconds = |ns: u64| (ns - intermission_ns) as f64 / 1e9;
    let row = |(at, worst): (usize, &Option<u64>)| {
        let (component, node) = (at / nodes, at % nodes + 1);
        let id = Id::Base(((usize::from(function::STATE) + component) << 7 | node) as u16);
        IdentifierRow {
            id: id.to_string(),
            node: node_of(id),
            frames: scenario.time.ticks,
            latency_s: worst.map(|ns| LatencyRow { max: seconds(ns), ..LatencyRow::default() }),
            ..IdentifierRow::default()
        }
    };
    let rows = worst.iter().enumerate().map(row);
    let load = |time: u64| states as f64 * time as f64 / tick_ns as f64;
    let load = (load(shortest), load(frame_ns));
    let table = BusTable {
        interface: format!("{SIMULATED}, computed, at most"),
        bitrate: Some(bus.bitrate),
        utilisation: Some(load.1.min(1.0)),
        latency_from: Some("tick"),
        identifiers: rows.collect(),
        ..BusTable::default()
    };
    let latest = worst.iter().copied().max_by_key(|worst| worst.unwrap_or(u64::MAX)).flatten();
    Some(OnCan { table, load, latest, frame_ns, intermission_ns })
}

/// The table of a CAN bus, as a run has it.
pub(super) fn table(scenario: &Scenario) -> Option<BusTable> {
    on_can(scenario).map(|on_can| on_can.table)
}

/// Whether states may come a tick late on CAN, since the bus is busy.
pub(super) fn is_late(scenario: &Scenario) -> bool {
    on_can(scenario).is_some_and(|can| can.latest.is_none_or(|latest| latest > scenario.time.tick_ns))
}

/// Time of the longest frame of a state on classic CAN at the bit rate of the arbitration, ns.
pub(super) fn frame_ns(scenario: &Scenario) -> u64 {
    let bits = u64::from(response::longest_classic(Id::Base(0), BYTES) - INTERMISSION);
    scenario.bus.timing().map_or(0, |timing| bits * timing.nominal().bit_ns())
}

fn can(subject: &Subject<'_>) -> Option<Finding> {
    let OnCan { table, load, latest, frame_ns, intermission_ns } = on_can(subject.scenario)?;
    let (bus, tick_ns) = (&subject.scenario.bus, subject.scenario.time.tick_ns);
    let to_last_bit = latest.map(|ns| ns - intermission_ns);
    let values = json!({
        "bit_errors": f64::from(bus.bit_errors) * 1e-9,
        "utilisation_low": load.0,
        "utilisation_high": load.1,
        "tick_s": subject.scenario.time.tick_s(),
        "worst_latency_s": to_last_bit.map(|ns| ns as f64 / 1e9),
        "table": table,
    });
    let (tick, rate) = (format_duration(tick_ns), bus.bitrate);
    let latency = match to_last_bit {
        Some(ns) => format!("the least urgent state has come after {} at the latest", format_duration(ns)),
        None => "the least urgent state comes later and later".to_owned(),
    };
    let text = format!(
        "states take {} to {} of a tick of {tick} on CAN at {rate} bit/s, by their stuff bits; {latency}",
        share(load.0),
        share(load.1)
    );
    Some(judge_can(Finding::new("bus", "Bus", text, values), subject, (load.0, latest), frame_ns))
}

/// How a CAN bus stands with a load of `low` or more and the latest state after `latest` (ns).
fn judge_can(
    found: Finding,
    subject: &Subject<'_>,
    (low, latest): (f64, Option<u64>),
    frame_ns: u64,
) -> Finding {
    let (bus, tick_ns) = (&subject.scenario.bus, subject.scenario.time.tick_ns);
    let states = subject.scenario.nodes.len() * subject.scenario.components();
    // All of them, and an announced edge before them.
    let needed = (states as u64 + 1) * frame_ns;
    if low > 1.0 {
        let why =
            "the bus cannot carry a state of every node in a tick: the least urgent nodes are not heard";
        return more_time(found, Status::Fail, why, subject, needed);
    }
    if latest.is_none_or(|latest| latest > tick_ns) {
        let why =
            "states may come a tick late, which is not followed: all that is predicted is of the ideal bus";
        return more_time(found, Status::Warn, why, subject, needed);
    }
    let loss = bus.loss.mean();
    if loss > HARMLESS_LOSS && !(subject.keeps() && is_damped(subject)) {
        let text = format!("{}; {} of the frames lost per receiver", found.text, share(loss));
        return damp(Finding { text, ..found }, subject);
    }
    if bus.bit_errors > 0 {
        // A frame that is disturbed in its last bit, its error frame, and the frame again.
        let error = frame_ns + u64::from(ERROR_BITS) * (1_000_000_000 / u64::from(bus.bitrate));
        let spare = (tick_ns - latest.unwrap_or(tick_ns)) / error;
        let advice = format!(
            "what {} of its bits in error do is not followed; a tick has room for {spare} errors before a state comes late",
            figure(f64::from(bus.bit_errors) * 1e-9)
        );
        return found.advise(if spare > 0 { Status::Note } else { Status::Warn }, advice);
    }
    // Every state is there before it is asked for: nothing else than on the ideal bus happens.
    found
}

/// Bits of an error frame at most, and of the intermission after it.
const ERROR_BITS: u32 = 23;

/// A tick that is long enough for so much on the bus (ns), or a faster bus.
fn more_time(found: Finding, status: Status, why: &str, subject: &Subject<'_>, needed: u64) -> Finding {
    let (bus, tick_ns) = (&subject.scenario.bus, subject.scenario.time.tick_ns);
    let fits = |rate: &&u32| needed.saturating_mul(bus.bitrate.into()) / u64::from(**rate) <= tick_ns;
    match RATES.iter().filter(|rate| **rate > bus.bitrate).find(fits) {
        Some(rate) => {
            found.advise(status, format!("{why}; {rate} bit/s would do")).set("bus.bitrate", rate.to_string())
        }
        None => {
            let us = needed.div_ceil(1000);
            let tick = format_duration(us.saturating_mul(1000));
            found.advise(status, format!("{why}; a tick of {tick} or more would do, or fewer nodes on a bus"))
        }
    }
}

/// The usual bit rates, bit/s.
const RATES: [u32; 4] = [125_000, 250_000, 500_000, 1_000_000];

/// What links do is not followed: the law is, with the bus alone.
fn of_links(subject: &Subject<'_>) -> Finding {
    let count = subject.scenario.links.len();
    let text = format!(
        "what {count} [[link]] directions do to frames is not followed: all that is predicted is without them"
    );
    Finding::new("bus", "Bus", text, json!({ "links": count })).stands(Status::NotChecked)
}

/// A bus with bits that is not computed: what is followed is the ideal one.
fn real(bit_errors: f64) -> Finding {
    let errors = match bit_errors {
        0.0 => String::new(),
        share => format!(", nor what {share} of its bits in error do"),
    };
    let text = format!(
        "the time that frames take on it is not followed{errors}: all that is predicted is of the ideal bus"
    );
    Finding::new("bus", "Bus", text, json!({ "bit_errors": bit_errors })).stands(Status::NotChecked)
}

const NOBODY: &str = "every frame is lost: nobody ever hears anybody";

/// What there is to say about the bus; nothing where it loses and delays nothing.
pub(super) fn findings(subject: &Subject<'_>) -> Option<Finding> {
    let (bus, tick_ns) = (&subject.scenario.bus, subject.scenario.time.tick_ns);
    let delay = bus.latency_ns.saturating_add(bus.jitter_ns);
    let loss = bus.loss.mean();
    if loss >= 1.0 && bus.model != BusModel::Ideal {
        let found = Finding::new(
            "bus",
            "Bus",
            "all of the frames lost per receiver".to_owned(),
            json!({ "loss": loss }),
        );
        return Some(found.advise(Status::Fail, NOBODY.to_owned()));
    }
    if bus.model != BusModel::Ideal && !subject.scenario.links.is_empty() {
        return Some(of_links(subject));
    }
    if let Some(found) = can(subject) {
        return Some(found);
    }
    if bus.model != BusModel::Ideal {
        return Some(real(f64::from(bus.bit_errors) * 1e-9));
    }
    if bus.loss.is_none() && delay == 0 {
        return (!subject.scenario.links.is_empty()).then(|| of_links(subject));
    }
    let text = format!(
        "{} of the frames lost per receiver, delay from {} to {}",
        share(loss),
        format_duration(bus.latency_ns),
        format_duration(delay)
    );
    let (latency, jitter) = (bus.latency_ns as f64 * 1e-9, bus.jitter_ns as f64 * 1e-9);
    let values = json!({ "loss": loss, "latency_s": latency, "jitter_s": jitter });
    let found = Finding::new("bus", "Bus", text, values);
    // What arrives with the next tick is taken after it.
    let ticks_late = |delay: u64| delay / tick_ns;
    if loss >= 1.0 {
        return Some(found.advise(Status::Fail, NOBODY.to_owned()));
    }
    if ticks_late(bus.latency_ns) > u64::from(WINDOW_BACK) {
        let why =
            format!("a frame is heard for {WINDOW_BACK} ticks at most, so that nobody ever hears anybody");
        return Some(decide_less_often(found, Status::Fail, &why, subject));
    }
    if delay >= tick_ns && !subject.keeps() {
        let why = "frames come a tick or more late, which a narrow funnel does not survive";
        return Some(decide_less_often(found, Status::Warn, why, subject));
    }
    if loss > HARMLESS_LOSS && !(subject.keeps() && is_damped(subject)) {
        return Some(damp(found, subject));
    }
    if delay >= tick_ns {
        let advice = "frames come a tick or more late; the law, followed with that over the whole run, stays inside its funnels";
        return Some(found.advise(Status::Note, advice.to_owned()));
    }
    Some(found.stands(Status::Note))
}
