//! What the command line takes: commands, options, and what `--help` says of them.

use std::path::PathBuf;

use clap::{Args, Parser, Subcommand};

use crate::bench;
use crate::run::Fidelity;
use crate::scenario::{Override, parse_duration};

// Here and below: a line for each paragraph, so that it is wrapped to the terminal's width.
const AFTER_HELP: &str = "\
Examples:
  sim-host check scenarios/five-agents.toml
  sim-host run scenarios/five-agents.toml --out out/five
  sim-host run scenarios/five-agents.toml --set graph.kind=star

Exit codes: 0 all expectations hold, 1 one failed, 2 bad usage or configuration, \
3 no such hardware or emulator, 4 a defect of the program, 129 stopped by SIGHUP, \
130 stopped by SIGINT (Ctrl-C) or SIGTERM. The worst wins: 4, 2, 3, 129 or 130, 1.";

/// Where `./ci.sh firmware` leaves the image, seen from the root of the repository.
pub(super) const DEFAULT_IMAGE: &str = "firmware/target/thumbv7em-none-eabihf/release/mps2_an386";

const RUN_HELP: &str = "\
Examples:
  sim-host run scenarios/five-agents.toml
  sim-host run scenarios/five-agents.toml --on reference --out ref --every 10ms
  sim-host run scenarios/lossy-ring.toml --set bus.loss=0.3 --junit lossy.xml
  sim-host run scenarios/five-agents.toml --seed 7 --set node.3.state=-2
  sim-host run - --json - < scenarios/five-agents.toml";

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
push, whether the sampled law, followed in f64 as far as that is cheap, stays inside its funnels, whether that \
is what the scenario expects, and what the states would take of a real bus. Takes up to 2,000 nodes; a run \
takes 127. Ends with code 2 where a finding is FAIL, and with --strict with code 1 where one is WARN.

Examples:
  sim-host check scenarios/five-agents.toml
  sim-host check scenarios/five-agents.toml --set time.tick=20ms --json";

const DIFF_HELP: &str = "\
Compares what --out has left in two folders, or two trajectory.csv: values to the bit and columns by their names, \
then the figures of the summaries, but for times of the machine, commands and versions.

Exit codes: 0 equal, 1 different, 2 not to be read.

Examples:
  sim-host diff out/yesterday out/today
  sim-host diff out/loopback out/bench --plot both.svg
  sim-host diff a/trajectory.csv b/trajectory.csv --json";

const REPLAY_HELP: &str = "\
The node is made of the scenario. It gets every frame that the others have sent, as it would have come on the bus, and \
is compared frame by frame up to the first difference, which is told with its tick, its field and both values.

Exit codes: 0 equal to the scenario's last tick, 1 different, or the log ends before, 2 not to be read, or a log of \
another scenario.

Examples:
  sim-host run scenarios/five-agents.toml --set bus.model=can --out out/can
  sim-host replay out/can/can.log --scenario out/can/scenario.toml --node 3
  candump -L can0 > bench.log
  sim-host replay bench.log --scenario scenarios/five-agents.toml --node 3";

const REPORT_HELP: &str = "\
Writes one page, report.html in the folder, that needs no network, fits a phone and prints: of a run its verdict, pictures, margins, \
events, bus and provenance; of two runs how they differ; of a sweep its table, its failures first, after its shards have been merged \
into runs.csv. The same folder gives the same page.

Exit codes: 0 written, whatever the verdict that it shows, 2 not.

Examples:
  sim-host run scenarios/five-agents.toml --out out/five
  sim-host report out/five
  sim-host report out/yesterday out/today --html both.html
  sim-host report out/five --html - | gzip > five.html.gz";

const SCHEMA_HELP: &str = "\
Examples:
  sim-host schema > scenario.schema.json
  and as the first line of a scenario beside it:  #:schema ./scenario.schema.json";

const COMPLETIONS_HELP: &str = "\
Examples:
  source <(sim-host completions bash)
  sim-host completions fish > ~/.config/fish/completions/sim-host.fish";

const MAN_HELP: &str = "\
Examples:
  sim-host man | man -l -
  sim-host man run > ~/.local/share/man/man1/sim-host-run.1";

/// Agreement with a guarantee: runs funnel-coupling scenarios, from the equations to emulated nodes.
#[derive(Debug, Parser)]
#[command(name = "sim-host", version, about, after_help = AFTER_HELP, max_term_width = 100)]
pub struct Cli {
    #[command(subcommand)]
    pub(super) command: Command,
}

