//! Running a scenario (placeholder: the engine takes this file over).

use std::fmt;
use std::path::PathBuf;

use crate::exit::Exit;
use crate::scenario::Scenario;

/// What runs the scenario.
#[derive(Clone, Copy, Debug, PartialEq, Eq, clap::ValueEnum)]
pub enum Fidelity {
    /// The f32 node, every byte through the protocol and the simulated bus.
    Loopback,
    /// The continuous-time system in f64 by a stiff solver.
    Reference,
    /// The firmware image, one QEMU per node.
    Emulator,
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

/// The options of `sim-host run`.
#[derive(Clone, Debug)]
pub struct RunOptions {
    /// What runs the scenario.
    pub on: Fidelity,
    /// Folder for trajectory, summary and plots; made where it is missing.
    pub out: Option<PathBuf>,
    /// Ticks between two rows of the trajectory; `None` means every tick, thinned to 2,000 rows.
    pub every_ticks: Option<u64>,
    /// File for the summary as JSON.
    pub json: Option<PathBuf>,
    /// File for the expectations as JUnit XML.
    pub junit: Option<PathBuf>,
    /// How much is said on the terminal.
    pub verbosity: Verbosity,
}

/// One expectation and what came of it.
#[derive(Clone, Debug, PartialEq)]
pub struct Verdict {
    /// The key in `[expect]`.
    pub name: &'static str,
    /// What the value must stay below.
    pub limit: f64,
    /// What was measured.
    pub value: f64,
    /// Whether it holds.
    pub pass: bool,
}

/// What a run gives. `Display` is the text for people.
#[derive(Clone, Debug, PartialEq)]
pub struct Summary {
    /// The expectations in the order of the contract.
    pub expect: Vec<Verdict>,
}

impl fmt::Display for Summary {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{} expectations", self.expect.len())
    }
}

/// Why a run did not come to an end.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct RunError {
    /// What happened, and what would mend it.
    pub message: String,
    /// How the program ends for it.
    pub exit: Exit,
}

impl fmt::Display for RunError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&self.message)
    }
}

impl std::error::Error for RunError {}

/// Runs a scenario.
///
/// # Errors
/// Always, until the engine is built.
pub fn execute(_scenario: &Scenario, _options: &RunOptions) -> Result<Summary, RunError> {
    Err(RunError { message: "run is not built yet".to_owned(), exit: Exit::Defect })
}
