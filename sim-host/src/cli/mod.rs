//! The command line: arguments in, exit code out.

mod arguments;
mod exporting;
mod sweeping;
mod words;

use std::ffi::OsString;
use std::io::{self, Write};
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::Path;
use std::process::ExitCode;

use clap::{CommandFactory, Parser};

use crate::bench::{self, BenchFile};
use crate::check;
use crate::compare::{Recorded, compare, overlay_svg};
use crate::exit::Exit;
use crate::flash_file::FileStorage;
use crate::host_node::{self, End, Kind};
use crate::hub::Commissioned;
use crate::interrupt::Interrupt;
use crate::printable::printable_lines;
use crate::program::Program;
use crate::record::{BusLogs, Summary, failures, is_standard_output, write_atomic};
use crate::replay::replay;
use crate::report::{self, Report};
use crate::run::{
    self, Claim, Fidelity, LargeOptions, RunError, RunOptions, UpdateProgress, Verbosity, Wanted,
};
use crate::scenario::{self, AnyScenario, LargeScenario, Override, Scenario, TimeSpec};

pub use arguments::Cli;
use arguments::{
    BenchArgs, CheckArgs, Command, DEFAULT_IMAGE, DiffArgs, NodeArgs, OutputArgs, ReplayArgs, ReportArgs,
    RunArgs, SchemaOf, Settings, Source,
};
use words::{command, repeat};

/// A message for standard error, and how the program ends.
struct Failure {
    message: String,
    exit: Exit,
}

impl Failure {
    fn bad_input(message: String) -> Self {
        Self { message, exit: Exit::BadInput }
    }
}

impl From<RunError> for Failure {
    fn from(RunError { message, exit }: RunError) -> Self {
        Self { message, exit }
    }
}

impl From<Failure> for RunError {
    fn from(Failure { message, exit }: Failure) -> Self {
        Self { message, exit }
    }
}

impl From<io::Error> for Failure {
    /// A reader that went away (`| head`) is no failure of ours; anything else could not be written.
    fn from(error: io::Error) -> Self {
        match error.kind() {
            io::ErrorKind::BrokenPipe => Self { message: String::new(), exit: Exit::Success },
            _ => Self::bad_input(format!("cannot write to standard output: {error}")),
        }
    }
}

impl Source {
    fn load_any(&self) -> Result<AnyScenario, Failure> {
        let read = || scenario::Source::read(&self.scenario)?.any_scenario(&self.settings.overrides());
        read().map_err(|errors| Failure::bad_input(errors.to_string()))
    }
}

impl Settings {
    fn overrides(&self) -> Vec<Override> {
        self.set.iter().cloned().chain(self.seed.map(Override::seed)).collect()
    }

    fn load(&self, scenario: &Path) -> Result<Scenario, Failure> {
        Scenario::load(scenario, &self.overrides()).map_err(|errors| Failure::bad_input(errors.to_string()))
    }
}

/// Runs the program with the process's arguments.
#[must_use]
pub fn main() -> ExitCode {
    let arguments: Vec<_> = std::env::args_os().collect();
    // A panic is a defect, and has its own exit code; its message is already on standard error.
    let exit = catch_unwind(AssertUnwindSafe(|| dispatch(&arguments))).unwrap_or_else(|_| {
        complain("this is a defect of sim-host; please report it with the command that you ran");
        Exit::Defect
    });
    exit.into()
}

fn dispatch(arguments: &[OsString]) -> Exit {
    let cli = match Cli::try_parse_from(arguments) {
        Ok(cli) => cli,
        Err(error) => return usage(&error),
    };
    let result = match cli.command {
        Command::Run(args) => run_command(&args, arguments),
        Command::Bench(args) => bench_command(&args, arguments),
        Command::Node(args) => node_command(&args),
        Command::Sweep(args) => sweeping::sweep_command(&args, arguments),
        Command::Check(args) => check_command(&args),
        Command::Diff(args) => diff_command(&args),
        Command::Replay(args) => replay_command(&args),
        Command::Report(args) => report_command(&args),
        Command::Export(args) => exporting::export_command(&args),
        Command::Schema { file: SchemaOf::Scenario } => schema_command(),
        Command::Completions { shell } => completions(shell),
        Command::Man { command } => manual_page(command.as_deref()),
    };
    result.unwrap_or_else(|failure| {
        complain(&failure.message);
        failure.exit
    })
}