/// The files that have a schema.
#[derive(Clone, Copy, Debug, clap::ValueEnum)]
pub(super) enum SchemaOf {
    /// The scenario file
    Scenario,
}

#[derive(Debug, Subcommand)]
pub(super) enum Command {
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
    /// Compare two recorded runs: where they differ first, and how far apart they come
    #[command(after_help = DIFF_HELP)]
    Diff(DiffArgs),
    /// Feed a log of CAN to one node's real code, and compare what it sends with what the log says it sent
    #[command(after_help = REPLAY_HELP)]
    Replay(ReplayArgs),
    /// Write a page to hand over, of a run, of two runs side by side, or of a sweep
    #[command(after_help = REPORT_HELP)]
    Report(ReportArgs),
    /// Print the JSON Schema of the scenario file, from which editors know its keys
    #[command(after_help = SCHEMA_HELP)]
    Schema {
        /// The file to describe
        #[arg(value_enum, default_value = "scenario")]
        file: SchemaOf,
    },
    /// Print a completion script for a shell
    #[command(after_help = COMPLETIONS_HELP)]
    Completions {
        /// The shell to complete for
        shell: clap_complete::Shell,
    },
    /// Print the manual page of the program or of one of its commands
    #[command(after_help = MAN_HELP)]
    Man {
        /// The command; none for the program
        command: Option<String>,
    },
}

#[derive(Args, Debug)]
pub(super) struct Source {
    /// The scenario file; - is standard input
    #[arg(value_name = "SCENARIO.toml")]
    pub(super) scenario: PathBuf,
    #[command(flatten)]
    pub(super) settings: Settings,
}

/// What replaces values of the scenario file.
#[derive(Args, Debug)]
pub(super) struct Settings {
    /// Root of every random stream, instead of the scenario's
    #[arg(long, value_name = "N")]
    pub(super) seed: Option<u64>,
    /// Set one value: TOML, or a bare string; node.3.state means the [[node]] with id 3 (repeatable)
    #[arg(long, value_name = "section.key=value", value_parser = parse_override)]
    pub(super) set: Vec<Override>,
}

#[derive(Args, Debug)]
pub(super) struct RunArgs {
    #[command(flatten)]
    pub(super) source: Source,
    /// What runs the scenario
    #[arg(long, value_enum, default_value = "loopback")]
    pub(super) on: Fidelity,
    #[command(flatten)]
    pub(super) output: OutputArgs,
}

#[derive(Args, Debug)]
pub(super) struct NodeArgs {
    /// The line to the host: a serial port
    #[arg(long, value_name = "PATH", required_unless_present = "inherited")]
    pub(super) serial: Option<String>,
    /// Bit rate of the serial port
    #[arg(long, value_name = "BIT/S", default_value_t = bench::DEFAULT_BAUD)]
    pub(super) baud: u32,
    /// Send and hear states on this CAN interface, and leave the line to the host
    #[arg(long, value_name = "INTERFACE")]
    pub(super) can: Option<String>,
    /// In frames of CAN FD, as all nodes of that bus then must
    #[arg(long, requires = "can")]
    pub(super) can_fd: bool,
    /// Keep its configuration in this file, as a board does in its flash; made where it is missing
    #[arg(long, value_name = "FILE")]
    pub(super) storage: Option<PathBuf>,
    /// The unique number that it says it has, in hexadecimal digits
    #[arg(long, value_name = "HEX", default_value = "0", value_parser = parse_uid)]
    pub(super) uid: u64,
    /// The line is a socket at standard input
    #[arg(long, hide = true, conflicts_with = "serial")]
    pub(super) inherited: bool,
}

#[derive(Args, Debug)]
pub(super) struct BenchArgs {
    /// The scenario file; - is standard input
    #[arg(value_name = "SCENARIO.toml", required_unless_present_any = ["list", "erase"])]
    pub(super) scenario: Option<PathBuf>,
    #[command(flatten)]
    pub(super) settings: Settings,
    /// The bench file: which node is where
    #[arg(long, value_name = "bench.toml", required_unless_present = "list")]
    pub(super) bench: Option<PathBuf>,
    /// Run nothing; ask every serial port, and those of the bench file, who is there
    #[arg(long, conflicts_with_all = ["scenario", "seed", "set", "out", "every", "json", "junit", "no_can_log", "pcapng"])]
    pub(super) list: bool,
    /// Run nothing; store the scenario's configurations in all nodes, or in none, for every start to come
    #[arg(long, conflicts_with_all = ["list", "out", "every", "json", "junit", "no_can_log", "pcapng"])]
    pub(super) commission: bool,
    /// Run nothing; make all nodes of the bench file blank at their next start
    #[arg(long, conflicts_with_all = ["scenario", "seed", "set", "list", "commission", "out", "every", "json", "junit", "no_can_log", "pcapng"])]
    pub(super) erase: bool,
    #[command(flatten)]
    pub(super) output: OutputArgs,
}

