//! The files of a run, but for the JUnit file. All are opened before the run, so that a folder that cannot be
//! written costs no time.

use super::claim::commit;
use super::error::RunError;
use super::names;
use super::options::{Fidelity, RunOptions};
use super::outcome::Outcome;
use super::rows::Rows;
use super::told::{self, Told};
use crate::exit::Exit;
use crate::number::Precision;
use crate::plot::{MarkKind, PlotError, Trace, agreement_svg, funnels_svg, inputs_svg, states_svg};
use crate::record::{
    AtomicFile, BusFiles, OnBus, RecordError, Recording, Row, Shape, Summary, TrajectoryWriter,
};
use crate::scenario::{Absence, Course, EventKind, EventSpec, Scenario};
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
    recording: Option<Recording>,
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
            recording: options
                .mcap
                .then(|| Recording::create(path, shape, precision, scenario.unit.as_deref()))
                .transpose()?,
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
        let happened = told::of(scenario, outcome);
        let heading = told::heading(outcome);
        let mut settled =
            vec![settle(told, &(heading + &told::lines(&happened)))?, settle(as_run, &scenario.as_run)?];
        if let Some(recording) = self.recording {
            settled.push(whole(recording, &happened, &scenario.as_run)?);
        }
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
        folder.recording.as_mut().map_or(Ok(()), |recording| recording.write(&row))?;
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

/// A recording with what happened, which has not got its name yet.
fn whole(mut recording: Recording, happened: &[Told], as_run: &str) -> Result<AtomicFile, RecordError> {
    for Told { at, gravity, who, what } in happened {
        recording.tell(*at, *gravity, who, what)?;
    }
    let mut file = recording.into_file(as_run)?;
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
            EventKind::Set => MarkKind::Event(event.kind.name()),
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