/// Help and version come this way too, with code 0. Nobody is left to tell if printing fails.
fn usage(error: &clap::Error) -> Exit {
    let text = error.render().to_string();
    let text = printable_lines(&text);
    if error.use_stderr() {
        let _ = write!(io::stderr().lock(), "{text}");
        return Exit::BadInput;
    }
    let mut out = io::stdout().lock();
    let _ = write!(out, "{text}").and_then(|()| out.flush());
    Exit::Success
}

fn run_command(args: &RunArgs, arguments: &[OsString]) -> Result<Exit, Failure> {
    let command = command(arguments);
    let wanted = wanted(&args.source.scenario, &args.source.settings.set, None, &args.output, &command);
    execute(&wanted, args.on, &args.output, arguments, || {
        Ok(match args.source.load_any()? {
            AnyScenario::Wired(_) if !args.nodes.is_empty() || args.threads.is_some() => {
                return Err(Failure::bad_input(
                    "--nodes and --threads are for runs with bus.model = \"none\"; others have columns of every node, and one thread".to_owned(),
                ));
            }
            AnyScenario::Wired(scenario) => (Asked::Wired(scenario), None),
            AnyScenario::Large(_) if args.on != Fidelity::Loopback => {
                return Err(Failure::bad_input(format!(
                    "--on {}: bus.model = \"none\" runs in this program only; leave --on out",
                    args.on
                )));
            }
            AnyScenario::Large(scenario) => {
                let mut nodes = args.nodes.clone();
                nodes.sort_unstable();
                nodes.dedup();
                let large = LargeOptions { nodes, threads: args.threads.map(Into::into) };
                (Asked::Large(scenario, large), None)
            }
        })
    })
}

fn bench_command(args: &BenchArgs, arguments: &[OsString]) -> Result<Exit, Failure> {
    let bench = || {
        args.bench.as_deref().map(BenchFile::load).transpose().map_err(|e| Failure::bad_input(e.to_string()))
    };
    match &args.scenario {
        Some(scenario) if args.commission => {
            let options = options(Fidelity::Bench, bench()?, &args.output, None, String::new())?;
            commissioned(run::commission(&args.settings.load(scenario)?, &options), &options)
        }
        Some(scenario) if args.update.is_some() => update_command(args, scenario, bench()?),
        Some(scenario) => {
            let command = command(arguments);
            let wanted = wanted(scenario, &args.settings.set, args.bench.as_deref(), &args.output, &command);
            execute(&wanted, Fidelity::Bench, &args.output, arguments, || {
                let bench = bench()?;
                Ok((Asked::Wired(Box::new(args.settings.load(scenario)?)), bench))
            })
        }
        None if args.erase => {
            let options = options(Fidelity::Bench, bench()?, &args.output, None, String::new())?;
            commissioned(run::erase(&options), &options)
        }
        None => list(bench()?.as_ref()),
    }
}

fn wanted<'a>(
    scenario: &'a Path,
    sets: &'a [Override],
    bench: Option<&'a Path>,
    output: &'a OutputArgs,
    command: &'a str,
) -> Wanted<'a> {
    Wanted {
        scenario,
        sets,
        bench,
        out: output.out.as_deref(),
        json: output.json.as_deref(),
        junit: output.junit.as_deref(),
        command,
    }
}

/// Gives all nodes a new program, or none.
fn update_command(args: &BenchArgs, scenario: &Path, bench: Option<BenchFile>) -> Result<Exit, Failure> {
    // Before any node is touched.
    let image = args.update.as_deref().unwrap_or(Path::new(""));
    let program = Program::load(image).map_err(|why| Failure::bad_input(format!("--update {why}")))?;
    let scenario = args.settings.load(scenario)?;
    let options = options(Fidelity::Bench, bench, &args.output, None, String::new())?;
    let mut progress = UpdateProgress::new(options.verbosity == Verbosity::Quiet);
    let outcome = run::update(&scenario, &options, &program, &mut |stage| progress.at(stage));
    drop(progress);
    let exit = |exit| if exit == Exit::Interrupted { options.interrupt.exit() } else { exit };
    let outcome = outcome.map_err(|error| Failure { message: error.message, exit: exit(error.exit) })?;
    if options.verbosity > Verbosity::Quiet {
        print(&printable_lines(&outcome.to_string()))?;
    }
    Ok(Exit::Success)
}

