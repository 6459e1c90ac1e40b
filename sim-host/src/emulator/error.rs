//! What can go wrong with emulated nodes, and what mends it.

use funnel_protocol::config::ConfigError;
use std::path::PathBuf;
use std::time::Duration;
use std::{fmt, io};

/// Why a run on emulated nodes ended early.
#[derive(Debug)]
pub enum EmulatorError {
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
    /// A node's emulator ended.
    Died {
        /// Its id.
        node: u8,
        /// What the emulator wrote last, or how it ended.
        detail: String,
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
    /// A node ran another tick than the one it was asked for.
    OutOfStep {
        /// Its id.
        node: u8,
        /// Tick that was asked for.
        tick: u32,
        /// Tick that it ran.
        found: u32,
    },
    /// The user stopped the run.
    Interrupted,
    /// The operating system refused something.
    Io {
        /// What was tried.
        what: &'static str,
        /// Why not.
        source: io::Error,
    },
}

impl EmulatorError {
    /// Wraps an error of the operating system.
    pub fn io(what: &'static str) -> impl FnOnce(io::Error) -> Self {
        move |source| Self::Io { what, source }
    }
}

impl fmt::Display for EmulatorError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::NoQemu { command } => {
                write!(f, "no emulator: cannot start '{command}'. Install it with: ./ci.sh setup")
            }
            Self::NoImage { path } => {
                write!(f, "no firmware image at {}. Build it with: ./ci.sh firmware", path.display())
            }
            Self::NoAnswer { node, awaited, waited } => write!(
                f,
                "node {node} did not answer: no {awaited} within {} s. An image of another version? Build it with: \
                 ./ci.sh firmware",
                waited.as_secs()
            ),
            Self::Died { node, detail } => write!(f, "the emulator of node {node} ended: {detail}"),
            Self::WireVersion { node, found } => write!(
                f,
                "node {node} speaks wire version {found}, this program {}. Build the image with: ./ci.sh firmware",
                funnel_protocol::WIRE_VERSION
            ),
            Self::Refused { node, reason } => write!(f, "node {node} refused its configuration: {reason}"),
            Self::OutOfStep { node, tick, found } => {
                write!(f, "node {node} ran tick {found} when it was asked for tick {tick}")
            }
            Self::Interrupted => write!(f, "interrupted; all emulators are ended"),
            Self::Io { what, source } => write!(f, "cannot {what}: {source}"),
        }
    }
}

impl std::error::Error for EmulatorError {}
