//! What the user asks of a run.

use super::error::RunError;
use crate::bench::BenchFile;
use crate::bus::SIMULATED;
use crate::emulator::EmulatorOptions;
use crate::interrupt::Interrupt;
use crate::record::BusLogs;
use crate::scenario::{Scenario, TimeSpec, format_duration};
use std::fmt;
use std::path::PathBuf;

/// What runs the scenario.
#[derive(Clone, Copy, Debug, PartialEq, Eq, clap::ValueEnum)]
pub enum Fidelity {
    /// The f32 node, every byte through the protocol and the simulated bus.
    Loopback,
    /// The continuous-time system in f64 by a stiff solver.
    Reference,
    /// The firmware image, one QEMU per node.
    Emulator,
    /// The nodes of a bench file, behind serial ports.
    #[value(skip)]
    Bench,
}

impl fmt::Display for Fidelity {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Loopback => "loopback",
            Self::Reference => "reference",
            Self::Emulator => "emulator",
            Self::Bench => "bench",
        })
    }
}

/// How much is said on the terminal.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Verbosity {
    /// Errors only.
    Quiet,
    /// The result.
    Normal,
    /// And how it came about.
    Verbose,
}

/// The options of `sim-host run` and `sim-host bench`.
#[derive(Clone, Debug)]
pub struct RunOptions {
    /// What runs the scenario.
    pub on: Fidelity,
    /// Folder for trajectory, summary and plots; made where it is missing.
    pub out: Option<PathBuf>,
    /// Ticks between two rows of the trajectory, those between two rounds included; `None` means every tick,
    /// thinned to 2,000 rows.
    pub every_ticks: Option<u64>,
    /// File for the summary as JSON; `-` is standard output, here and below.
    pub json: Option<PathBuf>,
    /// File for the expectations as JUnit XML.
    pub junit: Option<PathBuf>,
    /// Firmware image for emulated nodes.
    pub image: PathBuf,
    /// The nodes of [`Fidelity::Bench`].
    pub bench: Option<BenchFile>,
    /// Logs of CAN in the folder.
    pub bus_logs: BusLogs,
    /// Whether rows and events go into `run.mcap`, too; without an `out` there is none.
    pub mcap: bool,
    /// How much is said on the terminal.
    pub verbosity: Verbosity,
    /// Set when the user wants to stop.
    pub interrupt: Interrupt,
    /// The command that repeats the run.
    pub repeat: String,
}

/// Rows of a trajectory that is not asked for more closely.
const DEFAULT_ROWS: u64 = 2000;

impl RunOptions {
    /// Where emulated nodes come from.
    pub fn emulator(&self) -> EmulatorOptions {
        EmulatorOptions {
            image: self.image.clone(),
            qemu: "qemu-system-arm".to_owned(),
            interrupt: self.interrupt.clone(),
        }
    }

    /// Names of the CAN interfaces of a run of `scenario`, in the order in which its buses are numbered.
    pub fn interfaces(&self, scenario: &Scenario) -> Vec<String> {
        match (self.on, &self.bench) {
            (Fidelity::Bench, Some(bench)) => {
                let ids: Vec<u8> =
                    scenario.nodes.iter().filter_map(|node| u8::try_from(node.id).ok()).collect();
                bench.interfaces(&ids).into_iter().cloned().collect()
            }
            (Fidelity::Loopback, _) if scenario.bus.model.is_can() => vec![SIMULATED.to_owned()],
            _ => Vec::new(),
        }
    }

    /// Ticks between two rows of the trajectory, those between two rounds included.
    pub fn stride(&self, time: &TimeSpec) -> u64 {
        self.every_ticks.unwrap_or_else(|| time.steps().div_ceil(DEFAULT_ROWS)).max(1)
    }
}

/// Ticks between two rows that are `every_ns` apart, those between two rounds included.
///
/// # Errors
/// Not whole ticks, or longer than the run.
pub fn every_ticks(every_ns: u64, time: &TimeSpec) -> Result<u64, RunError> {
    // Not rounds: there are rows between two of them.
    let tick = time.tick_ns / u64::from(time.round);
    let duration = time.end_ns();
    if every_ns == 0 || !every_ns.is_multiple_of(tick) || every_ns > duration {
        let [every, tick, duration] = [every_ns, tick, duration].map(format_duration);
        return Err(RunError::bad_input(format!(
            "--every {every}: must be whole ticks of {tick}, from one to the whole run of {duration}"
        )));
    }
    Ok(every_ns / tick)
}