/// What is written and said, and the image of emulated nodes.
#[derive(Args, Debug)]
pub(super) struct OutputArgs {
    /// Folder for trajectory.csv, summary.json and plots; made where it is missing. Files of an earlier run there go first
    #[arg(long, value_name = "DIR")]
    pub(super) out: Option<PathBuf>,
    /// Time between two rows of the trajectory, such as 100ms [default: every tick, up to 2,000 rows]
    #[arg(long, value_name = "DURATION", value_parser = parse_duration)]
    pub(super) every: Option<u64>,
    /// File for the summary as JSON; - is standard output, without the text
    #[arg(long, value_name = "FILE")]
    pub(super) json: Option<PathBuf>,
    /// File for the verdicts as JUnit XML, or for why there are none; - is standard output, without the text
    #[arg(long, value_name = "FILE")]
    pub(super) junit: Option<PathBuf>,
    /// Leave can.log, the frames and errors of a run on CAN, out of the folder
    #[arg(long, requires = "out")]
    pub(super) no_can_log: bool,
    /// Write can.pcapng into the folder, too: the same for Wireshark, with nanoseconds
    #[arg(long, requires = "out")]
    pub(super) pcapng: bool,
    /// Firmware image (ELF) for emulated nodes [default: firmware/target/thumbv7em-none-eabihf/release/mps2_an386]
    #[arg(long, value_name = "FILE")]
    pub(super) image: Option<PathBuf>,
    /// Say nothing but errors
    #[arg(short, long, conflicts_with = "verbose")]
    pub(super) quiet: bool,
    /// Say what nodes report, too
    #[arg(short, long)]
    pub(super) verbose: bool,
}

#[derive(Args, Debug)]
pub(super) struct CheckArgs {
    #[command(flatten)]
    pub(super) source: Source,
    /// Print JSON instead of text
    #[arg(long)]
    pub(super) json: bool,
    /// End with code 1 where there is a warning
    #[arg(long)]
    pub(super) strict: bool,
}

#[derive(Args, Debug)]
pub(super) struct DiffArgs {
    /// A folder that --out has filled, or a trajectory.csv
    #[arg(value_name = "A")]
    pub(super) a: PathBuf,
    /// The other one
    #[arg(value_name = "B")]
    pub(super) b: PathBuf,
    /// Print JSON instead of text
    #[arg(long)]
    pub(super) json: bool,
    /// Draw the states of both into one picture (SVG)
    #[arg(long, value_name = "FILE")]
    pub(super) plot: Option<PathBuf>,
}

#[derive(Args, Debug)]
pub(super) struct ReplayArgs {
    /// The log: can.log of a run or of a bench, or of candump -L
    #[arg(value_name = "LOG")]
    pub(super) log: PathBuf,
    /// The scenario that the log is of; a folder of outputs has it as scenario.toml
    #[arg(long, value_name = "SCENARIO.toml")]
    pub(super) scenario: PathBuf,
    #[command(flatten)]
    pub(super) settings: Settings,
    /// The id of the node
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u8).range(1..=127))]
    pub(super) node: u8,
    /// Print JSON instead of text
    #[arg(long)]
    pub(super) json: bool,
}

#[derive(Args, Debug)]
pub(super) struct ReportArgs {
    /// A folder that run, bench or sweep has filled
    #[arg(value_name = "DIR")]
    pub(super) folder: PathBuf,
    /// A second run, to be compared with the first
    #[arg(value_name = "OTHER", requires = "html")]
    pub(super) other: Option<PathBuf>,
    /// File for the page instead of report.html in the folder; - is standard output
    #[arg(long, value_name = "FILE")]
    pub(super) html: Option<PathBuf>,
}

/// Clap names the option and the value itself, so only what is allowed is left to say.
fn parse_uid(text: &str) -> Result<u64, &'static str> {
    u64::from_str_radix(text, 16).map_err(|_| "must be up to 16 hexadecimal digits")
}

/// Clap names the option and the value itself, so only what is allowed is left to say.
fn parse_override(text: &str) -> Result<Override, String> {
    Override::parse(text).map_err(|diagnostic| diagnostic.allowed)
}
