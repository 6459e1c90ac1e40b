//! The files of a run, but for the JUnit file. All are opened before the run, so that a folder that cannot be
//! written costs no time.

use super::claim::commit;
use super::error::RunError;
use super::event_log::{MoreEvents, NAMED};
use super::names;
use super::options::{Fidelity, RunOptions};
use super::outcome::Outcome;
use super::rows::Rows;
use crate::engine::NodeEvent;
use crate::exit::Exit;
use crate::number::Precision;
use crate::plot::{MarkKind, PlotError, Trace, agreement_svg, funnels_svg, inputs_svg, states_svg};
use crate::record::{AtomicFile, BusFiles, OnBus, RecordError, Row, Shape, Summary, TrajectoryWriter};
use crate::scenario::{Absence, Course, EventKind, EventSpec, Scenario, TimeSpec};
use std::fmt::Write as _;
use std::path::{Path, PathBuf};

/// Files that wait for their content.
pub struct Outputs {
    folder: Option<FolderFiles>,
    json: Option<AtomicFile>,
}

/// What `--out` asks for. Rows go into the trajectory and into the pictures as they come.
struct FolderFiles {
    path: PathBuf,
    trajectory: TrajectoryWriter,
    buses: BusFiles,
    trace: Trace,
    events: AtomicFile,
    scenario: AtomicFile,
    states: AtomicFile,
    funnels: AtomicFile,
    inputs: AtomicFile,
    agreement: AtomicFile,
    summary: AtomicFile,
}

impl Outputs {
    /// Opens the files; the folder is there.
    ///
    /// # Errors
    /// The first file that cannot be written, by name.
    pub fn open(scenario: &Scenario, options: &RunOptions) -> Result<Self, RunError> {
        if options.bus_logs.capture && options.interfaces(scenario).is_empty() {
            return Err(RunError::bad_input(
                "--pcapng: there is no CAN bus in this run; set bus.model to \"can\", or run it on a bench on CAN",
            ));
        }
        let folder =
            options.out.as_ref().map(|path| FolderFiles::open(path, scenario, options)).transpose()?;
        let json = options.json.as_ref().map(AtomicFile::create).transpose()?;
        Ok(Self { folder, json })
    }

    /// Writes everything, and gives the files their names once all of them are whole.
    ///
    /// # Errors
    /// The first file that cannot be written, by name.
    pub fn write(self, scenario: &Scenario, outcome: &Outcome, summary: &Summary) -> Result<(), RunError> {
        let summary = summary.to_json();
        if let Some(folder) = self.folder {
            folder.write(scenario, outcome, &summary)?;
        }
        Ok(self.json.map_or(Ok(()), |file| commit(file, &summary))?)
    }
}

impl FolderFiles {
    fn open(path: &Path, scenario: &Scenario, options: &RunOptions) -> Result<Self, RecordError> {
        let precision = match options.on {
            Fidelity::Reference => Precision::Double,
            Fidelity::Loopback | Fidelity::Emulator | Fidelity::Bench => Precision::Single,
        };
        let shape = Shape { nodes: scenario.nodes.len(), components: scenario.components() };
        let file = |name: &str| AtomicFile::create(path.join(name));
        Ok(Self {
            path: path.to_owned(),
            trajectory: TrajectoryWriter::create(path.join("trajectory.csv"), shape, precision)?,
            buses: BusFiles::create(path, options.bus_logs, options.interfaces(scenario))?,
            trace: Trace::new(&scenario.title)
                .with_components(shape.components)
                .with_unit(scenario.unit.as_deref())
                .with_bound(scenario.sync_bound(1.0)),
            events: file("events.txt")?,
            scenario: file(names::SCENARIO)?,
            states: file("states.svg")?,
            funnels: file("funnels.svg")?,
            inputs: file("inputs.svg")?,
            agreement: file("agreement.svg")?,
            summary: file(names::SUMMARY)?,
        })
    }

    fn write(self, scenario: &Scenario, outcome: &Outcome, summary: &str) -> Result<(), RunError> {
        let Self { path, mut trajectory, mut trace, buses, .. } = self;
        let (told, as_run, last) = (self.events, self.scenario, self.summary);
        trajectory.settle()?;
        let mut settled = vec![settle(told, &told_of(scenario, outcome))?, settle(as_run, &scenario.as_run)?];
        for input in &scenario.input_files {
            settled.push(settle(AtomicFile::create(path.join(&input.name))?, &input.text)?);
        }
        for mut file in buses.into_files() {
            file.settle()?;
            settled.push(file);
        }
        // A run that ended early may have too few rows for a picture.
        if outcome.ended_early.is_none() || trace.has_span() {
            mark(&mut trace, scenario, outcome);
            settled.push(settle(self.states, &plot(states_svg(&trace))?)?);
            settled.push(settle(self.funnels, &plot(funnels_svg(&trace))?)?);
            settled.push(settle(self.inputs, &plot(inputs_svg(&trace))?)?);
            settled.push(settle(self.agreement, &plot(agreement_svg(&trace))?)?);
        }
        for (id, log) in &outcome.logs {
            settled.push(settle(AtomicFile::create(path.join(format!("node-{id}.log")))?, log)?);
        }
        // The summary says what the others are, so that it comes last.
        settled.push(settle(last, summary)?);
        trajectory.finish()?;
        Ok(settled.into_iter().try_for_each(AtomicFile::commit)?)
    }
}

