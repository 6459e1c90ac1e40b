//! What can go wrong with nodes behind streams of bytes, and what mends it.

use funnelnet_node::neighbour::{WINDOW_AHEAD, WINDOW_BACK};
use funnelnet_protocol::config::{ConfigError, NodeConfig};
use funnelnet_protocol::service::{StageError, StoreError};
use funnelnet_protocol::update::UpdateError;
use std::path::PathBuf;
use std::time::Duration;
use std::{fmt, io};

/// Why a run on emulated nodes or on boards ended early.
#[derive(Debug)]
pub enum HubError {
    /// The emulator is not installed.
    NoQemu {
        /// What was tried.
        command: String,
    },
    /// The firmware image is not there.
    NoImage {
        /// Where it was looked for.
        path: PathBuf,
    },
    /// A node did not do what it was asked for in time.
    NoAnswer {
        /// Its id.
        node: u8,
        /// What was waited for.
        awaited: &'static str,
        /// How long.
        waited: Duration,
    },
    /// A node's emulator ended, or its serial port is gone.
    Died {
        /// Its id.
        node: u8,
        /// What it was reached by, such as `the emulator`.
        place: String,
        /// What the emulator wrote last, or how it ended.
        detail: String,
    },
    /// A serial port cannot be used.
    Port {
        /// Id of the node that is to be there.
        node: u8,
        /// The port as the user named it.
        port: String,
        /// Why not.
        problem: String,
        /// What to try.
        advice: &'static str,
    },
    /// A CAN interface that was in use fails.
    Can {
        /// Its name.
        interface: String,
        /// Why.
        source: io::Error,
    },
    /// A CAN interface cannot be used.
    NoCan {
        /// The interface, why not, and what to try.
        problem: String,
    },
    /// Another chip than the one that the bench file names.
    Uid {
        /// Id that the bench file gives it.
        node: u8,
        /// What it was reached by.
        place: String,
        /// Unique number in the bench file.
        expected: u64,
        /// Unique number that the chip has.
        found: u64,
    },
    /// A node speaks another version of the wire.
    WireVersion {
        /// Its id.
        node: u8,
        /// Its version.
        found: u8,
    },
    /// A node refused its configuration.
    Refused {
        /// Its id.
        node: u8,
        /// Why.
        reason: ConfigError,
    },
    /// A node has not staged its configuration.
    NotStaged {
        /// Its id.
        node: u8,
        /// Why.
        reason: StageError,
    },
    /// The storage of a node failed as it was to make what is staged its configuration.
    NotCommitted {
        /// Its id.
        node: u8,
    },
    /// A node has not erased what it stores.
    NotErased {
        /// Its id.
        node: u8,
        /// Why.
        reason: StoreError,
    },
    /// A node has another configuration than the one that it was given.
    Checksum {
        /// Its id.
        node: u8,
        /// Checksum of what it was given.
        expected: u32,
        /// Checksum of what it has, 0 where that is nothing.
        found: u32,
    },
    /// Nodes cannot take a program.
    CannotUpdate {
        /// Their ids, and why.
        nodes: Vec<(u8, String)>,
    },
    /// A node refused a step of an update.
    NotTaken {
        /// Its id.
        node: u8,
        /// The step.
        what: &'static str,
        /// Why.
        reason: UpdateError,
    },
    /// A node was to come back with a new program, and has the one that it had.
    OldProgram {
        /// Its id.
        node: u8,
    },
    /// A node was restarted, and is on trial with the same program as before.
    StaysOnTrial {
        /// Its id.
        node: u8,
    },
    /// A node stopped by itself while its program was on trial.
    StoppedOnTrial {
        /// Its id.
        node: u8,
        /// Tick in which it was not there any more.
        tick: u32,
    },
    /// A node has not completed the trial of its program.
    NotConfirmed {
        /// Its id.
        node: u8,
        /// Ticks that it says are left.
        left: u32,
    },
    /// A node went on speaking without saying what was awaited.
    Babbles {
        /// Its id.
        node: u8,
        /// Tick that it was to run.
        tick: u32,
        /// What was waited for.
        awaited: &'static str,
        /// How long.
        waited: Duration,
    },
    /// Two nodes of the bench file are behind one port.
    OnePort {
        /// Its id.
        node: u8,
        /// Id of the one that has it already.
        other: u8,
        /// The port.
        port: String,
    },
    /// Several ports have the USB serial number that a node is known by.
    Ambiguous {
        /// Its id.
        node: u8,
        /// The number.
        number: String,
        /// The ports.
        ports: Vec<String>,
    },
    /// A node ran another tick than the one it was asked for.
    OutOfStep {
        /// Its id.
        node: u8,
        /// Tick that was asked for.
        tick: u32,
        /// Tick that it ran.
        found: u32,
    },
    /// A node that ticks by its own clock has fallen silent.
    Silent {
        /// Its id.
        node: u8,
        /// The last tick that it has told.
        last: Option<u32>,
        /// How long it has said nothing.
        waited: Duration,
    },
    /// Two clocks are farther apart than receivers allow.
    RanApart {
        /// Id of the node that is farther from most others.
        node: u8,
        /// Tick of its newest state.
        tick: u32,
        /// Id of its neighbour.
        other: u8,
        /// Tick of that one's newest state.
        other_tick: u32,
        /// A time master says SYNC among them.
        has_sync: bool,
    },
    /// The ticks that a node tells do not follow each other.
    Leapt {
        /// Its id.
        node: u8,
        /// Tick that was to come.
        from: u32,
        /// Tick that it told.
        to: u32,
    },
    /// Part of what a node said about a tick did not arrive.
    Lost {
        /// Its id.
        node: u8,
        /// Tick that it ran.
        tick: u32,
        /// What is missing.
        what: &'static str,
    },
    /// The user stopped the run.
    Interrupted,
    /// Any of the others, with what the node had to say.
    WithWords {
        /// What went wrong.
        cause: Box<Self>,
        /// How its emulator ended, what that complained of, the end of the node's log, what to try; a line
        /// each.
        words: String,
    },
    /// The operating system refused something.
    Io {
        /// What was tried.
        what: &'static str,
        /// Why not.
        source: io::Error,
    },
}

