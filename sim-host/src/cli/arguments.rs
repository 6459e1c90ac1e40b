//! What the command line takes: commands, options, and what `--help` says of them.

use std::path::PathBuf;

use clap::{Args, Parser, Subcommand};

use crate::bench;
use crate::run::Fidelity;
use crate::scenario::{Override, parse_duration};
use crate::sweep::{Axis, Range, Shard};

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
  sim-host run large.toml --out out/large --nodes 1,5,9
  sim-host run - --json - < scenarios/five-agents.toml";

const BENCH_HELP: &str = "\
The host configures the nodes, makes them tick together and relays their states, so that they compute the same bits \
as in `run`. bench.csv has the times at which it sent and read each frame. docs/book/src/bench.md lists the keys of a \
bench file.

--commission, --erase and --update stop nodes that are running. These stay stopped, even if the command fails.

--update sends a program (the ELF file of an image, or its bytes as they are in flash) to all nodes of the scenario. When all \
have read it back, all swap, and run the scenario for as many ticks as their trial takes (100), with their actuators. Whatever \
fails before the last of these ticks, Ctrl-C included: all go back to the program that they had. docs/book/src/update.md \
says which boards can.

Examples:
  sim-host bench --list
  sim-host bench scenarios/five-agents.toml --bench bench.toml --commission
  sim-host bench scenarios/five-agents.toml --bench bench.toml --out out/bench
  sim-host bench --bench bench.toml --erase
  sim-host bench three.toml --bench bench.toml --update image.elf";

const NODE_HELP: &str = "\
The node is blank until a bench configures it over its line, and the process ends when the line is closed. It has no \
plant. It keeps its configuration only with --storage. A bench starts such a node by itself where its file says \
`host = true`.

Examples:
  sim-host node --serial /dev/ttyUSB0
  sim-host node --serial /dev/ttyUSB0 --can can0
  sim-host node --serial /dev/ttyUSB0 --can can0 --can-fd";

const CHECK_HELP: &str = "\
Runs nothing. Answers, for up to 2,000 nodes (a run takes 127; with bus.model = \"none\" what scales is answered):
  - do the paper's assumptions hold, with which constants, and what do its bounds give over time?
  - how narrow a funnel can the tick hold?
  - what do the emergent dynamics predict, and how large an input does each node need?
  - does the sampled law stay inside its funnels? It is followed in f64 where that is cheap.
  - is that what the scenario expects?
  - how much of a real bus would the states take?

Exit codes: 0 no finding is FAIL, 1 with --strict one is WARN, 2 one is FAIL, or the scenario is refused.

Examples:
  sim-host check scenarios/five-agents.toml
  sim-host check scenarios/five-agents.toml --set time.tick=20ms --json";

const DIFF_HELP: &str = "\
Compares two folders that --out has filled, or two files trajectory.csv. Values are compared to the bit, columns by \
their names. Then come the figures of the summaries, except times of the machine, commands and versions.

Exit codes: 0 equal, 1 different, 2 a file cannot be read.

Examples:
  sim-host diff out/yesterday out/today
  sim-host diff out/loopback out/bench --plot both.svg
  sim-host diff a/trajectory.csv b/trajectory.csv --json";

const REPLAY_HELP: &str = "\
The scenario says what the node is. It gets every frame of the others in the order and at the times of the log. What \
it sends is compared frame by frame with the log, up to the first difference; this is printed with its tick, its field \
and both values.

Exit codes: 0 equal up to the scenario's last tick, 1 different, or the log ends earlier, 2 the log cannot be read or \
is of another scenario.

Examples:
  sim-host run scenarios/five-agents.toml --set bus.model=can --out out/can
  sim-host replay out/can/can.log --scenario out/can/scenario.toml --node 3
  candump -L can0 > bench.log
  sim-host replay bench.log --scenario scenarios/five-agents.toml --node 3";

