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
    /// Any of the others, with what the node had to say.
    WithWords {
        /// What went wrong.
        cause: Box<Self>,
        /// How its emulator ended, what that complained of, and the end of the node's log; a line each.
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

impl EmulatorError {
    /// Wraps an error of the operating system.
    pub fn io(what: &'static str) -> impl FnOnce(io::Error) -> Self {
        move |source| Self::Io { what, source }
    }

    /// The node whose log may tell more.
    pub(super) fn node(&self) -> Option<u8> {
        match *self {
            Self::NoAnswer { node, .. } | Self::Died { node, .. } | Self::OutOfStep { node, .. } => {
                Some(node)
            }
            _ => None,
        }
    }

    /// Adds what the node had to say.
    pub(super) fn with_words(self, words: String) -> Self {
        if words.is_empty() { self } else { Self::WithWords { cause: Box::new(self), words } }
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
            Self::WithWords { cause, words } => write!(f, "{cause}\n{words}"),
            Self::Interrupted => write!(f, "interrupted; all emulators are ended"),
            Self::Io { what, source } => write!(f, "cannot {what}: {source}"),
        }
    }
}

impl std::error::Error for EmulatorError {}