/// Prints what the nodes have now, a line each.
fn commissioned(nodes: Result<Vec<Commissioned>, RunError>, options: &RunOptions) -> Result<Exit, Failure> {
    let exit = |exit| if exit == Exit::Interrupted { options.interrupt.exit() } else { exit };
    let nodes = nodes.map_err(|error| Failure { message: error.message, exit: exit(error.exit) })?;
    if options.verbosity > Verbosity::Quiet {
        nodes.iter().try_for_each(|node| print(&printable_lines(&node.to_string())))?;
    }
    Ok(Exit::Success)
}

/// Prints who answers at which port. That nobody does is an answer too.
fn list(bench: Option<&BenchFile>) -> Result<Exit, Failure> {
    let listed = bench::list(bench, &Interrupt::on_signals()?);
    if listed.is_empty() {
        print("no serial ports on this machine")?;
    }
    listed.iter().try_for_each(|port| print(&printable_lines(&port.to_string())))?;
    Ok(Exit::Success)
}

/// What a command runs.
enum Asked {
    Wired(Box<Scenario>),
    Large(Box<LargeScenario>, LargeOptions),
}

impl Asked {
    fn time_and_seed(&self) -> (TimeSpec, u64) {
        match self {
            Self::Wired(scenario) => (scenario.time, scenario.seed),
            Self::Large(scenario, _) => (scenario.time, scenario.seed),
        }
    }
}

/// A run from its outputs on: whatever happens after they are claimed, the JUnit file says so.
fn execute(
    wanted: &Wanted<'_>,
    on: Fidelity,
    args: &OutputArgs,
    arguments: &[OsString],
    load: impl FnOnce() -> Result<(Asked, Option<BenchFile>), Failure>,
) -> Result<Exit, Failure> {
    let (summary, options) = Claim::take(wanted)?.guard(|claim| {
        let (asked, bench) = load()?;
        let (time, seed) = asked.time_and_seed();
        let every_ticks = args.every.map(|every| run::every_ticks(every, &time)).transpose()?;
        if args.every.is_some() && args.out.is_none() && !args.quiet {
            complain("note: --every says which rows trajectory.csv has, and there is none without --out");
        }
        let options = options(on, bench, args, every_ticks, repeat(arguments, seed))?;
        let done = match &asked {
            Asked::Wired(scenario) => run::execute_in(claim, scenario, &options),
            Asked::Large(scenario, large) => run::execute_large_in(claim, scenario, &options, large),
        };
        match done {
            Ok(summary) => Ok((summary, options)),
            Err(error) if error.exit == Exit::Interrupted => {
                Err(RunError { exit: options.interrupt.exit(), ..error })
            }
            Err(error) => Err(error),
        }
    })?;
    if summary.ended_early.is_some() && options.interrupt.is_set() {
        // The user knows; what was recorded says so, too.
        return Ok(options.interrupt.exit());
    }
    let exit = verdict(&summary, &options.repeat);
    let is_taken = [wanted.json, wanted.junit].into_iter().flatten().any(is_standard_output);
    if options.verbosity > Verbosity::Quiet && !is_taken {
        // The verdict stands where nobody reads the summary.
        if let Err(failure) = print(&printable_lines(&summary.to_string())).map_err(Failure::from) {
            complain(&failure.message);
            return Ok(exit.worst(failure.exit));
        }
    }
    Ok(exit)
}