const SWEEP_HELP: &str = "\
Runs every point of a design with every seed, on all cores, and writes a row for each run into DIR/runs.csv. Repetition r \
has the seed of the scenario plus r - 1 at every point. A run that does not pass prints the command that repeats it, and \
leaves its scenario in DIR/failed. After Ctrl-C, a crash or a power cut the same command with --resume goes on.

Values are as in --set. A list or a drawing comes with every combination of the grid.

Exit codes: 0 every run passes, 1 one fails, 2 nothing was run, or a run is refused; a signal as in run.

Examples:
  sim-host sweep five.toml --grid bus.loss=0.0,0.1,0.3 --seeds 20 --out loss
  sim-host sweep five.toml --lhs 200 --range bus.loss=1e-3..0.3:log --out o
  sim-host sweep five.toml --list points.csv --shard 2/8 --resume --out o";

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

const EXPORT_HELP: &str = "\
dbc: what each identifier on CAN means, for cantools, SavvyCAN and others; signals are called as the columns of trajectory.csv. \
The frames are those of CAN FD with bus.model = \"can-fd\", else classic ones.

graphml: the graph with its weights, for networkx, igraph, Gephi and others; a scenario reads it back with graph.kind = \"file\".

Examples:
  sim-host export dbc scenarios/five-agents.toml --out five.dbc
  sim-host export graphml scenarios/five-agents.toml --out ring.graphml";

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

/// The command line of `sim-host`; what `--help` says first is the package's description.
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

/// What can be exported.
#[derive(Clone, Copy, Debug, clap::ValueEnum)]
pub(super) enum Exported {
    /// The frames on CAN, as a DBC file
    Dbc,
    /// The graph, as a GraphML file
    Graphml,
}

#[derive(Debug, Subcommand)]
pub(super) enum Command {
    /// Run a scenario and check its expectations
    #[command(after_help = RUN_HELP)]
    Run(RunArgs),
    /// Run a scenario on nodes behind serial ports or on CAN, beside the same run in loopback
    #[command(after_help = BENCH_HELP)]
    Bench(BenchArgs),
    /// Run the firmware's node in this process: on a computer with a CAN adapter, or to try a bench without boards
    #[command(after_help = NODE_HELP)]
    Node(NodeArgs),
    /// Run a scenario over many values and seeds, on all cores, with a table of all figures
    #[command(after_help = SWEEP_HELP)]
    Sweep(SweepArgs),
    /// Check a scenario's assumptions, bounds and capacity without running it
    #[command(after_help = CHECK_HELP)]
    Check(CheckArgs),
    /// Compare two recorded runs: where they first differ, and by how much at most
    #[command(after_help = DIFF_HELP)]
    Diff(DiffArgs),
    /// Feed a log of CAN to one node's real code, and compare what it sends with what the log says it sent
    #[command(after_help = REPLAY_HELP)]
    Replay(ReplayArgs),
    /// Write a page to hand over, of a run, of two runs side by side, or of a sweep
    #[command(after_help = REPORT_HELP)]
    Report(ReportArgs),
    /// Write a scenario's frames (DBC) or its graph (GraphML) for other tools
    #[command(after_help = EXPORT_HELP)]
    Export(ExportArgs),
    /// Print a JSON Schema of the scenario file, by which editors complete and check its keys
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
        /// The command; without one, the page of the program itself
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
    /// Seed of every random stream, in place of the scenario's
    #[arg(long, value_name = "N")]
    pub(super) seed: Option<u64>,
    /// Replace one value of the scenario, by TOML or a bare string; node.3.state means the [[node]] with id 3 (repeatable)
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
    /// Ids of nodes that get columns in trajectory.csv, as 1,5,9; for runs with bus.model = "none", which have none else
    #[arg(long, value_name = "IDS", value_delimiter = ',', requires = "out")]
    pub(super) nodes: Vec<usize>,
    /// Threads of a run with bus.model = "none"; no figure depends on them [default: one per core]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u16).range(1..))]
    pub(super) threads: Option<u16>,
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
    /// CAN interface on which states are sent and heard; the line then only serves the host
    #[arg(long, value_name = "INTERFACE")]
    pub(super) can: Option<String>,
    /// Use frames of CAN FD, as all nodes of that bus then must
    #[arg(long, requires = "can")]
    pub(super) can_fd: bool,
    /// File that keeps its configuration, as a board does in its flash; made if it is missing
    #[arg(long, value_name = "FILE")]
    pub(super) storage: Option<PathBuf>,
    /// The unique number that it tells the host, in hexadecimal digits
    #[arg(long, value_name = "HEX", default_value = "0", value_parser = parse_uid)]
    pub(super) uid: u64,
    /// How much too fast its clock is, ppm, to try what boards with crystals of their own do
    #[arg(long, value_name = "PPM", default_value_t = 0.0, allow_negative_numbers = true, value_parser = parse_drift)]
    pub(super) drift_ppm: f64,
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
    #[arg(long, conflicts_with_all = ["scenario", "seed", "set", "out", "every", "json", "junit", "no_can_log", "pcapng", "mcap"])]
    pub(super) list: bool,
    /// Run nothing; store the scenario's configurations in all nodes, or in none, so that they survive a restart
    #[arg(long, conflicts_with_all = ["list", "out", "every", "json", "junit", "no_can_log", "pcapng", "mcap"])]
    pub(super) commission: bool,
    /// Run nothing; make all nodes of the bench file blank at their next start
    #[arg(long, conflicts_with_all = ["scenario", "seed", "set", "list", "commission", "out", "every", "json", "junit", "no_can_log", "pcapng", "mcap"])]
    pub(super) erase: bool,
    /// Record nothing; give all nodes of the scenario this program, or none: an ELF file, or bytes as they are in flash
    #[arg(long, value_name = "IMAGE", conflicts_with_all = ["list", "commission", "erase", "out", "every", "json", "junit", "no_can_log", "pcapng", "mcap", "image", "verbose"])]
    pub(super) update: Option<PathBuf>,
    #[command(flatten)]
    pub(super) output: OutputArgs,
}

