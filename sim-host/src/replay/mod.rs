//! `sim-host replay`: gives one node's real code what the others said in a log, and compares what it sends
//! with what the log says it sent (docs/book/src/can-logs.md).

mod difference;
mod gaps;
mod own_clock;
#[cfg(test)]
mod own_clock_tests;
#[cfg_attr(not(target_os = "linux"), path = "absent.rs")]
mod reader;
mod survey;
mod twin;

pub use difference::Difference;

use crate::can::AnyFormat;
use crate::exit::Exit;
use crate::run::RunError;
use crate::scenario::{BusModel, Scenario};
use difference::{field, hex};
use funnelnet_can_bus::{Id, Record};
use funnelnet_link::Frame as _;
use funnelnet_protocol::can::function;
use funnelnet_protocol::message::Message;
use funnelnet_protocol::refusal::Refusal;
use gaps::Gaps;
use own_clock::OwnClock;
use reader::LogReader;
use serde::Serialize;
use std::fmt;
use std::path::Path;
use survey::{Drive, Survey};
use twin::{Sent, Twin, tick_of};

/// Something that a log holds.
#[derive(Clone, Debug)]
struct Entry {
    /// Its line, from 1 on.
    line: usize,
    interface: String,
    record: Record,
}

impl Entry {
    /// Identifier and bytes of a data frame that can be one of the real-time plane.
    fn real_time(&self) -> Option<(u16, &[u8])> {
        match (self.record.frame()?.0.id(), self.record.fd) {
            (Id::Base(id), _) if !self.record.is_remote() => Some((id, self.record.bytes())),
            _ => None,
        }
    }
}

/// What a frame says, message by message, or the reason for refusing it.
fn says(format: &mut AnyFormat, id: u16, bytes: &[u8]) -> Vec<Result<Message, Refusal>> {
    format.unpack(id, bytes)
}

/// What a replay has found.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Replayed {
    /// The node.
    pub node: u8,
    /// The interface that it is on.
    pub interface: String,
    /// Frames of it in the log that are those that it sends, bit for bit.
    pub frames: u64,
    /// Frames of it that a full bus had no room for, or that a node which came late had nobody to tell: the
    /// next one took their place.
    pub unsent: u64,
    /// The last tick of which the log has a state of it.
    pub last_tick: Option<u32>,
    /// Ticks of the scenario.
    pub ticks: u64,
    /// Line in which the log was cut off.
    pub cut: Option<usize>,
    /// The first difference.
    pub difference: Option<Difference>,
    /// Whether all is as in the log, and that goes to the scenario's last tick.
    pub equal: bool,
}

impl Replayed {
    /// How the program ends for it.
    #[must_use]
    pub fn exit(&self) -> Exit {
        if self.equal { Exit::Success } else { Exit::ExpectationFailed }
    }
}

impl fmt::Display for Replayed {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let last = self.last_tick.map_or("no tick".to_owned(), |tick| format!("tick {tick}"));
        write!(f, "node {} on {}: ", self.node, self.interface)?;
        match &self.difference {
            Some(difference) => {
                write!(f, "{difference}; {} frames before it are equal, bit for bit", self.frames)?;
                if self.frames < 8 {
                    write!(f, "\nis the log of this scenario, its seed and its settings?")?;
                }
            }
            None => write!(f, "{} frames as in the log, bit for bit, to {last}", self.frames)?,
        }
        if self.unsent > 0 {
            write!(f, "; {} more were never sent: a newer one took their place", self.unsent)?;
        }
        if let Some(line) = self.cut {
            write!(f, "\nthe log is cut off in line {line}")?;
        }
        if self.difference.is_none() && !self.equal {
            write!(
                f,
                "\nthe log ends before the scenario, which has {} ticks: to compare a part, set time.duration",
                self.ticks
            )?;
        }
        Ok(())
    }
}