impl HubError {
    /// Wraps an error of the operating system.
    pub fn io(what: &'static str) -> impl FnOnce(io::Error) -> Self {
        move |source| Self::Io { what, source }
    }

    /// The node whose log may tell more.
    pub(crate) fn node(&self) -> Option<u8> {
        match *self {
            Self::NoAnswer { node, .. }
            | Self::Died { node, .. }
            | Self::Babbles { node, .. }
            | Self::OutOfStep { node, .. }
            | Self::Silent { node, .. }
            | Self::Leapt { node, .. }
            | Self::Lost { node, .. }
            | Self::Checksum { node, .. }
            | Self::NotCommitted { node }
            | Self::NotErased { node, .. }
            | Self::NotTaken { node, .. }
            | Self::OldProgram { node }
            | Self::StaysOnTrial { node }
            | Self::StoppedOnTrial { node, .. }
            | Self::NotConfirmed { node, .. }
            | Self::WireVersion { node, .. } => Some(node),
            _ => None,
        }
    }

    /// Adds why a node may not have been able to read the bytes of `config`. An older one knows fewer of them under the
    /// same wire version.
    pub(super) fn on_reading(self, config: &NodeConfig) -> Self {
        const UNREAD: ConfigError = ConfigError::Malformed;
        let unread = match &self {
            Self::Refused { reason, .. } | Self::NotStaged { reason: StageError::Config(reason), .. } => {
                *reason == UNREAD
            }
            _ => false,
        };
        let keys = [
            (!config.heard.is_none())
                .then_some("safety.heard_limit, safety.heard_rate and safety.drop_after"),
            (!config.time.is_none()).then_some("[sync]"),
        ];
        let keys: Vec<_> = keys.into_iter().flatten().collect();
        if !unread || keys.is_empty() {
            return self;
        }
        let keys = keys.join(", ");
        self.with_words(format!(
            "its firmware may be too old to know {keys}: give it the image of this version, or leave these keys out"
        ))
    }

    /// Adds what the node had to say.
    pub fn with_words(self, words: String) -> Self {
        if words.is_empty() { self } else { Self::WithWords { cause: Box::new(self), words } }
    }
}