/// What is written and said, and the image of emulated nodes.
#[derive(Args, Debug)]
pub(super) struct OutputArgs {
    /// Folder for trajectory.csv, summary.json and plots; made if it is missing. Files of an earlier run in it are removed first
    #[arg(long, value_name = "DIR")]
    pub(super) out: Option<PathBuf>,
    /// Time between two rows of the trajectory, such as 100ms [default: every tick, up to 2,000 rows]
    #[arg(long, value_name = "DURATION", value_parser = parse_duration)]
    pub(super) every: Option<u64>,
    /// File for the summary as JSON; - is standard output, in place of the text
    #[arg(long, value_name = "FILE")]
    pub(super) json: Option<PathBuf>,
    /// File for the verdicts as JUnit XML, or for the reason why there are none; - is standard output, in place of the text
    #[arg(long, value_name = "FILE")]
    pub(super) junit: Option<PathBuf>,
    /// Do not write can.log, the frames and errors of a run on CAN, into the folder
    #[arg(long, requires = "out")]
    pub(super) no_can_log: bool,
    /// Also write can.pcapng into the folder: the same for Wireshark, with times in nanoseconds
    #[arg(long, requires = "out")]
    pub(super) pcapng: bool,
    /// Also write run.mcap into the folder: rows and events for Foxglove and PlotJuggler
    #[arg(long, requires = "out")]
    pub(super) mcap: bool,
    /// Firmware image (ELF) for emulated nodes [default: firmware/target/thumbv7em-none-eabihf/release/mps2_an386]
    #[arg(long, value_name = "FILE")]
    pub(super) image: Option<PathBuf>,
    /// Print errors only
    #[arg(short, long, conflicts_with = "verbose")]
    pub(super) quiet: bool,
    /// Also print what nodes report
    #[arg(short, long)]
    pub(super) verbose: bool,
}