/// Replays the log at `path` into node `id` of `scenario`.
///
/// # Errors
/// The log cannot be read, or is none of this scenario and node.
pub fn replay(path: &Path, scenario: &Scenario, id: u8) -> Result<Replayed, RunError> {
    let nodes = scenario.nodes.len();
    if !(1..=nodes).contains(&usize::from(id)) {
        return Err(RunError::bad_input(format!("--node {id}: the scenario has nodes 1 to {nodes}")));
    }
    if !scenario.events.is_empty() {
        return Err(RunError::bad_input(
            "a log does not say when [[event]] switched nodes off and on, so that it cannot be replayed",
        ));
    }
    let survey = survey::survey(path, scenario, id)?;
    let model = if survey.fd { BusModel::CanFd } else { BusModel::Can };
    if survey.drive == Drive::Simulated && scenario.bus.model != model {
        return Err(RunError::bad_input(format!(
            "{}: there is no START in it, so that it is of a simulated bus, with bus.model = \"{}\", and the scenario has \"{}\"; add --set bus.model={}, with the bit rates of the run",
            path.display(),
            model.name(),
            scenario.bus.model.name(),
            model.name()
        )));
    }
    let mut replay = Replay::new(scenario, id, &survey)?;
    let mut log = LogReader::open(path)?;
    while let Some(entry) = log.next()? {
        if entry.interface == survey.interface {
            replay.take(&entry);
        }
        if replay.found.difference.is_some() {
            break;
        }
    }
    Ok(replay.finish(log.cut()))
}

/// A replay on its way.
struct Replay {
    twin: Twin,
    drive: Drive,
    id: u8,
    fd: bool,
    /// Time of the node at t = 0 of the log, ns, and how much earlier than the log says receivers have a
    /// frame.
    zero_ns: u64,
    earlier_ns: u64,
    /// Of a simulated bus.
    gaps: Option<Gaps>,
    /// Time of the first record of a real bus, ns.
    origin: Option<u64>,
    /// The node, where its ticks are its own.
    own_clock: Option<OwnClock>,
    line: usize,
    found: Replayed,
}

impl Replay {
    fn new(scenario: &Scenario, id: u8, survey: &Survey) -> Result<Self, RunError> {
        let simulated = survey.drive == Drive::Simulated;
        // The log of a real bus says nothing of its bit rates, and does not need them.
        let timing = scenario.bus.timing().filter(|_| simulated);
        if simulated && timing.is_none() {
            return Err(RunError::bad_input(
                "the log is of a simulated bus, and bus.model in the scenario is no CAN",
            ));
        }
        let mut twin = Twin::new(scenario, id, survey)?;
        if simulated {
            twin.start();
        }
        let own_clock = (survey.drive == Drive::OwnClock).then(|| OwnClock::new(twin.clone()));
        Ok(Self {
            twin,
            drive: survey.drive,
            id,
            fd: survey.fd,
            zero_ns: if simulated { scenario.time.tick_ns } else { 0 },
            earlier_ns: timing.map_or(0, |timing| timing.nominal().bit_ns()),
            gaps: timing.map(Gaps::new),
            origin: None,
            own_clock,
            line: 0,
            found: Replayed {
                node: id,
                interface: survey.interface.clone(),
                frames: 0,
                unsent: 0,
                last_tick: None,
                ticks: scenario.time.ticks,
                cut: None,
                difference: None,
                equal: false,
            },
        })
    }

    fn take(&mut self, entry: &Entry) {
        self.line = entry.line;
        if let Some(gaps) = &mut self.gaps {
            gaps.take(&entry.record);
        }
        if entry.record.is_error() {
            return;
        }
        let now = self.now(entry.record.at);
        if self.drive == Drive::Simulated {
            // At equal times nodes tick before frames come.
            self.twin.run(now);
        }
        match entry.real_time().filter(|&(id, _)| id >> 7 > 0 && (id & 0x7F) as u8 == self.id) {
            Some((id, bytes)) if self.own_clock.is_some() => self.compare_own_clock(entry, id, bytes),
            Some((id, bytes)) => self.compare(entry, id, bytes),
            None => match &mut self.own_clock {
                Some(own_clock) => own_clock.hear(entry),
                None => self.twin.hear(entry, now),
            },
        }
    }

    /// Time of the node at which it has a frame with this time in the log, ns.
    fn now(&mut self, at: u64) -> u64 {
        match self.drive {
            Drive::Simulated => (at + self.zero_ns).saturating_sub(self.earlier_ns),
            Drive::Host | Drive::OwnClock => at.saturating_sub(*self.origin.get_or_insert(at)),
        }
    }

