//! Runs a scenario without a bus: a summary, quantiles over time, and columns of the nodes that are asked for.

use super::claim::{self, Claim};
use super::error::RunError;
use super::names;
use super::options::RunOptions;
use super::rows::Nobody;
use crate::interrupt::Interrupt;
use crate::judge::{Check, CounterSummary};
use crate::number::{Precision, shortest};
use crate::number_format::significant;
use crate::plot::quantiles_svg;
use crate::progress::Progress;
use crate::record::{
    AtomicFile, BelievedSummary, BusLogs, Expectation, FunnelSummary, RecordError, Summary, SyncSummary,
    junit,
};
use crate::run::Verbosity;
use crate::scenario::{FloorSpec, LargeScenario};
use funnelnet_sim::large::{Findings, LEFT_OUT, Network, QUANTILES, Row};
use std::io::{self, Write};
use std::path::Path;
use std::time::Instant;

/// Rows of a run that is not asked for more closely: each sorts all nodes.
const DEFAULT_ROWS: u64 = 200;

/// What is asked of such a run beside the options of every run.
#[derive(Clone, Debug, Default)]
pub struct LargeOptions {
    /// Ids of nodes that get columns, ascending.
    pub nodes: Vec<usize>,
    /// Threads; none for one per core.
    pub threads: Option<usize>,
}

/// Takes what is seen of such a run while it goes on.
pub trait LargeRows {
    /// The run has come to the time `t` (s).
    fn reached(&mut self, _t: f64) {}

    /// A tick that has a row: one of so many, and the last one that was run.
    ///
    /// # Errors
    /// It cannot be kept, which ends the run.
    fn row(&mut self, network: &Network<'_>, k: u64) -> Result<(), RunError>;
}

/// Runs `scenario` and gives the summary with the judged expectations; writes nothing. Every so many ticks has a row, if none is said some
/// 200 of them.
///
/// # Errors
/// See [`RunError`], and those of `rows`.
pub fn simulate_large(
    scenario: &LargeScenario,
    large: &LargeOptions,
    every_ticks: Option<u64>,
    interrupt: &Interrupt,
    rows: &mut dyn LargeRows,
) -> Result<Summary, RunError> {
    let begin = Instant::now();
    let watched: Vec<usize> = large.nodes.iter().map(|id| id - 1).collect();
    let threads = large.threads.or_else(|| std::thread::available_parallelism().ok().map(Into::into));
    let mut network =
        Network::watching(scenario, threads.unwrap_or(1), &watched).map_err(RunError::bad_input)?;
    let stride = every_ticks.unwrap_or_else(|| scenario.time.ticks.div_ceil(DEFAULT_ROWS)).max(1);
    let mut interrupted = None;
    // The last tick that was run, where its row is not written.
    let mut unwritten = None;
    while let Some(k) = network.step() {
        unwritten = Some(k).filter(|_| k % stride != 0 && k != scenario.time.ticks);
        if unwritten.is_none() {
            rows.row(&network, k)?;
        }
        rows.reached(scenario.time.at_s(k));
        if interrupt.is_set() && k < scenario.time.ticks {
            interrupted = Some(format!("after {} of {} ticks: interrupted", k + 1, scenario.time.ticks + 1));
            break;
        }
    }
    if let Some(k) = unwritten {
        rows.row(&network, k)?;
    }
    let mut summary = judge(scenario, &network.findings(), interrupted);
    summary.trace_hash = Some(network.hash().to_string());
    summary.version = env!("CARGO_PKG_VERSION");
    summary.wall_s = begin.elapsed().as_secs_f64();
    Ok(summary)
}

/// Refuses ids that there are not.
///
/// # Errors
/// The first of them, under the name that the user has for them.
pub fn known_nodes(scenario: &LargeScenario, nodes: &[usize], name: &str) -> Result<(), RunError> {
    match nodes.iter().find(|&&id| id == 0 || id > scenario.nodes()) {
        Some(id) => Err(RunError::bad_input(format!("{name} {id}: ids are 1 to {} here", scenario.nodes()))),
        None => Ok(()),
    }
}

/// Runs `scenario`, writes what `options` ask for, and gives the summary with the judged expectations.
///
/// # Errors
/// See [`RunError`]; outputs appear whole or not at all.
pub fn execute_large_in(
    claim: &mut Claim,
    scenario: &LargeScenario,
    options: &RunOptions,
    large: &LargeOptions,
) -> Result<Summary, RunError> {
    execute_large_with(claim, scenario, options, large, &mut Nobody)
}

/// The same for who takes the rows as well.
///
/// # Errors
/// See [`RunError`], and those of `also`; outputs appear whole or not at all.
pub fn execute_large_with(
    claim: &mut Claim,
    scenario: &LargeScenario,
    options: &RunOptions,
    large: &LargeOptions,
    also: &mut dyn LargeRows,
) -> Result<Summary, RunError> {
    refuse(options)?;
    known_nodes(scenario, &large.nodes, "--nodes")?;
    let outputs = options.out.as_deref().map(|out| Outputs::open(out, &large.nodes)).transpose()?;
    let json = options.json.as_ref().map(AtomicFile::create).transpose()?;
    let progress = Progress::new("none", scenario.time.end_s(), options.verbosity == Verbosity::Quiet);
    let mut written = Written { scenario, outputs, progress, also };
    let done = simulate_large(scenario, large, options.every_ticks, &options.interrupt, &mut written);
    let Written { outputs, progress, .. } = written;
    drop(progress);
    let mut summary = done?;
    summary.command = claim.command().to_owned();
    let text = summary.to_json();
    if let Some(outputs) = outputs {
        outputs.write(scenario, &text)?;
    }
    json.map_or(Ok(()), |file| claim::commit(file, &text))?;
    claim.take_junit().map_or(Ok(()), |file| claim::commit(file, &junit(&summary, &options.repeat)))?;
    Ok(summary)
}

/// Rows that go into files, and the bar.
struct Written<'s> {
    scenario: &'s LargeScenario,
    outputs: Option<Outputs>,
    progress: Progress,
    also: &'s mut dyn LargeRows,
}