impl fmt::Display for HubError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::NoQemu { command } => {
                write!(f, "no emulator: cannot start '{command}'. Install it with: ./ci.sh setup")
            }
            Self::NoImage { path } => {
                write!(f, "no firmware image at {}. Build it with: ./ci.sh firmware", path.display())
            }
            Self::NoAnswer { node, awaited, waited } => {
                write!(f, "node {node} did not answer: no {awaited} within {} s", waited.as_secs_f64())
            }
            Self::Died { node, place, detail } => write!(f, "{place} of node {node} ended: {detail}"),
            Self::Port { node, port, problem, advice } => {
                write!(f, "node {node}: the serial port {port} {problem}. {advice}")
            }
            Self::Can { interface, source } => {
                write!(
                    f,
                    "the CAN interface {interface} fails: {source}. Is it up, is the bus terminated, is anybody else on it?"
                )
            }
            Self::NoCan { problem } => f.write_str(problem),
            Self::Uid { node, place, expected, found } => write!(
                f,
                "{place} of node {node} has the unique number {found:016x}, the bench file says {expected:016x}; nothing was \
                 configured. `sim-host bench --list` shows which board is where"
            ),
            Self::WireVersion { node, found } => write!(
                f,
                "node {node} speaks wire version {found}, this program {}. Build the image of this version: ./ci.sh firmware",
                funnelnet_protocol::WIRE_VERSION
            ),
            Self::Refused { node, reason } => write!(f, "node {node} refused its configuration: {reason}"),
            Self::NotStaged { node, reason } => {
                write!(f, "node {node} has not staged its configuration: {reason}")
            }
            Self::NotCommitted { node } => write!(
                f,
                "the storage of node {node} failed at the commit (FAULT 9): the node goes on with the configuration that it had, and which one it \
                 keeps shows after its next start"
            ),
            Self::NotErased { node, reason } => {
                write!(f, "node {node} has not erased what it stores: {reason}")
            }
            Self::Checksum { node, expected, found } => write!(
                f,
                "node {node} has the configuration with checksum {found:08x} and not {expected:08x}, which it was given"
            ),
            Self::CannotUpdate { nodes } => {
                f.write_str("not all nodes can take this program:")?;
                nodes.iter().try_for_each(|(node, why)| write!(f, "\nnode {node}: {why}"))
            }
            Self::NotTaken { node, what, reason } => {
                write!(f, "node {node} refused the {what}: {reason}")?;
                // It had said that it took the announcement.
                let forgot = *reason == UpdateError::NotBegun;
                if forgot { f.write_str("; it has been restarted meanwhile") } else { Ok(()) }
            }
            Self::OldProgram { node } => write!(
                f,
                "node {node} came back with the program that it had: the new one did not come up there"
            ),
            Self::StaysOnTrial { node } => write!(
                f,
                "node {node} is on trial with a program of another update, and was restarted, but did not go back"
            ),
            Self::StoppedOnTrial { node, tick } => write!(
                f,
                "node {node} stopped by itself at tick {tick} of its trial: does the scenario run so, with sim-host run?"
            ),
            Self::NotConfirmed { node, left } => {
                write!(f, "node {node} has not completed its trial: ticks that it says are left: {left}")
            }
            Self::Babbles { node, tick, awaited, waited } => write!(
                f,
                "node {node} goes on speaking, but said no {awaited} of tick {tick} within {} s",
                waited.as_secs_f64()
            ),
            Self::OnePort { node, other, port } => write!(
                f,
                "node {node}: the serial port {port} is that of node {other}: each node needs a port of its own"
            ),
            Self::Ambiguous { node, number, ports } => write!(
                f,
                "node {node}: the USB serial number {number} is that of several ports: {}. Name the right one by its path in the bench file, in place \
                 of usb_serial: serial = \"{}\"",
                ports.join(", "),
                ports.first().map_or("", String::as_str)
            ),
            Self::OutOfStep { node, tick, found } => {
                write!(f, "node {node} ran tick {found} when it was asked for tick {tick}")
            }
            Self::Silent { node, last, waited } => {
                write!(f, "node {node} has said nothing for {} s; ", waited.as_secs_f64())?;
                match last {
                    Some(tick) => write!(f, "its last tick was {tick}"),
                    None => f.write_str("it has not ticked at all"),
                }
            }
            Self::RanApart { node, tick, other, other_tick, has_sync } => {
                let why = match has_sync {
                    true => {
                        "its clock is off by more than the SYNC of a time master make up for, it does not hear them"
                    }
                    false => "its clock is off, the run is too long for clocks that nobody synchronises",
                };
                write!(
                    f,
                    "node {node} runs apart from the others: its newest state is of tick {tick}, that of node {other} of tick {other_tick}, and a \
                     node takes none that is more than {WINDOW_AHEAD} ahead of its own tick or {WINDOW_BACK} behind: {why}, or its line is too slow"
                )
            }
            Self::Leapt { node, from, to } => {
                write!(f, "node {node} told of tick {to} where tick {from} was to come")
            }
            Self::Lost { node, tick, what } => {
                write!(f, "node {node} ran tick {tick}, but its {what} did not arrive")
            }
            Self::WithWords { cause, words } => write!(f, "{cause}\n{words}"),
            Self::Interrupted => f.write_str("interrupted"),
            Self::Io { what, source } => write!(f, "cannot {what}: {source}"),
        }
    }
}

impl std::error::Error for HubError {}