impl Rows for Outputs {
    fn take(&mut self, row: Row) -> Result<(), RunError> {
        let Some(folder) = &mut self.folder else { return Ok(()) };
        folder.trajectory.write(&row)?;
        folder.trace.push(&row);
        Ok(())
    }

    fn hear(&mut self, heard: &[OnBus]) -> Result<(), RunError> {
        Ok(self.folder.as_mut().map_or(Ok(()), |folder| folder.buses.write(heard))?)
    }
}

/// A whole file that has not got its name yet.
fn settle(mut file: AtomicFile, text: &str) -> Result<AtomicFile, RecordError> {
    file.write(|out| out.write_all(text.as_bytes()))?;
    file.settle()?;
    Ok(file)
}

/// The curves of a run whose rows were kept, with stops, absences and cut links.
#[must_use]
pub fn trace(scenario: &Scenario, outcome: &Outcome) -> Trace {
    let title = scenario.title.as_str();
    let mut trace =
        Trace::new(title).with_components(scenario.components()).with_unit(scenario.unit.as_deref());
    outcome.rows.iter().for_each(|row| trace.push(row));
    mark(&mut trace, scenario, outcome);
    trace
}

/// Adds to the rows of a picture what is known only at the end.
fn mark(trace: &mut Trace, scenario: &Scenario, outcome: &Outcome) {
    trace.judged(&outcome.findings.worst);
    let known = |spread: Option<f64>| spread.unwrap_or(f64::NAN);
    trace.spread(known(outcome.findings.max_spread), known(outcome.findings.final_spread));
    for stop in outcome.stops(scenario) {
        trace.mark(usize::from(stop.id), stop.at_s, None, MarkKind::Stopped);
    }
    mark_events(scenario, &outcome.happened, trace);
    for absence in outcome.bench.iter().flat_map(|bench| &bench.absences) {
        let at_s = |tick: u32| scenario.time.at_s(tick.into());
        let to = absence.to_tick.map(at_s);
        trace.mark(usize::from(absence.node), at_s(absence.from_tick), to, MarkKind::Away);
    }
}

/// Marks what events have done.
fn mark_events(scenario: &Scenario, events: &[EventSpec], trace: &mut Trace) {
    let course = Course::of(events, &scenario.graph);
    for Absence { node, from_tick, to_tick } in course.absences(&scenario.time) {
        let at_s = |tick: u64| scenario.time.at_s(tick);
        trace.mark(node + 1, at_s(from_tick), to_tick.map(at_s), MarkKind::Away);
    }
    for (event, disturbance) in events.iter().zip(course.disturbances(events)) {
        let kind = match event.kind {
            EventKind::Partition => MarkKind::Cut,
            kind if !kind.is_of_presence() && event.lasts_ns > 0 => MarkKind::Event(kind.name()),
            _ => continue,
        };
        let at_s = |ns: u64| ns as f64 / 1e9;
        trace.mark(0, at_s(disturbance.from_ns), disturbance.end_ns.map(at_s), kind);
    }
}

/// A plot that cannot be drawn from whole rows is a defect of the program.
fn plot(svg: Result<String, PlotError>) -> Result<String, RunError> {
    svg.map_err(|error| RunError { message: error.to_string(), exit: Exit::Defect })
}