fn options(
    on: Fidelity,
    bench: Option<BenchFile>,
    args: &OutputArgs,
    every_ticks: Option<u64>,
    repeat: String,
) -> Result<RunOptions, Failure> {
    if let (Some(image), Fidelity::Loopback | Fidelity::Reference) = (&args.image, on) {
        let image = image.display();
        return Err(Failure::bad_input(format!(
            "--image {image}: --on {on} emulates no node; use --on emulator"
        )));
    }
    Ok(RunOptions {
        on,
        out: args.out.clone(),
        every_ticks,
        json: args.json.clone(),
        junit: args.junit.clone(),
        bus_logs: BusLogs { log: !args.no_can_log, capture: args.pcapng },
        mcap: args.mcap,
        verbosity: match (args.quiet, args.verbose) {
            (true, _) => Verbosity::Quiet,
            (_, true) => Verbosity::Verbose,
            _ => Verbosity::Normal,
        },
        image: args.image.clone().unwrap_or_else(|| DEFAULT_IMAGE.into()),
        bench,
        interrupt: Interrupt::on_signals()?,
        repeat,
    })
}

/// Says what failed, with the seed and the command that repeats it.
fn verdict(summary: &Summary, repeat: &str) -> Exit {
    if summary.passes() {
        return Exit::Success;
    }
    failures(summary).iter().for_each(|failure| complain(failure));
    complain(&format!("seed {}; repeat with: {repeat}", summary.seed));
    Exit::ExpectationFailed
}

fn check_command(args: &CheckArgs) -> Result<Exit, Failure> {
    let report = match args.source.load_any()? {
        AnyScenario::Wired(scenario) => check::check(&scenario),
        AnyScenario::Large(scenario) => check::check_large(&scenario),
    };
    if args.json {
        let text = serde_json::to_string_pretty(&report)
            .map_err(|error| Failure { message: error.to_string(), exit: Exit::Defect })?;
        print(&text)?;
    } else {
        let text = match columns() {
            Some(width) => format!("{report:width$}"),
            None => report.to_string(),
        };
        print(&printable_lines(&text))?;
    }
    Ok(match (report.pass, args.strict && report.count(check::Status::Warn) > 0) {
        (false, _) => Exit::BadInput,
        (true, true) => Exit::ExpectationFailed,
        (true, false) => Exit::Success,
    })
}

/// Characters of a line of the terminal, where standard output is one.
fn columns() -> Option<usize> {
    let (terminal_size::Width(width), _) = terminal_size::terminal_size_of(io::stdout())?;
    Some(width.into())
}

fn diff_command(args: &DiffArgs) -> Result<Exit, Failure> {
    let read = |path: &Path| Recorded::read(path).map_err(Failure::bad_input);
    let (a, b) = (read(&args.a)?, read(&args.b)?);
    let found = compare(&a, &b);
    if let Some(path) = &args.plot {
        if let Some(read) = [&a, &b].into_iter().find_map(|recorded| recorded.is_read_from(path)) {
            let message =
                format!("--plot {}: would overwrite {}, which is compared", path.display(), read.display());
            return Err(Failure::bad_input(message));
        }
        let title = format!("A: {}, B: {}", args.a.display(), args.b.display());
        let svg =
            overlay_svg(&title, &a.table, &b.table).map_err(|error| Failure::bad_input(error.to_string()))?;
        write_atomic(path, svg.as_bytes()).map_err(|error| Failure::bad_input(error.to_string()))?;
    }
    if args.json {
        let text = serde_json::to_string_pretty(&found)
            .map_err(|error| Failure { message: error.to_string(), exit: Exit::Defect })?;
        print(&text)?;
    } else {
        print(&printable_lines(&found.to_string()))?;
    }
    Ok(if found.equal { Exit::Success } else { Exit::ExpectationFailed })
}

fn replay_command(args: &ReplayArgs) -> Result<Exit, Failure> {
    let scenario = args.settings.load(&args.scenario)?;
    let found = replay(&args.log, &scenario, args.node)?;
    if args.json {
        let text = serde_json::to_string_pretty(&found)
            .map_err(|error| Failure { message: error.to_string(), exit: Exit::Defect })?;
        print(&text)?;
    } else {
        print(&printable_lines(&found.to_string()))?;
    }
    Ok(found.exit())
}

