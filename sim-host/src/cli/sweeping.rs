//! `sim-host sweep`: from its arguments to what it says at the end.

use super::arguments::SweepArgs;
use super::words::{command, quoted};
use super::{Failure, complain, print};
use crate::exit::Exit;
use crate::interrupt::Interrupt;
use crate::printable::printable_lines;
use crate::run::files_named_in;
use crate::scenario::{Override, Source, is_standard_input};
use crate::sweep::{Design, Done, HAS_PARQUET, List, Method, Plan, Quoting, Request, execute};
use std::collections::BTreeSet;
use std::ffi::OsString;
use std::num::NonZero;
use std::path::PathBuf;

pub(super) fn sweep_command(args: &SweepArgs, arguments: &[OsString]) -> Result<Exit, Failure> {
    if args.parquet && !HAS_PARQUET {
        return Err(Failure::bad_input(
            "--parquet: this build writes no Parquet; build it with cargo build --package sim-host --features parquet"
                .to_owned(),
        ));
    }
    let design = design(args).map_err(Failure::bad_input)?;
    let named = &args.source.scenario;
    let source = Source::read(named).map_err(|errors| Failure::bad_input(errors.to_string()))?;
    let settings = &args.source.settings;
    let plan = Plan {
        seed: settings.seed.unwrap_or_else(|| source.seed()),
        source,
        named: named.clone(),
        settings: settings.set.clone(),
        design,
        seeds: args.seeds,
        is_independent: args.independent,
    };
    let request = request(args, &plan, arguments)?;
    let done = execute(&plan, &request)?;
    tell(&done, &request)
}

fn design(args: &SweepArgs) -> Result<Design, String> {
    let (grid, seed) = (args.grid.clone(), args.design_seed);
    let drawn = |option: &str, method, points| {
        Design::drawn(method, points, seed, args.range.clone(), grid.clone())
            .map_err(|why| format!("--{option} {why}"))
    };
    match (&args.list, args.sobol, args.lhs) {
        (_, Some(points), _) => drawn("sobol", Method::Sobol, points),
        (_, _, Some(points)) => drawn("lhs", Method::Lhs, points),
        _ if !args.range.is_empty() => {
            Err("--range: says what to draw from; --sobol N or --lhs N says how many points".to_owned())
        }
        (Some(path), ..) => {
            let list = List::load(path).map_err(|why| format!("--list {why}"))?;
            Ok(Design::of_list(path.display().to_string(), list, grid))
        }
        _ => Ok(Design::of_grid(grid)),
    }
}

/// Points that are looked at for names of files; more are refused.
const MOST_POINTS: u64 = 10_000_000;

/// Everything that replaces a value and may name a file, of the points too.
fn settings(plan: &Plan) -> Vec<Override> {
    let points = (0..plan.design.points().min(MOST_POINTS)).flat_map(|index| plan.design.point(index));
    let texts: BTreeSet<_> = points.map(|setting| format!("{}={}", setting.key, setting.value)).collect();
    let named = texts.iter().filter(|text| text.contains("file"));
    plan.settings.iter().cloned().chain(named.filter_map(|text| Override::parse(text).ok())).collect()
}

fn request(args: &SweepArgs, plan: &Plan, arguments: &[OsString]) -> Result<Request, Failure> {
    let scenario = &args.source.scenario;
    let scenario = if is_standard_input(scenario) { PathBuf::from("/dev/stdin") } else { scenario.clone() };
    let read = files_named_in(&args.source.scenario, &settings(plan));
    let cores = || std::thread::available_parallelism().map_or(1, NonZero::get);
    let program =
        arguments.first().map_or("sim-host".into(), |program| program.to_string_lossy().into_owned());
    Ok(Request {
        out: args.out.clone(),
        inputs: read.into_iter().chain([Some(scenario), args.list.clone()].into_iter().flatten()).collect(),
        shard: args.shard,
        resumes: args.resume,
        jobs: args.jobs.map_or_else(cores, usize::from),
        may_refuse: args.allow_refused,
        parquet: args.parquet,
        is_quiet: args.quiet,
        interrupt: Interrupt::on_signals()?,
        command: command(arguments),
        quoting: Quoting { program, quote: quoted },
    })
}

/// Says what came of it, and how to go on where it was stopped.
fn tell(done: &Done, request: &Request) -> Result<Exit, Failure> {
    let (there, runs, table) = (done.tally.total(), done.runs, done.table.display());
    if there < runs {
        let resume = if request.resumes { "" } else { " --resume" };
        let command = &request.command;
        complain(&format!(
            "stopped by {}: {there} of {runs} runs are in {table}; go on with: {command}{resume}",
            request.interrupt.by()
        ));
        return Ok(done.exit);
    }
    if request.is_quiet {
        return Ok(done.exit);
    }
    if done.expects_nothing && runs > 0 {
        complain("note: the scenario expects nothing: only the checks that every run has to pass were made");
    }
    let merged = if done.is_merged { "; all shards are there, and merged into runs.csv" } else { "" };
    let text = format!("{runs} runs: {}; {table}{merged}", done.tally);
    // The verdict stands where nobody reads it.
    if let Err(failure) = print(&printable_lines(&text)).map_err(Failure::from) {
        complain(&failure.message);
        return Ok(done.exit.worst(failure.exit));
    }
    Ok(done.exit)
}
