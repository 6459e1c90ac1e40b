//! The command line: arguments in, exit code out.

use std::ffi::OsString;
use std::io::{self, Write};
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::{Path, PathBuf};
use std::process::ExitCode;

use clap::{Args, CommandFactory, Parser, Subcommand};

use crate::bench::{self, BenchFile};
use crate::check;
use crate::exit::Exit;
use crate::figure::figure;
use crate::flash_file::FileStorage;
use crate::host_node::{self, End};
use crate::hub::Commissioned;
use crate::interrupt::Interrupt;
use crate::record::{
    BenchNodeSummary, BenchSummary, Expectation, FunnelSummary, OwnClockSummary, PerComponent, Summary,
    WiresSummary,
};
use crate::run::{self, Fidelity, RunError, RunOptions, Verbosity};
use crate::scenario::{Override, Scenario, format_duration, parse_duration};

// Here and below: a line for each paragraph, so that it is wrapped to the terminal's width.
const AFTER_HELP: &str = "\
Examples:
  sim-host check scenarios/five-agents.toml
  sim-host run scenarios/five-agents.toml --out out/five
  sim-host run scenarios/five-agents.toml --set graph.kind=star

Exit codes: 0 all expectations hold, 1 one failed, 2 bad usage or configuration, \
3 no such hardware or emulator, 4 a defect of the program, 130 stopped by the user.";

/// Where `./ci.sh firmware` leaves the image, seen from the root of the repository.
const DEFAULT_IMAGE: &str = "firmware/target/thumbv7em-none-eabihf/release/mps2_an386";

const RUN_HELP: &str = "\
Examples:
  sim-host run scenarios/five-agents.toml
  sim-host run scenarios/five-agents.toml --on reference --every 10ms
  sim-host run scenarios/lossy-ring.toml --set bus.loss=0.3 --junit lossy.xml
  sim-host run scenarios/five-agents.toml --seed 7 --set node.3.state=-2";

const BENCH_HELP: &str = "\
Relays states between the nodes and makes them tick together, so that a run has the bits of `run`; records when \
the host sent and read each of them (bench.csv). docs/bench.md lists the keys of a bench file.

Nodes that run are stopped by --commission and --erase, and stay stopped: also where they fail.

Examples:
  sim-host bench --list
  sim-host bench scenarios/five-agents.toml --bench bench.toml --commission
  sim-host bench scenarios/five-agents.toml --bench bench.toml --out out/bench
  sim-host bench --bench bench.toml --erase";

const NODE_HELP: &str = "\
The node is blank until a bench configures it over its line, and ends when that is closed. It has no plant, and keeps \
its configuration only where it has a --storage. A bench file's `host = true` starts such a node by itself.

Examples:
  sim-host node --serial /dev/ttyUSB0
  sim-host node --serial /dev/ttyUSB0 --can can0
  sim-host node --serial /dev/ttyUSB0 --can can0 --can-fd";

const CHECK_HELP: &str = "\
Runs nothing. Says whether the paper's assumptions hold and with which constants, what its bounds give over \
time, how narrow a funnel the tick can hold, what the emergent dynamics predict, how hard each node has to \
push, and what the states would take of a real bus. Takes up to 2,000 nodes; a run takes 127.

Examples:
  sim-host check scenarios/five-agents.toml
  sim-host check scenarios/five-agents.toml --set time.tick=20ms --json";

const COMPLETIONS_HELP: &str = "\
Examples:
  source <(sim-host completions bash)
  sim-host completions fish > ~/.config/fish/completions/sim-host.fish";

/// Agreement with a guarantee: runs funnel-coupling scenarios, from the equations to emulated nodes.
#[derive(Debug, Parser)]
#[command(name = "sim-host", version, about, after_help = AFTER_HELP, max_term_width = 100)]
pub struct Cli {
    #[command(subcommand)]
    command: Command,
}