fn report_command(args: &ReportArgs) -> Result<Exit, Failure> {
    let report = Report::of(&args.folder, args.other.as_deref()).map_err(Failure::bad_input)?;
    let path = args.html.clone().unwrap_or_else(|| args.folder.join(report::FILE));
    if is_standard_output(&path) {
        io::stdout().lock().write_all(report.html.as_bytes())?;
        return Ok(Exit::Success);
    }
    let name = path.display();
    if !report::is_replaceable(&path) {
        return Err(Failure::bad_input(format!(
            "{name} would be replaced by the report, and is none; move it, or name another file with --html"
        )));
    }
    write_atomic(&path, report.html.as_bytes()).map_err(|error| Failure::bad_input(error.to_string()))?;
    print(&printable_lines(&format!("{name}: {}", report.told)))?;
    Ok(Exit::Success)
}

fn node_command(args: &NodeArgs) -> Result<Exit, Failure> {
    let missing = |message| Failure { message, exit: Exit::NoHardware };
    let can =
        args.can.as_deref().map(|can| host_node::can_port(can, args.can_fd)).transpose().map_err(missing)?;
    let storage = args.storage.as_deref().map(FileStorage::open).transpose().map_err(Failure::bad_input)?;
    let line = match &args.serial {
        Some(path) => host_node::serial_line(path, args.baud).map_err(missing)?,
        None => host_node::inherited_line()
            .map_err(|error| missing(format!("standard input is no socket: {error}")))?,
    };
    let end = host_node::run(line, can, storage, Kind { uid: args.uid, drift_ppm: args.drift_ppm });
    if let End::CanGone(why) = &end {
        complain(&format!("the CAN interface is gone: {why}"));
    }
    Ok(Exit::from(&end))
}

fn schema_command() -> Result<Exit, Failure> {
    let text = serde_json::to_string_pretty(&crate::scenario::schema::scenario())
        .map_err(|error| Failure { message: error.to_string(), exit: Exit::Defect })?;
    print(&text)?;
    Ok(Exit::Success)
}

fn completions(shell: clap_complete::Shell) -> Result<Exit, Failure> {
    let mut script = Vec::new();
    clap_complete::generate(shell, &mut Cli::command(), "sim-host", &mut script);
    io::stdout().lock().write_all(&script)?;
    Ok(Exit::Success)
}

fn manual_page(name: Option<&str>) -> Result<Exit, Failure> {
    let mut program = Cli::command();
    program.build();
    let (page, title) = match name {
        None => (program, "sim-host".to_owned()),
        Some(name) => match program.find_subcommand(name) {
            // As the file is called in which `man` looks for it.
            Some(command) => (command.clone(), format!("sim-host-{name}")),
            None => {
                let known: Vec<_> = program.get_subcommands().map(clap::Command::get_name).collect();
                let known = known.join(", ");
                return Err(Failure::bad_input(format!(
                    "man {name}: there is no such command; there are {known}"
                )));
            }
        },
    };
    let mut text = Vec::new();
    clap_mangen::Man::new(page).title(title).render(&mut text)?;
    io::stdout().lock().write_all(&text)?;
    Ok(Exit::Success)
}

/// One text and a newline to standard output; unlike `println!` it does not panic on a broken pipe.
fn print(text: &str) -> io::Result<()> {
    let mut out = io::stdout().lock();
    writeln!(out, "{text}")?;
    out.flush()
}

/// One message to standard error; where even that fails there is nobody to tell.
fn complain(message: &str) {
    if !message.is_empty() {
        let _ = writeln!(io::stderr().lock(), "{}", printable_lines(message));
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::record::Expectation;

    #[test]
    fn the_definition_is_sound() {
        Cli::command().debug_assert();
    }

    #[test]
    fn a_failed_expectation_is_code_1_and_none_is_code_0() {
        let judged = |value| Expectation::below("funnel_ratio", 1.0, value);
        let summary =
            |value| Summary { expect: vec![judged(Some(0.9)), judged(value)], ..Summary::default() };
        assert_eq!(verdict(&summary(Some(0.9)), ""), Exit::Success);
        assert_eq!(verdict(&summary(Some(1.0)), ""), Exit::ExpectationFailed);
        assert_eq!(verdict(&summary(None), ""), Exit::ExpectationFailed);
    }
}