impl LargeRows for Written<'_> {
    fn reached(&mut self, t: f64) {
        self.progress.at(t);
        self.also.reached(t);
    }

    fn row(&mut self, network: &Network<'_>, k: u64) -> Result<(), RunError> {
        self.also.row(network, k)?;
        let Some(outputs) = &mut self.outputs else { return Ok(()) };
        Ok(outputs.take(self.scenario, network, k)?)
    }
}

impl LargeRows for Nobody {
    fn row(&mut self, _: &Network<'_>, _: u64) -> Result<(), RunError> {
        Ok(())
    }
}

/// The columns of `quantiles.csv` behind the time.
#[must_use]
pub fn quantile_names() -> Vec<String> {
    let of_states = QUANTILES.iter().map(|share| format!("x_q{:02}", (share * 100.0).round() as u32));
    let others = ["ratio_q50", "ratio_q95", "ratio_q100", "u_q50", "u_q100"];
    ["x_mean".to_owned()].into_iter().chain(of_states).chain(others.map(str::to_owned)).collect()
}

/// Options that would do nothing.
fn refuse(options: &RunOptions) -> Result<(), RunError> {
    let name = match (options.bus_logs, options.verbosity) {
        (BusLogs { capture: true, .. }, _) => "--pcapng: there is no CAN bus in this run",
        (BusLogs { log: false, .. }, _) => "--no-can-log: there is no CAN bus in this run",
        _ if options.mcap => "--mcap: there are no columns per node in this run",
        (_, Verbosity::Verbose) => "--verbose: nodes report nothing in this run",
        _ => return Ok(()),
    };
    Err(RunError::bad_input(format!("{name} (bus.model = \"none\"); leave it out")))
}

fn judge(scenario: &LargeScenario, findings: &Findings, interrupted: Option<String>) -> Summary {
    let halt = findings.halt.as_ref().map(|halt| {
        let (id, at) = (halt.node + 1, significant(scenario.time.at_s(halt.tick), 6));
        format!(
            "at {at} s: node {id} would have stopped by itself, since {}; without a bus nobody hears that",
            halt.why
        )
    });
    let ended_early = interrupted.or(halt);
    let ratio = if findings.judged > 0 { findings.max_ratio } else { f64::NAN };
    let expect = &scenario.expect;
    let expectations = [
        ("funnel_ratio", expect.funnel_ratio, Some(ratio)),
        ("final_spread", expect.final_spread, Some(findings.final_spread()).filter(|_| scenario.nodes() > 1)),
        ("max_input", expect.max_input, Some(findings.max_input.into())),
    ];
    let expectations = expectations
        .into_iter()
        .filter_map(|(name, limit, value)| Some(Expectation::below(name, limit?, value)))
        .chain(expect.final_value.map(|expected| {
            Expectation::below("final_value", expected.within, Some(findings.distance(expected.is)))
        }));
    let mut summary = Summary {
        scenario: scenario.title.clone(),
        seed: scenario.seed,
        on: "none".to_owned(),
        nodes: scenario.nodes(),
        ticks: scenario.time.ticks,
        tick_s: scenario.time.tick_s(),
        funnel: Some(FunnelSummary {
            max_ratio: ratio,
            breaches: findings.breaches,
            uncoupled: findings.uncoupled,
            believed: Some(BelievedSummary {
                max_ratio: shortest(findings.believed_ratio),
                breaches: findings.believed_breaches,
            }),
            ..FunnelSummary::default()
        }),
        sync: Some(SyncSummary {
            final_spread: findings.final_spread(),
            max_spread: findings.max_spread,
            // `check` knows them, where they are known.
            bound: f64::NAN,
            lambda2: f64::NAN,
        }),
        counters: Some(CounterSummary {
            breaches: findings.believed_breaches,
            max_ratio: Some(shortest(findings.believed_ratio)),
            floored: findings.floored,
            saturated: findings.saturated,
            limited: findings.limited,
            ..CounterSummary::default()
        }),
        max_input: findings.max_input.into(),
        expect: expectations.collect(),
        checks: checks(scenario, findings, ended_early.as_deref()),
        ended_early,
        left_out: LEFT_OUT.to_vec(),
        ..Summary::default()
    };
    summary.passed = summary.passes();
    summary
}