#[derive(Debug, Subcommand)]
enum Command {
    /// Run a scenario and check its expectations
    #[command(after_help = RUN_HELP)]
    Run(RunArgs),
    /// Run a scenario on nodes behind serial ports or on CAN, beside the same run in loopback
    #[command(after_help = BENCH_HELP)]
    Bench(BenchArgs),
    /// Be a node: the firmware's, in this process, for a computer with a CAN adapter or to try a bench without boards
    #[command(after_help = NODE_HELP)]
    Node(NodeArgs),
    /// Check a scenario's assumptions, bounds and capacity without running it
    #[command(after_help = CHECK_HELP)]
    Check(CheckArgs),
    /// Print a completion script for a shell
    #[command(after_help = COMPLETIONS_HELP)]
    Completions {
        /// The shell to complete for
        shell: clap_complete::Shell,
    },
}

#[derive(Args, Debug)]
struct Source {
    /// The scenario file
    #[arg(value_name = "SCENARIO.toml")]
    scenario: PathBuf,
    #[command(flatten)]
    settings: Settings,
}

/// What replaces values of the scenario file.
#[derive(Args, Debug)]
struct Settings {
    /// Root of every random stream, instead of the scenario's
    #[arg(long, value_name = "N")]
    seed: Option<u64>,
    /// Set one value: TOML, or a bare string; node.3.state means the [[node]] with id 3 (repeatable)
    #[arg(long, value_name = "section.key=value", value_parser = parse_override)]
    set: Vec<Override>,
}

impl Source {
    fn load(&self) -> Result<Scenario, Failure> {
        self.settings.load(&self.scenario)
    }
}

impl Settings {
    fn load(&self, scenario: &Path) -> Result<Scenario, Failure> {
        let seed = self.seed.map(Override::seed);
        let overrides: Vec<_> = self.set.iter().cloned().chain(seed).collect();
        Scenario::load(scenario, &overrides).map_err(|errors| Failure::bad_input(errors.to_string()))
    }
}

#[derive(Args, Debug)]
struct RunArgs {
    #[command(flatten)]
    source: Source,
    /// What runs the scenario
    #[arg(long, value_enum, default_value = "loopback")]
    on: Fidelity,
    #[command(flatten)]
    output: OutputArgs,
}

#[derive(Args, Debug)]
struct NodeArgs {
    /// The line to the host: a serial port
    #[arg(long, value_name = "PATH", required_unless_present = "inherited")]
    serial: Option<String>,
    /// Bit rate of the serial port
    #[arg(long, value_name = "BIT/S", default_value_t = bench::DEFAULT_BAUD)]
    baud: u32,
    /// Send and hear states on this CAN interface, and leave the line to the host
    #[arg(long, value_name = "INTERFACE")]
    can: Option<String>,
    /// In frames of CAN FD, as all nodes of that bus then must
    #[arg(long, requires = "can")]
    can_fd: bool,
    /// Keep its configuration in this file, as a board does in its flash; made where it is missing
    #[arg(long, value_name = "FILE")]
    storage: Option<PathBuf>,
    /// The unique number that it says it has, in hexadecimal digits
    #[arg(long, value_name = "HEX", default_value = "0", value_parser = parse_uid)]
    uid: u64,
    /// The line is a socket at standard input
    #[arg(long, hide = true, conflicts_with = "serial")]
    inherited: bool,
}

#[derive(Args, Debug)]
struct BenchArgs {
    /// The scenario file
    #[arg(value_name = "SCENARIO.toml", required_unless_present_any = ["list", "erase"])]
    scenario: Option<PathBuf>,
    #[command(flatten)]
    settings: Settings,
    /// The bench file: which node is where
    #[arg(long, value_name = "bench.toml", required_unless_present = "list")]
    bench: Option<PathBuf>,
    /// Run nothing; ask every serial port, and those of the bench file, who is there
    #[arg(long, conflicts_with_all = ["scenario", "seed", "set", "out", "every", "json", "junit"])]
    list: bool,
    /// Run nothing; store the scenario's configurations in all nodes, or in none, for every start to come
    #[arg(long, conflicts_with_all = ["list", "out", "every", "json", "junit"])]
    commission: bool,
    /// Run nothing; make all nodes of the bench file blank at their next start
    #[arg(long, conflicts_with_all = ["scenario", "seed", "set", "list", "commission", "out", "every", "json", "junit"])]
    erase: bool,
    #[command(flatten)]
    output: OutputArgs,
}