    fn compare(&mut self, entry: &Entry, id: u16, bytes: &[u8]) {
        let line = entry.line;
        let tick = tick_of(id, bytes, self.fd, self.twin.tick());
        let waiting = self.twin.sent.entry(id).or_default();
        // Those before it were never sent, if the bus was full for as long as they waited.
        let at = match function_of(id) {
            function::STATE..=function::STATE_FD => waiting.iter().position(|sent| sent.tick == tick),
            _ => waiting.iter().position(|sent| sent.frame.data() == bytes),
        };
        let before: Vec<Sent> = waiting.drain(..at.unwrap_or(0)).collect();
        let next = waiting.pop_front();
        let Some(sent) = next else {
            let log = format!("{id:03X} {}", hex(bytes));
            self.differ(tick, "frame", log, "sends no such frame by then".to_owned(), line);
            return;
        };
        let until = before.iter().skip(1).map(|sent| sent.at).chain([sent.at]);
        let missing = before.iter().zip(until).find(|(sent, until)| self.had_room(sent.at, *until));
        if let Some((missing, _)) = missing {
            let node = format!("sends {id:03X} {}", hex(missing.frame.data()));
            self.differ(missing.tick, "frame", "nothing".to_owned(), node, line);
            return;
        }
        self.found.unsent += before.len() as u64;
        if sent.frame.data() != bytes {
            let (name, log, node) = field(id, bytes, sent.frame.data(), self.fd);
            self.differ(sent.tick, &name, log, format!("sends {node}"), line);
            return;
        }
        self.found.frames += 1;
        if let function::STATE..=function::STATE_FD = function_of(id) {
            self.found.last_tick = Some(sent.tick);
        }
    }

    /// As [`Self::compare`], in a log that does not say what the node had heard.
    fn compare_own_clock(&mut self, entry: &Entry, id: u16, bytes: &[u8]) {
        let Some(own_clock) = &mut self.own_clock else { return };
        match own_clock.take(id, bytes, self.fd) {
            Ok((tick, replaced)) => {
                self.found.frames += 1;
                if let function::STATE..=function::STATE_FD = function_of(id) {
                    self.found.last_tick = Some(tick);
                    self.found.unsent += u64::from(replaced);
                }
            }
            Err(twin) => {
                self.twin = *twin;
                self.compare(entry, id, bytes);
            }
        }
    }

    /// Whether a frame that waited in this time would have been sent.
    fn had_room(&self, from: u64, until: u64) -> bool {
        let zero = self.zero_ns;
        self.gaps
            .as_ref()
            .is_none_or(|gaps| gaps.was_free(from.saturating_sub(zero), until.saturating_sub(zero)))
    }

    fn differ(&mut self, tick: u32, field: &str, log: String, node: String, line: usize) {
        self.found.difference = Some(Difference { tick, field: field.to_owned(), log, node, line });
    }

    fn finish(mut self, cut: Option<usize>) -> Replayed {
        let (found, ticks) = (&self.found, self.found.ticks);
        // The last state is sent as the run ends, so that a simulated bus does not carry it any more.
        let end = (ticks + 1).saturating_mul(self.zero_ns);
        let is_state =
            |(id, _): &(&u16, _)| (function::STATE..=function::STATE_FD).contains(&function_of(**id));
        let states = self.twin.sent.iter().filter(is_state);
        let excused = states.flat_map(|(_, waiting)| {
            let until = waiting.iter().skip(1).map(|sent| sent.at).chain([end]);
            waiting.iter().zip(until).filter(|(sent, _)| u64::from(sent.tick) <= ticks)
        });
        let excused = !excused.into_iter().any(|(sent, until)| self.had_room(sent.at, until));
        let last = found.last_tick.is_some_and(|last| u64::from(last) >= ticks);
        let whole = last || (excused && self.gaps.is_some() && u64::from(self.twin.tick()) >= ticks);
        self.found.cut = cut;
        self.found.equal = whole && self.found.difference.is_none();
        self.found
    }
}

/// The function code of an identifier.
fn function_of(id: u16) -> u8 {
    (id >> 7) as u8 & 0xF
}