#[derive(Args, Debug)]
pub(super) struct SweepArgs {
    #[command(flatten)]
    pub(super) source: Source,
    /// Values of a key, TOML or bare strings; several grids are combined (repeatable)
    #[arg(long, value_name = "key=a,b,c", value_parser = Axis::parse)]
    pub(super) grid: Vec<Axis>,
    /// Points from a CSV file: keys in its first line, then a line for each point
    #[arg(long, value_name = "FILE", conflicts_with_all = ["sobol", "lhs"])]
    pub(super) list: Option<PathBuf>,
    /// Draw so many points of a Sobol sequence, best a power of two, from the ranges
    #[arg(long, value_name = "N", conflicts_with = "lhs")]
    pub(super) sobol: Option<u64>,
    /// Draw a Latin hypercube of so many points from the ranges
    #[arg(long, value_name = "N")]
    pub(super) lhs: Option<u64>,
    /// Range of a key for --sobol and --lhs: real numbers, whole ones, or times; :log for equal ratios (repeatable)
    #[arg(long, value_name = "key=low..high[:log]", value_parser = Range::parse)]
    pub(super) range: Vec<Range>,
    /// Seed of the drawing
    #[arg(long, value_name = "N", default_value_t = 1)]
    pub(super) design_seed: u64,
    /// Repetitions of each point, each with a seed of its own
    #[arg(long, value_name = "K", default_value_t = 1, value_parser = clap::value_parser!(u64).range(1..))]
    pub(super) seeds: u64,
    /// Mix the point into the seed: no two points share random streams
    #[arg(long)]
    pub(super) independent: bool,
    /// Run every n-th run only, from the i-th on, into runs-i-of-n.csv; the last shard to end merges them
    #[arg(long, value_name = "i/n")]
    pub(super) shard: Option<Shard>,
    /// Go on with the rows that are there; begins where there are none
    #[arg(long)]
    pub(super) resume: bool,
    /// Threads [default: as many as there are cores]
    #[arg(long, value_name = "J", value_parser = clap::value_parser!(u16).range(1..=4096))]
    pub(super) jobs: Option<u16>,
    /// Folder for the table; made where it is missing
    #[arg(long, value_name = "DIR")]
    pub(super) out: PathBuf,
    /// A run that is refused is a row, and not the end of the sweep
    #[arg(long)]
    pub(super) allow_refused: bool,
    /// Once every run is there, also write runs.parquet: the table with a type for each column; takes a build with --features parquet
    #[arg(long)]
    pub(super) parquet: bool,
    /// Say nothing but errors and runs that do not pass
    #[arg(short, long)]
    pub(super) quiet: bool,
}

#[derive(Args, Debug)]
pub(super) struct CheckArgs {
    #[command(flatten)]
    pub(super) source: Source,
    /// Print JSON instead of text
    #[arg(long)]
    pub(super) json: bool,
    /// End with code 1 if there is a warning
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
    /// The log: can.log of a run or of a bench, or what candump -L wrote
    #[arg(value_name = "LOG")]
    pub(super) log: PathBuf,
    /// The scenario that was run; the folder of --out has it as scenario.toml
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

#[derive(Args, Debug)]
pub(super) struct ExportArgs {
    /// What to write
    #[arg(value_enum, value_name = "WHAT")]
    pub(super) what: Exported,
    #[command(flatten)]
    pub(super) source: Source,
    /// File to write; without it, and as -, standard output
    #[arg(long, value_name = "FILE")]
    pub(super) out: Option<PathBuf>,
}

/// Clap names the option and the value itself, so only what is allowed is left to say.
fn parse_uid(text: &str) -> Result<u64, &'static str> {
    u64::from_str_radix(text, 16).map_err(|_| "must be up to 16 hexadecimal digits")
}

/// Clap names the option and the value itself, so only what is allowed is left to say.
fn parse_drift(text: &str) -> Result<f64, &'static str> {
    let drift = text.parse().ok().filter(|drift: &f64| drift.abs() <= 1000.0);
    drift.ok_or("must be a number from -1000 to 1000 (ppm)")
}

/// Clap names the option and the value itself, so only what is allowed is left to say.
fn parse_override(text: &str) -> Result<Override, String> {
    Override::parse(text).map_err(|diagnostic| diagnostic.allowed)
}