/// What is written and said, and the image of emulated nodes.
#[derive(Args, Debug)]
struct OutputArgs {
    /// Folder for trajectory.csv, summary.json and plots; made where it is missing
    #[arg(long, value_name = "DIR")]
    out: Option<PathBuf>,
    /// Time between two rows of the trajectory, such as 100ms [default: every tick, up to 2,000 rows]
    #[arg(long, value_name = "DURATION", value_parser = parse_duration)]
    every: Option<u64>,
    /// File for the summary as JSON
    #[arg(long, value_name = "FILE")]
    json: Option<PathBuf>,
    /// File for the expectations as JUnit XML
    #[arg(long, value_name = "FILE")]
    junit: Option<PathBuf>,
    /// Firmware image (ELF) for emulated nodes
    #[arg(long, value_name = "FILE", default_value = DEFAULT_IMAGE)]
    image: PathBuf,
    /// Say nothing but errors
    #[arg(short, long, conflicts_with = "verbose")]
    quiet: bool,
    /// Say what nodes report, too
    #[arg(short, long)]
    verbose: bool,
}

#[derive(Args, Debug)]
struct CheckArgs {
    #[command(flatten)]
    source: Source,
    /// Print JSON instead of text
    #[arg(long)]
    json: bool,
}

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

impl From<io::Error> for Failure {
    /// A reader that went away (`| head`) is no failure of ours; anything else could not be written.
    fn from(error: io::Error) -> Self {
        match error.kind() {
            io::ErrorKind::BrokenPipe => Self { message: String::new(), exit: Exit::Success },
            _ => Self::bad_input(format!("cannot write to standard output: {error}")),
        }
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
        Err(error) => {
            // Help and version come this way too, with code 0. Nobody is left to tell if printing fails.
            let _ = error.print();
            return if error.exit_code() == 0 { Exit::Success } else { Exit::BadInput };
        }
    };
    let result = match cli.command {
        Command::Run(args) => run_command(&args, arguments),
        Command::Bench(args) => bench_command(&args, arguments),
        Command::Node(args) => node_command(&args),
        Command::Check(args) => check_command(&args),
        Command::Completions { shell } => completions(shell),
    };
    result.unwrap_or_else(|failure| {
        complain(&failure.message);
        failure.exit
    })
}

fn run_command(args: &RunArgs, arguments: &[OsString]) -> Result<Exit, Failure> {
    execute(&args.source.load()?, args.on, None, &args.output, arguments)
}

fn bench_command(args: &BenchArgs, arguments: &[OsString]) -> Result<Exit, Failure> {
    let load = |path| BenchFile::load(path).map_err(|errors| Failure::bad_input(errors.to_string()));
    let bench = args.bench.as_deref().map(load).transpose()?;
    match &args.scenario {
        Some(scenario) if args.commission => {
            let options = options(Fidelity::Bench, bench, &args.output, None, String::new())?;
            commissioned(run::commission(&args.settings.load(scenario)?, &options), &options)
        }
        Some(scenario) => {
            execute(&args.settings.load(scenario)?, Fidelity::Bench, bench, &args.output, arguments)
        }
        None if args.erase => {
            let options = options(Fidelity::Bench, bench, &args.output, None, String::new())?;
            commissioned(run::erase(&options), &options)
        }
        None => list(bench.as_ref()),
    }
}