/// What happened, what nodes reported and when they were away, in the order of time.
fn told_of(scenario: &Scenario, outcome: &Outcome) -> String {
    let time = &scenario.time;
    let line = |event: &NodeEvent| (time_of(event, time), events([event], time));
    // Before what nodes say at the same time: the cause comes first.
    let happened = outcome.happened.iter();
    let mut lines: Vec<_> =
        happened.map(|event| (event.at_ns, format!("{} s, event {event}\n", seconds(event.at_ns)))).collect();
    lines.extend(outcome.events.iter().map(line));
    lines.extend(outcome.more_events.iter().map(|more| (time_of(&more.last, time), counted(more, time))));
    for absence in outcome.bench.iter().flat_map(|bench| &bench.absences) {
        let mut tell = |tick: u32, what: String| {
            let at = time.at_ns(tick.into());
            lines.push((at, format!("{} s, node {} {what}\n", seconds(at), absence.node)));
        };
        tell(absence.from_tick, format!("is away from tick {} on: {}", absence.from_tick, absence.why));
        if let Some(to) = absence.to_tick {
            tell(to, format!("is back at tick {to}"));
        }
    }
    // Stable: what happened at the same time stays in the order in which it was told.
    lines.sort_by_key(|&(at, _)| at);
    let is_short = outcome.more_events.is_empty();
    let heading = if is_short { String::new() } else { format!("# {}\n", shortened()) };
    heading + &lines.into_iter().map(|(_, line)| line).collect::<String>()
}

/// How a list of events is shortened, for its reader.
fn shortened() -> String {
    format!("of each node the first {NAMED} events of a kind, and of more their number and the last one")
}

/// The last of the events that were only counted, as a line.
pub(super) fn counted(more: &MoreEvents, time: &TimeSpec) -> String {
    let line = events([&more.last], time);
    format!("{} (the last of {} more of this kind)\n", line.trim_end(), more.count)
}

/// What nodes reported, a line each: time, node, event. The time is that of the trajectory, which begins with
/// tick 0: one tick after the start, when the announced states have arrived.
pub(super) fn events<'a>(events: impl IntoIterator<Item = &'a NodeEvent>, time: &TimeSpec) -> String {
    let mut text = String::new();
    for event in events {
        // Writing to a string does not fail.
        let t = seconds(time_of(event, time));
        let _ = writeln!(text, "{t} s, node {} {}", event.node + 1, event.event);
    }
    text
}

/// The time of an event of a node, ns.
fn time_of(event: &NodeEvent, time: &TimeSpec) -> u64 {
    time.from_clock(event.at.saturating_sub(time.tick_ns))
}

/// Nanoseconds as seconds, to the last digit, with six decimals or more.
fn seconds(ns: u64) -> String {
    let exact = format!("{}.{:09}", ns / 1_000_000_000, ns % 1_000_000_000);
    let zeros = exact.len() - exact.trim_end_matches('0').len();
    exact[..exact.len() - zeros.min(3)].to_owned()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::judge::AbsenceSummary;
    use crate::record::BenchSummary;
    use funnelnet_node::Event;

    #[test]
    fn events_have_the_time_of_the_trajectory_and_read_as_sentences() {
        let event = |at, event| NodeEvent { at, node: 2, event };
        let list = [event(0, Event::Started), event(41_000_000, Event::BreachEnded { tick: 40 })];
        let expected =
            "0.000000 s, node 3 started\n0.040000 s, node 3 is inside its funnel again at tick 40\n";
        assert_eq!(events(&list, &TimeSpec::plain(1_000_000, 100)), expected);
    }

    #[test]
    fn absences_stand_among_the_events_in_the_order_of_time() {
        let text = "version = 1\ntime = { tick = '1ms', duration = '1s' }\ngraph = { kind = 'path', nodes = 3 }\nagent = { dynamics = { kind = 'affine' } }\n\
                    coupling = { kind = 'none', funnel = { kind = 'constant', width = 1.0 } }";
        let scenario = Scenario::parse(text, Path::new("a.toml"), &[]).unwrap();
        let absence =
            |from_tick, to_tick| AbsenceSummary { node: 3, from_tick, to_tick, why: "it is silent".into() };
        let bench = BenchSummary {
            absences: vec![absence(10, Some(40)), absence(60, None)],
            ..BenchSummary::default()
        };
        let event = |at, event| NodeEvent { at, node: 0, event };
        let outcome = Outcome {
            events: vec![event(0, Event::Started), event(31_000_000, Event::SyncGap { missed: 2 })],
            bench: Some(bench),
            ..Outcome::default()
        };
        let expected = "0.000000 s, node 1 started\n0.010000 s, node 3 is away from tick 10 on: it is silent\n\
                        0.030000 s, node 1 skips 2 ticks that SYNC has skipped\n0.040000 s, node 3 is back at tick 40\n\
                        0.060000 s, node 3 is away from tick 60 on: it is silent\n";
        assert_eq!(told_of(&scenario, &outcome), expected);
    }

    #[test]
    fn times_of_events_are_exact() {
        for (ns, text) in [
            (0, "0.000000"),
            (1, "0.000000001"),
            (1_500, "0.0000015"),
            (300_000_000, "0.300000"),
            (86_400_000_000_001_000, "86400000.000001"),
            (u64::MAX, "18446744073.709551615"),
        ] {
            assert_eq!(seconds(ns), text);
        }
    }
}
