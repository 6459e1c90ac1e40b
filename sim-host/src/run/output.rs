//! The files of a run. All are opened before the run, so that a folder that cannot be written costs no time.

use super::error::RunError;
use super::options::{Fidelity, RunOptions};
use super::outcome::Outcome;
use crate::engine::NodeEvent;
use crate::exit::Exit;
use crate::record::{
    AtomicFile, Precision, RecordError, Shape, Summary, TrajectoryWriter, junit, write_atomic,
};
use crate::report::{MarkKind, PlotError, Trace, funnels_svg, states_svg};
use crate::scenario::Scenario;
use std::fmt::Write as _;
use std::path::{Path, PathBuf};

/// Files that wait for their content.
pub struct Outputs {
    trajectory: Option<TrajectoryWriter>,
    json: Vec<AtomicFile>,
    junit: Option<AtomicFile>,
}

impl Outputs {
    /// Makes the folder and opens the files.
    ///
    /// # Errors
    /// The first file that cannot be written, by name.
    pub fn open(scenario: &Scenario, options: &RunOptions) -> Result<Self, RunError> {
        let mut outputs = Self { trajectory: None, json: Vec::new(), junit: None };
        if let Some(folder) = &options.out {
            make_folder(folder)?;
            let precision = match options.on {
                Fidelity::Reference => Precision::Double,
                Fidelity::Loopback | Fidelity::Emulator | Fidelity::Bench => Precision::Single,
            };
            let shape = Shape { nodes: scenario.nodes.len(), components: scenario.components() };
            let path = folder.join("trajectory.csv");
            outputs.trajectory = Some(TrajectoryWriter::create(path, shape, precision)?);
            outputs.json.push(AtomicFile::create(folder.join("summary.json"))?);
        }
        if let Some(path) = &options.json {
            outputs.json.push(AtomicFile::create(path)?);
        }
        outputs.junit = options.junit.as_ref().map(AtomicFile::create).transpose()?;
        Ok(outputs)
    }

    /// Writes everything and gives the files their names.
    ///
    /// # Errors
    /// The first file that cannot be written, by name.
    pub fn write(
        self,
        scenario: &Scenario,
        outcome: &Outcome,
        summary: &Summary,
        options: &RunOptions,
    ) -> Result<(), RunError> {
        if let Some(mut trajectory) = self.trajectory {
            outcome.rows.iter().try_for_each(|row| trajectory.write(row))?;
            trajectory.finish()?;
        }
        if let Some(folder) = &options.out {
            write_folder(folder, scenario, outcome)?;
        }
        for file in self.json {
            commit(file, &summary.to_json())?;
        }
        if let Some(file) = self.junit {
            commit(file, &junit(summary, &options.repeat))?;
        }
        Ok(())
    }
}

fn make_folder(folder: &Path) -> Result<(), RecordError> {
    std::fs::create_dir_all(folder).map_err(|reason| RecordError { path: PathBuf::from(folder), reason })
}

fn commit(mut file: AtomicFile, text: &str) -> Result<(), RecordError> {
    file.write(|out| out.write_all(text.as_bytes()))?;
    file.commit()
}

fn write_folder(folder: &Path, scenario: &Scenario, outcome: &Outcome) -> Result<(), RunError> {
    write_atomic(folder.join("events.txt"), events(&outcome.events, scenario.time.tick_ns).as_bytes())?;
    for (id, log) in &outcome.logs {
        write_atomic(folder.join(format!("node-{id}.log")), log.as_bytes())?;
    }
    write_plots(folder, scenario, outcome)
}

fn write_plots(folder: &Path, scenario: &Scenario, outcome: &Outcome) -> Result<(), RunError> {
    let title = scenario.title.as_str();
    let mut trace =
        Trace::new(title).with_components(scenario.components()).with_unit(scenario.unit.as_deref());
    outcome.rows.iter().for_each(|row| trace.push(row));
    trace.judged(&outcome.findings.worst);
    for stop in outcome.stops(scenario) {
        trace.mark(usize::from(stop.id), stop.at_s, None, MarkKind::Stopped);
    }
    for absence in outcome.bench.iter().flat_map(|bench| &bench.absences) {
        let at_s = |tick: u32| scenario.time.at_s(tick.into());
        let to = absence.to_tick.map(at_s);
        trace.mark(usize::from(absence.node), at_s(absence.from_tick), to, MarkKind::Away);
    }
    write_atomic(folder.join("states.svg"), plot(states_svg(&trace))?.as_bytes())?;
    write_atomic(folder.join("funnels.svg"), plot(funnels_svg(&trace))?.as_bytes())?;
    Ok(())
}

/// A plot that cannot be drawn from whole rows is a defect of the program.
fn plot(svg: Result<String, PlotError>) -> Result<String, RunError> {
    svg.map_err(|error| RunError { message: error.to_string(), exit: Exit::Defect })
}

/// What nodes reported, a line each: time, node, event. The time is that of the trajectory, which begins with tick 0: one
/// tick after the start, when the announced states have arrived.
pub(super) fn events<'a>(events: impl IntoIterator<Item = &'a NodeEvent>, tick_ns: u64) -> String {
    let mut text = String::new();
    for NodeEvent { at, node, event } in events {
        // Writing to a string does not fail.
        let t = at.saturating_sub(tick_ns) as f64 * 1e-9;
        let _ = writeln!(text, "{t:.6} s, node {} {event}", node + 1);
    }
    text
}

#[cfg(test)]
mod tests {
    use super::*;
    use funnel_core::Event;

    #[test]
    fn events_have_the_time_of_the_trajectory_and_read_as_sentences() {
        let event = |at, event| NodeEvent { at, node: 2, event };
        let list = [event(0, Event::Started), event(41_000_000, Event::BreachEnded { tick: 40 })];
        let expected =
            "0.000000 s, node 3 started\n0.040000 s, node 3 is inside its funnel again at tick 40\n";
        assert_eq!(events(&list, 1_000_000), expected);
    }
}