/// What every run must do, as far as that can be said here.
fn checks(scenario: &LargeScenario, findings: &Findings, ended_early: Option<&str>) -> Vec<Check> {
    let check = |name, fault: Option<String>, fine: &str| Check {
        name,
        pass: fault.is_none(),
        text: fault.unwrap_or_else(|| fine.to_owned()),
    };
    let floored = (findings.floored > 0 && scenario.floor == FloorSpec::None).then(|| {
        format!(
            "nodes have floored their funnels at {} node-ticks, and no coupling.floor accepts that",
            findings.floored
        )
    });
    let unknown = (findings.judged == 0 || findings.max_ratio.is_nan())
        .then(|| "no diffusive term was known, or one was not a number".to_owned());
    vec![
        check("complete", ended_early.map(|why| format!("the run ended {why}")), "every tick was run"),
        check("floor", floored, "no node has floored its funnel, or coupling.floor accepts that"),
        check("measured", unknown, "every figure is a number"),
    ]
}

/// The files of `--out`.
struct Outputs {
    quantiles: AtomicFile,
    picture: AtomicFile,
    /// With the ids of its nodes.
    trajectory: Option<AtomicFile>,
    scenario: AtomicFile,
    summary: AtomicFile,
    rows: Vec<Row>,
    folder: std::path::PathBuf,
}

impl Outputs {
    fn open(out: &Path, nodes: &[usize]) -> Result<Self, RecordError> {
        let file = |name: &str| AtomicFile::create(out.join(name));
        let mut quantiles = file(names::QUANTILES)?;
        quantiles.write(|out| writeln!(out, "t,{}", quantile_names().join(",")))?;
        let trajectory = (!nodes.is_empty())
            .then(|| {
                let mut trajectory = file(names::TRAJECTORY)?;
                trajectory.write(|out| {
                    write!(out, "t")?;
                    for name in ["x", "nu", "psi", "u"] {
                        nodes.iter().try_for_each(|id| write!(out, ",{name}_{id}"))?;
                    }
                    writeln!(out)
                })?;
                Ok(trajectory)
            })
            .transpose()?;
        Ok(Self {
            quantiles,
            picture: file(names::QUANTILES_PICTURE)?,
            trajectory,
            scenario: file(names::SCENARIO)?,
            summary: file(names::SUMMARY)?,
            rows: Vec::new(),
            folder: out.to_owned(),
        })
    }

    fn take(&mut self, scenario: &LargeScenario, network: &Network<'_>, k: u64) -> Result<(), RecordError> {
        let row = network.row();
        let single = |out: &mut dyn Write, value: f32| {
            write!(out, ",")?;
            Precision::Single.write(out, value.into())
        };
        self.quantiles.write(|out| {
            Precision::Double.write(out, row.t)?;
            write!(out, ",")?;
            Precision::Double.write(out, row.mean)?;
            let values = row.x.iter().chain(&row.ratio).chain(&row.input);
            values.copied().try_for_each(|value| single(out, value))?;
            writeln!(out)
        })?;
        self.rows.push(row);
        let Some(trajectory) = &mut self.trajectory else { return Ok(()) };
        trajectory.write(|out| {
            Precision::Double.write(out, scenario.time.at_s(k))?;
            let columns: [fn(&funnelnet_node::Observation<f32>) -> f32; 4] =
                [|seen| seen.x, |seen| seen.nu, |seen| seen.psi, |seen| seen.u];
            for of in columns {
                network.watched().map(of).try_for_each(|value| single(out, value))?;
            }
            writeln!(out)
        })
    }

    fn write(self, scenario: &LargeScenario, summary: &str) -> Result<(), RunError> {
        let settle = |mut file: AtomicFile, text: &str| -> Result<AtomicFile, RecordError> {
            file.write(|out: &mut dyn Write| -> io::Result<()> { out.write_all(text.as_bytes()) })?;
            file.settle()?;
            Ok(file)
        };
        let mut settled = Vec::new();
        for file in [Some(self.quantiles), self.trajectory].into_iter().flatten() {
            settled.push(settle(file, "")?);
        }
        // A run that ended at once has no picture.
        if let Ok(picture) = quantiles_svg(&scenario.title, scenario.unit.as_deref(), &self.rows) {
            settled.push(settle(self.picture, &picture)?);
        }
        settled.push(settle(self.scenario, &scenario.as_run)?);
        for input in &scenario.input_files {
            settled.push(settle(AtomicFile::create(self.folder.join(&input.name))?, &input.text)?);
        }
        settled.push(settle(self.summary, summary)?);
        Ok(settled.into_iter().try_for_each(AtomicFile::commit)?)
    }
}