/// Prints what the nodes have now, a line each.
fn commissioned(nodes: Result<Vec<Commissioned>, RunError>, options: &RunOptions) -> Result<Exit, Failure> {
    let nodes = nodes.map_err(|error| Failure { message: error.message, exit: error.exit })?;
    if options.verbosity > Verbosity::Quiet {
        nodes.iter().try_for_each(|node| print(&node.to_string()))?;
    }
    Ok(Exit::Success)
}

/// Prints who answers at which port. That nobody does is an answer too.
fn list(bench: Option<&BenchFile>) -> Result<Exit, Failure> {
    let listed = bench::list(bench, &Interrupt::on_signals()?);
    if listed.is_empty() {
        print("no serial ports on this machine")?;
    }
    listed.iter().try_for_each(|port| print(&port.to_string()))?;
    Ok(Exit::Success)
}

fn execute(
    scenario: &Scenario,
    on: Fidelity,
    bench: Option<BenchFile>,
    args: &OutputArgs,
    arguments: &[OsString],
) -> Result<Exit, Failure> {
    let every_ticks = args.every.map(|every| every_ticks(every, scenario)).transpose()?;
    let options = options(on, bench, args, every_ticks, repeat(arguments, scenario.seed))?;
    let summary = run::execute(scenario, &options)
        .map_err(|error| Failure { message: error.to_string(), exit: error.exit })?;
    let exit = verdict(&summary, &options.repeat);
    if options.verbosity > Verbosity::Quiet {
        // The verdict stands even where nobody reads the summary.
        if let Err(failure) = print(&text(&summary)).map_err(Failure::from) {
            complain(&failure.message);
            return Ok(if exit == Exit::Success { failure.exit } else { exit });
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
    Ok(RunOptions {
        on,
        out: args.out.clone(),
        every_ticks,
        json: args.json.clone(),
        junit: args.junit.clone(),
        verbosity: match (args.quiet, args.verbose) {
            (true, _) => Verbosity::Quiet,
            (_, true) => Verbosity::Verbose,
            _ => Verbosity::Normal,
        },
        image: args.image.clone(),
        bench,
        interrupt: Interrupt::on_signals()?,
        repeat,
    })
}

fn every_ticks(every_ns: u64, scenario: &Scenario) -> Result<u64, Failure> {
    let tick = scenario.time.tick_ns;
    let duration = scenario.time.ticks.saturating_mul(tick);
    if every_ns == 0 || !every_ns.is_multiple_of(tick) || every_ns > duration {
        let [every, tick, duration] = [every_ns, tick, duration].map(format_duration);
        return Err(Failure::bad_input(format!(
            "--every {every}: must be whole ticks of {tick}, from one to the whole run of {duration}"
        )));
    }
    Ok(every_ns / tick)
}

/// Says what failed, with the seed and the command that repeats it.
fn verdict(summary: &Summary, repeat: &str) -> Exit {
    if summary.passes() {
        return Exit::Success;
    }
    let failed = summary.expect.iter().filter(|expectation| !expectation.pass);
    for Expectation { name, limit, value, .. } in failed {
        let value = value.map_or("not measured".to_owned(), |value| value.to_string());
        complain(&format!("failed: {name} = {value} must stay below {limit}"));
    }
    for check in summary.checks.iter().filter(|check| !check.pass) {
        complain(&format!("failed: {}: {}", check.name, check.text));
    }
    complain(&format!("seed {}; repeat with: {repeat}", summary.seed));
    Exit::ExpectationFailed
}

/// The summary for people: a line per part that the run has, and one per expectation.
fn text(summary: &Summary) -> String {
    let mut lines = vec![format!(
        "{}: {} nodes, {} ticks of {} s on {}, {} s of wall time",
        summary.scenario,
        summary.nodes,
        summary.ticks,
        figure(summary.tick_s, 4),
        summary.on,
        figure(summary.wall_s, 3)
    )];
    let mut line = |name: &str, text: String| lines.push(format!("  {name:<10} {text}"));
    if let Some(funnel) = &summary.funnel {
        line("funnel", funnels(funnel));
    }
    if let Some(sync) = summary.sync {
        let [last, most, bound] =
            [sync.final_spread, sync.max_spread, sync.bound].map(|value| figure(value, 4));
        line("sync", format!("final spread {last}, bound {bound}; largest spread {most}"));
    }
    line("input", format!("largest |u| {}", figure(summary.max_input, 4)));
    if let Some(emergent) = &summary.emergent {
        let mut distance = |name: &str, error: Option<f64>, symbol: &str, end: &Option<PerComponent>| {
            if let (Some(error), Some(end)) = (error, end) {
                line(name, format!("final distance {} to {symbol}{}", figure(error, 4), each(&end.0)));
            }
        };
        distance("emergent", emergent.final_error, "xi = ", &emergent.xi_final);
        distance("blended", emergent.blended_error, "", &emergent.blended_final);
        if let Some(why) = &emergent.unresolved {
            line("emergent", format!("not predicted: {why}"));
        }
    }
    if let Some(reference) = summary.reference {
        let off = figure(reference.error_estimate, 2);
        line(
            "reference",
            match reference.resolved {
                true => format!("largest error {}", figure(reference.max_error, 4)),
                false => format!("not resolved: it may be off by {off} itself, and nothing is judged by it"),
            },
        );
    }
    if let Some(bus) = &summary.bus {
        let refused: u64 = bus.refused.values().sum();
        let refused = if refused == 0 { String::new() } else { format!(", {refused} refused") };
        line("bus", format!("{} frames sent, {} deliveries lost{refused}", bus.sent, bus.lost));
    }
    if let Some(bench) = &summary.bench {
        line("bench", beside_loopback(bench));
        if let Some(clocks) = &bench.own_clock {
            line("clocks", own_clocks(clocks));
        }
        if let Some(WiresSummary { count, extrapolated, .. }) = bench.wires {
            line(
                "wires",
                format!("{count} from node to node, {extrapolated} values came too late for their tick"),
            );
        }
    }
    if let Some(counters) = &summary.counters {
        line("counted", counters.told());
    }
    if let Some(hash) = &summary.trace_hash {
        line("trace", hash.clone());
    }
    for Expectation { name, limit, value, pass } in &summary.expect {
        let value = value.map_or("not measured".to_owned(), |value| figure(value, 4));
        line(if *pass { "pass" } else { "FAIL" }, format!("{name} {value} < {limit}"));
    }
    for check in summary.checks.iter().filter(|check| !check.pass) {
        line("FAIL", format!("{}: {}", check.name, check.text));
    }
    if summary.expect.is_empty() {
        line(
            "note",
            "the scenario expects nothing: only the checks that every run has to pass were made".to_owned(),
        );
    }
    lines.join("\n")
}

/// How the funnels held, and what nodes believe of them where that is something else.
fn funnels(funnel: &FunnelSummary) -> String {
    let mut text = format!("largest |nu|/psi {}, breaches {}", figure(funnel.max_ratio, 4), funnel.breaches);
    if let Some(believed) = funnel.believed {
        let [true_ratio, ratio] = [funnel.max_ratio, believed.max_ratio].map(|ratio| figure(ratio, 4));
        if true_ratio != ratio || funnel.breaches != believed.breaches {
            text += &format!("; nodes believe {ratio}, {}", believed.breaches);
        }
    }
    if funnel.unknown > 0 {
        text += &format!("; not known at {} node-ticks", funnel.unknown);
    }
    text
}

/// How a bench's nodes differ from loopback.
fn beside_loopback(bench: &BenchSummary) -> String {
    let differs = |node: &BenchNodeSummary| {
        let first = node.first_difference?;
        Some(format!(
            "node {} from tick {first}, by at most {}",
            node.node,
            figure(node.largest_deviation, 4)
        ))
    };
    let differences: Vec<_> = bench.nodes.iter().filter_map(differs).collect();
    let unreadable: u64 = bench.nodes.iter().map(|node| node.unreadable).sum();
    let unreadable =
        if unreadable == 0 { String::new() } else { format!("; {unreadable} unreadable frames from nodes") };
    match differences.as_slice() {
        [] => format!("bit for bit as loopback{unreadable}"),
        some => format!("differs from loopback: {}{unreadable}", some.join("; ")),
    }
}

/// What nodes did with clocks of their own.
fn own_clocks(clocks: &OwnClockSummary) -> String {
    let late: u64 = clocks.nodes.iter().map(|node| u64::from(node.extrapolated)).sum();
    format!(
        "largest skew {} s, {late} values came too late for their tick, {} node-ticks not recorded",
        figure(clocks.largest_skew_s, 3),
        clocks.missed
    )
}

/// A number, or the numbers of a vector in brackets.
fn each(values: &[f64]) -> String {
    let figures: Vec<_> = values.iter().map(|&value| figure(value, 6)).collect();
    if let [one] = figures.as_slice() { one.clone() } else { format!("[{}]", figures.join(", ")) }
}

/// The command as typed, quoted for a POSIX shell, with the seed made explicit.
fn repeat(arguments: &[OsString], seed: u64) -> String {
    let mut words: Vec<_> = arguments.iter().map(|word| quote(&word.to_string_lossy())).collect();
    if !words.iter().any(|word| word == "--seed" || word.starts_with("--seed=")) {
        words.push(format!("--seed {seed}"));
    }
    words.join(" ")
}

fn quote(word: &str) -> String {
    let plain = |c: char| c.is_ascii_alphanumeric() || "-_./=:,+@%".contains(c);
    if !word.is_empty() && word.chars().all(plain) {
        word.to_owned()
    } else {
        format!("'{}'", word.replace('\'', r"'\''"))
    }
}

fn check_command(args: &CheckArgs) -> Result<Exit, Failure> {
    let report = check::check(&args.source.load()?);
    if args.json {
        let text = serde_json::to_string_pretty(&report)
            .map_err(|error| Failure { message: error.to_string(), exit: Exit::Defect })?;
        print(&text)?;
    } else {
        print(&report.to_string())?;
    }
    Ok(if report.pass { Exit::Success } else { Exit::BadInput })
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
    let end = host_node::run(line, can, storage, args.uid);
    if let End::CanGone(why) = &end {
        complain(&format!("the CAN interface is gone: {why}"));
    }
    Ok(Exit::from(&end))
}

/// Clap names the option and the value itself, so only what is allowed is left to say.
fn parse_uid(text: &str) -> Result<u64, &'static str> {
    u64::from_str_radix(text, 16).map_err(|_| "must be up to 16 hexadecimal digits")
}

fn completions(shell: clap_complete::Shell) -> Result<Exit, Failure> {
    let mut script = Vec::new();
    clap_complete::generate(shell, &mut Cli::command(), "sim-host", &mut script);
    io::stdout().lock().write_all(&script)?;
    Ok(Exit::Success)
}

/// Clap names the option and the value itself, so only what is allowed is left to say.
fn parse_override(text: &str) -> Result<Override, String> {
    Override::parse(text).map_err(|diagnostic| diagnostic.allowed)
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
        let _ = writeln!(io::stderr().lock(), "{message}");
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_definition_is_sound() {
        Cli::command().debug_assert();
    }

    #[test]
    fn the_repeating_command_has_the_seed_once_and_is_quoted() {
        let words = |list: &[&str]| list.iter().map(OsString::from).collect::<Vec<_>>();
        let command = repeat(&words(&["sim-host", "run", "my file.toml", "--set", "title=\"it's\""]), 3);
        assert_eq!(command, r#"sim-host run 'my file.toml' --set 'title="it'\''s"' --seed 3"#);
        assert_eq!(
            repeat(&words(&["sim-host", "run", "a.toml", "--seed=9"]), 9),
            "sim-host run a.toml --seed=9"
        );
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
